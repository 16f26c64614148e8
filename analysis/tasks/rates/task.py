"""What the analyses of tasks with right answers share, as a base class."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.clustered import least_p
from analysis.parts import AnyPart
from analysis.parts.correct import RatesPart, odd_answers
from analysis.parts.differences import ComparisonsPart
from analysis.parts.interaction import RateInteraction
from analysis.parts.learning import RightLearning
from analysis.parts.levels import SECTION, CurvesPart, ThresholdsPart
from analysis.parts.people import PeoplePart
from analysis.parts.right_models import ModelsPart
from analysis.parts.times import TimesPart
from analysis.plans.rates import (
    RateSettings,
    RatesOptions,
    by_columns,
    common_settings,
    common_settings_of_table,
    prepared,
)
from analysis.tables.table import Source, opened
from analysis.tables.trials import answer_columns, as_decisions, read_trials
from analysis.tasks.base import (
    Assumption,
    Counted,
    PowerReport,
    TableOptions,
    TaskAnalysis,
)
from analysis.tasks.rates.pilot import sensitivity_deviations, threshold_deviations
from analysis.tasks.rates.power import (
    Draw,
    Judge,
    assumptions,
    cell_design,
    judge_shares,
    looked_p_values,
    rate_power,
)
from protocols.adaptive.section import AdaptiveLevels
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.prose import count_of
from protocols.schema import StudyProtocol
from protocols.tasks.rates import name_of

Floats = NDArray[np.float64]


def rate_parts(*sensitivity: AnyPart, levels: Sequence[AnyPart] = ()) -> tuple[AnyPart, ...]:
    """Return the parts of a task with right answers, whose parts of sensitivity are its own.

    `levels` are further ones along the level.
    """
    return (
        RatesPart(),
        *sensitivity,
        CurvesPart(),
        ThresholdsPart(),
        *levels,
        ComparisonsPart(),
        RateInteraction(),
        ModelsPart(),
        PeoplePart(),
        RightLearning(),
        TimesPart(),
    )


class RatesTask(TaskAnalysis[RateSettings]):
    """Shares of right answers, sensitivity, levels, models: whatever the answers are."""

    options: ClassVar[type[TableOptions]] = RatesOptions
    two: ClassVar[bool] = False
    """There are two answers, of which a table may name one."""

    # What differs between tasks.

    @abstractmethod
    def table_answers(self, decisions: pd.DataFrame, options: Any) -> tuple[str, ...]:
        """Return the answers that a table without a protocol speaks of."""

    def draw(self, settings: RateSettings) -> Draw:
        """Return how an observer of a given sensitivity answers, for simulating power."""
        share = self.share_of(settings)
        assert share is not None, "a task with a criterion draws by itself"
        return lambda d_prime, _criterion, _design, _typical: share(d_prime)

    def judge(self) -> Judge:
        """Return the planned test, for simulating power; by default of differences of shares."""
        return judge_shares

    def simulated_p(
        self,
        study: StudyProtocol,
        assumed: Mapping[str, float],
        participants: Sequence[int],
        *,
        null: bool,
        rng: np.random.Generator,
        studies: int,
        progress: Counted | None = None,
    ) -> NDArray[np.float64]:
        """Simulate the study's own cells, and make its planned comparisons."""
        settings = self.settings(study)
        return looked_p_values(
            study,
            settings,
            assumed,
            participants,
            self.draw(settings),
            self.judge(),
            null=null,
            rng=rng,
            studies=studies,
            progress=progress,
        )

    def least_p(self, study: StudyProtocol, people: int) -> float:
        """Return the least adjusted p of shares or d'; of thresholds any can be had."""
        settings, count = self.settings(study), self.family(study)
        if settings.adaptive:
            return 0.0
        toward = min(settings.chance, 1.0 - settings.chance) if count == 0 else 0.5
        return min(1.0, max(count, 1) * float(least_p(people, toward)))

    def family(self, study: StudyProtocol) -> int:
        """Return the number of comparisons with the baseline."""
        settings = self.settings(study)
        if settings.adaptive or len(settings.values) < 2:
            return 0
        design = cell_design(study.task.cells(study.pool), settings, study.design.repeats)
        shown = design.sensed if settings.kind == "detection" else settings.values
        return max(len(shown) - 1, 1) if settings.correction == "holm" else 1

    # Settings and tables.

    def settings(self, study: StudyProtocol) -> RateSettings:
        """Return columns, values and rules of a protocol."""
        return common_settings(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> RateSettings:
        """Return what the options say; without a protocol nothing was planned."""
        answers = self.table_answers(decisions, options)
        return common_settings_of_table(decisions, name, self.kind, options, answers)

    def options_of(self, settings: RateSettings) -> TableOptions:
        """Return the options that say the same."""
        held = vars(settings) | {
            "baseline": settings.baseline if settings.by is not None else None,
            "guess": settings.guess,
            "signal": next(iter(settings.answers), ""),
        }
        return self.options(
            **{name: held[name] for name in self.options.model_fields & held.keys()}
        )

    def read(self, table: Source, mapping: Mapping[str, str], options: Any) -> pd.DataFrame:
        """Read trials: who was shown what, answered what, and was right or wrong."""
        rows = opened(table, mapping)
        wanted = list(by_columns(options.by))
        if options.interaction not in (None, options.level, *wanted):
            wanted.append(options.interaction)
        levels = [name for name in (options.level,) if name is not None]
        found = read_trials(rows, conditions=wanted, levels=levels, own=rows.imported, two=self.two)
        # What was mapped is there under our name; it need not be there twice.
        renamed = rows.renamed - {*wanted, options.level}
        return as_decisions(found.drop(columns=renamed, errors="ignore"))

    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of the table: ours, and those of its conditions."""
        return answer_columns(decisions)

    def table_notes(self, decisions: pd.DataFrame, settings: RateSettings) -> Sequence[str]:
        """Return whether answers are below guessing, or get worse where they should not."""
        return odd_answers(prepared(decisions, settings), settings)

    def check_table(self, path: Path, decisions: pd.DataFrame, settings: RateSettings) -> None:
        """Refuse conditions and answers that the protocol does not have."""
        rows = prepared(decisions, settings)
        checked = [(settings.by, "condition", settings.values)] if settings.by else []
        if "answer" in decisions:
            checked.append(("answer", "answer", settings.answers))
        for name, column, known in checked:
            unknown = sorted(set(rows[column].map(name_of)) - set(known))
            if unknown:
                raise StudyError(
                    f"{path}: {name} must be one of the protocol's ({', '.join(known)})"
                    f" (got {', '.join(unknown)})"
                )

    def table(self, decisions: pd.DataFrame, settings: RateSettings) -> pd.DataFrame:
        """Return the decisions with their condition."""
        return prepared(decisions, settings)

    def parts_of(self, settings: RateSettings) -> Sequence[AnyPart]:
        """Return the parts; where levels were chosen from the answers, thresholds come first."""
        return sorted(self.parts, key=lambda part: settings.adaptive and part.section != SECTION)

    def counted(self, settings: RateSettings) -> str:
        """Return how many conditions are compared."""
        return count_of(len(settings.values), "condition")

    # Power.

    def assumptions(self, study: StudyProtocol) -> tuple[Assumption, ...]:
        """Return d' of the baseline, what the others have more, and how people differ."""
        scenes = {cell.scene for cell in study.task.cells(study.pool)}
        return assumptions(self.settings(study), len(scenes))

    def from_pilot(
        self, study: StudyProtocol, decisions: pd.DataFrame, settings: RateSettings
    ) -> tuple[Mapping[str, float], Sequence[str]]:
        """Return how much d' of a pilot's participants and scenes differs, or their thresholds."""
        own = self.settings(study)
        if own.adaptive != settings.adaptive:
            raise StudyError(
                "--from: must hold levels chosen as the study chooses them"
                f" ({'adaptive' if own.adaptive else 'constant'}); give deviations by --set"
            )
        if own.adaptive:
            levels = study.task.adaptation
            assert isinstance(levels, AdaptiveLevels)
            span = float(np.ptp(levels.levels(study.task, study.pool)))
            return threshold_deviations(decisions, settings, span)
        return sensitivity_deviations(decisions, settings, self.share_of(settings))

    def share_of(self, _settings: RateSettings) -> Callable[[Floats], Floats] | None:
        """Return the chance of a right answer by d'; None where answers have a criterion."""
        return None

    def beside(self) -> tuple[str, Judge] | None:
        """Return a further measure that power is simulated of, and its test; by default none."""
        return None

    def power(
        self,
        study: StudyProtocol,
        assumed: Mapping[str, float],
        *,
        rng: np.random.Generator,
        studies: int | None = None,
        progress: Counted | None = None,
    ) -> PowerReport:
        """Simulate the study's own cells with observers of this task."""
        settings = self.settings(study)
        return rate_power(
            study,
            settings,
            assumed,
            self.draw(settings),
            self.judge(),
            beside=self.beside(),
            rng=rng,
            studies=studies,
            progress=progress,
        )
