"""The one way things are hashed: SHA-256, of bytes, of files, of canonical JSON."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TypeAlias

from pydantic import BaseModel

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"

_PIECE = 1 << 18


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
    digest = hashlib.sha256()
    with path.open("rb", buffering=0) as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()
