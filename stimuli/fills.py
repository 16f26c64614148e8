"""The fills of one clip, any frame at any time."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.methods.method import CleanPlate, Method, PlateMethod, TexturePlate
from pipeline.methods.on_gpu import filled_colour


class Views(Protocol):
    """Views of `Footage` that a fill needs."""

    def warped(self, frame: int) -> WarpedFrame:
        """Warp the source to `frame`."""
        ...

    def warped_textures(self, frame: int) -> FrameTextures:
        """The same, on the GPU."""
        ...

    def source_key(self, frame: int) -> int:
        """Return the key of the source that `frame` is warped from."""
        ...


class Fills:
    """Fill frames of one clip by one method: frame k alone is frame k in a row.

    A method with a plate (`PlateMethod`) gets the frames of each source in their order, from the
    first one on. So a frame asked for alone costs the fills of those before it.
    """

    def __init__(self, method: Method, views: Views, seed: int) -> None:
        self._method = method
        self._views = views
        self._seed = seed
        self._plate: CleanPlate | TexturePlate | None = None
        self._source: int | None = None
        self._next = 0  # the first frame that the plate has not seen

    def frame(self, frame: int) -> NDArray[np.float32]:
        """Return the filled frame, (H, W, 3)."""
        if not isinstance(self._method, PlateMethod):
            return self._filled(frame, None)
        source = self._views.source_key(frame)
        if self._plate is None or source != self._source or frame < self._next:
            self.release()
            self._plate, self._source, self._next = _checked(self._method.new_plate()), source, 0
        result: NDArray[np.float32] | None = None
        for k in range(self._next, frame + 1):
            if self._views.source_key(k) == source:
                result = self._filled(k, self._plate)
        self._next = frame + 1
        assert result is not None  # the last k is the frame itself
        return result

    def release(self) -> None:
        """Free the plate, if it lies on the GPU."""
        if isinstance(self._plate, TexturePlate):
            self._plate.release()
        self._plate = None

    def _filled(self, frame: int, plate: CleanPlate | TexturePlate | None) -> NDArray[np.float32]:
        """Fill one frame, from a plate where there is one."""
        filler = self._method if plate is None else plate
        if isinstance(filler, TexturePlate):  # or a method on the GPU, which has what a plate has
            textures = self._views.warped_textures(frame)
            filler.fill_textures(textures, self._seed)
            return filled_colour(textures)
        return filler.fill(self._views.warped(frame), self._seed)


def _checked(plate: CleanPlate | TexturePlate) -> CleanPlate | TexturePlate:
    """Require a plate that fills; a plug-in's may not."""
    if not isinstance(plate, CleanPlate | TexturePlate):
        old = [name for name in ("settle", "settle_textures") if hasattr(plate, name)]
        has = f", which has {old[0]}" if old else ""
        cure = "; fill takes the frame with its holes, where settle took the finished fill"
        raise InputError(
            "a plate must have fill, or fill_textures and release (got"
            f" {type(plate).__name__}{has}); mend the method that makes it{cure if old else ''}"
        )
    return plate
