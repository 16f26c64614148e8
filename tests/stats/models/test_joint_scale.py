"""All methods at once: equal, on one axis; as Hotelling's test and by simulation."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from analysis.models.paired.joint_tests import _hotelling, joint_tests


def votes(rng, effects, *, people=11, scenes=6, repeats=2, circle=0.0):
    """Return votes whose logits are differences of effects; `circle`: each beats the next."""
    count = len(effects)
    found = np.zeros((people, scenes, count, count))
    taste, liked = rng.normal(0, 0.4, (people, count)), rng.normal(0, 0.3, (scenes, count))
    for i in range(count):
        for j in range(i + 1, count):
            turn = circle if j - i == 1 else -circle
            logit = effects[i] - effects[j] + turn
            logit = logit + (taste[:, None, i] - taste[:, None, j])
            logit = logit + (liked[None, :, i] - liked[None, :, j])
            won = rng.binomial(repeats, expit(logit))
            found[..., i, j], found[..., j, i] = won, repeats - won
    return found


def test_with_the_covariance_of_a_mean_it_is_hotellings_test(rng):
    rows = rng.standard_normal((15, 3)) @ rng.standard_normal((3, 3)) + 0.4
    mean, covariance = rows.mean(axis=0), np.cov(rows, rowvar=False) / 15
    draws = rng.multivariate_normal(np.zeros(3), covariance, 4000)
    whitened = draws @ np.linalg.inv(np.linalg.cholesky(np.cov(draws, rowvar=False))).T
    exact = whitened @ np.linalg.cholesky(covariance).T  # their covariance is that very one
    found = _hotelling(mean, exact, 3, 15)
    squared = float(mean @ np.linalg.solve(covariance, mean))

    assert found.f == pytest.approx(squared * 12 / (3 * 14))
    assert found.p == pytest.approx(stats.f.sf(found.f, 3, 12))


def test_unequal_methods_on_one_axis_and_circles_are_told_apart(rng):
    line = joint_tests(votes(rng, [1.5, 0.5, -0.5, -1.5], people=20), rng=rng, samples=500)
    ring = joint_tests(votes(rng, [0.0, 0.0, 0.0], people=20, circle=1.2), rng=rng, samples=500)

    assert line.equal.p < 0.01
    assert line.axis.p > 0.05
    assert ring.axis.p < 0.01
    assert ring.equal.p > 0.05


def test_equal_methods_are_seldom_called_unequal(rng):
    found = [joint_tests(votes(rng, [0.0] * 3), rng=rng, samples=200) for _ in range(60)]

    assert np.mean([one.equal.p < 0.05 for one in found]) <= 0.08
    assert np.mean([one.axis.p < 0.05 for one in found]) <= 0.08


def test_too_few_people_have_no_joint_test(rng):
    found = joint_tests(votes(rng, [0.0] * 4, people=3), rng=rng, samples=200)

    assert found.equal is None
    assert found.axis is None
