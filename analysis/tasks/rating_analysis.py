"""The analysis of ordered ratings, kind `ratings`."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pandas as pd

from analysis.models.ordinal import lacking
from analysis.parts import AnyPart
from analysis.parts.learning import StepLearning
from analysis.parts.random_effects import RatingEffects, TimeEffects
from analysis.parts.ratings import RatingsPart
from analysis.parts.times import TimesPart
from analysis.plans.rating_plan import RatingPlan, conditions_of, from_protocol, settings_of
from analysis.plans.table_settings import RatingTableSettings
from analysis.simulations import RatedSteps
from analysis.tables.rating_table import read_ratings
from analysis.tables.table import Source
from analysis.tables.trials import as_decisions
from analysis.tasks.base import TaskAnalysis
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Analysis


class RatingsTask(TaskAnalysis[RatingPlan]):
    """A cumulative-link mixed model of ratings, or of graded comparisons of pairs."""

    kind: ClassVar[str] = "ratings"
    task: ClassVar[str] = "ratings"
    parts: ClassVar[tuple[AnyPart, ...]] = (
        RatingsPart(),
        RatingEffects(RatingsPart()),
        StepLearning(),
        TimesPart(),
        TimeEffects(TimesPart()),
    )
    options: ClassVar[type[Analysis]] = RatingTableSettings

    def settings(self, study: StudyProtocol) -> RatingPlan:
        """Return the plan that a protocol fixes."""
        return from_protocol(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, told: Any) -> RatingPlan:
        """Return the plan that was told."""
        return settings_of(decisions, name, told)

    def read(self, table: Source, mapping: Mapping[str, str], told: Any) -> pd.DataFrame:
        """Read ratings: who gave which to what."""
        by = told.by or None
        return as_decisions(
            read_ratings(table, mapping, by=by, scale=told.scale, option="--set {}=")
        )

    def simulation(self, study: StudyProtocol) -> RatedSteps:
        """Return the simulation of the steps that are given."""
        plan = self.settings(study)
        return RatedSteps(study, plan, self.parts_of(plan))

    def lacks(self, decisions: pd.DataFrame, settings: RatingPlan) -> str:
        """Return the column without which nothing can be compared."""
        rated = len(conditions_of(decisions, settings))
        return lacking(decisions["participant"].nunique(), rated, decisions["rating"].nunique())
