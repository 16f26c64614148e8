"""Random effects of trials, and the linear algebra that keeps thousands of them quick.

The second derivative in all effects is an arrow: effects that never share a trial, such as those
of different participants, form small blocks, and the few others, such as scenes, a border.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Floats = NDArray[np.float64]
Codes = NDArray[np.int64]
N = TypeVar("N", bound=np.generic)


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

    def solve(self, vector: Floats) -> Floats:
        """Return the inverse times a vector (slots,)."""
        inner, outer = np.split(vector, self.reach.shape[:1])
        rest = self.border @ (outer - self.reach.T @ inner)
        own = (self.blocks @ inner.reshape(*self.blocks.shape[:2], 1)).ravel()
        return np.concatenate([own - self.reach @ rest, rest])

    def inverse(self) -> Floats:
        """Return the inverse's blocks, their part of the border, and the border, laid flat."""
        outward = (self.reach @ self.border).reshape(*self.blocks.shape[:2], -1)
        reach = self.reach.reshape(outward.shape)
        whole = self.blocks + outward @ reach.swapaxes(-1, -2)
        return np.concatenate([whole.ravel(), -outward.ravel(), self.border.ravel()])


class RandomEffects:
    """Random effects of each trial, ordered so that the second derivative is an arrow.

    Parameters
    ----------
    groups : sequence of ndarray (trials,) or (trials, members)
        Level of each factor, counted from 0. A trial may have several effects of one factor,
        such as those of the two methods it compares.
    times : sequence of ndarray like `groups`
        What each effect is multiplied by.

    Notes
    -----
    Vectors of effects have `size` slots; those that fill up short blocks stay 0.
    """

    def __init__(self, groups: Sequence[Codes], times: Sequence[Floats]) -> None:
        codes = [code.reshape(len(code), -1).T for code in groups]
        sizes = [int(code.max()) + 1 for code in codes]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        members = np.concatenate(
            [code + start for code, start in zip(codes, starts[:-1], strict=True)]
        )
        slot, self._blocks, self._border = _slots(codes, starts)
        self.factors = len(groups)
        self.size = self._blocks[0] * self._blocks[1] + self._border
        self._kept = [slot[low:high] for low, high in pairwise(starts)]
        self.factor = np.full(self.size, len(groups))
        for number, places in enumerate(self._kept):
            self.factor[places] = number
        self.members = slot[members]
        self.times = np.concatenate(
            [np.asarray(one, dtype=np.float64).reshape(len(one), -1).T for one in times]
        )
        self._first, self._second, self._index = self._pairs()
        count = len(self.members)
        twice = self.times[:, None] * self.times[None, :]
        self._twice = twice.reshape(count * count, -1)
        # Laid flat once: small studies are fitted hundreds of times.
        self._flat_index, self._flat_members = self._index.ravel(), self.members.ravel()
        self._factor_of_pair = self.factor[self._first].ravel()
        self._units = np.eye(self._blocks[1]), np.eye(self._border)

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

    def arrow(self, weight: Floats, scale: Floats) -> Arrow:
        """Return I + S Z' W Z S, inverted.

        Raises
        ------
        LinAlgError
            If it is not positive definite.
        """
        count, size = self._blocks
        flat: Floats = np.bincount(
            self._flat_index,
            weights=(self._twice * weight).ravel(),
            minlength=count * size * (size + self._border) + self._border**2,
        ).astype(np.float64)
        inner, outer = scale[: count * size].reshape(count, size), scale[count * size :]
        corner = count * size * size
        edge = corner + count * size * self._border
        blocks = (
            flat[:corner].reshape(count, size, size) * inner[:, :, None] * inner[:, None, :]
            + self._units[0]
        )
        # Each pair of a block's and a border's effect was met twice, once each way round.
        across = 0.5 * flat[corner:edge].reshape(count * size, self._border)
        across *= inner.reshape(-1, 1) * outer
        border = flat[edge:].reshape(self._border, self._border) * outer[:, None] * outer
        inverse = np.asarray(1.0 / blocks if size == 1 else np.linalg.inv(blocks))
        reach = (inverse @ across.reshape(count, size, -1)).reshape(across.shape)
        left = border + self._units[1] - across.T @ reach
        if np.any(weight < 0):
            np.linalg.cholesky(blocks)
            np.linalg.cholesky(left)
        return Arrow(inverse, reach, np.asarray(np.linalg.inv(left), dtype=np.float64))

    def leverage(self, arrow: Arrow, weight: Floats, scale: Floats) -> tuple[Floats, Floats]:
        """Return z' H^-1 z of each trial, and the trace of H^-1 Z' W Z S over each factor.

        z is a trial's row of Z S; half the trace is what the log determinant gains where the
        factor's deviation grows and W stays.
        """
        inverse = self._twice * arrow.inverse()[self._index]
        half = inverse * scale[self._second]
        trace = np.bincount(
            self._factor_of_pair,
            weights=(half * weight).ravel(),
            minlength=len(self._kept),
        )
        return np.asarray((half * scale[self._first]).sum(axis=0)), trace.astype(np.float64)

    def by_factor(self, slots: NDArray[N]) -> tuple[NDArray[N], ...]:
        """Return the effects of each factor, in the order of its levels."""
        return tuple(slots[places] for places in self._kept)

    def _pairs(self) -> tuple[Codes, Codes, Codes]:
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


def _slots(codes: Sequence[Codes], starts: Codes) -> tuple[Codes, tuple[int, int], int]:
    """Return each effect's slot, how many blocks of which size there are, and the border's size.

    Factors enter the blocks from the one with most levels on, as long as that is less work.
    """
    order = np.argsort(-np.diff(starts), kind="stable")
    best: tuple[float, Codes, Codes] | None = None
    for taken in range(1, len(codes) + 1):
        inner = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in order[:taken]])
        linked = np.concatenate([codes[k] + starts[k] for k in order[:taken]])
        # Every trial ties its effects to the first of them.
        ends = np.broadcast_to(linked[0], linked.shape).ravel()
        graph = coo_array((np.ones(linked.size), (linked.ravel(), ends)), (starts[-1],) * 2)
        label = connected_components(graph, directed=False)[1][inner]
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
