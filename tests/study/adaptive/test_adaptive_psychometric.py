"""The psychometric function of adaptive trials and of fits, by hand."""

import numpy as np
import pytest
from scipy.special import ndtri

from protocols.adaptive.answer_history import check_history, check_rising
from protocols.adaptive.psychometric_function import SHAPES, probability, sigmoid, slope_of
from protocols.errors import StudyError


@pytest.mark.parametrize("shape", SHAPES)
def test_threshold_is_at_one_half_and_width_spans_the_rise(shape):
    levels = np.linspace(0.01, 40.0, 400_001)

    rise = sigmoid(levels, 8.0, 3.0, shape)

    assert sigmoid(8.0, 8.0, 3.0, shape) == pytest.approx(0.5, abs=1e-12)
    low, high = np.interp((0.05, 0.95), rise, levels)
    assert high - low == pytest.approx(3.0, abs=1e-4)


def test_gumbel_on_logarithms_is_weibull():
    levels = np.linspace(0.5, 20.0, 40)
    slope = float(slope_of(6.0, "weibull", 8.0))

    width = float(slope_of(1.0, "gumbel")) / slope  # slope times width is a constant
    on_logs = sigmoid(np.log(levels), np.log(8.0), width, "gumbel")

    np.testing.assert_allclose(on_logs, sigmoid(levels, 8.0, 6.0, "weibull"), rtol=1e-12)


def test_slopes_are_those_of_the_table():
    assert float(slope_of(1.0, "gauss")) == pytest.approx(2 * ndtri(0.95))
    assert float(slope_of(1.0, "logistic")) == pytest.approx(2 * np.log(19.0))
    assert float(slope_of(1.0, "gumbel")) == pytest.approx(
        np.log(-np.log(0.05)) - np.log(-np.log(0.95))
    )


def test_guess_and_lapse_bound_the_probability():
    """By hand: .5 + (1 - .5 - .02) / 2 = .74 at the threshold."""
    told = {"threshold": 8.0, "width": 3.0, "guess": 0.5, "lapse": 0.02}

    np.testing.assert_allclose(probability([-90.0, 8.0, 90.0], **told), [0.5, 0.74, 0.98])


@pytest.mark.parametrize("shape", SHAPES)
def test_probability_rises_with_the_level_and_falls_where_asked(shape):
    levels = np.linspace(0.0, 20.0, 101)
    told = {"threshold": 8.0, "width": 5.0, "guess": 0.25, "lapse": 0.04, "shape": shape}

    up, down = probability(levels, **told), probability(levels, **told, falling=True)

    assert np.all(np.diff(up) >= 0)
    assert up[-1] - up[0] > 0.6
    np.testing.assert_allclose(up + down, 0.25 + 0.96)


@pytest.mark.parametrize("shape", SHAPES)
def test_far_from_a_steep_rise_it_is_flat(shape):
    """Nothing overflows: warnings are errors here."""
    np.testing.assert_allclose(sigmoid([0.0, 1e6], 8.0, 1e-3, shape), [0.0, 1.0], atol=1e-300)


def test_all_arguments_broadcast():
    found = probability(
        np.zeros((4, 1, 1)), threshold=np.ones((3, 1)), width=np.ones(2), guess=0.5, lapse=0.0
    )

    assert found.shape == (4, 3, 2)


@pytest.mark.parametrize(
    ("job", "told"),
    [
        (lambda: sigmoid(0.0, 1.0, 1.0, "cauchy"), "shape: must be one of gauss, logistic"),
        (lambda: check_rising((1.0,)), "levels: must hold two levels or more (got 1)"),
        (
            lambda: check_rising((1.0, 3.0, 2.0)),
            "levels[2]: must be above the one before it, 3 (got 2)",
        ),
        (lambda: check_rising((1.0, 1.0)), "levels[1]: must be above the one before it, 1 (got 1)"),
        (lambda: check_rising((1.0, float("nan"))), "levels[1]: must be a finite number (got nan)"),
        (
            lambda: check_history([(1.0, True), (2.5, True)], (1.0, 2.0)),
            "history[1]: must be one of the 2 allowed levels from 1 to 2 (got 2.5)",
        ),
        (
            lambda: check_history([(1.0, 0.4)], (1.0, 2.0)),
            "history[0]: the answer must be true or false (got 0.4)",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place(job, told):
    with pytest.raises(StudyError) as raised:
        job()

    assert told in str(raised.value)


def test_levels_that_are_right_pass():
    check_rising((-1.0, 0.0, 2.5))
    check_history([(0.0, True), (2.5, np.False_)], (0.0, 2.5))
