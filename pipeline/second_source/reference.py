"""Two warped pictures of one view made one. Twin: gpu.py.

A hole of the first picture is covered by nothing that it saw. So where the second picture has
something there, that is the nearest surface that any of the two saw.
"""

from dataclasses import replace

import numpy as np

from pipeline.frame import WarpedFrame, check_same_size


def completed(first: WarpedFrame, second: WarpedFrame) -> WarpedFrame:
    """Take from `second` what is a hole in `first`: colour, depth and motion.

    Parameters
    ----------
    first, second : WarpedFrame
        The same view of the same moment, warped from two pictures.

    Returns
    -------
    WarpedFrame
        Holes are where both have holes, with the first picture's background behind them.

    Raises
    ------
    InputError
        If their sizes differ.
    """
    check_same_size(first=first.depth_m, second=second.depth_m)
    take = first.hole & ~second.hole
    return replace(
        first,
        colour=np.where(take[..., None], second.colour, first.colour),
        depth_m=np.where(take, second.depth_m, first.depth_m),
        flow_px=np.where(take[..., None], second.flow_px, first.flow_px),
        hole=first.hole & second.hole,
    )
