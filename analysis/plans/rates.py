"""What the analyses of tasks with right answers need to know of a study."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import Field

from analysis.ideal_observer import AbxRule
from analysis.parts import Plan
from analysis.tasks.base import NamedOptions
from protocols.adaptive.psychometric import Shape
from protocols.adaptive.section import AdaptiveLevels
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.suggest import did_you_mean
from protocols.tasks.rates import BETWEEN, TAKEN, RatesAnalysis, name_of
from protocols.tasks.single import RightOrWrong
from protocols.units import Scalar

Test = Literal["participant-scene", "participant"]
EVERYTHING = "all"
"""Name of the condition where nothing is compared."""


class RatesOptions(NamedOptions):
    """What a table of right and wrong answers may be told."""

    by: str | None = None
    """The column whose values are compared, or several with commas between, whose combinations
    are; left out: `method`, if there is one."""
    baseline: Scalar | None = None
    """The value of `by` that the others are compared with; left out: the first in order."""
    level: str | None = None
    """A column of numbers along which answers get better or worse."""
    falling: bool = False
    """Answers get worse as `level` rises."""
    test: Test = "participant-scene"
    """Whose variation the inference respects."""
    correction: Literal["holm", "none"] = "holm"
    """Over all comparisons with the baseline."""
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Level of every test."""
    shape: Shape = "gauss"
    """Of psychometric functions; `weibull` where levels are above 0."""
    reaction: Literal["summary", "models"] = "summary"
    """Of reaction times: medians and means, or models of them too."""
    interaction: str | None = None
    """A second column: tests whether the differences between values of `by` differ between its
    values."""


@dataclass(frozen=True)
class RateSettings(Plan):
    """Names and rules of the analysis of right and wrong answers.

    Attributes
    ----------
    by : str or None
        The column whose values are compared, or several with commas between; and `values` in
        order, the baseline first.
    answers : tuple of str
        All that can be answered; empty where a table does not say.
    alternatives : int
        How many answers there are: chance is 1 / alternatives.
    adaptive : bool
        Levels were chosen from the answers: shares of right answers say nothing, thresholds do.
    shape : str
        Of psychometric functions: the one that an adaptive rule plans with, else ``gauss``.
    rule : str
        ABX: how participants are taken to decide.
    reaction : str
        ``models``: of reaction times too.
    interaction : str or None
        A second column, between whose values differences are compared.
    """

    study: str
    title: str
    kind: str
    by: str | None
    values: tuple[str, ...]
    level: str | None
    falling: bool
    adaptive: bool
    answers: tuple[str, ...]
    alternatives: int
    labels: Mapping[str, str]
    test: Test
    correction: str
    alpha: float
    planned_participants: int | None
    planned_trials: int | None
    protocol_sha256: str | None
    rule: AbxRule = "differencing"
    shape: Shape = "gauss"
    reaction: Literal["summary", "models"] = "summary"
    interaction: str | None = None

    @property
    def baseline(self) -> str:
        """The value that the others are compared with."""
        return self.values[0]

    @property
    def chance(self) -> float:
        """Share of right answers by guessing."""
        return 1.0 / self.alternatives

    @property
    def guess(self) -> float | None:
        """Rate of guessing of psychometric functions; None: unknown."""
        return self.chance

    @property
    def logarithmic(self) -> bool:
        """Whether psychometric functions are of the logarithm of levels."""
        return self.shape == "weibull"

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions, which parts find beside those of the table."""
        return (TAKEN,)

    @property
    def compared_title(self) -> str:
        """What heads conditions."""
        return "Condition"

    def in_order(self, names: Sequence[str]) -> list[str]:
        """Return conditions as the study declares them."""
        place = {name: index for index, name in enumerate(self.values)}
        return sorted(names, key=lambda name: place.get(name, len(place)))

    def reference_in(self, names: Sequence[str]) -> str | None:
        """Return the first of these conditions, where there are others to compare it with."""
        return self.in_order(names)[0] if len(names) > 1 else None

    def label(self, name: str) -> str:
        """Return what reports print for a value of a condition."""
        if name in self.labels:
            return self.labels[name]
        return BETWEEN.join(self.labels.get(part, part) for part in name.split(BETWEEN))


def by_columns(by: str | None) -> tuple[str, ...]:
    """Return the columns that `by` names."""
    return () if by is None else tuple(by.replace(BETWEEN, ",").split(","))


def combined(values: Iterable[object]) -> str:
    """Return the values of these columns as the name of a condition."""
    return BETWEEN.join(map(name_of, values))


def common_settings(study: StudyProtocol) -> RateSettings:
    """Return the settings that a protocol fixes.

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
    level = analysis.level
    falling = analysis.falling
    shape: Shape = "gauss"
    if isinstance(rule, AdaptiveLevels):
        level = level or rule.column
        falling = bool(getattr(rule, "falling", falling))
        shape = getattr(rule, "shape", shape)
    return RateSettings(
        study=study.study.name,
        title=study.study.title,
        kind=analysis.kind,
        by=analysis.by_name,
        values=tuple(value for value in values if value in shown),
        level=level,
        falling=falling,
        adaptive=rule is not None,
        answers=task.answers(),
        alternatives=len(task.answers()),
        labels={**answers, **study.stimuli.labels(), **task.labels()},
        planned_participants=study.study.participants,
        planned_trials=rule.trials_of(task, pool) if rule else len(cells) * pool.repeats,
        protocol_sha256=study.sha256,
        shape=shape,
        **_told(analysis, "test", "correction", "alpha", "reaction", "rule", "interaction"),
    )


def common_settings_of_table(
    decisions: pd.DataFrame, name: str, kind: str, options: RatesOptions, answers: tuple[str, ...]
) -> RateSettings:
    """Return the settings of a table without a protocol.

    Raises
    ------
    StudyError
        If the table does not have a column or value that the options name.
    """
    by = options.by or ("method" if "method" in decisions else None)
    named = [*(("by", column) for column in by_columns(by)), ("level", options.level)]
    named.append(("interaction", options.interaction))
    for key, column in named:
        if column is not None and column not in decisions:
            raise StudyError(
                f"--set {key}={column}: must name a column of the table"
                f" ({', '.join(map(str, decisions.columns))})"
                f"{did_you_mean(column, list(map(str, decisions.columns)))}"
            )
    if options.level == TAKEN:
        raise StudyError(
            f"--set level={TAKEN}: must not be {TAKEN!r}, as reports call what is compared; give it"
            f" another name: --map level={TAKEN} --set level=level"
        )
    values = [EVERYTHING]
    if by is not None:
        columns = list(by_columns(by))
        found = decisions[columns].drop_duplicates().sort_values(columns, kind="stable")
        values = list(map(combined, found.itertuples(index=False)))
    parts = {*(part for name in values for part in name.split(BETWEEN)), *answers}
    values = options.sort(values, sorted(parts))
    if options.baseline is not None:
        first = name_of(options.baseline)
        if first not in values:
            raise StudyError(
                f"--set baseline={first}: must be a value of {by!r} ({', '.join(values)})"
                f"{did_you_mean(first, values)}"
            )
        values.sort(key=lambda value: value != first)
    return RateSettings(
        study=name,
        title=name,
        kind=kind,
        by=by,
        values=tuple(values),
        adaptive="track" in decisions and bool((decisions["track"].fillna("") != "").any()),
        answers=answers,
        alternatives=len(answers),
        labels=options.label,
        planned_participants=None,
        planned_trials=None,
        protocol_sha256=None,
        **_told(options, "level", "falling", "shape"),
        **_told(options, "test", "correction", "alpha", "reaction", "rule", "interaction"),
    )


def _told(by: RatesAnalysis | RatesOptions, *names: str) -> dict[str, Any]:
    """Return what a protocol or options say; those of other tasks lack a rule."""
    return {name: getattr(by, name) for name in names if hasattr(by, name)}


def prepared(decisions: pd.DataFrame, settings: RateSettings) -> pd.DataFrame:
    """Return the decisions as the statistics take them.

    Returns
    -------
    DataFrame
        All columns of the decisions, ``correct`` as 0 and 1, and ``condition``: the value of `by`
        as text. Without ``scene`` where the test respects participants only, or there is none.
    """
    rows = decisions.copy()
    rows["correct"] = pd.to_numeric(rows["correct"]).astype(int)
    columns = list(by_columns(settings.by))
    names: Sequence[str] | str = EVERYTHING
    if columns:
        names = list(map(combined, rows[columns].itertuples(index=False)))
    rows["condition"] = names  # last: the table may have a column of this name
    if "scene" in rows and (settings.test == "participant" or (rows["scene"] == "").all()):
        rows = rows.drop(columns="scene")
    return rows.reset_index(drop=True)


def shown_in(rows: pd.DataFrame, settings: RateSettings) -> list[str]:
    """Return the conditions of prepared rows, as the study declares them."""
    present = set(rows["condition"])
    return [name for name in settings.values if name in present]


def baseline_in(rows: pd.DataFrame, settings: RateSettings) -> str | None:
    """Return the first condition of prepared rows, where there are others to compare it with."""
    return settings.reference_in(shown_in(rows, settings))
