"""A warped frame on the GPU: what the warp writes and the fills of ours complete in place."""

from dataclasses import dataclass
from typing import Self

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame
from pipeline.gl.texture import check_texture, create_texture, read_back, upload


@dataclass(frozen=True)
class FrameTextures:
    """A `WarpedFrame` as textures of one size.

    Attributes
    ----------
    colour : rgba32f
        Encoded R'G'B'; alpha 1 where known, all zero in holes.
    depth_m : r32f
        Depth; the background's in holes.
    flow_px : rg32f
        Target minus source position of what is shown; the background's in holes.
    """

    colour: moderngl.Texture
    depth_m: moderngl.Texture
    flow_px: moderngl.Texture

    @classmethod
    def create(cls, ctx: moderngl.Context, size: tuple[int, int]) -> Self:
        """Make uninitialised textures of `size` (width, height)."""
        return cls(
            create_texture(ctx, size, "rgba32f"),
            create_texture(ctx, size, "r32f"),
            create_texture(ctx, size, "rg32f"),
        )

    @classmethod
    def of(cls, ctx: moderngl.Context, frame: WarpedFrame) -> Self:
        """Make textures of a frame."""
        textures = cls.create(ctx, (frame.size[1], frame.size[0]))
        textures.upload(frame)
        return textures

    def check(self, size: tuple[int, int]) -> None:
        """Require one size (width, height) and the formats above.

        Raises
        ------
        InputError
            Naming the texture, what must hold and what was found.
        """
        check_texture(self.colour, "colour", size, "rgba32f")
        check_texture(self.depth_m, "depth_m", size, "r32f")
        check_texture(self.flow_px, "flow_px", size, "rg32f")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.colour.width, self.colour.height

    def upload(self, frame: WarpedFrame) -> None:
        """Copy a frame of this size from arrays."""
        known = (~frame.hole).astype(np.float32)[..., None]
        upload(self.colour, np.concatenate([frame.colour * known, known], axis=-1))
        upload(self.depth_m, frame.depth_m)
        upload(self.flow_px, frame.flow_px)

    def read_back(self) -> WarpedFrame:
        """Copy into arrays."""
        colour: NDArray[np.float32] = read_back(self.colour)
        return WarpedFrame(
            np.ascontiguousarray(colour[..., :3]),
            read_back(self.depth_m),
            colour[..., 3] == 0,
            read_back(self.flow_px),
        )

    def release(self) -> None:
        """Free the textures."""
        for texture in (self.colour, self.depth_m, self.flow_px):
            texture.release()
