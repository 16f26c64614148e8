"""Scales: values worked by hand, limits, batches, and what must be refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.models.bootstrap import bootstrap_scale, bootstrap_scores, expanded_tail
from analysis.models.clustered import holm
from analysis.models.paired.paired_counts import (
    choice_share,
    difference_design,
    has_maximum,
    solve_pairs,
)
from analysis.models.scaling import scale

NAMES3 = ("a", "b", "c")


def test_two_conditions_at_75_percent_are_one_jod_apart():
    fitted = scale(np.array([[0, 75], [25, 0]]), ("a", "b"))

    assert fitted.scores[0] - fitted.scores[1] == pytest.approx(1.0, abs=1e-9)
    assert fitted.unit == "JOD"


@pytest.mark.parametrize("votes", [1e2, 1e4, 1e6, 1e9])
def test_scores_do_not_depend_on_how_many_votes_the_shares_come_from(votes):
    shares = np.array([[0, 0.8, 0.999], [0.2, 0, 0.9], [0.001, 0.1, 0]])

    few, many = scale(100 * shares, NAMES3), scale(votes * shares, NAMES3)

    np.testing.assert_allclose(many.scores, few.scores, atol=1e-8)


def test_a_tie_as_half_a_vote_each_way_pulls_scores_together():
    wins = np.array([[0, 8.0], [2.0, 0]])
    tied = wins + np.array([[0, 2.0], [2.0, 0]])

    apart = scale(wins, ("a", "b")).scores
    together = scale(tied, ("a", "b")).scores

    assert 0 < together[0] < apart[0]


def test_disconnected_designs_are_refused_with_their_groups_named():
    wins = np.zeros((4, 4))
    wins[0, 1] = wins[1, 0] = wins[2, 3] = wins[3, 2] = 5

    with pytest.raises(ValueError, match=r"2 separate groups: \{a, b\}; \{c, d\}"):
        scale(wins, ("a", "b", "c", "d"))


@pytest.mark.parametrize(
    ("wins", "names", "message"),
    [
        (np.zeros((2, 3)), ("a", "b"), "2x2"),
        (np.array([[0, -1], [1, 0]]), ("a", "b"), "not negative"),
        (np.array([[0, np.nan], [1, 0]]), ("a", "b"), "finite"),
        (np.ones((2, 2)), ("a", "a"), "distinct"),
    ],
)
def test_impossible_tables_are_refused_in_words(wins, names, message):
    with pytest.raises(ValueError, match=message):
        scale(wins, names)


def test_a_condition_that_always_wins_stays_finite_and_is_flagged():
    wins = np.array([[0, 132, 132], [0, 0, 100], [0, 32, 0]], dtype=float)

    fitted = scale(wins, NAMES3)

    assert np.all(np.isfinite(fitted.scores))
    assert fitted.scores[0] > fitted.scores[1] > fitted.scores[2]
    assert "lower bound" in fitted.warnings[0]


def test_a_maximum_exists_exactly_where_the_win_graph_is_strongly_connected():
    chain = np.array([[0, 1, 1], [0, 0, 1], [0, 0, 0]], dtype=bool)
    circle = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], dtype=bool)

    assert not has_maximum(chain)
    assert has_maximum(circle)
    np.testing.assert_array_equal(has_maximum(np.stack([chain, circle])), [False, True])


@given(st.integers(0, 10_000))
def test_a_batch_gives_what_its_entries_give_alone(seed):
    rng = np.random.default_rng(seed)
    won, lost = rng.integers(1, 20, (5, 6)).astype(float), rng.integers(1, 20, (5, 6)).astype(float)
    design = difference_design(4)

    together = solve_pairs(design, won, lost).parameters
    alone = [solve_pairs(design, k, n).parameters for k, n in zip(won, lost, strict=True)]

    np.testing.assert_allclose(together, np.stack(alone), atol=1e-9)


def _votes(
    rng, people=11, scenes=6, repeats=2, spread=0.5, scene_spread=0.0, quality=(1.0, 0.0, -1.0)
):
    own = (
        np.array(quality)
        + rng.normal(0, spread, (people, 1, 3))
        + rng.normal(0, scene_spread, (1, scenes, 3))
    )
    first, second = np.triu_indices(3, 1)
    share = choice_share(own[..., first] - own[..., second])
    answers = rng.binomial(repeats, share)
    votes = np.zeros((people, scenes, 3, 3))
    votes[..., first, second] = answers
    votes[..., second, first] = repeats - answers
    return votes


def test_bootstrap_of_identical_participants_has_no_spread(rng):
    one = np.array([[0, 3.0, 4.0], [1.0, 0, 3.0], [1.0, 1.0, 0]])
    votes = np.broadcast_to(one, (5, 4, 3, 3))

    scores = bootstrap_scores(votes, rng=rng, samples=50)

    np.testing.assert_allclose(scores, np.tile(scale(one, NAMES3).scores, (50, 1)), atol=1e-5)


def test_bootstrap_limits_are_wider_when_scenes_are_drawn_too(rng):
    votes = _votes(rng, scene_spread=0.5)

    both = bootstrap_scale(votes, rng=np.random.default_rng(1))
    people = bootstrap_scale(votes, rng=np.random.default_rng(1), scenes=False)

    assert np.all(both.upper - both.lower > people.upper - people.lower)
    assert any("these scenes only" in note for note in people.warnings)


def test_expanded_tail_is_wider_than_the_nominal_one_and_tends_to_it():
    assert expanded_tail(0.95, 11) < 0.015
    assert expanded_tail(0.95, 100_000) == pytest.approx(0.025, abs=1e-4)


@pytest.mark.parametrize("scene_spread", [0.0, 0.4])
def test_jod_limits_cover_the_truth_with_eleven_observers(rng, scene_spread):
    """Moderate: 120 studies, 3 conditions; 1,000 and more in benchmarks/. Floor .93 there."""
    wide = _votes(rng, people=60_000, scenes=1, repeats=1, spread=np.hypot(0.5, scene_spread))
    truth = scale(wide.sum(axis=(0, 1)), NAMES3).scores
    hits = []
    for _ in range(120):
        limits = bootstrap_scale(_votes(rng, scene_spread=scene_spread), rng=rng, samples=400)
        hits.append((limits.lower <= truth) & (truth <= limits.upper))

    assert np.mean(hits) >= 0.93


@pytest.mark.parametrize(("spread", "scene_spread"), [(0.5, 0.0), (0.5, 0.4), (0.8, 0.4)])
def test_differences_without_an_effect_are_significant_as_seldom_as_they_say(
    rng, proof_count, spread, scene_spread
):
    studies = proof_count(400)
    wrong = []
    for _ in range(studies):
        votes = _votes(rng, spread=spread, scene_spread=scene_spread, quality=(0.0, 0.0, 0.0))
        limits = bootstrap_scale(votes, rng=rng, samples=300)
        wrong.append(limits.difference_p[np.triu_indices(3, 1)] < 0.05)

    assert np.mean(wrong) <= 0.06 + 3.5 * np.sqrt(0.05 * 0.95 / (2 * studies))


def test_p_of_a_difference_is_small_exactly_where_its_limits_leave_out_zero(rng):
    above = np.triu_indices(3, 1)
    seen = []
    for people in (4, 8, 11):
        for _ in range(8):
            limits = bootstrap_scale(_votes(rng, people=people, spread=0.7), rng=rng, samples=200)
            out = (limits.difference_lower > 0) | (limits.difference_upper < 0)
            np.testing.assert_array_equal(limits.difference_p < 0.05, out)
            np.testing.assert_array_equal(limits.difference_p, limits.difference_p.T)
            np.testing.assert_allclose(
                limits.difference_p_adjusted[above], holm(limits.difference_p[above])
            )
            seen += list(out[above])
    assert 0 < np.mean(seen) < 1


def test_a_strong_difference_is_not_bound_to_the_number_of_draws(rng):
    """All 200 draws lie beyond 0: p goes on past one in 200, down to that of eleven people."""
    votes = _votes(rng, spread=0.1)
    p = bootstrap_scale(votes, rng=rng, samples=200).difference_p

    assert p[0, 2] < 0.005
    assert p[0, 2] >= 2 / 2**11
