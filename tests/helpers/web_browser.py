"""Browsers for tests, and a server on loopback around a study."""

import base64
import io
import json
import os
import shutil
import subprocess
import threading
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from chromium import Chromium
from loopback import FolderHandler
from loopback import served as served_by
from PIL import Image
from web_kernel import WEB, needed, node_modules

_SCRIPTS = Path(__file__).with_name("web")
STUB = _SCRIPTS / "jatos_stub.js"
CLOCK, OBSERVER = ((_SCRIPTS / f"{one}.js").read_text() for one in ("clock", "observer"))
"""Scripts for a page: a virtual display, and an observer who does what `observer.answer` says."""
LUCKY = """
let luck = 7, keys = null;
const drawn = () => { luck = (Math.imul(luck, 1103515245) + 12345) >>> 0; return luck / 2 ** 32; };
observer.text = "<b>edges</b> & \\u{1f440}";
observer.reads_ms = 50;
fetch("study.json").then((answer) => answer.json()).then((study) => {
  const phases = study.rates[0].scripts[study.default_language].flatMap((script) => script.phases);
  keys = Object.fromEntries(phases.map((phase) => [phase.name, phase.question?.keys.flat()]));
});
observer.answer = (phase) => {
  const known = keys?.[phase];
  return known ? [known[Math.floor(drawn() * known.length)], 40 + 100 * drawn()] : null;
};
"""
"""An observer who answers by chance, and fast."""


def iwer(kind: str, hz: float) -> tuple[str, ...]:
    """Return scripts of a headset of a kind that iwer knows, with a participant in it."""
    package = node_modules() / "iwer"
    needed("iwer", package.is_dir())
    made = (package / "build" / "iwer.min.js").read_text()
    return (
        f"window.HEADSET = {kind!r}; clock.hz = {hz};",
        made,
        (_SCRIPTS / "headset.js").read_text(),
    )


class Browser(Protocol):
    """A browser with one page: what `Chromium` is, and `Firefox`."""

    def open(
        self, url: str, *scripts: str, size: tuple[int, int] | None = ..., anew: bool = ...
    ) -> None:
        """Open a page, whose scripts run before its own."""

    def resize(self, size: tuple[int, int]) -> None:
        """Give the page another size, as who drags its window does."""

    def evaluate(self, script: str) -> Any:
        """Return what a script gives, awaited."""

    def text(self) -> str:
        """Return what the page says."""

    def close(self) -> None:
        """End the tab as a participant does."""

    def swap(self) -> None:
        """Turn to the tab that was put aside, and put this one aside."""

    @property
    def errors(self) -> list[str]:
        """Errors in the page so far."""


class Firefox:
    """Firefox, driven through Node: it speaks BiDi, over web sockets, only."""

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

    def open(
        self, url: str, *scripts: str, size: tuple[int, int] | None = (1920, 400), anew: bool = True
    ) -> None:
        self.ask("open", url=url, scripts=scripts, size=size, anew=anew)

    def resize(self, size: tuple[int, int]) -> None:
        self.ask("resize", size=size)

    def evaluate(self, script: str) -> Any:
        return self.ask("evaluate", script=script)

    def text(self) -> str:
        return str(self.evaluate("document.body?.innerText ?? ''"))

    def close(self) -> None:
        self.ask("close")

    def swap(self) -> None:
        self.ask("swap")

    @property
    def errors(self) -> list[str]:
        return list(self.ask("errors"))


def until(browser: Browser, script: str, timeout_s: float = 60.0) -> None:
    """Wait until a script gives something true; say what the page shows where it does not."""
    end = time.monotonic() + timeout_s
    while not browser.evaluate(f"Boolean({script})"):
        assert time.monotonic() < end, f"{script}: {browser.text()!r}, errors {browser.errors}"
        time.sleep(0.02)


def screen(browser: Chromium) -> np.ndarray:
    """Return the composited page, shape (height, width, 3)."""
    png = base64.b64decode(browser.devtools("Page.captureScreenshot")["data"])
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


@contextmanager
def running_firefox(folder: Path) -> Iterator[Firefox]:
    """Start Firefox without a screen; it ends with the block."""
    path = shutil.which("firefox-esr") or shutil.which("firefox")
    needed("Firefox", path)
    modules = node_modules()
    needed("puppeteer-core", (modules / "puppeteer-core").is_dir())
    script = folder / "driver.mjs"
    (folder / "node_modules").symlink_to(modules)  # where Node looks for puppeteer-core
    subprocess.run(
        [modules / ".bin" / "esbuild", "test/driver.ts", "--bundle", "--platform=node",
         "--format=esm", "--external:puppeteer-core", "--log-level=warning",
         f"--outfile={script}"],
        cwd=WEB, check=True, timeout=60,
    )  # fmt: skip
    with subprocess.Popen(
        ["node", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"MOZ_HEADLESS_WIDTH": "1920", "MOZ_HEADLESS_HEIGHT": "1080"},
    ) as process:  # fmt: skip
        browser = Firefox(process)
        try:
            browser.ask("launch", path=path)
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
    """Answers in place of a file: status and bytes."""
    hang: Callable[[str], bool] = lambda _: False
    """Test of requests to JATOS that are never answered, though they arrive."""
    lost: Callable[[str], bool] = lambda _: False
    """Test of requests to JATOS that never arrive."""
    refuses: bool = False
    """JATOS takes nothing."""
    most_bytes: int = 5_000_000
    """Of a component result."""
    rivals: int = 0
    """Other participants, who each take a slot just before this one's patch of it arrives."""
    url: str = ""
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def lines(self) -> list[str]:
        """All that came home, line by line."""
        files = [text for name, text in self.files.items() if name.endswith(".txt")]
        return "".join(self.results + files).splitlines(keepends=True)

    def archive(self, path: Path) -> None:
        """Write what JATOS would export."""
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("metadata.json", "{}")
            for number, text in enumerate(self.results):
                archive.writestr(f"study_result_1/comp-result_{number}/data.txt", text)
            for name, text in self.files.items():
                number, _, file = name.partition("/")
                archive.writestr(f"study_result_1/comp-result_{number}/files/{file}", text)

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
                if self.rivals and body["op"] != "test":
                    self.rivals -= 1
                    taken = self.batch.get("metamerlab_slots", 0) + 1
                    self.batch["metamerlab_slots"], self.version = taken, self.version + 1
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
        return STUB.read_text().replace("STATE", json.dumps(state)).encode()


class _Handler(FolderHandler):
    site: Site

    def do_GET(self) -> None:  # noqa: N802
        self.site.asked.append(self.name)
        if self.name == "jatos.js" and self.site.jatos:
            with self.site.lock:
                return self.answer(200, self.site.stub(), ".js")
        if self.name not in self.site.faults:
            return super().do_GET()
        path = self.site.folder / self.name
        found = path.read_bytes() if path.is_file() else b""
        status, data = self.site.faults[self.name](found)
        return self.answer(status, data, path.suffix)

    def do_POST(self) -> None:  # noqa: N802
        body = json.loads(self.body())
        what = self.path.removeprefix("/jatos/")
        if self.site.lost(what):
            return self.hang()
        if self.site.refuses or (self.site.ended and what != "end"):
            return self.answer(403, b"{}")
        if what == "append":
            size = len(self.site.results[body["component"]]) + len(body["data"])
            if size > self.site.most_bytes:
                return self.answer(413, b"{}")
        with self.site.lock:
            told = self.site.post(what, body)
        if self.site.hang(what):
            return self.hang()
        return self.answer(200, json.dumps(told).encode())

    def hang(self) -> None:
        """Answer nothing while the page is there."""
        self.close_connection = True
        time.sleep(2)


@contextmanager
def served(folder: Path, *, jatos: bool = True) -> Iterator[Site]:
    """Serve a folder."""
    site = Site(folder, jatos)
    with served_by(type("Handler", (_Handler,), {"folder": folder, "site": site})) as site.url:
        yield site


def begin(
    browser: Browser,
    site: Site,
    *scripts: str,
    page: str = "index.html?slot=1",
    **how: Any,
) -> None:
    """Open a study on the virtual clock, for an observer who answers by chance."""
    how.setdefault("size", json.loads((site.folder / "study.json").read_text())["window_px"])
    browser.open(f"{site.url}{page}", CLOCK, OBSERVER, LUCKY, *scripts, **how)


def whole(browser: Browser, site: Site, *scripts: str, **how: Any) -> None:
    """Let the artificial observer run a study to its end."""
    begin(browser, site, *scripts, **how)
    until(browser, "['ended', 'aborted'].includes(document.title)")


def said(lines: list[str], kind: str) -> list[Mapping[str, Any]]:
    """Return the lines of a kind, those that came twice once."""
    return [line for line in map(json.loads, dict.fromkeys(lines)) if line["kind"] == kind]


def started(browser: Browser, site: Site) -> Mapping[str, Any]:
    """Return the line of the start, once it came: it stays, however soon the session is over."""
    end = time.monotonic() + 60
    while not (lines := said(site.lines, "start")):
        assert time.monotonic() < end, f"{browser.text()!r}, errors {browser.errors}"
        time.sleep(0.02)
    (line,) = lines
    return line
