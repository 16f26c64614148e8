"""The analysis of ordered ratings, kind `ratings`."""

import pandas as pd

from analysis.models.ordinal import lacking
from analysis.parts.learning import StepLearning
from analysis.parts.random_effects import RatingEffects
from analysis.parts.ratings import RatingsPart
from analysis.parts.times import TimesPart
from analysis.plans.rating_plan import RatingPlan
from analysis.plans.table_sections import RatingTableSection
from analysis.simulations import RatedSteps
from analysis.tables.rating_table import read_ratings
from analysis.tables.table import Source
from analysis.tables.trials import as_decisions
from analysis.tasks.base import TaskAnalysis
from protocols.errors import StudyError
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rating import Rating, RatingsAnalysis


class RatingsTask(TaskAnalysis[RatingTableSection, RatingPlan]):
    """A cumulative-link mixed model of ratings, or of graded comparisons of pairs."""

    kind = "ratings"
    task = "ratings"
    parts = (
        RatingsPart(),
        RatingEffects(RatingsPart()),
        StepLearning(),
        TimesPart(),
    )
    options = RatingTableSection

    def plan(self, study: StudyProtocol) -> RatingPlan:
        """Return the plan that a protocol fixes.

        Raises
        ------
        StudyError
            If it is no study of ratings.
        """
        analysis, task = study.analysis, study.task
        if not (isinstance(analysis, RatingsAnalysis) and isinstance(task, Rating)):
            raise StudyError(
                f"analysis.kind: must be 'ratings' with the task 'rating' (got {analysis.kind!r}"
                f" with {task.kind!r})"
            )
        return RatingPlan(
            section=analysis,
            study=study.study.name,
            title=study.study.title,
            protocol_sha256=study.sha256,
            scale=task.scale,
        )

    def plan_of_table(
        self, decisions: pd.DataFrame, name: str, section: RatingTableSection
    ) -> RatingPlan:
        """Return the plan of a table's own conditions."""
        section = section.model_copy(update={"reaction": "models"})
        plan = RatingPlan(section=section, study=name, title=name, scale=section.scale)
        plan.check_known(plan.conditions_of(decisions), "one of the conditions")
        return plan

    def read(self, table: Source, section: RatingTableSection) -> pd.DataFrame:
        """Read ratings: who gave which to what."""
        by = section.by or None
        return as_decisions(read_ratings(table, by=by, scale=section.scale, option="--set {}="))

    def simulation(self, study: StudyProtocol) -> RatedSteps:
        """Return the simulation of the steps that are given."""
        plan = self.plan(study)
        return RatedSteps(study, plan, self.parts_of(plan))

    def lacks(self, decisions: pd.DataFrame, plan: RatingPlan) -> str:
        """Return the column without which nothing can be compared."""
        rated = len(plan.conditions_of(decisions))
        return lacking(decisions["participant"].nunique(), rated, decisions["rating"].nunique())
