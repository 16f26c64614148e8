"""Plan of the analyses of tasks with right answers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import pandas as pd

from analysis.models.curves.response import CurveForm
from analysis.parts import AnalysisPlan, SectionKey
from analysis.plans.table_sections import RateTableSection, check_contrasts
from protocols.adaptive.answer_history import Shape
from protocols.adaptive.section import AdaptiveLevels
from protocols.answer_rules import AnswerRule, EqualSigns, answer_rule
from protocols.errors import StudyError, count_of, did_you_mean
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rates import BETWEEN, TAKEN, RatesAnalysis, name_of
from protocols.tasks.single import RightOrWrong

EVERYTHING = "all"
"""Name of the condition where nothing is compared."""


@dataclass(frozen=True, kw_only=True)
class RatePlan(AnalysisPlan):
    """Names and rules of the analysis of right and wrong answers."""

    section: RatesAnalysis
    values: tuple[str, ...]
    """Values of `by` that are compared, in order, the baseline first."""
    adaptive: bool = False
    """Levels were chosen from the answers: shares of right answers say nothing, thresholds do."""
    answers: tuple[str, ...]
    """All that can be answered, the signal's first; empty where a table does not say."""
    alternatives: int
    """Number of answers: chance is 1 / alternatives."""
    signal: str = ""
    labels: Mapping[str, str]
    planned_participants: int | None = None
    planned_trials: int | None = None
    rule: str = "alternatives"
    """Name of the answer rule, by which participants are taken to decide."""
    guess: float | None
    """Rate of guessing of psychometric functions; None: unknown."""
    log: bool = False
    shape: Shape = "gauss"
    """Shape of psychometric functions: an adaptive rule's, else ``gauss``."""

    by = SectionKey[str | tuple[str, ...]]()
    by_columns = SectionKey[tuple[str, ...]]()
    by_name = SectionKey[str]()
    level = SectionKey[str | None]()
    falling = SectionKey[bool]()
    claimed_level = SectionKey[float | None](None)
    test = SectionKey[Literal["participant-scene", "participant"]]()
    correction = SectionKey[Literal["holm", "none"]]()
    interaction = SectionKey[str | None]()

    @property
    def chance(self) -> float:
        """Share of right answers by guessing."""
        return 1.0 / self.alternatives

    @property
    def by_threshold(self) -> bool:
        """True if thresholds decide whether conditions differ, and shares of right answers not."""
        return self.adaptive and not self.by_scaling

    @property
    def answer_rule(self) -> AnswerRule:
        """Share of right answers of an unbiased observer by d', and back."""
        return answer_rule(self.rule, self.alternatives)

    @property
    def by_scaling(self) -> bool:
        """True if the level is how much two stimuli pool, whose critical scalings are compared."""
        return (
            self.level is not None and not self.falling and isinstance(self.answer_rule, EqualSigns)
        )

    @property
    def logarithmic(self) -> bool:
        """True if psychometric functions are of the logarithm of levels."""
        return self.log or self.shape == "weibull"

    @property
    def curve(self) -> CurveForm:
        """Form of psychometric functions."""
        return CurveForm(
            self.guess, shape=self.shape, falling=self.falling, logarithmic=self.logarithmic
        )

    @property
    def counted(self) -> str:
        """Number of conditions compared, in words."""
        return count_of(len(self.values), "condition")

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions, which parts find beside those of the table."""
        return (TAKEN,)

    @property
    def compared_columns(self) -> tuple[str, ...]:
        """The columns whose values make conditions."""
        return tuple(self.by_columns)

    @property
    def compared_title(self) -> str:
        """Heading of conditions."""
        return "Condition"

    def in_order(self, names: Sequence[str]) -> list[str]:
        """Return conditions as the study declares them."""
        place = {name: index for index, name in enumerate(self.values)}
        return sorted(names, key=lambda name: place.get(name, len(place)))

    def reference_in(self, names: Sequence[str]) -> str | None:
        """Return the first of these conditions, where there are others to compare it with."""
        return self.in_order(names)[0] if len(names) > 1 else None

    def label(self, name: str) -> str:
        """Return the words that reports print for a value of a condition."""
        if name in self.labels:
            return self.labels[name]
        return BETWEEN.join(self.labels.get(part, part) for part in name.split(BETWEEN))


def combined(values: Iterable[object]) -> str:
    """Return the values of these columns as the name of a condition."""
    return BETWEEN.join(map(name_of, values))


def rate_plan(study: StudyProtocol) -> RatePlan:
    """Return the plan that a protocol fixes.

    Values of `by` that no trial shows, such as a standard, are left out.
    """
    analysis, task, pool = study.analysis, study.task, study.pool
    if not (isinstance(analysis, RatesAnalysis) and isinstance(task, RightOrWrong)):
        raise TypeError(f"a task with right answers is needed (got task {task.kind!r})")
    cells = task.cells(pool)
    columns = analysis.by_columns
    conditions = [cell.arrangements[0].condition for cell in cells]
    shown = [combined(one.get(column) for column in columns) for one in conditions]
    # As declared; combinations as trials show them.
    declared = map(name_of, analysis.known(task, pool)) if len(columns) == 1 else shown
    values = list(dict.fromkeys(declared))
    if analysis.baseline is not None:
        values.sort(key=lambda value: value != name_of(analysis.baseline))
    answers = study.text.languages[study.text.default_language].answers
    rule = task.adaptation
    section = analysis
    shape: Shape = "gauss"
    if isinstance(rule, AdaptiveLevels):
        adapted = {
            "level": analysis.level or rule.column,
            "falling": bool(getattr(rule, "falling", analysis.falling)),
        }
        section = analysis.model_copy(update=adapted)
        shape = getattr(rule, "shape", shape)
    return RatePlan(
        section=section,
        study=study.study.name,
        title=study.study.title,
        protocol_sha256=study.sha256,
        values=tuple(value for value in values if value in shown),
        adaptive=rule is not None,
        answers=task.answers(),
        alternatives=len(task.answers()),
        signal=task.answers()[0],
        guess=1.0 / len(task.answers()),
        labels={**answers, **study.stimuli.labels(), **task.labels()},
        planned_participants=study.study.participants,
        planned_trials=rule.trials_of(task, pool) if rule else len(cells) * pool.repeats,
        shape=shape,
        rule=getattr(analysis, "rule", task.rule),
    )


class CurvePlan(RatePlan):
    """Plan of an analysis along a level; all pairs of conditions are compared."""

    @property
    def by_threshold(self) -> bool:
        """True: nothing else is compared."""
        return True

    @property
    def counted(self) -> str:
        """Along what answers change."""
        return f"by {self.level}"

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return nothing."""
        return None


def rate_plan_of_table(
    decisions: pd.DataFrame,
    name: str,
    section: RateTableSection,
    answers: tuple[str, ...],
    plan: type[RatePlan] = RatePlan,
    *,
    rule: str = "alternatives",
) -> RatePlan:
    """Return the plan of a table without a protocol.

    Raises
    ------
    StudyError
        If the table does not have a column or value that the options name.
    """
    columns = section.by_columns or (("method",) if "method" in decisions else ())
    by = BETWEEN.join(columns)
    named = [*(("by", column) for column in columns), ("level", section.level)]
    named.append(("interaction", section.interaction))
    for key, column in named:
        if column is not None and column not in decisions:
            raise StudyError(
                f"--set {key}={column}: must name a column of the table"
                f" ({', '.join(map(str, decisions.columns))})"
                f"{did_you_mean(column, list(map(str, decisions.columns)))}"
            )
    if section.level == TAKEN:
        raise StudyError(
            f"--set level={TAKEN}: must not be {TAKEN!r}, as reports call what is compared; give it"
            f" another name: --map level={TAKEN} --set level=level"
        )
    values = [EVERYTHING]
    if columns:
        found = decisions[[*columns]].drop_duplicates().sort_values([*columns], kind="stable")
        values = list(map(combined, found.itertuples(index=False)))
    parts = {*(part for name in values for part in name.split(BETWEEN)), *answers}
    values = section.sort(values, sorted(parts))
    if section.baseline is not None:
        first = name_of(section.baseline)
        if first not in values:
            raise StudyError(
                f"--set baseline={first}: must be a value of {by!r} ({', '.join(values)})"
                f"{did_you_mean(first, values)}"
            )
        values.sort(key=lambda value: value != first)
    check_contrasts(section, values)
    return plan(
        section=section.model_copy(update={"by": by}),
        study=name,
        title=name,
        values=tuple(values),
        adaptive="track" in decisions and bool((decisions["track"].fillna("") != "").any()),
        answers=answers,
        alternatives=len(answers),
        guess=getattr(section, "guess", 1.0 / len(answers)),
        log=getattr(section, "log", False),
        signal=getattr(section, "signal", ""),
        rule=getattr(section, "rule", rule),
        shape=section.shape,
        labels=section.label,
    )


def prepared(decisions: pd.DataFrame, plan: RatePlan) -> pd.DataFrame:
    """Return the decisions as the statistics take them.

    Returns
    -------
    DataFrame
        All columns of the decisions, ``correct`` as 0 and 1, and ``condition``: the value of `by`
        as text. Without ``scene`` where the test respects participants only, or there is none.
    """
    rows = decisions.copy()
    rows["correct"] = pd.to_numeric(rows["correct"]).astype(int)
    columns = list(plan.by_columns)
    names: Sequence[str] | str = EVERYTHING
    if columns:
        names = list(map(combined, rows[columns].itertuples(index=False)))
    rows["condition"] = names  # last: the table may have a column of this name
    if "scene" in rows and (plan.test == "participant" or (rows["scene"] == "").all()):
        rows = rows.drop(columns="scene")
    return rows.reset_index(drop=True)


def shown_in(rows: pd.DataFrame, plan: RatePlan) -> list[str]:
    """Return the conditions of prepared rows, as the study declares them."""
    present = set(rows["condition"])
    return [name for name in plan.values if name in present]


def baseline_in(rows: pd.DataFrame, plan: RatePlan) -> str | None:
    """Return the first condition of prepared rows, where there are others to compare it with."""
    return plan.reference_in(shown_in(rows, plan))
