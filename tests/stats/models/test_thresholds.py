"""Thresholds with participants as random: recovery, coverage, comparisons, refusals."""

import numpy as np
import pandas as pd
import pytest
from made_up_trials import TaskDesign, simulate_identification
from scipy.special import ndtr

from analysis.models.curves.quadrature import fit_people
from analysis.models.curves.response import CurveForm, ResponseFunction
from analysis.models.logistic import glmm_logit
from analysis.models.thresholds import fit_thresholds
from protocols.adaptive.psychometric_function import probability

STEEP = (0, 3, 4)
"""Of studies that the model of participants by Laplace's method gave no thresholds of."""

LEVELS = list(np.linspace(-3, 3, 7))


def study(rng, thresholds=None, *, people=12, repeats=8, **more):
    chosen = {"a": 0.0, "b": 0.0} if thresholds is None else thresholds
    options = {"levels": LEVELS, "width": 3.0, "participant_sd": 0.6, "interaction_sd": 0.3}
    return simulate_identification(
        TaskDesign(people, 1, repeats), chosen, rng, **{**options, **more}
    )


def test_without_guesses_and_lapses_it_is_the_logit_mixed_model(rng):
    """Threshold = -intercept / slope; delta-method limits by hand."""
    rows = study(rng, {"a": 0.4}, alternatives=2, lapse=0.0, shape="logistic")
    curve = CurveForm(guess=0.0, lapse=0.0, shape="logistic")
    model = fit_thresholds(rows, "level", curve=curve)
    glmm = glmm_logit("correct ~ 1 + level", rows, groups=("participant",))
    slope = glmm["level"].estimate

    assert model["all"].value == pytest.approx(-glmm["Intercept"].estimate / slope, abs=1e-4)
    assert model["all"].width == pytest.approx(2 * np.log(19) / slope, abs=1e-3)
    assert model.log_likelihood == pytest.approx(glmm.log_likelihood, abs=1e-3)
    assert model.participant_sd == pytest.approx(glmm.random_sd["participant"] / slope, abs=1e-3)


def test_the_likelihood_is_the_integral_over_what_people_differ_by(rng):
    """Against plain sums over 201 x 201 values of the two deviations; its slope is 0 there."""
    rows = study(rng, people=4, repeats=6)
    person = rows["participant"].astype("category").cat.codes.to_numpy(np.int64)
    condition = rows["method"].astype("category").cat.codes.to_numpy(np.int64)
    y = rows["correct"].to_numpy(float)
    level = rows["level"].to_numpy(float)
    design = np.column_stack([condition == 0, condition == 1, level]).astype(float)
    response = ResponseFunction("probit", 0.5, 0.02)
    fit = fit_people(
        design, y, person, condition, response=response, start=np.array([0.0, 0.0, 1.0]),
        steepest=np.full(3, np.inf),
    )  # fmt: skip
    grid = np.linspace(-7, 7, 201)
    weight = np.exp(-0.5 * grid**2) * (grid[1] - grid[0]) / np.sqrt(2 * np.pi)

    def summed(beta, sd):
        apart = sd[0] * grid[:, None] + sd[1] * grid
        right = rows.groupby([person, condition, "level"])["correct"].agg(["sum", "size"])
        inner = {}
        for (who, what, place), (hits, shown) in right.iterrows():
            share = 0.5 + 0.48 * ndtr(beta[what] + beta[2] * place + apart)
            answers = hits * np.log(share) + (shown - hits) * np.log1p(-share)
            inner[who, what] = inner.get((who, what), 0.0) + answers
        one = [
            np.exp(inner[who, 0]) @ weight * (np.exp(inner[who, 1]) @ weight) for who in range(4)
        ]
        return float(np.sum(np.log(np.array(one) @ weight)))

    assert fit.log_likelihood == pytest.approx(summed(fit.beta, fit.sd), abs=1e-4)
    for step in (0.05, -0.05):
        assert summed(fit.beta + np.array([0, 0, step]), fit.sd) < fit.log_likelihood
        assert summed(fit.beta, fit.sd + np.array([step, 0])) <= fit.log_likelihood + 1e-4


@pytest.mark.parametrize("seed", STEEP)
def test_steep_curves_have_thresholds_with_limits(seed):
    """Laplace's method found no maximum here: with a guess rate it makes up likelihood."""
    rows = study(np.random.default_rng(seed), people=10, repeats=6, width=1.0, participant_sd=0.8)
    model = fit_thresholds(rows, "level", ("method",))

    assert len(model.contrasts) == 1
    for one in model.thresholds:
        assert one.lower is not None
        assert one.upper is not None
        assert one.lower < one.value < one.upper
        assert one.upper - one.lower < 3.0


def test_a_participant_who_lapses_is_told_from_one_whose_threshold_is_high(rng):
    steady = study(rng, {"a": -1.0}, people=9, repeats=40, lapse=0.01)
    absent = study(rng, {"a": -1.0}, people=1, repeats=40, lapse=0.2, participant_sd=0.0)
    rows = pd.concat([steady, absent.assign(participant="P999")])
    shared = fit_thresholds(rows, "level", curve=CurveForm(lapse=0.01))
    own = fit_thresholds(rows, "level")

    assert shared["all"].individual["P999"] > -0.6
    assert own["all"].individual["P999"] < shared["all"].individual["P999"] - 0.2
    assert own.lapse == pytest.approx(0.03, abs=0.02)


@pytest.mark.parametrize("of_scenes", [0.0, 1.0])
def test_a_condition_that_differs_by_scene_is_judged_by_scenes(rng, of_scenes):
    """Few degrees of freedom where scenes decide; those of people where they do not matter."""
    rows = simulate_identification(
        TaskDesign(12, 4, 2), {"a": 0.0, "b": 0.0}, rng, levels=LEVELS, width=3.0,
        participant_sd=0.6, interaction_sd=0.3,
    )  # fmt: skip
    scene = rows["scene"].astype("category").cat.codes
    rows["level"] += of_scenes * np.array([-1.5, -0.5, 0.5, 1.5])[scene] * (rows["method"] == "b")
    (gap,) = fit_thresholds(rows, "level", ("method",), scenes=True).contrasts
    (without,) = fit_thresholds(rows, "level", ("method",)).contrasts

    assert without.df == pytest.approx(11)
    if of_scenes:
        assert gap.df < 6
        assert gap.upper - gap.lower > 2 * (without.upper - without.lower)
    else:
        assert gap.df > 6


def test_thresholds_deviations_and_lapses_are_recovered(rng):
    rows = study(rng, {"a": -0.5, "b": 0.5}, people=40, repeats=20, lapse=0.03)
    model = fit_thresholds(rows, "level", ("method",))

    assert model["a"].value == pytest.approx(-0.5, abs=0.3)
    assert model["b"].value == pytest.approx(0.5, abs=0.3)
    assert model["a"].width == pytest.approx(3.0, abs=0.4)
    assert model.participant_sd == pytest.approx(0.6, abs=0.25)
    assert model.interaction_sd == pytest.approx(0.3, abs=0.2)
    assert model.lapse == pytest.approx(0.03, abs=0.015)
    (gap,) = model.contrasts
    assert (gap.first, gap.second) == ("a", "b")
    assert gap.upper < 0
    assert gap.lower < -1.0 < gap.upper


@pytest.mark.slow
def test_limits_of_thresholds_cover_and_equal_thresholds_rarely_differ(rng, proof_count):
    """12 people x 3 conditions x 7 levels x 8: coverage .93 to .97, false positives to .06."""
    studies = proof_count(120)
    covered, wrong, values, without = [], [], [], 0
    for _ in range(studies):
        model = fit_thresholds(study(rng, {"a": 0.0, "b": 0.0, "c": 0.0}), "level", ("method",))
        values += [one.value for one in model.thresholds]
        if not model.contrasts:
            without += 1
            continue
        covered += [one.lower <= 0.0 <= one.upper for one in model.thresholds]
        wrong += [one.p < 0.05 for one in model.contrasts]
    # Three conditions of one study share its people: they count as little more than one.
    slack = 3.5 * np.sqrt(0.05 * 0.95 / studies)

    assert without <= 0.05 * studies + 1
    assert 0.93 - slack <= np.mean(covered) <= 0.97 + slack
    assert np.mean(wrong) <= 0.06 + slack
    assert abs(np.mean(values)) < 0.1 + 3.5 * 0.25 / np.sqrt(studies)


def test_each_participant_has_a_threshold_near_their_own(rng):
    rows = study(rng, {"a": 0.0}, people=10, repeats=60, participant_sd=1.0, interaction_sd=0.0)
    model = fit_thresholds(rows, "level")
    share = rows.groupby("participant")["correct"].mean()
    own = pd.Series(dict(model["all"].individual))

    assert list(own.index) == list(share.index)
    assert own.corr(share, method="spearman") < -0.9
    assert own.std() == pytest.approx(model.participant_sd, rel=0.35)


def test_performance_that_falls_has_a_negative_width_and_the_curve_follows_the_data(rng):
    rows = study(
        rng,
        {"a": 17.0, "b": 14.0},
        levels=[5, 10, 15, 20, 25],
        width=-12.0,
        repeats=40,
        participant_sd=2.0,
        interaction_sd=1.0,
    )
    model = fit_thresholds(rows, "level", ("method",), reference="b")

    assert model["a"].width < 0
    assert model.contrasts[0].first == "a"
    for name, part in rows.groupby("method"):
        right = part.groupby("level")["correct"].mean()
        np.testing.assert_allclose(
            model.population.average(str(name), right.index.to_numpy(float)), right, atol=0.06
        )
    typical = model.population.typical("a", np.array([model["a"].value]))[0]
    assert typical == pytest.approx(0.5 + 0.5 * (0.5 - model.lapse))


@pytest.mark.parametrize("shape", ["gauss", "weibull"])
def test_logarithmic_levels_give_thresholds_on_their_own_axis(rng, shape):
    levels = np.geomspace(0.5, 8, 7)
    rows = study(
        rng, {"a": np.log(2.0)}, levels=np.log(levels), width=1.8, repeats=40, participant_sd=0.2
    )
    rows["level"] = np.exp(rows["level"])
    model = fit_thresholds(rows, "level", curve=CurveForm(shape=shape, logarithmic=True))

    assert model["all"].value == pytest.approx(2.0, rel=0.2)
    assert 0 < model["all"].lower < model["all"].value < model["all"].upper
    if shape == "gauss":
        assert np.log(model["all"].width) == pytest.approx(1.8, abs=0.6)


@pytest.mark.parametrize("shape", ["gumbel", "weibull"])
@pytest.mark.parametrize("falling", [False, True])
def test_the_curve_is_the_one_that_an_adaptive_rule_plans_with(rng, shape, falling):
    """Answers drawn from QUEST+'s own function: threshold and curve come back, the same shape."""
    levels = np.repeat([2.0, 4.0, 6.0, 8.0, 10.0, 12.0], 300)
    told = {"guess": 0.5, "lapse": 0.02, "shape": shape, "falling": falling}
    chance = probability(levels, threshold=7.0, width=6.0, **told)
    rows = pd.DataFrame(
        {
            "participant": np.tile([f"P{n}" for n in range(6)], 300),
            "level": levels,
            "correct": (rng.random(levels.size) < chance).astype(int),
        }
    )
    logarithmic = shape == "weibull"
    curve = CurveForm(lapse=0.02, shape=shape, falling=falling, logarithmic=logarithmic)
    model = fit_thresholds(rows, "level", curve=curve)
    x = np.linspace(2.0, 12.0, 11)
    one = model["all"]

    assert one.value == pytest.approx(7.0, abs=0.6)
    assert (one.width < 0) == falling
    np.testing.assert_allclose(
        model.population.typical("all", x),
        probability(x, threshold=7.0, width=6.0, **told),
        atol=0.07,
    )
    if not logarithmic:  # widths are ratios there
        same = probability(x, threshold=one.value, width=abs(one.width), **told)
        np.testing.assert_allclose(model.population.typical("all", x), same, rtol=1e-9)


def test_a_guess_rate_can_be_fitted(rng):
    rows = study(rng, {"a": 0.0}, alternatives=8, people=20, repeats=40, interaction_sd=0.0)

    model = fit_thresholds(rows, "level", curve=CurveForm(guess=None))
    assert model.guess == pytest.approx(0.125, abs=0.05)


def test_scenes_that_differ_widen_limits(rng):
    rows = simulate_identification(
        TaskDesign(10, 6, 6), {"a": 0.0}, rng, levels=LEVELS, width=3.0, scene_sd=0.8
    )
    without = fit_thresholds(rows, "level")
    model = fit_thresholds(rows, "level", scenes=True)

    assert model.scene_sd == pytest.approx(0.8, abs=0.5)
    assert model["all"].upper - model["all"].lower > 1.5 * (
        without["all"].upper - without["all"].lower
    )


def test_the_error_over_few_scenes_is_that_of_their_mean(rng):
    """Likelihood takes deviations from a mean that it fitted: of three they come out too small."""
    rows = simulate_identification(
        TaskDesign(10, 3, 5), {"a": 0.0, "b": 0.0}, rng, levels=LEVELS, width=3.0,
        participant_sd=0.1,
    )  # fmt: skip
    scene = rows["scene"].astype("category").cat.codes
    rows["level"] += np.array([-1.2, 0.0, 1.2])[scene] * (rows["method"] == "b")
    (gap,) = fit_thresholds(rows, "level", ("method",), scenes=True).contrasts

    assert gap.standard_error > 0.95 * 1.2 / np.sqrt(3.0)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (lambda r: r.drop(columns="level"), {}, "missing"),
        (lambda r: r.assign(level="high"), {}, "must hold numbers"),
        (lambda r: r.assign(level=1.0), {}, "two levels at least"),
        (lambda r: r[r["participant"] == "P001"], {}, "two participants"),
        (lambda r: r.assign(correct=2), {}, "0 and 1"),
        (lambda r: r, {"curve": CurveForm(logarithmic=True)}, "must be positive"),
        (lambda r: r, {"curve": CurveForm(shape="weibull")}, "logarithmic=True"),
        (lambda r: r, {"by": ("method",), "reference": "x"}, "reference must be one of"),
    ],
)
def test_tables_without_thresholds_are_refused(rng, change, options, message):
    rows = study(rng, people=3, repeats=2)
    with pytest.raises(ValueError, match=message):
        fit_thresholds(change(rows), "level", **options)
