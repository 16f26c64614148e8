"""Thresholds at a stated performance, slopes, limits of curves, and goodness of fit.

Oracles are R's glm and MASS::dose.p; people who answer alike make its model and ours the same.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_trials import TaskDesign, simulate_identification
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy import stats
from scipy.special import ndtri
from typer.testing import CliRunner

from analysis.models.curves.goodness_of_fit import _deviances, _refitted, curve_misfits, misfits
from analysis.models.curves.psychometric_posterior import psychometric_posterior
from analysis.models.curves.quadrature import _Integrated
from analysis.models.curves.response import ResponseFunction
from analysis.models.psychometric import CurveForm, fit_psychometric
from analysis.models.thresholds import ThresholdModel, fit_thresholds
from analysis.plans.rate_plan import RatePlan
from analysis.plots import DrawnCurve, people_plot, psychometric_plot
from analysis.tasks import analysis_of
from analysis.tasks.note import options_from
from protocols.errors import StudyError
from study_app.cli import app

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_stated.json").read_text())
HITS = {"a": (1, 3, 9, 16, 19), "b": (2, 4, 6, 12, 15)}
ERROR_RTOL = {"probit": 1e-2, "logit": 2e-3}
"""Errors of R's probit invert the expected information, ours the observed one."""
SHAPES = {"probit": "gauss", "logit": "logistic"}
LEVELS = list(np.linspace(-3, 3, 7))


def alike(people: int = 2) -> pd.DataFrame:
    """Return the trials of oracle_stated.R, answered by so many people in the same way."""
    return pd.DataFrame(
        [
            (f"P{who}", method, level, int(trial < hits))
            for who in range(people)
            for method, several in HITS.items()
            for level, hits in zip((-2.0, -1.0, 0.0, 1.0, 2.0), several, strict=True)
            for trial in range(20)
        ],
        columns=["participant", "method", "level", "correct"],
    )


@pytest.fixture(scope="module", params=SHAPES)
def of_r(request) -> tuple[str, ThresholdModel]:
    shape = SHAPES[request.param]
    curve = CurveForm(guess=0.0, lapse=0.0, shape=shape)
    return request.param, fit_thresholds(alike(), "level", ("method",), curve, own_widths=True)


@pytest.mark.parametrize(("place", "share"), [(0, None), (1, 0.75), (2, 0.6)])
def test_stated_thresholds_and_their_limits_are_those_of_dose_p(of_r, place, share):
    """Two people have half the variance, which P / (P - 1) doubles; and one degree of freedom."""
    link, model = of_r
    found, (gap,) = model.population.thresholds(share)
    reach = stats.t.ppf(0.975, 1)
    for one in found:
        value = ORACLE[f"{link}_{one.condition}_dose"][place]
        error = ORACLE[f"{link}_{one.condition}_error"][place]
        assert one.value == pytest.approx(value, abs=2e-4)
        assert (one.upper - one.lower) / 2 / reach == pytest.approx(error, rel=ERROR_RTOL[link])
        chance = model.population.typical(one.condition, np.array([one.value]))
        assert chance == pytest.approx(share or 0.5, abs=1e-9)
    a, b = (ORACLE[f"{link}_{name}_dose"][place] for name in "ab")
    errors = [ORACLE[f"{link}_{name}_error"][place] for name in "ab"]
    assert gap.difference == pytest.approx(a - b, abs=3e-4)
    assert gap.standard_error == pytest.approx(np.hypot(*errors), rel=ERROR_RTOL[link])


def test_slopes_are_compared_as_their_logarithms_in_r(of_r):
    link, model = of_r
    (ratio,) = model.population.slope_ratios()
    value, error = ORACLE[f"{link}_slopes"]

    assert ratio.difference == pytest.approx(value, abs=2e-3)
    assert ratio.standard_error == pytest.approx(error, rel=ERROR_RTOL[link])
    assert ratio.df == 1


def test_limits_of_a_curve_are_those_of_predict(of_r):
    link, model = of_r
    x = np.array([-1.5, 0.2, 2.0])
    of_eta = {"probit": ndtri, "logit": lambda p: np.log(p / (1 - p))}[link]
    np.testing.assert_allclose(
        of_eta(model.population.average("a", x)), ORACLE[f"{link}_eta"], atol=2e-3
    )
    if link == "probit":
        lower, upper = map(ndtri, model.population.average_limits("a", x))
        error = (upper - lower) / 2 / stats.t.ppf(0.975, 1)
        np.testing.assert_allclose(error, ORACLE["probit_eta_error"], rtol=1e-2)


def test_deviance_is_that_of_r_and_what_the_model_simulates_has_one_for_each_count(of_r, rng):
    link, model = of_r
    rows = alike()
    found, predicted = misfits(rows, "level", rows["method"], model.population, rng)
    for one, deviance in zip(found, ORACLE[f"{link}_deviance"], strict=True):
        assert one.deviance == pytest.approx(2 * deviance, rel=0.02, abs=2e-3)
        assert one.cells == 10
        assert one.expected == pytest.approx(10, rel=0.15)
        assert one.p > 0.9
    own = predicted.reshape(2, 2, 5, 20)[..., 0]
    np.testing.assert_allclose(own[0], own[1], atol=1e-6)


def test_a_mean_curve_is_the_normal_integral_and_lies_in_its_limits(rng):
    """Probit: Phi(eta / sqrt(1 + sd^2)), between guesses and lapses."""
    rows = simulate_identification(
        TaskDesign(12, 1, 8), {"a": 0.0, "b": 0.5}, rng, levels=LEVELS, width=3.0,
        participant_sd=0.6, interaction_sd=0.3, lapse=0.03,
    )  # fmt: skip
    population = fit_thresholds(rows, "level", ("method",)).population
    x = np.linspace(-3, 3, 9)
    guess, lapse = population.rates()
    spread = np.sqrt(1 + sum(sd**2 for sd in population.sd.values()))
    mean = guess + (1 - guess - lapse) * stats.norm.cdf(population.eta("b", x) / spread)
    lower, upper = population.average_limits("b", x)

    np.testing.assert_allclose(population.average("b", x), mean, atol=1e-4)
    assert np.all((guess <= lower) & (lower <= mean) & (mean <= upper) & (upper <= 1))
    assert (upper - lower)[0] < 0.12


def test_scores_of_participants_are_slopes_of_their_own_likelihoods(rng):
    rows = simulate_identification(
        TaskDesign(4, 1, 4), {"a": 0.0}, rng, levels=LEVELS, width=3.0, participant_sd=0.6
    )
    person = rows["participant"].astype("category").cat.codes.to_numpy(np.int64)
    design = np.column_stack([np.ones(len(rows)), rows["level"]])
    y, nothing = rows["correct"].to_numpy(float), np.zeros(len(rows), np.int64)
    model = _Integrated.of(
        design, y, person, nothing, ResponseFunction("probit", 0.5), np.full(2, np.inf)
    )
    theta = np.array([0.1, 0.9, 0.6])
    each = model.parts(most=1)

    assert len(each) == 4
    for part in each:
        steps = 1e-5 * np.eye(3)
        numeric = [(part(theta + s)[0] - part(theta - s)[0]) / 2e-5 for s in steps]
        np.testing.assert_allclose(part(theta)[1], numeric, atol=1e-4)


def test_people_who_differ_in_slopes_widen_the_limits_of_ratios(rng):
    def ratio(slope_sd):
        width = 3.0 * np.exp(slope_sd * np.array([-1, 1, -1, 1, -1, 1, -1, 1]))
        parts = [
            simulate_identification(
                TaskDesign(1, 1, 20), {name: 0.0}, rng, levels=LEVELS, width=float(one),
                participant_sd=0.0, alternatives=4,
            ).assign(participant=f"P{who}", method=name)
            for who, one in enumerate(width)
            for name, one in (("a", one), ("b", 9.0 / one))
        ]  # fmt: skip
        rows, curve = pd.concat(parts), CurveForm(guess=0.25)
        model = fit_thresholds(rows, "level", ("method",), curve, own_widths=True)
        return model.population.slope_ratios()[0]

    assert ratio(0.5).standard_error > 1.5 * ratio(0.0).standard_error


def test_a_curve_that_answers_do_not_follow_is_found_by_level():
    """A third of the answers at one high level are guesses; at the others all is as modelled."""
    rng = np.random.default_rng(3)
    rows = simulate_identification(
        TaskDesign(12, 1, 10), {"a": 0.0, "b": 0.0}, rng, levels=LEVELS, width=3.0,
        participant_sd=0.6,
    )  # fmt: skip
    guessed = (rows["level"] == 2.0) & (rows["method"] == "a") & (rng.random(len(rows)) < 0.4)
    rows.loc[guessed, "correct"] = rng.integers(0, 2, guessed.sum())
    model = fit_thresholds(rows, "level", ("method",))
    a, b = misfits(rows, "level", rows["method"], model.population, rng)[0]

    assert a.level_p_adjusted < 0.01
    assert b.level_p > 0.05
    worst = int(np.argmin(a.residuals))
    assert a.levels[worst] == 2.0
    assert a.residuals[worst] < a.lower[worst]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "falling"), [("gauss", False), ("gumbel", True), ("weibull", False)]
)
def test_what_a_curve_simulates_is_fitted_anew_as_the_answers_were(shape, falling, rng):
    """No worse than the search that fits answers, set by set, which can be stuck at a bound."""
    levels = np.exp(np.linspace(-1, 1, 7)) if shape == "weibull" else np.linspace(-3, 3, 7)
    right, shown = np.array([9.0, 11, 12, 15, 18, 20, 20]), np.full(7, 20.0)
    right = right[::-1] if falling else right
    curve = CurveForm(shape=shape, falling=falling)
    fit = fit_psychometric(levels, right, shown, curve)
    drawn = rng.binomial(20, np.tile(fit(levels), (6, 1))).astype(float)
    found = _deviances(drawn, _refitted(fit, levels, drawn, shown, 0.5), shown)
    best = [fit_psychometric(levels, one, shown, curve).deviance for one in drawn]
    (one,) = curve_misfits({"a": fit}, {"a": (levels, right, shown)}, 0.5, rng)

    assert np.all(found <= np.array(best) + 0.3)
    assert one.deviance == pytest.approx(fit.deviance, abs=1e-5)
    assert one.expected == pytest.approx(4.2, abs=1.3)  # 7 levels less 3 parameters


def test_slopes_that_the_levels_do_not_tell_are_not_compared():
    """Widths of half of the gap between levels: only the prior bounds them."""
    rows = simulate_identification(
        TaskDesign(10, 1, 6), {"a": 0.0, "b": 0.2}, np.random.default_rng(0), levels=LEVELS,
        width=0.5, participant_sd=0.8, interaction_sd=0.3,
    )  # fmt: skip
    population = fit_thresholds(rows, "level", ("method",), own_widths=True).population

    assert set(population.narrow) == {"a", "b"}
    assert population.slope_ratios() == ()


@pytest.mark.parametrize("share", [0.75, 0.9])
def test_a_persons_stated_threshold_is_the_posteriors_by_plain_sums(share):
    """Binomial answers, no lapses: sums over 400 x 400 thresholds and widths, even priors."""
    right, shown = np.array([31.0, 30, 35, 44, 55, 59, 60]), np.full(7, 60.0)
    x = np.linspace(-3, 3, 7)
    fit = psychometric_posterior(
        x, right, shown, CurveForm(lapse=0.0), share=share, overdispersed=False
    )
    place, width = np.meshgrid(np.linspace(-3, 3, 400), np.linspace(2, 6, 400), indexing="ij")
    span = 2 * ndtri(0.95)
    chance = 0.5 + 0.5 * stats.norm.cdf(span * (x - place[..., None]) / width[..., None])
    height = stats.binom.logpmf(right, shown, np.clip(chance, 0, 1 - 1e-9)).sum(axis=-1)
    where = (place + width * ndtri(2 * share - 1) / span).ravel()
    order = np.argsort(where)
    risen = np.cumsum(np.exp(height - height.max()).ravel()[order])
    wanted = np.interp([0.5, 0.025, 0.975], risen / risen[-1], where[order])

    assert fit.stated is not None
    found = [fit.stated.value, fit.stated.lower, fit.stated.upper]
    np.testing.assert_allclose(found, wanted, atol=0.05)


@pytest.mark.parametrize(("kind", "count", "share"), [
    ("identification", 2, ORACLE["d_prime_1"][0]), ("identification", 3, ORACLE["d_prime_1"][1]),
    ("identification", 4, ORACLE["d_prime_1"][2]), ("detection", 2, float(stats.norm.cdf(0.5))),
    ("abx", 2, 0.5825), ("which-half", 2, 0.5733),
])  # fmt: skip
def test_d_prime_of_one_is_a_share_of_right_answers_by_the_task(kind, count, share):
    """By R's integral; ABX and two pairs by hand from Phi(1/sqrt 2), Phi(1/sqrt 6), Phi(1/2)."""
    rule = "dual-pair" if kind == "which-half" else "differencing"
    plan = RatePlan(
        kind=kind, study="s", title="s", values=("a",), answers=(), alternatives=count, labels={},
        guess=1 / count, level="level", threshold_at="dprime=1", rule=rule,
    )  # fmt: skip
    assert plan.stated_share == pytest.approx(share, abs=1e-4)


@pytest.mark.parametrize(("options", "said"), [
    (("--threshold-at", "0.5"), "--threshold-at 0.5: must be above the rate of guessing, 0.5"),
    (("--threshold-at", "1.5"), "--threshold-at: must be a share of right answers between 0 and 1"),
    (("--threshold-at", "dprime=-1"), "or a d' as \"dprime=1\" (got 'dprime=-1')"),
    (("--threshold-at", "dprime=1", "--guess", "0"), "state a share of right answers in its place"),
    (("--threshold-at", "dprime=1", "--guess", "fit"), "where --guess is 1/m"),
])  # fmt: skip
def test_performance_that_no_curve_has_is_refused_with_a_cure(options, said, tmp_path):
    alike(3).to_csv(tmp_path / "rows.csv", index=False)
    arguments = ["analysis", "psychometric", str(tmp_path / "rows.csv"), "--level", "level"]
    if "--guess" not in options:
        rows = alike(3)
        rows.loc[rows["level"] < 0, "correct"] = np.arange((rows["level"] < 0).sum()) % 2
        rows.to_csv(tmp_path / "rows.csv", index=False)
    done = CliRunner().invoke(app, [*arguments, *options], env={"COLUMNS": "300"})

    assert done.exit_code == 2, done.output
    assert said in done.output


def test_a_table_without_levels_states_no_performance():
    told = options_from("identification", {"threshold_at": "0.75", "alternatives": "2"})
    with pytest.raises(StudyError, match=r"threshold_at=0.75: must be left out, or --set level"):
        analysis_of("identification").settings_of_table(alike(), "rows", told)


def drawn_curve() -> DrawnCurve:
    def share(x):
        return 0.5 + 0.5 * stats.norm.cdf(x)

    return DrawnCurve(share, lambda x: (share(x - 0.3), share(x + 0.3)), (0.0, -0.4, 0.4))


def test_a_figure_has_limits_of_the_curve_and_of_the_threshold():
    x = np.linspace(-2, 2, 7)
    data = (x, np.array([5.0, 5, 6, 7, 9, 10, 10]), np.full(7, 10.0))
    figure = psychometric_plot({"one": (*data, drawn_curve())}, x_label="x", chance=0.5)
    axes, strip = figure.axes
    FigureCanvasAgg(figure).draw()

    assert len(axes.collections) == 2  # whiskers and the band
    assert any(list(line.get_xdata()) == [-0.4, 0.4] for line in strip.lines)
    assert any(list(line.get_xdata()) == [0.0, 0.0] for line in axes.lines)
    boxes = [one.get_window_extent() for one in strip.get_xticklabels() if one.get_text()]
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))


def test_every_person_has_a_panel_up_to_a_number_of_them(monkeypatch):
    x, right, shown = np.array([1.0, 2, 3]), np.array([5.0, 8, 10]), np.full(3, 10.0)
    people = {f"P{k}": {"a": (x, right, shown, drawn_curve())} for k in range(5)}

    def seen() -> list[str]:
        axes = people_plot(people, x_label="x", chance=0.5).axes
        for one in axes:
            assert not one.get_visible() or any(len(line.get_xdata()) == 200 for line in one.lines)
        return [one.get_title(loc="left") for one in axes if one.get_visible()]

    assert seen() == list(people)
    monkeypatch.setattr("analysis.plots.psychometric_plots.PANELS", 2)
    assert seen() == ["P0", "P1"]
