"""Psychometric functions: recovery, definitions, limits, flags."""

import numpy as np
import pandas as pd
import pytest

from analysis.models.logistic import glm_logit
from analysis.models.psychometric import CurveForm, fit_psychometric, sigmoid

LEVELS = np.linspace(-3, 3, 9)


@pytest.mark.parametrize("shape", ["gauss", "logistic"])
def test_width_spans_the_rise_from_5_to_95_percent(shape):
    ends = sigmoid(np.array([0.0, 1.0, 2.0]), 1.0, 2.0, shape)

    np.testing.assert_allclose(ends, [0.05, 0.5, 0.95], atol=1e-12)


def test_weibull_has_its_threshold_and_width_on_the_axis_of_x():
    x = np.linspace(0.01, 8, 40_000)
    rise = sigmoid(x, 2.0, 3.0, "weibull")
    low, high = x[np.searchsorted(rise, 0.05)], x[np.searchsorted(rise, 0.95)]

    assert float(sigmoid(np.array([2.0]), 2.0, 3.0, "weibull")[0]) == pytest.approx(0.5)
    assert high - low == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize(("guess", "lapse"), [(0.5, 0.0), (0.5, 0.04), (0.0, 0.02)])
def test_exact_shares_give_back_the_function_they_came_from(guess, lapse):
    trials = np.full(LEVELS.size, 1e6)
    share = guess + (1 - guess - lapse) * sigmoid(LEVELS, 0.3, 2.5, "gauss")

    fit = fit_psychometric(LEVELS, trials * share, trials, CurveForm(guess))

    assert fit.threshold == pytest.approx(0.3, abs=2e-3)
    assert fit.width == pytest.approx(2.5, abs=5e-3)
    assert fit.lapse == pytest.approx(lapse, abs=1e-3)
    np.testing.assert_allclose(fit(LEVELS), share, atol=1e-4)


def test_without_guess_and_lapse_it_is_a_logistic_regression():
    successes, trials = np.array([2.0, 5, 9, 14, 18]), np.full(5, 20.0)
    x = np.arange(5.0)
    fit = fit_psychometric(x, successes, trials, CurveForm(0.0, lapse=0.0, shape="logistic"))

    rows = pd.DataFrame(
        [{"x": a, "y": int(i < k)} for a, k in zip(x, successes, strict=True) for i in range(20)]
    )
    glm = glm_logit("y ~ 1 + x", rows)
    slope = glm["x"].estimate
    assert fit.threshold == pytest.approx(-glm["Intercept"].estimate / slope, abs=1e-5)
    assert fit.width == pytest.approx(2 * np.log(19) / slope, abs=1e-4)


def test_performance_that_falls_with_eccentricity_has_a_negative_width():
    x, trials = np.array([5.0, 10, 15, 20, 25]), np.full(5, 1000.0)
    share = 0.5 + 0.5 / (1 + np.exp((x - 18) / 2))

    curve = CurveForm(shape="logistic", falling=True)
    fit = fit_psychometric(x, (trials * share).round(), trials, curve)

    assert fit.width < 0
    assert fit.threshold == pytest.approx(18, abs=0.3)
    assert fit.threshold_limits is not None
    assert fit.threshold_limits[0] < fit.threshold < fit.threshold_limits[1]
    assert fit.width_limits is not None
    assert fit.width_limits[0] < fit.width < fit.width_limits[1]


def test_profile_limits_cover_the_threshold(rng, proof_count):
    hits = []
    for _ in range(proof_count(160)):
        share = 0.5 + 0.48 * sigmoid(LEVELS, 0.0, 3.0, "gauss")
        right = rng.binomial(40, share)
        fit = fit_psychometric(LEVELS, right, np.full(9, 40), CurveForm(lapse=0.02))
        if fit.threshold_limits is not None:
            hits.append(fit.threshold_limits[0] <= 0.0 <= fit.threshold_limits[1])

    assert len(hits) >= 0.8 * proof_count(160)
    assert np.mean(hits) >= 0.93 - 3.5 * np.sqrt(0.05 * 0.95 / len(hits))


def test_answers_that_vary_too_much_widen_the_limits(rng):
    """Shares that wander by .15 from level to level, and limits as much wider as they wander."""
    trials = np.full(9, 200)
    share = np.clip(sigmoid(LEVELS, 0.0, 4.0, "gauss") + rng.normal(0, 0.15, 9), 0, 1)
    right = rng.binomial(trials, share)
    form = CurveForm(0.0, lapse=0.0)
    wide = fit_psychometric(LEVELS, right, trials, form)
    plain = fit_psychometric(LEVELS, np.round(trials * wide(LEVELS)), trials, form)

    assert wide.overdispersion == pytest.approx(wide.deviance / wide.df)
    assert plain.overdispersion == 1.0
    ratio = np.ptp(wide.threshold_limits) / np.ptp(plain.threshold_limits)
    assert ratio == pytest.approx(np.sqrt(wide.overdispersion), rel=0.15)


@pytest.mark.parametrize(
    ("successes", "wanted"),
    [
        ([20, 20, 20, 20, 20], "same at every level"),
        ([0, 0, 0, 20, 20], "jump between two levels"),
        ([0, 0, 0, 0, 2], "outside the levels"),
    ],
)
def test_data_that_place_no_curve_are_flagged_and_get_no_limits(successes, wanted):
    fit = fit_psychometric(
        np.arange(5.0), np.array(successes, float), np.full(5, 20.0), CurveForm(0.0, lapse=0.0)
    )

    assert any(wanted in note for note in fit.warnings)
    assert fit.threshold_limits is None


@pytest.mark.parametrize(
    ("x", "successes", "trials"),
    [
        ([1.0], [1], [2]),
        ([1.0, 2.0], [3, 1], [2, 2]),
        ([1.0, 2.0], [0, 0], [0, 2]),
        ([1.0, 2.0, 3.0], [0, 0], [1, 2]),
    ],
)
def test_impossible_counts_are_refused(x, successes, trials):
    with pytest.raises(ValueError, match="must"):
        fit_psychometric(np.array(x), np.array(successes), np.array(trials))


def test_a_curve_on_logarithms_is_refused_and_the_cure_that_is_named_works():
    x, trials = np.array([1.0, 2, 4, 8]), np.full(4, 20.0)
    right = np.array([10.0, 12, 17, 20])
    with pytest.raises(ValueError, match="give the logarithms of x"):
        fit_psychometric(x, right, trials, CurveForm(logarithmic=True))

    assert 1.0 < np.exp(fit_psychometric(np.log(x), right, trials).threshold) < 8.0
