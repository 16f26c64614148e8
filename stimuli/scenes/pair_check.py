"""Check that the files of a stereo pair belong together: left, right, disparity in pixels.

A left pixel with disparity d must be seen again in the right photograph at x - d.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.errors import InputError
from pipeline.frame import Floats
from stimuli.scenes.stereo import StereoPair, too_wide
from stimuli.scenes.truth_check import Reading, TruthVerdict, judge_truth

_FACTORS = (2, 3, 4, 5, 8, 10, 16, 32, 64, 100, 128, 256)
_ROWS = (1, 2, 3, 4, 6, 8, 12, 16)


def judge_pair(pair: StereoPair, *, units_per_px: float = 1.0) -> TruthVerdict:
    """Compare the photographs of a pair by its disparity, and by what may have been meant.

    Parameters
    ----------
    pair : StereoPair
        With its right photograph.
    units_per_px : float
        As the file was read, for the cure.

    Raises
    ------
    InputError
        If the pair has no right photograph, or one of another size.
    """
    if pair.right is None:
        raise InputError("a pair must have its right photograph to be compared (it has none)")
    whose = (
        "the picture given as the right one is the left one"
        if pair.mirrored
        else "the picture given as left is the right one, with its own disparity"
    )

    def readings(step: int, flow_px: Floats) -> Iterator[Reading]:
        del step
        same = "left and right are the same picture: name the other photograph"
        yield Reading(same, 0 * flow_px)
        yield Reading("left and right are exchanged", flow_px, exchanged=True)
        yield Reading("the disparity is that of the other photograph", -flow_px, exchanged=True)
        yield Reading(f"pixels move the other way: {whose}", -flow_px)
        for factor in (*_FACTORS, *(1 / factor for factor in _FACTORS)):
            units = f"units_per_px = {units_per_px / factor:g} fits"
            yield Reading(f"the disparity is in other units: {units}", flow_px * factor)
        for lower in (*_ROWS, *(-row for row in _ROWS)):
            lies = f"{abs(lower)} px {'lower' if lower > 0 else 'higher'}"
            yield Reading(
                f"the pair is not rectified: the right photograph lies {lies}",
                flow_px + np.array([0, lower]),
            )

    verdict = judge_truth(pair.warp_input(), pair.right, readings, pair.known)
    return replace(verdict, wide=too_wide(pair.disparity_px))
