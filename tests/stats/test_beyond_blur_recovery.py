"""Observers with the coefficients of Beyond Blur's Table 1, N = 14: its model finds them again."""

import numpy as np
from scipy import stats

from analysis.models.mixed.logit import fit_logit

PRINTED = np.array([0.105, -0.391, -0.611, -0.846, 0.258])
ERRORS = np.array([0.138, 0.131, 0.129, 0.127, 0.141])
BLURS_THAT_HARM = [2, 3]  # 1.05 and 1.40
ECCENTRICITY = np.repeat([5.0, 10.0, 15.0, 20.0, 25.0], 6)
METHOD = np.tile(np.arange(6), 5)
DESIGN = np.column_stack(
    [np.ones(30), ECCENTRICITY, *(level == METHOD for level in range(1, 6))]
).astype(float)


def fitted(rng: np.random.Generator, effects: np.ndarray, studies: int):
    """Estimates, standard errors and p of each study, shape (studies, 5)."""
    logit = DESIGN @ np.concatenate([[2.976, -0.101], effects])  # as Fig. 17 reads
    trials = np.full(30, 14 * 10.0)
    right = rng.binomial(140, 1 / (1 + np.exp(-logit)), (studies, 30)).astype(float)
    fits = [fit_logit(DESIGN, answers, trials) for answers in right]
    estimates = np.array([fit.beta[2:] for fit in fits])
    errors = np.array([np.sqrt(np.diag(fit.covariance))[2:] for fit in fits])
    return estimates, errors, 2 * stats.norm.sf(abs(estimates / errors))


def test_table_1_comes_back_from_simulated_studies(rng, proof_count):
    studies = proof_count(1000)
    estimates, errors, p = fitted(rng, PRINTED, studies)

    slack = max(0.02, 4 * 0.141 / np.sqrt(studies))
    np.testing.assert_allclose(estimates.mean(0), PRINTED, atol=slack)
    np.testing.assert_allclose(errors.mean(0), ERRORS, atol=0.003)
    spread = max(0.1, 3.5 / np.sqrt(2 * studies))
    np.testing.assert_allclose(estimates.std(0, ddof=1), ERRORS, rtol=spread)
    assert np.all((p[:, BLURS_THAT_HARM] < 0.05).mean(0) >= 0.95)


def test_without_effects_the_papers_test_keeps_its_level(rng, proof_count):
    studies = proof_count(2000)
    p = fitted(rng, np.zeros(5), studies)[2]

    slack = 3.5 * np.sqrt(0.05 * 0.95 / studies)
    assert np.all(abs((p < 0.05).mean(0) - 0.05) < slack)
