"""Analyses of right and wrong answers: their base, and those of each task and of tables.

`detection` is of yes-no tasks, `psychometric` of a table along a level; all others have d' by the
task's answer rule.
"""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Self, TypeVar

import pandas as pd

from analysis.parts import AnyPart
from analysis.parts.comparisons import ComparisonsPart
from analysis.parts.correct import RatesPart, curve_mistake, odd_answers
from analysis.parts.curves.critical import CriticalPart
from analysis.parts.curves.goodness import GoodnessPart
from analysis.parts.curves.own_curves import OwnCurvesPart
from analysis.parts.interaction import RateInteraction
from analysis.parts.learning import RightLearning
from analysis.parts.levels import SECTION, ThresholdsPart
from analysis.parts.people import PeoplePart
from analysis.parts.random_effects import RightEffects
from analysis.parts.right_models import ModelsPart
from analysis.parts.sensitivity import DiscriminationPart, TypicalPart, YesNoPart
from analysis.parts.times import TimesPart
from analysis.plans.rate_plan import (
    CurvePlan,
    RatePlan,
    prepared,
    rate_plan,
    rate_plan_of_table,
)
from analysis.plans.table_sections import (
    CurveTableSection,
    DetectionTableSection,
    RateTableSection,
    table_section,
)
from analysis.simulations import RightAnswers, Tracks, tabulated
from analysis.tables.table import Source, opened
from analysis.tables.trials import as_decisions, read_trials
from analysis.tasks.base import TaskAnalysis
from protocols.answer_rules import EqualSigns, answer_rule
from protocols.errors import StudyError, did_you_mean
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Task
from protocols.tasks.rates import name_of
from protocols.tasks.single import RightOrWrong


def rate_parts(*sensitivity: AnyPart, levels: Sequence[AnyPart] = ()) -> tuple[AnyPart, ...]:
    """Return the parts of a task with right answers, whose parts of sensitivity are its own.

    `levels` are further ones along the level.
    """
    return (
        RatesPart(),
        *sensitivity,
        *levels,
        ThresholdsPart(),
        OwnCurvesPart(instead=True),
        GoodnessPart(),
        ComparisonsPart(),
        RateInteraction(),
        ModelsPart(),
        RightEffects(ModelsPart()),
        PeoplePart(),
        RightLearning(),
        TimesPart(),
    )


S = TypeVar("S", bound=RateTableSection)


class RatesTask(TaskAnalysis[S, RatePlan]):
    """Shares of right answers, sensitivity, levels, models: whatever the answers are."""

    two: ClassVar[bool] = False
    """There are two answers with a criterion between, of which a table may name one."""
    rule: str = "alternatives"
    """Answer rule, where the section names none."""

    # What differs between tasks.

    @abstractmethod
    def table_answers(self, decisions: pd.DataFrame, section: S) -> tuple[str, ...]:
        """Return the answers that a table without a protocol speaks of."""

    # Plan and tables.

    def plan(self, study: StudyProtocol) -> RatePlan:
        """Return columns, values and rules of a protocol."""
        return rate_plan(study)

    def plan_of_table(self, decisions: pd.DataFrame, name: str, section: S) -> RatePlan:
        """Return the plan of a table's own conditions; without a protocol nothing was planned."""
        answers = self.table_answers(decisions, section)
        return rate_plan_of_table(decisions, name, section, answers, rule=self.rule)

    def read(self, table: Source, section: S) -> pd.DataFrame:
        """Read trials: who was shown what, answered what, and was right or wrong."""
        rows = opened(table)
        wanted = list(section.by_columns)
        if section.interaction is not None and section.interaction not in (section.level, *wanted):
            wanted.append(section.interaction)
        levels = [name for name in (section.level,) if name is not None]
        found = read_trials(rows, conditions=wanted, levels=levels, own=rows.imported, two=self.two)
        # What was mapped is there under our name; it need not be there twice.
        renamed = rows.renamed - {*wanted, section.level}
        return as_decisions(found.drop(columns=renamed, errors="ignore"))

    def table_notes(self, decisions: pd.DataFrame, plan: RatePlan) -> Sequence[str]:
        """Return notes on answers below guessing, or that get worse where they should not."""
        return odd_answers(prepared(decisions, plan), plan)

    def check_table(self, path: Path, decisions: pd.DataFrame, plan: RatePlan) -> None:
        """Refuse conditions and answers that the protocol does not have."""
        rows = prepared(decisions, plan)
        checked = [(plan.by_name, "condition", plan.values)] if plan.by else []
        if "answer" in decisions:
            checked.append(("answer", "answer", plan.answers))
        for name, column, known in checked:
            unknown = sorted(set(rows[column].map(name_of)) - set(known))
            if unknown:
                raise StudyError(
                    f"{path}: {name} must be one of the protocol's ({', '.join(known)})"
                    f" (got {', '.join(unknown)}){did_you_mean(unknown[0], known)}"
                )

    def table(self, decisions: pd.DataFrame, plan: RatePlan) -> pd.DataFrame:
        """Return the decisions with their condition."""
        return prepared(decisions, plan)

    def parts_of(self, plan: RatePlan) -> Sequence[AnyPart]:
        """Return the parts; those of levels first where these decide what is compared."""
        first = plan.adaptive or plan.by_scaling
        return sorted(self.parts, key=lambda part: first and part.section != SECTION)

    # Power.

    def simulation(self, study: StudyProtocol) -> RightAnswers | Tracks:
        """Return the simulation of the study's own cells, with observers of this task."""
        plan = self.plan(study)
        if plan.adaptive:
            return Tracks(study, plan, self.parts_of(plan))
        share = None if self.two else tabulated(plan.answer_rule.share)
        return RightAnswers(study, plan, self.parts_of(plan), share)


class DetectionRates(RatesTask[DetectionTableSection]):
    """Sensitivity and criterion by condition: task `yes-no`."""

    kind = "detection"
    options = DetectionTableSection
    task = "yes-no answers"
    parts = rate_parts(YesNoPart(), TypicalPart())
    two: ClassVar[bool] = True

    def read(self, table: Source, section: DetectionTableSection) -> pd.DataFrame:
        """Read trials; both answers must be there, because d' needs hits and false alarms."""
        table = opened(table)
        rows = super().read(table, section)
        if "answer" not in rows or (rows["answer"] == "").any():
            raise StudyError(
                f"{table.path}: must have the columns expected and answer: whether answers were"
                " right does not tell hits from correct rejections; say which columns hold them:"
                f" {table.cure('--map expected=COLUMN')} --map answer=COLUMN (one of both is enough"
                " beside correct)"
            )
        return rows

    def table_answers(
        self, decisions: pd.DataFrame, section: DetectionTableSection
    ) -> tuple[str, ...]:
        """Return the signal's answer and the other.

        Raises
        ------
        StudyError
            If the table does not speak of two answers, one of them the signal's.
        """
        signal = section.signal
        found = sorted({*decisions["expected"].map(str), *decisions["answer"].map(str)})
        if signal not in found or len(found) > 2:
            raise StudyError(
                "--set signal: must be the answer that is right where the signal is, one of two"
                f" that the columns expected and answer hold (got {signal!r}; they hold"
                f" {', '.join(found)})"
            )
        others = [answer for answer in found if answer != signal]
        return (signal, others[0] if others else f"not {signal}")


class DiscriminationRates(RatesTask[RateTableSection]):
    """Shares of right answers, and d' by the task's answer rule.

    d' of stimuli that are told apart by how much they differ is also fitted against the level.
    """

    def __init__(self, task: type[RightOrWrong]) -> None:
        self.kind, self.task = task.analysis.own_kind(), task.decisions
        self.rule, self._named = task.rule, task.every_answer
        self.options = table_section(task.analysis, open_ended=not self._named)
        apart = isinstance(answer_rule(self.rule), EqualSigns)
        self.parts = rate_parts(
            DiscriminationPart(sides=len(self._named) == 2), levels=(CriticalPart(),) * apart
        )

    @classmethod
    def of(cls, task: type[Task]) -> Self:
        """Return the analysis of a task with right answers."""
        assert issubclass(task, RightOrWrong)
        return cls(task)

    def table_answers(self, decisions: pd.DataFrame, section: RateTableSection) -> tuple[str, ...]:
        """Return the answers: as the table names them, if it names all.

        Where tasks differ in them, numbers are in the place of those that it does not name.

        Raises
        ------
        StudyError
            If nothing says how many there were, or the table holds more.
        """
        if self._named:
            said = tuple(sorted(set(decisions.get("answer", pd.Series()).map(str)) - {""}))
            return said if len(said) == len(self._named) else self._named
        asked = getattr(section, "alternatives", None)
        found: list[str] = []
        if {"expected", "answer"} <= set(decisions.columns):
            found = sorted({*decisions["expected"].map(str), *decisions["answer"].map(str)} - {""})
        count = asked or len(found)
        if count < max(2, len(found)):
            raise StudyError(
                "--set alternatives: must say how many answers there were to choose from (got"
                f" {asked or 'nothing'}; the columns expected and answer hold"
                f" {len(found)}: {', '.join(found[:8]) or 'none'})"
            )
        return (*found, *(f"answer {number + 1}" for number in range(len(found), count)))


class TableOfLevels(RatesTask[CurveTableSection]):
    """Psychometric functions of each person and of all people."""

    kind = "psychometric"
    task = "answers"
    options = CurveTableSection
    parts = (
        ThresholdsPart(),
        GoodnessPart(),
        OwnCurvesPart(),
    )

    def table_answers(
        self, _decisions: pd.DataFrame, _section: CurveTableSection
    ) -> tuple[str, ...]:
        """Return names for right and wrong answers: their number is not asked for."""
        return ("right", "wrong")

    def plan_of_table(
        self, decisions: pd.DataFrame, name: str, section: CurveTableSection
    ) -> RatePlan:
        """Return the plan of the table; without `by` all answers are of one condition."""
        if not section.by:
            decisions = decisions.drop(columns="method", errors="ignore")
        answers = self.table_answers(decisions, section)
        return rate_plan_of_table(decisions, name, section, answers, CurvePlan)

    def read(self, table: Source, section: CurveTableSection) -> pd.DataFrame:
        """Read trials; refuse levels along which no psychometric function can run."""
        table = opened(table)
        if section.level is None:
            raise StudyError(f"{table.path}: --set level must name the column of levels")
        rows = super().read(table, section)
        levels = rows[section.level]
        if (section.log or section.shape == "weibull") and bool((levels <= 0).any()):
            raise StudyError(
                f"{table.path}: {section.level} must be above 0 in every row to have a logarithm"
                f" (least: {levels.min():g}); leave the others out with --where"
                f" '{section.level}>0', or leave --log away"
            )
        if levels.nunique() < 2:
            raise StudyError(
                f"{table.path}: {section.level} must hold two levels or more (found 1)"
            )
        if mistake := curve_mistake(rows, section.level, section.guess, falling=section.falling):
            raise StudyError(f"{table.path}: {mistake}")
        return rows

    def table_notes(self, _decisions: pd.DataFrame, _plan: RatePlan) -> Sequence[str]:
        """Return nothing: mistakes were refused."""
        return ()
