"""The observer check finds who answers unlike the others, and seldom anyone else."""

import numpy as np
import pytest

from analysis.models.observers import check_observers
from analysis.models.paired.paired_counts import choice_share


def study(rng, *, spread, odd=None, people=11, trials=24, tail_df=None):
    quality = np.array([1.0, 0.2, -1.2])
    first, second = np.triu_indices(3, 1)
    taste = rng.standard_normal((people, 3))
    if tail_df is not None:
        taste = rng.standard_t(tail_df, (people, 3)) / np.sqrt(tail_df / (tail_df - 2))
    own = quality + spread * taste
    if odd == "random":
        own[0] = 0.0
    if odd == "reversed":
        own[0] = -quality
    share = choice_share(own[:, first] - own[:, second])
    answers = rng.binomial(trials, share)
    votes = np.zeros((people, 3, 3))
    votes[:, first, second], votes[:, second, first] = answers, trials - answers
    return votes


NAMES = [f"P{i}" for i in range(11)]


@pytest.mark.slow
@pytest.mark.parametrize(("spread", "tail_df"), [(0.0, None), (0.5, None), (1.5, None), (0.7, 3.0)])
def test_clean_studies_flag_anyone_about_as_rarely_as_stated(rng, proof_count, spread, tail_df):
    """Family-wise .05, also where people differ by 1.5 JOD or some differ much more than most."""
    flagged = [
        bool(
            check_observers(
                study(rng, spread=spread, tail_df=tail_df), NAMES, rng=rng, studies=150
            ).flagged
        )
        for _ in range(proof_count(400))
    ]

    assert np.mean(flagged) <= 0.07 + 3 * np.sqrt(0.05 * 0.95 / len(flagged))


@pytest.mark.parametrize("spread", [0.5, 1.5])
def test_the_spread_between_observers_is_recovered(rng, spread):
    """By moments alone 1.5 JOD look like one."""
    found = [
        check_observers(study(rng, spread=spread), NAMES, rng=rng, studies=100).spread
        for _ in range(12)
    ]

    assert np.mean(found) == pytest.approx(spread, abs=0.25 * spread + 0.05)


def test_a_reversed_observer_is_flagged_and_the_others_are_not(rng):
    found = [
        check_observers(study(rng, spread=0.3, odd="reversed"), NAMES, rng=rng, studies=200)
        for _ in range(15)
    ]

    assert np.mean([one.flagged == ("P0",) for one in found]) >= 0.8


def test_an_observer_who_answers_the_other_way_round_is_found_where_people_differ(rng):
    """At a spread of .5 JOD the distance alone found .4 to .7 of them."""
    odd = [
        check_observers(study(rng, spread=0.5, odd="reversed", trials=12), NAMES, rng=rng)
        for _ in range(10)
    ]
    clean = [check_observers(study(rng, spread=0.5), NAMES, rng=rng) for _ in range(10)]

    assert np.mean([one.turned == ("P0",) for one in odd]) >= 0.9
    assert np.mean([bool(one.turned) for one in clean]) <= 0.2
    assert odd[0].agreement[0] < 0 < odd[0].agreement[1:].mean()


def test_an_observer_by_coin_is_flagged_where_others_agree(rng):
    found = [
        check_observers(study(rng, spread=0.0, odd="random"), NAMES, rng=rng, studies=200)
        for _ in range(15)
    ]

    assert np.mean(["P0" in one.flagged for one in found]) >= 0.7


def test_three_observers_are_too_few_to_judge(rng):
    found = check_observers(study(rng, spread=0.3, people=3), NAMES[:3], rng=rng)

    assert found.flagged == ()
    assert "fewer than four" in found.warnings[0]


def test_unanimous_answers_do_not_break_the_check(rng):
    votes = np.zeros((6, 3, 3))
    votes[:, 0, 1] = votes[:, 0, 2] = votes[:, 1, 2] = 12

    found = check_observers(votes, NAMES[:6], rng=rng, studies=100)

    assert np.all(np.isfinite(found.distance))
    assert found.flagged == ()
