"""Logit models against values by hand, against R, and where no maximum exists."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit, log_expit
from scipy.stats import chi2

from analysis.models.curves.response import LOGIT, ResponseFunction
from analysis.models.logistic import glm_logit, glmm_logit, glmm_probit, models_beside
from analysis.models.mixed.arrow_matrix import RandomEffects
from analysis.models.mixed.formula import TILDE_OPERATOR
from analysis.models.mixed.glmm import CountedTrials, LaplaceLikelihood, fit_crossed
from analysis.models.mixed.inference import Draws, Inference
from analysis.models.mixed.logit import (
    cluster_covariance,
    firth_limits,
    fit_logit,
    information,
    likelihood_ratio_p,
    separated,
)
from analysis.models.mixed.profile import HeldContrast
from analysis.models.ordinal import OrderedLaw

ORACLES = Path(__file__).parents[1] / "oracles"
R = json.loads((ORACLES / "oracle.json").read_text())
R_PAIRED = json.loads((ORACLES / "oracle_paired.json").read_text())
R_TASKS = json.loads((ORACLES / "oracle_tasks.json").read_text())


@pytest.fixture(scope="module")
def crossed() -> pd.DataFrame:
    """Answers of 12 made-up participants to 8 items, as R saw them."""
    return pd.read_csv(ORACLES / "crossed.csv")


def column(fit, name):
    return [getattr(row, name) for row in fit.coefficients]


def test_intercept_of_one_group_is_the_log_odds():
    """By hand: 30 of 40, log 3, error sqrt(1/30 + 1/10)."""
    table = pd.DataFrame({"y": [1] * 30 + [0] * 10})

    row = glm_logit("y ~ 1", table)["Intercept"]

    assert row.estimate == pytest.approx(np.log(3), abs=1e-9)
    assert row.standard_error == pytest.approx(np.sqrt(1 / 30 + 1 / 10), abs=1e-9)
    assert row.odds_ratio == pytest.approx(3.0)


def test_glm_equals_r(crossed):
    fit = glm_logit("logit(y) ~ 1 + cond", crossed)

    np.testing.assert_allclose(column(fit, "estimate"), R["glm"], atol=1e-8)
    np.testing.assert_allclose(column(fit, "standard_error"), R["glm_se"], atol=1e-8)
    assert fit.log_likelihood == pytest.approx(R["glm_loglik"][0], abs=1e-7)
    assert any("independent" in note for note in fit.warnings)


def test_crossed_glmm_equals_glmmtmb(crossed):
    fit = glmm_logit("y ~ 1 + cond", crossed, groups=("participant", "item"))

    np.testing.assert_allclose(column(fit, "estimate"), R["glmm"], atol=1e-4)
    np.testing.assert_allclose(column(fit, "standard_error"), R["glmm_se"], atol=1e-4)
    np.testing.assert_allclose(list(fit.random_sd.values()), R["glmm_sd"], atol=1e-4)
    assert fit.log_likelihood == pytest.approx(R["glmm_loglik"][0], abs=1e-5)


def test_the_likelihood_ratio_of_a_mixed_model_equals_glmmtmbs(crossed):
    fit = glmm_logit("y ~ 1 + cond", crossed, groups=("participant", "item"))

    assert column(fit, "p") == pytest.approx(R_PAIRED["glmm_ratio_p"], rel=1e-3)
    assert fit["cond[T.b]"].df is None


def coded(crossed: pd.DataFrame) -> pd.DataFrame:
    return crossed.assign(x=np.where(crossed["cond"] == "b", 0.5, -0.5))


def test_crossed_probit_equals_glmmtmb(crossed):
    fit = glmm_probit("y ~ 1 + x", coded(crossed), groups=("participant", "item"))

    np.testing.assert_allclose(column(fit, "estimate"), R_TASKS["probit"], atol=1e-4)
    np.testing.assert_allclose(column(fit, "standard_error"), R_TASKS["probit_se"], atol=1e-4)
    np.testing.assert_allclose(list(fit.random_sd.values()), R_TASKS["probit_sd"], atol=1e-4)
    assert fit.log_likelihood == pytest.approx(R_TASKS["probit_loglik"][0], abs=1e-5)


def test_a_probit_model_has_profile_limits_and_p_by_bootstrap(crossed, rng):
    told = Inference(profile=True, draws=Draws(4, rng))
    fit = glmm_probit("y ~ 1 + x", coded(crossed), groups=("participant",), inference=told)

    assert fit["x"].p in np.arange(1, 6) / 5
    (people,) = fit.deviations
    assert people.lower < people.sd < people.upper
    assert people.icc == pytest.approx(people.sd**2 / (people.sd**2 + 1))


def test_random_slopes_equal_glmmtmb(crossed):
    fit = glmm_probit("y ~ 1 + x", coded(crossed), groups=("participant",), slopes=[("x", "item")])

    np.testing.assert_allclose(column(fit, "estimate"), R_TASKS["slope"], atol=1e-4)
    np.testing.assert_allclose(column(fit, "standard_error"), R_TASKS["slope_se"], atol=1e-4)
    np.testing.assert_allclose(list(fit.random_sd.values()), R_TASKS["slope_sd"], atol=1e-3)
    assert list(fit.random_sd) == ["participant", "x | item"]


def test_random_slopes_that_are_there_are_found(rng):
    person = np.repeat(np.arange(30), 60)
    x = np.tile([-1.0, 1.0], 900)
    slope = 0.8 * rng.standard_normal(30)
    table = pd.DataFrame({"participant": person, "x": x})
    table["y"] = (rng.random(1800) < 1 / (1 + np.exp(-(0.5 + slope[person]) * x))).astype(int)

    with_slopes = glmm_logit("y ~ x", table, groups=("participant",), slopes=[("x", "participant")])
    without = glmm_logit("y ~ x", table, groups=("participant",))

    assert with_slopes.random_sd["x | participant"] == pytest.approx(0.8, abs=0.3)
    assert with_slopes["x"].standard_error > 1.8 * without["x"].standard_error
    with pytest.raises(ValueError, match="must hold numbers"):
        glmm_logit(
            "y ~ x", table.assign(z="a"), groups=("participant",), slopes=[("z", "participant")]
        )


@pytest.mark.parametrize(
    ("link", "mirrored"),
    [("logit", False), ("probit", False), ("weibull", False), ("weibull", True)],
)
@pytest.mark.parametrize("rates", [(0.0, 0.0), (0.5, 0.03)])
def test_slopes_and_curvatures_of_responses_are_their_derivatives(link, mirrored, rates):
    response = ResponseFunction(link, *rates, mirrored)
    eta = np.linspace(-2.0, 1.5, 7)
    successes, trials = np.arange(7.0), np.full(7, 8.0)

    def each(at):
        return np.array(
            [response.log_likelihood(at[[k]], successes[[k]], trials[[k]], rates) for k in range(7)]
        )

    slope, observed, expected = response.slope(eta, successes, trials, rates)
    step = 1e-4
    np.testing.assert_allclose(slope, (each(eta + step) - each(eta - step)) / (2 * step), rtol=1e-5)
    bend = (each(eta + step) - 2 * each(eta) + each(eta - step)) / step**2
    np.testing.assert_allclose(observed, -bend, rtol=1e-3, atol=1e-5)
    assert np.all(expected > 0)
    assert response.share(np.array([0.0]), rates)[0] == pytest.approx(
        rates[0] + 0.5 * (1 - sum(rates))
    )
    assert response.share(np.array([response.eta(0.9)]), (0.0, 0.0))[0] == pytest.approx(0.9)


def test_a_probit_model_without_maximum_says_so():
    """Everybody always gives their own answer: people differ without end."""
    rows = [{"y": int(person < 4), "participant": person} for person in range(8) for _ in range(40)]
    fit = glmm_probit("y ~ 1", pd.DataFrame(rows), groups=("participant",))

    assert "numbers are left out" in fit.warnings[0]
    assert np.isnan([fit["Intercept"].estimate, fit["Intercept"].p]).all()


def test_firth_equals_brglm2():
    design = np.array([[1.0, -1], [-1, 0], [0, -1]])
    solution = fit_logit(design, np.array([106.0, 125, 132]), np.full(3, 132.0), firth=True)

    np.testing.assert_allclose(solution.beta, R["bt_firth"], atol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(solution.covariance)), R["bt_firth_se"], atol=1e-6)


def test_unanimous_answers_get_firths_estimate_and_never_read_as_no_effect():
    """By hand: log(132.5 / .5); Wald of plain maximum likelihood says p = .9996 here."""
    fit = glm_logit("y ~ 1", pd.DataFrame({"y": [1] * 132}))
    row = fit["Intercept"]

    assert row.estimate == pytest.approx(np.log(132.5 / 0.5), abs=1e-8)
    assert [row.estimate, row.standard_error] == pytest.approx(R["unanimous_firth"], abs=1e-7)
    assert row.p < 1e-10
    assert any("Firth" in note for note in fit.warnings)


def test_limits_of_a_separated_model_are_those_of_its_penalised_profile():
    """132 of 132: the penalised likelihood is l(b) + log(p q) / 2, tried on a fine grid."""
    (row,) = glm_logit("y ~ 1", pd.DataFrame({"y": [1] * 132})).coefficients
    b = np.linspace(0.0, 15.0, 1_500_001)
    penalised = 132.5 * log_expit(b) + 0.5 * log_expit(-b)
    within = b[penalised > penalised.max() - 0.5 * chi2.ppf(0.95, 1)]

    assert [row.lower, row.upper] == pytest.approx([within[0], within[-1]], abs=1e-4)


@pytest.mark.parametrize("chosen", [5, 7, 8, 9, 10])
def test_profile_limits_leave_out_zero_exactly_where_the_penalised_ratio_is_significant(chosen):
    design = np.column_stack([np.ones(4), [0.0, 0.0, 1.0, 1.0]])
    counted = design, np.array([4.0, 5.0, chosen, 10.0]), np.full(4, 10.0)
    p = likelihood_ratio_p(*counted, firth=True)[1]

    for level in (1.0 - 1.01 * p, 1.0 - 0.99 * p):
        low, high = firth_limits(*counted, level)[1]
        assert (low > 0 or high < 0) == (p < 1.0 - level)


def test_separation_by_one_condition_is_seen():
    design = np.array([[1.0, 0], [1, 0], [1, 1], [1, 1]])

    assert separated(design, np.array([0.0, 1, 1, 1]), np.ones(4))
    assert not separated(design, np.array([0.0, 1, 0, 1]), np.ones(4))


def test_a_separated_mixed_model_falls_back_and_says_so(crossed):
    table = crossed.assign(y=np.where(crossed["cond"] == "b", 1, crossed["y"]))
    fit = glmm_logit("y ~ 1 + cond", table, groups=("participant", "item"))

    assert all(np.isfinite(column(fit, "standard_error")))
    assert any(
        "separated" in note and "takes trials as independent" in note for note in fit.warnings
    )
    assert all(row.lower < row.estimate < row.upper for row in fit.coefficients)


def test_people_who_always_answer_alike_do_not_run_the_mixed_model_off():
    """Six of eight always say yes, two are mixed: the deviation has no finite maximum."""
    rows = [
        {"y": int(person < 6 or trial % 2), "participant": person, "scene": trial % 2}
        for person in range(8)
        for trial in range(4)
    ]
    fit = glmm_logit("y ~ 1", pd.DataFrame(rows), groups=("participant", "scene"))

    assert abs(fit["Intercept"].estimate) < 10
    assert 0 < fit["Intercept"].standard_error < 10


def test_sandwich_of_single_row_clusters_is_the_robust_covariance_by_hand():
    """Intercept only: V = G/(G-1) Σ (y - p)² / (n p q)²."""
    y = np.array([1.0, 1, 1, 0, 0])
    design = np.ones((5, 1))
    beta = fit_logit(design, y, np.ones(5)).beta

    found = cluster_covariance(design, y, np.ones(5), beta, (np.arange(5),))

    by_hand = 5 / 4 * (3 * 0.4**2 + 2 * 0.6**2) / (5 * 0.6 * 0.4) ** 2
    assert found[0, 0] == pytest.approx(by_hand, abs=1e-9)


def test_clustered_standard_errors_use_t_of_the_smaller_number_of_clusters(crossed):
    fit = glm_logit("y ~ 1 + cond", crossed, cluster=("participant", "item"))

    assert fit.coefficients[0].df == 7.0
    assert fit.coefficients[0].df == 7
    assert fit.coefficients[0].standard_error > R["glm_se"][0]
    assert any("only 8 clusters" in note for note in fit.warnings)


ECCENTRICITY = np.repeat([5.0, 10.0, 15.0, 20.0, 25.0], 6)
METHOD = np.tile(np.arange(6), 5)  # reference, four blurs, ours
PRINTED = np.array([0.105, -0.391, -0.611, -0.846, 0.258])  # [BB] Table 1


def test_the_design_of_table_1_reproduces_the_printed_standard_errors():
    """[BB] 6.1: 14 people x 5 eccentricities x 6 methods x 10; b0, b1 as its Fig. 17 reads."""
    design = np.column_stack(
        [np.ones(30), ECCENTRICITY, *(level == METHOD for level in range(1, 6))]
    ).astype(float)
    beta = np.concatenate([[2.976, -0.101], PRINTED])

    errors = np.sqrt(np.diag(np.linalg.inv(information(design, beta, np.full(30, 140.0)))))

    np.testing.assert_allclose(errors[2:].round(3), [0.138, 0.131, 0.129, 0.127, 0.141], atol=6e-4)


def test_wilkinson_formula_with_a_reference_level_fits_a_study_like_table_1(rng):
    rows = pd.DataFrame(
        {"eccentricity": np.repeat(ECCENTRICITY, 140), "method": np.repeat(METHOD, 140).astype(str)}
    )
    shift = np.concatenate([[0.0], PRINTED])[rows["method"].astype(int)]
    logit = 2.976 - 0.101 * rows["eccentricity"] + shift
    rows["correct"] = (rng.random(len(rows)) < 1 / (1 + np.exp(-logit))).astype(int)
    rows["method"] = rows["method"].replace({"0": "z-reference"})

    fit = glm_logit(
        f"logit(correct) {TILDE_OPERATOR} 1 + eccentricity + method",
        rows,
        reference={"method": "z-reference"},
    )

    assert len(fit.coefficients) == 7
    blur = fit["method[T.4]"]
    assert abs(blur.estimate - -0.846) < 3.5 * blur.standard_error
    assert blur.standard_error == pytest.approx(0.127, abs=0.006)


def simulated_table_1(rng, participant_sd=0.0):
    """Answers of 14 people to 300 trials each, with the coefficients of [BB] Table 1."""
    rows = pd.DataFrame(
        {
            "participant": np.repeat(np.arange(14), 300),
            "eccentricity": np.tile(np.repeat(ECCENTRICITY, 10), 14),
            "method": np.tile(np.repeat(METHOD, 10), 14),
        }
    )
    shift = np.concatenate([[0.0], PRINTED])[rows["method"]]
    logit = 2.976 - 0.101 * rows["eccentricity"] + shift
    logit = logit + participant_sd * rng.standard_normal(14)[rows["participant"]]
    rows["correct"] = (rng.random(len(rows)) < 1 / (1 + np.exp(-logit))).astype(int)
    return rows.astype({"method": str})


def test_an_effect_that_people_differ_in_is_not_found_by_the_mixed_model():
    """Intercepts alone judge the answers of nine people as if their effects were one."""
    own = np.array([2.4, 2.2, 1.8, 1.2, 1.0, 0.6, -0.9, -1.0, -1.3])
    rows = pd.DataFrame(
        [(p, c) for p in range(9) for c in range(2) for _ in range(30)],
        columns=["participant", "method"],
    )
    chance = expit(0.5 + own[rows["participant"]] * (rows["method"] - 0.5))
    rows["correct"] = (np.tile(np.arange(30) + 0.5, 18) / 30 < chance).astype(int)
    rows["method"] = rows["method"].map({0: "a", 1: "b"})
    intercepts = glmm_logit("logit(correct) ~ 1 + method", rows, groups=("participant",))
    beside = models_beside("logit(correct) ~ 1 + method", rows)
    row = beside.mixed["method[T.b]"]

    assert intercepts["method[T.b]"].p < 0.01
    assert row.df == pytest.approx(8)
    assert row.p > 0.05
    assert beside.mixed.random_sd["participant x method"] > 0.5


def test_people_who_differ_make_clustered_and_mixed_models_say_what_the_plain_one_cannot(rng):
    """The intercept is between people: its plain error is far too small. Methods are within."""
    rows = simulated_table_1(rng, participant_sd=0.9)
    beside = models_beside(
        "logit(correct) ~ 1 + eccentricity + method", rows, reference={"method": "0"}
    )

    plain, clustered, mixed = (
        fit["Intercept"].standard_error
        for fit in (beside.independent, beside.clustered, beside.mixed)
    )
    assert clustered > 1.3 * plain
    assert mixed > 1.3 * plain
    assert beside.clustered["method[T.4]"].df == 13
    assert beside.mixed.random_sd["participant"] == pytest.approx(0.9, abs=0.45)
    assert abs(beside.mixed["method[T.4]"].estimate) > abs(beside.clustered["method[T.4]"].estimate)
    with pytest.raises(ValueError, match="two values at least"):
        models_beside("correct ~ 1", rows.assign(participant=1))


@pytest.mark.parametrize(
    ("formula", "message"),
    [("z ~ 1", "left side"), ("y", "left side"), ("cond ~ 1", "0 and 1 only")],
)
def test_wrong_formulas_are_refused_in_words(crossed, formula, message):
    with pytest.raises(ValueError, match=message):
        glm_logit(formula, crossed)


def test_an_unknown_reference_names_the_levels(crossed):
    with pytest.raises(ValueError, match=r"one of \['a', 'b'\]"):
        glm_logit("y ~ cond", crossed, reference={"cond": "x"})


def test_firth_shrinks_towards_no_effect():
    design = np.column_stack([np.ones(4), [0.0, 0.0, 1.0, 1.0]])
    chosen, trials = np.array([4.0, 5.0, 8.0, 9.0]), np.full(4, 10.0)
    plain = fit_logit(design, chosen, trials)
    shrunk = fit_logit(design, chosen, trials, firth=True)

    assert 0 < shrunk.beta[1] < plain.beta[1]


def test_the_curvature_of_the_random_effects_is_that_at_their_mode(rng):
    """Not that of the step before: where the search starts must not show in a standard error."""
    rows = 60
    group = rng.integers(0, 6, rows)
    y = (rng.random(rows) < 0.6).astype(float)
    design = np.column_stack([np.ones(rows), rng.normal(0, 0.5, rows)])
    theta = np.array([0.2, 0.7, 0.8])

    def search(start):
        model = LaplaceLikelihood(design, CountedTrials.of(design, y, [group]), LOGIT)
        model.mode = start
        return model.solved(theta)

    exact = search(np.zeros(6)).b
    weight = 1.0 / (2.0 + 2.0 * np.cosh(design @ theta[:2] + 0.8 * exact[group]))
    by_hand = 1.0 + 0.64 * np.bincount(group, weights=weight, minlength=6)

    for start in (np.zeros(6), np.ones(6), exact + 9e-10, exact - 9e-10):
        np.testing.assert_allclose(search(start).arrow.blocks[:, 0, 0], 1 / by_hand, rtol=1e-11)


def one_trial_each(rng, common, spread=1.5, people=11, scenes=4):
    """One trial of each participant in each scene: design, answers, and both groups."""
    person, scene = np.indices((people, scenes)).reshape(2, -1)
    eta = common + rng.normal(0, spread, people)[person] + rng.normal(0, spread, scenes)[scene]
    y = (rng.random(eta.size) < 1 / (1 + np.exp(-eta))).astype(float)
    return np.ones((eta.size, 1)), y, [person, scene]


def test_the_mode_is_found_where_newtons_steps_alone_swing_for_ever(rng):
    for _ in range(60):
        design, y, groups = one_trial_each(rng, 3.0)
        model = LaplaceLikelihood(design, CountedTrials.of(design, y, groups), LOGIT)
        at = model.solved(np.array([2.9, 1.7, 2.8]))
        slope = at.scale * model.effects.of_effects(at.gap) - at.b
        assert np.abs(slope).max() < 1e-8


@pytest.mark.slow
def test_a_likelihood_ratio_is_against_the_best_of_the_smaller_models(rng):
    """Without an intercept either people or scenes may vary more in its place; at 0 none does."""
    larger, several, boundary = [], 0, 0
    for common in np.repeat([0.8, 1.5], 12):
        design, y, groups = one_trial_each(rng, common, 0.4)
        order = np.where(rng.random(y.size) < 0.5, 0.5, -0.5)[:, None]
        fit = fit_crossed(np.hstack([design, order]), y, groups)
        found, _ = HeldContrast(fit.maximum, np.array([1.0, 0.0])).ratio()
        tried = [
            fit_crossed(order, y, groups, start=np.array([fit.beta[1], *sd])).log_likelihood
            for sd in ((0.5, 0.5), (2.0, 0.1), (0.1, 2.0))
        ]
        larger.append(found - 2.0 * (fit.log_likelihood - max(tried)))
        several += max(tried) - min(tried) > 0.01
        boundary += fit.sd.min() < 1e-3

    assert np.max(larger) < 2e-3
    assert several >= 3
    assert boundary >= 3


PAIRED = np.array([[0, 1], [1, 2], [2, 0]])
"""Methods that three kinds of trials compare."""


@pytest.mark.parametrize(
    "response",
    [LOGIT, ResponseFunction("probit", 0.5, None), ResponseFunction("weibull", 0.25, 0.02)],
)
@pytest.mark.parametrize("paired", [False, True])
def test_the_slope_of_the_laplace_likelihood_is_its_derivative(rng, response, paired):
    """Crossed factors, and a participant's effects of two methods in each trial."""
    trials = 300
    person, scene = rng.integers(0, 9, trials), rng.integers(0, 4, trials)
    x = rng.normal(size=trials)
    design = np.column_stack([np.ones(trials), x])
    once = np.ones(trials)
    groups, times = [person, scene], [once, once]
    if paired:
        two = 3 * person[:, None] + PAIRED[rng.integers(0, 3, trials)]
        groups, times = [two, scene, person], [np.array([[1.0, -1.0]] * trials), once, x]
    y = (rng.random(trials) < 0.6).astype(float)
    model = LaplaceLikelihood(design, CountedTrials.of(design, y, groups, times), response)
    theta = np.concatenate([[0.3, -0.2], [0.7, -0.4, 0.5][: len(groups)], response.start()])

    _, slope = model(theta)
    steps = 1e-5 * np.eye(theta.size)
    by_differences = [(model(theta + s)[0] - model(theta - s)[0]) / 2e-5 for s in steps]

    np.testing.assert_allclose(slope, by_differences, atol=1e-6)


@pytest.mark.parametrize("link", ["probit", "logit"])
def test_the_slope_of_the_likelihood_of_ratings_is_its_derivative(rng, link):
    trials = 200
    person, scene = rng.integers(0, 9, trials), rng.integers(0, 4, trials)
    two = 3 * person[:, None] + PAIRED[rng.integers(0, 3, trials)]
    design, y = rng.normal(size=(trials, 2)), rng.integers(0, 4, trials)
    times = [np.array([[1.0, -1.0]] * trials), None]
    counted = CountedTrials.of(design, y, [two, scene], times, ordered=True)
    model = LaplaceLikelihood(design, counted, OrderedLaw(link))
    theta = np.array([0.3, -0.2, 0.7, -0.4, -0.8, -0.3, 0.1])

    _, slope = model(theta)
    steps = 1e-5 * np.eye(theta.size)
    by_differences = [(model(theta + s)[0] - model(theta - s)[0]) / 2e-5 for s in steps]

    np.testing.assert_allclose(slope, by_differences, atol=1e-6)


def test_blocks_and_border_solve_as_the_whole_matrix_does(rng):
    """Participants with three methods each are blocks, scenes the border."""
    person, scene = rng.integers(0, 7, 80), rng.integers(0, 4, 80)
    two = 3 * person[:, None] + PAIRED[rng.integers(0, 3, 80)]
    effects = RandomEffects([two, scene], [np.array([[1.0, -1.0]] * 80), np.ones(80)], 80)
    scale, weight = effects.scale(np.array([0.6, 0.9])), rng.random(80)
    z = np.stack([effects.on_trials(unit) for unit in np.eye(effects.size)], axis=1) * scale
    whole = np.eye(effects.size) + z.T @ (z * weight[:, None])
    vector = rng.normal(size=effects.size) * (scale > 0)

    arrow = effects.arrow(weight, scale)

    assert arrow.blocks.shape == (7, 3, 3)
    assert arrow.border.shape == (4, 4)
    np.testing.assert_allclose(arrow.solve(vector), np.linalg.solve(whole, vector), atol=1e-12)
    assert arrow.log_det == pytest.approx(np.linalg.slogdet(whole)[1], abs=1e-12)
    leverage, _ = effects.leverage(arrow, weight, scale)
    np.testing.assert_allclose(leverage, np.diag(z @ np.linalg.inv(whole) @ z.T), atol=1e-12)


@pytest.mark.parametrize(("scale", "shift"), [(1e-9, 0.0), (1e9, 0.0), (1.0, 1e6), (1e-4, 30.0)])
@pytest.mark.parametrize("model", [glm_logit, partial(glmm_logit, groups=["participant"])])
def test_the_unit_of_a_covariate_changes_no_p(model, scale, shift):
    """Picoseconds or years, and dates: p and z are those of the standardised covariate."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=240)
    rows = pd.DataFrame(
        {
            "y": (rng.random(240) < 1 / (1 + np.exp(-0.4 * x))).astype(int),
            "x": x,
            "participant": np.arange(240) % 8,
        }
    )
    plain = model("y ~ 1 + x", rows)["x"]
    found = model("y ~ 1 + x", rows.assign(x=x * scale + shift))["x"]

    assert found.p == pytest.approx(plain.p, rel=1e-4)
    assert found.estimate * scale == pytest.approx(plain.estimate, rel=1e-4)
    assert found.standard_error * scale == pytest.approx(plain.standard_error, rel=1e-4)


def test_a_trial_without_a_group_is_refused():
    rows = pd.DataFrame({"y": [0, 1] * 10, "who": ["a", None, "b", "c"] * 5})

    with pytest.raises(
        ValueError, match=r"column 'who' must name a group in every row \(row 2 has"
    ):
        glmm_logit("y ~ 1", rows, groups=["who"])
