"""What all fills that depth guides have in common: a pass, its textures, arrays in and out."""

from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.gl.texture import create_texture, read_back, upload
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.methods.method import composite

_FORMATS = ("rgba32f", "r32f", "rg32f")  # colour with validity, depth, motion


class FillPass(Protocol):
    """What a pass of ours has."""

    def release(self) -> None: ...


P = TypeVar("P", bound=FillPass)


class Guided(ABC, Generic[P]):
    """A pass over colour, depth and motion, kept for the last frame size."""

    def __init__(self, ctx: moderngl.Context, z_near_m: float) -> None:
        if not (np.isfinite(z_near_m) and z_near_m >= 0):
            raise InputError(
                "z_near_m must be a depth in metres, or 0 for each frame's own nearest"
                f" (got {z_near_m})"
            )
        self._ctx = ctx
        self._z_near_m = z_near_m
        self._size: tuple[int, int] | None = None
        self._pass: P | None = None
        self._textures: list[moderngl.Texture] = []

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Fill the holes; known pixels are untouched."""
        check_some_known(warped.hole)
        known = (~warped.hole).astype(np.float32)[..., None]
        filler = self._prepared((warped.size[1], warped.size[0]))
        arrays = (
            np.concatenate([warped.colour * known, known], axis=-1),
            warped.depth_m,
            warped.flow_px,
        )
        for texture, array in zip(self._textures, arrays, strict=True):
            upload(texture, array)
        self._run(filler, self._z_near_m or nearest_depth_m(warped.depth_m), seed)
        return composite(warped, read_back(self._textures[0])[..., :3])

    def release(self) -> None:
        """Free textures and shaders."""
        if self._pass is not None:
            self._pass.release()
        for texture in self._textures:
            texture.release()
        self._pass, self._textures, self._size = None, [], None

    def _prepared(self, size: tuple[int, int]) -> P:
        if self._pass is None or self._size != size:
            self.release()
            self._pass = self._build(size)
            self._textures = [create_texture(self._ctx, size, name) for name in _FORMATS]
            self._size = size
        return self._pass

    @abstractmethod
    def _build(self, size: tuple[int, int]) -> P: ...

    @abstractmethod
    def _run(self, filler: P, z_near_m: float, seed: int) -> None: ...
