"""Of many conditions each is compared with one and with the mean of all, in little time."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from command_line import result_of

from analysis.models.contrasts import MEAN, MOST_IN_PAIRS, pairs_of
from analysis.models.mixed import reaction_model
from analysis.models.ordinal import rating_model
from analysis.models.right_answers import correct_rates, rate_contrasts
from analysis.parts.shared import many_told

run = result_of("analysis", env={"COLUMNS": "200"})
MANY = [f"c{k}" for k in range(MOST_IN_PAIRS + 1)]


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(3)
    cells = [(f"P{who}", name, k) for who in range(6) for k, name in enumerate(MANY)] * 2
    frame = pd.DataFrame(cells, columns=["participant", "method", "place"])
    latent = 0.2 * frame.pop("place") + rng.normal(size=len(frame))
    return frame.assign(
        correct=(latent > 0.3).astype(int),
        rating=np.digitize(latent, [0.0, 1.0, 2.0]) + 1,
        rt_s=np.exp(0.3 * latent),
    )


def test_more_than_eight_are_not_compared_in_pairs():
    assert len(pairs_of(MANY[:-1], None)) == 8 * 7 / 2
    assert pairs_of(MANY[:-1], "c1") == [(name, "c1") for name in MANY[:-1] if name != "c1"]
    for given, reference in ((None, "c0"), ("c1", "c1")):
        own = [(name, reference) for name in MANY if name != reference]
        assert pairs_of(MANY, given) == own + [(name, MEAN) for name in MANY]


def test_a_condition_against_the_mean_is_its_surplus(rows):
    every = sorted(rate_contrasts(rows, ["method"]), key=lambda one: one.first)
    said = many_told(every, SimpleNamespace(label=str))
    assert said.endswith(f"compared with c0 and {MEAN}, and no other.")
    found = [one for one in every if one.second == MEAN]
    share = np.array([one.share for one in correct_rates(rows, ["method"], chance=0.5)])

    assert [one.difference for one in found] == pytest.approx(list(share - share.mean()))
    assert sum(one.difference for one in found) == pytest.approx(0.0, abs=1e-12)


def test_no_model_is_fitted_for_each_of_many_comparisons(rows, monkeypatch):
    monkeypatch.setattr(reaction_model._HeldGap, "at", lambda *_: pytest.fail("a comparison's fit"))
    times = reaction_model.time_model(rows, ["method"])
    middle = np.exp(np.mean(times.beta))

    for one, own in zip(times.ratios[len(MANY) - 1 :], times.times, strict=True):
        assert one.ratio == pytest.approx(own.median_s / middle)
        assert (one.p < 0.05) == (one.lower > 1.0 or one.upper < 1.0)
    rated = rating_model(rows, ["method"])
    assert len(rated.contrasts) == 2 * len(MANY) - 1
    for one in rated.contrasts:
        assert (one.p < 0.05) == (one.lower * one.upper > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["ratings", "reaction"])
def test_the_table_says_what_is_compared(command, rows, tmp_path):
    rows.to_csv(tmp_path / "rows.csv", index=False)
    said = " ".join(run(command, tmp_path / "rows.csv", "--by", "method").output.split())

    assert f"Of more than 8 conditions each is compared with c0 and {MEAN}" in said
