"""A folder on a loopback port of its own, for a browser that this program drives."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

KINDS = {
    ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css",
    ".json": "application/json", ".png": "image/png",
}  # fmt: skip


class FolderHandler(BaseHTTPRequestHandler):
    """Answers with the files of a folder; whoever posts is answered by subclasses."""

    folder: Path
    protocol_version = "HTTP/1.1"
    wbufsize = -1  # header and body in one packet: two wait for each other

    def do_GET(self) -> None:
        """Answer with a file."""
        path = self.folder / self.name
        known = path.is_file() and path.resolve().is_relative_to(self.folder.resolve())
        self.answer(200 if known else 404, path.read_bytes() if known else b"", path.suffix)

    @property
    def name(self) -> str:
        """Name that is asked for, without its parameters."""
        return self.path.split("?")[0].lstrip("/") or "index.html"

    def body(self) -> bytes:
        """Return the body that was posted."""
        return self.rfile.read(int(self.headers["content-length"]))

    def answer(self, status: int, data: bytes, suffix: str = ".json") -> None:
        """Send a status and bytes."""
        self.send_response(status)
        self.send_header("content-type", KINDS.get(suffix, "application/octet-stream"))
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def handle(self) -> None:
        """Answer until the page is gone."""
        try:
            super().handle()
        except ConnectionError:
            return  # the tab was closed

    def log_message(self, *_: object) -> None:
        """Keep still."""


@contextmanager
def served(handler: Callable[..., BaseHTTPRequestHandler]) -> Iterator[str]:
    """Serve on a port of its own, so that its storage in a browser is its own, too.

    Parameters
    ----------
    handler : callable
        Makes what answers a connection.

    Yields
    ------
    str
        The address, with a slash at its end.
    """
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    try:
        yield f"http://localhost:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()
