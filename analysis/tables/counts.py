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
_CALLED_SUMS = {"total", "totals", "sum", "sums", "all", "n"}


def is_square(path: Path, header: list[str], rows: list[list[str]]) -> bool:
    """Return True if rows are called what columns are, each once, the first column apart.

    Raises
    ------
    StudyError
        If only most of them are.
    """
    names, columns = [row[0].strip() for row in rows], header[1:]
    if len(rows) >= _LEAST and sorted(names) == sorted(columns):
        return True
    odd = sorted({*names} ^ {*columns}) or sorted({n for n in names if names.count(n) > 1})
    if len({*names} & {*columns}) >= max(_LEAST, len(odd)):
        raise StudyError(
            f"{path}: a table of counts must have a row and a column of each name, once (got"
            f" {', '.join(odd)} otherwise); leave sums away, and give tables of several"
            " participants one by one"
        )
    return False


def _sums(names: list[str], cells: dict[tuple[str, str], int]) -> str | None:
    """Return the name whose row and column are the sums of the others; None where none is."""

    def is_sum(name: str, diagonal: bool) -> bool:
        others = [each for each in names if each != name]
        shown = {
            (row, column): cells[row, column] if diagonal or row != column else 0
            for row in others
            for column in others
        }
        whole = sum(shown.values())
        return (
            whole > 0
            and (name.lower() in _CALLED_SUMS or cells[name, name] == whole)
            and all(cells[row, name] == sum(shown[row, each] for each in others) for row in others)
            and all(cells[name, col] == sum(shown[each, col] for each in others) for col in others)
        )

    return next((name for name in names if is_sum(name, False) or is_sum(name, True)), None)


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
            counted = _COUNT.fullmatch(text)
            # Nothing is chosen over itself.
            if text not in _NOTHING and not counted and (pair[0] != name or kind == "answers"):
                raise StudyError(
                    f"{path}: line {line_of[pair[0]]}: a count must be a whole number (got"
                    f" {text!r}, {pair[0]} by {name}); give how often, no shares and no marks"
                    " between digits"
                )
            counts[pair] = round(float(text)) if counted else 0
    if sums := _sums(header[1:], counts):
        raise StudyError(
            f"{path}: must hold no sums (row and column {sums!r} are those of the others); leave"
            " both away"
        )
    if kind == "choices":
        counts |= dict.fromkeys(((name, name) for name in header[1:]), 0)
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
