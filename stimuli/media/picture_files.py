"""The one walk of commands over pictures: read one at a time, all of one size, and written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.pictures.colour_file import AnyPicture, PictureReading, read_any, save_colour
from protocols.disk.result_folder import whole_folder
from stimuli.media.frames_folder import Reporter, frames_in


class PictureFiles:
    """A picture, or the frames of a folder in the order of their names, for one command.

    Parameters
    ----------
    source : Path
        Any picture that `read_any` reads, or a folder of such.
    command : str
        One of `pipeline.pictures.size_limits.NEEDS`.
    reading : PictureReading, optional
        What is said about the files.

    Raises
    ------
    InputError, OSError
        If a folder has none.
    """

    def __init__(self, source: Path, command: str, reading: PictureReading | None = None) -> None:
        self.paths = frames_in(source) if source.is_dir() else [source]
        self._source, self._reading, self._command = source, reading, command

    @cached_property
    def first(self) -> AnyPicture:
        """The first picture, read when it is asked for."""
        return read_any(self.paths[0], self._reading, self._command)

    @property
    def names(self) -> list[str]:
        """Names of the frames as PNG; InputError where two are alike but for their endings."""
        stems = dict.fromkeys(path.stem for path in self.paths)
        if len(stems) < len(self.paths):
            raise InputError(f"{self._source}: frames must have different names, endings aside")
        return [f"{stem}.png" for stem in stems]

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of each, pixels."""
        return self.first.size

    def __iter__(self) -> Iterator[AnyPicture]:
        """Yield each picture; InputError for one that is not as large as the first."""
        yield self.first
        for path in self.paths[1:]:
            opened = read_any(path, self._reading, self._command)
            if opened.size != self.size:
                (height, width), (high, wide) = self.size, opened.size
                raise InputError(
                    f"{path}: must be as large as the first frame, {width} x {height} px"
                    f" (is {wide} x {high})"
                )
            yield opened


def save_pictures(
    out: Path,
    frames: list[str] | None,
    shown: Iterable[tuple[NDArray[np.float32], int | None]],
    reporter: Reporter,
) -> list[Path]:
    """Write pictures as they come, and return the files.

    Parameters
    ----------
    out : Path
        A folder, which gets all of the frames or none; the picture where there are no frames.
    frames : list of str, optional
        Names of the frames.
    shown : iterable of (ndarray, bits)
        As `save_colour` takes them.
    """
    if not frames:
        out.parent.mkdir(parents=True, exist_ok=True)
    names = frames or [out.name]
    with whole_folder(out) if frames else nullcontext(out.parent) as folder:
        for done, (name, (colour, bits)) in enumerate(zip(names, shown, strict=True), 1):
            save_colour(folder / name, colour, bits=bits)
            if frames:
                reporter.progress("frames", done, len(frames))
    return [(out if frames else out.parent) / name for name in names]
