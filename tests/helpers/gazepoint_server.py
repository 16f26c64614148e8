"""Stands for Gazepoint Control: its XML over TCP, at the pace of a test's clock."""

from __future__ import annotations

import re
import socket
import threading
from contextlib import suppress

RATE_HZ = 150.0
EPOCH_S = 1000.25
"""The tracker's clock began that much before ours."""
POINT_S = 1.0


class GazepointServer:
    """Answers on a free port of this computer.

    Parameters
    ----------
    eye : Eye
        What it sees.
    lines : list of str, optional
        Sent in place of what the eye does, one a sample.
    """

    def __init__(self, eye, lines=None, screen=(1920, 1080)) -> None:
        self.eye, self.lines, self.screen = eye, lines, screen
        self.commands: list[str] = []
        self.sent = b""
        self._points: list[tuple[str, str]] = []
        self._calibrates_from: float | None = None
        self._step = 0
        self._listener = self._peer = None
        self._next = 0
        self._wants = threading.Event()
        self.port = 0
        self.listen()

    def listen(self) -> None:
        self._wants.clear()
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._serve, args=(self._listener,), daemon=True).start()

    def drop(self) -> None:
        """Break the connection and take no other."""
        for each in (self._listener, self._peer):
            if each is not None:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self._listener = self._peer = None

    def _serve(self, listener) -> None:
        try:
            peer, _ = listener.accept()
        except OSError:
            return
        self._peer, rest = peer, ""
        while True:
            try:
                data = peer.recv(4096)
            except OSError:
                return
            if not data:
                return
            *lines, rest = (rest + data.decode()).split("\r\n")
            for line in lines:
                self._hear(line)

    def _hear(self, line: str) -> None:
        self.commands.append(line)
        name = re.search(r'ID="(\w+)"', line)[1]
        if name == "SCREEN_SIZE":
            width, height = self.screen
            self._send(f'<ACK ID="SCREEN_SIZE" X="0" Y="0" WIDTH="{width}" HEIGHT="{height}" />')
        elif name == "PRODUCT_ID":
            self._send('<ACK ID="PRODUCT_ID" VALUE="GP3HD" />')
        elif name == "CALIBRATE_ADDPOINT":
            self._points.append((*re.findall(r'[XY]="([0-9.]+)"', line),))
        elif name == "CALIBRATE_CLEAR":
            self._points = []
        elif name == "CALIBRATE_START" and 'STATE="1"' in line:
            self._step, self._calibrates_from = 0, self._next / RATE_HZ
        elif name == "ENABLE_SEND_DATA" and 'STATE="1"' in line:
            self._wants.set()

    def _send(self, text: str) -> None:
        data = (text + "\r\n").encode()
        self.sent += data
        self._peer.sendall(data)

    def advance(self, now_s: float) -> int:
        """Send all samples up to a time; return how many the other end will get."""
        wanted = int(now_s * RATE_HZ) + 1
        what = self.eye.now(now_s)
        if what in ("break", "death"):
            if self._peer is not None:
                self.drop()
            self._next = wanted
            return 0
        if self._listener is None:
            self.listen()
        if not self._wants.wait(30):
            raise AssertionError("nobody asked for data")
        lines = self._calibration(now_s)
        count = max(0, wanted - self._next)
        lines += [self._record(number) for number in range(self._next, wanted)]
        self._next = wanted
        if lines:
            self._send("\r\n".join(lines))
        return count

    def _record(self, number: int) -> str:
        if self.lines is not None:
            return self.lines[number % len(self.lines)]
        t_s = number / RATE_HZ
        place = self.eye.place(t_s)
        x, y = (place[0] / 1920, place[1] / 1080) if place else (0.0, 0.0)
        return (
            f'<REC TIME="{t_s + EPOCH_S:.5f}" BPOGX="{x:.5f}" BPOGY="{y:.5f}"'
            f' BPOGV="{int(place is not None)}" BKID="0" BKDUR="0.00000" />'
        )

    def _calibration(self, now_s: float) -> list[str]:
        if self._calibrates_from is None:
            return []
        lines = []
        while (step := self._step) <= len(self._points):
            if now_s < self._calibrates_from + step * POINT_S:
                break
            if step < len(self._points):
                x, y = self._points[step]
                lines.append(f'<CAL ID="CALIB_START_PT" PT="{step + 1}" CALX="{x}" CALY="{y}" />')
            else:
                each = [
                    f'CALX{i}="{x}" CALY{i}="{y}" LX{i}="{float(x) + 0.01:.5f}" LY{i}="{y}"'
                    f' LV{i}="1" RX{i}="{float(x) + 0.01:.5f}" RY{i}="{y}" RV{i}="{int(i != 2)}"'
                    for i, (x, y) in enumerate(self._points, 1)
                ]
                lines.append(f'<CAL ID="CALIB_RESULT" {" ".join(each)} />')
                self._calibrates_from = None
            self._step += 1
            if self._calibrates_from is None:
                break
        return lines

    def close(self) -> None:
        self.drop()
