"""Models whose conditions differ by participant and by scene, against lme4, glmmTMB and ordinal."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.models.contrasts import IN_CONDITION
from analysis.models.logistic import models_beside
from analysis.models.mixed.inference import Inference
from analysis.models.mixed.reaction_model import time_model
from analysis.models.ordinal import paired_ratings, rating_model

ORACLES = Path(__file__).parents[1] / "oracles"
R = {
    name: np.array(value)
    for name, value in json.loads((ORACLES / "oracle_by_scene.json").read_text()).items()
}
GROUPS = ("participant", "scene")
GAP = {"gap": {"a": 1.0, "b": -1.0}}
PROFILE = json.loads((ORACLES / "oracle_profile.json").read_text())


@pytest.fixture(scope="module")
def trials():
    return pd.read_csv(ORACLES / "by_scene.csv")


def test_right_answers_with_slopes_of_people_and_scenes_are_glmmtmbs(trials):
    fit = models_beside("correct ~ 1 + level + cond", trials).mixed
    terms = [fit[name] for name in ("Intercept", "level", "cond[T.b]")]

    np.testing.assert_allclose([one.estimate for one in terms], R["right_beta"], rtol=5e-3)
    np.testing.assert_allclose([one.standard_error for one in terms], R["right_se"], rtol=1e-2)
    order = ("participant", "scene", "level from its mean | participant",
             "level from its mean | scene", "participant x cond", "scene x cond")  # fmt: skip
    np.testing.assert_allclose([fit.random_sd[name] for name in order], R["right_sd"], rtol=1e-2,
                               atol=1e-3)  # fmt: skip
    assert fit.log_likelihood == pytest.approx(R["right_loglik"][0], abs=1e-3)
    # The oracle's p are of t with 10 degrees of freedom; ours lie between people's and scenes'.
    roots = [stats.t.isf(0.5 * one.p, one.df) for one in terms[1:]]
    np.testing.assert_allclose(2.0 * stats.t.sf(roots, 10), R["right_ratio_p"], rtol=2e-2)
    assert all(5 < one.df <= 10 for one in terms)


def test_times_with_scene_by_condition_are_lme4s(trials):
    fit = time_model(trials, ("cond",), asked=GAP)
    found = (fit.participant_sd, fit.scene_sd, fit.interaction_sd, fit.scene_interaction_sd,
             fit.residual_sd)  # fmt: skip

    np.testing.assert_allclose(fit.beta, R["times_beta"], rtol=1e-4)
    np.testing.assert_allclose(fit.beta_se, R["times_se"], rtol=1e-3)
    np.testing.assert_allclose(found, R["times_sd"], rtol=1e-3)
    assert fit.log_likelihood == pytest.approx(R["times_loglik"][0], abs=1e-4)
    (gap,) = fit.margins.contrasts
    assert gap.standard_error == pytest.approx(R["times_gap_se"][0], rel=1e-3)
    assert 5 <= fit.ratios[0].df <= 10


@pytest.mark.parametrize("link", ["probit", "logit"])
def test_ratings_with_scene_by_condition_are_ordinals(trials, link):
    fit = rating_model(trials, ("cond",), link=link, asked=GAP)
    (gap,) = fit.contrasts
    sd = [fit.sd[name + more] for more in ("", IN_CONDITION) for name in GROUPS]

    found = [*fit.thresholds, -gap.difference]
    np.testing.assert_allclose(found, R[f"rated_{link}"], rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(sd, R[f"rated_{link}_sd"], rtol=5e-3)
    assert fit.log_likelihood == pytest.approx(R[f"rated_{link}_loglik"][0], abs=1e-3)
    error = fit.margins.contrasts[0].standard_error
    assert error == pytest.approx(R[f"rated_{link}_se"][-1], rel=1e-2)


def test_limits_and_ratios_are_those_of_profiles_of_lme4_glmmtmb_and_ordinal(trials):
    """At the limits the root of the likelihood ratio is 2."""
    found = {
        "times": lambda how: time_model(trials, ("cond",), inference=how).ratios[0],
        "rated": lambda how: rating_model(trials, ("cond",), inference=how).contrasts[0],
        "right": lambda how: models_beside(
            "correct ~ 1 + level + cond", trials, inference=how
        ).mixed["cond[T.b]"],
    }
    for name, fitted in found.items():
        df = fitted(Inference()).df
        one = fitted(Inference(1.0 - 2.0 * stats.t.sf(2.0, df)))
        limits = np.array([one.lower, one.upper])
        if name != "right":  # a minus b, and not b minus a
            limits = -(np.log(limits) if name == "times" else limits)[::-1]
        root = stats.t.isf(0.5 * one.p, df)
        np.testing.assert_allclose(limits, PROFILE[name][:2], atol=2e-3)
        assert root**2 == pytest.approx(PROFILE[name][2], rel=5e-3)


def test_graded_pairs_that_scenes_judge_otherwise_are_ordinals():
    fit = paired_ratings(pd.read_csv(ORACLES / "graded.csv"))
    (gap,) = fit.contrasts

    found = [*fit.thresholds, -gap.difference]
    np.testing.assert_allclose(found, R["graded"], rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(
        [fit.sd[name + IN_CONDITION] for name in GROUPS], R["graded_sd"], rtol=5e-3
    )
    assert fit.log_likelihood == pytest.approx(R["graded_loglik"][0], abs=1e-3)
