"""Rounding, which differs between processors, moves no p and no choice."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.models.bootstrap import difference_limits
from analysis.models.clustered import ClusteredEstimate, holm, participant_t, sign_flip_p, two_way
from analysis.models.contrasts import crossed_means_p
from analysis.models.curves.goodness_of_fit import _as_large
from analysis.models.curves.psychometric_posterior import compare_thresholds, psychometric_posterior
from analysis.models.mixed.inference import Draws, p_of_draws
from analysis.models.numeric import binomial_below, exact_binomial, tied, zeroed
from analysis.models.trends import trend
from analysis.power import first_reaching

NOISE = 1e-15
FIVE_SCENES = np.random.default_rng(4).binomial(2, 0.6, (12, 5)).astype(float)


def _plateau(rng):
    """Return draws (samples, differences) of which many are 0, as those of few people are."""
    return np.stack(
        [
            np.round(rng.normal(0.3, 1.0, 400)),
            np.where(rng.random(400) < 0.4, 0.0, rng.normal(0.5, 1.0, 400)),
            np.maximum(rng.normal(0.2, 0.5, 400), 0.0),
            np.zeros(400),
            np.full(400, 0.7),
        ],
        axis=1,
    )


def _limits(drawn):
    return np.stack(difference_limits(drawn, 6, 0.95))


def _estimate(values):
    people = np.full(4, 5.0)
    found = ClusteredEstimate(values[:4], np.full(4, 0.2), people - 1.0, people)
    return found.p_value()


def _trend(values):
    order = np.tile(np.arange(10), 4)
    who = np.repeat(list("abcd"), 10)
    rows = pd.DataFrame({"participant": who, "order": order, "outcome": values})
    found = trend(rows, "outcome")
    return found.p, found.sign_flip_p, found.spearman_p


def _drawn(values):
    rest = iter(values[1:])
    draws = Draws(values.size - 1, np.random.default_rng(0))
    return p_of_draws(values[0], draws.ratios(lambda _: next(rest)))


@pytest.mark.parametrize(
    ("judged", "values"),
    [
        (_limits, _plateau(np.random.default_rng(1))),
        (crossed_means_p, np.round(np.random.default_rng(2).normal(0.0, 1.0, (40, 4, 3)))),
        (crossed_means_p, np.zeros((2, 4, 3))),
        (crossed_means_p, np.full((2, 4, 1), 0.3)),
        (sign_flip_p, np.array([0.5, -0.5, 0.25, 0.25, -0.5])),
        (sign_flip_p, np.tile([0.5, -0.5, 0.0], 8)),
        (participant_t, np.zeros(5)),
        (_estimate, np.array([0.0, 0.1, -0.2, 0.0])),
        (holm, np.array([0.02, 0.02, 0.3, 0.02])),
        (_trend, np.tile([0.0, 1.0, 0.5, 0.5, 0.0, 1.0, 1.0, 0.5, 0.0, 1.0], 4)),
        (_trend, np.full(40, 0.3)),
        (_drawn, np.array([0.0, *np.zeros(10), 1.0, 2.0])),
        (_drawn, np.array([1.0, *np.ones(10), 0.0, 2.0])),
        (lambda found: _as_large(found[1:], found[:1]), np.array([3.0, 3.0, 3.0, 2.0, 5.0])),
        (lambda curve: first_reaching([4, 6, 8], curve, 0.8), np.array([0.5, 0.8, 0.9])),
        (lambda shares: two_way(shares, np.full((4, 3), 2.0)).p_value(), np.ones((4, 3))),
        (lambda seen: two_way(FIVE_SCENES, seen).p_value(), np.full((12, 5), 2.0)),
        (tied, np.array([0.0, 1.0, 0.0, 0.5, 0.5])),
    ],
)
def test_noise_of_rounding_moves_no_p(judged, values):
    expected = np.asarray(judged(values))

    for seed in range(5):
        noise = NOISE * np.random.default_rng(seed).standard_normal(values.shape)

        np.testing.assert_allclose(
            np.asarray(judged(values + noise)), expected, rtol=1e-6, atol=1e-12
        )


def test_a_lost_trial_of_five_scenes_tips_no_rule():
    """Counted by weight, five scenes were fewer than five once a trial was lost."""
    rng = np.random.default_rng(0)
    taste = 0.5 + rng.normal(0.0, 0.6, (1000, 12, 1)) + rng.normal(0.0, 0.5, (1000, 1, 5))
    chosen = rng.binomial(2, 1.0 / (1.0 + np.exp(-taste))).astype(float)
    shown = np.full((1000, 12, 5), 2.0)
    whole = two_way(chosen, shown).p_value()
    shown[:, 0, 0], chosen[:, 0, 0] = 1.0, np.minimum(chosen[:, 0, 0], 1.0)
    lost = two_way(chosen, shown).p_value()

    assert abs((lost < 0.05).mean() - (whole < 0.05).mean()) < 0.005


def test_draws_that_are_0_count_half_on_either_side():
    """By hand: of 101 draws 20 lie below 0, 41 at 0 and 40 above; 0 is at place .40."""
    drawn = np.concatenate([np.full(20, -1.0), np.zeros(41), np.full(40, 1.0)])[:, None]
    apart = np.concatenate([np.linspace(-1, -0.5, 40), [0.0], np.linspace(0.5, 1, 60)])[:, None]

    assert difference_limits(drawn, 6, 0.95)[2] == pytest.approx(
        difference_limits(apart, 6, 0.95)[2]
    )


def test_thresholds_of_the_same_answers_do_not_differ():
    shown = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5, 6, 9, 10.0]), np.full(4, 10.0)
    one = psychometric_posterior(*shown)

    (found,) = compare_thresholds({"a": one, "b": one})

    assert found.larger == pytest.approx(0.5)
    assert found.p == pytest.approx(1.0)


def test_numbers_are_0_relative_to_their_scale():
    np.testing.assert_array_equal(zeroed(np.array([1e-8, 1.0, -1e-5]), 1e4), [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(zeroed(np.array([1e-10, 1e-8])), [0.0, 1e-8])


@pytest.mark.parametrize("chance", [0.5, 0.25, 1 / 3])
@pytest.mark.parametrize(("count", "trials"), [(0, 7), (7, 7), (13, 20), (3, 400), (240, 400)])
def test_exact_binomials_are_those_of_scipy(count, trials, chance):
    known = stats.binomtest(count, trials, chance)
    p, *ends = exact_binomial(count, trials, chance, 0.9)

    assert p == pytest.approx(known.pvalue, rel=1e-9)
    assert ends == pytest.approx(known.proportion_ci(0.9, "exact"), abs=1e-9)
    below = stats.binom.cdf(count, trials, chance)
    assert binomial_below(count, trials, chance) == pytest.approx(below, rel=1e-9)
