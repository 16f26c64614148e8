"""Are all methods equal, and does one axis suffice: for people and scenes like these."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import pandas as pd
from numpy.random import Generator

from analysis.models.compared_methods import as_numbers
from analysis.models.paired.joint_tests import JointTest, JointTests, joint_tests
from analysis.parts import Part, Presentation, tried
from analysis.parts.scale import BOOTSTRAP_SAMPLES, vote_tensor
from analysis.plans.preference_plan import PreferencePlan
from analysis.report.wording import NONE, number, p_number, p_text
from analysis.showable import FamilyOfTests
from protocols.blocks import Cautions, TableBlock, grouped
from protocols.prose import count_of

EQUAL, AXIS = "all methods are equal", "one axis suffices"


@dataclass(frozen=True)
class SizeTests:
    """Both tests at one size."""

    size: str
    tests: JointTests


@dataclass(frozen=True)
class JointScales:
    """Every number, by size."""

    sizes: tuple[SizeTests, ...]
    notes: tuple[str, ...]


class JointScalePart(Part[PreferencePlan, JointScales]):
    """Tests of all scores at once by the two-way bootstrap."""

    name: ClassVar[str] = "joint_scale"
    section: ClassVar[tuple[str, str]] = ("scale", "Scale")

    def wanted(self, table: pd.DataFrame, plan: PreferencePlan) -> bool:
        """Return True if three methods or more, and several people, are there."""
        return len(plan.methods) > 2 and table["participant"].nunique() > 1

    def compute(
        self,
        table: pd.DataFrame,
        plan: PreferencePlan,
        _found: Mapping[str, Any],
        chance: Generator,
    ) -> JointScales:
        """Test the methods of each size."""
        decisions, notes = as_numbers(table), list[str]()

        def of(size: str) -> SizeTests:
            rows, methods = plan.compared_at(decisions, size)
            votes, people = vote_tensor(rows, methods)
            tests = joint_tests(votes, rng=chance, samples=BOOTSTRAP_SAMPLES)
            few = (
                note
                for family in _families(rows["first"], rows["second"])
                for note in family.hopeless(len(people), plan.alpha)
            )
            return SizeTests(size, replace(tests, notes=(*tests.notes, *few)))

        found = (
            tried(partial(of, size), f"joint tests{plan.at(size, ' at {}')}", notes)
            for size in plan.sizes
        )
        return JointScales(tuple(one for one in found if one is not None), tuple(notes))

    def families(self, cells: pd.DataFrame, plan: PreferencePlan) -> Sequence[FamilyOfTests]:
        """Return both tests of each size, where there are three methods or more."""
        if len(plan.methods) < 3:
            return ()
        sizes = (_families(rows["method"], rows["against"]) for _, rows in cells.groupby("size"))
        return tuple(dict.fromkeys(one for size in sizes for one in size))

    def show(self, found: JointScales, plan: PreferencePlan) -> Presentation:
        """Return a row for each test."""
        every = [
            (plan.at(one.size, whole="all sizes"), what, test)
            for one in found.sizes
            for what, test in (("all equal", one.tests.equal), ("one axis", one.tests.axis))
        ]
        lines = [
            {"size": one.size, "hypothesis": what, **vars(test)}
            for one in found.sizes
            for what, test in (("equal", one.tests.equal), ("axis", one.tests.axis))
            if test is not None
        ]
        return Presentation(
            blocks=(
                TableBlock.each(
                    "All methods at once, by bootstrap of participants and scenes",
                    every,
                    *([("Size", "l", lambda one: one[0])] if plan.sized else []),
                    ("Hypothesis", "l c", lambda one: one[1]),
                    ("F(df)", "n", lambda one: _f(one[2])),
                    ("p", "strong", lambda one: NONE if one[2] is None else p_number(one[2].p)),
                ),
                Cautions(
                    "When not to trust these joint tests",
                    grouped([(plan.at(one.size), one.tests.notes) for one in found.sizes]),
                ),
            ),
            sentences=tuple(_sentences(found, plan)),
            methods=(
                "Whether all methods are equal, and whether one axis suffices, was tested by"
                " Hotelling's T² with the covariance of the two-way bootstrap."
            ),
            tables={"joint_scale.csv": pd.DataFrame(lines)},
        )


def _families(first: Iterable[str], second: Iterable[str]) -> Iterator[FamilyOfTests]:
    """Yield the tests of methods, by the pairs of them that are shown."""
    pairs = {frozenset(pair) for pair in zip(first, second, strict=True)}
    scores = len(frozenset[str]().union(*pairs)) - 1
    for what, numbers in ((EQUAL, scores), (AXIS, len(pairs) - scores)):
        if numbers > 0:
            of = f" that {what} ({count_of(numbers, 'number')} at once)"
            yield FamilyOfTests("joint test", of, numbers=numbers)


def _f(test: JointTest | None) -> str:
    return NONE if test is None else f"F({test.df}, {test.rest_df}) = {number(test.f)}"


def _sentences(found: JointScales, plan: PreferencePlan) -> Iterator[str]:
    for one in found.sizes:
        about = plan.at(one.size, " ({})")
        for test, what in ((one.tests.equal, EQUAL), (one.tests.axis, AXIS)):
            if test is not None:
                yield (f"That {what}{about}: {_f(test)}, {p_text(test.p)} (two-way bootstrap).")
