"""Reproducible chance: integers from SHA-256 of (seed, counter), the same on every platform.

Library shuffles may change between versions; a plan must not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import TypeVar

from protocols.disk.hashing import Json, canonical_json

T = TypeVar("T")


class Chance:
    """A stream of integers, fixed by `seed`.

    Parameters
    ----------
    seed : JSON values
        What the stream belongs to: a seed, a participant's code, a purpose.
    """

    def __init__(self, *seed: Json) -> None:
        self._key = hashlib.sha256(canonical_json(list(seed))).digest()
        self._counter = 0

    def _draw(self) -> int:
        """Return the next 64 bits."""
        block = self._key + self._counter.to_bytes(8, "big")
        self._counter += 1
        return int.from_bytes(hashlib.sha256(block).digest()[:8], "big")

    def below(self, bound: int) -> int:
        """Return an integer in [0, bound), every one equally likely."""
        if bound < 1:
            raise ValueError(f"bound must be at least 1 (got {bound})")
        limit = 2**64 - 2**64 % bound  # above it, the remainders would not be equally likely
        while (drawn := self._draw()) >= limit:
            pass
        return drawn % bound

    def shuffled(self, items: Iterable[T]) -> list[T]:
        """Return the items in random order (Fisher and Yates)."""
        order = list(items)
        for last in range(len(order) - 1, 0, -1):
            other = self.below(last + 1)
            order[last], order[other] = order[other], order[last]
        return order
