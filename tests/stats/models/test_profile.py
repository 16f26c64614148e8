"""Likelihood ratios and the limits that follow from them: a p and its limits never disagree."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.models.logistic import models_beside
from analysis.models.mixed.inference import Inference, cut_of_draws, p_of_draws
from analysis.models.mixed.profile import HeldContrast, Maximum, ratio_test
from analysis.models.mixed.reaction_model import time_model
from analysis.models.ordinal import rating_model


def parabola(point):
    """Minus a log likelihood with covariance [[.04, .01], [.01, .09]] about (1, 2)."""
    gap = point - np.array([1.0, 2.0])
    slope = np.linalg.solve(np.array([[0.04, 0.01], [0.01, 0.09]]), gap)
    return 0.5 * float(gap @ slope), slope


def test_of_a_parabola_the_ratio_is_walds_square_and_limits_are_walds():
    """Difference -1, variance .04 - .02 + .09 = .11."""
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    held = HeldContrast(
        Maximum(parabola, np.array([1.0, 2.0]), covariance, range(0)), np.array([1.0, -1.0])
    )
    found = ratio_test(held, 0.0, -1.0, 0.11**0.5, 7.0, 0.95)
    reach = stats.t.ppf(0.975, 7) * 0.11**0.5

    assert found.root == pytest.approx(-1.0 / 0.11**0.5)
    assert found.p == pytest.approx(2.0 * stats.t.sf(1.0 / 0.11**0.5, 7))
    assert (found.lower, found.upper) == pytest.approx((-1.0 - reach, -1.0 + reach), rel=1e-3)


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9, 0.95])
@pytest.mark.parametrize("count", [3, 19, 20, 99])
def test_the_cut_of_drawn_ratios_is_where_their_p_begins_to_be_below(count, level):
    drawn = -np.sort(-np.random.default_rng(count).chisquare(1, count))
    cut = cut_of_draws(drawn, level)
    tried = np.concatenate([drawn, drawn + 1e-6, drawn - 1e-6, [0.0, 50.0]])
    below = np.array([p_of_draws(one, drawn) < 1.0 - level - 1e-12 for one in tried])

    np.testing.assert_array_equal(below, (tried > cut) if np.isfinite(cut) else False)


def made_up(rng):
    """Return trials of a few people and scenes with a difference of about two errors."""
    people, scenes = rng.integers(4, 9), rng.integers(1, 5)
    rows = pd.DataFrame(
        [(p, s, c) for p in range(people) for s in range(scenes) for c in "ab" for _ in range(4)],
        columns=["participant", "scene", "cond"],
    )
    b = (rows["cond"] == "b").to_numpy(int)
    own = rng.normal(0.4, 0.5, (people, 2))[rows["participant"], b] * (0.3 + b)
    latent = own + rng.normal(0.0, 0.4, scenes)[rows["scene"]]
    noise = rng.standard_normal(len(rows))
    return rows.assign(
        rt_s=np.exp(0.3 * latent + 0.3 * noise),
        rating=np.digitize(latent + noise, [-1.0, 0.0, 1.0]),
        correct=(latent + noise > 0).astype(int),
    )


@pytest.mark.slow
def test_no_p_contradicts_its_limits_at_any_level(full):
    """Near the level at which each p is just significant, where limits end at 0."""
    rng = np.random.default_rng(5)
    judged = {
        "times": lambda d, how: time_model(d, ("cond",), inference=how).ratios[0],
        "ratings": lambda d, how: rating_model(d, ("cond",), inference=how).contrasts[0],
        "right": lambda d, how: models_beside(
            "correct ~ 1 + cond", d, inference=how
        ).mixed.coefficients[1],
    }
    told = 0
    for number in range(2000 if full else 30):
        name = (*judged, "times", "times", "ratings")[number % 6]
        rows = made_up(rng)
        p = judged[name](rows, Inference()).p
        for nudge in (0.999, 1.001):
            if not 1e-6 < p * nudge < 0.999:
                continue
            one = judged[name](rows, Inference(1.0 - p * nudge))
            nothing = 1.0 if name == "times" else 0.0
            assert (not one.lower <= nothing <= one.upper) == (nudge > 1.0), (number, name, one)
            told += 1
    assert told > 20
