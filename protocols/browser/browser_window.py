"""Windows of browsers, and what of a trial is seen in them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import ceil
from typing import TypeAlias

from protocols.journal import BrowserWindow
from protocols.script import Frames, PixelSize, TrialScript

PlacedRect: TypeAlias = tuple[float, float, float, float]
"""Left and top, from the middle of the screen, width and height, px."""


def shows_all(window: BrowserWindow, need_px: PixelSize) -> bool:
    """Return True if a window shows so many pixels of a study, each as large as its scale says."""
    seen = zip(window.window_px, need_px, strict=True)
    return all(has_px >= window.scale * of_px for has_px, of_px in seen)


def stimuli_px(script: TrialScript) -> PixelSize:
    """Return the smallest part of the screen, about its middle, that shows a trial's stimuli.

    Texts are left out: their size is that of the fonts of the machine that exported the study.
    """
    return about_middle(stimuli_rects(script))


def stimuli_rects(script: TrialScript) -> Iterator[PlacedRect]:
    """Yield the rectangles in which a trial shows stimuli."""
    for frames in (entry for phase in script.phases for entry in phase.show):
        if isinstance(frames, Frames):
            yield *frames.at, *(frames.crop or (0, 0, *script.stimulus_px))[2:]


def about_middle(rects: Iterable[PlacedRect]) -> PixelSize:
    """Return the smallest part of the screen, about its middle, that holds such rectangles."""
    reach_x = reach_y = 1.0
    for left, top, width, height in rects:
        reach_x, reach_y = max(reach_x, -left, left + width), max(reach_y, -top, top + height)
    return 2 * ceil(reach_x), 2 * ceil(reach_y)


def window_in_words(window: BrowserWindow) -> str:
    """Return size, ratio, scale and full screen of a window."""
    width, height = window.window_px
    full = "in full screen" if window.full_screen else "not in full screen"
    ratio = f"device ratio {window.device_pixel_ratio:g}, scale {window.scale}"
    return f"window of {width} x {height} px, {ratio}, {full}"
