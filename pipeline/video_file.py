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
        edges = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        width, height = (round(self._video.get(edge)) for edge in edges)
        try:
            check_values(path, width, height, 3)
            self.size_px = (width, height)
            with quiet_stderr():
                while self._video.grab():  # what the head says of its length may be wrong
                    self._next += 1
            self._count = self._next
            if not self._count:
                raise InputError(f"{path}: must have frames (has none, or is damaged)")
        finally:
            self._video.release()

    def _open(self) -> None:
        # FFmpeg alone: OpenCV's other readers take numbered pictures for a sequence.
        with quiet_stderr():
            self._video = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        self._next = 0
        if not self._video.isOpened():
            raise InputError(f"{self.path}: must be a video that OpenCV reads (or it is damaged)")

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
