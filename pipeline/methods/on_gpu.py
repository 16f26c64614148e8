"""Base of all fills of ours: a pass that completes textures in place."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.methods.method import InNumpy, check_finite, composite
from pipeline.plate.gpu import PlatePass, PlateTextures


class FillPass(Protocol):
    """Interface of a pass of ours."""

    def release(self) -> None: ...


P = TypeVar("P", bound=FillPass)


class OnGpu(ABC, Generic[P]):
    """A method whose frame lies on the GPU; its pass is kept for the last frame size.

    Without a context it only knows its numpy twin.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._size: tuple[int, int] | None = None
        self._pass: P | None = None
        self._textures: FrameTextures | None = None  # of frames that come as arrays
        self._plate_pass: PlatePass | None = None

    @abstractmethod
    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Fill the holes of arrays; known pixels are untouched."""
        check_some_known(warped.hole)
        size = warped.size[1], warped.size[0]
        if self._textures is None or self._textures.size != size:
            self._release_textures()
            self._textures = FrameTextures.create(self._ctx, size)
        self._textures.upload(warped)
        self.fill_textures(self._textures, seed)
        return composite(warped, read_back(self._textures.colour)[..., :3])

    def fill_textures(self, frame: FrameTextures, seed: int) -> None:
        """Fill the holes of `frame.colour` in place; alpha still tells where they were."""
        self._run(self._fit(frame.size), frame, seed)

    def release(self) -> None:
        """Free textures and shaders; plates are their users'."""
        self._release_pass()
        self._release_textures()

    def _release_pass(self) -> None:
        for held in (self._pass, self._plate_pass):
            if held is not None:
                held.release()
        self._pass, self._plate_pass, self._size = None, None, None

    def _release_textures(self) -> None:
        if self._textures is not None:
            self._textures.release()
        self._textures = None

    def _new_plate(self) -> PlateTextures:
        """Return an empty plate, for methods that have one."""
        return PlateTextures(self._ctx, self._fill_from_plate)

    def _fill_from_plate(self, frame: FrameTextures, plate: PlateTextures, seed: int) -> None:
        self._fit(frame.size)
        if self._plate_pass is None:
            self._plate_pass = self._build_plate(frame.size)
        self._plate_pass(frame, plate, lambda known: self.fill_textures(known, seed))

    def _fit(self, size: tuple[int, int]) -> P:
        """The pass for frames of a size, built anew where the last one was of another."""
        if self._pass is None or self._size != size:
            self._release_pass()
            self._pass, self._size = self._build(size), size
        return self._pass

    @abstractmethod
    def _build(self, size: tuple[int, int]) -> P: ...

    def _build_plate(self, size: tuple[int, int]) -> PlatePass:
        raise NotImplementedError(f"{type(self).__name__} keeps no plate of {size}")

    @abstractmethod
    def _run(self, filler: P, frame: FrameTextures, seed: int) -> None: ...


class DepthGuidedMethod(OnGpu[P]):
    """A method that depth guides; its parameters: fields of `settings_class`, and `z_near_m`."""

    settings_class: ClassVar[type[Any]]

    def __init__(self, ctx: moderngl.Context, *, z_near_m: float = 0.0, **settings: Any) -> None:
        super().__init__(ctx)
        self._settings = self.settings_class(**settings)
        if not (np.isfinite(z_near_m) and z_near_m >= 0):
            raise InputError(
                "z_near_m must be a depth in metres, or 0 for each frame's own nearest"
                f" (got {z_near_m})"
            )
        self._z_near_m = z_near_m

    def _nearest_m(self, frame: FrameTextures | WarpedFrame) -> float:
        if self._z_near_m:
            return self._z_near_m
        if isinstance(frame, WarpedFrame):
            return nearest_depth_m(frame.depth_m)
        return nearest_depth_m(read_back(frame.depth_m))


def filled_colour(frame: FrameTextures) -> NDArray[np.float32]:
    """Read a frame's colour back after a fill: (H, W, 3) in [0, 1].

    Raises
    ------
    InputError
        If every pixel was a hole, or the fill is not finite.
    """
    texels = read_back(frame.colour)
    hole = texels[..., 3] == 0
    check_some_known(hole)
    colour = np.ascontiguousarray(texels[..., :3])
    check_finite(colour[hole])
    return colour.clip(0.0, 1.0)
