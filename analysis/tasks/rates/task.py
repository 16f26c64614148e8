"""What the analyses of tasks with right answers share, as a base class."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.detection import YesNoResults
from analysis.exclusions import FlowStep
from analysis.report.wording import leading, left_out_sentence
from analysis.tables.table import Source, opened
from analysis.tasks.base import (
    Assumption,
    Counted,
    Estimate,
    PowerReport,
    Step,
    TableOptions,
    TaskAnalysis,
)
from analysis.tasks.blocks import Block, ReportFigure, Section
from analysis.tasks.rates.estimates import rate_estimates
from analysis.tasks.rates.figures import rate_figures
from analysis.tasks.rates.pilot import sensitivity_deviations, threshold_deviations
from analysis.tasks.rates.power import (
    Draw,
    Judge,
    assumptions,
    judge_shares,
    looked_p_values,
    rate_power,
)
from analysis.tasks.rates.sections import lead, sections
from analysis.tasks.rates.settings import (
    RateSettings,
    RatesOptions,
    common_settings,
    common_settings_of_table,
    prepared,
)
from analysis.tasks.rates.study import RateResults, odd_answers
from analysis.tasks.rates.tables import answer_columns, read_answers, result_tables
from analysis.tasks.rates.wording import (
    apa_critical,
    apa_difference,
    apa_discrimination,
    apa_rate,
    apa_term,
    apa_thresholds,
    apa_trend,
    apa_yes_no,
    methods_discrimination,
    methods_yes_no,
)
from protocols.adaptive.section import AdaptiveLevels
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.tasks.rates import name_of

Floats = NDArray[np.float64]


class RatesTask(TaskAnalysis[RateSettings, RateResults]):
    """Shares of right answers, sensitivity, levels, models: whatever the answers are."""

    options: ClassVar[type[TableOptions]] = RatesOptions
    task: ClassVar[str]
    """What a trial is called in a sentence."""

    # What differs between tasks.

    @abstractmethod
    def analyse(self, decisions: pd.DataFrame, settings: RateSettings, step: Step) -> RateResults:
        """Return every result that a report shows."""

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

    def estimates(self, decisions: pd.DataFrame, settings: RateSettings) -> Sequence[Estimate]:
        """Return shares of right answers and what they differ by; thresholds where levels adapt."""
        return rate_estimates(decisions, settings)

    def planned_p(self, results: RateResults) -> float | None:
        """Return the least adjusted p of the planned comparisons; of a single condition its own."""
        if results.comparisons:
            return min(one.p_adjusted for one in results.comparisons)
        return results.rates[0].p if len(results.rates) == 1 else None

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

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> RateSettings:
        """Return what the options say; without a protocol nothing was planned."""
        answers = self.table_answers(decisions, options)
        return common_settings_of_table(decisions, name, self.kind, options, answers)

    def options_of(self, settings: RateSettings) -> RatesOptions:
        """Return the options that say the same."""
        return RatesOptions(**self._shared_options(settings))

    def _shared_options(self, settings: RateSettings) -> dict[str, Any]:
        return {
            "by": settings.by,
            "baseline": settings.baseline if settings.by is not None else None,
            "level": settings.level,
            "falling": settings.falling,
            "test": settings.test,
            "correction": settings.correction,
            "alpha": settings.alpha,
            "shape": settings.shape,
            "reaction": settings.reaction,
        }

    def read(
        self, table: Source, mapping: Mapping[str, str], options: Any, *, own: bool = True
    ) -> pd.DataFrame:
        """Read trials: who was shown what, answered what, and was right or wrong."""
        return read_answers(opened(table, mapping), options, own=own)

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

    def tables(self, _decisions: pd.DataFrame, results: RateResults) -> Mapping[str, pd.DataFrame]:
        """Return rates, comparisons, levels and thresholds."""
        return result_tables(results)

    # The page.

    def warnings(self, results: RateResults) -> tuple[str, ...]:
        """Return what is odd about the study as a whole."""
        return results.warnings

    def counted(self, settings: RateSettings) -> str:
        """Return how many conditions are compared."""
        count = len(settings.values)
        return f"{count} condition{'s' * (count != 1)}"

    def lead(self, results: RateResults, settings: RateSettings) -> Sequence[Block]:
        """Return the planned comparisons."""
        return lead(results, settings)

    def sections(self, results: RateResults, settings: RateSettings) -> Sequence[Section]:
        """Return right answers, sensitivity, levels, models, people, checks."""
        return sections(results, settings)

    def figures(
        self,
        decisions: pd.DataFrame,
        results: RateResults,
        settings: RateSettings,
        *,
        simulated: bool,
    ) -> Sequence[ReportFigure]:
        """Return the figures of all sections."""
        return rate_figures(decisions, results, settings, simulated=simulated)

    def methods(
        self,
        results: RateResults,
        settings: RateSettings,
        *,
        people: int,
        decisions: int,
        flow: Sequence[FlowStep],
        version: str,
    ) -> str:
        """Return how right and wrong answers were analysed."""
        text = f"We analysed {decisions} {self.task} of {people} participant{'s' * (people != 1)}"
        if len(settings.values) > 1:
            names = ", ".join(settings.label(name) for name in settings.values)
            text += f" in {len(settings.values)} conditions ({names})"
        text += ". "
        if settings.protocol_sha256:
            text += left_out_sentence(flow)
        found = results.sensitivity
        if isinstance(found, YesNoResults):
            text += methods_yes_no(found)
        else:
            text += methods_discrimination(found)
        if results.counts:
            text += (
                f" Psychometric functions over {settings.level} were fitted by maximum likelihood"
                " with a guess rate of chance."
            )
        if results.thresholds is not None:
            effects = ["participants"]
            if results.thresholds.scene_sd:
                effects.append("scenes")
            if len(results.thresholds.thresholds) > 1:
                effects += [f"{effect} x conditions" for effect in effects]
            text += (
                " Thresholds in the population come from one mixed model of all trials, random"
                f" over {', '.join(effects)}, with a lapse rate of each participant, drawn"
                " towards small ones (adaptive quadrature over participants"
                f"{', then Laplace approximation' if results.thresholds.scene_sd else ''})."
            )
        if results.critical:
            text += (
                " Critical scalings were fitted to the answers with critical scaling and gain"
                " random over participants."
            )
        if results.models is not None:
            groups = results.groups
            text += (
                f" Logistic models, {results.models.independent.formula}, are given with trials as"
                f" independent, with standard errors clustered by {' and '.join(groups)}, and with"
                f" {'both as crossed' if len(groups) > 1 else f'{groups[0]}s as'} random"
                " intercepts and effects that differ between them, by t of participants - 1."
            )
        corrected = ", Holm-adjusted" if settings.correction == "holm" else ", not adjusted"
        if len(results.comparisons) > 1:
            text += (
                f" {len(results.comparisons)} comparisons with"
                f" {settings.label(results.comparisons[0].second)} were planned{corrected}."
            )
        return (
            f"{text} Tests are two-sided, alpha = {leading(f'{settings.alpha:g}')}. Analyses were"
            f" run with metamerlab {version}."
        )

    def sentences(self, results: RateResults, settings: RateSettings) -> Sequence[str]:
        """Return rates, sensitivities, comparisons, levels, models and trends as sentences."""
        label = settings.label
        found = [apa_rate(one, name=label(one.condition)) for one in results.rates]
        sensitivity = results.sensitivity
        if isinstance(sensitivity, YesNoResults):
            found += [
                apa_yes_no(
                    replace(one, bias_answer=label(one.bias_answer)), name=label(one.condition)
                )
                for one in sensitivity.conditions
            ]
        else:
            found += [
                apa_discrimination(one, sensitivity.rule, name=label(one.condition))
                for one in sensitivity.conditions
            ]
        found += [apa_difference(one) for one in results.comparisons]
        if results.thresholds is not None:
            shown = [level for one in results.counts.values() for level in one.levels]
            found.append(apa_thresholds(results.thresholds, levels=shown))
        found += [apa_critical(one) for one in results.critical]
        if results.models is not None:
            mixed = results.models.mixed
            found += [
                apa_term(mixed, one.term) for one in mixed.coefficients if one.term != "Intercept"
            ]
        return [*found, *(apa_trend(one) for _, one in results.learning)]

    def headline(self, results: RateResults, settings: RateSettings) -> str:
        """Return the first planned comparison, or the first condition."""
        if results.comparisons:
            return apa_difference(results.comparisons[0])
        first = results.rates[0]
        return apa_rate(first, name=settings.label(first.condition))

    # Power.

    def assumptions(self, study: StudyProtocol) -> tuple[Assumption, ...]:
        """Return d' of the baseline, what the others have more, and how people differ."""
        scenes = {cell.scene for cell in study.task.cells(study, study.main_scenes())}
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
            return threshold_deviations(decisions, settings, float(np.ptp(levels.levels(study))))
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
