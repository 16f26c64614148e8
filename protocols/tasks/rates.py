"""Settings of the analyses of tasks whose answers are right or wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from protocols.errors import Problem, did_you_mean
from protocols.recipes.base import Pool
from protocols.tasks.base import Task
from protocols.tasks.mixed import MixedAnalysis
from protocols.units import Condition, Name, Scalar

BETWEEN = ", "
"""Between the values of several columns that are compared together."""
TAKEN = "condition"
"""Name of the compared values in results: no column of levels may have it."""


def name_of(value: object) -> str:
    """Return a condition's value as text: ``5`` for 5 and for 5.0."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.15g}" if isinstance(value, int | float) else str(value)


def value_of(condition: Condition, columns: Sequence[str]) -> str:
    """Return the name under which a condition is compared, by the columns of `by`."""
    if len(columns) == 1:
        return str(condition.get(columns[0], ""))
    return BETWEEN.join(name_of(condition.get(column, "")) for column in columns)


class RatesAnalysis(MixedAnalysis):
    """Right answers by condition and level: rates, psychometric functions, models, learning."""

    by: Name | Annotated[tuple[Name, ...], Field(min_length=2)] = "method"
    """The column whose values are compared. Several columns: every combination is a condition,
    written with commas, such as `"noise, standard"`."""
    baseline: Scalar | None = None
    """Value that the others are compared with. Default: the first declared."""
    level: Name | None = None
    """Column of numbers along which answers get better or worse. Default: none."""
    falling: bool = False
    """Answers get worse as `level` rises, as with eccentricity."""
    test: Literal["participant-scene", "participant"] = "participant-scene"
    """Units whose variation the test accounts for."""
    correction: Literal["holm", "none"] = "holm"
    """Over all comparisons with the baseline."""
    interaction: Name | None = None
    """A second column: tests whether the differences between values of `by` differ between its
    values; of a single condition, whether right answers do. Default: not tested."""

    added_later: ClassVar[tuple[str, ...]] = (*MixedAnalysis.added_later, "interaction")

    def problems(self, task: Task, pool: Pool, /) -> Iterator[Problem]:
        """Yield columns and values that the stimuli do not have."""
        wrong = list(task.check_shown(pool, "analysis.by", self.by_columns))
        yield from wrong
        known = () if wrong else self.known(task, pool)
        if self.baseline is not None and known and self.baseline not in known:
            listed = ", ".join(map(str, known))
            yield Problem(
                "analysis.baseline",
                f"must be a value of {self.by_name!r} ({listed}) (got {self.baseline!r})"
                f"{did_you_mean(self.baseline, map(str, known))}",
            )
        if known:
            yield from self.contrast_problems(list(map(name_of, known)))
        if self.interaction is not None:
            yield from task.check_shown(pool, "analysis.interaction", (self.interaction,))
            if self.interaction in self.by_columns:
                yield Problem(
                    "analysis.interaction",
                    f"must be another column than `by` compares (got {self.interaction!r})",
                )
        adapted = getattr(task.adaptation, "column", None)
        if adapted is not None and self.level != adapted:
            yield Problem(
                "analysis.level",
                f"must be {adapted!r}, the column that adapts: thresholds over it are what the"
                f" study is about (got {self.level!r})",
            )
        if self.level is None:
            return
        yield from pool.check_columns("analysis.level", (self.level,))
        if self.level == TAKEN:
            must = f"must not be {TAKEN!r}, as reports call what `by` compares; rename the column"
            yield Problem("analysis.level", must)
        texts = [v for v in pool.stimuli.values(self.level) if isinstance(v, bool | str)]
        if texts:  # one text makes a column of a table a column of texts
            found = next((text for text in texts if not _reads_as_number(text)), texts[0])
            yield Problem(
                "analysis.level",
                f"must be a column of numbers (got {found!r} in {self.level})",
            )

    @property
    def by_columns(self) -> tuple[str, ...]:
        """The columns that `by` names; none: nothing is compared."""
        if isinstance(self.by, str):  # a table's may be named with commas between
            return tuple(self.by.replace(BETWEEN, ",").split(",")) if self.by else ()
        return self.by

    @property
    def by_name(self) -> str:
        """Name of `by` in a sentence."""
        return BETWEEN.join(self.by_columns)

    def known(self, task: Task, pool: Pool) -> tuple[Scalar, ...]:
        """Return the values of `by`, or every combination that a trial shows, as declared."""
        own = task.own_columns()
        if len(self.by_columns) == 1:
            (column,) = self.by_columns
            return own.get(column) or pool.stimuli.values(column)
        cells = task.cells(pool)
        shown = (cell.arrangements[0].condition for cell in cells)
        return tuple(dict.fromkeys(value_of(condition, self.by_columns) for condition in shown))

    def ordered(self, task: Task, pool: Pool) -> tuple[str, ...]:
        """Return the values of `by`, the baseline first."""
        values = list(dict.fromkeys(map(str, self.known(task, pool))))
        if self.baseline is not None:
            values.sort(key=lambda value: value != str(self.baseline))
        return tuple(values)

    def plain_sentences(self, task: Task, pool: Pool) -> list[str]:
        """Return the analysis in sentences."""
        baseline, *others = self.ordered(task, pool)
        respected = {
            "participant-scene": "participants and of scenes",
            "participant": "participants",
        }[self.test]
        named = "; ".join(others) if len(self.by_columns) > 1 else ", ".join(others)
        found = [
            f"Answers are compared between values of {self.by_name}: {named or 'none'}, each"
            f" against {baseline}, two-sided, alpha {self.alpha:g}, respecting variation of"
            f" {respected}; correction {self.correction}."
        ]
        if self.interaction is not None:
            found.append(
                f"Interaction: whether these differences in the share of right answers differ"
                f" between values of {self.interaction}, two-sided, alpha {self.alpha:g},"
                " respecting the same variation; correction holm."
            )
        if self.level is not None:
            found.append(
                f"A logistic model of right answers has the terms {self.level} and {self.by_name};"
                f" psychometric functions over {self.level} are fitted for each {self.by_name}."
            )
        return found + self.mixed_sentences()


def _reads_as_number(value: object) -> bool:
    try:
        float(str(value))
    except ValueError:
        return False
    return not isinstance(value, bool)
