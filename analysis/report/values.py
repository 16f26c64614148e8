"""Results as plain JSON: every number, none that is not finite."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import pandas as pd

from protocols.disk.hashing import Json


@runtime_checkable
class ResultRow(Protocol):
    """A result that names its own columns."""

    def row(self) -> Mapping[str, object]:
        """Return values by name."""


def as_json(value: object) -> Json:
    """Return any result as JSON; numbers that are not finite become null.

    Mappings with tuple keys get ``a / b / c`` keys; dataclasses become objects by field name, or
    by the names of their `row`, which stay when the classes change. Fields that a result calls
    `unidentified` become null; those without a `repr` are no numbers for readers, and left out.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic):
        return as_json(value.item())
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, ResultRow):
        return as_json(value.row())
    if is_dataclass(value) and not isinstance(value, type):
        hidden = getattr(value, "unidentified", ())
        return {
            one.name: None if one.name in hidden else as_json(getattr(value, one.name))
            for one in fields(value)
            if one.repr
        }
    if isinstance(value, Mapping):
        return {_key(key): as_json(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return [as_json(entry) for entry in value.tolist()]
    if isinstance(value, list | tuple):
        return [as_json(entry) for entry in value]
    raise TypeError(f"{type(value).__name__} has no place in a report")


def _key(key: object) -> str:
    return " / ".join(filter(None, map(str, key))) if isinstance(key, tuple) else str(key)


def rows_as_json(table: pd.DataFrame) -> list[Json]:
    """Return a table's rows as JSON objects; missing values become null."""
    plain = table.astype(object).where(table.notna(), None)
    return [as_json(row) for row in plain.to_dict("records")]


def flat_table(results: Iterable[object], *without: str) -> pd.DataFrame:
    """Return results as a table, one a row: numbers of nested ones by both names, no mappings.

    Fields `without` are left out. Pairs are limits; what is not identified, or not finite, is
    missing.
    """
    rows = []
    for one in results:
        held = as_json(one)
        assert isinstance(held, dict)
        left_out = {name for name, value in vars(one).items() if isinstance(value, Mapping)}
        plain = {name: held[name] for name in held if name not in left_out.union(without)}
        rows.append(dict(_flat(plain, "")))
    return pd.DataFrame(rows)


def _flat(value: Json, name: str) -> Iterator[tuple[str, object]]:
    match value:
        case dict():
            for key, one in value.items():
                yield from _flat(one, name if key == "value" else f"{name}_{key}".strip("_"))
        case [float() | int() as lower, float() | int() | None as upper]:
            stem = name.removesuffix("_limits")
            yield from ((f"{stem}_lower", lower), (f"{stem}_upper", upper))
        case list():
            yield name, "; ".join(map(str, value))
        case _:
            yield name, value
