"""Are all methods equal, and does one axis suffice: for people and scenes like these."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import pandas as pd
from numpy.random import Generator

from analysis.models.compared_methods import as_numbers
from analysis.models.paired.joint_tests import JointTest, JointTests, joint_tests
from analysis.parts import Part, Shown, tried
from analysis.parts.scale import BOOTSTRAP_SAMPLES, vote_tensor
from analysis.plans.preference_plan import PreferencePlan
from analysis.report.wording import NONE, number, p_number, p_text
from protocols.blocks import Cautions, TableBlock, grouped


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
        """Return whether three methods or more, and several people, are there."""
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
            votes, _ = vote_tensor(rows, methods)
            return SizeTests(size, joint_tests(votes, rng=chance, samples=BOOTSTRAP_SAMPLES))

        found = (
            tried(partial(of, size), f"joint tests{plan.at(size, ' at {}')}", notes)
            for size in plan.sizes
        )
        return JointScales(tuple(one for one in found if one is not None), tuple(notes))

    def show(self, found: JointScales, plan: PreferencePlan) -> Shown:
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
        return Shown(
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


def _f(test: JointTest | None) -> str:
    return NONE if test is None else f"F({test.df}, {test.rest_df}) = {number(test.f)}"


def _sentences(found: JointScales, plan: PreferencePlan) -> Iterator[str]:
    for one in found.sizes:
        about = plan.at(one.size, " ({})")
        for test, what in (
            (one.tests.equal, "all methods are equal"),
            (one.tests.axis, "one axis suffices"),
        ):
            if test is not None:
                yield (f"That {what}{about}: {_f(test)}, {p_text(test.p)} (two-way bootstrap).")
