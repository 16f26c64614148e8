"""The analysis of ordered ratings, kind `ratings`."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pandas as pd

from analysis.parts import AnyPart
from analysis.parts.learning import StepLearning
from analysis.parts.ratings import RatingsPart
from analysis.parts.times import TimesPart
from analysis.plans.ratings import RatingSettings, RatingsOptions, from_protocol, settings_of
from analysis.simulations import RatedSteps
from analysis.tables.ratings import read_ratings, scale_of
from analysis.tables.table import Source
from analysis.tasks.base import TableOptions, TaskAnalysis
from protocols.columns import Column, decided
from protocols.schema import StudyProtocol
from protocols.tasks.rating import RATING_COLUMNS

_ALWAYS = ("session", "participant", "simulated", "trial", "kind", "order", "included", "exclusion")


class Ratings(TaskAnalysis[RatingSettings]):
    """A cumulative-link mixed model of ratings, or of graded comparisons of pairs."""

    kind: ClassVar[str] = "ratings"
    task: ClassVar[str] = "ratings"
    parts: ClassVar[tuple[AnyPart, ...]] = (RatingsPart(), StepLearning(), TimesPart())
    options: ClassVar[type[TableOptions]] = RatingsOptions

    def settings(self, study: StudyProtocol) -> RatingSettings:
        """Return the settings that a protocol fixes."""
        return from_protocol(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> RatingSettings:
        """Return what the options say."""
        return settings_of(decisions, name, options)

    def options_of(self, settings: RatingSettings) -> RatingsOptions:
        """Return the options that say the same."""
        return RatingsOptions(
            by=settings.by,
            baseline=settings.baseline,
            scale=",".join(settings.scale) or None,
            link=settings.link,
            correction=settings.correction,
            alpha=settings.alpha,
        )

    def read(self, table: Source, mapping: Mapping[str, str], options: Any) -> pd.DataFrame:
        """Read ratings: who gave which to what."""
        scale = scale_of(options.scale, "--set scale")
        rows = read_ratings(table, mapping, by=options.by, scale=scale, option="--set {}=")
        return rows.assign(
            session=rows["participant"],
            trial=[f"row-{number}" for number in range(1, len(rows) + 1)],
            kind="main",
            included=1,
            exclusion="",
        )[[column.name for column in _columns(rows)]]

    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of the table."""
        return _columns(decisions)

    def counted(self, settings: RatingSettings) -> str:
        """Return what is rated."""
        return "pairs, graded" if settings.by is None else f"ratings by {settings.by}"

    def simulation(self, study: StudyProtocol) -> RatedSteps:
        """Return the simulation of the steps that are given."""
        plan = self.settings(study)
        return RatedSteps(study, plan, self.parts_of(plan))


def _columns(decisions: pd.DataFrame) -> tuple[Column, ...]:
    known = {*_ALWAYS, "scene", "rating", "rt_s"}
    condition = [
        Column("scene", "text", "", "Scene"),
        *(
            Column(str(name), "text", "", "Column of the table's conditions")
            for name in decisions.columns
            if name not in known
        ),
    ]
    there = {*_ALWAYS, *decisions.columns}
    return tuple(column for column in decided(condition, RATING_COLUMNS) if column.name in there)
