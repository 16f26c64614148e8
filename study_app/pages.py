"""Lays out pages: text, questions, the answer screen, notices. Images only; no window."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.script import Words
from protocols.session_schema import Texts
from protocols.wording import consent_text, fill, key_label
from study_app.stage import Page
from study_app.text_image import Align, text_image, typeface_for, widest_px, wrap, writable

_TEXT_SHARE = 1 / 27
"""Letter size as a share of the screen's height; never below `_SMALLEST_PX`."""
_SMALLEST_PX = 12
_MARGIN_SHARE = 0.12
_LONGEST_LINE = 34
"""Width of a text in letter sizes: longer lines are hard to read."""
_CARET = "|"


class Pages:
    """Makes screen-sized RGBA images, transparent where nothing is written.

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

    def page(self, text: str, key: str = "") -> NDArray[np.uint8]:
        """Return a page of text, with the key that turns it below; letters shrink if need be."""
        image = self._block(text, narrow=True)
        if key:
            self._hint(image, key)
        return image

    def question(self, page: Page, typed: str, chosen: int) -> NDArray[np.uint8]:
        """Return a question with what was typed so far, or with its choices."""
        if page.choices:
            marks = _marks(page)
            lines = [
                f"{marks[index == chosen]}  {index + 1}  {choice}"
                for index, choice in enumerate(page.choices)
            ]
        else:
            # What was typed is kept as it is; what no font can draw is shown as a question mark.
            lines = [writable(typed, page.text + _CARET) + _CARET]
        image = self._block("\n".join((page.text, "", *lines)))
        self._hint(image, "enter")
        return image

    def _hint(self, image: NDArray[np.uint8], key: str) -> None:
        """Write at the lower edge which key goes on."""
        label = f"[ {key_label(key, self._key_names)} ]"
        face = typeface_for([label], max(_SMALLEST_PX, round(0.8 * self._letter_px)))
        width, height = self._size
        hint = text_image([label], face, width, align="centre", grey=self._grey)
        _paste(image, hint, (0, round(height * (1 - _MARGIN_SHARE / 2)) - len(hint)))

    def words(self, words: Words) -> NDArray[np.uint8]:
        """Return a notice, or a question with each answer's label and key below it.

        Letters of all labels shrink alike until every one fits its share of the width.
        """
        if not words.labels:
            return self._centred(words.text)
        width, height = self._size
        image = self._centred(words.text, at=0.36, ends=0.47)
        room, top = width // len(words.labels), round(height * 0.5)
        texts = ["\n".join(both) for both in zip(words.labels, words.keys, strict=True)]
        letter_px = self._letter_px
        while True:
            face = typeface_for(texts, letter_px)
            wrapped = [wrap(text, face, round(0.8 * room)) for text in texts]
            fits = all(
                widest_px(lines, face) <= round(0.95 * room)
                and top + len(lines) * face.line_px <= height
                for lines in wrapped
            )
            if fits:
                break
            if letter_px <= _SMALLEST_PX:
                raise StudyError(
                    f"text: the labels of {len(texts)} answers must fit beside each other on"
                    f" {width}x{height} pixels (got {', '.join(words.labels)});"
                    " take shorter ones"
                )
            letter_px = max(_SMALLEST_PX, round(letter_px * 0.9))
        for place, lines in enumerate(wrapped):
            block = text_image(lines, face, room, align="centre", grey=self._grey)
            x = round(width * (2 * place + 1) / (2 * len(texts))) - room // 2
            _paste(image, block, (x, top))
        return image

    def _centred(self, text: str, at: float = 0.45, ends: float = 1.0) -> NDArray[np.uint8]:
        return self._block(text, align="centre", at=at, ends=ends)

    def _block(
        self,
        text: str,
        *,
        align: Align = "left",
        at: float | None = None,
        ends: float = 1.0,
        narrow: bool = False,
    ) -> NDArray[np.uint8]:
        """Lay out a text.

        `at` and `ends` are shares of the height: where it begins (left out: in the middle), and
        where it ends at the latest. A `narrow` block is as wide as its widest line, so that short
        texts stand in the middle.
        """
        width, height = self._size
        room = round(height * (1 - 2 * _MARGIN_SHARE))
        letter_px = self._letter_px
        while True:
            face = typeface_for([text], letter_px)
            across = min(round(width * (1 - 2 * _MARGIN_SHARE)), _LONGEST_LINE * letter_px)
            lines = wrap(text, face, across)
            if len(lines) * face.line_px <= room or letter_px <= _SMALLEST_PX:
                break
            letter_px = max(_SMALLEST_PX, round(letter_px * 0.9))
        if narrow:
            across = min(across, widest_px(lines, face))
        block = text_image(lines, face, across, align=align, grey=self._grey)
        top = round(height * at) if at is not None else (height - len(block)) // 2
        top = min(top, round(height * ends) - len(lines) * face.line_px)
        image = np.zeros((height, width, 4), np.uint8)
        _paste(image, block, ((width - across) // 2, max(0, top)))
        return image


def words_image(words: Words) -> NDArray[np.uint8]:
    """Return the picture of a script's words, shape (height, width, 4)."""
    return Pages(words.size_px, {}, words.background).words(words)


def check_texts(protocol: StudyProtocol, texts: Texts) -> None:
    """Refuse texts that no font of this machine can write, before anything is shown.

    Raises
    ------
    StudyError
        Naming the characters that are missing.
    """
    digits = "0123456789"
    for text in (
        consent_text(texts, protocol.privacy.contact),
        *texts.instructions,
        texts.practice,
        texts.start,
        texts.question,
        "\n".join((*texts.answers.values(), *_key_labels(protocol, texts))),
        *(text for text in (texts.right, texts.wrong) if text),
        texts.break_page + digits,
        texts.paused,
        texts.gaze_lost,
        texts.too_late,
        texts.preparing,
        texts.quit_question,
        texts.thanks,
    ):
        typeface_for([fill(text, protocol.response)], _SMALLEST_PX)
    for question in texts.questions:
        text = fill(question.text, protocol.response)
        typeface_for([text, *question.choices, digits, _CARET], _SMALLEST_PX)


def _key_labels(protocol: StudyProtocol, texts: Texts) -> list[str]:
    """Every name of a key that a page shows."""
    shown = (*(keys[0] for keys in protocol.response.keys), protocol.response.continue_keys[0])
    return [key_label(key, texts.key_names) for key in (*shown, "enter")]


def _marks(page: Page) -> tuple[str, str]:
    """Return what stands before a choice that is open, and before the chosen one."""
    try:
        typeface_for([page.text, *page.choices, "○●"], _SMALLEST_PX)
    except StudyError:
        return "[  ]", "[x]"
    return "○", "●"


def _paste(image: NDArray[np.uint8], block: NDArray[np.uint8], place: tuple[int, int]) -> None:
    """Copy what of `block` lies on the image."""
    x, y = place
    height, width = image.shape[:2]
    fits = block[: max(0, height - y), : max(0, width - x)]
    image[y : y + fits.shape[0], x : x + fits.shape[1]] = fits
