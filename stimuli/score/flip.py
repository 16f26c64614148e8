"""FLIP (Andersson et al. 2020) of every frame, by NVIDIA's `flip-evaluator`."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from stimuli.score.measured import PairScores, mean_of
from stimuli.score.metrics import HOLES
from stimuli.score.pair import Image, ScoredPair, composed_region
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:  # noqa: ARG001
    """Average the map of every frame: inside the holes, or everywhere."""
    per_frame: dict[tuple[str, str], list[float | None]] = {
        ("flip", region): [] for region in pair.regions
    }
    summed = np.zeros((pair.height_px, pair.width_px))
    counted = np.zeros((pair.height_px, pair.width_px))
    for _, test, truth, hole in pair.walk():
        for region in pair.regions:
            if region == HOLES and not hole.any():
                per_frame["flip", region].append(None)
                continue
            errors = flip_map(composed_region(test, truth, hole, region), truth, viewing.px_per_deg)
            inside = hole if region == HOLES else np.ones_like(hole)
            per_frame["flip", region].append(float(errors[inside].mean()))
            if region == pair.regions[0]:
                summed[inside] += errors[inside]
                counted[inside] += 1
    return PairScores(
        {key: mean_of(found) for key, found in per_frame.items()},
        per_frame,
        (summed / np.maximum(counted, 1)).astype(np.float32),
    )


def flip_map(test: Image, truth: Image, px_per_deg: float) -> NDArray[np.float32]:
    """Return the error of every pixel in [0, 1], shape (H, W)."""
    import flip_evaluator

    errors, _, _ = flip_evaluator.evaluate(
        np.ascontiguousarray(truth),
        np.ascontiguousarray(test),
        "LDR",
        inputsRGB=True,
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": px_per_deg},
    )
    return cast(NDArray[np.float32], errors)[..., 0]
