"""A small video of a clip, to look at: not what participants see."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from protocols.manifest import Clip
from stimuli.media.png import decode
from stimuli.media.video import whole_video

PREVIEW_FOLDER = "previews"
LARGEST_PX = 480


def preview_path(out: Path, clip: Clip) -> Path:
    """Return the path of the preview of `clip`; its name carries the clip's hash."""
    return out / PREVIEW_FOLDER / f"{clip.name}.{clip.sha256[:12]}.webm"


def write_preview(out: Path, clip: Clip, path: Path) -> None:
    """Write a WebM (VP8) of at most 480 px, at the clip's rate.

    Raises
    ------
    InputError
        If a frame is damaged, or the video cannot be written.
    """
    scale = min(1.0, LARGEST_PX / max(clip.width_px, clip.height_px))
    size = tuple(max(2, round(scale * edge) // 2 * 2) for edge in (clip.width_px, clip.height_px))
    with whole_video(path, (size[0], size[1]), clip.fps) as write:
        for index in range(len(clip.frames_sha256)):
            frame = decode(out / clip.frame_path(index))
            if frame.dtype == np.uint16:
                frame = (frame >> 8).astype(np.uint8)
            small = cv2.resize(np.ascontiguousarray(frame), size, interpolation=cv2.INTER_AREA)
            write(np.asarray(small, np.uint8))
