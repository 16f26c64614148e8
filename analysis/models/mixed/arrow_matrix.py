"""Random effects of trials, and the linear algebra that keeps thousands of them quick.

The second derivative in all effects is an arrow: effects that never share a trial, such as those
of different participants, form small blocks, and the few others, such as scenes, a border.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.arrays import Floats, Ints
from protocols.errors import StudyError
from protocols.limits import FIXED

N = TypeVar("N", bound=np.generic)

MOST_LEVELS = FIXED["effects"].most
MOST_PAIRS = FIXED["effect_pairs"].most
_CURE = (
    "leave participants or scenes out with --where, or give each row the code of its participant"
)


@dataclass(frozen=True)
class ArrowMatrix:
    """A symmetric matrix of blocks with a border.

    Attributes
    ----------
    blocks : ndarray (blocks, m, m)
    across : ndarray (blocks m, border)
    border : ndarray (border, border)
    """

    blocks: Floats
    across: Floats
    border: Floats

    def __matmul__(self, vectors: Floats) -> Floats:
        """Return the matrix times a vector (slots,), or several (slots, vectors)."""
        inner, outer = np.split(vectors, self.across.shape[:1])
        return np.concatenate(
            [
                _by_block(self.blocks, inner) + self.across @ outer,
                self.across.T @ inner + self.border @ outer,
            ]
        )

    def __mul__(self, other: "ArrowMatrix") -> "ArrowMatrix":
        """Return the product entry by entry."""
        return ArrowMatrix(
            self.blocks * other.blocks, self.across * other.across, self.border * other.border
        )

    def scaled(self, scale: Floats) -> "ArrowMatrix":
        """Return S M S, where S has `scale` (slots,) on its diagonal."""
        inner, outer = np.split(scale, self.across.shape[:1])
        own = inner.reshape(self.blocks.shape[:2])
        return ArrowMatrix(
            self.blocks * own[:, :, None] * own[:, None, :],
            self.across * (inner.reshape(-1, 1) * outer),
            self.border * outer[:, None] * outer,
        )

    def plus_one_inverted(self, *, convex: bool = True) -> "Arrow":
        """Return I + M, inverted; not `convex`: M may have negative eigenvalues.

        Raises
        ------
        LinAlgError
            If it is not positive definite.
        """
        size = self.blocks.shape[1]
        blocks = self.blocks + np.eye(size)
        inverse = np.asarray(1.0 / blocks if size == 1 else np.linalg.inv(blocks))
        reach = _by_block(inverse, self.across)
        left = self.border + np.eye(len(self.border)) - self.across.T @ reach
        if not convex:
            np.linalg.cholesky(blocks)
            np.linalg.cholesky(left)
        return Arrow(inverse, reach, np.asarray(np.linalg.inv(left), dtype=np.float64))


@dataclass(frozen=True)
class Arrow:
    """A symmetric matrix of blocks with a border, inverted.

    Attributes
    ----------
    blocks : ndarray (blocks, m, m)
        Inverse of each block.
    reach : ndarray (blocks m, border)
        Inverse of each block times its share of the border.
    border : ndarray (border, border)
        Inverse of what the blocks leave of the border (the Schur complement).
    """

    blocks: Floats
    reach: Floats
    border: Floats

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant; infinite where the matrix is singular."""
        return -float(sum(np.linalg.slogdet(one)[1].sum() for one in (self.blocks, self.border)))

    def solve(self, vectors: Floats) -> Floats:
        """Return the inverse times a vector (slots,), or several (slots, vectors)."""
        inner, outer = np.split(vectors, self.reach.shape[:1])
        rest = self.border @ (outer - self.reach.T @ inner)
        return np.concatenate([_by_block(self.blocks, inner) - self.reach @ rest, rest])

    def inverse(self) -> ArrowMatrix:
        """Return the inverse, as far as blocks and the border go."""
        outward = self.reach @ self.border
        reach = self.reach.reshape(*self.blocks.shape[:2], len(self.border))
        whole = self.blocks + outward.reshape(reach.shape) @ reach.swapaxes(-1, -2)
        return ArrowMatrix(whole, -outward, self.border)


def _by_block(blocks: Floats, vectors: Floats) -> Floats:
    """Return each block times its rows of vectors (slots,) or (slots, vectors)."""
    rows = vectors.reshape(*blocks.shape[:2], math.prod(vectors.shape[1:]))
    return np.asarray((blocks @ rows).reshape(vectors.shape))


class RandomEffects:
    """Random effects of each trial, ordered so that the second derivative is an arrow.

    Parameters
    ----------
    groups : sequence of ndarray (trials,) or (trials, members)
        Level of each factor, counted from 0. A trial may have several effects of one factor,
        such as those of the two methods it compares.
    times : sequence of ndarray like `groups`
        What each effect is multiplied by.
    trials : int

    Raises
    ------
    StudyError
        If there are more than `MOST_LEVELS` effects, or `MOST_PAIRS` that the equations tie.

    Notes
    -----
    Vectors of effects have `size` slots; those that fill up short blocks stay 0.
    """

    def __init__(self, groups: Sequence[Ints], times: Sequence[Floats], trials: int) -> None:
        codes = [code.reshape(len(code), -1).T for code in groups]
        sizes = [int(code.max()) + 1 for code in codes]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        if starts[-1] > MOST_LEVELS:
            raise StudyError(
                f"a mixed model must have at most {MOST_LEVELS:,} participants, scenes and their"
                f" combinations with conditions (there are {starts[-1]:,}); {_CURE}"
            )
        members = np.concatenate(
            [np.zeros((0, trials), dtype=np.int64)]
            + [code + start for code, start in zip(codes, starts[:-1], strict=True)]
        )
        slot, self._blocks, self._border = _slots(codes, starts)
        count, width = self._blocks
        pairs = count * width * (width + self._border) + self._border**2
        if pairs > MOST_PAIRS:
            raise StudyError(
                f"a mixed model must tie at most {MOST_PAIRS:,} pairs of participants, scenes and"
                f" their combinations with conditions (there are {pairs:,}); {_CURE}"
            )
        self.factors, self.count = len(groups), int(starts[-1])
        self.size = self._blocks[0] * self._blocks[1] + self._border
        self._kept = [slot[low:high] for low, high in pairwise(starts)]
        self.factor = np.full(self.size, len(groups))
        for number, places in enumerate(self._kept):
            self.factor[places] = number
        self.members = slot[members]
        self.times = np.concatenate(
            [np.zeros((0, trials))] + [one.reshape(len(one), -1).T for one in times]
        )
        self._first, self._second, self._index = self._pairs()
        count = len(self.members)
        twice = self.times[:, None] * self.times[None, :]
        self._twice = twice.reshape(count * count, trials)
        # Laid flat once: small studies are fitted hundreds of times.
        self._flat_index, self._flat_members = self._index.ravel(), self.members.ravel()
        self._factor_of_pair = self.factor[self._first].ravel()

    def scale(self, sd: Floats) -> Floats:
        """Return the deviation of each slot; 0 where a slot fills up a block."""
        return np.asarray(np.append(sd, 0.0)[self.factor])

    def on_trials(self, effects: Floats) -> Floats:
        """Return the sum of effects (slots,) that act on each trial."""
        return np.asarray((self.times * effects[self.members]).sum(axis=0))

    def of_effects(self, values: Floats) -> Floats:
        """Return the sum over each effect's trials of values (trials,) times its multiplier."""
        return np.bincount(
            self._flat_members, weights=(self.times * values).ravel(), minlength=self.size
        ).astype(np.float64)

    def products(self, weight: Floats) -> ArrowMatrix:
        """Return Z' W Z, for weights (trials,)."""
        count, size = self._blocks
        flat: Floats = np.bincount(
            self._flat_index,
            weights=(self._twice * weight).ravel(),
            minlength=count * size * (size + self._border) + self._border**2,
        ).astype(np.float64)
        blocks, across, border = np.split(
            flat, [count * size * size, count * size * (size + self._border)]
        )
        # Each pair of a block's and a border's effect was met twice, once each way round.
        return ArrowMatrix(
            blocks.reshape(count, size, size),
            0.5 * across.reshape(count * size, self._border),
            border.reshape(self._border, self._border),
        )

    def arrow(self, weight: Floats, scale: Floats) -> Arrow:
        """Return I + S Z' W Z S, inverted.

        Raises
        ------
        LinAlgError
            If it is not positive definite.
        """
        convex = not np.any(weight < 0)
        return self.products(weight).scaled(scale).plus_one_inverted(convex=convex)

    def leverage(self, arrow: Arrow, weight: Floats, scale: Floats) -> tuple[Floats, Floats]:
        """Return z' H^-1 z of each trial, and the trace of H^-1 Z' W Z S over each factor.

        z is a trial's row of Z S; half the trace is what the log determinant gains where the
        factor's deviation grows and W stays.
        """
        whole = arrow.inverse()
        flat = np.concatenate([whole.blocks.ravel(), whole.across.ravel(), whole.border.ravel()])
        inverse = self._twice * flat[self._index]
        half = inverse * scale[self._second]
        trace = np.bincount(
            self._factor_of_pair,
            weights=(half * weight).ravel(),
            minlength=len(self._kept),
        )
        return np.asarray((half * scale[self._first]).sum(axis=0)), trace.astype(np.float64)

    def totals(self, slots: Floats) -> Floats:
        """Return the sum over the effects of each factor."""
        return np.array([part.sum() for part in self.by_factor(slots)])

    def by_factor(self, slots: NDArray[N]) -> tuple[NDArray[N], ...]:
        """Return the effects of each factor, in the order of its levels."""
        return tuple(slots[places] for places in self._kept)

    def _pairs(self) -> tuple[Ints, Ints, Ints]:
        """Return both slots of every two members of a trial, and where their product lies."""
        count, size = self._blocks
        corner, inside = count * size * size, count * size
        first = np.repeat(self.members, len(self.members), axis=0)
        second = np.tile(self.members, (len(self.members), 1))
        low, high = np.minimum(first, second), np.maximum(first, second)
        block = low // size * size * size + first % size * size + second % size
        across = corner + low * self._border + (high - inside)
        border = corner + inside * self._border
        border = border + (first - inside) * self._border + (second - inside)
        return (
            first,
            second,
            np.where(high < inside, block, np.where(low < inside, across, border)),
        )


def _slots(codes: Sequence[Ints], starts: Ints) -> tuple[Ints, tuple[int, int], int]:
    """Return each effect's slot, how many blocks of which size there are, and the border's size.

    Factors enter the blocks from the one with most levels on, as long as that is less work.
    """
    if not codes:
        return np.zeros(0, dtype=np.int64), (0, 0), 0
    order = np.argsort(-np.diff(starts), kind="stable")
    best: tuple[float, Ints, Ints] | None = None
    for taken in range(1, len(codes) + 1):
        inner = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in order[:taken]])
        linked = np.concatenate([codes[k] + starts[k] for k in order[:taken]])
        # Every trial ties its effects to the first of them.
        ends = np.broadcast_to(linked[0], linked.shape).ravel()
        graph = scipy.sparse.coo_array(
            (np.ones(linked.size), (linked.ravel(), ends)), (starts[-1],) * 2
        )
        label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1][inner]
        label = np.unique(label, return_inverse=True)[1].astype(np.int64)
        sizes = np.bincount(label)
        border = starts[-1] - inner.size
        work = sizes.size * float(sizes.max()) ** 3 + float(border) ** 3
        if best is None or work < best[0]:
            best = work, label, inner
    assert best is not None
    _, label, inner = best
    sizes = np.bincount(label)
    width = int(sizes.max())
    by_block = np.argsort(label, kind="stable")
    place = np.arange(inner.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    slot = np.full(starts[-1], -1)
    slot[inner[by_block]] = label[by_block] * width + place
    outside = np.flatnonzero(slot < 0)
    slot[outside] = sizes.size * width + np.arange(outside.size)
    return slot, (int(sizes.size), width), int(outside.size)
