"""Figures that several tasks have: shares by participant or scene."""

from collections.abc import Callable, Sequence

import numpy as np

from analysis.plots import heat_map, sized
from analysis.report.blocks import ReportFigure


def shares_figure(
    name: str,
    caption: str,
    columns: Sequence[str],
    shares: Sequence[Sequence[tuple[str, float]]],
    *,
    label: Callable[[str], str],
    simulated: bool,
) -> ReportFigure:
    """Return the heat map of `shares`: of each of the columns, every row's name and share.

    `name` is of the rows, such as ``participants``.
    """
    rows = sorted({row for pairs in shares for row, _ in pairs})
    table = np.full((len(rows), len(columns)), np.nan)
    for column, pairs in enumerate(shares):
        for row, value in pairs:
            table[rows.index(row), column] = value
    names, title = [label(row) for row in rows], name.removesuffix("s").capitalize()
    drawn = sized(heat_map, table, names, columns, row_title=title, simulated=simulated)
    return ReportFigure(name, caption, drawn)
