"""Lays out pages: text, questions, the answer screen, notices. Images only; no window."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.script import Words
from protocols.study_file.session_schema import key_label
from study_app.stage import Page
from study_app.text_image import (
    Align,
    Typeface,
    UnwritableError,
    text_image,
    typeface_for,
    widest_px,
    wrap,
    writable,
)

_TEXT_SHARE = 1 / 27
"""Letter size as a share of the screen's height; never below `_SMALLEST_PX`."""
_SMALLEST_PX = 12
_MARGIN_SHARE = 0.12
_LONGEST_LINE = 34
"""Width of a text in letter sizes: longer lines are hard to read."""
_BAR_AT, _BAR_WIDE = _MARGIN_SHARE / 2, 0.4
"""Top and width of the bar that says how much is done, in shares of the screen."""
_CARET = "|"


class UnfitLabelsError(StudyError):
    """Labels of answers that do not fit beside each other."""


class Block(NamedTuple):
    """Lines of text at a place of the screen."""

    lines: Sequence[str]
    face: Typeface
    width_px: int
    left: int
    top: int
    align: Align = "centre"


@dataclass(frozen=True)
class Sheet:
    """Text that a participant reads at once: blocks on a screen."""

    size_px: tuple[int, int]
    """Width and height."""
    grey: int
    """Grey of the letters."""
    blocks: tuple[Block, ...]
    done_share: float = 0.0
    """Share of the session that is done, as a bar at the upper edge; 0: no bar."""

    def image(self) -> NDArray[np.uint8]:
        """Return the screen, shape (height, width, 4), transparent where nothing is written."""
        width, height = self.size_px
        image = np.zeros((height, width, 4), np.uint8)
        for block in self.blocks:
            part = text_image(
                block.lines, block.face, block.width_px, align=block.align, grey=self.grey
            )
            below = image[block.top :, block.left :][: len(part), : block.width_px]
            below[:] = part[: below.shape[0], : below.shape[1]]  # what is cut off is empty
        if self.done_share > 0:
            self._draw_bar(image)
        return image

    def _draw_bar(self, image: NDArray[np.uint8]) -> None:
        """Draw how much is done: a frame, filled from the left."""
        width, height = self.size_px
        line = max(1, height // 540)
        top, left = round(height * _BAR_AT), round(width * (1 - _BAR_WIDE) / 2)
        bar = image[top : top + max(6 * line, height // 60), left : width - left]
        bar[:] = self.grey, self.grey, self.grey, 255
        done_px = round(min(1.0, self.done_share) * bar.shape[1])
        bar[line:-line, max(line, done_px) : -line] = 0


class PageLayout:
    """Lays out sheets of the screen's size.

    A text that does not fit, even in the smallest letters, is a `StudyError`.

    Parameters
    ----------
    size : (width, height)
        Of the screen, in pixels.
    key_names : mapping
        Names of keys in the participant's language.
    background : int
        Grey of the screen, 0 to 255: dark letters on light, light ones on dark.
    """

    def __init__(
        self, size: tuple[int, int], key_names: Mapping[str, str], background: int
    ) -> None:
        self._size, self._key_names = size, key_names
        self._letter_px = max(_SMALLEST_PX, round(size[1] * _TEXT_SHARE))
        # Contrast with 50 % grey is 5.3 to 1 for black, and 3.9 to 1 for white.
        self._grey = 0 if background >= 110 else 255

    def page(self, text: str, key: str = "", done_share: float = 0.0) -> Sheet:
        """Return a page of text, with the key that turns it below; letters shrink if need be.

        `done_share` is how much of the session is done, for a bar; 0: no bar.
        """
        blocks = (self._block(text, narrow=True), *([self._hint(key)] if key else []))
        return Sheet(self._size, self._grey, blocks, done_share)

    def question(self, page: Page, typed: str, chosen: int) -> Sheet:
        """Return a question with what was typed so far, or with its choices.

        Of what was typed, the end is shown where all of it does not fit.
        """
        if page.choices:
            marks = _marks(page)
            lines = [
                f"{marks[index == chosen]}  {index + 1}  {choice}"
                for index, choice in enumerate(page.choices)
            ]
        else:
            # What was typed is kept as it is; what no font can draw is shown as a question mark.
            lines = [writable(typed, page.text + _CARET) + _CARET]
        try:
            block = self._block("\n".join((page.text, "", *lines)))
        except UnwritableError:
            raise
        except StudyError:
            if not typed or page.choices:
                raise
            return self.question(page, typed[len(typed) // 8 + 1 :], chosen)
        return self._sheet(block, self._hint("enter"))

    def words(self, words: Words) -> Sheet:
        """Return a notice, or a question with each answer's label and key below it.

        Letters of all labels shrink alike until every one fits its share of the width.
        """
        if not words.labels:
            return self._sheet(self._block(words.text, align="centre", at=0.45))
        width, height = self._size
        count, top = len(words.labels), round(height * 0.5)
        room = width // count
        lefts = [round(width * (2 * place + 1) / (2 * count)) - room // 2 for place in range(count)]
        texts = ["\n".join(both) for both in zip(words.labels, words.keys, strict=True)]
        fitted = self._fitted(
            texts, lambda _: round(0.8 * room), round(0.95 * room), height - top, self._letter_px
        )
        if isinstance(fitted, str):
            raise UnfitLabelsError(
                f"text: the labels of {count} answers must fit beside each other on"
                f" {width}x{height} pixels (got {', '.join(words.labels)}); take shorter ones"
            )
        face, wrapped = fitted
        return self._sheet(
            self._block(words.text, align="centre", at=0.36, ends=0.47),
            *(
                Block(lines, face, room, left, top)
                for left, lines in zip(lefts, wrapped, strict=True)
            ),
        )

    def _sheet(self, *blocks: Block) -> Sheet:
        return Sheet(self._size, self._grey, blocks)

    def _hint(self, key: str) -> Block:
        """Lay out at the lower edge which key goes on."""
        width, height = self._size
        label = f"[ {key_label(key, self._key_names)} ]"
        letter_px = max(_SMALLEST_PX, round(0.8 * self._letter_px))
        face, (lines,) = self._must_fit(label, lambda _: width, width, height, letter_px)
        below = len(lines) * face.line_px + face.size_px // 2
        top = round(height * (1 - _MARGIN_SHARE / 2)) - below
        return Block(lines, face, width, 0, max(0, top))

    def _block(
        self,
        text: str,
        *,
        align: Align = "left",
        at: float | None = None,
        ends: float = 1.0,
        narrow: bool = False,
    ) -> Block:
        """Lay out a text.

        `at` and `ends` are shares of the height: where it begins (left out: in the middle), and
        where it ends at the latest. A `narrow` block is as wide as its widest line, so that short
        texts stand in the middle.
        """
        width, height = self._size
        most = round(width * (1 - 2 * _MARGIN_SHARE))
        room = round(height * min(ends, 1 - 2 * _MARGIN_SHARE))
        face, (lines,) = self._must_fit(
            text,
            lambda letter_px: min(most, _LONGEST_LINE * letter_px),
            most,
            room,
            self._letter_px,
        )
        widest = widest_px(lines, face)
        across = widest if narrow else max(widest, min(most, _LONGEST_LINE * face.size_px))
        high = len(lines) * face.line_px
        middle = (height - high - face.size_px // 2) // 2
        top = min(middle if at is None else round(height * at), round(height * ends) - high)
        return Block(lines, face, across, (width - across) // 2, max(0, top), align)

    def _must_fit(
        self, text: str, wraps: Callable[[int], int], most: int, room: int, letter_px: int
    ) -> tuple[Typeface, list[list[str]]]:
        fitted = self._fitted([text], wraps, most, room, letter_px)
        if isinstance(fitted, str):
            width, height = self._size
            raise StudyError(
                f"text: must fit on {width}x{height} pixels in letters of {_SMALLEST_PX} px (got"
                f" {fitted}); shorten it"
            )
        return fitted

    def _fitted(
        self,
        texts: Sequence[str],
        wraps: Callable[[int], int],
        most: int,
        room: int,
        letter_px: int,
    ) -> tuple[Typeface, list[list[str]]] | str:
        """Return texts in lines, in the largest letters in which every one fits, or what does not.

        `wraps` gives the width at which lines are broken, by the size of letters. No line may be
        wider than `most`, and no text higher than `room`.
        """

        def laid(size_px: int) -> tuple[Typeface, list[list[str]], str]:
            face = typeface_for(texts, size_px)
            wrapped = [wrap(text, face, wraps(size_px)) for text in texts]
            wide, line = max((widest_px([line], face), line) for lines in wrapped for line in lines)
            high = max(map(len, wrapped))
            if wide > most:
                return face, wrapped, f"{line[:40]!r}, {wide} px wide where {most} are free"
            if high * face.line_px > room:
                return face, wrapped, f"{high} lines where {room // face.line_px} are free"
            return face, wrapped, ""

        found = laid(letter_px)
        if found[2] and letter_px > _SMALLEST_PX:
            smallest = laid(_SMALLEST_PX)  # a text that is too long for it is tried in no other
            while found[2] and found is not smallest:
                letter_px = round(letter_px * 0.9)
                found = smallest if smallest[2] or letter_px <= _SMALLEST_PX else laid(letter_px)
        face, wrapped, amiss = found
        return amiss or (face, wrapped)


def words_image(words: Words) -> NDArray[np.uint8]:
    """Return the picture of a script's words, shape (height, width, 4)."""
    return words_sheet(words).image()


def words_sheet(words: Words) -> Sheet:
    """Lay out a script's words."""
    return PageLayout(words.size_px, {}, words.background).words(words)


def _marks(page: Page) -> tuple[str, str]:
    """Return the marks before a choice that is open, and before the chosen one."""
    try:
        typeface_for([page.text, *page.choices, "○●"], _SMALLEST_PX)
    except UnwritableError:
        return "[  ]", "[x]"
    return "○", "●"
