"""Plan of the analysis of ratings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import pandas as pd

from analysis.parts import AnalysisPlan, SectionKey
from analysis.plans.table_sections import RatingTableSection, check_contrasts
from protocols.errors import StudyError, did_you_mean
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rates import name_of
from protocols.tasks.rating import Rating, RatingsAnalysis
from protocols.units import Scalar


@dataclass(frozen=True, kw_only=True)
class RatingPlan(AnalysisPlan):
    """Names and rules of the analysis of ratings; without `by` they are of pairs."""

    section: RatingsAnalysis
    scale: tuple[str, ...] = ()
    """Ratings from the lowest; empty: they are numbers."""

    by = SectionKey[str]()
    baseline = SectionKey[Scalar | None]()
    link = SectionKey[Literal["probit", "logit"]]()
    correction = SectionKey[Literal["holm", "none"]]()

    @property
    def counted(self) -> str:
        """Rated thing, in a few words."""
        return f"ratings by {self.by}" if self.by else "pairs, graded"

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions; none where pairs are rated."""
        return (self.by,) if self.by else ()

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return the baseline."""
        return None if self.baseline is None else name_of(self.baseline)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that hold conditions."""
        return self.compared or ("first", "second")


def rating_plan(study: StudyProtocol) -> RatingPlan:
    """Return the plan that a protocol fixes.

    Raises
    ------
    StudyError
        If it is no study of ratings.
    """
    analysis, task = study.analysis, study.task
    if not (isinstance(analysis, RatingsAnalysis) and isinstance(task, Rating)):
        raise StudyError(
            f"analysis.kind: must be 'ratings' with the task 'rating' (got {analysis.kind!r} with"
            f" {task.kind!r})"
        )
    return RatingPlan(
        section=analysis,
        study=study.study.name,
        title=study.study.title,
        protocol_sha256=study.sha256,
        scale=task.scale,
    )


def rating_plan_of_table(
    decisions: pd.DataFrame, name: str, section: RatingTableSection
) -> RatingPlan:
    """Return the plan of a table.

    Raises
    ------
    StudyError
        If the baseline is no condition of the table.
    """
    section = section.model_copy(update={"reaction": "models"})
    plan = RatingPlan(section=section, study=name, title=name, scale=section.scale)
    known, baseline = conditions_of(decisions, plan), plan.reference_in(())
    check_contrasts(section, known)
    if baseline is not None and baseline not in known:
        raise StudyError(
            f"--set baseline={baseline}: must be one of the conditions"
            f" ({', '.join(known)}){did_you_mean(baseline, known)}"
        )
    return plan


def conditions_of(decisions: pd.DataFrame, plan: RatingPlan) -> Sequence[str]:
    """Return the conditions that are rated, sorted."""
    return sorted({str(value) for name in plan.columns for value in decisions[name]})
