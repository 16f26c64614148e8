"""Settings of the analysis of ratings."""

from collections.abc import Sequence

import pandas as pd

from analysis.parts import AnalysisPlan
from analysis.plans.table_settings import RatingTableSettings, check_contrasts
from protocols.errors import StudyError, did_you_mean
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rates import name_of
from protocols.tasks.rating import Rating, RatingsAnalysis


class RatingPlan(RatingsAnalysis, AnalysisPlan):
    """Names and rules of the analysis of ratings; without `by` they are of pairs."""

    by: str = ""
    scale: tuple[str, ...] = ()
    """Ratings from the lowest; empty: they are numbers."""

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


def from_protocol(study: StudyProtocol) -> RatingPlan:
    """Return the settings that a protocol fixes.

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
    return RatingPlan.of(
        analysis,
        study=study.study.name,
        title=study.study.title,
        protocol_sha256=study.sha256,
        scale=task.scale,
    )


def settings_of(decisions: pd.DataFrame, name: str, told: RatingTableSettings) -> RatingPlan:
    """Return the settings of a table.

    Raises
    ------
    StudyError
        If the baseline is no condition of the table.
    """
    settings = RatingPlan.of(told, study=name, title=name, reaction="models")
    known, baseline = conditions_of(decisions, settings), settings.reference_in(())
    check_contrasts(told, known)
    if baseline is not None and baseline not in known:
        raise StudyError(
            f"--set baseline={baseline}: must be one of the conditions"
            f" ({', '.join(known)}){did_you_mean(baseline, known)}"
        )
    return settings


def conditions_of(decisions: pd.DataFrame, settings: RatingPlan) -> Sequence[str]:
    """Return the conditions that are rated, sorted."""
    return sorted({str(value) for name in settings.columns for value in decisions[name]})
