"""Square tables of counts as one row per decision: who was chosen over whom, or answered for what.

A count says how often, not in which order: a pair's two methods stand in one order throughout.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Literal

from protocols.errors import StudyError
from protocols.limits import check_within

Counted = Literal["choices", "answers"]
"""`choices`: the row's method over the column's. `answers`: the column's where the row's was right.
"""
HEADER: dict[Counted, list[str]] = {
    "choices": ["participant", "first", "second", "chosen"],
    "answers": ["participant", "expected", "answer"],
}
_NOTHING = {"", "-", "0"}
_COUNT = re.compile(r"\d+(\.0+)?")
_LEAST = 2


def is_square(header: list[str], rows: list[list[str]]) -> bool:
    """Return whether rows are called what columns are, each once, the first column apart."""
    names = [row[0].strip() for row in rows]
    return len(rows) >= _LEAST and sorted(names) == sorted(header[1:])


def decisions_of(
    path: Path, header: list[str], rows: list[list[str]], lines: list[int], kind: Counted
) -> Iterator[tuple[int, list[str]]]:
    """Yield a line of the file and a row under `HEADER` for every decision that is counted.

    Raises
    ------
    StudyError
        If a count is no whole number, or there are more than a table may have.
    """
    line_of = {row[0].strip(): line for line, row in zip(lines, rows, strict=True)}
    counts: dict[tuple[str, str], int] = {}
    for row in rows:
        for name, cell in zip(header[1:], row[1:], strict=True):
            text, pair = cell.strip(), (row[0].strip(), name)
            if pair[0] == pair[1] and kind == "choices":
                continue  # nothing is chosen over itself
            if text not in _NOTHING and not _COUNT.fullmatch(text):
                raise StudyError(
                    f"{path}: line {line_of[pair[0]]}: a count must be a whole number (got"
                    f" {text!r}, {pair[0]} by {name})"
                )
            counts[pair] = 0 if text in _NOTHING else round(float(text))
    total = sum(counts.values())
    check_within("cells", total * len(HEADER[kind]), StudyError, path, "cells")
    if not total:
        raise StudyError(f"{path}: must count at least one decision (all counts are 0)")
    if kind == "choices":
        for first, second in combinations(header[1:], 2):
            for chosen, other in ((first, second), (second, first)):
                for _ in range(counts[chosen, other]):
                    yield line_of[chosen], [path.stem, first, second, chosen]
        return
    for (expected, answer), count in counts.items():
        for _ in range(count):
            yield line_of[expected], [path.stem, expected, answer]
