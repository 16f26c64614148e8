"""`frames:FOLDER`: fills made elsewhere, one image per frame of the clip, or a video."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.methods.method import composite
from pipeline.pictures.decode import from_integers, read_integers
from pipeline.video_file import VideoFrames, is_video

FRAME = "{frame}"
"""Stands for a frame's number in a path."""
MOST_APART = 0.06
"""Median difference outside the holes, largest channel; half of a frame may be further off."""


class FramesOnDisk:
    """Take the holes' content from ``FOLDER/000000.png``, ``000001.png``, ...

    Only the holes are taken: all else stays the warp's own, so that methods differ in their
    fill alone. Outside the holes a frame shows what the warped frame shows, or nothing (black).

    Parameters
    ----------
    path : Path
        A folder of images of integers whose names are numbers from 0 without a gap; or a path to
        such images whose last part has ``{frame}`` in place of the number; or a video.

    Raises
    ------
    NotADirectoryError, FileNotFoundError
        If there is no such folder.
    InputError
        If it holds no frame, or a number is missing or there twice.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.video = VideoFrames(path) if is_video(path) else None
        self._files = [] if self.video is not None else self._numbered_files(path)

    @staticmethod
    def _numbered_files(path: Path) -> list[Path]:
        numbered: dict[int, Path] = {}
        for number, file in _numbered(path):
            if number in numbered:
                raise InputError(
                    f"{path}: must hold each frame once"
                    f" (frame {number} is in {numbered[number].name} and in {file.name})"
                )
            numbered[number] = file
        if not numbered:
            raise InputError(
                f"{path}: must hold frames named {_name(path, 0)}, {_name(path, 1)}, ... (has none)"
            )
        missing = sorted(set(range(max(numbered) + 1)) - numbered.keys())
        if missing:
            raise InputError(
                f"{path}: must hold every frame from 0 to {max(numbered)}"
                f" ({len(missing)} missing, the first is {missing[0]:06d})"
            )
        return [numbered[number] for number in range(len(numbered))]

    @staticmethod
    def files(path: Path) -> list[Path]:
        """Return the frames of a pattern, every file of a folder, or the video."""
        if is_video(path):
            return [path]
        if FRAME in path.name:
            return [file for _, file in _numbered(path)]
        if not path.is_dir():
            raise FileNotFoundError(2, "No such folder", str(path))
        return sorted(file for file in path.rglob("*") if file.is_file())

    @property
    def first(self) -> Path:
        """The file of frame 0."""
        return self.path if self.video is not None else self._files[0]

    def __len__(self) -> int:
        return len(self._files if self.video is None else self.video)

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes from the image of the frame's own index."""
        if warped.frame_index >= len(self):
            raise InputError(
                f"{self.path}: must hold frame {warped.frame_index:06d} (has {len(self)} frames)"
            )
        if self.video is not None:
            file = self.path
            colour = from_integers(self.video.read(warped.frame_index))
        else:
            file = self._files[warped.frame_index]
            colour = read_integers(file)
        if colour.shape != warped.colour.shape:
            raise InputError(
                f"{file}: must be {warped.size[1]} x {warped.size[0]} px as the warped frame"
                f" (is {colour.shape[1]} x {colour.shape[0]})"
            )
        _check_outside(file, colour, warped)
        return composite(warped, colour)

    def release(self) -> None:
        """Close the video, where it is one."""
        if self.video is not None:
            self.video.release()


def _numbered(path: Path) -> list[tuple[int, Path]]:
    """Every file with a frame's number, by name."""
    folder, name = path, r"(\d+)\.[^.]+"
    if FRAME in path.name:
        folder = path.parent
        head, _, tail = path.name.partition(FRAME)
        name = re.escape(head) + r"(\d+)" + re.escape(tail)
    return [
        (int(match[1]), file)
        for file in sorted(folder.iterdir())
        if file.is_file() and (match := re.fullmatch(name, file.name))
    ]


def _name(path: Path, frame: int) -> str:
    number = f"{frame:06d}"
    return path.name.replace(FRAME, number) if FRAME in path.name else f"{number}.png"


def _check_outside(file: Path, colour: NDArray[np.float32], warped: WarpedFrame) -> None:
    """Refuse a frame that shows something else than the warped one where that has no hole."""
    known = ~warped.hole
    shown = colour[known]
    if not shown.any():  # all black, or nothing is known
        return
    apart = float(np.median(np.abs(shown - warped.colour[known]).max(axis=-1)))
    if apart > MOST_APART:
        raise InputError(
            f"{file}: must show, outside the holes, what frame {warped.frame_index} of the clip"
            f" shows (half of its pixels differ by {255 * apart:.0f}/255 or more); is it of another"
            " scene, size or frame? 'metamerlab stimuli export-holes' writes what is to be filled"
        )
