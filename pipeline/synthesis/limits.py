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
        If the frame is too wide.
    """
    edge = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    widest = min(edge // BANDS * 2, edge // levels * 4)
    if size[0] > widest:
        raise InputError(
            f"frames to fill with metamers must be at most {widest} px wide on this driver"
            f" (got {size[0]}x{size[1]})"
        )
