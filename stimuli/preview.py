"""A small video of a clip, to look at: not what participants see."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.video_file import quiet_stderr
from protocols.manifest import Clip
from stimuli.png import decode

PREVIEW_FOLDER = "previews"
LARGEST_PX = 480
_TRACK_UID = b"s\xc5\x88"  # of Matroska: the element's name, and that eight bytes follow
_HEAD = 4096  # bytes that hold everything before the frames


def preview_path(out: Path, clip: Clip) -> Path:
    """Return where the preview of `clip` lies; its name carries the clip's hash."""
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
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part.webm")
    with quiet_stderr():
        writer = cv2.VideoWriter(
            str(temporary), cv2.VideoWriter.fourcc(*"VP80"), clip.fps, (size[0], size[1])
        )
    try:
        for index in range(len(clip.frames_sha256)):
            frame = decode(out / clip.frame_path(index))
            if frame.dtype == np.uint16:
                frame = (frame >> 8).astype(np.uint8)
            small = cv2.resize(
                np.ascontiguousarray(frame[..., ::-1]), size, interpolation=cv2.INTER_AREA
            )
            writer.write(small)
        writer.release()
        if not temporary.exists() or temporary.stat().st_size == 0:
            raise InputError(f"{path}: the preview could not be written; set clips.preview = false")
        _without_chance(temporary)
        temporary.replace(path)
    finally:
        writer.release()
        temporary.unlink(missing_ok=True)


def _without_chance(path: Path) -> None:
    """Put 1 for the number that FFmpeg draws for the track: same frames, same bytes."""
    data = path.read_bytes()
    at = data.find(_TRACK_UID)
    if at >= 0:
        drawn = data[at + len(_TRACK_UID) :][:8]
        fixed = (1).to_bytes(8, "big")
        path.write_bytes(
            data[:_HEAD].replace(b"\xc5\x88" + drawn, b"\xc5\x88" + fixed) + data[_HEAD:]
        )
