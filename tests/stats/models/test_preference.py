"""Preferences: the counts of [MI] Fig. 10, unanimous cells, verdicts, warnings."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.models.clustered import holm, two_way
from analysis.models.compared_methods import Comparisons, counts, pairing_rows
from analysis.models.preference import cohens_h, preference, preferences
from analysis.report.wording import big
from analysis.showable import FamilyOfTests

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle.json").read_text())


def cell_with(chosen: int, people: int = 11, scenes: int = 6, repeats: int = 2) -> pd.DataFrame:
    """Decisions with a given count, scattered over people and scenes."""
    total = people * scenes * repeats
    rows = [
        {
            "participant": f"P{i % people:02d}",
            "scene": f"s{(i // people) % scenes}",
            "size": "x",
            "first": "ours",
            "second": "pp",
            "chosen": "ours" if (i * 35) % total < chosen else "pp",
        }
        for i in range(total)
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize("index", range(len(ORACLE["binom_counts"])))
def test_counts_of_the_printed_figure_give_the_p_values_of_r(index):
    found = preference(cell_with(ORACLE["binom_counts"][index]), "ours", "pp")

    assert found.trials == 132
    assert found.exact_p == pytest.approx(ORACLE["binom_p"][index], rel=1e-9)
    assert found.exact_lower == pytest.approx(ORACLE["binom_low"][index], abs=1e-9)
    assert found.exact_upper == pytest.approx(ORACLE["binom_high"][index], abs=1e-9)


def decisions_of(chosen: np.ndarray, repeats: int = 2) -> pd.DataFrame:
    """Decisions from how often each participant chose ours in each scene."""
    people, scenes = chosen.shape
    person, scene, repeat = np.indices((people, scenes, repeats)).reshape(3, -1)
    ours = repeat < chosen[person, scene]
    return pd.DataFrame(
        {
            "participant": [f"P{number:02d}" for number in person],
            "scene": [f"s{number}" for number in scene],
            "size": "x",
            "first": "ours",
            "second": "pp",
            "chosen": np.where(ours, "ours", "pp"),
        }
    )


def scattered(counts: list[int], scenes: int = 6, repeats: int = 2) -> np.ndarray:
    """Cells of participants with these counts, each spread evenly from another scene on."""
    cells = np.zeros((len(counts), scenes))
    place = 0
    for person, count in enumerate(counts):
        for step in range(count):
            cells[person, (place + step) % scenes] += 1
        place += count
    assert cells.max() <= repeats
    return cells


@pytest.mark.slow
@pytest.mark.parametrize("test", ["participant-scene", "participant", "pooled"])
@pytest.mark.parametrize("design", [(11, 6, 2), (6, 3, 2), (5, 4, 2), (30, 8, 1)])
def test_p_is_small_exactly_where_the_limits_leave_out_one_half(rng, test, design):
    people, scenes, repeats = design
    seen = set()
    for rate in (0.5, 0.65, 0.8, 0.97):
        for _ in range(12):
            logit = np.log(rate / (1 - rate)) + rng.normal(0, 0.5, (people, 1))
            cells = rng.binomial(
                repeats, 1 / (1 + np.exp(-np.broadcast_to(logit, (people, scenes))))
            )
            found = preference(decisions_of(cells, repeats), "ours", "pp", test=test)
            assert (found.test.p < 0.05) == (
                found.estimate.lower > 0.5 or found.estimate.upper < 0.5
            )
            seen.add(found.test.p < 0.05)
    assert len(seen) == 2 or people < 6


def test_people_who_agree_by_luck_show_no_more_than_their_trials():
    """Ten of 7 in 12 and one of 6: the variance is next to none, 76 of 132 is no proof."""
    found = preference(decisions_of(scattered([7] * 10 + [6])), "ours", "pp")

    assert found.test.p > 0.05
    assert found.estimate.lower < 0.5
    assert found.test.p == pytest.approx(found.exact_p, abs=0.03)
    assert any("such agreement can be luck" in note for note in found.warnings)


@pytest.mark.parametrize(
    "studies",
    [
        [[count] * 11 for count in range(6, 13)],
        [[12] * 10 + [count] for count in range(13)],
        [[12] * count + [6] * (11 - count) for count in range(12)],
    ],
    ids=["all alike", "the last dissenter", "more people who always choose"],
)
def test_more_agreement_is_never_weaker_evidence(studies):
    found = [preference(decisions_of(scattered(counts)), "ours", "pp") for counts in studies]
    p = np.array([one.test.p for one in found])
    lower = np.array([one.estimate.lower for one in found])

    assert np.all(np.diff(p) <= 1e-12)
    assert np.all(np.diff(lower) >= -1e-12)


def test_equivalence_is_shown_exactly_where_90_percent_limits_lie_within_the_margin(rng):
    seen = set()
    for sd in (0.05, 0.2, 0.5):
        for _ in range(15):
            logit = np.broadcast_to(rng.normal(0, sd, (25, 1)), (25, 10))
            rows = decisions_of(rng.binomial(2, 1 / (1 + np.exp(-logit))))
            found = preference(rows, "ours", "pp", margin=0.06)
            wide = preference(rows, "ours", "pp", alpha=0.1, margin=0.06)
            assert (found.equivalence_p < 0.05) == (
                wide.estimate.lower > 0.44 and wide.estimate.upper < 0.56
            )
            seen.add(found.equivalence_p < 0.05)
    assert len(seen) == 2


def test_p_is_never_less_than_so_many_participants_can_show():
    found = preference(cell_with(106), "ours", "pp")

    assert found.sign_flip_floor == 2 / 2**11
    assert found.test.p == found.sign_flip_floor
    assert found.test.name == "participants as votes"
    assert any(
        "held at 0.00098, the least that 11 participants can show" in n for n in found.warnings
    )


def test_limits_of_the_odds_of_one_decision_are_those_of_its_share():
    """One decision says nothing of other people: shares and odds are anything."""
    rows = pd.DataFrame(
        {"participant": ["P1"], "scene": ["s"], "first": ["a"], "second": ["b"], "chosen": ["a"]}
    )
    one = preference(rows, "a", "b")

    assert (one.estimate.lower, one.estimate.upper) == (0.0, 1.0)
    assert (one.odds_lower, one.odds_upper) == (0.0, math.inf)
    assert [big(odds) for odds in (0.0, math.inf)] == ["0", "\N{INFINITY}"]


@pytest.mark.parametrize("chosen", [0, 132])
def test_unanimous_cells_are_finite_and_significant(chosen):
    found = preference(cell_with(chosen), "ours", "pp")

    assert found.test.p == 2 / 2**11
    assert found.test.name == "participants as votes"
    assert any("all answers agree" in note for note in found.warnings)
    for name, value in found.row().items():
        if isinstance(value, float):
            assert math.isfinite(value) or (name == "odds_upper" and chosen), name
    assert found.verdict == ("preferred" if chosen else "rejected")
    assert found.equivalence_p == 1.0
    assert (found.estimate.lower > 0.6) if chosen else (found.estimate.upper < 0.4)


def test_a_study_of_answers_by_coin_is_undecided_or_equivalent(make_decisions):
    table = preferences(
        make_decisions(quality={"a": 0.0, "b": 0.0}, people=30, participant_sd=0.1), margin=0.15
    )

    assert {cell.verdict for cell in table.cells} == {"equivalent"}


def test_known_preferences_lie_within_their_limits(make_decisions):
    """Twelve studies of three comparisons at two sizes: about 95 % of limits cover the truth."""
    rng = np.random.default_rng(5)
    quality = {"metameric": 0.6, "push-pull": -0.9, "reference": 1.6}
    noise = rng.normal(0.0, 0.4 * np.sqrt(2), 200_000)
    hits = []
    for seed in range(12):
        for cell in preferences(make_decisions(seed=seed)).cells:
            gap = quality[cell.method] - quality[cell.against]
            truth = float(np.mean(1 / (1 + np.exp(-(gap + noise)))))
            hits.append(cell.estimate.lower <= truth <= cell.estimate.upper)

    assert np.mean(hits) >= 0.9


def test_holm_counts_every_pairing_at_every_size(make_decisions):
    table = preferences(make_decisions())
    p = np.array([cell.test.p for cell in table.cells])

    assert len(table.cells) == 6
    assert min(c.test.p_adjusted for c in table.cells) == pytest.approx(6 * p.min())
    assert all(cell.test.p_adjusted >= cell.test.p for cell in table.cells)


def test_the_protocols_test_decides_p(make_decisions):
    rows = pairing_rows(make_decisions(), "metameric", "push-pull", "small")
    by_test = {
        name: preference(rows, "metameric", "push-pull", "small", test=name)
        for name in ("participant-scene", "participant", "pooled")
    }

    assert by_test["pooled"].test.p == by_test["pooled"].exact_p
    assert by_test["participant"].test.df == 10.0
    assert by_test["pooled"].estimate.lower == by_test["pooled"].exact_lower
    assert any("independent" in note for note in by_test["pooled"].warnings)


def test_swapping_the_methods_mirrors_the_result(make_decisions):
    rows = pairing_rows(make_decisions(), "metameric", "push-pull", "small")
    one, other = (
        preference(rows, "metameric", "push-pull"),
        preference(rows, "push-pull", "metameric"),
    )

    assert one.estimate.share == pytest.approx(1 - other.estimate.share)
    assert one.test.p == pytest.approx(other.test.p)
    assert one.odds_ratio == pytest.approx(1 / other.odds_ratio)
    assert one.cohens_h == pytest.approx(-other.cohens_h)


@pytest.mark.parametrize(
    ("people", "scenes", "wanted"),
    [
        (1, 6, "one participant only"),
        (4, 6, "only 4 participants"),
        (11, 1, "one scene only"),
        (11, 3, "only 3 scenes"),
    ],
)
def test_results_say_when_not_to_trust_them(people, scenes, wanted):
    found = preference(cell_with(people * scenes, people, scenes), "ours", "pp")

    assert any(wanted in note for note in found.warnings)
    assert math.isfinite(found.test.p)


def test_unbalanced_designs_are_flagged():
    rows = cell_with(80).iloc[5:-3]

    assert any("unbalanced" in note for note in preference(rows, "ours", "pp").warnings)


def test_a_participant_with_three_trials_is_flagged_and_breaks_nothing():
    rows = cell_with(80)
    few = rows[rows["participant"] == "P00"].head(3)
    found = preference(pd.concat([rows[rows["participant"] != "P00"], few]), "ours", "pp")

    assert any("fewer than 4 trials" in note for note in found.warnings)
    assert math.isfinite(found.test.p)


def test_missing_columns_and_pairings_are_refused_in_words():
    with pytest.raises(ValueError, match=r"missing: \['scene'\]"):
        preferences(cell_with(3).drop(columns="scene"))
    with pytest.raises(ValueError, match="at least one row"):
        preferences(cell_with(3).head(0))
    with pytest.raises(ValueError, match="at least one of the pairings"):
        preferences(cell_with(3), pairings=[("x", "y")])


def test_a_comparison_without_decisions_is_refused_in_words():
    none = decisions_of(np.ones((2, 2))).iloc[:0]

    with pytest.raises(ValueError, match="must compare ours with blur"):
        preference(none, "ours", "blur")


def test_comparisons_grouped_once_hold_the_rows_of_each(make_decisions):
    rows = make_decisions()
    grouped = Comparisons(rows)

    for pair in (("metameric", "push-pull"), ("push-pull", "metameric")):
        for size in (*grouped.sizes, "all"):
            found, wanted = grouped.rows(*pair, size), pairing_rows(rows, *pair, size)
            assert list(found.index) == list(wanted.index)
            assert list(found["chosen"]) == list(wanted["chosen"])
    for nothing in (("metameric", "nobody", "small"), ("metameric", "push-pull", "huge")):
        assert grouped.rows(*nothing).empty


def test_a_comparisons_row_names_every_number_of_its_parts_once():
    found = preference(cell_with(80), "ours", "pp")
    numbers = [value for part in (found.estimate, found.test) for value in vars(part).values()]
    numbers += [value for name, value in vars(found).items() if name not in ("estimate", "test")]

    row = found.row()

    assert len(row) == len(numbers)
    assert [value for value in numbers if value not in row.values()] == []
    assert (row["p"], row["equivalence_p"]) == (found.test.p, found.equivalence_p)


def test_counts_lay_people_and_scenes_out():
    chosen, shown, people, scenes = counts(cell_with(11), "ours")

    assert shown.shape == (11, 6)
    assert people[0] == "P00"
    assert len(scenes) == 6
    assert chosen.sum() == 11


def test_cohens_h_by_hand():
    """sin² of 60° is .75: h = 2 (60° - 45°) in radians."""
    assert cohens_h(0.75) == pytest.approx(np.deg2rad(30))


def test_verdicts_of_equivalence_are_adjusted_like_the_tests(make_decisions):
    rows = make_decisions(quality={"a": 0.0, "b": 0.0, "c": 0.0}, people=40, participant_sd=0.1)
    table = preferences(rows, margin=0.06)
    alone = preferences(rows, margin=0.06, correction="none")
    p = np.array([cell.equivalence_p for cell in table.cells])

    np.testing.assert_allclose([cell.equivalence_p_adjusted for cell in table.cells], holm(p))
    assert [cell.equivalence_p_adjusted for cell in alone.cells] == list(p)
    for cell in table.cells:
        shown = cell.test.p_adjusted >= 0.05 and cell.equivalence_p_adjusted < 0.05
        assert (cell.verdict == "equivalent") == shown
    assert sum(cell.verdict == "equivalent" for cell in table.cells) < sum(
        cell.verdict == "equivalent" for cell in alone.cells
    )


def test_six_verdicts_of_equivalence_at_the_boundary_err_no_more_than_one_should(rng, proof_count):
    """True shares of .6, margin .1: any of six called equivalent is wrong."""
    studies = proof_count(4000)
    logit = np.log(0.6 / 0.4) + rng.normal(0, 0.2, (studies, 6, 20, 1))
    chosen = rng.binomial(4, 1 / (1 + np.exp(-np.broadcast_to(logit, (studies, 6, 20, 8)))))
    p = two_way(chosen, 4.0).equivalence_p(0.1)
    slack = 3.5 * np.sqrt(0.05 * 0.95 / studies)

    assert np.mean((p < 0.05).any(axis=1)) > 0.12
    assert np.mean((holm(p) < 0.05).any(axis=1)) <= 0.06 + slack


@pytest.mark.parametrize(("people", "count"), [(6, 2), (8, 7)])
def test_a_family_too_large_for_its_participants_says_so_and_how_many_it_takes(people, count):
    """All agree: the least p that so many people can show, times the number of comparisons."""

    def table(people):
        names = [f"m{k:02}" for k in range(count + 1)]
        rows = [
            (f"P{who}", f"S{scene}", "10", "none", name, "none")
            for who in range(people) for name in names[:count] for scene in range(5)
        ]  # fmt: skip
        columns = ["participant", "scene", "size", "first", "second", "chosen"]
        pairings = [("none", name) for name in names[:count]]
        return preferences(pd.DataFrame(rows, columns=columns), pairings=pairings, sizes=["10"])

    family = FamilyOfTests("comparison", count=count)
    (note,) = family.hopeless(people, 0.05)
    needed = int(re.search(r"that takes (\d+) participants", note)[1])

    assert min(cell.test.p_adjusted for cell in table(people).cells) >= 0.05
    assert min(cell.test.p_adjusted for cell in table(needed).cells) < 0.05
    assert min(cell.test.p_adjusted for cell in table(needed - 1).cells) >= 0.05
    assert family.hopeless(needed, 0.05) == []
