"""Chromium and Firefox, driven from Python, and a server on loopback around a study."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from web_kernel import WEB, needed, node_modules

SCRIPTS = Path(__file__).with_name("web")
CLOCK, OBSERVER = ((SCRIPTS / f"{one}.js").read_text() for one in ("virtual_clock", "observer"))
KINDS = {
    ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css",
    ".json": "application/json", ".png": "image/png",
}  # fmt: skip
PROGRAMS = {"chrome": ("chromium", "chromium-browser"), "firefox": ("firefox-esr", "firefox")}


class Browser:
    """A browser with one page; what it is told runs at once."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def ask(self, order: str, **said: Any) -> Any:
        """Return the answer; `AssertionError` with the browser's words where it fails."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({"order": order, **said}) + "\n")
        self.process.stdin.flush()
        told = json.loads(self.process.stdout.readline() or '{"error": "the driver has died"}')
        assert "error" not in told, told["error"]
        return told["answer"]

    def open(self, url: str, *scripts: str, size: tuple[int, int] | None = (1920, 400)) -> None:
        """Open a page with storage of its own, whose scripts run before its own.

        Without a size it is the window as it is, whose ratio of pixels no browser makes up.
        """
        self.ask("open", url=url, scripts=scripts, size=size)

    def evaluate(self, script: str) -> Any:
        """Return what a script gives, awaited."""
        return self.ask("evaluate", script=script)

    def until(self, script: str, timeout_s: float = 60.0) -> Any:
        """Wait until a script gives something true; say what the page shows where it does not."""
        told = self.ask("until", script=f"Boolean({script})", timeout_s=timeout_s)
        assert told, f"{script}: {self.text()!r}, errors {self.ask('errors')}"
        return told

    def text(self) -> str:
        """Return what the page says."""
        return str(self.evaluate("document.body?.innerText ?? ''"))

    def screen(self) -> np.ndarray:
        """Return the composited page, shape (height, width, 3)."""
        shot = base64.b64decode(self.ask("screenshot"))
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))


@contextmanager
def running_browser(
    folder: Path, kind: str, *args: str, prefs: dict[str, object] | None = None
) -> Iterator[Browser]:
    """Start a browser without a screen; it ends with the block."""
    path = next(filter(None, map(shutil.which, PROGRAMS[kind])), None)
    needed(PROGRAMS[kind][0], path)
    modules = node_modules()
    needed("puppeteer-core", (modules / "puppeteer-core").is_dir())
    script = folder / "driver.mjs"
    if not (folder / "node_modules").exists():
        (folder / "node_modules").symlink_to(modules)  # where Node looks for puppeteer-core
    subprocess.run(
        [modules / ".bin" / "esbuild", "test/driver.ts", "--bundle", "--platform=node",
         "--format=esm", "--external:puppeteer-core", "--log-level=warning",
         f"--outfile={script}"],
        cwd=WEB, check=True, timeout=60,
    )  # fmt: skip
    plain = ("--no-sandbox", "--disable-gpu", "--mute-audio", "--force-color-profile=srgb")
    with subprocess.Popen(
        ["node", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"MOZ_HEADLESS_WIDTH": "1920", "MOZ_HEADLESS_HEIGHT": "1080"},
    ) as process:  # fmt: skip
        browser = Browser(process)
        try:
            browser.ask(
                "launch",
                browser=kind,
                path=path,
                args=[*(plain if kind == "chrome" else ()), *args],
                prefs=prefs or {},
            )
            yield browser
            browser.ask("quit")
        finally:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(timeout=30)


@dataclass
class Site:
    """A folder on loopback; where `jatos` is set, a stand-in for a JATOS server is around it."""

    folder: Path
    jatos: bool = True
    results: list[str] = field(default_factory=list)
    """Of JATOS: a text for each component result."""
    files: dict[str, str] = field(default_factory=dict)
    session: dict[str, Any] = field(default_factory=dict)
    batch: dict[str, Any] = field(default_factory=dict)
    version: int = 0
    ended: dict[str, Any] | None = None
    asked: list[str] = field(default_factory=list)
    """Paths, in the order in which they were asked for."""
    faults: dict[str, Callable[[bytes], tuple[int, bytes]]] = field(default_factory=dict)
    """What is answered in place of a file: status and bytes."""
    hang: Callable[[str], bool] = lambda _: False
    """Which requests to JATOS are never answered, though they arrive."""
    lost: Callable[[str], bool] = lambda _: False
    """Which requests to JATOS never arrive."""
    refuses: bool = False
    """JATOS takes nothing."""
    url: str = ""
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def lines(self) -> list[str]:
        """All that came home, line by line."""
        return "".join(self.results).splitlines(keepends=True)

    def post(self, what: str, body: Any) -> Any:
        """Do what `jatos.js` asks."""
        match what:
            case "append":
                self.results[body["component"]] += body["data"]
            case "file":
                self.files[body["name"]] = body["data"]
            case "session":
                self.session = body
            case "batch":
                name, known = body["path"][1:], body["version"] == self.version
                done = known and (body["op"] != "test" or self.batch.get(name) == body["value"])
                if done and body["op"] != "test":
                    self.batch[name] = body["value"]
                    self.version += 1
                return {"batch": self.batch, "version": self.version, "done": done}
            case "end":
                self.ended, self.session = body, {}
            case "abort":
                self.ended, self.session, self.results = {"aborted": True, **body}, {}, []
        return None

    def stub(self) -> bytes:
        """Return `jatos.js`; each asking begins a component result."""
        self.results.append("")
        state = {
            "session": self.session, "batch": self.batch, "version": self.version,
            "component": len(self.results) - 1,
        }  # fmt: skip
        return (SCRIPTS / "jatos_stub.js").read_text().replace("STATE", json.dumps(state)).encode()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    wbufsize = -1  # header and body in one packet: two wait for each other

    def __init__(self, site: Site, *rest: Any) -> None:
        self.site = site
        super().__init__(*rest)

    def do_GET(self) -> None:
        name = self.path.split("?")[0].lstrip("/") or "index.html"
        self.site.asked.append(name)
        if name == "jatos.js" and self.site.jatos:
            with self.site.lock:
                return self.answer(200, self.site.stub(), ".js")
        path = self.site.folder / name
        status, data = (200, path.read_bytes()) if path.is_file() else (404, b"")
        if name in self.site.faults:
            status, data = self.site.faults[name](data)
        return self.answer(status, data, path.suffix)

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        what = self.path.removeprefix("/jatos/")
        if self.site.lost(what):
            return self.hang()
        if self.site.refuses or (self.site.ended and what != "end"):
            return self.answer(403, b"{}", ".json")
        if what == "append" and len(self.site.results[body["component"]]) > 5_000_000:
            return self.answer(413, b"{}", ".json")
        with self.site.lock:
            told = self.site.post(what, body)
        if self.site.hang(what):
            return self.hang()
        return self.answer(200, json.dumps(told).encode(), ".json")

    def hang(self) -> None:
        """Answer nothing while the page is there."""
        self.close_connection = True
        time.sleep(2)

    def answer(self, status: int, data: bytes, suffix: str) -> None:
        self.send_response(status)
        self.send_header("content-type", KINDS.get(suffix, "application/octet-stream"))
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def handle(self) -> None:
        try:
            super().handle()
        except ConnectionError:
            return  # the tab was killed

    def log_message(self, *_: object) -> None:
        return


@contextmanager
def served(folder: Path, *, jatos: bool = True) -> Iterator[Site]:
    """Serve a folder on a port of its own, so that its storage in a browser is its own, too."""
    site = Site(folder, jatos)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, site))
    server.daemon_threads = True
    site.url = f"http://localhost:{server.server_address[1]}/"
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield site
    finally:
        server.shutdown()
        server.server_close()


def whole(
    browser: Browser, site: Site, *scripts: str, page: str = "index.html?slot=3&simulated"
) -> None:
    """Let the artificial observer run a study to its end on the virtual clock."""
    browser.open(f"{site.url}{page}", CLOCK, OBSERVER, *scripts)
    browser.until("['ended', 'aborted'].includes(document.title)", 60)
