"""Weighted pull-push on the GPU. Twin: reference.py."""

from itertools import pairwise

import moderngl

from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import check_size, check_texture, create_texture
from pipeline.pushpull.gpu import coarser_sizes

TILE = 8  # work-group edge, pixels


class WeightedPullPushPass:
    """Fill the unknown pixels of one rgba32f texture of a fixed size.

    Compiles and allocates once, on construction. A call binds and dispatches: twice
    log2 of the longer edge, rounded up.

    Parameters
    ----------
    size : (width, height)
        Any size from 1x1.

    Raises
    ------
    InputError
        If the driver has no textures of this size.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        check_size(ctx, size)
        self._ctx = ctx
        self._reduce = compile_compute(ctx, "weighted_pullpush/reduce.comp.glsl", TILE=TILE)
        self._expand = compile_compute(ctx, "weighted_pullpush/expand.comp.glsl", TILE=TILE)
        self.size = size
        # A single pixel still gets a level below it, so that it takes the path of the others.
        sizes = coarser_sizes(size) or [(1, 1)]
        self._coarser = [create_texture(ctx, level, "rgba32f") for level in sizes]

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return 2 * len(self._coarser)

    def __call__(self, image: moderngl.Texture, filled: moderngl.Texture) -> None:
        """Fill `image` (rgb, weight; rgba32f) into `filled` (the same texture will do).

        Weights and colours must be finite, weights at least 0. Where no pixel at all is
        known the result is zero.

        Raises
        ------
        InputError
            If a texture's size or format is not the pass's.
        """
        check_texture(image, "image", self.size, "rgba32f")
        check_texture(filled, "filled", self.size, "rgba32f")
        levels = [image, *self._coarser]
        for fine, coarse in pairwise(levels):
            fine.use(0)
            self._dispatch(self._reduce, coarse)
        for index in reversed(range(len(levels) - 1)):
            levels[index].use(0)
            levels[index + 1].use(1)
            self._dispatch(self._expand, levels[index] if index else filled)

    def _dispatch(self, shader: moderngl.ComputeShader, target: moderngl.Texture) -> None:
        target.bind_to_image(0, read=False, write=True)
        shader.run(-(-target.width // TILE), -(-target.height // TILE))
        self._ctx.memory_barrier()

    def release(self) -> None:
        """Free textures and shaders."""
        for texture in self._coarser:
            texture.release()
        self._reduce.release()
        self._expand.release()
