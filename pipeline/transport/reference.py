"""Coherence transport guided by depth, in numpy.

Bornemann and März 2007, "Fast image inpainting based on coherence transport", visit hole pixels
from the border inwards. Each becomes an average of the pixels known so far around it, which reaches
far along the structure that runs into the hole, and not across it. So an edge that ends at a hole
goes on in it. Here the hole pixels of one *shell* are filled at once and do not see each other
(Hocking, MacKenzie and Schönlieb 2016 do this for new views, on a GPU), and depth decides what
belongs together:

1. Shells. The first is what lies beside known background of the hole pixel's own surface; each
   further one what lies beside the shell before.
2. Structure. Tensors of the known colour's gradients are averaged beside the hole, and carried
   inwards with the colour.
3. Transport. The weighted mean of each pixel of a shell. The fill is `TransportSettings.share` of
   it, and for the rest what push-pull finds at the same depth.
4. Near. A hole pixel that no shell reaches sees no background of its own, as in a gap between
   leaves. Another leaf may be uncovered there: some of what is near, at any depth, is mixed in.
5. Detail. What the fill lacks of its surroundings' texture is added as noise, as `metameric` does
   (synthesis/). Where the surroundings have one direction they do not count: transport continues
   what makes that, and noise would repeat edges as marble.

With a gaze, all this happens near it alone (`TransportSettings.fovea_deg`). Hole pixels far from it
keep what push-pull finds, and are not seen.

Settings and what is fixed serve both twins.

Twin: gpu.py with the shaders here. Change both or neither.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat, share_around
from pipeline.frame import Bools, Floats, WarpedFrame
from pipeline.inpaint.reference import guide_from_depth, guided_base
from pipeline.synthesis.reference import with_detail
from pipeline.synthesis.settings import MetamericSettings

RADIUS_PX = 4  # seen pixels this near to a hole pixel are averaged
TENSOR_PX = 3.0  # deviation of the Gaussian that averages gradients
TENSOR_REACH_PX = 6  # how far it reaches along rows and columns
TENSOR_STEP_PX = 2  # and of how many pixels it takes one
CARRY_PX = 2  # tensors are carried from seen pixels this near
COHERENCE = 10.0  # how much longer than wide the average is along a clear structure
FAINT = 0.02  # a gradient of so much encoded colour per pixel is no clear structure yet
LEAST_DIFFERENCE = 1e-6  # of eigenvalues: where they are equal there is no direction
NEAR_SHARE = 0.25  # of what is near, in thin holes that see no background of theirs
WORKED_PX = 64  # transport works this far around what the gaze leaves it: edges come from there
DETAIL_IN_STILLS = 0.5  # chosen by measurement (docs/decisions/0254)
GATE_LOG2 = 2  # one tensor tells of 4x4 pixels whether they count as texture
ROUND, DIRECTED = 0.4, 0.6  # (l1 - l2) / (l1 + l2): up to here texture, from here on one direction
THIN_PX, WIDE_PX = 2, 6  # across a hole: up to here it is thin, and from here on it is not


@dataclass(frozen=True)
class TransportSettings:
    """Parameters of `coherence-transport`.

    Parameters
    ----------
    share : float
        Of transport in the fill, from 0 to 1; the rest is `push-pull-depth`.
    depth_threshold : float
        Steps of ``1 - z_near / z`` beyond this are depth edges.
    fovea_deg : float
        Within this angle of the gaze transport works; over the next degree it gives way to
        `push-pull-depth`, which alone fills what lies beyond. 0: transport works everywhere.
    gaze_x_deg, gaze_y_deg : float
        Where the eye looks, right of and below the frame's middle.
    width_deg : float
        Visual angle of the frame's width.
    detail : float, optional
        Amplitude of the texture's noise, relative to the statistics; 0: none. By default
        `DETAIL_IN_STILLS` where one frame is filled by itself, and none in clips.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    share: float = 0.7
    depth_threshold: float = 0.04
    fovea_deg: float = 0.0
    gaze_x_deg: float = 0.0
    gaze_y_deg: float = 0.0
    width_deg: float = 40.0
    detail: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise InputError(f"share must lie in [0, 1] (got {self.share})")
        if not 0 < self.depth_threshold < 1:
            raise InputError(f"depth_threshold must lie in (0, 1) (got {self.depth_threshold})")
        if not 0 <= self.fovea_deg <= 180:
            raise InputError(f"fovea_deg must lie in [0, 180] (got {self.fovea_deg})")
        for name in ("gaze_x_deg", "gaze_y_deg"):
            if not -90 < getattr(self, name) < 90:
                raise InputError(f"{name} must lie in (-90, 90) (got {getattr(self, name)})")
        if self.detail is not None and not 0 <= self.detail <= 8:
            raise InputError(f"detail must lie in 0..8 (got {self.detail})")
        Flat(width_deg=self.width_deg)  # checks its range
        for name in ("gaze_x_deg", "gaze_y_deg", "width_deg"):
            if self.fovea_deg == 0 and getattr(self, name) != getattr(type(self), name):
                raise InputError(
                    f"{name} (got {getattr(self, name)}) is for a fill by eccentricity and needs"
                    " fovea_deg above 0, how far around the gaze transport works; give it, too"
                )

    @property
    def noise(self) -> MetamericSettings:
        """Settings of the detail; as long as its `noise` is not 0."""
        amplitude = DETAIL_IN_STILLS if self.detail is None else self.detail
        return MetamericSettings(noise=amplitude, depth_threshold=self.depth_threshold)

    def in_clips(self) -> "TransportSettings":
        """The same for the frames of a clip."""
        return replace(self, detail=self.detail or 0.0)

    def attention(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """Share of transport that the gaze leaves: (H, W) of a frame of `size`, 1 at the gaze."""
        if self.fovea_deg == 0:
            return np.ones(size, np.float32)
        eye = Flat(width_deg=self.width_deg).of(size[1], size[0])
        return share_around(eye, eye.place_px(self.gaze_x_deg, self.gaze_y_deg), self.fovea_deg)

    def worked(self, size: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns where transport works in a frame of `size`."""
        attended = self.attention(size) > 0

        def around(axis: int) -> slice:
            found = np.flatnonzero(attended.any(axis=1 - axis))
            if not len(found):
                return slice(0, 0)
            first, last = int(found[0]), int(found[-1])
            return slice(max(0, first - WORKED_PX), min(size[axis], last + WORKED_PX + 1))

        return around(0), around(1)


Indices = NDArray[np.intp]

S = TypeVar("S", bound=np.generic)

UNREACHED = 1 << 30  # shell of a hole pixel that sees no background of its own
LEFT_OUT = UNREACHED + 1  # and of one that is far from the gaze
SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # row, column
CORNERS = ((1, 1), (1, -1), (-1, -1), (-1, 1))
DISC = tuple(
    (y, x)
    for y in range(-RADIUS_PX, RADIUS_PX + 1)
    for x in range(-RADIUS_PX, RADIUS_PX + 1)
    if 0 < x * x + y * y <= RADIUS_PX**2
)


@dataclass(frozen=True, eq=False)
class TransportFill:
    """A fill, and how it came about."""

    colour: Floats  # (H, W, 3), in [0, 1]
    base: Floats  # (H, W, 3): push-pull's
    shell: Indices  # (H, W): 0 where known, from 1 on in holes
    transported: Floats  # (H, W, 3): before the base is mixed in


def transport_fill(
    warped: WarpedFrame, settings: TransportSettings, *, z_near_m: float, seed: int = 0
) -> TransportFill:
    """Fill the holes of a frame.

    Parameters
    ----------
    warped : WarpedFrame
        At least one pixel must be known.
    z_near_m : float
        The clip's nearest depth; see `guide_from_depth`.
    seed : int
        Of the detail's noise.
    """
    hole, threshold = warped.hole, settings.depth_threshold
    guide = guide_from_depth(warped.depth_m, z_near_m)
    known = np.where(hole[..., None], 0.0, warped.colour.astype(np.float64))
    noise = settings.noise
    levels = guided_base(
        known, hole, guide, levels=noise.levels, gamma=noise.gamma, threshold=threshold
    )
    base = np.where(hole[..., None], levels[0].values, known)
    attention = settings.attention(warped.size).astype(np.float64)
    worked = np.zeros(hole.shape, np.bool_)
    worked[settings.worked(warped.size)] = True
    shell = shells(hole, guide, threshold, worked)
    tensor = structure_tensors(known, hole, guide, threshold)
    moved = transported(known, tensor, shell, guide, threshold)
    result, reached = base.copy(), hole & (shell < UNREACHED)
    result[reached] += (settings.share * attention[..., None] * (moved - base))[reached]
    enclosed = np.argwhere(shell == UNREACHED)
    near, share = near_around(known, hole, enclosed)
    share *= attention[tuple(enclosed.T)]
    result[tuple(enclosed.T)] += share[:, None] * (near - base[tuple(enclosed.T)])
    result = result.clip(0, 1)
    if noise.noise:
        parts = texture_parts(tensor, noise.levels)
        result = with_detail(
            warped, result, levels, noise,
            seed=seed, parts=parts, attention=attention[..., None],
        ).colour  # fmt: skip
    return TransportFill(result, base, shell, moved)


def shells(
    hole: Bools,
    guide: Floats,
    threshold: float,
    worked: Bools | None = None,
) -> Indices:
    """Number the hole pixels of each surface by their distance from its known pixels: (H, W).

    `LEFT_OUT` where they are not `worked` at; no way leads over these.

    The first shell has a known pixel of the same surface among the eight around it. From an odd
    shell the next is reached along rows and columns, from an even one along diagonals too: such
    shells are octagons, and grow by nearly a pixel each.
    """
    shell = np.where(hole, UNREACHED, 0)
    if worked is not None:
        shell[hole & ~worked] = LEFT_OUT
    front, number = np.argwhere(~hole), 0
    while len(front):
        steps = SIDES if number % 2 else SIDES + CORNERS
        found = [np.zeros((0, 2), np.intp)]
        for pixel, place, _ in _pairs(front, steps, guide, threshold):
            del pixel
            place = place[shell[tuple(place.T)] == UNREACHED]
            shell[tuple(place.T)] = number + 1
            found.append(place)
        front, number = np.unique(np.concatenate(found), axis=0), number + 1
    return shell


def structure_tensors(colour: Floats, hole: Bools, guide: Floats, threshold: float) -> Floats:
    """Average products of the known colour's gradients: (H, W, 3) of xx, xy, yy; 0 in holes.

    A gradient is half the difference of the two neighbours, along rows and columns, summed over
    the three colours; all five pixels must be known and of one surface. The mean over a surface
    is a Gaussian's.
    """
    height, width = hole.shape
    product, whole = np.zeros(colour.shape), np.zeros(hole.shape, np.bool_)
    middle = np.s_[1 : height - 1, 1 : width - 1]

    def beside(array: NDArray[S], y: int, x: int) -> NDArray[S]:
        return array[1 + y : height - 1 + y, 1 + x : width - 1 + x]

    if min(height, width) > 2:
        whole[middle] = ~hole[middle]
        for step in SIDES:
            apart = np.abs(beside(guide, *step) - guide[middle])
            whole[middle] &= ~beside(hole, *step) & (apart <= threshold)
        x, y = (beside(colour, *a) - beside(colour, *b) for a, b in (SIDES[::2], SIDES[1::2]))
        products = [(a * b).sum(axis=-1) / 4 for a, b in ((x, x), (x, y), (y, y))]
        product[middle] = np.stack(products, axis=-1)
    reach = range(-TENSOR_REACH_PX, TENSOR_REACH_PX + 1, TENSOR_STEP_PX)
    pixels = np.argwhere(~hole)
    total, weight = np.zeros(colour.shape), np.zeros((*hole.shape, 1))
    steps = [(y, x) for y in reach for x in reach]
    for pixel, place, step in _pairs(pixels, steps, guide, threshold):
        share = whole[tuple(place.T)] * np.exp(-np.dot(step, step) / (2 * TENSOR_PX**2))
        total[tuple(pixel.T)] += share[:, None] * product[tuple(place.T)]
        weight[tuple(pixel.T)] += share[:, None]
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)


def transported(
    colour: Floats, tensor: Floats, shell: Indices, guide: Floats, threshold: float
) -> Floats:
    """Carry colour and tensors inwards, shell by shell; unreached pixels keep what they have.

    Bornemann and März, eq. 9 and section 4: with n the direction across the structure and d the
    way to a seen pixel, the weight of its colour is ``exp(-(mu n.d / R)^2 / 2) / |d|``. `mu` is
    near 1 where the eigenvalues of the tensor are alike, and large along a clear structure.
    """
    colour, tensor = colour.copy(), tensor.copy()
    reached = shell[shell < UNREACHED]
    for number in range(1, int(reached.max(initial=0)) + 1):
        pixels = np.argwhere(shell == number)
        index = np.full(shell.shape, -1, np.intp)
        index[tuple(pixels.T)] = np.arange(len(pixels))
        seen = []  # of each step: rows of `pixels`, places, and the step
        for pixel, place, step in _pairs(pixels, DISC, guide, threshold):
            known = shell[tuple(place.T)] < number
            seen.append((index[tuple(pixel[known].T)], place[known], step))
        mean, total = np.zeros((len(pixels), 3)), np.zeros((len(pixels), 1))
        for row, place, step in seen:
            if np.dot(step, step) > CARRY_PX**2:
                continue
            mean[row] += tensor[tuple(place.T)] / np.dot(step, step)
            total[row] += 1 / np.dot(step, step)
        mean /= total
        across = coherence(mean)
        mixed, total = np.zeros((len(pixels), 3)), np.zeros((len(pixels), 1))
        for row, place, (y, x) in seen:
            off = (across[row] @ (x, y)) / RADIUS_PX
            weight = (np.exp(-(off**2) / 2) / np.hypot(x, y))[:, None]
            mixed[row] += weight * colour[tuple(place.T)]
            total[row] += weight
        colour[tuple(pixels.T)], tensor[tuple(pixels.T)] = mixed / total, mean
    return colour


def coherence(tensor: Floats) -> Floats:
    """Return mu times the direction across the structure, (N, 2) of x and y, of tensors (N, 3)."""
    xx, xy, yy = tensor.T
    difference = np.hypot(xx - yy, 2 * xy)  # of the eigenvalues
    angle = np.arctan2(2 * xy, xx - yy) / 2
    with np.errstate(divide="ignore", over="ignore"):
        mu = 1 + COHERENCE * np.exp(-((FAINT**2 / difference) ** 2))
    mu *= difference / (difference + LEAST_DIFFERENCE)
    return np.asarray(mu[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def texture_parts(tensor: Floats, levels: int) -> list[Floats]:
    """Tell, level by level, how much coefficients count as texture, given all tensors (H, W, 3).

    0 where the picture has one direction, clearly (twice `FAINT`), else 1. What the middle of 4x4
    pixels says holds for all of them.
    """
    height, width = tensor.shape[:2]
    step = 1 << GATE_LOG2
    rows, columns = (
        np.minimum(np.arange(step // 2, length + step // 2, step), length - 1)
        for length in (height, width)
    )
    xx, xy, yy = np.moveaxis(tensor[rows][:, columns], -1, 0)
    total, difference = xx + yy, np.hypot(xx - yy, 2 * xy)
    share = np.divide(difference, total, out=np.zeros_like(total), where=total > 0)
    directed = np.clip((share - ROUND) / (DIRECTED - ROUND), 0, 1)
    clear = np.clip((total + difference) / (2 * FAINT**2) - 1, 0, 1)
    found = []
    for level in range(levels):
        whole = (1 - directed * clear).repeat(step >> level, 0).repeat(step >> level, 1)
        found.append(whole[: -(-height // (1 << level)), : -(-width // (1 << level))])
    return found


def near_around(colour: Floats, hole: Bools, pixels: Indices) -> tuple[Floats, Floats]:
    """Return all that is near hole pixels, (N, 2), at any depth, and the share that the fill takes.

    Returns
    -------
    colour : (N, 3)
        Mean of the known pixels within `RADIUS_PX`, by 1 / distance^2.
    share : (N,)
        `NEAR_SHARE` where the hole is at most `THIN_PX` across, along its row or column, and less
        up to `WIDE_PX`. 0 where no pixel within `RADIUS_PX` is known.
    """
    index = np.full(hole.shape, -1, np.intp)
    index[tuple(pixels.T)] = np.arange(len(pixels))
    mean, total = np.zeros((len(pixels), 3)), np.zeros(len(pixels))
    for pixel, place, step in _pairs(pixels, DISC, np.zeros(hole.shape), 1.0):
        weight = ~hole[tuple(place.T)] / np.dot(step, step)
        row = index[tuple(pixel.T)]
        mean[row] += weight[:, None] * colour[tuple(place.T)]
        total[row] += weight
    thin = np.clip((WIDE_PX - across_px(hole, pixels)) / (WIDE_PX - THIN_PX), 0, 1)
    share = NEAR_SHARE * np.where(total > 0, thin, 0.0)
    return mean / np.maximum(total, 1e-9)[:, None], share


def across_px(hole: Bools, pixels: Indices) -> Indices:
    """Count the hole pixels in line through each of some, (N,): the fewer of row and column.

    At most `WIDE_PX`; beyond the frame's edge there are none.
    """
    padded = np.pad(hole, WIDE_PX)
    lengths = []
    for axis in (0, 1):
        length = np.ones(len(pixels), np.intp)
        for sense in (-1, 1):
            going = np.ones(len(pixels), np.bool_)
            for count in range(1, WIDE_PX):
                place = pixels + WIDE_PX
                place[:, axis] += sense * count
                going &= padded[tuple(place.T)]
                length += going
        lengths.append(length)
    return np.minimum(*lengths).clip(max=WIDE_PX)


def _pairs(
    pixels: Indices, steps: tuple[tuple[int, int], ...] | list[tuple[int, int]], guide: Floats,
    threshold: float,
) -> Iterator[tuple[Indices, Indices, tuple[int, int]]]:  # fmt: skip
    """Yield for each step those of `pixels` that it leads to their own surface from, and where."""
    for step in steps:
        place = pixels + step
        inside = ((place >= 0) & (place < guide.shape)).all(axis=1)
        pixel, place = pixels[inside], place[inside]
        same = np.abs(guide[tuple(pixel.T)] - guide[tuple(place.T)]) <= threshold
        yield pixel[same], place[same], step
