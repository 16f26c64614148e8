"""Layout of a baked texture, and how it is baked: halvings, and pooled moments of every level.

Beyond Blur, section 5.2. Rows flow through a cascade: whatever operator has the rows that it needs
gives its own, down to the coarsest resolution. So memory goes with the texture's width, and what
comes out equals, bit for bit, what the whole texture at once would give.

Resolution r is the texture halved r times, edges rounded up. At each there is the colour, and from
resolution 1 on moments of all pyramid levels finer than it: those of level k lie at resolutions
k + 1 and coarser. Eight numbers a level and texel: squares and means of luma in three bands, and
products of luma with Cb and Cr summed over bands (see foveation/pooled_moments.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.chain import chain_length, halve_around, halve_box
from pipeline.foveation.pooled_moments import coefficient_moments
from pipeline.frame import Floats
from protocols.limits import FIXED

MOMENTS = 8
"""Numbers of a level and texel."""
COLOUR_BYTES = 3
MOMENT_BYTES = 2 * MOMENTS
MOST_EDGE_PX = FIXED["frame_edge"].most
"""As large as textures are on the GPU."""


@dataclass(frozen=True)
class Layout:
    """Layout of a texture of `width` x `height` texels.

    Parameters
    ----------
    wraps : bool
        The right border goes on at the left one, as on a globe.

    Raises
    ------
    InputError
        If it is too large, or goes round and cannot be halved evenly.
    """

    width: int
    height: int
    wraps: bool = False

    def __post_init__(self) -> None:
        if not all(1 <= edge <= MOST_EDGE_PX for edge in (self.width, self.height)):
            raise InputError(
                f"a texture must have edges of 1 to {MOST_EDGE_PX} px"
                f" (has {self.width} x {self.height})"
            )
        step = 1 << self.halvings
        if self.wraps and self.width % step:
            near = max(1, round(self.width / step)) * step
            raise InputError(
                f"a texture that goes round must be a multiple of {step} px wide, so that it can be"
                f" halved {self.halvings} times (is {self.width} px); resize it to {near} px, or"
                " bake it without --wrap"
            )

    @property
    def halvings(self) -> int:
        """Halvings of the texture; as many pyramid levels have moments."""
        return chain_length(self.width, self.height)

    def size(self, halvings: int) -> tuple[int, int]:
        """Height and width of a resolution."""
        step = 1 << halvings
        return -(-self.height // step), -(-self.width // step)

    def planes(self) -> list[Plane]:
        """All planes, in the order of the file."""
        found, at = [], 0
        for halvings in range(self.halvings + 1):
            for level in (None, *range(halvings)):
                plane = Plane(level, halvings, self.size(halvings), at)
                found.append(plane)
                at += plane.nbytes
        return found

    @property
    def nbytes(self) -> int:
        """Bytes of all planes."""
        last = self.planes()[-1]
        return last.at + last.nbytes


@dataclass(frozen=True)
class Plane:
    """Colour (`level` None) or one level's moments at a resolution; `at`: bytes before it."""

    level: int | None
    halvings: int
    size: tuple[int, int]
    at: int

    @property
    def dtype(self) -> str:
        return "u1" if self.level is None else "<f2"

    @property
    def channels(self) -> int:
        return COLOUR_BYTES if self.level is None else MOMENTS

    @property
    def row_bytes(self) -> int:
        return self.size[1] * (COLOUR_BYTES if self.level is None else MOMENT_BYTES)

    @property
    def nbytes(self) -> int:
        return self.size[0] * self.row_bytes


BakedRows = NDArray[np.uint8] | NDArray[np.float16]
Put = Callable[[int | None, int, int, BakedRows], None]
"""Takes rows of a plane: its level (None: colour), its halvings, the first row's number."""

STRIP_TEXELS = 1 << 18
"""Pixels of the texture at a time: what bounds memory, unless a row has more."""


class RowOperator:
    """An operator of rows that is fed a few rows at a time.

    Parameters
    ----------
    operate : callable
        Gives a row for every `step` rows (h, w, channels).
    step : int
    reach : int
        Rows beyond its own, above and below, that a row of the result depends on.
    """

    def __init__(self, operate: Callable[[Floats], Floats], step: int, reach: int) -> None:
        self._operate, self._step, self._reach = operate, step, reach
        self._held: list[Floats] = []
        self._first = 0  # row that the held ones begin with, a multiple of the step
        self._done = 0

    def __call__(self, rows: Floats, *, last: bool) -> Floats | None:
        """Take more rows, and give those of the result that they complete."""
        step = self._step
        held = np.concatenate([*self._held, rows]) if self._held else rows
        total = self._first + len(held)
        ready = -(-total // step) if last else (total - self._reach) // step
        self._held = [held]
        if ready <= self._done:
            return None
        until = total if last else step * ready + self._reach
        found = self._operate(held[: until - self._first])
        found = found[self._done - self._first // step : ready - self._first // step]
        first = max(0, (step * ready - self._reach) // step * step)
        self._held = [held[first - self._first :].copy()]
        self._first, self._done = first, ready
        return found


class Cascade:
    """All planes of a texture, from its rows."""

    def __init__(self, layout: Layout, put: Put) -> None:
        wraps = layout.wraps
        self._layout, self._put = layout, put
        count = layout.halvings

        def halving() -> RowOperator:
            return RowOperator(lambda rows: halve_around(rows, wraps=wraps), 2, 1)

        self._lows = [halving() for _ in range(count)]

        def first(rows: Floats) -> Floats:  # what `moment_chain` begins with
            return halve_box(coefficient_moments(rows, wraps=wraps)[..., :MOMENTS])

        self._firsts = [RowOperator(first, 2, 1) for _ in range(count)]
        self._moments = [[halving() for _ in range(k + 1, count)] for k in range(count)]
        self._at: dict[tuple[int | None, int], int] = {}

    def feed(self, rows: NDArray[np.uint8], *, last: bool) -> None:
        """Take the next rows of the texture, (h, W, 3)."""
        self._colour(0, rows.astype(np.float64) / 255, last=last)

    def _colour(self, halvings: int, rows: Floats, *, last: bool) -> None:
        self._give(None, halvings, np.rint(255 * rows.clip(0, 1)).astype(np.uint8))
        if halvings == self._layout.halvings:
            return
        found = self._firsts[halvings](rows, last=last)
        if found is not None:
            self._moment(halvings, halvings + 1, found, last=last)
        found = self._lows[halvings](rows, last=last)
        if found is not None:
            self._colour(halvings + 1, found, last=last)

    def _moment(self, level: int, halvings: int, rows: Floats, *, last: bool) -> None:
        self._give(level, halvings, rows.astype(np.float16))
        if halvings < self._layout.halvings:
            found = self._moments[level][halvings - level - 1](rows, last=last)
            if found is not None:
                self._moment(level, halvings + 1, found, last=last)

    def _give(self, level: int | None, halvings: int, rows: BakedRows) -> None:
        at = self._at.get((level, halvings), 0)
        self._put(level, halvings, at, rows)
        self._at[level, halvings] = at + len(rows)


def strips(texture: NDArray[np.uint8]) -> Iterator[NDArray[np.uint8]]:
    """A texture, `STRIP_TEXELS` at a time."""
    rows = max(2, STRIP_TEXELS // texture.shape[1])
    for start in range(0, len(texture), rows):
        yield texture[start : start + rows]


def bake_rows(layout: Layout, parts: Iterable[NDArray[np.uint8]], put: Put) -> None:
    """Bake a texture that comes in parts of so many rows, (h, W, 3) encoded R'G'B'.

    `put` is given all rows of all planes, each plane's in order.
    """
    cascade, seen = Cascade(layout, put), 0
    for rows in parts:
        seen += len(rows)
        cascade.feed(rows, last=seen == layout.height)


@dataclass(frozen=True, eq=False)
class BakedTexture:
    """A baked texture.

    `colour[r]` (h, w, 3), uint8: encoded R'G'B' at resolution r. `moments[k][i]` (h, w, 8),
    float16: of level k at resolution k + 1 + i.
    """

    layout: Layout
    colour: tuple[NDArray[np.uint8], ...]
    moments: tuple[tuple[NDArray[np.float16], ...], ...]


def bake(texture: NDArray[np.uint8], *, wraps: bool = False) -> BakedTexture:
    """Bake a texture in memory.

    Parameters
    ----------
    texture : ndarray of uint8, shape (H, W, 3)
        Encoded R'G'B'.

    Raises
    ------
    InputError
        As `Layout`.
    """
    height, width = texture.shape[:2]
    layout = Layout(width, height, wraps)
    held = {
        (plane.level, plane.halvings): np.empty((*plane.size, plane.channels), plane.dtype)
        for plane in layout.planes()
    }

    def put(level: int | None, halvings: int, at: int, rows: BakedRows) -> None:
        held[level, halvings][at : at + len(rows)] = rows

    bake_rows(layout, strips(texture), put)
    return baked_of(layout, held)


def baked_of(
    layout: Layout, held: dict[tuple[int | None, int], NDArray[np.generic]]
) -> BakedTexture:
    """Sort planes, by level and halvings."""
    count = layout.halvings
    colour = tuple(held[None, r] for r in range(count + 1))
    moments = tuple(tuple(held[k, r] for r in range(k + 1, count + 1)) for k in range(count))
    return BakedTexture(layout, colour, moments)  # type: ignore[arg-type]
