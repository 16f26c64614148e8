"""What the analyses of tasks with right answers share, as a base class."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.parts import AnyPart
from analysis.parts.comparisons import ComparisonsPart
from analysis.parts.confidence import ConfidencePart
from analysis.parts.correct import RatesPart, odd_answers
from analysis.parts.graded import MetacognitionPart
from analysis.parts.learning import RightLearning
from analysis.parts.levels import SECTION, CurvesPart, ThresholdsPart
from analysis.parts.people import PeoplePart
from analysis.parts.random_effects import RightEffects, TimeEffects
from analysis.parts.right_models import ModelsPart
from analysis.parts.times import TimesPart
from analysis.plans.rates import (
    RateSettings,
    common_settings,
    common_settings_of_table,
    prepared,
)
from analysis.tables.table import Source, opened
from analysis.tables.trials import as_decisions, read_trials
from analysis.tasks.base import (
    Assumption,
    Counted,
    PowerReport,
    TaskAnalysis,
)
from analysis.tasks.rates.pilot import sensitivity_deviations, threshold_deviations
from analysis.tasks.rates.power import (
    Draw,
    Judge,
    assumptions,
    judge_shares,
    looked_p_values,
    rate_power,
)
from protocols.adaptive.section import AdaptiveLevels
from protocols.errors import StudyError
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
        ModelsPart(),
        RightEffects(ModelsPart()),
        PeoplePart(),
        ConfidencePart(),
        MetacognitionPart(),
        RightLearning(),
        TimesPart(),
        TimeEffects(TimesPart()),
    )


class RatesTask(TaskAnalysis[RateSettings]):
    """Shares of right answers, sensitivity, levels, models: whatever the answers are."""

    two: ClassVar[bool] = False
    """There are two answers, of which a table may name one."""

    # What differs between tasks.

    @abstractmethod
    def table_answers(self, decisions: pd.DataFrame, told: Any) -> tuple[str, ...]:
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

    # Settings and tables.

    def settings(self, study: StudyProtocol) -> RateSettings:
        """Return columns, values and rules of a protocol."""
        return common_settings(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, told: Any) -> RateSettings:
        """Return what was told; without a protocol nothing was planned."""
        return common_settings_of_table(decisions, name, told, self.table_answers(decisions, told))

    def read(self, table: Source, mapping: Mapping[str, str], told: Any) -> pd.DataFrame:
        """Read trials: who was shown what, answered what, and was right or wrong."""
        rows = opened(table, mapping)
        wanted = list(told.by_columns)
        levels = [name for name in (told.level,) if name is not None]
        found = read_trials(rows, conditions=wanted, levels=levels, own=rows.imported, two=self.two)
        # What was mapped is there under our name; it need not be there twice.
        renamed = rows.renamed - {*wanted, told.level}
        return as_decisions(found.drop(columns=renamed, errors="ignore"))

    def table_notes(self, decisions: pd.DataFrame, settings: RateSettings) -> Sequence[str]:
        """Return whether answers are below guessing, or get worse where they should not."""
        return odd_answers(prepared(decisions, settings), settings)

    def check_table(self, path: Path, decisions: pd.DataFrame, settings: RateSettings) -> None:
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
                    f" (got {', '.join(unknown)})"
                )

    def table(self, decisions: pd.DataFrame, settings: RateSettings) -> pd.DataFrame:
        """Return the decisions with their condition."""
        return prepared(decisions, settings)

    def parts_of(self, settings: RateSettings) -> Sequence[AnyPart]:
        """Return the parts; where levels were chosen from the answers, thresholds come first."""
        return sorted(self.parts, key=lambda part: settings.adaptive and part.section != SECTION)

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
