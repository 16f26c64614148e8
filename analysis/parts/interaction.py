"""Interaction of preferences, or of differences of right answers, with a second factor."""

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from operator import attrgetter
from typing import ClassVar, TypeVar

import numpy as np
import pandas as pd
from numpy.random import Generator

from analysis.answers import SimulatedAnswers
from analysis.arrays import Floats
from analysis.models.cells import TrialGrid, checked, grid
from analysis.models.clustered import FEW_SCENES, holm
from analysis.models.compared_methods import pairing_rows
from analysis.models.contrasts import Difference
from analysis.models.right_answers import (
    Influence,
    Rate,
    rate,
    share_influence,
    share_interactions,
)
from analysis.parts import Part, PartFigure, PartNumbers, Presentation, Tests
from analysis.parts.shared import apa_difference, between
from analysis.plans.preference_plan import PreferencePlan
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots.tasks import interaction_plot
from analysis.report.result_table import (
    T_DF,
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    estimated,
    limits,
    within,
)
from analysis.report.values import frame_of
from analysis.report.wording import (
    column_in_words,
    leading,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import Box, Cautions, FigurePlace, Paragraph
from protocols.errors import count_of
from protocols.tasks.rates import name_of

LED_BY = 6
"""Planned changes that stand before all."""
Pair = tuple[str, str]
AtValues = Mapping[str, Sequence[pd.Series]]
"""Cells of a comparison's condition, or of its two, by value of the factor."""
T = TypeVar("T")
P = TypeVar("P", PreferencePlan, RatePlan)


@dataclass(frozen=True)
class Side:
    """A share at one value of the factor: of choices of `first` over `second`, or right answers.

    `second` is empty where there is none.
    """

    first: str
    second: str
    at: str
    share: float
    lower: float
    upper: float
    trials: int
    participants: int
    scenes: int


@dataclass(frozen=True)
class Interaction:
    """Change of a difference of two conditions between two values of the factor."""

    first: str
    second: str
    gap: Difference


@dataclass(frozen=True)
class Interactions:
    """Every number.

    Attributes
    ----------
    sides : tuple of Side
        What is compared.
    planned : tuple of Interaction
        Those that the study names: of the primary comparison, Holm-adjusted over the pairs of
        values alone; of right answers all.
    shares : tuple of Interaction
        All of them, Holm-adjusted together: of preferences the planned ones by themselves, and
        the others.
    """

    factor: str
    chance: float
    sides: tuple[Side, ...]
    planned: tuple[Interaction, ...]
    shares: tuple[Interaction, ...]
    notes: tuple[str, ...]


class InteractionPart(Part[P, Interactions]):
    """A second factor that the study names, and what it changes."""

    name: ClassVar[str] = "interaction"
    section: ClassVar[tuple[str, str]] = ("interaction", "Second factor")

    def wanted(self, table: pd.DataFrame, plan: P) -> bool:
        """Return True if a second factor is named, and has several values."""
        return plan.interaction in table and len(_values(table, plan)) > 1

    @abstractmethod
    def at_values(self, cells: pd.DataFrame, plan: P) -> Mapping[Pair, AtValues]:
        """Return the cells of each comparison, at every value, shown or not."""

    def _shown(self, cells: pd.DataFrame, plan: P) -> dict[Pair, AtValues]:
        """Return the cells of comparisons that are shown at several values, at these."""
        if plan.interaction not in cells:
            return {}
        every = {
            pair: {value: own for value, own in one.items() if all(mask.any() for mask in own)}
            for pair, one in self.at_values(cells, plan).items()
        }
        return {pair: one for pair, one in every.items() if len(one) > 1}

    def families(self, cells: pd.DataFrame, plan: P) -> Sequence[FamilyOfTests]:
        """Return the planned changes, and all of them."""
        shown = {pair: math.comb(len(one), 2) for pair, one in self._shown(cells, plan).items()}
        return _families(shown, plan)

    def show(self, found: Interactions, plan: P) -> Presentation:
        """Return the planned ones before all, every difference, and shares by value."""
        factor = column_in_words(found.factor)
        left = len(found.planned) - LED_BY
        more = f"{left} more are below." if left > 0 else ""
        over = "over all"
        if isinstance(plan, PreferencePlan):
            over += f", those of {_whose(plan)} by themselves and those of other pairs together"
        told = _changes(found.shares, plan)
        return Presentation(
            lead=(
                Box(
                    f"Interaction with {factor}",
                    " ".join([*(_apa(one, plan) for one in found.planned[:LED_BY]), more]).strip(),
                    f"Planned; two-sided, alpha = {leading(f'{plan.alpha:g}')}.",
                ),
            ),
            title=f"Second factor: {factor}",
            blocks=(
                FigurePlace("interaction"),
                replace(told, caption=f"Changes between values of {factor}").block(),
                Paragraph(
                    f"Change: 0 where the factor changes nothing. Deciding p: Holm's, {over}. That"
                    " one value has a significant result and another has none does not show that"
                    " they differ; this test does.",
                    muted=True,
                ),
                Cautions("When not to trust these changes", found.notes),
            ),
            sentences=[_apa(one, plan) for one in found.shares],
            methods=(
                f"Changes between values of {factor} were tested by t with errors clustered by"
                " participant and by scene."
            ),
            tables={
                "interaction.csv": told.every_field(),
                "interaction_shares.csv": frame_of(found.sides),
            },
            figures=(_figure(found, factor, plan),),
        )


def _changes(
    found: Sequence[Interaction], plan: PreferencePlan | RatePlan
) -> ResultTable[Interaction]:
    return ResultTable.of(
        "",
        found,
        ResultColumn("Of", "l c", lambda one: _between(one, plan)),
        ResultColumn("Values", "l", lambda one: between(one.gap, plan)),
        attribute("In", "gap.measure", str, "l"),
        *within(
            attrgetter("gap"),
            (
                estimated("Change", "difference"),
                limits(plan.limits),
                T_DF,
                deciding("p_adjusted", "gap_p_adjusted"),
            ),
        ),
    )


class PreferenceInteraction(InteractionPart[PreferencePlan]):
    """Preferences between sizes."""

    def compute(
        self, table: pd.DataFrame, plan: PreferencePlan, _found: PartNumbers, _chance: Generator
    ) -> Interactions:
        """Compare each pairing between sizes."""
        rows, places = _on_grid(table, plan)
        values, sides, shares = _values(rows, plan), list[Side](), dict[Pair, list[Difference]]()
        for pair in plan.pairings:
            events = {}
            for value in values:
                here = pairing_rows(rows, *pair, value)
                if len(here):
                    events[value] = {pair[0]: (here["chosen"] == pair[0]).astype(int)}
                    counted = rate(events[value][pair[0]], places, condition=value,
                                   level=plan.confidence)  # fmt: skip
                    sides.append(_side(pair, value, counted))
            if len(events) > 1:
                shares[pair] = list(
                    share_interactions(events, places, "share of choices", plan.confidence)
                )
        if not shares:
            raise ValueError(f"no two methods were compared at two values of {plan.interaction}")
        first = _first(plan)
        people = max(pairing_rows(rows, *pair)["participant"].nunique() for pair in shares)
        notes = _notes(sides, people, _families(_numbers(shares), plan), plan)
        return Interactions(
            factor="size",
            chance=0.5,
            sides=tuple(sides),
            planned=_family(_only(shares, first)),
            shares=_apart(shares, first),
            notes=tuple(notes),
        )

    def at_values(self, cells: pd.DataFrame, plan: PreferencePlan) -> Mapping[Pair, AtValues]:
        """Return the cells of each pairing by size."""
        of = [
            (pair, (cells["method"] == pair[0]) & (cells["against"] == pair[1]))
            for pair in plan.pairings
        ]
        return {
            pair: {size: [own & (cells["size"] == size)] for size in plan.sizes} for pair, own in of
        }

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: PreferencePlan
    ) -> Tests:
        """Test whether shares of the primary comparison differ between sizes."""
        shown = self._shown(answers.cells, plan)
        return _planned(self.name, answers, people, plan, _only(shown, _first(plan)))


class RateInteraction(InteractionPart[RatePlan]):
    """Differences of right answers to the baseline between values; of one condition the answers."""

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a factor, and levels were not chosen from the answers."""
        return not plan.adaptive and super().wanted(table, plan)

    def compute(
        self, table: pd.DataFrame, plan: RatePlan, _found: PartNumbers, _chance: Generator
    ) -> Interactions:
        """Compare each condition's difference to the first between the factor's values."""
        rows, places = _on_grid(table, plan)
        of = rows[plan.interaction].map(name_of)
        events: dict[Pair, pd.Series] = {}
        sides = []
        for name in shown_in(rows, plan):
            for value in _values(rows, plan):
                here = rows.loc[(rows["condition"] == name) & (of == value), "correct"]
                if len(here):
                    events[name, value] = here
                    counted = rate(here, places, condition=value, chance=plan.chance,
                                   level=plan.confidence)  # fmt: skip
                    sides.append(_side((name, ""), value, counted))
        baseline, *others = shown_in(rows, plan)
        found: dict[Pair, list[Difference]] = {}
        for pair in [(one, baseline) for one in others] or [(baseline, "")]:
            names = [name for name in pair if name]
            both = {
                value: {name: events[name, value] for name in names}
                for value in _values(rows, plan)
                if all((name, value) in events for name in names)
            }
            if len(both) > 1:
                found[pair] = list(
                    share_interactions(both, places, "share correct", plan.confidence)
                )
        if not found:
            raise ValueError(f"no comparison was shown at two values of {plan.interaction}")
        every = _family(found)
        who = rows["participant"]
        people = max(who[rows["condition"].isin(pair)].nunique() for pair in found)
        return Interactions(
            str(plan.interaction),
            plan.chance,
            tuple(sides),
            every,
            every,
            tuple(_notes(sides, people, _families(_numbers(found), plan), plan)),
        )

    def at_values(self, cells: pd.DataFrame, plan: RatePlan) -> Mapping[Pair, AtValues]:
        """Return the cells of each condition and the baseline; of a single one its own."""
        if plan.adaptive:
            return {}
        at, (baseline, *others) = cells[plan.interaction].map(name_of), plan.values
        pairs = [(one, baseline) for one in others] or [(baseline, "")]
        return {
            pair: {
                value: [(cells["condition"] == name) & (at == value) for name in pair if name]
                for value in _values(cells, plan)
            }
            for pair in pairs
        }

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: RatePlan
    ) -> Tests:
        """Test whether differences to the baseline differ between the factor's values."""
        shown = self._shown(answers.cells, plan)
        if plan.kind == "detection":  # what is given is the answer of the signal
            there = (answers.cells["expected"] == plan.answers[0]).to_numpy()
            answers = replace(answers, given=answers.given == there)
        return _planned(self.name, answers, people, plan, shown)


def _figure(found: Interactions, factor: str, plan: PreferencePlan | RatePlan) -> PartFigure:
    rows = [
        (_between(one, plan), plan.label(one.at), one.share, one.lower, one.upper)
        for one in found.sides
    ]
    caption = (
        f"Shares by {factor}, with {plan.limits} that respect participants"
        " and scenes; dashed: chance. Limits that overlap are no test of a difference."
    )
    draw = partial(interaction_plot, rows, title=factor, chance=found.chance, level=plan.confidence)
    return PartFigure("interaction", caption, draw)


def _planned(
    name: str,
    answers: SimulatedAnswers,
    people: Sequence[int],
    plan: PreferencePlan | RatePlan,
    shown: Mapping[Pair, AtValues],
) -> Tests:
    """Return the test of how shares change between values, Holm-adjusted, by `name`.

    Nothing where no comparison is shown at two values.
    """

    def moved(count: int, masks: Sequence[pd.Series]) -> Influence:
        each = []
        for mask in masks:
            happened, seen = answers.grid(
                mask.to_numpy(), by_scene=plan.test == "participant-scene"
            )
            happened = happened[:, :count]
            each.append(share_influence(happened, np.broadcast_to(seen, happened.shape)))
        return each[0] if len(each) == 1 else each[0].minus(each[1])

    def of(count: int) -> Floats:
        p = []
        for one in shown.values():
            at = [moved(count, masks) for masks in one.values()]
            p += [first.less(second).p_value() for first, second in combinations(at, 2)]
        return holm(np.stack(p, axis=-1))

    return {name: lambda: np.stack([of(count) for count in people], axis=1)} if shown else {}


def _on_grid(
    table: pd.DataFrame, plan: PreferencePlan | RatePlan
) -> tuple[pd.DataFrame, TrialGrid]:
    """Return numbered rows and their grid; of one scene where the test respects people alone."""
    claimed = plan.test == "participant-scene"
    rows = checked(table if claimed else table.drop(columns="scene", errors="ignore"), ())
    return rows, grid(rows)


def _values(table: pd.DataFrame, plan: PreferencePlan | RatePlan) -> list[str]:
    """Return the values of the factor, sizes as the study declares them."""
    held = table[plan.interaction].drop_duplicates().sort_values()
    found = list(dict.fromkeys(map(name_of, held)))
    if isinstance(plan, PreferencePlan):
        return [size for size in plan.sizes if size in found]
    return found


def _side(pair: Pair, value: str, one: Rate) -> Side:
    return Side(
        *pair, value, one.share, one.lower, one.upper, one.trials, one.participants, one.scenes
    )


def _first(plan: PreferencePlan) -> Pair:
    """Return the comparison whose changes are tested by themselves."""
    return plan.primary[:2] if plan.primary else plan.pairings[0]


def _whose(plan: PreferencePlan) -> str:
    """Return the comparison whose changes are tested by themselves, in words."""
    return "the primary preference" if plan.primary else " / ".join(map(plan.label, _first(plan)))


def _only(found: Mapping[Pair, T], pair: Pair) -> dict[Pair, T]:
    return {pair: found[pair]} if pair in found else {}


def _numbers(found: Mapping[Pair, Sequence[Difference]]) -> dict[Pair, int]:
    return {pair: len(several) for pair, several in found.items()}


def _families(changes: Mapping[Pair, int], plan: PreferencePlan | RatePlan) -> list[FamilyOfTests]:
    """Return the families of so many changes of each comparison."""
    of, total = f" with {plan.interaction}", sum(changes.values())
    found = [FamilyOfTests("change", of, total)] * (total > 0)
    if isinstance(plan, RatePlan):
        return found
    first = _first(plan)
    if first in changes:
        others = total - changes[first]
        found = [
            FamilyOfTests("change", f" of {_whose(plan)}{of}", changes[first]),
            *[FamilyOfTests("change", f" of other pairs{of}", others)] * (others > 0),
        ]
    return found


def _family(found: Mapping[Pair, Iterable[Difference]]) -> tuple[Interaction, ...]:
    """Return differences, Holm-adjusted over all of them."""
    every = [Interaction(*pair, gap) for pair, several in found.items() for gap in several]
    adjusted = holm(np.array([one.gap.p for one in every])) if every else ()
    return tuple(
        replace(one, gap=replace(one.gap, p_adjusted=float(p)))
        for one, p in zip(every, adjusted, strict=True)
    )


def _apart(found: Mapping[Pair, Sequence[Difference]], first: Pair) -> tuple[Interaction, ...]:
    """Return differences, those of the planned comparison Holm-adjusted by themselves."""
    others = {pair: several for pair, several in found.items() if pair != first}
    return (*_family(_only(found, first)), *_family(others))


def _notes(
    sides: Sequence[Side],
    people: int,
    families: Sequence[FamilyOfTests],
    plan: PreferencePlan | RatePlan,
) -> list[str]:
    """Return notes on what few people cannot show of these changes, and few scenes hardly tell.

    `people` is the largest number of whom a change tells, at either of its values.
    """
    fewest = min(one.scenes for one in sides)
    found = [note for one in families for note in one.hopeless(people, plan.alpha)]
    if fewest == 1:
        found.append("one scene at some value: the change is about these scenes")
    elif fewest < FEW_SCENES:
        number = count_of(fewest, "scene")
        found.append(f"only {number} at some value: how scenes differ is poorly known")
    return found


def _between(one: Side | Interaction, plan: PreferencePlan | RatePlan) -> str:
    return " / ".join(plan.label(name) for name in (one.first, one.second) if name)


def _apa(one: Interaction, plan: PreferencePlan | RatePlan) -> str:
    return f"{_between(one, plan)}: {apa_difference(one.gap, plan)}"
