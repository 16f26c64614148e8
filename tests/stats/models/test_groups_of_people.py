"""Groups of people, or of scenes, that saw one condition each are samples of their own."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from analysis.models.contrasts import CrossedDesign, Effect, between_df
from analysis.models.curves.response import CurveForm
from analysis.models.mixed.reaction_model import time_model
from analysis.models.ordinal import rating_model
from analysis.models.thresholds import fit_thresholds

PEOPLE = 6
GROUP = np.arange(PEOPLE) % 2


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    """Three people in each of two groups."""
    rng = np.random.default_rng(3)
    table = pd.DataFrame(product(range(PEOPLE), range(8)), columns=["participant", "again"])
    table["group"] = np.where(GROUP[table["participant"]], "expert", "novice")
    latent = rng.normal(0.0, 0.6, PEOPLE)[table["participant"]] + rng.normal(0.0, 0.5, len(table))
    return table.assign(rt_s=np.exp(latent), rating=np.digitize(latent, (-0.7, 0.0, 0.7)))


def test_times_of_two_groups_are_compared_as_by_the_t_test_of_two_samples(rows):
    """A contrast has its t; the likelihood ratio of n means is n log(1 + t^2 / (n - 2))."""
    model = time_model(rows, ("group",), asked={"gap": {"expert": 1.0, "novice": -1.0}})
    (found,), (gap,) = model.ratios, model.margins.contrasts
    means = np.log(rows["rt_s"]).groupby([rows["group"], rows["participant"]]).mean()
    wanted = stats.ttest_ind(means["expert"], means["novice"])

    assert found.df == pytest.approx(PEOPLE - 2)
    assert gap.p == pytest.approx(wanted.pvalue, rel=1e-4)
    ratio = PEOPLE * np.log1p(wanted.statistic**2 / (PEOPLE - 2))
    assert found.t**2 == pytest.approx(ratio, rel=1e-3)
    assert list(model.sd) == ["participant"]
    assert model.interaction_sd == 0.0


def test_ratings_of_groups_have_one_deviation_of_people_and_no_note_on_single_ratings(rows):
    model = rating_model(rows, ("group",))

    assert list(model.sd) == ["participant"]
    assert model.contrasts[0].df == pytest.approx(PEOPLE - 2)
    assert not any("has one rating" in note for note in model.warnings)


@pytest.mark.parametrize(
    ("seen", "df"),
    [
        (np.eye(2)[GROUP], PEOPLE - 2),
        (np.ones((PEOPLE, 2)), PEOPLE - 1),
        (np.array([[1.0, 0.0], [0.0, 1.0]]), 1.0),
    ],
    ids=["two groups", "all saw both", "one in each"],
)
def test_degrees_of_freedom_are_those_of_the_samples(seen, df):
    person, condition = np.nonzero(seen)
    crossed = CrossedDesign.of(condition, {"participant": person}, {"participant": 1.0})
    influence = np.where(condition == 0, 1.0, -1.0) / np.sum(seen, axis=0)[condition]
    effect = Effect(scene=False, group=person, level=person, times=None, sd=1.0)

    assert crossed.df(np.array([1.0, -1.0]), 1.0) == pytest.approx(df)
    assert between_df(influence, [effect], 1.0) == pytest.approx(df)


def test_thresholds_of_groups_have_one_deviation_of_people():
    rng = np.random.default_rng(5)
    table = pd.DataFrame(
        product(range(PEOPLE), range(1, 6), range(8)), columns=["participant", "x", "n"]
    )
    table["group"] = np.where(GROUP[table["participant"]], "expert", "novice")
    away = table["x"] - 3.0 - rng.normal(0.0, 1.0, PEOPLE)[table["participant"]]
    right = 0.5 + 0.48 * stats.norm.cdf(away / 0.6)
    model = fit_thresholds(
        table.assign(correct=(rng.random(len(table)) < right).astype(int)), "x", ("group",)
    )

    assert model.interaction_sd == 0.0
    assert model.participant_sd == pytest.approx(1.0, abs=0.6)
    assert model.contrasts[0].df == pytest.approx(PEOPLE - 2)


LEVELS = np.linspace(-1.5, 2.5, 5)
LAPSE = 0.02
TIGHT = {"xatol": 1e-5, "fatol": 1e-8, "maxiter": 4000}


def _curve(x):
    return 0.5 + (0.5 - LAPSE) * stats.norm.cdf(x)


def _two_groups(seed: int, scene_sd: float = 0.0) -> pd.DataFrame:
    """Sixteen people, a group each, who answer eight times at five levels."""
    rng = np.random.default_rng(seed)
    rows = pd.DataFrame(
        product(range(16), LEVELS, range(8)), columns=["participant", "level", "again"]
    )
    rows["scene"], rows["group"] = rows["again"] % 4, rows["participant"] % 2
    threshold = 0.4 + rng.normal(0.0, 0.6, 16)[rows["participant"]]
    threshold += rng.normal(0.0, scene_sd, 4)[rows["scene"]] if scene_sd else 0.0
    right = _curve((rows["level"] - threshold) / 0.75)
    return rows.assign(correct=(rng.random(len(rows)) < right).astype(int))


@pytest.mark.parametrize("seed", [100, 102])
def test_thresholds_of_two_groups_are_those_of_one_deviation_of_people(seed):
    """A quadrature of its own: the likelihood once had no maximum for two deviations."""
    rows = _two_groups(seed)
    model = fit_thresholds(rows, "level", ("group",), CurveForm(guess=0.5, lapse=LAPSE))
    cells = rows.pivot_table(index="participant", columns="level", values="correct", aggfunc="sum")
    right, nodes = cells.to_numpy(), np.linspace(-6.0, 6.0, 121)
    weight = stats.norm.pdf(nodes) * (nodes[1] - nodes[0])

    def loss(theta):
        middle = theta[np.arange(16) % 2, None] + theta[3] * nodes
        p = _curve((LEVELS - middle[..., None]) / np.exp(theta[2]))
        each = (right[:, None] * np.log(p) + (8 - right)[:, None] * np.log1p(-p)).sum(axis=-1)
        return -float(np.log(np.exp(each) @ weight).sum())

    best = optimize.minimize(loss, [0.2, 0.2, -0.3, 0.6], method="Nelder-Mead", options=TIGHT)
    assert model.log_likelihood == pytest.approx(-best.fun, abs=0.01)
    assert [one.value for one in model.thresholds] == pytest.approx(best.x[:2], abs=0.02)
    assert model.participant_sd == pytest.approx(abs(best.x[3]), rel=0.05)
    assert model.interaction_sd == 0.0


@pytest.mark.parametrize("scenes", [False, True])
def test_thresholds_of_two_groups_have_limits_with_fitted_lapses_and_scenes(scenes):
    for seed in range(100, 104):
        rows = _two_groups(seed, 0.3 * scenes)
        model = fit_thresholds(rows, "level", ("group",), CurveForm(guess=0.5), scenes=scenes)
        assert model.warnings == ()
        assert all(one.lower < one.value < one.upper for one in model.thresholds)
        assert model.contrasts[0].df < 15
