"""Push-pull on the GPU, plain and weighted. Twin: reference.py."""

from itertools import pairwise
from typing import ClassVar

import moderngl

from pipeline.gl.passes import Pass
from pipeline.gl.texture import check_size, check_texture

TILE = 8  # work-group edge, pixels


class PyramidPass(Pass):
    """Fill the unknown pixels of one rgba32f texture of a fixed size, level by level.

    The shader `pull` halves `fine` into `coarse`, `push` completes `fine` from `coarse` into
    `filled`; a subclass says whether pixels count with the square of their weight.

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

    squared: ClassVar[bool]

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        super().__init__(ctx)
        check_size(ctx, size)
        constants = {"TILE": TILE, "SQUARED": self.squared}
        self._down = self._shader("pushpull/pull.comp.glsl", **constants)
        self._up = self._shader("pushpull/push.comp.glsl", **constants)
        self.size = size
        # A single pixel still gets a level below it, so that it takes the path of the others.
        sizes = coarser_sizes(size) or [(1, 1)]
        self._coarser = [self._texture(level, "rgba32f") for level in sizes]

    def __call__(self, image: moderngl.Texture, filled: moderngl.Texture) -> None:
        """Fill `image` (rgb, weight; rgba32f) into `filled` (the same texture will do).

        Weights and colours must be finite, weights at least 0, also where nothing is known.
        Weights stay as they are.
        Where no pixel at all is known the result is zero.

        Raises
        ------
        InputError
            If a texture's size or format is not the pass's.
        """
        self._play(self._fill, image, filled)

    def _fill(self, image: moderngl.Texture, filled: moderngl.Texture) -> None:
        check_texture(image, "image", self.size, "rgba32f")
        check_texture(filled, "filled", self.size, "rgba32f")
        levels = [image, *self._coarser]
        for fine, coarse in pairwise(levels):
            self._down.run_over(coarse.size, fine=fine, coarse=coarse)
        for index, (fine, coarse) in reversed(list(enumerate(pairwise(levels)))):
            result = fine if index else filled
            self._up["keeps_weight"] = index == 0
            self._up.run_over(result.size, fine=fine, coarse=coarse, filled=result)


class PushPullPass(PyramidPass):
    """Classic push-pull; weights are confidences in [0, 1]. Twin: reference.py."""

    squared = False


def coarser_sizes(size: tuple[int, int]) -> list[tuple[int, int]]:
    """Halve `size`, rounding up, down to 1x1; `size` itself is not in the list."""
    sizes: list[tuple[int, int]] = []
    while size != (1, 1):
        size = ((size[0] + 1) // 2, (size[1] + 1) // 2)
        sizes.append(size)
    return sizes


class WeightedPullPushPass(PyramidPass):
    """Pull-push with squared weights, as the note on hole filling has it."""

    squared = True
