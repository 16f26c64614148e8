"""A 3D scene on a local page: drag to turn, keys to move, and the view's line is printed.

The page is served to this machine alone, under a name that nobody can guess, and asks for nothing
from elsewhere.
"""

from __future__ import annotations

import math
import queue
import secrets
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import NamedTuple
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np

from pipeline.pictures.drawing import of_colour
from protocols.blocks import html_page
from stimuli.rendering.open_scene import view_line
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.world import Viewpoint

VIEW_PX = (640, 480)
HOST = "127.0.0.1"
PATIENCE_S = 60.0
_FARTHEST_M = 1e7


@dataclass(frozen=True)
class CameraPlace:
    """A camera by place and angles: what a page can turn and move.

    Parameters
    ----------
    yaw_deg : float
        To the right of the direction -z; `pitch_deg` is downwards.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float
    pitch_deg: float
    fov_deg: float

    @classmethod
    def of(cls, view: Viewpoint) -> CameraPlace:
        """Return the place and the direction of a view."""
        x, y, z = np.subtract(view.look_at_m, view.position_m)
        return cls(
            *view.position_m,
            math.degrees(math.atan2(x, -z)),
            math.degrees(math.atan2(-y, math.hypot(x, z))),
            view.vertical_fov_deg,
        )

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> CameraPlace:
        """Return the place that a page asks for.

        Raises
        ------
        ValueError
            If a number is missing, not finite, or out of range.
        """
        found = {name: float(words[name]) for name in cls.__dataclass_fields__ if name in words}
        if len(found) < len(cls.__dataclass_fields__):
            raise ValueError("a view has x_m, y_m, z_m, yaw_deg, pitch_deg and fov_deg")
        made = cls(**found)
        far = max(abs(made.x_m), abs(made.y_m), abs(made.z_m))
        if not (
            all(map(math.isfinite, found.values()))
            and far <= _FARTHEST_M
            and abs(made.pitch_deg) < 90
            and 1 <= made.fov_deg <= 170
        ):
            raise ValueError("a view's numbers must be finite, its pitch below 90 degrees")
        return made

    def view(self, reach_m: float) -> Viewpoint:
        """Return the view, looking at a point `reach_m` ahead."""
        yaw, pitch = math.radians(self.yaw_deg), math.radians(self.pitch_deg)
        ahead = (
            math.sin(yaw) * math.cos(pitch), -math.sin(pitch), -math.cos(yaw) * math.cos(pitch)
        )  # fmt: skip
        x, y, z = (
            place + reach_m * way
            for place, way in zip((self.x_m, self.y_m, self.z_m), ahead, strict=True)
        )
        return Viewpoint((self.x_m, self.y_m, self.z_m), (x, y, z), self.fov_deg)


class _Job(NamedTuple):
    """A picture that a request waits for."""

    view: Viewpoint
    drawn: Future[bytes]


class LookServer:
    """Serves the page of one scene until somebody is done.

    Parameters
    ----------
    renderer : WorldRenderer
        Of the scene; used in the thread that calls `run` alone.
    scene : str
        What the page is called.
    start : Viewpoint
        Where it begins.
    say : callable
        Told the line of every view that is taken.
    """

    def __init__(
        self, renderer: WorldRenderer, scene: str, start: Viewpoint, say: Callable[[str], None]
    ) -> None:
        low, high = renderer.world.bounds_m
        self._renderer, self._say = renderer, say
        self._reach_m = max(1e-3, float(np.linalg.norm(high - low)) / 2)
        self._key = secrets.token_urlsafe(16)
        self._asked: queue.Queue[_Job | None] = queue.Queue()
        self._page = html_page(
            f"{scene}: choose a view",
            "stimuli/rendering/view_page.html",
            heading=scene,
            width=VIEW_PX[0],
            height=VIEW_PX[1],
            start=vars(CameraPlace.of(start)),
            reach=self._reach_m,
        )
        outer = self

        class Handler(BaseHTTPRequestHandler):
            timeout = 30.0

            def do_GET(self) -> None:
                outer._answer(self, "GET")

            def do_POST(self) -> None:
                outer._answer(self, "POST")

            def log_message(self, *_: object) -> None:
                """Say nothing: the terminal is for the views' lines."""

        # Threads, for browsers open connections that they do not use; pictures are drawn by `run`.
        self._server = ThreadingHTTPServer((HOST, 0), Handler)

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self._server.server_port}/{self._key}/"

    def run(self) -> None:
        """Draw what is asked for until the page says that it is done; an interrupt ends it too."""
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        try:
            while (job := self._asked.get()) is not None:
                try:
                    job.drawn.set_result(self._draw(job.view))
                except Exception as error:
                    job.drawn.set_exception(error)
                    raise
        finally:
            self._server.shutdown()
            self._server.server_close()

    def _draw(self, view: Viewpoint) -> bytes:
        frame = self._renderer.render(view.camera(*VIEW_PX))
        shown = np.ascontiguousarray(of_colour(frame.colour)[..., ::-1])
        return bytes(cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, 88])[1])

    def _answer(self, request: BaseHTTPRequestHandler, method: str) -> None:
        asked = urlsplit(request.path)
        wanted = f"{HOST}:{self._server.server_port}"
        base, _, name = asked.path.removeprefix("/").partition("/")
        # Another site's page could name this machine: the key and the host keep it out.
        known = secrets.compare_digest(base.encode(), self._key.encode())
        if not known or request.headers.get("Host") != wanted:
            _send(request, HTTPStatus.NOT_FOUND, "text/plain", b"not found")
        elif (method, name) == ("GET", ""):
            _send(request, HTTPStatus.OK, "text/html; charset=utf-8", self._page.encode())
        elif (method, name) == ("POST", "done"):
            _send(request, HTTPStatus.OK, "text/plain", b"done")
            self._asked.put(None)
        elif (method, name) in {("GET", "view"), ("POST", "take")}:
            words = {key: values[-1] for key, values in parse_qs(asked.query).items()}
            try:
                view = CameraPlace.from_words(words).view(self._reach_m)
            except ValueError as error:
                _send(request, HTTPStatus.BAD_REQUEST, "text/plain", str(error).encode())
                return
            line = view_line(view)
            if name == "take":
                self._say(line)
                _send(request, HTTPStatus.OK, "text/plain", line.encode())
                return
            job = _Job(view, Future())
            self._asked.put(job)
            _send(request, HTTPStatus.OK, "image/jpeg", job.drawn.result(PATIENCE_S), line)
        else:
            _send(request, HTTPStatus.NOT_FOUND, "text/plain", b"not found")


def _send(
    request: BaseHTTPRequestHandler, status: HTTPStatus, kind: str, data: bytes, line: str = ""
) -> None:
    request.send_response(status)
    request.send_header("Content-Type", kind)
    request.send_header("Content-Length", str(len(data)))
    request.send_header("Cache-Control", "no-store")
    request.send_header("Connection", "close")
    if line:
        request.send_header("X-View", line)
    with suppress(ConnectionError):  # a browser that no longer waits
        request.end_headers()
        request.wfile.write(data)
