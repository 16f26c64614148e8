"""Fonts on this machine, and the characters that each can draw.

Pillow has no font fallback: one text is drawn with one font, so that font must
hold every character of it.
"""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from pathlib import Path

from PIL import ImageFont

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
