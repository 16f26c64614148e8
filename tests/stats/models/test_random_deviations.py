"""Deviations of random effects: profile limits and levels of lme4, glmmTMB and ordinal."""

import json
import math
import re
from pathlib import Path

import pandas as pd
import pytest
from fixed_studies import PLAN

from analysis.models.logistic import ModelFit, glmm_logit
from analysis.models.mixed.deviations import profile_limits
from analysis.models.mixed.inference import Inference
from analysis.models.mixed.reaction_model import time_model
from analysis.models.ordinal import RandomFactor, fit_cumulative, rating_model
from analysis.parts.shared import apa_test

FOLDER = Path(__file__).parents[1] / "oracles"
ORACLE = json.loads((FOLDER / "oracle_deviations.json").read_text())
PROFILE = Inference(profile=True)
_LAW = "likelihood ratio"


@pytest.fixture(scope="module")
def times() -> pd.DataFrame:
    return pd.read_csv(FOLDER / "times.csv").assign(hit=lambda rows: (rows["rating"] > 2) * 1)


@pytest.fixture(scope="module")
def right(times) -> ModelFit:
    groups = ["participant", "scene"]
    return glmm_logit("hit ~ 1 + cond", times, groups=groups, inference=PROFILE)


def test_deviations_of_right_answers_have_glmmtmbs_profile(right):
    people, scenes = right.deviations
    assert (people.lower, people.upper) == pytest.approx(ORACLE["right_participant"], rel=1e-3)
    # Scenes do not differ: the lower limit is 0, and an upper one is there all the same.
    assert scenes.sd == pytest.approx(0.0, abs=1e-3)
    assert scenes.lower == 0.0
    assert scenes.upper == pytest.approx(ORACLE["right_scene"][1], rel=1e-3)
    own = ORACLE["right_sd"][0] ** 2
    assert people.icc == pytest.approx(own / (own + math.pi**2 / 3), abs=1e-3)


def test_the_deviation_of_ratings_has_the_profile_of_ordinals_clmm2(times):
    code = pd.factorize(times["participant"], sort=True)[0]
    design = pd.get_dummies(times["cond"]).to_numpy(float)[:, 1:]
    effects = {"participant": RandomFactor(code)}
    fit = fit_cumulative(design, times["rating"].to_numpy() - 1, effects, level=0.95)
    (one,) = fit.deviations
    # clmm2 interpolates between values of the deviation.
    assert (one.lower, one.upper) == pytest.approx(ORACLE["ratings_participant"], rel=3e-3)
    assert one.icc == pytest.approx(one.sd**2 / (one.sd**2 + 1))


def test_limits_of_a_parabola_are_walds():
    """Minus log likelihood (v - 2)^2 / (2 x .09): limits 2 +- 1.96 x .3."""
    ends = profile_limits(lambda v: -((v - 2) ** 2) / 0.18, 2.0, 0.0, 0.1, 0.95)
    assert ends == pytest.approx((2 - 1.95996 * 0.3, 2 + 1.95996 * 0.3), abs=1e-3)


def test_a_likelihood_that_never_falls_has_no_upper_limit():
    assert profile_limits(lambda v: -max(1 - v, 0), 1.0, 0.0, 0.3, 0.95) == (0.0, math.inf)


def test_models_of_reports_hold_deviations_of_every_effect(times):
    rated = rating_model(times, ("cond",), inference=PROFILE)
    assert {one.name: one.sd for one in rated.deviations} == rated.sd
    assert all(one.lower <= one.sd <= one.upper for one in rated.deviations)


def test_many_levels_have_no_profile(times, monkeypatch):
    monkeypatch.setattr("analysis.models.mixed.deviations.MOST_PROFILED", 5)
    fit = glmm_logit("hit ~ 1 + cond", times, groups=["participant"], inference=PROFILE)
    assert math.isnan(fit.deviations[0].lower)


def test_a_likelihood_ratio_that_judges_is_said(times):
    (ratio, *others) = time_model(times, ("cond",), reference="a").ratios
    said = apa_test(ratio, others, PLAN, "model")
    assert re.fullmatch(r"t\(.*\) = .*, p [=<].*\(likelihood ratio, model\)", said)
    drawn = apa_test(ratio, others, PLAN.but(bootstrap_draws=99), "model")
    assert re.match(r"likelihood ratio [\d.]+, p .*ratio, model; parametric bootstrap", drawn)
