"""Groups of people, or of scenes, that saw one condition each are samples of their own."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.models.contrasts import CrossedDesign, Effect, between_df
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
    model = time_model(rows, ("group",))
    (found,) = model.ratios
    means = np.log(rows["rt_s"]).groupby([rows["group"], rows["participant"]]).mean()
    wanted = stats.ttest_ind(means["expert"], means["novice"])

    assert found.df == pytest.approx(PEOPLE - 2)
    assert found.p == pytest.approx(wanted.pvalue, rel=1e-4)
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
