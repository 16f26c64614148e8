"""Windows of browsers and headsets, and what of a study is seen in them."""

from __future__ import annotations

from protocols.journal import BrowserWindow, HeadsetDevice
from protocols.script import PixelSize


def shows_all(window: BrowserWindow, need_px: PixelSize) -> bool:
    """Return True if a window shows so many pixels of a study, each as large as its scale says."""
    seen = zip(window.window_px, need_px, strict=True)
    return all(has_px >= window.scale * of_px for has_px, of_px in seen)


def window_in_words(window: BrowserWindow) -> str:
    """Return size, ratio, scale and full screen of a window."""
    width, height = window.window_px
    full = "in full screen" if window.full_screen else "not in full screen"
    ratio = f"device ratio {window.device_pixel_ratio:g}, scale {window.scale}"
    return f"window of {width} x {height} px, {ratio}, {full}"


def headset_in_words(headset: HeadsetDevice) -> str:
    """Return controllers, distance of the eyes, and sizes of the views of a headset."""
    views = ", ".join(
        f"{view.eye} {view.size_px[0]} x {view.size_px[1]} px" for view in headset.views
    )
    return f"{headset.profile}, eyes {1000 * headset.eye_distance_m:.0f} mm apart, {views}"
