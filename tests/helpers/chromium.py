"""Chromium without a window, driven through a pair of pipes by its DevTools protocol.

No library is needed: a message is JSON, and ends with a zero byte.
"""

import json
import os
import select
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from web_kernel import needed

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_ARGUMENTS = (
    "--headless", "--remote-debugging-pipe", "--no-first-run", "--no-default-browser-check",
    "--disable-background-networking", "--disable-component-update", "--disable-default-apps",
    "--disable-extensions", "--disable-sync", "--disable-dev-shm-usage", "--mute-audio",
    "--disable-renderer-backgrounding", "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows", "--force-color-profile=srgb", "--disable-gpu",
)  # fmt: skip
_SILENCE_S = 60.0
"""Longest silence: a browser that does not answer for so long has died."""


class BrowserError(RuntimeError):
    """The browser, or a script in its page, has failed."""


class Chromium:
    """A browser with one page at a time; `chromium_for_tests` starts and ends it."""

    def __init__(self, to: int, back: int, log: Path) -> None:
        self._to, self._back, self._log = to, back, log
        self._unread = b""
        self._number = 0
        self._target = self._session = ""
        self._aside = ("", "")
        self.context = ""
        """Of the DevTools protocol: what pages share their storage."""
        self._loaded = False
        self._crashed = False
        self.errors: list[str] = []
        """Errors in the page so far."""

    def devtools(self, method: str, *, of_page: bool = True, **params: object) -> Any:
        """Return the browser's answer to an order of the DevTools protocol.

        Raises
        ------
        BrowserError
            If it refuses, or does not answer.
        """
        self._number += 1
        session = {"sessionId": self._session} if of_page else {}
        order = {"id": self._number, "method": method, "params": params, **session}
        unsent = json.dumps(order).encode() + b"\0"
        while unsent:
            unsent = unsent[os.write(self._to, unsent) :]
        while (told := self._read()).get("id") != self._number:
            pass
        if "error" in told:
            raise BrowserError(f"{method}: {told['error']['message']}")
        return told["result"]

    def open(
        self, url: str, *scripts: str, size: tuple[int, int] | None = (1920, 400), anew: bool = True
    ) -> None:
        """Open a page, whose scripts run before its own, in place of the one that is open.

        Parameters
        ----------
        url : str
            Of the page.
        *scripts : str
            JavaScript.
        size : (width, height), optional
            Of the window, in pixels. Left out, it is the window as it is, whose ratio of pixels
            nobody makes up.
        anew : bool
            As a browser that was never here: False keeps what pages have stored.
        """
        self.close()
        if anew and self.context:
            self.devtools(
                "Target.disposeBrowserContext", of_page=False, browserContextId=self.context
            )
        if anew or not self.context:
            made = self.devtools("Target.createBrowserContext", of_page=False)
            self.context = made["browserContextId"]
        of = {"browserContextId": self.context} if size else {}
        made = self.devtools("Target.createTarget", of_page=False, url="about:blank", **of)
        self._target = made["targetId"]
        told = self.devtools(
            "Target.attachToTarget", of_page=False, targetId=self._target, flatten=True
        )
        self._session, self._crashed, self.errors = told["sessionId"], False, []
        for domain in ("Page", "Runtime", "Inspector"):
            self.devtools(f"{domain}.enable")
        if size:
            self.resize(size)
        for script in scripts:
            self.devtools("Page.addScriptToEvaluateOnNewDocument", source=script)
        self.go(url)

    def swap(self) -> None:
        """Turn to the tab that was put aside, and put this one aside."""
        (self._target, self._session), self._aside = self._aside, (self._target, self._session)

    def resize(self, size: tuple[int, int]) -> None:
        """Give the page another size."""
        self.devtools(
            "Emulation.setDeviceMetricsOverride",
            width=size[0], height=size[1], deviceScaleFactor=1, mobile=False,
        )  # fmt: skip

    def go(self, url: str) -> None:
        """Load another page in the same tab."""
        self._loaded = False
        self.devtools("Page.navigate", url=url)
        while not self._loaded:
            self._read()

    def evaluate(self, script: str) -> Any:
        """Return the value of a script, awaited.

        Raises
        ------
        BrowserError
            If it throws.
        """
        told = self.devtools(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in told:
            raise BrowserError(_described(told["exceptionDetails"]))
        return told["result"].get("value")

    def text(self) -> str:
        """Return the text of the page."""
        return str(self.evaluate("document.body?.innerText ?? ''"))

    def close(self, *, crash: bool = False) -> None:
        """End the tab as a participant does, or its process, as a machine does."""
        if not self._target:
            return
        if crash:
            self._send_crash()
        with suppress(BrowserError):  # it may be gone
            self.devtools("Target.closeTarget", of_page=False, targetId=self._target)
        self._target = ""

    def _send_crash(self) -> None:
        order = {"id": 0, "method": "Page.crash", "params": {}, "sessionId": self._session}
        os.write(self._to, json.dumps(order).encode() + b"\0")  # nobody is left to answer
        while not self._crashed:
            self._read()

    def _read(self) -> dict[str, Any]:
        """Return the next message, of which events are noticed."""
        while b"\0" not in self._unread:
            ready, _, _ = select.select([self._back], [], [], _SILENCE_S)
            data = os.read(self._back, 1 << 20) if ready else b""
            if not ready:
                raise BrowserError(f"Chromium is silent for {_SILENCE_S:.0f} s")
            if not data:
                said = self._log.read_text(errors="replace").split("\n")[-2:][0] or "nothing"
                raise BrowserError(f"Chromium has ended, and said: {said}")
            self._unread += data
        text, _, self._unread = self._unread.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        if message.get("sessionId") == self._session:
            match message.get("method"):
                case "Page.loadEventFired":
                    self._loaded = True
                case "Inspector.targetCrashed":
                    self._crashed = True
                case "Runtime.exceptionThrown":
                    self.errors.append(_described(message["params"]["exceptionDetails"]))
        return message


def _described(details: dict[str, Any]) -> str:
    """Return a script's exception, in words."""
    thrown = details.get("exception", {})
    return str(thrown.get("description") or thrown.get("value") or details["text"])


@contextmanager
def chromium_for_tests(*arguments: str) -> Iterator[Chromium]:
    """Start Chromium, where it is there, with a profile of its own; it ends with the block."""
    if sys.platform == "win32":
        pytest.skip("Chromium is driven through two pipes, which Windows hands on in another way")
    import fcntl  # Windows has none

    path = next(filter(None, map(shutil.which, PROGRAMS)), None)
    needed("Chromium", path)
    assert path is not None
    rights = ("--no-sandbox",) if os.geteuid() == 0 else ()  # for root it has no sandbox
    theirs, to = os.pipe()
    back, their_end = os.pipe()
    # Higher than those that it looks for, which are copies of these.
    inner = [fcntl.fcntl(one, fcntl.F_DUPFD_CLOEXEC, 10) for one in (theirs, their_end)]
    with (
        tempfile.TemporaryDirectory(
            prefix="metamerlab-browser-", ignore_cleanup_errors=True
        ) as own,
        (Path(own) / "said").open("wb") as log,
    ):
        words = [path, *_ARGUMENTS, *rights, f"--user-data-dir={own}", *arguments, "about:blank"]
        process = os.posix_spawn(
            path, words, os.environ, setpgroup=0,
            file_actions=[
                (os.POSIX_SPAWN_DUP2, one, place)
                for place, one in enumerate((log.fileno(), log.fileno(), *inner), 1)
            ],
        )  # fmt: skip
        for one in (theirs, their_end, *inner):
            os.close(one)
        browser = Chromium(to, back, Path(log.name))
        try:
            yield browser
            with suppress(BrowserError, OSError):
                browser.devtools("Browser.close", of_page=False)
        finally:
            os.close(to)
            os.close(back)
            _ended(process)


def _ended(process: int) -> None:
    """Wait for a process; end its group if it does not end."""
    if sys.platform == "win32":
        return  # none was started
    until = time.monotonic() + 10
    while os.waitpid(process, os.WNOHANG) == (0, 0):
        if time.monotonic() > until:
            os.killpg(process, signal.SIGKILL)
        time.sleep(0.02)
