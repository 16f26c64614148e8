"""What a driver must hold for a fill with metamers."""

import moderngl

from pipeline.errors import InputError
from pipeline.synthesis.variances import BANDS


def check_limits(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """Require a driver for frames of `size`, (width, height).

    Variances of 2x2 pixels lie `BANDS` side by side in one image.

    Raises
    ------
    InputError
        If the frame is too wide.
    """
    edge = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    widest = edge // BANDS * 2
    if size[0] > widest:
        raise InputError(
            f"frames to fill with metamers must be at most {widest} px wide on this driver"
            f" (got {size[0]}x{size[1]})"
        )
