"""Likelihood ratios, marginal means, named contrasts and bootstrap p, against lme4 and ordinal."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.models.mixed.inference import Draws, Inference, p_of_draws
from analysis.models.mixed.marginal_means import margins
from analysis.models.mixed.reaction_model import time_model
from analysis.models.ordinal import rating_model
from analysis.parts.right_models import ModelsPart
from analysis.plans.rate_plan import prepared, rate_plan_of_table
from analysis.plans.table_sections import TimeTableSection
from analysis.tasks import analysis_of
from analysis.tasks.note import options_from
from protocols.errors import StudyError

ORACLES = Path(__file__).parents[1] / "oracles"
R = json.loads((ORACLES / "oracle_margins.json").read_text())
WEIGHTS = {"a to others": {"a": 1.0, "b": -0.5, "c": -0.5}}


@pytest.fixture(scope="module")
def trials():
    return pd.read_csv(ORACLES / "times.csv")


def ratios(compared):
    return [stats.t.isf(0.5 * one.p, one.df) ** 2 for one in compared]


def test_likelihood_ratios_and_contrasts_of_times_are_lme4s(trials):
    model = time_model(trials, ("cond",), asked=WEIGHTS)

    np.testing.assert_allclose(ratios(model.ratios), R["times_ratio"], rtol=2e-3)
    (own,) = model.margins.contrasts
    np.testing.assert_allclose([own.value, own.standard_error], R["times_contrast"], rtol=1e-3)
    assert np.exp([one.value for one in model.margins.means]) == pytest.approx(
        [one.median_s for one in model.times]
    )
    assert own.p == own.p_adjusted < 0.01


def test_likelihood_ratios_means_and_contrasts_of_ratings_are_ordinals(trials):
    model = rating_model(trials, ("cond",), asked=WEIGHTS)

    np.testing.assert_allclose(ratios(model.contrasts), R["rated_ratio"], rtol=1e-2)
    means, (own,) = model.margins.means, model.margins.contrasts
    np.testing.assert_allclose([one.value for one in means], R["rated_means"], atol=2e-3)
    errors = [one.standard_error for one in means]
    np.testing.assert_allclose(errors, R["rated_means_se"], rtol=1e-2)
    np.testing.assert_allclose([own.value, own.standard_error], R["rated_contrast"], rtol=1e-2)


def test_marginal_means_of_right_answers_are_glmmtmbs_at_the_mean_level():
    rows = pd.read_csv(ORACLES / "by_scene.csv").assign(method=lambda d: d["cond"])
    told = analysis_of("identification").options(
        by="method", level="level", alternatives=2, contrasts={"gap": {"b": 1, "a": -1}}
    )
    plan = rate_plan_of_table(rows, "table", told, ("yes", "no"))
    found = ModelsPart().of(prepared(rows, plan), plan)

    means, (gap,) = found.margins.means, found.margins.contrasts
    np.testing.assert_allclose([one.value for one in means], R["right_means"], rtol=5e-3)
    errors = [one.standard_error for one in means]
    np.testing.assert_allclose(errors, R["right_means_se"], rtol=1e-2)
    row = found.mixed["method[T.b]"]
    own = row.estimate, row.standard_error
    assert (gap.value, gap.standard_error) == pytest.approx(own)
    (said,) = (s for s in ModelsPart().show(found, plan).sentences if "Contrast gap" in s)
    assert re.search(r"\(1 b - 1 a\): .* logits, 95% CI", said)


@pytest.mark.slow
def test_p_by_parametric_bootstrap_is_lme4s_where_people_are_few(trials):
    few = trials[
        trials["participant"].le("P06") & trials["scene"].le("c") & (trials["cond"] != "a")
    ]
    draws = Draws(39, np.random.default_rng(1))
    (own,) = time_model(few, ("cond",), inference=Inference(draws=draws)).ratios

    assert ratios(time_model(few, ("cond",)).ratios) == pytest.approx(R["few_ratio"], rel=5e-3)
    (p,) = R["few_bootstrap_p"]
    assert abs(own.p - p) < 3.5 * np.sqrt(p * (1 - p) * (1 / 39 + 1 / 400))


def test_a_drawn_ratio_that_cannot_be_had_counts_against_the_effect():
    drawn = iter([0.5, 3.0, np.nan, 1.0])

    assert (
        p_of_draws(2.0, Draws(4, np.random.default_rng(0)).ratios(lambda _rng: next(drawn))) == 0.6
    )


def test_thirds_in_three_digits_are_a_contrast_and_what_is_not_identified_has_no_number():
    wild = np.diag([0.01, 0.01, 0.01, 1e6])
    asked = {"thirds": {"a": 1, "b": -0.333, "c": -0.333, "d": -0.333}, "plain": {"a": 1, "b": -1}}
    found = margins(
        list("abcd"), np.eye(4), np.array([5.0, 4.0, 4.0, 4.0]), wild, lambda *_: 9.0,
        level=0.95, asked=asked,
    )  # fmt: skip
    thirds, plain = found.contrasts

    assert np.isnan([thirds.value, thirds.p, thirds.p_adjusted, found.means[3].lower]).all()
    assert plain.value == pytest.approx(1.0)
    assert plain.p_adjusted == plain.p


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        ("a=1,d=-1", "must name conditions (a; b; c) (got 'd')"),
        ("a=1,b=-1/2", "that sum to 0, such as 1 and -1 (got a = 1, b = -0.5)"),
        ("a to b", "that sum to 0"),
        ("", "that sum to 0"),
    ],
)
def test_contrasts_that_are_none_are_refused(weights, said, trials):
    analysis = analysis_of("reaction")
    told = options_from("reaction", {"by": "cond", "contrasts.x": weights})

    with pytest.raises(StudyError, match=r"--set contrasts\.x: must") as refused:
        analysis.plan_of_table(trials, "table", told)
    assert said in str(refused.value)


def test_weights_are_fractions_or_numbers_of_conditions_with_commas():
    told = options_from("reaction", {"contrasts.x": "one, two=1, three=-1/2,four=-.5"})

    assert isinstance(told, TimeTableSection)
    assert told.contrasts == {"x": {"one, two": 1.0, "three": -0.5, "four": -0.5}}
