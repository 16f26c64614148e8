"""Base class of the analyses of tasks with right answers."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from analysis.arrays import Floats
from analysis.parts import AnyPart
from analysis.parts.comparisons import ComparisonsPart
from analysis.parts.correct import RatesPart, odd_answers
from analysis.parts.curves.goodness import GoodnessPart
from analysis.parts.interaction import RateInteraction
from analysis.parts.learning import RightLearning
from analysis.parts.levels import SECTION, CurvesPart, ThresholdsPart
from analysis.parts.people import PeoplePart
from analysis.parts.random_effects import RightEffects, TimeEffects
from analysis.parts.right_models import ModelsPart
from analysis.parts.times import TimesPart
from analysis.plans.rate_plan import (
    RatePlan,
    common_settings,
    common_settings_of_table,
    prepared,
)
from analysis.simulations import RightAnswers, Tracks
from analysis.tables.table import Source, opened
from analysis.tables.trials import as_decisions, read_trials
from analysis.tasks.base import TaskAnalysis
from protocols.errors import StudyError, did_you_mean
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rates import name_of


def rate_parts(*sensitivity: AnyPart, levels: Sequence[AnyPart] = ()) -> tuple[AnyPart, ...]:
    """Return the parts of a task with right answers, whose parts of sensitivity are its own.

    `levels` are further ones along the level.
    """
    return (
        RatesPart(),
        *sensitivity,
        CurvesPart(),
        ThresholdsPart(),
        GoodnessPart(),
        *levels,
        ComparisonsPart(),
        RateInteraction(),
        ModelsPart(),
        RightEffects(ModelsPart()),
        PeoplePart(),
        RightLearning(),
        TimesPart(),
        TimeEffects(TimesPart()),
    )


class RatesTask(TaskAnalysis[RatePlan]):
    """Shares of right answers, sensitivity, levels, models: whatever the answers are."""

    two: ClassVar[bool] = False
    """There are two answers, of which a table may name one."""

    # What differs between tasks.

    @abstractmethod
    def table_answers(self, decisions: pd.DataFrame, told: Any) -> tuple[str, ...]:
        """Return the answers that a table without a protocol speaks of."""

    # PreferencePlan and tables.

    def settings(self, study: StudyProtocol) -> RatePlan:
        """Return columns, values and rules of a protocol."""
        return common_settings(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, told: Any) -> RatePlan:
        """Return the plan that was told; without a protocol nothing was planned."""
        return common_settings_of_table(decisions, name, told, self.table_answers(decisions, told))

    def read(self, table: Source, mapping: Mapping[str, str], told: Any) -> pd.DataFrame:
        """Read trials: who was shown what, answered what, and was right or wrong."""
        rows = opened(table, mapping)
        wanted = list(told.by_columns)
        if told.interaction not in (None, told.level, *wanted):
            wanted.append(told.interaction)
        levels = [name for name in (told.level,) if name is not None]
        found = read_trials(rows, conditions=wanted, levels=levels, own=rows.imported, two=self.two)
        # What was mapped is there under our name; it need not be there twice.
        renamed = rows.renamed - {*wanted, told.level}
        return as_decisions(found.drop(columns=renamed, errors="ignore"))

    def table_notes(self, decisions: pd.DataFrame, settings: RatePlan) -> Sequence[str]:
        """Return notes on answers below guessing, or that get worse where they should not."""
        return odd_answers(prepared(decisions, settings), settings)

    def check_table(self, path: Path, decisions: pd.DataFrame, settings: RatePlan) -> None:
        """Refuse conditions and answers that the protocol does not have."""
        rows = prepared(decisions, settings)
        checked = [(settings.by_name, "condition", settings.values)] if settings.by else []
        if "answer" in decisions:
            checked.append(("answer", "answer", settings.answers))
        for name, column, known in checked:
            unknown = sorted(set(rows[column].map(name_of)) - set(known))
            if unknown:
                raise StudyError(
                    f"{path}: {name} must be one of the protocol's ({', '.join(known)})"
                    f" (got {', '.join(unknown)}){did_you_mean(unknown[0], known)}"
                )

    def table(self, decisions: pd.DataFrame, settings: RatePlan) -> pd.DataFrame:
        """Return the decisions with their condition."""
        return prepared(decisions, settings)

    def parts_of(self, settings: RatePlan) -> Sequence[AnyPart]:
        """Return the parts; where levels were chosen from the answers, thresholds come first."""
        return sorted(self.parts, key=lambda part: settings.adaptive and part.section != SECTION)

    # Power.

    def share_of(self, _settings: RatePlan) -> Callable[[Floats], Floats] | None:
        """Return the chance of a right answer by d'; None where answers have a criterion."""
        return None

    def simulation(self, study: StudyProtocol) -> RightAnswers | Tracks:
        """Return the simulation of the study's own cells, with observers of this task."""
        plan = self.settings(study)
        if plan.adaptive:
            return Tracks(study, plan, self.parts_of(plan))
        return RightAnswers(study, plan, self.parts_of(plan), self.share_of(plan))
