"""Preferences: how often one method is chosen over another, for every pairing and size."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any, ClassVar, TypeAlias

import numpy as np
import pandas as pd
from markupsafe import Markup

from analysis.answers import SimulatedAnswers
from analysis.arrays import Floats
from analysis.models.clustered import ClusteredShare, holm, limits_by_scene, two_way_of_first
from analysis.models.compared_methods import ALL_SIZES, Comparisons, counts
from analysis.models.numeric import binomial_below
from analysis.models.preference import (
    Preference,
    PreferenceTable,
    preference,
    preferences,
)
from analysis.parts import EQUIVALENCE, Estimate, PartFigure, Presentation, SimplePart, Tests
from analysis.parts.people import NO_LIMITS, Limits, scenes_table, shares_figure
from analysis.parts.shared import apa_p, over, planned_family
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots import preference_bars
from analysis.report.result_table import (
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    limits,
    p_value,
    set_aside,
    within,
)
from analysis.report.wording import (
    big,
    leading,
    level_text,
    share,
    share_range,
    t_number,
    t_text,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import (
    Block,
    Box,
    Cautions,
    FigurePlace,
    Folded,
    Paragraph,
    Section,
    strong,
)

TESTS = {
    "participant-scene": (
        "two-way clustered score t",
        "a score t test with standard errors clustered by participant and by scene (two-way"
        " clustering, Cameron, Gelbach & Miller, 2011), p no smaller than that of independent"
        " trials or of unanimous participants",
    ),
    "participant": (
        "participant score t",
        "a score t test over participants' choice proportions, p no smaller than that of"
        " independent trials or of unanimous participants",
    ),
    "pooled": (
        "pooled exact binomial",
        "an exact binomial test that takes trials as independent",
    ),
}
"""Tests of a protocol: what a table calls them, and what they are."""

PairingShares: TypeAlias = Mapping[tuple[str, str, str], tuple[tuple[str, float], ...]]


@dataclass(frozen=True)
class PreferenceResults:
    """Every number.

    Attributes
    ----------
    primary : Preference or None
        The planned comparison, not adjusted; None where there is none, or no decision makes it.
    table : PreferenceTable
        Every comparison, adjusted together.
    participant_shares, scene_shares : mapping of (method, against, size) to (name, share)
        Of choices of the first method; `scene_limits` are those of scenes.
    """

    primary: Preference | None
    table: PreferenceTable
    participant_shares: PairingShares
    scene_shares: PairingShares
    scene_limits: Mapping[tuple[str, str, str], Limits]
    notes: tuple[str, ...]


class PreferencesPart(SimplePart[PreferencePlan, PreferenceResults]):
    """Shares of choices with their tests; the primary comparison leads."""

    name: ClassVar[str] = "preferences"
    section: ClassVar[tuple[str, str]] = ("preference", "Preference")
    essential: ClassVar[bool] = True

    def of(self, table: pd.DataFrame, plan: PreferencePlan) -> PreferenceResults:
        """Test every pairing at every size, and the primary comparison by itself."""
        decisions = Comparisons(table)
        how: dict[str, Any] = {"alpha": plan.alpha, "margin": plan.margin, "test": plan.test}
        cells = preferences(
            decisions,
            pairings=plan.pairings,
            sizes=plan.sizes,
            correction=plan.correction,
            **how,
        )
        notes, primary = list(cells.warnings), None
        if plan.primary is not None:
            method, against, _ = plan.primary
            rows = decisions.rows(*plan.primary)
            if rows.empty:
                notes.append(f"the primary comparison ({method} with {against}) has no decisions")
            else:
                primary = preference(rows, *plan.primary, **how)
                own = (primary if _key(one) == _key(primary) else one for one in cells.cells)
                cells = replace(cells, cells=tuple(own))
        people = [max(cell.participants for cell in cells.cells)]
        if primary is not None:  # of all sizes, whoever saw which
            people = [primary.participants, *people]
        families = _families(primary is not None, len(cells.cells), plan)
        for family, those in zip(families, people, strict=False):
            notes += family.hopeless(those, plan.alpha)
        return PreferenceResults(
            primary,
            cells,
            _shares_by(1, decisions, cells),
            _shares_by(0, decisions, cells),
            _scene_limits(decisions, cells, plan),
            tuple(notes),
        )

    def planned_p(self, found: PreferenceResults, _plan: PreferencePlan) -> float | None:
        """Return p of the primary comparison."""
        return None if found.primary is None else found.primary.test.p

    def families(self, _cells: pd.DataFrame, plan: PreferencePlan) -> Sequence[FamilyOfTests]:
        """Return the primary comparison, and all comparisons together."""
        return _families(plan.primary is not None, len(plan.comparisons), plan)

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: PreferencePlan
    ) -> Tests:
        """Test the primary comparison, all comparisons together, and equivalence of the primary."""
        cells = answers.cells

        def share(method: str, against: str, size: str) -> ClusteredShare:
            chosen = (cells["method"] == method) & (cells["against"] == against)
            if size != ALL_SIZES:
                chosen &= cells["size"] == size
            counts, shown = answers.grid(chosen.to_numpy(), by_scene=plan.test != "participant")
            held = shown > 0
            return two_way_of_first(counts[..., held], shown[held], people)

        def p_of(found: ClusteredShare) -> Floats:
            if plan.test != "pooled":
                return found.p_value()
            fewer = np.round(np.minimum(found.share, 1.0 - found.share) * found.trials)
            one_sided = binomial_below(fewer, found.trials, 0.5)
            return np.asarray(np.minimum(1.0, 2.0 * one_sided))

        def family() -> Floats:
            kinds = [(one.method, one.against, one.size) for one in plan.comparisons]
            p = np.stack([p_of(share(*kind)) for kind in kinds], axis=-1)
            return holm(p) if plan.correction == "holm" else p

        assert plan.primary is not None, "every study declares it"
        primary = share(*plan.primary)
        return {
            "primary": lambda: p_of(primary)[..., None],
            "": family,
            EQUIVALENCE: lambda: primary.equivalence_p(plan.margin)[..., None],
        }

    def estimates(self, found: PreferenceResults, plan: PreferencePlan) -> Sequence[Estimate]:
        """Return the share of choices in every comparison."""
        return [_estimate(cell, plan) for cell in found.table.cells]

    def planned(self, found: PreferenceResults, plan: PreferencePlan) -> Sequence[Estimate]:
        """Return the share of choices in the primary comparison."""
        return [] if found.primary is None else [_estimate(found.primary, plan)]

    def show(self, found: PreferenceResults, plan: PreferencePlan) -> Presentation:
        """Return the primary comparison before all, every comparison, people and scenes."""
        cells, primary = found.table.cells, found.primary
        sentences = [apa_preference(one, plan) for one in cells]
        lead: tuple[Block, ...] = ()
        headline = sentences[0]
        if primary is not None:
            headline = apa_preference(primary, plan)
            lead = _lead(primary, headline, plan)
            sentences = [
                f"Primary comparison: {headline}",
                *(s for s in sentences if s != headline),
            ]
        table = _table(cells, plan)
        return Presentation(
            lead=lead,
            headline=headline,
            blocks=tuple(_blocks(table, plan)),
            others=(_others(table, plan),),
            further=(
                Section(
                    "people",
                    "Participants and scenes",
                    "Participants and scenes",
                    (
                        FigurePlace("participants"),
                        FigurePlace("scenes"),
                        *scenes_table(
                            "Share of choices of the first method",
                            found.scene_shares,
                            found.scene_limits,
                            plan,
                            partial(_column, plan, "; {}"),
                        ),
                    ),
                ),
            ),
            sentences=sentences,
            methods=_methods(plan),
            tables={"preferences.csv": table.every_field(), "shares.csv": _shares(found)},
            figures=tuple(_figures(found, plan)),
        )


def _key(cell: Preference) -> tuple[str, str, str]:
    return cell.method, cell.against, cell.size


def _families(primary: bool, count: int, plan: PreferencePlan) -> list[FamilyOfTests]:
    """Return the primary comparison, where there is one, and all together."""
    every = planned_family(count, plan)
    first = [replace(every, noun="primary comparison", count=1)] * primary
    return [*first, *[every] * (count > 1 or not primary)]


def _estimate(cell: Preference, plan: PreferencePlan) -> Estimate:
    return Estimate(
        f"{plan.label(cell.method)} over {plan.label(cell.against)}{plan.at(cell.size, ', {}')}",
        cell.estimate.share,
        cell.estimate.lower,
        cell.estimate.upper,
        cell.test.p_adjusted,
        cell.trials,
    )


def _shares_by(summed: int, decisions: Comparisons, table: PreferenceTable) -> PairingShares:
    """Return shares of participants (axis 1 of the counts is summed) or of scenes (axis 0)."""
    found = {}
    for one in table.cells:
        key = _key(one)
        chosen, shown, *names = counts(decisions.rows(*key), one.method)
        shares = chosen.sum(axis=summed) / shown.sum(axis=summed)
        found[key] = tuple(zip(names[1 - summed], map(float, shares), strict=True))
    return found


def _scene_limits(
    decisions: Comparisons, table: PreferenceTable, plan: PreferencePlan
) -> dict[tuple[str, str, str], Limits]:
    found = {}
    for one in table.cells:
        cells = counts(decisions.rows(*_key(one)), one.method)[:2]
        limits = map(list, limits_by_scene(*cells, plan.confidence))
        found[_key(one)] = tuple(zip(*limits, strict=True))
    return found


def verdict(cell: Preference, plan: PreferencePlan) -> str:
    """Say in plain words what a comparison shows."""
    return {
        "preferred": f"{plan.label(cell.method)} is preferred",
        "rejected": f"{plan.label(cell.against)} is preferred",
        "equivalent": "equivalent",
        "undecided": "undecided",
    }[cell.verdict]


def apa_preference(cell: Preference, plan: PreferencePlan) -> str:
    """Return one comparison as an APA sentence."""
    found, decided = cell.estimate, cell.test
    test = decided.name
    if decided.t is not None and decided.df is not None and "t" in decided.name.split():
        test = t_text(decided.t, decided.df)
    text = (
        f"{plan.label(cell.method)} was chosen over {plan.label(cell.against)}"
        f"{plan.at(cell.size, ' ({})', 'all sizes together')} in {cell.chosen} of"
        f" {cell.trials} trials, {share(found.share)}, {level_text(found.level)}"
        f" {share_range(found.lower, found.upper)}, {test},"
        f" {apa_p(decided.p, decided.p_adjusted)}, Cohen's h ="
        f" {cell.cohens_h:.2f}, OR = {big(cell.odds_ratio)} [{big(cell.odds_lower)},"
        f" {big(cell.odds_upper)}]."
    )
    if cell.verdict == "equivalent":
        text += (
            f" The share was equivalent to .5 within ±{share(cell.margin)} (TOST,"
            f" {apa_p(cell.equivalence_p, cell.equivalence_p_adjusted)})."
        )
    return text


def _methods(plan: PreferencePlan) -> str:
    text = (
        f"Decisions are two-alternative forced choices comparing {len(plan.methods)} methods"
        f" ({', '.join(map(plan.label, plan.methods))})"
    )
    if plan.sized:
        text += f" at {len(plan.sizes)} sizes of disocclusion"
    text += (
        f". For every pairing{' and size' * plan.sized} the share of choices was compared with .5"
        f" by {TESTS[plan.test][1]}, two-sided, alpha = {leading(f'{plan.alpha:g}')}"
    )
    count = len(plan.pairings) * len(plan.sizes)
    several = plan.correction == "holm" and count > 1
    if several:
        text += f", Holm-adjusted over {count} comparisons"
    if plan.primary is not None:
        declared = " was declared beforehand and" if plan.protocol_sha256 else ""
        text += f". The primary comparison{declared} is not adjusted"
    return (
        f"{text}. Intervals invert the test (Wilson score intervals). Equivalence was judged by two"
        f" one-sided tests against ±{share(plan.margin)}{', Holm-adjusted as well' * several}."
    )


def _lead(primary: Preference, said: str, plan: PreferencePlan) -> tuple[Block, ...]:
    text = Markup("Result: {}. This p decides, by the {}.").format(
        strong(verdict(primary, plan)), TESTS[plan.test][0]
    )
    return (
        Box("Primary comparison", said, text),
        Cautions("When not to trust the primary comparison", primary.warnings),
    )


def _named(cell: Preference, plan: PreferencePlan) -> str:
    return plan.named(cell.method, cell.against, cell.size)


def _table(cells: Sequence[Preference], plan: PreferencePlan) -> ResultTable[Preference]:
    level, margin = plan.limits, share(plan.margin)
    alone = ", the primary comparison alone" * (plan.primary in [*map(_key, cells)])
    return ResultTable.of(
        f"Every comparison, p by {TESTS[plan.test][0]}{over(cells, plan)}{alone}",
        cells,
        ResultColumn("Comparison", "l c", lambda c: _named(c, plan)),
        ResultColumn("Chosen", "n", lambda c: f"{c.chosen} / {c.trials}"),
        attribute("Share", "estimate.share", share, "strong"),
        *within(attrgetter("estimate"), (limits(level, share_range),)),
        ResultColumn("t(df)", "n", lambda c: t_number(c.test.t, c.test.df)),
        deciding("test.p_adjusted"),
        attribute("h", "cohens_h"),
        attribute("OR", "odds_ratio", big, "n"),
        ResultColumn("Result", "l", lambda c: verdict(c, plan)),
        p_value("Pooled exact p", "exact_p"),
        set_aside(
            ResultColumn(
                "Clopper-Pearson", "n", lambda c: share_range(c.exact_lower, c.exact_upper)
            )
        ),
        p_value("Sign-flip p", "sign_flip_p"),
        set_aside(attribute("Floor", "sign_flip_floor", "{:.2g}".format)),
        p_value(f"TOST p (±{margin})", "equivalence_p_adjusted"),
        set_aside(attribute("eff. n", "estimate.effective_n", "{:.0f}".format)),
        set_aside(attribute("SD of participants", "participant_sd", share)),
    )


def _blocks(table: ResultTable[Preference], plan: PreferencePlan) -> Iterator[Block]:
    yield FigurePlace("preference")
    yield table.block()
    yield Paragraph(
        "Limits leave out .5 exactly where p before correction is small. t(df): clustered score"
        " test of the share against .5; p is never smaller than that of independent trials, or of"
        " unanimous participants. h (Cohen): size of that distance, .2 small,"
        " .5 medium, .8 large. OR: odds of choosing the first method, 1 at .5.",
        muted=True,
    )
    yield Cautions.each(
        "When not to trust these comparisons", table.rows, lambda one: _named(one, plan)
    )


def _others(table: ResultTable[Preference], plan: PreferencePlan) -> Folded:
    return table.folded(
        "Pooled exact test, sign-flip test, equivalence",
        "Papers print the pooled exact binomial test. It takes trials as independent, which they"
        " are not: at a participant SD of 0.5 logits it calls chance an effect more than twice as"
        " often as it says. The sign-flip test of the participants' own shares assumes no normal"
        " law, but its p cannot fall below the floor. Equivalence asks another question: a small p"
        f" of TOST shows that the share lies within ±{share(plan.margin)} of .5, too near to"
        " matter.",
        Paragraph(
            f"Clopper-Pearson: pooled exact {plan.limits}. eff. n: so many independent trials would"
            " tell as much.",
            muted=True,
        ),
    )


def _shares(found: PreferenceResults) -> pd.DataFrame:
    rows = [
        (of, name, *key, value, *ends)
        for of, shares in (
            ("participant", found.participant_shares), ("scene", found.scene_shares)
        )
        for key, pairs in shares.items()
        for (name, value), ends in zip(
            pairs, found.scene_limits[key] if of == "scene" else NO_LIMITS, strict=False
        )
    ]  # fmt: skip
    columns = ["of", "name", "method", "against", "size", "share", "lower", "upper"]
    return pd.DataFrame(rows, columns=columns)


def _figures(found: PreferenceResults, plan: PreferencePlan) -> Iterator[PartFigure]:
    cells = found.table.cells
    dots = {key: [value for _, value in pairs] for key, pairs in found.participant_shares.items()}
    yield PartFigure(
        "preference",
        "Share of trials in which the method on the left was chosen; dark: the one chosen more"
        f" often. Whiskers: {plan.limits} that respect participants and scenes; dots:"
        " participants; dashed: chance.",
        partial(preference_bars, cells, dots, label=plan.label),
    )
    yield _heat_map("participants", found.participant_shares, plan)
    yield _heat_map("scenes", found.scene_shares, plan)


def _heat_map(name: str, shares: PairingShares, plan: PreferencePlan) -> PartFigure:
    return shares_figure(
        name,
        f"Share of choices of the first method, by {name[:-1]}. Blue: the first is preferred;"
        " orange: the second.",
        shares,
        plan.label,
        partial(_column, plan, "\n{}"),
    )


def _column(plan: PreferencePlan, size: str, key: tuple[str, str, str]) -> str:
    return f"{plan.label(key[0])} / {plan.label(key[1])}{plan.at(key[2], size)}"
