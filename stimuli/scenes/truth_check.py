"""Check that a warp shows what a given true view shows, whatever its motion comes from.

A pixel of the picture, moved by its flow, must be seen again in the true view. Differences alone do
not say so: they grow with contrast, light and noise. So two readings of the same files are compared
by votes. Each pixel whose two errors differ by more than can be seen votes for the smaller one.
Of two readings that are both wrong each gets half of the votes, whatever the picture.

`WON` of the votes, two to one, is asked of a reading against another, and of the given one against
colours from anywhere in the true view: there true pairs have 0.72 to 1, other pictures at most
0.64. A shift by s px gets the votes of pixels that are off by more than s / 2 its way. So where the
worst of eight directions is below `_UNMOVED`, the warp is off by more than that. Pictures that
have nothing in common reach 0.51 there, true pairs 0.77 or more for 2 px.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.frame import Floats, TargetWindow
from pipeline.pictures.warp_input import WarpInput, motion_between

WON: Final = 2 / 3
_UNMOVED = 0.55
_VISIBLE = 4 / 255  # of encoded colour
_GAIN = (0.5, 2)  # of one camera's light: what lands on one spot is not explained by less
_SHIFTS_PX = (2, 4, 8, 16, 32, 64, 128)
_FEWEST = 200  # pixels that a vote rests on
_MOST = 20_000  # pixels that are asked: rows and columns are left out of larger pictures
STILL: Final = "the true view shows the picture unmoved: is it the view that is meant?"
_SHARES = "the flow is in shares of the picture: multiply it by width and height in pixels"
_FACTORS = (2, 4, 8, 16, 20, 32, 64)  # between sizes of networks' flows, and of 16-bit files
_UNITS = (1, 10, 100, 1000, 0.1, 0.01, 0.001, 0.2, 5)  # the last two: 5000 a metre (TUM)
_USELESS_PX = 4  # beside the truth, and half of what it moves: a warp is no better than none
_TRIED = 3  # readings that are looked at closely


@dataclass(frozen=True, eq=False)
class Reading:
    """Another reading of the same files: a fault with its cure, and the motion if it is one.

    Parameters
    ----------
    cause : str
    flow_px : ndarray, shape (h, w, 2)
        At each pixel that is asked; NaN where it is not seen.
    exchanged : bool
        The flow is that of the true view's pixels, into the picture.
    """

    cause: str
    flow_px: Floats
    exchanged: bool = False


Readings = Callable[[int, Floats], Iterable[Reading]]
"""Other readings, given which pixels are asked (every n-th row and column), and their flow."""


def no_readings(_step: int, _flow_px: Floats) -> Iterable[Reading]:
    """Return none: nothing else may have been meant."""
    return ()


@dataclass(frozen=True)
class TruthVerdict:
    """Result of a comparison of a warp with the true view, outside the holes.

    Parameters
    ----------
    difference : float, optional
        Median, of 255, in one light; None where too few pixels have texture, or none is seen.
    related : bool
        The pictures have more in common than any two places of them, and the warp is nearer to the
        true view than `_USELESS_PX`, or than half of what it moves.
    off_px : float
        The warp lies farther than this beside the true view; 0: within a pixel.
    cause : str, optional
        What is wrong, with its cure, where another reading of the same files fits.
    fitting : float, optional
        The difference with that reading.
    wide : str, optional
        A disparity leads farther than the picture is wide.
    """

    difference: float | None
    related: bool = True
    off_px: float = 0.0
    cause: str | None = None
    fitting: float = 0.0
    wide: str | None = None

    @property
    def refused(self) -> bool:
        """True if the files cannot belong together as they are given."""
        return self.wide is not None or self.cause is not None or not self.related

    @property
    def doubtful(self) -> bool:
        """True if a person should look at it."""
        return self.refused or self.difference is None or self.off_px > 0

    def __str__(self) -> str:
        """Return the rule, and the value that was found."""
        if self.wide is not None:
            return f"{self.wide}; {self.cause or 'is units_per_px (--units-per-px) right?'}"
        rule = "outside the holes the warp must show what the true view shows"
        if self.cause is not None and self.difference is None:
            return f"{rule} (nothing of it lies there): {self.cause}"
        if self.difference is None:
            return "warp and true view could not be compared (too few pixels have texture)"
        found = f"median difference {self.difference:.2g} of 255"
        if self.cause is not None:
            return f"{rule} ({found}, else {self.fitting:.2g}): {self.cause}"
        if not self.related:
            return (
                f"{rule} ({found}); the files may be of different pictures, or the motion is of"
                " others: pose, intrinsics, flow, or no disparity (depth?)"
            )
        beside = f"more than {self.off_px:g} px beside" if self.off_px else "within a pixel of"
        return f"outside the holes the warp lies {beside} the true view ({found})"


def judge_truth(
    frame: WarpInput,
    truth: NDArray[np.float32],
    readings: Readings,
    known: NDArray[np.bool_] | None = None,
) -> TruthVerdict:
    """Compare a warp with the true view, and with what else may have been meant.

    Parameters
    ----------
    truth : ndarray of float32, shape (H, W, 3)
    known : ndarray of bool, shape (H, W), optional
        Pixels that are asked; left out: all.
    """
    picture = frame.source.colour
    varied = np.abs(picture - np.median(picture, axis=(0, 1))).max(axis=-1) > _VISIBLE
    if varied.sum() < _FEWEST:
        return TruthVerdict(None)
    step = max(1, math.ceil(math.sqrt(picture[..., 0].size / _MOST)))
    window = frame.window or TargetWindow.of(frame.source.size)
    flow = frame.flow_px[::step, ::step].astype(np.float64) - (window.x_px, window.y_px)
    for seen in (known, None if frame.target_depth_m is None else frame.target_depth_m > 0):
        if seen is not None:
            flow = np.where(seen[::step, ::step, None], flow, np.nan)
    given = _Look(picture, truth, step, Reading("", flow))
    found = []
    for reading in readings(step, flow):
        other = _Look(picture, truth, step, reading)
        error, way = given.error, flow
        if reading.exchanged:  # the same things lie elsewhere
            error, way = error[other.landed], -flow[other.landed]
        error = np.where(np.isnan(error), other.stray, error)
        # Where two motions are alike, nobody can tell them apart.
        apart = ~(np.linalg.norm(reading.flow_px - way, axis=-1) < 1)
        if (votes := _votes(other.error, error, apart)) >= WON:
            found.append((votes, apart, other))
    for _, apart, other in sorted(found, key=lambda one: -one[0])[:_TRIED]:
        asked = apart
        if other.reading.exchanged:
            asked = np.zeros(apart.shape, np.bool_)
            asked[tuple(index[apart] for index in other.landed)] = True
        if other.related(apart) >= WON and other.off_px(apart) < given.off_px(asked):
            fitting = other.difference(apart) or 0.0
            return TruthVerdict(given.difference(asked), cause=other.reading.cause, fitting=fitting)
    everywhere = np.ones(flow.shape[:2], np.bool_)
    difference, related = given.difference(everywhere), given.related(everywhere)
    if np.isnan(related):
        return TruthVerdict(None)
    off_px = min(given.off_px(everywhere), _SHIFTS_PX[-1] / 2)
    moved_px = float(np.nanmedian(np.linalg.norm(flow, axis=-1)))
    near = off_px < max(_USELESS_PX, moved_px / 2)
    return TruthVerdict(difference, related >= WON and near, off_px)


class _Look:
    """View of the truth where a reading moves the pixels that are asked."""

    def __init__(
        self, picture: NDArray[np.float32], truth: NDArray[np.float32], step: int, reading: Reading
    ) -> None:
        self.reading = reading
        moved, self._truth = (truth, picture) if reading.exchanged else (picture, truth)
        asked = moved[::step, ::step].astype(np.float64)
        across, down = np.meshgrid(*(np.arange(0, edge, step) for edge in moved.shape[1::-1]))
        self._place = np.stack([down, across]) + np.moveaxis(reading.flow_px[..., ::-1], -1, 0)
        # The other picture's asked pixels, nearest to where these land.
        near = np.rint(np.nan_to_num(self._place) / step).astype(np.intp)
        self.landed = tuple(near.clip(0, np.reshape(asked.shape[:2], (2, 1, 1)) - 1))
        shown = self._shown(0, 0)
        seen = np.flatnonzero(~np.isnan(shown[..., 0]))
        self._expected = asked
        if len(seen):  # two cameras may expose differently
            there, here = shown.reshape(-1, 3)[seen], asked.reshape(-1, 3)[seen]
            gain = (there.std(axis=0) / np.maximum(here.std(axis=0), 1e-6)).clip(*_GAIN)
            self._expected = there.mean(axis=0) + gain * (asked - here.mean(axis=0))
        self.error = self._differs(shown)
        if len(seen):
            stray = np.random.default_rng(0).choice(seen, asked.shape[:2])
            shown = shown.reshape(-1, 3)[stray]
        self.stray = self._differs(shown)

    def difference(self, asked: NDArray[np.bool_]) -> float | None:
        """Median difference, of 255; None where nothing is seen."""
        seen = self.error[asked & ~np.isnan(self.error)]
        return 255 * float(np.median(seen)) if len(seen) else None

    def related(self, asked: NDArray[np.bool_]) -> float:
        """Votes for this reading, against colours from anywhere in the true view."""
        return _votes(self.error, self.stray, asked)

    def off_px(self, asked: NDArray[np.bool_]) -> float:
        """Half of the longest shift that may be as right, up to the first that is not."""
        lost = 0.0
        for shift in _SHIFTS_PX:
            ways = [(y * shift, x * shift) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x]
            votes = [_votes(self.error, self._differs(self._shown(*way)), asked) for way in ways]
            if min(votes) >= _UNMOVED:
                return lost
            if not np.isnan(votes).any():
                lost = shift / 2
        return math.inf

    def _shown(self, down: float, across: float) -> Floats:
        """Colours of the true view where pixels land, shifted; NaN outside of it."""
        height, width = self._truth.shape[:2]
        y, x = self._place[0] + down, self._place[1] + across
        inside = (y >= 0) & (y <= height - 1) & (x >= 0) & (x <= width - 1)
        y, x = np.where(inside, (y, x), 0)
        top, left = y.astype(np.intp), x.astype(np.intp)
        low, right = np.minimum(top + 1, height - 1), np.minimum(left + 1, width - 1)
        y, x = (y - top)[..., None], (x - left)[..., None]
        above = (1 - x) * self._truth[top, left] + x * self._truth[top, right]
        below = (1 - x) * self._truth[low, left] + x * self._truth[low, right]
        return np.where(inside[..., None], (1 - y) * above + y * below, np.nan)

    def _differs(self, shown: Floats) -> Floats:
        return np.asarray(np.abs(shown - self._expected).mean(axis=-1))


def _votes(one: Floats, other: Floats, asked: NDArray[np.bool_]) -> float:
    """Share of votes for `one`, NaN where too few can tell."""
    told = asked & (np.abs(one - other) > _VISIBLE)
    return float((one < other)[told].mean()) if told.sum() >= _FEWEST else math.nan


def flow_readings(backward: str, scaled: str = "multiply it by {:g}") -> Readings:
    """Return other readings of a flow.

    Parameters
    ----------
    backward, scaled : str
        Cures where it leads the other way, and where a factor is missing.
    """

    def readings(step: int, flow_px: Floats) -> Iterator[Reading]:
        height, width = (step * edge for edge in flow_px.shape[:2])
        way = f"the flow leads the other way: {backward}"
        yield Reading(way, -flow_px)
        yield Reading(way, flow_px, exchanged=True)
        yield Reading(STILL, 0 * flow_px)
        yield Reading("the flow counts y upwards: change the sign of its y", flow_px * (1, -1))
        yield Reading("the flow counts x leftwards: change the sign of its x", flow_px * (-1, 1))
        yield Reading("the flow has y before x: exchange them", flow_px[..., ::-1])
        yield Reading(_SHARES, flow_px * (width, height))
        yield Reading(_SHARES, flow_px * (width / 2, height / 2))
        for factor in _FACTORS:
            for scale in (factor, 1 / factor):
                unit = "the flow is in another unit than pixels: " + scaled.format(scale)
                yield Reading(unit, flow_px * scale)

    return readings


def pose_readings(
    depth_m: NDArray[np.float32],
    intrinsics_px: tuple[float, float, float, float],
    poses: tuple[Floats, Floats],
    *,
    depth_scale: float = 1.0,
    depth_is: str = "distance",
) -> Readings:
    """Return other readings of depth and two poses; parameters as `from_depth` has them."""

    def readings(step: int, flow_px: Floats) -> Iterator[Reading]:
        small = np.ascontiguousarray(depth_m[::step, ::step])

        def moved(
            cause: str, depth: NDArray[np.float32], poses: tuple[Floats, ...], *lens: float
        ) -> Reading:
            fx, fy, cx, cy = (value / step for value in lens or intrinsics_px)
            with np.errstate(all="ignore"):
                flow, seen = motion_between(depth, (fx, fy, cx, cy), poses[0], poses[1])
            return Reading(cause, np.where(seen[..., None] > 0, flow * step, np.nan))

        yield Reading(STILL, 0 * flow_px)
        for said, turned in _turned(poses):
            for factor in _UNITS if not said or "inverse" in said else (1,):
                unit = "depth and poses have different units: --depth-scale {:g} fits"
                unit = unit.format(depth_scale * factor) if factor != 1 else ""
                if cause := "; ".join(filter(None, (said, unit))):
                    yield moved(cause, (small * np.float32(factor)), turned)
        fx, fy, cx, cy = intrinsics_px
        height, width = depth_m.shape
        inverse = (np.float32(depth_scale**2) / small).astype(np.float32)
        if (inverse > 0).all():
            is_a = "distance" if depth_is == "inverse" else "inverse"
            yield moved(f"depth has another meaning: --depth-is {is_a} fits", inverse, poses)
        lenses = [tuple(scale * value for value in intrinsics_px) for scale in (2, 4, 0.5, 0.25)]
        for lens in (*lenses, (fx, fy, cy, cx), (fx, fy, (width - 1) / 2, (height - 1) / 2)):
            said = ",".join(f"{value:g}" for value in lens)
            yield moved(f"the intrinsics are others: --camera {said} fits", small, poses, *lens)

    return readings


def _turned(poses: tuple[Floats, Floats]) -> Iterator[tuple[str, tuple[Floats, Floats]]]:
    """Yield both poses as they are, and as other programs write them."""
    back = np.diag([1.0, -1.0, -1.0, 1.0])
    inverse = np.linalg.inv(poses).astype(np.float64)
    graphics = "with y up and z back (OpenGL, NeRF, Blender): change the signs of y and z"
    yield "", poses
    yield (
        "the poses fit the other way round, camera from world, as COLMAP writes them: give the"
        " inverse of each", (inverse[0], inverse[1]),
    )  # fmt: skip
    yield "the poses fit exchanged (or are they camera from world, as COLMAP's?)", poses[::-1]
    yield f"the poses are {graphics}", (poses[0] @ back, poses[1] @ back)
    yield (
        f"the poses are camera from world, {graphics}, of the inverse of each",
        (inverse[0] @ back, inverse[1] @ back),
    )
    first = [np.eye(4), np.eye(4)]
    for pose, matrix in zip(poses, first, strict=True):
        matrix[:3, 3] = pose[:3, 3]
        turn = np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), -1)
        matrix[:3, :3] = Rotation.from_quat(turn).as_matrix()
    yield "the quaternions begin with qw: write qx qy qz qw", (first[0], first[1])


def sideways_readings(share: float) -> Readings:
    """Return other readings of a depth without poses, whose camera moves by a parallax."""

    def readings(step: int, flow_px: Floats) -> Iterator[Reading]:
        del step
        yield Reading(STILL, 0 * flow_px)
        for power in range(-12, 13):
            for factor in (1.2**power, -(1.2**power)):
                cause = f"the true view has another parallax: --parallax {share * factor:.3g} fits"
                if factor != 1:
                    yield Reading(cause, flow_px * factor)

    return readings
