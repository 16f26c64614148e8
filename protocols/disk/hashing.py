"""The one way things are hashed, SHA-256 of bytes, files and canonical JSON; chance comes of it.

Library shuffles may change between versions; a plan must not. So integers are drawn from hashes of
(seed, counter), the same on every platform.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias, TypeVar

from pydantic import BaseModel

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"


def canonical_json(value: BaseModel | Json) -> bytes:
    """Return the one byte string that stands for `value`.

    Keys sorted, no spaces, UTF-8, floats as Python's shortest round-trip form. A model is
    dumped in JSON mode first, so that equal models give equal bytes.

    Raises
    ------
    ValueError
        If a number is not finite: JSON has no name for it.
    """
    plain = value.model_dump(mode="json") if isinstance(value, BaseModel) else value
    text = json.dumps(
        plain, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return text.encode("utf-8")


def sha256_bytes(data: bytes) -> str:
    """Return the SHA-256 of `data` as 64 lower-case hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sha256_json(value: BaseModel | Json) -> str:
    """Return the SHA-256 of `canonical_json(value)`."""
    return sha256_bytes(canonical_json(value))


def sha256_file(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, read in pieces."""
    with path.open("rb", buffering=0) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
