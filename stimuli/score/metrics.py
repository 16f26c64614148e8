"""Metrics by name: what each needs, and what its numbers mean.

To add a metric, write its family (a module with ``measure(pair, viewing, gaze)``) and add its
lines here. A package of another lab adds its own by an entry point, see `PluginMetrics`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from protocols.errors import StudyError, did_you_mean
from protocols.plugins import registered

HOLES, FRAME = "holes", "frame"
REGIONS = (HOLES, FRAME)
RING_DEG = 5
RINGS = tuple(f"{first} to {first + RING_DEG} deg" for first in range(0, 180, RING_DEG))
"""Rings around the gaze, of which a metric may have numbers beside that of the frame."""
"""`holes`: all other pixels are set to the reference ([MI] 4); `frame`: everything counts."""

Better: TypeAlias = Literal["higher", "lower", "one"]
"""`one`: the nearer to 1 the better."""


@dataclass(frozen=True)
class Family:
    """Metrics that are computed together, in processes of their own.

    Attributes
    ----------
    module : str
        With ``measure(pair, viewing, gaze) -> Measured``.
    packages : tuple of (import name, distribution)
        What it needs beside our own dependencies.
    uses_gaze, uses_display : bool
        Whether a place of gaze or a display change its numbers.
    version : int
        Part of cache keys: raised when our own code changes a number (a test pins them).
    """

    name: str
    module: str
    packages: tuple[tuple[str, str], ...] = ()
    uses_gaze: bool = False
    uses_display: bool = False
    version: int = 1


@dataclass(frozen=True)
class Metric:
    """One column of a table.

    Attributes
    ----------
    perfect : float
        The value for identical clips.
    least_px : int
        Smallest height and width of a frame.
    over_time : bool
        Whether it needs at least two frames.
    needs_gaze : bool
        Whether it measures only where a gaze is known.
    """

    name: str
    label: str
    unit: str
    better: Better
    perfect: float
    family: str
    least_px: int
    digits: int
    what: str
    licence: str
    regions: tuple[str, ...] = REGIONS
    over_time: bool = False
    needs_gaze: bool = False

    @property
    def blind(self) -> str:
        """Sentence on what it does not see."""
        return BLIND.get(self.name, "its package does not say")

    def badness(self, value: float) -> float:
        """Return a number that is lower for better values, whatever the metric's direction."""
        if self.better == "one":
            return abs(math.log(value)) if value > 0 else math.inf
        return -value if self.better == "higher" else value

    @property
    def arrow(self) -> str:
        """Say in words which way is better."""
        return {"higher": "higher is better", "lower": "lower is better", "one": "1 is right"}[
            self.better
        ]


_TORCH = ("torch", "torch")
FAMILIES = {
    family.name: family
    for family in (
        Family("pixels", "stimuli.score.pixels"),
        Family("statistics", "stimuli.score.statistics", uses_gaze=True),
        Family("band-ratios", "stimuli.score.band_ratios", uses_gaze=True, uses_display=True),
        Family("flicker-rings", "stimuli.score.flicker_rings", uses_gaze=True, uses_display=True),
        Family(
            "flip",
            "stimuli.score.flip",
            (("flip_evaluator", "flip-evaluator"),),
            uses_display=True,
        ),
        Family(
            "fovvideovdp",
            "stimuli.score.fovvideovdp",
            (_TORCH, ("pyfvvdp", "pyfvvdp")),
            uses_gaze=True,
            uses_display=True,
        ),
        Family(
            "colorvideovdp",
            "stimuli.score.colorvideovdp",
            (_TORCH, ("torchvision", "torchvision"), ("pycvvdp", "cvvdp")),
            uses_display=True,
        ),
        Family(
            "lpips",
            "stimuli.score.lpips_alex",
            (_TORCH, ("torchvision", "torchvision"), ("lpips", "lpips")),
        ),
    )
}

OURS = "part of metamerlab (MIT)"
NOT_COMMERCIAL = "pyfvvdp, CC BY-NC 4.0: not for commercial use"

METRICS = {
    metric.name: metric
    for metric in (
        Metric(
            "psnr", "PSNR", "dB", "higher", math.inf, "pixels", 1, 2,
            "peak signal-to-noise ratio of the mean squared error of all frames", OURS,
        ),
        Metric(
            "ssim", "SSIM", "", "higher", 1.0, "pixels", 11, 3,
            "structural similarity (Wang et al. 2004), mean of the frames",
            "scikit-image (BSD)",
        ),
        Metric(
            "hf-ratio", "high-frequency ratio", "", "one", 1.0, "pixels", 1, 2,
            "fine detail over that of the reference: below 1 is blur, above is noise", OURS,
        ),
        Metric(
            "flicker", "flicker", "/255", "lower", 0.0, "pixels", 1, 2,
            "mean absolute difference between the clip's and the reference's change from frame"
            " to frame, where both frames are holes", OURS, regions=(HOLES,), over_time=True,
        ),
        Metric(
            "flicker-rings", "flicker by eccentricity", "/255", "lower", 0.0, "flicker-rings", 1, 2,
            "the same difference over the frame, in rings of 5 degrees around the gaze; mean of the"
            " rings", OURS, regions=(FRAME,), over_time=True, needs_gaze=True,
        ),
        Metric(
            "statistics", "statistics distance", "", "lower", 0.0, "statistics", 32, 3,
            "distance of pooled moments of steerable bands, pools growing from the gaze", OURS,
        ),
        Metric(
            "band-ratio", "band ratio", "", "one", 1.0, "band-ratios", 32, 3,
            "deviation of luma's bands over the reference's beyond 1 degree from the gaze,"
            " geometric mean of levels and rings", OURS, regions=(FRAME,), needs_gaze=True,
        ),
        Metric(
            "flip", "FLIP", "", "lower", 0.0, "flip", 1, 3,
            "FLIP (Andersson et al. 2020) at the display's pixels per degree, mean of the frames",
            "flip-evaluator (BSD)",
        ),
        Metric(
            "fvvdp", "FovVideoVDP", "JOD", "higher", 10.0, "fovvideovdp", 4, 2,
            "FovVideoVDP (Mantiuk et al. 2021) with the package's current parameters",
            NOT_COMMERCIAL,
        ),
        Metric(
            "fvvdp-1.0", "FovVideoVDP 1.0", "JOD", "higher", 10.0, "fovvideovdp", 4, 2,
            "FovVideoVDP with the parameters of 1.0, current when [MI] was written; never foveated",
            NOT_COMMERCIAL,
        ),
        Metric(
            "cvvdp", "ColorVideoVDP", "JOD", "higher", 10.0, "colorvideovdp", 4, 2,
            "ColorVideoVDP (Mantiuk et al. 2024)", "cvvdp (MIT)",
        ),
        Metric(
            "lpips", "LPIPS", "", "lower", 0.0, "lpips", 31, 3,
            "LPIPS 0.1 (Zhang et al. 2018) on AlexNet, mean of the frames", "lpips (BSD)",
        ),
    )
}  # fmt: skip


BLIND = {
    "psnr": "Everything but differences of pixels: a metamer and plain noise of equal power are the"
    " same to it, and a blur is better than both.",
    "ssim": "Where the eye looks, and what it pools: structure is compared pixel by pixel.",
    "hf-ratio": "Where detail lies and what it looks like: only how much there is.",
    "flicker": "Single frames: it sees change over time alone.",
    "flicker-rings": "Single frames, and how well flicker of what speed is seen in a ring.",
    "statistics": "Where things lie within a pool, edges that turn into texture, and dependences"
    " between bands: a noise metamer and a true texture can be equal to it.",
    "band-ratio": "Structure, phase and colour: noise of the right spectrum scores 1. Too much in"
    " one ring and too little in another cancel in the mean, not in the plot.",
    "flip": "Where the eye looks: every pixel is seen as in the fovea.",
    "fvvdp": "Pooling: it knows acuity and masking by eccentricity, but compares pixels where pools"
    " would do. It prefers a blur to a metamer wherever pools are small. Colour.",
    "fvvdp-1.0": "As FovVideoVDP, and where the eye looks.",
    "cvvdp": "Where the eye looks: every pixel is seen as in the fovea, so any metamer is far.",
    "lpips": "Where the eye looks, and what a network trained on photographs was not shown.",
}
"""Sentences on what each metric does not see; scores pages print them beside the numbers."""


@dataclass(frozen=True)
class PluginMetrics:
    """Metrics of a package: entry points of the group ``metamerlab.metrics`` name such objects."""

    family: Family
    metrics: tuple[Metric, ...]
    blind: Mapping[str, str] = field(default_factory=dict)
    """Sentence on what each metric does not see, by name."""


def _add_plugins() -> None:
    added: dict[str, PluginMetrics] = registered(
        "metrics",
        {},
        "name a PluginMetrics of stimuli.score.metrics",
        lambda _name, value: (
            isinstance(value, PluginMetrics)
            and isinstance(value.family, Family)
            and all(isinstance(metric, Metric) for metric in value.metrics)
        ),
    )
    for name, plugin in added.items():
        taken = [plugin.family.name] if plugin.family.name in FAMILIES else []
        taken += [metric.name for metric in plugin.metrics if metric.name in METRICS]
        if taken:
            raise StudyError(
                f"plug-in {name!r} of metamerlab.metrics: names must be its own (got"
                f" {', '.join(taken)}, which {'is' if len(taken) == 1 else 'are'} taken)"
            )
        FAMILIES[plugin.family.name] = plugin.family
        METRICS.update({metric.name: metric for metric in plugin.metrics})
        BLIND.update(plugin.blind)


_add_plugins()


def choose_metrics(names: Iterable[str] | None) -> tuple[Metric, ...]:
    """Return the metrics called `names`, or all, in the order of the tables.

    Raises
    ------
    StudyError
        If a name is unknown, with the nearest one.
    """
    if names is None:
        return tuple(METRICS.values())
    wanted = list(names)
    for name in wanted:
        if name not in METRICS:
            raise StudyError(
                f"--metrics: must be of {', '.join(METRICS)} (got {name!r})"
                f"{did_you_mean(name, list(METRICS))}"
            )
    if not wanted:
        raise StudyError(f"--metrics: must name at least one of {', '.join(METRICS)}")
    return tuple(metric for metric in METRICS.values() if metric.name in wanted)
