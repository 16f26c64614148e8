"""The page of grey patches: shows a level, takes the photometer's reading, goes on."""

from __future__ import annotations

import numpy as np

from study_app.desktop.draw import Painter
from study_app.desktop.keys import edited
from study_app.desktop.luminance import LEVELS, PATCH_SHARE, parse_reading
from study_app.desktop.window import Window
from study_app.text_image import text_image, typeface_for

_BACKGROUND = 64
_HELP = "Hold the photometer to the patch, type cd/m2, press Enter. Escape stops."


def read_patches(window: Window) -> dict[int, float] | None:
    """Show every level of `LEVELS` until its reading is typed.

    Returns
    -------
    dict of level to cd/m2, or None where the operator stopped.
    """
    painter = Painter(window.ctx, window.size, _BACKGROUND)
    readings: dict[int, float] = {}
    try:
        for number, level in enumerate(LEVELS, start=1):
            reading = _read_one(window, painter, level, f"{number} of {len(LEVELS)}")
            if reading is None:
                return None
            readings[level] = reading
    finally:
        painter.release()
    return readings


def _read_one(window: Window, painter: Painter, level: int, progress: str) -> float | None:
    width, height = window.size
    letter_px = max(12, height // 36)
    edge = round(height * PATCH_SHARE)
    typed, drawn, texture = "", None, None
    while True:
        if drawn != typed:
            lines = [f"{progress}   level {level}", f"cd/m2: {typed}▏", _HELP]
            face = typeface_for(lines, letter_px)
            image = text_image(lines, face, width, align="centre", grey=255)
            if texture is not None:
                texture.release()
            texture, drawn = painter.texture(np.ascontiguousarray(image)), typed
        assert texture is not None
        painter.clear()
        painter.fill(((width - edge) // 2, height // 16), (edge, edge), level / 255)
        painter.image(texture, (0, height // 16 + edge + letter_px))
        window.flip()
        typed = edited(typed, window.typed())
        for press in window.key_presses():
            if press.key == "escape":
                texture.release()
                return None
            if press.key == "enter":
                reading = parse_reading(typed)
                if reading is not None:
                    texture.release()
                    return reading
                typed = ""
