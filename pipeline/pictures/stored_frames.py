"""Frames of a picture, a folder of pictures or a video, as stored: 8-bit red, green, blue."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.pictures.decode import read_pixels, three_channels
from pipeline.pictures.header import stated_size_px
from pipeline.video_file import VideoFrames


def sequence_files(file: str, folder: Path) -> list[Path]:
    """Return the files of a sequence in order; ``####`` in `file` stands for the number.

    Raises
    ------
    FileNotFoundError
        If there is none.
    InputError
        If a number is missing in between.
    """
    match = re.search(r"#+", file)
    if match is None:
        if not (folder / file).is_file():
            raise FileNotFoundError(2, "No such file", str(folder / file))
        return [folder / file]
    head, tail = file[: match.start()], file[match.end() :]
    place = folder / Path(head).parent if "/" in head else folder
    name = re.compile(
        re.escape(Path(head).name if not head.endswith("/") else "")
        + rf"(\d{{{len(match[0])},}})" + re.escape(tail) + "$"
    )  # fmt: skip
    entries = sorted(place.iterdir()) if place.is_dir() else []
    numbered = {int(m[1]): e for e in entries if (m := name.fullmatch(e.name))}
    if not numbered:
        raise FileNotFoundError(2, "No such file", str(folder / file))
    missing = sorted(set(range(min(numbered), max(numbered) + 1)) - numbered.keys())
    if missing:
        raise InputError(
            f"{folder / file}: must have every frame from {min(numbered)} to"
            f" {max(numbered)} ({len(missing)} missing, the first is {missing[0]});"
            " render what is missing, or copy the frames of one part into a folder of their own"
        )
    return [numbered[number] for number in sorted(numbered)]


RATE_TOLERANCE_SHARE = 1e-3
"""Video files say 29.97 Hz in several ways."""
Frame = NDArray[np.uint8]


def read_frames(
    path: Path, size_px: tuple[int, int], frames: int, fps: float | None
) -> Iterator[Frame]:
    """Yield the frames of a stimulus, each of shape (H, W, 3).

    Parameters
    ----------
    path : Path
        A picture of any format that OpenImageIO reads; with `fps` a folder of such pictures, in
        the order of their names, or a video that OpenCV reads.
    size_px : (int, int)
        Width and height that each frame must have: nothing is rescaled.
    frames : int
        How many there must be.
    fps : float, optional
        Frames per second that a video must state; None for a still.

    Raises
    ------
    InputError
        If the file is not there or damaged, or anything of it differs from what is said here.
        Frames may have been yielded before that.
    """
    if not path.exists():
        raise InputError(f"{path}: must be there (there is no such file)")
    if fps is None:
        found: Iterator[Frame] = iter([read_picture(path)])
    elif path.is_dir():
        found = _frames_of_folder(path, frames)
    else:
        found = _frames_of_video(path, frames, fps)
    width, height = size_px
    count = 0
    for frame in found:
        if frame.shape[:2] != (height, width):
            got = frame.shape[1], frame.shape[0]
            raise InputError(f"{path}: {wrong_size(size_px, got)}")
        count += 1
        if count <= frames:
            yield frame
    if count != frames:
        raise _wrong_number(path, frames, count)


def read_picture(path: Path) -> Frame:
    """Return a picture with 8 bits per channel; grey becomes three equal channels.

    Raises
    ------
    InputError
        If it is not a whole picture, is transparent, has more than 8 bits, is stored turned, or
        holds several pictures.
    """
    if path.is_dir():
        raise InputError(
            f"{path}: must be a picture (this is a folder); a folder of frames is a video: give"
            " stimuli.fps and stimuli.duration_s"
        )
    pixels = read_pixels(path)
    if pixels.data.dtype != np.uint8:
        bits = "16 bits" if pixels.data.dtype == np.uint16 else "numbers of more than 8 bits"
        raise InputError(
            f"{path}: must have 8 bits per channel (has {bits}); save it with 8 bits, so that what"
            " is shown is your choice"
        )
    return np.ascontiguousarray(three_channels(path, pixels))


class StimulusHeader(NamedTuple):
    """Statements in the header of a stimulus."""

    size_px: tuple[int, int] | None
    """Width and height; None where a picture cannot be read: `read_frames` says why."""
    notes: Sequence[str] = ()
    """Other statements, which are not followed."""


def stated(path: Path, fps: float | None) -> StimulusHeader:
    """Return the header of a stimulus, without decoding it; of a folder, of its first.

    Raises
    ------
    InputError
        If a video cannot be read, or its header says what must be refused.
    """
    if fps is None:
        return StimulusHeader(stated_size_px(path))
    if path.is_dir():
        return StimulusHeader(next(map(stated_size_px, frame_files(path)), None))
    video = VideoFrames(path)
    video.release()
    return StimulusHeader(video.size_px, video.notes)


def file_sha256(path: Path) -> str:
    """Return the hash of a file, or of the names and files of a folder.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    digest = hashlib.sha256()
    for part in frame_files(path) if path.is_dir() else [path]:
        if path.is_dir():
            digest.update(part.name.encode() + b"\0")
        with part.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def frame_files(folder: Path) -> list[Path]:
    """Return the files of a folder of frames by name; hidden ones do not count."""
    return sorted(
        entry for entry in folder.iterdir() if entry.is_file() and not entry.name.startswith(".")
    )


def wrong_size(wanted: tuple[int, int], got: tuple[int, int]) -> str:
    """Return the fault of a stimulus of another size than the study's."""
    return (
        f"must be {wanted[0]} x {wanted[1]} px, as the study says (got {got[0]} x {got[1]} px); no"
        " picture is rescaled: make it again at that size, or change width_px and height_px"
    )


def _frames_of_folder(folder: Path, frames: int) -> Iterator[Frame]:
    files = frame_files(folder)
    if len(files) != frames:
        raise _wrong_number(folder, frames, len(files))
    yield from map(read_picture, files)


def _frames_of_video(path: Path, frames: int, fps: float) -> Iterator[Frame]:
    video = VideoFrames(path, fps)
    try:
        if video.fps and abs(video.fps - fps) > RATE_TOLERANCE_SHARE * fps:
            raise InputError(
                f"{path}: must have {fps:g} frames per second, as the study says (it says"
                f" {video.fps:g}); make it again at that rate, or change fps"
            )
        for count, frame in enumerate(video, 1):
            if count > frames:  # one more than wanted is enough to know
                raise _wrong_number(path, frames, max(count, video.promised))
            yield frame
    finally:
        video.release()


def _wrong_number(path: Path, wanted: int, got: int) -> InputError:
    return InputError(
        f"{path}: must have {wanted} frames, duration_s x fps (got {got}); cut it, or change"
        " duration_s"
    )
