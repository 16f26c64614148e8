"""`frames:FOLDER`: fills made elsewhere, one image per frame of the clip."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.image_file import from_integers, read_pixels, three_channels
from pipeline.methods.method import composite


class FramesOnDisk:
    """Take the holes' content from ``FOLDER/000000.png``, ``000001.png``, ...

    Only the holes are taken: all else stays the warp's own, so that methods differ in their
    fill alone.

    Parameters
    ----------
    path : Path
        A folder of images of integers whose names are numbers from 0 without a gap.

    Raises
    ------
    NotADirectoryError, FileNotFoundError
        If there is no such folder.
    InputError
        If it holds no frame, or a number is missing or there twice.
    """

    def __init__(self, path: Path) -> None:
        numbered: dict[int, Path] = {}
        for file in sorted(path.iterdir()):
            if not (file.is_file() and file.stem.isdecimal()):
                continue
            number = int(file.stem)
            if number in numbered:
                raise InputError(
                    f"{path}: must hold each frame once"
                    f" (frame {number} is in {numbered[number].name} and in {file.name})"
                )
            numbered[number] = file
        if not numbered:
            raise InputError(
                f"{path}: must hold frames named 000000.png, 000001.png, ... (has none)"
            )
        missing = sorted(set(range(max(numbered) + 1)) - numbered.keys())
        if missing:
            raise InputError(
                f"{path}: must hold every frame from 0 to {max(numbered)}"
                f" ({len(missing)} missing, the first is {missing[0]:06d})"
            )
        self.path = path
        self._files = [numbered[number] for number in range(len(numbered))]

    def __len__(self) -> int:
        return len(self._files)

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes from the image of the frame's own index."""
        if warped.frame_index >= len(self):
            raise InputError(
                f"{self.path}: must hold frame {warped.frame_index:06d} (has {len(self)} frames)"
            )
        file = self._files[warped.frame_index]
        pixels = read_pixels(file)
        if pixels.data.dtype.kind != "u":
            raise InputError(f"{file}: must hold integers, such as a PNG of 8 or 16 bits")
        colour = from_integers(three_channels(file, pixels))
        if colour.shape != warped.colour.shape:
            raise InputError(
                f"{file}: must be {warped.size[1]} x {warped.size[0]} px as the warped frame"
                f" (is {colour.shape[1]} x {colour.shape[0]})"
            )
        return composite(warped, colour)

    def release(self) -> None:
        """Hold nothing."""
