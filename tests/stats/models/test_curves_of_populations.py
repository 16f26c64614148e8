"""Thresholds, limits of curves, and goodness of fit.

Oracles are R's glm and MASS::dose.p; people who answer alike make its model and ours the same.
"""

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

from analysis.models.curves.goodness_of_fit import misfits
from analysis.models.curves.response import CurveForm
from analysis.models.thresholds import ThresholdModel, fit_thresholds
from analysis.plots import DrawnCurve, people_plot, psychometric_plot

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_curves.json").read_text())
HITS = {"a": (1, 3, 9, 16, 19), "b": (2, 4, 6, 12, 15)}
ERROR_RTOL = {"probit": 1e-2, "logit": 2e-3}
"""Errors of R's probit invert the expected information, ours the observed one."""
SHAPES = {"probit": "gauss", "logit": "logistic"}
LEVELS = list(np.linspace(-3, 3, 7))


def alike(people: int = 2) -> pd.DataFrame:
    """Return the trials of oracle_curves.R, answered by so many people in the same way."""
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


@pytest.fixture(scope="module", params=[(link, name) for link in SHAPES for name in HITS])
def of_r(request) -> tuple[str, str, pd.DataFrame, ThresholdModel]:
    link, name = request.param
    curve = CurveForm(guess=0.0, lapse=0.0, shape=SHAPES[link])
    rows = alike().query("method == @name")
    return link, name, rows, fit_thresholds(rows, "level", ("method",), curve)


def test_thresholds_and_their_limits_are_those_of_dose_p(of_r):
    """Two people have half the variance, which P / (P - 1) doubles; and one degree of freedom."""
    link, name, _, model = of_r
    (one,), gaps = model.population.thresholds()
    (value,), (error,) = (ORACLE[f"{link}_{name}_{part}"] for part in ("dose", "error"))

    assert gaps == ()
    assert one.value == pytest.approx(value, abs=2e-4)
    half = (one.upper - one.lower) / 2
    assert half / stats.t.ppf(0.975, 1) == pytest.approx(error, rel=ERROR_RTOL[link])
    chance = model.population.typical(name, np.array([one.value]))
    assert chance == pytest.approx(0.5, abs=1e-9)


def test_limits_of_a_curve_are_those_of_predict(of_r):
    link, name, _, model = of_r
    if name != "a":
        return
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
    link, name, rows, model = of_r
    (one,), predicted = misfits(rows, "level", rows["method"], model.population, rng)

    deviance = ORACLE[f"{link}_deviance"][list(HITS).index(name)]
    assert one.deviance == pytest.approx(2 * deviance, rel=0.02, abs=2e-3)
    assert one.cells == 10
    assert one.expected == pytest.approx(10, rel=0.2)
    assert one.p > 0.9
    own = predicted.reshape(2, 5, 20)[..., 0]
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
