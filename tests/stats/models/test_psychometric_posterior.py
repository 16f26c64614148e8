"""Posteriors of psychometric functions: psignifit's numbers, coverage, comparisons."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import binom

from analysis.models.curves import psychometric_posterior as module
from analysis.models.curves.psychometric_posterior import (
    WIDTH_OF_LEVELS,
    compare_thresholds,
    psychometric_posterior,
)
from analysis.models.curves.response import CurveForm
from protocols.adaptive.psychometric_function import sigmoid

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_psignifit.json").read_text())
LEVELS = np.array(ORACLE["levels"])
SHOWN = np.full(LEVELS.size, float(ORACLE["shown"]))
OURS = {"threshold": "threshold", "width": "width", "lapse": "lambda", "spread": "eta"}


@pytest.mark.parametrize("case", list(ORACLE["cases"]))
def test_the_posterior_is_psignifits(case):
    said = ORACLE["cases"][case]
    shape = {"norm": "gauss", "logistic": "logistic"}[said["sigmoid"]]
    right = np.array(said["right"], float)
    fit = psychometric_posterior(LEVELS, right, SHOWN, CurveForm(shape=shape))

    reach = {name: np.diff(said["limits"][theirs])[0] for name, theirs in OURS.items()}
    for name, theirs in OURS.items():
        # Both are grids; a hundredth and a half of the limits' distance is what they differ by.
        mean = fit.marginals[name].mean
        assert mean == pytest.approx(said["mean"][theirs], abs=0.015 * reach[name]), name
    for end, value in zip(said["limits"]["threshold"], (fit.threshold.lower, fit.threshold.upper),
                          strict=True):  # fmt: skip
        assert value == pytest.approx(end, abs=0.05 * reach["threshold"])


def test_answers_that_stray_widen_the_limits_and_say_so():
    steady, strayed = (
        psychometric_posterior(LEVELS, np.array(ORACLE["cases"][name]["right"], float), SHOWN)
        for name in ("two_alternatives", "strayed")
    )

    assert strayed.spread.lower > steady.spread.value
    wide = strayed.threshold.upper - strayed.threshold.lower
    assert wide > 1.3 * (steady.threshold.upper - steady.threshold.lower)


def test_falling_levels_mirror_rising_ones():
    right = np.array([5.0, 9, 14, 17, 19, 20])
    x, shown = np.arange(6.0), np.full(6, 20.0)
    rising = psychometric_posterior(x, right, shown, CurveForm(0.0))
    falling = psychometric_posterior(-x, right, shown, CurveForm(0.0, falling=True))

    assert falling.threshold.value == pytest.approx(-rising.threshold.value, abs=1e-6)
    assert falling.threshold.lower == pytest.approx(-rising.threshold.upper, abs=1e-6)
    assert falling.width.value == pytest.approx(-rising.width.value, abs=1e-6)
    np.testing.assert_allclose(falling(-x), rising(x), atol=1e-6)


@pytest.mark.parametrize("shape", ["gauss", "gumbel"])
def test_logarithmic_levels_give_thresholds_in_units_of_the_level(shape):
    x = np.array([1.0, 2, 4, 8, 16])
    share = 0.5 + 0.5 * sigmoid(np.log(x), np.log(5.0), np.log(4.0), shape)
    curve = CurveForm(shape=shape, logarithmic=True)
    fit = psychometric_posterior(x, np.round(2000 * share), np.full(5, 2000.0), curve)

    assert fit.threshold.value == pytest.approx(5.0, rel=0.03)
    assert fit.width.value == pytest.approx(4.0, rel=0.1)
    np.testing.assert_allclose(fit(x), share, atol=0.02)


def test_a_guess_rate_that_is_fitted_is_found():
    x = np.linspace(-3, 3, 7)
    share = 0.2 + 0.78 * sigmoid(x, 0.4, 2.0, "gauss")
    fit = psychometric_posterior(x, np.round(400 * share), np.full(7, 400.0), CurveForm(None))

    assert fit.guess.lower < 0.2 < fit.guess.upper
    assert fit.guess.value == pytest.approx(0.2, abs=0.03)
    assert fit.threshold.lower < 0.4 < fit.threshold.upper


def test_a_lapse_rate_that_is_known_has_no_prior_and_no_doubt():
    x = np.linspace(-3, 3, 7)
    share = 0.5 + 0.3 * sigmoid(x, 0.4, 2.0, "gauss")
    right, shown = np.round(400 * share), np.full(7, 400.0)
    known = psychometric_posterior(x, right, shown, CurveForm(lapse=0.2))

    assert (known.lapse.lower, known.lapse.value, known.lapse.upper) == (0.2, 0.2, 0.2)
    assert known.threshold.value == pytest.approx(0.4, abs=0.1)
    assert not any("lapses" in note for note in known.warnings)


def _answers(rng, threshold, *, levels=7, shown=20, spread=0.0, lapse=0.02):
    x = np.linspace(-3, 3, levels)
    share = 0.5 + (0.5 - lapse) * sigmoid(x, threshold, 3.0, "gauss")
    if spread:
        size = 1.0 / spread**2 - 1.0
        share = rng.beta(share * size, (1.0 - share) * size)
    return x, rng.binomial(shown, share).astype(float), np.full(levels, float(shown))


@pytest.mark.slow
@pytest.mark.parametrize(("levels", "shown", "spread"), [(5, 10, 0.0), (7, 20, 0.0), (7, 40, 0.2)])
def test_limits_hold_the_threshold_as_often_as_they_say(levels, shown, spread, proof_count):
    """Of 300 runs .93 to .98 did: no fewer, but for what chance makes of so few runs."""
    runs = proof_count(300)
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(runs):
        truth = rng.uniform(-1, 1)
        fit = psychometric_posterior(
            *_answers(rng, truth, levels=levels, shown=shown, spread=spread)
        )
        held += fit.threshold.lower <= truth <= fit.threshold.upper

    assert binom.ppf(5e-4, runs, 0.93) <= held
    assert held < runs or runs < 100


def test_a_difference_of_thresholds_is_found_and_none_is_not():
    rng = np.random.default_rng(5)
    fits = {
        "near": psychometric_posterior(*_answers(rng, -1.0, shown=60)),
        "again": psychometric_posterior(*_answers(rng, -1.0, shown=60)),
        "far": psychometric_posterior(*_answers(rng, 1.0, shown=60)),
    }
    _, far, again = compare_thresholds({name: fits[name] for name in ("far", "again", "near")})

    assert (far.first, far.second) == ("far", "near")
    assert far.lower > 0.8
    assert far.upper < 3.2
    assert far.p_adjusted < 0.001
    assert far.larger > 0.999
    assert again.lower < 0 < again.upper
    assert again.p > 0.1
    assert again.p_adjusted >= again.p


def test_a_difference_of_normal_posteriors_is_their_convolution():
    """The rule itself: quantiles of both stand for their laws."""
    values = np.linspace(-6, 6, 401)
    fit = psychometric_posterior(*_answers(np.random.default_rng(1), 0.0))

    def with_threshold(mean: float, sd: float) -> module.PsychometricPosterior:
        density = np.exp(-0.5 * ((values - mean) / sd) ** 2)
        density /= np.trapezoid(density, values)
        return replace(
            fit, marginals={**fit.marginals, "threshold": module.Marginal(values, density)}
        )

    (gap,) = compare_thresholds({"a": with_threshold(1.0, 0.6), "b": with_threshold(0.0, 0.8)})

    assert gap.difference == pytest.approx(1.0, abs=0.01)
    assert gap.upper - gap.lower == pytest.approx(2 * 1.96 * 1.0, rel=0.01)
    assert gap.p == pytest.approx(0.3173, abs=0.005)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x": np.ones(3)}, "two levels"),
        ({"x": np.arange(4.0)}, "equally long"),
        ({"successes": np.array([1.0, 2, 30])}, "between 0 and trials"),
        ({"curve": CurveForm(logarithmic=True)}, "logarithm"),
        ({"curve": CurveForm(shape="weibull")}, "logarithmic=True"),
    ],
)
def test_what_cannot_be_is_refused(change, said):
    given = {"x": np.arange(3.0), "successes": np.arange(3.0), "trials": np.full(3, 9.0)} | change
    with pytest.raises(ValueError, match=said):
        psychometric_posterior(**given)


def test_fits_on_two_axes_are_not_compared():
    x, right, shown = np.array([1.0, 2, 4]), np.array([5.0, 7, 10]), np.full(3, 10.0)
    plain = psychometric_posterior(x, right, shown)
    logarithmic = psychometric_posterior(x, right, shown, CurveForm(logarithmic=True))

    with pytest.raises(ValueError, match="same axis"):
        compare_thresholds({"a": plain, "b": logarithmic})


def test_a_width_near_the_gap_between_levels_has_no_lower_limit_of_the_prior():
    """The prior holds no width below the gap: limits of steep curves held the truth in .63."""
    x = np.arange(-3.0, 4.0)
    steep = psychometric_posterior(
        x, np.array([20, 20, 20, 20, 40, 40, 40]) * 1.0, np.full(7, 40.0)
    )
    flat = psychometric_posterior(x, np.array([20, 22, 25, 30, 35, 38, 40]) * 1.0, np.full(7, 40.0))

    assert WIDTH_OF_LEVELS in steep.warnings
    assert WIDTH_OF_LEVELS not in flat.warnings
    assert steep.width.lower == 0.0
    assert 1.0 < steep.width.upper < 4.0
    assert flat.width.lower > 2.0


def test_the_note_on_steep_curves_comes_with_these_and_seldom_with_others(rng):
    """By the lower limit alone it came with nearly every curve of ten answers a level."""
    x = np.arange(5.0)

    def noted(width: float) -> int:
        share = 0.5 + 0.5 * ndtr((x - 1.8) / width * 2.0 * ndtri(0.95))
        drawn = (rng.binomial(10, share).astype(float) for _ in range(10))
        fits = (psychometric_posterior(x, one, np.full(5, 10.0)) for one in drawn)
        return sum(WIDTH_OF_LEVELS in one.warnings for one in fits)

    assert noted(0.6) > 7
    assert noted(4.0) < 6
