"""Differences of participants' median reaction times, with limits that need no law."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from scipy.stats import binom

from analysis.arrays import Floats
from analysis.models.contrasts import pairs_of
from analysis.parts import AnalysisPlan, Presentation, SimplePart
from analysis.report.result_table import ResultColumn, ResultTable, attribute, estimated, limits
from analysis.report.wording import level_text, number, number_range
from protocols.blocks import Paragraph


@dataclass(frozen=True)
class MedianDifference:
    """Median over participants of their medians' difference, first minus second, s."""

    first: str
    second: str
    difference_s: float
    lower: float
    upper: float
    participants: int


@dataclass(frozen=True)
class MedianDifferences:
    """Every number."""

    pairs: tuple[MedianDifference, ...]
    notes: tuple[str, ...]


class MedianDifferencesPart(SimplePart[AnalysisPlan, MedianDifferences]):
    """Differences of median reaction times between conditions."""

    name: ClassVar[str] = "median_differences"
    section: ClassVar[tuple[str, str]] = ("checks", "Learning, speed")

    def wanted(self, table: pd.DataFrame, plan: AnalysisPlan) -> bool:
        """Return True if there are times above 0 in conditions that are compared."""
        return "rt_s" in table and bool((table["rt_s"] > 0).any()) and len(plan.compared) == 1

    def of(self, table: pd.DataFrame, plan: AnalysisPlan) -> MedianDifferences:
        """Take participants' medians away from each other, pair by pair."""
        rows = table[table["rt_s"] > 0]
        keys = [rows["participant"].astype(str), rows[plan.compared[0]].astype(str)]
        each = rows["rt_s"].groupby(keys).median().unstack()
        names = plan.in_order(list(each.columns))
        found = []
        for a, b in pairs_of({name: each[name] for name in names}, plan.reference_in(names)):
            moved = (each[a] - each[b]).dropna().to_numpy()
            lower, upper = _limits(moved, plan.confidence)
            found.append(MedianDifference(a, b, float(np.median(moved)), lower, upper, moved.size))
        return MedianDifferences(tuple(found), ())

    def show(self, found: MedianDifferences, plan: AnalysisPlan) -> Presentation:
        """Return a table of them, and each as a sentence."""
        label, level = plan.label, level_text(plan.confidence)
        names = ResultColumn[MedianDifference](
            "Conditions",
            "l c",
            lambda one: f"{label(one.first)} - {label(one.second)}",
            "first second",
        )
        table = ResultTable[MedianDifference].of(
            "Differences of participants' median reaction times, s",
            found.pairs,
            names,
            estimated("Median", "difference_s"),
            limits(plan.limits),
            attribute("Participants", "participants", str),
        )
        return Presentation(
            blocks=(table.block(), Paragraph("Limits are order statistics.", muted=True)),
            sentences=tuple(
                f"Participants' median times in {label(one.first)} minus {label(one.second)} had a"
                f" median of {number(one.difference_s)} s, {level}"
                f" {number_range(one.lower, one.upper)}."
                for one in found.pairs
            ),
            methods=(
                "Limits of the median of participants' differences of median times are those of"
                " the sign test (order statistics; coverage is at least what is stated)."
            ),
            tables={"median_differences.csv": table.frame()},
        )


def _limits(moved: Floats, level: float) -> tuple[float, float]:
    """Return the limits of a median by order statistics; NaN where they are infinite."""
    out = int(binom.ppf((1 - level) / 2, moved.size, 0.5))
    # The largest number of values left out on each side that keeps the coverage.
    while out > 0 and binom.cdf(out - 1, moved.size, 0.5) > (1 - level) / 2:
        out -= 1
    if out == 0:
        return float("nan"), float("nan")
    ordered = np.sort(moved)
    return float(ordered[out - 1]), float(ordered[-out])
