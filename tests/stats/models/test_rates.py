"""Shares of right answers: limits and p from one procedure, and what few people can show."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

from analysis.models.clustered import two_way
from analysis.models.right_answers import contrasts, correct_rates, rate_contrasts, share_influence
from analysis.simulations import mean_logit

DEVIATIONS = ((0, 0), (0.5, 0), (1, 0), (0.5, 0.5), (0.63, 0.43))
DESIGNS = ((11, 6, 2), (6, 3, 2), (30, 20, 1))


def answers(rng, rate, sd, design, studies):
    """Right answers (studies, participants, scenes) whose mean rate is `rate`."""
    people, scenes, repeats = design
    logit = mean_logit(rate, float(np.hypot(*sd)))
    logit = logit + sd[0] * rng.standard_normal((studies, people, 1))
    logit = logit + sd[1] * rng.standard_normal((studies, 1, scenes))
    return rng.binomial(repeats, expit(logit)).astype(float)


def table(right, *, shown=2, method="ours"):
    """Trials of one study, cell by cell."""
    rows = [
        {"participant": p, "scene": s, "method": method, "correct": int(k < right[p][s])}
        for p in range(len(right))
        for s in range(len(right[0]))
        for k in range(shown)
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize("rate", [0.5, 0.65, 0.8, 0.9, 0.95, 0.99])
def test_limits_cover_and_p_is_small_exactly_where_they_leave_out_chance(
    rng, proof_count, design, rate
):
    """Coverage .935 or more and false positives .06 or fewer, at every deviation.

    Of the larger designs .035 or more too; fewer only where trials are nearly independent,
    because p is never smaller than theirs (docs/decisions/0160).
    """
    studies = proof_count(8_000)
    slack = 3.5 * np.sqrt(0.05 * 0.95 / studies)
    for sd in DEVIATIONS:
        right = answers(rng, rate, sd, design, studies)
        shown = np.full(design[:2], float(design[2]))
        found = two_way(right, shown)
        lower, upper = found.limits(0.95, 0.5)
        p = found.p_value(0.5)

        assert np.mean((lower <= rate) & (rate <= upper)) >= 0.935 - slack, sd
        np.testing.assert_array_equal(p < 0.05, (lower > 0.5) | (upper < 0.5))
        assert np.all((lower >= 0) & (upper <= 1) & (lower <= upper))
        if rate == 0.5:
            assert np.mean(p < 0.05) <= 0.06 + slack, sd
            if design != (6, 3, 2):
                least = {(0, 0): 0.015, (0.5, 0): 0.027}.get(sd, 0.035)
                assert np.mean(p < 0.05) >= least - slack, sd


@pytest.mark.parametrize("people", range(2, 13))
def test_exact_chance_is_never_significant(people):
    """Everybody has 6 of 12: the share is .5 and nothing varies."""
    (found,) = correct_rates(table(np.ones((people, 6))), chance=0.5)

    assert found.share == 0.5
    assert found.p == 1.0
    assert found.lower < 0.5 < found.upper


def test_chance_of_four_alternatives_is_a_quarter():
    right = np.tile([1, 0, 0, 0], (8, 1))
    (found,) = correct_rates(table(right, shown=1), chance=0.25)

    assert found.p == 1.0
    assert found.exact_p == pytest.approx(1.0)
    assert found.lower < 0.25 < found.upper


@pytest.mark.parametrize("people", [4, 5, 6, 11])
def test_perfect_participants_count_as_votes(people):
    """By hand: p = 2 / 2^n; of one trial each, the exact binomial limit of n of n votes."""
    (found,) = correct_rates(table(np.full((people, 6), 2)), chance=0.5)
    (once,) = correct_rates(table(np.ones((people, 1)), shown=1), chance=0.5)

    assert found.p == once.p == pytest.approx(2 / 2**people)
    assert once.lower == pytest.approx(0.025 ** (1 / people))
    assert found.lower >= once.lower
    assert (found.lower > 0.5) == (people > 5)
    assert found.upper == 1.0
    assert f"p is held at {2 / 2**people:.2g}, the least that {people} participants" in str(
        found.warnings
    )
    (split,) = correct_rates(table(np.full((people, 6), 1)), chance=0.5)
    assert "held" not in str(split.warnings)


def test_more_right_answers_are_never_weaker_evidence():
    """The last wrong answer of 132 must not make p smaller than none does."""
    p = []
    for wrong in range(12):
        right = np.full((11, 6), 2.0)
        right.flat[np.arange(wrong) * 5] -= 1
        p.append(float(two_way(right, np.full((11, 6), 2.0)).p_value(0.5)))

    assert np.all(np.diff(p) >= 0)
    assert p[0] == pytest.approx(2 / 2**11)


def test_ten_people_alike_and_one_not_are_judged_as_their_limits_say():
    """7 of 12 for ten, 6 of 12 for one: a Wald t said p = 1.6e-6 beside limits from .48."""
    right = np.array([[2, 1, 1, 1, 1, 1]] * 10 + [[1] * 6], dtype=float)
    found = two_way(right.sum(1)[:, None], np.full((11, 1), 12.0))
    lower, upper = found.limits(0.95, 0.5)
    p = found.p_value(0.5)

    assert p > 0.05
    assert lower < 0.5 < upper


def test_one_participant_gets_exact_limits_and_a_warning():
    (found,) = correct_rates(table(np.array([[2, 2, 1]])), chance=0.5)

    assert found.p == found.exact_p
    assert any("one participant" in note for note in found.warnings)


def test_without_scenes_only_participants_cluster():
    rows = table(np.array([[2, 1], [1, 1], [2, 2]]))
    (with_one,) = correct_rates(rows.assign(scene="x"), chance=0.5)
    (without,) = correct_rates(rows.drop(columns="scene"), chance=0.5)

    assert (with_one.lower, with_one.upper, with_one.p) == (without.lower, without.upper, without.p)


def test_influence_of_a_share_is_the_two_way_error_itself(rng):
    shown = rng.integers(1, 4, (9, 5)).astype(float)
    happened = rng.binomial(shown.astype(int), 0.6).astype(float)

    moved = share_influence(happened, shown)
    one = moved.estimate()
    other = two_way(happened, shown)

    assert float(one.value) == pytest.approx(float(other.share))
    assert float(one.standard_error) == pytest.approx(
        max(float(other.standard_error), np.sqrt(moved.least))
    )
    assert float(one.df) == pytest.approx(float(other.df))


def test_differences_find_what_each_person_does_better_and_holm_adjusts(rng):
    """People differ by far more than methods do; the comparison is within people."""
    ability = np.linspace(0.3, 0.8, 10)
    parts = [
        table(rng.binomial(8, ability[:, None] + gain, (10, 6)), shown=8, method=name)
        for name, gain in (("a", 0.0), ("b", 0.0), ("c", 0.15))
    ]
    found = rate_contrasts(pd.concat(parts), ("method",))
    by_pair = {(one.first, one.second): one for one in found}

    assert by_pair["a", "c"].p_adjusted < 0.01
    assert by_pair["a", "c"].upper < 0
    assert by_pair["a", "b"].p > 0.05
    assert all(one.p <= one.p_adjusted for one in found)
    only = rate_contrasts(pd.concat(parts), ("method",), reference="a")
    assert [(one.first, one.second) for one in only] == [("b", "a"), ("c", "a")]


def test_an_unknown_reference_is_refused():
    with pytest.raises(ValueError, match=r"reference must be one of \['ours'\]"):
        contrasts("x", {"ours": share_influence(np.ones((2, 2)), np.ones((2, 2)))}, reference="b")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows.drop(columns="correct"), "missing"),
        (lambda rows: rows.assign(correct=2), "0 and 1"),
        (lambda rows: rows.assign(method=np.nan), "value in every row"),
        (lambda rows: rows.iloc[:0], "must hold rows"),
    ],
)
def test_tables_that_cannot_be_counted_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        correct_rates(change(table(np.ones((3, 2)))), ("method",), chance=0.5)


def test_chance_must_be_a_share():
    with pytest.raises(ValueError, match="between 0 and 1"):
        correct_rates(table(np.ones((3, 2))), chance=1.0)
