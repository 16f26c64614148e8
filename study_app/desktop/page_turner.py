"""Pages on the window: shows one until a key turns it, and takes typed or chosen answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import moderngl

from study_app.desktop.draw import Painter
from study_app.desktop.keys import edited
from study_app.desktop.window import Window
from study_app.pages import PageLayout, Sheet
from study_app.stage import KeyPress, Page, PageResult
from study_app.virtual import Observer

NOTICE_S = 1.5
"""Time for which a page without keys can be read."""
_SIMULATED_PAGE_S = 0.4
_SIMULATED_REST_S = 1.0
"""Time for which a simulated run rests: a notice that covers the screen goes in some seconds."""


class PageTurner:
    """Shows pages on an open window.

    Parameters
    ----------
    window, painter, pages : Window, Painter, PageLayout
        Where and how.
    quit_keys : sequence of str
        Keys that leave a question; those that write a character do so where one is typed.
    flip : callable
        Called with what draws; draws, flips, and lets the next clips load.
    key_presses : callable
        Returns the keys that went down since the last call.
    observer : Observer, optional
        Turns pages in place of a person; real keys work as well.
    """

    def __init__(
        self,
        window: Window,
        painter: Painter,
        pages: PageLayout,
        quit_keys: Sequence[str],
        flip: Callable[[Callable[[], None]], object],
        key_presses: Callable[[], Sequence[KeyPress]],
        observer: Observer | None = None,
    ) -> None:
        self._window, self._painter, self._pages = window, painter, pages
        self._quit_keys = quit_keys
        self._flip, self._key_presses, self._observer = flip, key_presses, observer
        self._texture: moderngl.Texture | None = None

    def turn(self, page: Page) -> PageResult:
        """Show a page until one of its keys goes down."""
        began_s = self._window.now()
        self._window.take_focus()
        self._window.key_presses()
        self._window.typed()
        show = self._question if page.name == "question" else self._wait
        return show(page, began_s)

    def release(self) -> None:
        """Free the last page."""
        if self._texture is not None:
            self._texture.release()
            self._texture = None

    def _wait(self, page: Page, began_s: float) -> PageResult:
        scripted = self._scripted(page, began_s)
        turns = page.keys[0] if page.keys and page.name != "quit" else ""
        waits = page.least_s > 0  # the key is named once it does something
        self._show(self._pages.page(page.text, "" if waits else turns, page.done_share))
        while True:
            self._flip(self._draw)
            if waits and self._window.now() >= began_s + page.least_s:
                waits = False
                self._show(self._pages.page(page.text, turns, page.done_share))
            for press in self._key_presses():
                if press.key in page.keys and press.t_s >= began_s + page.least_s:
                    return PageResult(press.key, "", press.t_s - began_s)
            now_s = self._window.now()
            if scripted and now_s >= scripted[1]:
                return PageResult(scripted[0].key, scripted[0].answer, now_s - began_s)
            if not page.keys and now_s >= began_s + NOTICE_S:
                return PageResult("", "", now_s - began_s)

    def _question(self, page: Page, began_s: float) -> PageResult:
        scripted = self._scripted(page, began_s)
        text, drawn = page.draft, None
        chosen = page.choices.index(text) if text in page.choices else -1
        writing = ("space", "enter", "backspace")
        leaving = [key for key in self._quit_keys if len(key) > 1 and key not in writing]
        while True:
            if drawn != (text, chosen):
                drawn = (text, chosen)
                self._show(self._pages.question(page, text, chosen))
            self._flip(self._draw)
            typed = self._window.typed()
            if page.choices:
                text = page.choices[chosen] if chosen >= 0 else ""
            else:
                text = edited(text, typed)
            for press in self._key_presses():
                now_s = self._window.now()
                if press.key in leaving:
                    return PageResult(press.key, text, now_s - began_s)
                if press.key == "enter" and (chosen >= 0 or not page.choices):
                    answer = page.choices[chosen] if page.choices else text
                    return PageResult("enter", answer, now_s - began_s)
                if page.choices:
                    chosen = _chosen(press.key, chosen, len(page.choices))
            now_s = self._window.now()
            if scripted and now_s >= scripted[1]:
                return PageResult(scripted[0].key, scripted[0].answer, now_s - began_s)

    def _scripted(self, page: Page, began_s: float) -> tuple[PageResult, float] | None:
        if self._observer is None or not page.keys:
            return None
        result = self._observer.turn_page(page)
        read_s = _SIMULATED_REST_S if page.name == "paused" else _SIMULATED_PAGE_S
        return result, began_s + max(page.least_s, read_s)

    def _show(self, sheet: Sheet) -> None:
        self.release()
        self._texture = self._painter.texture(sheet.image())

    def _draw(self) -> None:
        assert self._texture is not None
        self._painter.clear()
        self._painter.image(self._texture, (0, 0))


def _chosen(key: str, chosen: int, count: int) -> int:
    """Return the choice after a key: digits pick one, arrows move."""
    digit = key.removeprefix("kp_")
    if digit.isdigit() and 1 <= int(digit) <= count:
        return int(digit) - 1
    if key in ("up", "down"):
        step = 1 if key == "down" else -1
        return (chosen + step) % count if chosen >= 0 else (0 if step > 0 else count - 1)
    return chosen
