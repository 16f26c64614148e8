"""Stands for the phone of Pupil Labs' glasses: REST, RTSP and its packets, at a test's pace."""

from __future__ import annotations

import json
import re
import socket
import struct
import threading
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

RATE_HZ = 200.0
EPOCH_S = 1_790_000_000.0
"""Unix time at our 0."""
CLOCK_HZ = 90_000
FIRST_STAMP = 2**32 - CLOCK_HZ * 3
"""So that stamps begin anew within a session."""


def in_camera(place):
    """Place in the glasses' camera of a point of the screen: turned, small, and in perspective."""
    x, y = place
    w = 1 + x * 5e-5 - y * 3e-5
    return (0.4 * x - 0.05 * y + 420) / w, (0.06 * x + 0.41 * y + 310) / w


class PupilPhone:
    """Answers on free ports of this computer."""

    def __init__(self, eye, glasses=True) -> None:
        self.eye, self.glasses = eye, glasses
        self.asked: list[tuple[str, object]] = []
        self.sent: list[bytes] = []
        self.skips = 0
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._client: tuple[int, int] | None = None
        self._plays = threading.Event()
        self._next, self._number = 0, 65_500
        self._reported = -1e9
        self._listener = self._peer = None
        self._rtsp_port = 0
        self.listen()
        phone = self

        class Handler(BaseHTTPRequestHandler):
            def _answer(self, result) -> None:
                data = json.dumps({"message": "Success", "result": result}).encode()
                self.send_response(200)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def do_GET(self) -> None:
                self._answer(phone.status())

            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                phone.asked.append((self.path, body))
                self._answer({"id": "7f3a"})

            def log_message(self, *_) -> None:
                pass

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = self._http.server_port
        threading.Thread(target=self._http.serve_forever, args=(0.05,), daemon=True).start()

    def status(self):
        if self._listener is None:
            return []
        sensor = {
            "sensor": "gaze", "conn_type": "DIRECT", "connected": self.glasses,
            "ip": "127.0.0.1", "port": self._rtsp_port, "params": "camera=gaze",
            "protocol": "rtsp", "stream_error": False,
        }  # fmt: skip
        return [
            {"model": "Phone", "data": {"device_name": "a phone", "ip": "127.0.0.1"}},
            {"model": "Sensor", "data": sensor | {"sensor": "world"}},
            {"model": "Sensor", "data": sensor},
        ]

    def listen(self) -> None:
        self._plays.clear()
        self._listener = socket.create_server(("127.0.0.1", self._rtsp_port))
        self._rtsp_port = self._listener.getsockname()[1]
        threading.Thread(target=self._serve, args=(self._listener,), daemon=True).start()

    def drop(self) -> None:
        for each in (self._listener, self._peer):
            if each is not None:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self._listener = self._peer = None

    def _serve(self, listener) -> None:
        with suppress(OSError):
            self._peer, _ = listener.accept()
            peer, rest = self._peer, ""
            while data := peer.recv(4096):
                *requests, rest = (rest + data.decode()).split("\r\n\r\n")
                for request in requests:
                    peer.sendall(self._reply(request))

    def _reply(self, request: str) -> bytes:
        number = re.search(r"CSeq: (\d+)", request)[1]
        head, body = f"RTSP/1.0 200 OK\r\nCSeq: {number}\r\n", ""
        if request.startswith("DESCRIBE"):
            body = (
                f"v=0\r\nm=application 0 RTP/AVP 96\r\na=rtpmap:96 com.pupillabs.gaze1/{CLOCK_HZ}"
            )
            body += "\r\na=control:streamid=0\r\n"
            head += f"Content-Length: {len(body)}\r\n"
        elif request.startswith("SETUP"):
            ports = re.search(r"client_port=(\d+)-(\d+)", request)
            self._client = int(ports[1]), int(ports[2])
            head += "Session: 12ab;timeout=60\r\n"
        elif request.startswith("PLAY"):
            assert "Session: 12ab" in request
            self._reported = -1e9
            self._plays.set()
        return (head + "\r\n" + body).encode()

    def _send(self, data: bytes, channel: int) -> None:
        self.sent.append(data)
        self._udp.sendto(data, ("127.0.0.1", self._client[channel]))

    def advance(self, now_s: float) -> int:
        """Send all packets up to a time; return how many samples the other end will get."""
        wanted = int(now_s * RATE_HZ) + 1
        if self.eye.now(now_s) in ("break", "death"):
            self.drop()
            self._next = wanted
            return 0
        if self._listener is None:
            self.listen()
        assert self._plays.wait(30), "nobody asked for the stream"
        count = 0
        for number in range(self._next, wanted):
            t_s = number / RATE_HZ
            stamp = (FIRST_STAMP + round(t_s * CLOCK_HZ)) % 2**32
            if t_s - self._reported > 5:
                self._reported = t_s
                whole, part = divmod(EPOCH_S + t_s, 1)
                words = int(whole) + 2_208_988_800, int(part * 2**32), stamp, 0, 0
                self._send(struct.pack("!BBHIIIIII", 128, 200, 6, 1, *words), 1)
                time.sleep(0.02)  # on another port: it must be there before the samples
            self._number += 1
            if self.skips:
                self.skips -= 1
                continue
            place = self.eye.place(t_s)
            x, y = in_camera(place) if place else (0.0, 0.0)
            head = struct.pack("!BBHII", 128, 96, self._number % 65536, stamp, 1)
            self._send(head + struct.pack("!ffB", x, y, 255 if place else 0), 0)
            count += 1
        self._next = wanted
        return count

    def close(self) -> None:
        self.drop()
        self._http.shutdown()
        self._http.server_close()
        self._udp.close()
