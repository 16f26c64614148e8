"""What a driver must hold for a fill with metamers."""

import moderngl

from pipeline.errors import InputError
from pipeline.synthesis.variances import BANDS


def check_limits(ctx: moderngl.Context, size: tuple[int, int], levels: int) -> None:
    """Require a driver for frames of `size`, (width, height), and so many pyramid levels.

    Variances of 2x2 pixels lie `BANDS` side by side in one image, gains of 4x4 pixels `levels`
    side by side in another.

    Raises
    ------
    InputError
        If the frame is too wide, or uniform blocks do not hold the bands' overlap: six levels
        need 18 KB, of which OpenGL promises 16.
    """
    edge = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    widest = min(edge // BANDS * 2, edge // levels * 4)
    if size[0] > widest:
        raise InputError(
            f"frames to fill with metamers must be at most {widest} px wide on this driver"
            f" (got {size[0]}x{size[1]})"
        )
    limit, needed = int(ctx.info["GL_MAX_UNIFORM_BLOCK_SIZE"]), overlap_bytes(levels)
    if needed > limit:
        raise InputError(
            f"{levels} levels need uniform blocks of {needed} bytes, and this driver's hold"
            f" {limit}; take fewer levels"
        )


def overlap_bytes(levels: int) -> int:
    """Of `gains.overlap_by_levels`: three columns of four floats for every band of a pair."""
    pairs = levels * (levels + 1) // 2
    return levels * pairs * BANDS * 3 * 4 * 4
