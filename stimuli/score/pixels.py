"""PSNR, SSIM and fine detail from `pipeline.quality`, and flicker inside holes."""

from __future__ import annotations

import numpy as np

from pipeline.errors import InputError
from pipeline.quality import SSIM_LEAST_PX, high_frequency_ratio, psnr_db, ssim
from stimuli.score.measured import PairScores, mean_of
from stimuli.score.metrics import HOLES
from stimuli.score.pair import Image, Mask, ScoredPair
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:  # noqa: ARG001
    """Measure every frame; the clip's PSNR is that of the mean squared error of all frames."""
    per_frame: dict[tuple[str, str], list[float | None]] = {}
    changes: list[float | None] = []
    last: tuple[Image, Image, Mask] | None = None
    squares = np.zeros((pair.height_px, pair.width_px))
    for _, test, truth, hole in pair.walk():
        for region in pair.regions:
            mask = hole if region == HOLES else np.ones_like(hole)
            for name, found in _of_frame(test, truth, mask).items():
                per_frame.setdefault((name, region), []).append(found)
        if last is not None and pair.masks:
            changes.append(_excess_change(last, (test, truth, hole)))
        squares += ((test - truth) ** 2).mean(axis=2) * hole
        last = test, truth, hole
    values: dict[tuple[str, str], float | None] = {
        key: mean_of(numbers) for key, numbers in per_frame.items()
    }
    for region in pair.regions:
        values["psnr", region] = _whole_psnr(per_frame["psnr", region])
    if pair.masks:
        values["flicker", HOLES] = mean_of(changes)
        per_frame["flicker", HOLES] = changes
    return PairScores(values, per_frame, np.sqrt(squares / pair.frames).astype(np.float32))


def _of_frame(test: Image, truth: Image, mask: Mask) -> dict[str, float | None]:
    if not mask.any():
        return {"psnr": None, "ssim": None, "hf-ratio": None}
    small = min(mask.shape) < SSIM_LEAST_PX
    ratio: float | None
    try:
        ratio = high_frequency_ratio(test, truth, mask)
    except InputError:  # the reference is flat there
        ratio = 1.0 if np.array_equal(test[mask], truth[mask]) else None
    return {
        "psnr": psnr_db(test, truth, mask),
        "ssim": None if small else ssim(test, truth, mask),
        "hf-ratio": ratio,
    }


def _whole_psnr(per_frame: list[float | None]) -> float | None:
    found = [value for value in per_frame if value is not None]
    if not found:
        return None
    mean_square = float(np.mean([10.0 ** (-value / 10) for value in found]))
    return float("inf") if mean_square == 0 else -10.0 * float(np.log10(mean_square))


def _excess_change(
    before: tuple[Image, Image, Mask], now: tuple[Image, Image, Mask]
) -> float | None:
    """Mean difference of the clip's change from the reference's, in steps of 1/255."""
    both = before[2] & now[2]
    if not both.any():
        return None
    ours, theirs = (now[k][both] - before[k][both] for k in (0, 1))
    return 255.0 * float(np.abs(ours - theirs).mean())
