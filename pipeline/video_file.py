"""Frames of a video file, in their order or by their number: the one reader of videos."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.pictures.size_limits import check_values
from pipeline.statements.check_statements import VideoStatement, judged
from pipeline.video_header.read_header import number_bytes, statements
from protocols.outside import reading

_CONTAINERS: Final = (
    (0, b"RIFF"), (0, b"\x1aE\xdf\xa3"), (0, b"OggS"), (0, b"\x00\x00\x01\xba"),
    (0, b"\x00\x00\x01\xb3"), (0, b"\x30\x26\xb2\x75"), (0, b"FLV"), (0, b"YUV4MPEG2"),
    (0, b"DKIF"), (0, b"GIF8"), (188, b"G"),
    *((4, kind) for kind in (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot")),
)  # fmt: skip
"""First bytes of files that hold a video: AVI, Matroska, Ogg, MPEG, ASF, ..., MP4 and MOV."""
_LISTS: Final = (b"#EXTM3U", b"ffconcat", b"<MPD", b"c=IN IP")
"""Texts that FFmpeg takes for a list of other files, wherever they stand at the beginning."""
_HEAD: Final = 4096
VIDEOS: Final = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi")
"""Endings of videos; FFmpeg decides whether a file is one."""
LARGEST_SHIFT: Final = 0.5
"""Frames that a frame may come early or late: it is still nearest to its own place."""
_ROUNDING_MS: Final = 1.0  # of times in Matroska
_NEAR_RATE_SHARE: Final = 0.03
_NO_FRAMES: Final = VideoStatement(
    "no frames", "has none, or is damaged, or its codec is not known"
)


def is_video(path: Path) -> bool:
    """True if a path names a file with the ending of a video."""
    return path.suffix.lower() in VIDEOS and path.is_file()


# FFmpeg would write of every damaged frame to the terminal; OpenCV asks for this once.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
_ONE_AT_A_TIME = threading.Lock()


@contextmanager
def quiet_stderr() -> Iterator[None]:
    """Keep what OpenCV writes straight to the descriptor from the terminal, for a moment."""
    with _ONE_AT_A_TIME:
        kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nothing)


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
        raise InputError(
            f"{path}: must be a video that OpenCV reads (it is damaged, or its codec is not known);"
            " export it anew, in a common codec such as H.264"
        )
    return video


def _edges(video: cv2.VideoCapture) -> tuple[int, int]:
    width, height = (
        round(video.get(edge)) for edge in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    return width, height


class VideoFrames:
    """A video's frames, in their order or by their number; fast in their order.

    Frames have 8 bits a channel, whatever the video holds.

    Parameters
    ----------
    path : Path
        The file.
    wanted_fps : float, optional
        Frames per second that its study wants, for cures.

    Attributes
    ----------
    size_px : (int, int)
        Width and height.
    fps : float
        Frames per second, as the file says; 0 if it says none.
    promised : int
        Frames that the file says it has; some files only estimate it.
    notes : list of str
        What a user should know of what the file says: see `pipeline.video_header`.

    Raises
    ------
    InputError
        If FFmpeg, in OpenCV, cannot read it, or it says what must be refused.
    """

    def __init__(self, path: Path, wanted_fps: float | None = None) -> None:
        self.path, self._wanted_fps = path, wanted_fps
        self.fps = self._first_ms = self._last_ms = 0.0
        self._open()
        number = self._video.get
        try:
            self.size_px = _edges(self._video)
            if not all(self.size_px):
                judged(path, [_NO_FRAMES])
            check_values(path, *self.size_px, 3)
            fps = number(cv2.CAP_PROP_FPS)
            if np.isfinite(fps) and fps > 0:
                self.fps = float(fps)
            self.promised = int(number(cv2.CAP_PROP_FRAME_COUNT))
            self.notes = judged(path, statements(path, self._video))
        except Exception:
            self.release()
            raise

    def _open(self) -> None:
        self._video = _capture(self.path)
        if number_bytes(self._video, cv2.CAP_PROP_CODEC_PIXEL_FORMAT) == b"BGRA":
            self._video.set(cv2.CAP_PROP_CONVERT_RGB, 0)  # which would drop alpha unseen
        self._next = 0

    def __len__(self) -> int:
        """Count the frames, by going through them: the head's count may be wrong."""
        return self._count

    @cached_property
    def _count(self) -> int:
        self._rewind()
        while self._grab():
            pass
        count = self._next
        self.release()
        if not count:
            judged(self.path, [_NO_FRAMES])
        return count

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Yield every frame as `read` returns it."""
        self._rewind()
        while self._grab():
            yield self._retrieve()

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one frame, (height, width, 3), encoded colour.

        Raises
        ------
        InputError
            If it cannot be read, is of another size, or does not come when the rate says.
        """
        if index < self._next or not self._video.isOpened():
            self._rewind()
        while self._next <= index:
            if not self._grab():
                raise InputError(f"{self.path}: must hold frame {index} (has {self._next} frames)")
        return self._retrieve()

    def release(self) -> None:
        """Close the file."""
        self._video.release()

    def _rewind(self) -> None:
        self.release()
        self._open()

    def _grab(self) -> bool:
        with reading(self.path, "a whole video", InputError):
            if not self._video.grab():
                return False
            time_ms = float(self._video.get(cv2.CAP_PROP_POS_MSEC))
        if self._next == 0:
            self._first_ms = self._last_ms = time_ms
        elif time_ms and self.fps:  # 0: not known, as at the end of some AVI files
            shift = (time_ms - self._first_ms) * self.fps / 1000 - self._next
            if abs(shift) > LARGEST_SHIFT + _ROUNDING_MS * self.fps / 1000:
                judged(self.path, [self._off_the_rate(time_ms)])
            self._last_ms = time_ms
        self._next += 1
        return True

    def _off_the_rate(self, time_ms: float) -> VideoStatement:
        last_ms, gaps = (self._last_ms, self._next - 1) if self._next > 1 else (time_ms, 1)
        before_ms = (last_ms - self._first_ms) / gaps
        rate = 1000 / before_ms if before_ms > 0 else self.fps
        rate = round(rate) if abs(round(rate) / rate - 1) < _NEAR_RATE_SHARE else round(rate, 3)
        rate = self._wanted_fps or rate  # the cure makes a video that a study takes
        after_s = (time_ms - self._first_ms) / 1000
        words = (
            f"frame {self._next} comes {after_s:.3f} s after the first; at {self.fps:g} a second it"
            f" would be {self._next / self.fps:.3f} s"
        )
        return VideoStatement("frame times", words, {"rate": f"{rate:g}"})

    def _retrieve(self) -> NDArray[np.uint8]:
        """Return the frame that was grabbed last."""
        with reading(self.path, "a whole video", InputError):
            done, frame = self._video.retrieve()
        if done and frame.ndim == 3 and frame.shape[2] == 4:
            if not (frame[..., 3] == 255).all():
                judged(
                    self.path, [VideoStatement("alpha", f"frame {self._next - 1} is transparent")]
                )
            frame = frame[..., :3]
        shape = (*self.size_px[::-1], 3)
        if not done or frame.dtype != np.uint8 or frame.shape != shape:
            found = f"{frame.dtype}, {_by(frame.shape)}" if done else "cannot be decoded"
            raise InputError(
                f"{self.path}: every frame must be a whole colour frame of {_by(shape[1::-1])} px"
                f" (frame {self._next - 1}: {found})"
            )
        return np.ascontiguousarray(frame[..., ::-1], np.uint8)


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))
