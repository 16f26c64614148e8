"""Results as plain JSON: every number, none that is not finite."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
    if isinstance(value, ResultRow) or (is_dataclass(value) and not isinstance(value, type)):
        hidden = getattr(value, "unidentified", ())
        held = _values(value).items()
        return {name: None if name in hidden else as_json(one) for name, one in held}
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


def frame_of(
    results: Iterable[object], kind: type | None = None, *, without: Sequence[str] = ()
) -> pd.DataFrame:
    """Return results as a table, one a row: numbers of nested ones by both names, no mappings.

    Pairs are limits; what is not identified is missing. Fields `without` are left out.

    Parameters
    ----------
    kind : type, optional
        Dataclass of the results, whose fields are the columns where there are none.
    """
    rows = [dict(_cells(one, without)) for one in results]
    names = None if rows or kind is None else [one.name for one in fields(kind)]
    return pd.DataFrame(rows, columns=names)


def _cells(result: object, without: Sequence[str]) -> Iterator[tuple[str, object]]:
    hidden = getattr(result, "unidentified", ())
    for name, value in _values(result).items():
        if name in hidden:
            yield name, None
        elif name not in without and not isinstance(value, Mapping):
            yield from (((name, value),) if np.isscalar(value) else _flat(as_json(value), name))


def _values(result: object) -> Mapping[str, object]:
    """Return the values of a result: of its `row`, or of the fields that readers see."""
    if isinstance(result, ResultRow):
        return result.row()
    assert is_dataclass(result)
    return {one.name: getattr(result, one.name) for one in fields(result) if one.repr}


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
