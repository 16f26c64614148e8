"""Push-pull on the GPU. Twin: reference.py."""

import moderngl

from pipeline.errors import InputError
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import create_texture

TILE = 8  # work-group edge, pixels


class PushPullPass:
    """Fill the unknown pixels of one rgba32f texture of a fixed size.

    Compiles and allocates once, on construction. A call binds and dispatches: twice
    log2 of the longer edge, rounded up.

    Parameters
    ----------
    size : (width, height)
        Any size from 1x1.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self._ctx = ctx
        self._pull = compile_compute(ctx, "pushpull/pull.comp.glsl", TILE=TILE)
        self._push = compile_compute(ctx, "pushpull/push.comp.glsl", TILE=TILE)
        self.size = size
        self._coarser = [create_texture(ctx, level, "rgba32f") for level in coarser_sizes(size)]

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return max(1, 2 * len(self._coarser))

    def __call__(self, image: moderngl.Texture, filled: moderngl.Texture) -> None:
        """Fill `image` (rgb, confidence; rgba32f) into `filled` (the same texture will do).

        Where no pixel at all is known the result is zero, confidence included.
        """
        for name, texture in (("image", image), ("filled", filled)):
            if texture.size != self.size:
                raise InputError(
                    f"{name} must be {self.size[0]}x{self.size[1]} as this pass was built"
                    f" (got {texture.width}x{texture.height})"
                )
        levels = [image, *self._coarser] if self._coarser else [image, image]
        for fine, coarse in zip(levels, self._coarser, strict=False):
            fine.use(0)
            self._dispatch(self._pull, coarse)
        for index in reversed(range(len(levels) - 1)):
            levels[index].use(0)
            levels[index + 1].use(1)
            self._dispatch(self._push, levels[index] if index else filled)

    def _dispatch(self, shader: moderngl.ComputeShader, target: moderngl.Texture) -> None:
        target.bind_to_image(0, read=False, write=True)
        shader.run(-(-target.width // TILE), -(-target.height // TILE))
        self._ctx.memory_barrier()

    def release(self) -> None:
        """Free textures and shaders."""
        for texture in self._coarser:
            texture.release()
        self._pull.release()
        self._push.release()


def coarser_sizes(size: tuple[int, int]) -> list[tuple[int, int]]:
    """Halve `size`, rounding up, down to 1x1; `size` itself is not in the list."""
    sizes: list[tuple[int, int]] = []
    while size != (1, 1):
        size = ((size[0] + 1) // 2, (size[1] + 1) // 2)
        sizes.append(size)
    return sizes
