"""Plans of analyses that compare the values of one column: ratings, and reaction times."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import pandas as pd

from analysis.parts import AnalysisPlan, SectionKey
from analysis.plans.table_sections import TimeTableSection, check_contrasts
from protocols.errors import StudyError, did_you_mean
from protocols.tasks.rates import name_of
from protocols.tasks.rating import RatingsAnalysis
from protocols.units import Scalar


@dataclass(frozen=True, kw_only=True)
class OneColumnPlan(AnalysisPlan):
    """Names and rules of an analysis by one column; without `by` all rows are together."""

    section: RatingsAnalysis | TimeTableSection

    by = SectionKey[str]()
    baseline = SectionKey[Scalar | None]()

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions, if any."""
        return (self.by,) if self.by else ()

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return the baseline."""
        return None if self.baseline is None else name_of(self.baseline)

    def check_known(self, known: Sequence[str], baseline_must: str) -> None:
        """Refuse contrasts and a baseline of what are no conditions of a table (StudyError)."""
        check_contrasts(self.section, known)
        baseline = self.reference_in(())
        if baseline is not None and baseline not in known:
            raise StudyError(
                f"--set baseline={baseline}: must be {baseline_must} ({', '.join(known)})"
                f"{did_you_mean(baseline, known)}"
            )


@dataclass(frozen=True, kw_only=True)
class RatingPlan(OneColumnPlan):
    """Names and rules of the analysis of ratings; without `by` they are of pairs."""

    section: RatingsAnalysis
    scale: tuple[str, ...] = ()
    """Ratings from the lowest; empty: they are numbers."""

    link = SectionKey[Literal["probit", "logit"]]()
    correction = SectionKey[Literal["holm", "none"]]()

    @property
    def counted(self) -> str:
        """Rated thing, in a few words."""
        return f"ratings by {self.by}" if self.by else "pairs, graded"

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that hold conditions."""
        return self.compared or ("first", "second")

    def conditions_of(self, decisions: pd.DataFrame) -> Sequence[str]:
        """Return the conditions that are rated, sorted."""
        return sorted({str(value) for name in self.columns for value in decisions[name]})
