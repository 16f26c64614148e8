"""The place in a pair beside the scores: against a probit regression, and what has no maximum."""

import numpy as np
import pytest
import statsmodels.api as sm
from scipy.special import ndtr

from analysis.models.paired.order_effect import order_effect
from analysis.models.paired.paired_counts import JOD_SIGMA


def votes(rng, order, people=12, scenes=4, both=True):
    scores, wins = np.array([0.0, 0.5, 1.0]), np.zeros((people, scenes, 2, 3, 3))
    for i, j in ((i, j) for i in range(3) for j in range(3) if i != j and (both or i < j)):
        chance = ndtr((scores[i] - scores[j] + order) / JOD_SIGMA)
        won = rng.binomial(2, chance, (people, scenes))
        wins[:, :, 0, i, j] += won
        wins[:, :, 1, j, i] += 2 - won
    return wins


def test_order_and_scores_are_those_of_a_probit_regression(rng):
    wins = votes(rng, 0.4)
    found = order_effect(wins, rng=rng, samples=500, level=0.95)

    rows, counts = [], []
    for i, j in ((i, j) for i in range(3) for j in range(3) if i != j):  # i came first
        rows.append([float(k == i) - float(k == j) for k in (1, 2)] + [1.0])
        counts.append([wins[:, :, 0, i, j].sum(), wins[:, :, 1, j, i].sum()])
    family = sm.families.Binomial(sm.families.links.Probit())
    fit = sm.GLM(np.array(counts), np.array(rows), family=family).fit()
    gaps = np.array(found.scores[1:]) - found.scores[0]
    assert [*gaps, found.value] == pytest.approx(list(JOD_SIGMA * fit.params), abs=1e-4)
    assert found.standard_error == pytest.approx(JOD_SIGMA * fit.bse[-1], rel=0.35)
    assert found.lower < 0.4 < found.upper
    assert found.p < 0.05


def test_an_order_that_everything_was_shown_in_is_no_effect(rng):
    with pytest.raises(ValueError, match="shown in both orders"):
        order_effect(votes(rng, 0.0, both=False), rng=rng, samples=200, level=0.95)
    always = np.zeros((4, 2, 2, 2, 2))
    always[:, :, 0, 0, 1] = always[:, :, 0, 1, 0] = 3.0  # who came first won every time
    with pytest.raises(ValueError, match="decided all answers"):
        order_effect(always, rng=rng, samples=200, level=0.95)
