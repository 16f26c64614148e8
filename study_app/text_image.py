"""Text as an image, in any script that a font of this machine can write.

Pillow draws, with raqm for scripts that need shaping and for right-to-left lines. It has no font
fallback: one text is drawn with one font, so that font must hold every character of it.
"""

from __future__ import annotations

import math
import os
import re
import sys
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, features

from protocols.errors import StudyError

# Read first: these are the ones with the widest coverage.
_PREFERRED = ("dejavusans.", "notosans-regular.", "notosanscjk-regular.", "freesans.", "unifont")


def find_fonts() -> list[Path]:
    """Return every TrueType and OpenType font file, those with wide coverage first."""
    home = Path.home()
    folders: tuple[Path, ...]
    if sys.platform == "win32":
        data = os.environ.get("LOCALAPPDATA") or str(home / "AppData/Local")
        root = os.environ.get("SYSTEMROOT") or "C:/Windows"
        folders = (Path(data) / "Microsoft/Windows/Fonts", Path(root) / "Fonts")
    elif sys.platform == "darwin":
        folders = tuple(base / "Library/Fonts" for base in (home, Path("/"), Path("/System")))
    else:
        data = os.environ.get("XDG_DATA_HOME") or str(home / ".local/share")
        shared = os.environ.get("XDG_DATA_DIRS") or "/usr/local/share:/usr/share"
        bases = (data, *shared.split(":"))
        folders = (home / ".fonts", *(Path(base) / "fonts" for base in bases))
    return list(_fonts_in(folders))


@lru_cache(maxsize=1)  # a study has dozens of texts
def _fonts_in(folders: tuple[Path, ...]) -> tuple[Path, ...]:
    found = {
        path
        for folder in folders
        if folder.is_dir()
        for path in folder.rglob("*")
        if path.suffix.lower() in (".ttf", ".otf", ".ttc")
    }
    return tuple(sorted(found, key=lambda path: (_preference(path), str(path))))


def missing_characters(font: Path, text: str) -> str:
    """Return the characters of `text` that `font` cannot draw (spaces aside).

    Raises
    ------
    OSError
        If `font` is not a font that FreeType can read.
    """
    blank = _outline(font, "\U0010ffff")  # never assigned: every font draws its "not here" box
    return "".join(
        char for char in dict.fromkeys(text) if not char.isspace() and _outline(font, char) == blank
    )


def _preference(path: Path) -> int:
    name = path.name.lower()
    return next((rank for rank, start in enumerate(_PREFERRED) if name.startswith(start)), 99)


@lru_cache(maxsize=1)
def _face(font: Path) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(font, 32, layout_engine=ImageFont.Layout.BASIC)


@lru_cache(maxsize=1024)  # texts share their letters
def _outline(font: Path, char: str) -> tuple[tuple[int, int], bytes]:
    mask = _face(font).getmask(char, mode="L")
    return mask.size, bytes(mask)


class UnwritableError(StudyError):
    """Characters that no font of this machine can draw."""


Align = Literal["left", "centre"]
LINE_SPACING = 1.45
_SHAPED = re.compile("[\u0590-\u0dff\u0e00-\u0fff\u1000-\u109f\u1780-\u17ff\ufb1d-\ufefc]")
"""Hebrew, Arabic, Indic and South-East Asian scripts: wrong without shaping."""
_SPACELESS = re.compile("[\u2e80-\u9fff\uac00-\ud7a3\uf900-\ufaff\uff00-\uffef]")
"""Scripts written without spaces: a line may break between any two characters ..."""
_NOT_FIRST = "、。，．・：；？！）」』】〕〉》ー々ぁぃぅぇぉっゃゅょァィゥェォッャュョ"  # noqa: RUF001
"""... except before these."""


@dataclass(frozen=True)
class Typeface:
    """A font file at a size, for texts it can write."""

    path: Path
    size_px: int

    @property
    def line_px(self) -> int:
        """Distance of two lines."""
        return round(self.size_px * LINE_SPACING)


def typeface_for(texts: Sequence[str], size_px: int) -> Typeface:
    """Return a font that holds every character of `texts`.

    Raises
    ------
    UnwritableError
        If no font on this machine does, naming the characters; or if the script needs shaping
        and the shaping library is missing.
    """
    text = _characters(texts)
    if _SHAPED.search(text) and not features.check("raqm"):
        raise UnwritableError(
            "text: this script needs shaping (Pillow finds no raqm); install libfribidi0"
        )
    return Typeface(_font_for(text), size_px)


def _characters(texts: Sequence[str]) -> str:
    return "".join(sorted(set("".join(texts)) - set("\n")))


@lru_cache(maxsize=512)
def _font_for(text: str) -> Path:
    best: tuple[int, Path | None, str] = (len(text) + 1, None, text)
    for path in find_fonts():
        try:
            missing = missing_characters(path, text)
        except OSError:
            continue
        if not missing:
            return path
        best = min(best, (len(missing), path, missing), key=lambda entry: entry[0])
    _, nearest, missing = best
    shown = " ".join(missing[:12]) + (" ..." if len(missing) > 12 else "")
    raise UnwritableError(
        f"text: one font must hold every character that is shown (the best here, {nearest}, lacks"
        f" {len(missing)}: {shown}); install a font of that script, for instance fonts-noto-core"
        " or fonts-noto-cjk"
    )


def writable(text: str, along_with: str) -> str:
    """Return `text` with a question mark for each character that cannot be drawn.

    It is drawn in one font together with `along_with`, which must be writable itself.
    """
    try:
        _font_for(_characters([text, along_with]))
    except UnwritableError:
        missing = missing_characters(_font_for(_characters([along_with])), text)
        return "".join("?" if char in missing else char for char in text)
    return text


def is_right_to_left(text: str) -> bool:
    """Return True if the first strong character runs from right to left."""
    for char in text:
        direction = unicodedata.bidirectional(char)
        if direction in ("R", "AL"):
            return True
        if direction == "L":
            return False
    return False


def wrap(text: str, typeface: Typeface, width_px: int) -> list[str]:
    """Break a text into lines that fit; line feeds in it stay."""
    font = _load(typeface)
    lines: list[str] = []
    for paragraph in text.split("\n"):
        line = ""
        for piece in _pieces(paragraph):
            if line and font.getlength((line + piece).rstrip()) > width_px:
                lines.append(line.rstrip())
                line = piece.lstrip()
            else:
                line += piece
        lines.append(line.rstrip())
    return lines


def widest_px(lines: Sequence[str], typeface: Typeface) -> int:
    """Return the width of the widest line."""
    font = _load(typeface)
    return max(1, *(math.ceil(font.getlength(line)) for line in lines))


def _pieces(paragraph: str) -> list[str]:
    """Return the pieces that may not be broken: words with their spaces, single ideographs."""
    pieces: list[str] = []
    for word in re.findall(r"\S+\s*|\s+", paragraph):
        start = 0
        for place in range(1, len(word)):
            near = _SPACELESS.match(word[place]) or _SPACELESS.match(word[place - 1])
            if near and word[place] not in _NOT_FIRST and not word[place].isspace():
                pieces.append(word[start:place])
                start = place
        pieces.append(word[start:])
    return pieces


def text_image(
    lines: Sequence[str], typeface: Typeface, width_px: int, *, align: Align = "left", grey: int = 0
) -> NDArray[np.uint8]:
    """Draw lines of text.

    Returns
    -------
    ndarray of shape (H, width_px, 4)
        RGBA with straight alpha: the text's grey, transparent elsewhere. Right-to-left lines
        stand at the right edge.
    """
    font = _load(typeface)
    height = typeface.line_px * max(1, len(lines)) + typeface.size_px // 2
    mask = Image.new("L", (width_px, height), 0)
    draw = ImageDraw.Draw(mask)
    for index, line in enumerate(lines):
        right = is_right_to_left(line)
        length = font.getlength(line)
        left = (width_px - length) / 2 if align == "centre" else width_px - length if right else 0
        baseline = index * typeface.line_px + typeface.size_px
        direction = ("rtl" if right else "ltr") if features.check("raqm") else None
        draw.text(
            (max(0, left), baseline), line, fill=255, font=font, anchor="ls", direction=direction
        )
    image = np.empty((height, width_px, 4), np.uint8)
    image[..., :3] = grey
    image[..., 3] = np.asarray(mask)
    return image


@lru_cache(maxsize=32)
def _load(typeface: Typeface) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(typeface.path, typeface.size_px)
