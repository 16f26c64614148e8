"""The analysis of ordered ratings, kind `ratings`."""

from collections.abc import Mapping

import pandas as pd

from analysis.models.ordinal import lacking
from analysis.parts.learning import StepLearning
from analysis.parts.random_effects import RatingEffects, TimeEffects
from analysis.parts.ratings import RatingsPart
from analysis.parts.times import TimesPart
from analysis.plans.rating_plan import RatingPlan, conditions_of, rating_plan, rating_plan_of_table
from analysis.plans.table_sections import RatingTableSection
from analysis.simulations import RatedSteps
from analysis.tables.rating_table import read_ratings
from analysis.tables.table import Source
from analysis.tables.trials import as_decisions
from analysis.tasks.base import TaskAnalysis
from protocols.study_file.schema import StudyProtocol


class RatingsTask(TaskAnalysis[RatingTableSection, RatingPlan]):
    """A cumulative-link mixed model of ratings, or of graded comparisons of pairs."""

    kind = "ratings"
    task = "ratings"
    parts = (
        RatingsPart(),
        RatingEffects(RatingsPart()),
        StepLearning(),
        TimesPart(),
        TimeEffects(TimesPart()),
    )
    options = RatingTableSection

    def plan(self, study: StudyProtocol) -> RatingPlan:
        """Return the plan that a protocol fixes."""
        return rating_plan(study)

    def plan_of_table(
        self, decisions: pd.DataFrame, name: str, section: RatingTableSection
    ) -> RatingPlan:
        """Return the plan of a table's own conditions."""
        return rating_plan_of_table(decisions, name, section)

    def read(
        self, table: Source, mapping: Mapping[str, str], section: RatingTableSection
    ) -> pd.DataFrame:
        """Read ratings: who gave which to what."""
        by = section.by or None
        return as_decisions(
            read_ratings(table, mapping, by=by, scale=section.scale, option="--set {}=")
        )

    def simulation(self, study: StudyProtocol) -> RatedSteps:
        """Return the simulation of the steps that are given."""
        plan = self.plan(study)
        return RatedSteps(study, plan, self.parts_of(plan))

    def lacks(self, decisions: pd.DataFrame, plan: RatingPlan) -> str:
        """Return the column without which nothing can be compared."""
        rated = len(conditions_of(decisions, plan))
        return lacking(decisions["participant"].nunique(), rated, decisions["rating"].nunique())
