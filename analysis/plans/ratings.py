"""What the analysis of ratings needs to know of a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import pandas as pd
from pydantic import Field

from analysis.ordinal import OrdinalLink
from analysis.parts import Plan
from analysis.tables.ratings import scale_of
from analysis.tasks.base import TableOptions
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.suggest import did_you_mean
from protocols.tasks.rates import name_of
from protocols.tasks.rating import Rating, RatingsAnalysis


class RatingsOptions(TableOptions):
    """What a table of ratings may be told."""

    by: str | None = None
    """The column of conditions; left out: each row rates a pair, `first` against `second`."""
    baseline: str | None = None
    """The condition that the others are compared with; left out: all pairs are compared."""
    scale: str | None = None
    """Ratings from the lowest, with commas between, where they are no numbers."""
    link: OrdinalLink = "probit"
    """Of the cumulative-link model."""
    correction: Literal["holm", "none"] = "holm"
    """Over all comparisons."""
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Level of every test."""


@dataclass(frozen=True)
class RatingSettings(Plan):
    """Names and rules of the analysis of ratings; `by` None: ratings of pairs."""

    study: str
    title: str
    by: str | None
    baseline: str | None
    scale: tuple[str, ...]
    link: OrdinalLink
    correction: Literal["holm", "none"]
    alpha: float
    protocol_sha256: str | None = None

    reaction = "models"
    alternatives = None

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions; none where pairs are rated."""
        return () if self.by is None else (self.by,)

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return the baseline."""
        return self.baseline

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that hold conditions."""
        return ("first", "second") if self.by is None else (self.by,)


def from_protocol(study: StudyProtocol) -> RatingSettings:
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
    return RatingSettings(
        study=study.study.name,
        title=study.study.title,
        by=analysis.by,
        baseline=None if analysis.baseline is None else name_of(analysis.baseline),
        scale=task.scale,
        link=analysis.link,
        correction=analysis.correction,
        alpha=analysis.alpha,
        protocol_sha256=study.sha256,
    )


def settings_of(decisions: pd.DataFrame, name: str, options: RatingsOptions) -> RatingSettings:
    """Return the settings of a table.

    Raises
    ------
    StudyError
        If the baseline is no condition of the table.
    """
    settings = RatingSettings(
        study=name,
        title=name,
        by=options.by,
        baseline=options.baseline,
        scale=scale_of(options.scale, "--set scale"),
        link=options.link,
        correction=options.correction,
        alpha=options.alpha,
    )
    known = conditions_of(decisions, settings)
    if options.baseline is not None and options.baseline not in known:
        raise StudyError(
            f"--set baseline={options.baseline}: must be one of the conditions"
            f" ({', '.join(known)}){did_you_mean(options.baseline, known)}"
        )
    return settings


def conditions_of(decisions: pd.DataFrame, settings: RatingSettings) -> Sequence[str]:
    """Return the conditions that are rated, sorted."""
    return sorted({str(value) for name in settings.columns for value in decisions[name]})
