"""One mixed model of all pairings: against lme4, against chance, and where it cannot be had."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.models.paired.bradley_terry_mixed import paired_model

ORACLES = Path(__file__).parents[1] / "oracles"
LME4 = json.loads((ORACLES / "oracle_paired.json").read_text())
METHODS = ("a", "b", "c")


@pytest.fixture(scope="module")
def paired() -> pd.DataFrame:
    """Choices of 10 made-up participants between 3 methods, as R saw them."""
    return pd.read_csv(ORACLES / "paired.csv")


def made_up(rng, taste_sd, people=11, scenes=6, repeats=2):
    """Choices without any effect: people differ in how they like each method, by `taste_sd`."""
    person, _, repeat, pair = (
        axis.ravel()
        for axis in np.meshgrid(
            range(people), range(scenes), range(repeats), range(3), indexing="ij"
        )
    )
    low, high = np.array([[0, 1], [0, 2], [1, 2]])[pair].T
    swapped = repeat % 2 == 1
    first, second = np.where(swapped, high, low), np.where(swapped, low, high)
    own = taste_sd * rng.standard_normal((people, 3))
    share = 1 / (1 + np.exp(own[person, second] - own[person, first]))
    chosen = np.where(rng.random(share.size) < share, first, second)
    names = np.array(METHODS)
    return pd.DataFrame(
        {
            "participant": person,
            "scene": _,
            "first": names[first],
            "second": names[second],
            "chosen": names[chosen],
        }
    )


def test_estimates_errors_deviations_and_ratios_equal_lme4s(paired):
    found = paired_model(paired, METHODS)
    b, c = -np.array([one.estimate for one in found.contrasts[:2]])

    assert [found.shown_first, b, c] == pytest.approx(LME4["beta"], abs=2e-4)
    errors = [one.standard_error for one in found.contrasts[:2]]
    assert [found.shown_first_error, *errors] == pytest.approx(LME4["beta_se"], abs=1e-4)
    assert list(found.random_sd.values()) == pytest.approx(LME4["sd"], abs=1e-4)
    assert found.log_likelihood == pytest.approx(LME4["loglik"][0], abs=1e-5)
    assert [one.ratio for one in found.contrasts] == pytest.approx(
        [LME4[f"ratio_{pair}"][0] for pair in ("ab", "ac", "bc")], abs=1e-4
    )


def test_which_method_is_named_first_turns_signs_and_nothing_else(paired):
    there = paired_model(paired, METHODS)
    back = paired_model(paired, METHODS[::-1])

    for one in there.contrasts:
        (other,) = [c for c in back.contrasts if {c.first, c.second} == {one.first, one.second}]
        assert other.first == one.second
        assert other.estimate == pytest.approx(-one.estimate, abs=1e-5)
        assert other.ratio == pytest.approx(one.ratio, abs=1e-5)
        assert other.p_adjusted >= other.p


@pytest.mark.slow
def test_equal_methods_seldom_differ_where_people_do(rng, proof_count):
    """Tastes of sd .7, so pairings of sd 1: without random slopes a quarter of p are small."""
    p = [
        contrast.p
        for _ in range(proof_count(200))
        for contrast in paired_model(made_up(rng, 0.7), METHODS).contrasts[:1]
    ]

    assert np.mean(np.array(p) < 0.05) < 0.06 + 3 * np.sqrt(0.05 * 0.95 / len(p))


def test_answers_without_any_spread_are_fitted_and_said_to_have_none(rng):
    found = [paired_model(made_up(rng, 0.0, people=6, scenes=3), METHODS) for _ in range(4)]

    singular = [one for one in found if min(one.random_sd.values()) < 1e-3]
    assert singular
    for one in singular:
        assert any("no variance of methods" in note for note in one.warnings)
        assert all(np.isfinite(contrast.p) for contrast in one.contrasts)


def test_a_method_that_always_wins_is_compared_with_none(rng):
    table = made_up(rng, 0.3)
    always = (table["first"] == "a") | (table["second"] == "a")
    found = paired_model(table.assign(chosen=table["chosen"].mask(always, "a")), METHODS)

    assert found.contrasts == ()
    assert "no finite maximum" in found.warnings[0]


def test_separate_groups_of_methods_and_single_participants_are_refused(rng):
    table = made_up(rng, 0.3)
    apart = table[(table["first"] != "c") & (table["second"] != "c")]

    with pytest.raises(ValueError, match="link all methods"):
        paired_model(apart, METHODS)
    with pytest.raises(ValueError, match="two participants"):
        paired_model(table[table["participant"] == 0], METHODS)
