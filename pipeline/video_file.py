"""Frames of a video file, read by their number."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.limits import check_values

_CONTAINERS: Final = (
    (0, b"RIFF"), (0, b"\x1aE\xdf\xa3"), (0, b"OggS"), (0, b"\x00\x00\x01\xba"),
    (0, b"\x00\x00\x01\xb3"), (0, b"\x30\x26\xb2\x75"), (0, b"FLV"), (0, b"YUV4MPEG2"),
    (0, b"DKIF"), (0, b"GIF8"), (188, b"G"),
    *((4, kind) for kind in (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot")),
)  # fmt: skip
"""How files begin that hold a video themselves: AVI, Matroska, Ogg, MPEG, ASF, ..., MP4 and MOV."""
_LISTS: Final = (b"#EXTM3U", b"ffconcat", b"<MPD", b"c=IN IP")
"""What FFmpeg takes for a list of other files, wherever it stands at the beginning."""
_HEAD: Final = 4096
VIDEOS: Final = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi")
"""What is taken for a video, by its ending; FFmpeg decides whether it is one."""


def is_video(path: Path) -> bool:
    """Whether a path names a file that is taken for a video."""
    return path.suffix.lower() in VIDEOS and path.is_file()


@contextmanager
def quiet_stderr() -> Iterator[None]:
    """Keep what FFmpeg and OpenCV write straight to the descriptor from the terminal."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


@contextmanager
def opened_video(path: Path) -> Iterator[cv2.VideoCapture]:
    """Give a video as FFmpeg reads it, in OpenCV; it is closed when the block ends.

    Raises
    ------
    InputError
        If it is no video but a list of others, such as a playlist; if FFmpeg cannot read it; or if
        a frame holds more numbers than the limit.
    """
    video = _capture(path)
    try:
        check_values(path, *_edges(video), 3)
        yield video
    finally:
        video.release()


def _capture(path: Path) -> cv2.VideoCapture:
    with path.open("rb") as file:
        head = file.read(_HEAD)
    # Playlists and the like lead to other files, which nobody named or hashed.
    known = any(head.startswith(mark, place) for place, mark in _CONTAINERS)
    if not known or any(mark in head for mark in _LISTS):
        raise InputError(
            f"{path}: must be a video that OpenCV reads, as {', '.join(VIDEOS)} files are, and no"
            f" list of others (it begins with {ascii(head[:16])[1:]}); export it as a video"
        )
    # FFmpeg alone: OpenCV's other readers take numbered pictures for a sequence.
    with quiet_stderr():
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not video.isOpened():
        raise InputError(f"{path}: must be a video that OpenCV reads (or it is damaged)")
    return video


def _edges(video: cv2.VideoCapture) -> tuple[int, int]:
    width, height = (
        round(video.get(edge)) for edge in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    return width, height


def stated_video_size_px(path: Path) -> tuple[int, int] | None:
    """Return width and height as a video says; None where it cannot be read."""
    try:
        with opened_video(path) as video:
            return _edges(video)
    except (InputError, OSError):
        return None


class VideoFrames:
    """A video whose frames are read by number; fast in their order.

    Attributes
    ----------
    size_px : (int, int)
        Width and height.

    Raises
    ------
    InputError
        If FFmpeg, in OpenCV, cannot read it, or it has no frame.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._open()
        try:
            self.size_px = _edges(self._video)
            check_values(path, *self.size_px, 3)
            with quiet_stderr():
                while self._video.grab():  # what the head says of its length may be wrong
                    self._next += 1
            self._count = self._next
            if not self._count:
                raise InputError(f"{path}: must have frames (has none, or is damaged)")
        finally:
            self._video.release()

    def _open(self) -> None:
        self._video = _capture(self.path)
        self._next = 0

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one frame, (height, width, 3), encoded colour.

        Raises
        ------
        InputError
            If it cannot be read, or is not of 8 bits.
        """
        if index < self._next or not self._video.isOpened():
            self._video.release()
            self._open()
        with quiet_stderr():
            while self._next < index and self._video.grab():
                self._next += 1
            done, frame = self._video.read()
        if not done or frame.dtype != np.uint8 or frame.ndim != 3:
            raise InputError(f"{self.path}: frame {index} must be a colour frame that is whole")
        self._next += 1
        return np.ascontiguousarray(frame[..., ::-1], np.uint8)

    def release(self) -> None:
        """Close the file."""
        self._video.release()
