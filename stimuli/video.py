"""Videos as folders of frames, and folders of frames as videos."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.image_file import read_pixels, three_channels
from pipeline.video_file import VideoFrames, is_video, quiet_stderr
from stimuli.png import encode_bytes

CODECS: Final = {".mp4": "mp4v", ".webm": "VP80", ".avi": "FFV1"}
"""What is written, by ending: .avi keeps every pixel, the others are smaller."""


@dataclass(frozen=True)
class Unpacked:
    """A video's frames as a folder of PNG, ``000000.png`` on."""

    folder: Path
    fps: float
    frames: int
    notes: list[str]
    """What a user should know of it."""


@contextmanager
def unpacked_video(path: Path) -> Iterator[Unpacked]:
    """Give a video's frames as a folder that is gone when the block ends.

    Raises
    ------
    InputError
        As `VideoFrames` raises it, or if there is no frame or no rate.
    """
    video = VideoFrames(path)
    with tempfile.TemporaryDirectory(prefix="metamerlab-frames-") as made:
        folder = Path(made) / path.stem  # scores are told by names of folders
        folder.mkdir()
        count = 0
        try:
            for count, frame in enumerate(video, 1):
                (folder / f"{count - 1:06d}.png").write_bytes(encode_bytes(frame))
        finally:
            video.release()
        if not count or not video.fps:
            raise InputError(
                f"{path}: must have frames and a rate (has {count} at {video.fps:g} a second)"
            )
        notes = list(video.notes)
        if video.promised > count + 1:
            notes.append(
                f"of {video.promised} frames that the video should have, {count} could be read:"
                " was it cut short?"
            )
        yield Unpacked(folder, video.fps, count, notes)


@contextmanager
def folder_of_frames(path: Path, tell: Callable[[str], None]) -> Iterator[Path]:
    """Give a video's frames as a folder for as long as the block lasts; all else as it is.

    `tell` is given each of its notes.
    """
    if not is_video(path):
        yield path
        return
    with unpacked_video(path) as unpacked:
        for note in unpacked.notes:
            tell(f"note: {note}")
        yield unpacked.folder


def check_video(path: Path, width: int, height: int) -> str:
    """Refuse a video that cannot be written in this size; return its codec.

    Raises
    ------
    InputError
        If the ending is another, or an edge is odd where the codec needs even ones.
    """
    codec = CODECS.get(path.suffix.lower())
    if codec is None:
        raise InputError(f"{path}: must end in {', '.join(CODECS)}")
    if codec != "FFV1" and (width % 2 or height % 2):
        raise InputError(
            f"{path}: this kind of video needs even edges (frames are {width} x {height} px); write"
            " .avi, which keeps every pixel"
        )
    return codec


def write_video(path: Path, frames: Sequence[Path], fps: float) -> None:
    """Write pictures of one size as a video, whole or not at all.

    Parameters
    ----------
    path : Path
        Ends in ``.mp4``, ``.webm`` or ``.avi``; see `CODECS`. Its folder is made.
    frames : sequence of Path
        Pictures of 8 or 16 bits, in their order; videos have 8, so 16 are rounded.

    Raises
    ------
    InputError
        If the ending is another, sizes or numbers differ, or an edge is odd where the codec needs
        even ones.
    """
    first = _in_8_bits(frames[0])
    height, width = first.shape[:2]
    codec = check_video(path, width, height)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix.lower()}")
    with quiet_stderr():
        writer = cv2.VideoWriter(
            str(temporary), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), fps, (width, height)
        )
    try:
        if not writer.isOpened():
            raise InputError(f"{path}: OpenCV here cannot write {codec}; take another ending")
        for file in frames:
            frame = _in_8_bits(file)
            if frame.shape != first.shape:
                raise InputError(
                    f"{file}: must be {width} x {height} px as the frame before (is"
                    f" {frame.shape[1]} x {frame.shape[0]})"
                )
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
        writer.release()
        temporary.replace(path)
    finally:
        writer.release()
        temporary.unlink(missing_ok=True)


def _in_8_bits(path: Path) -> NDArray[np.uint8]:
    pixels = three_channels(path, read_pixels(path))
    if pixels.dtype.kind != "u":
        raise InputError(f"{path}: must have 8 or 16 bits per channel (has {pixels.dtype})")
    return np.asarray(np.rint(pixels / (np.iinfo(pixels.dtype).max / 255)), np.uint8)
