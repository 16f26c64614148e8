"""d' of one table, learning, order and side bias, reaction times."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from yes_no_table import of_table

from analysis.models.order_and_side import order_bias, side_bias
from analysis.models.reaction import reaction_times
from analysis.models.trends import trend


def test_d_prime_by_hand():
    """Half hits, 3 of 23 false alarms: z(.5) - z(3/23)."""
    found = of_table(10, 10, 3, 20)

    assert found.d_prime.value == pytest.approx(-stats.norm.ppf(3 / 23))
    assert found.criterion.value == pytest.approx(-0.5 * stats.norm.ppf(3 / 23))
    assert found.criterion.standard_error == pytest.approx(found.d_prime.standard_error / 2)


def test_the_correction_is_for_every_table_or_for_none():
    perfect = of_table(10, 0, 0, 10, "log-linear").d_prime
    corrected = of_table(9, 1, 1, 9, "log-linear").d_prime
    plain = of_table(9, 1, 1, 9).d_prime

    assert perfect.value == pytest.approx(2 * stats.norm.ppf(10.5 / 11))
    assert corrected.value < plain.value == pytest.approx(2 * stats.norm.ppf(0.9))
    with pytest.raises(ValueError, match="log-linear"):
        of_table(9, 1, 1, 9, "loglinear")


def sessions(rng, slopes, trials=60):
    rows = []
    for person, slope in enumerate(slopes):
        place = np.linspace(-0.5, 0.5, trials)
        share = np.clip(0.5 + slope * place, 0, 1)
        rows.append(
            pd.DataFrame(
                {
                    "participant": person,
                    "order": np.arange(1, trials + 1),
                    "y": (rng.random(trials) < share).astype(float),
                }
            )
        )
    return pd.concat(rows, ignore_index=True)


def test_a_straight_drift_is_measured_exactly():
    rows = pd.DataFrame(
        {
            "participant": np.repeat([1, 2], 5),
            "order": np.tile(np.arange(5), 2),
            "y": np.tile([0.0, 0.25, 0.5, 0.75, 1.0], 2),
        }
    )
    found = trend(rows, "y")

    assert found.change == pytest.approx(1.0)
    assert found.spearman_rho == pytest.approx(1.0)


def test_participants_who_all_learn_are_found(rng):
    found = trend(sessions(rng, np.full(11, 0.6)), "y")

    assert found.lower > 0
    assert found.p < 0.01
    assert found.lower < 0.6 < found.upper


def test_trends_that_vary_fool_the_pooled_correlation_and_not_the_default(rng):
    """No learning on average; each person drifts their own way."""
    pooled, between = [], []
    for _ in range(150):
        found = trend(sessions(rng, rng.normal(0, 0.6, 11)), "y")
        pooled.append(found.spearman_p < 0.05)
        between.append(found.p < 0.05)

    assert np.mean(pooled) > 0.15
    assert np.mean(between) < 0.10


def test_a_changing_mix_of_trials_is_no_learning():
    """Easy cells late: centring within cells leaves no trend."""
    rows = pd.DataFrame(
        {
            "participant": np.repeat([1, 2, 3], 8),
            "order": np.tile(np.arange(8), 3),
            "cell": np.tile([0] * 4 + [1] * 4, 3),
            "y": np.tile([0.2] * 4 + [0.9] * 4, 3),
        }
    )

    assert abs(trend(rows, "y", within=("cell",)).change) < 1e-12
    assert trend(rows, "y").change > 0.5


def test_learning_of_right_answers_is_found_within_conditions(rng):
    """Trials of a task as they are: the outcome is ``correct``, 0 and 1 or false and true."""
    rows = sessions(rng, np.full(11, 0.5)).rename(columns={"y": "correct"})
    rows["method"] = np.where(rows["order"] % 2, "ours", "blur")

    found = trend(rows.astype({"correct": bool}), "correct", within=("method",))

    assert found.outcome == "correct"
    assert found.lower > 0
    assert found.spearman_rho > 0
    assert found.p == trend(rows.astype({"correct": int}), "correct", within=("method",)).p


def test_constant_answers_and_single_participants_give_flagged_results(rng):
    constant = sessions(rng, np.zeros(4)).assign(y=1.0)
    alone = sessions(rng, [0.5])

    assert trend(constant, "y").p == 1.0
    assert "all values are equal, or too few" in trend(constant, "y").warnings[0]
    assert any("fewer than two" in note for note in trend(alone, "y").warnings)


def test_order_bias_is_recovered_and_clickers_are_named(make_decisions):
    rows = make_decisions(seed=3)
    fair = order_bias(rows)
    biased = rows.copy()
    biased.loc[biased["participant"] == "P03", "chose_first"] = 1

    assert fair.lower < 0.5 < fair.upper
    assert [name for name, _, _ in order_bias(biased).extreme] == ["P03"]
    assert "P03" in order_bias(biased).warnings[0]


def test_all_identical_answers_give_a_flagged_bias(make_decisions):
    rows = make_decisions().assign(chosen_side="left", chose_first=1)

    side = side_bias(rows)
    assert side is not None
    assert side.share == 1.0
    assert side.p == 2 / 2**11
    assert side.lower > 0.6
    assert len(side.extreme) == 11
    assert side_bias(rows.assign(chosen_side="")) is None


def test_reaction_times_by_hand():
    rows = pd.DataFrame(
        {"participant": ["a"] * 3 + ["b"] * 3, "size": "x", "rt_s": [1.0, 2.0, 60.0, 0.5, 0.5, 0.5]}
    )
    (found,) = reaction_times(rows, ("size",))

    assert found.mean_of_medians == pytest.approx(1.0)  # geometric mean of 2 and .5
    assert found.median == pytest.approx(0.75)
    assert found.lower < 1.0 < found.upper
    assert reaction_times(rows.assign(rt_s=np.nan)) == ()


def test_one_slow_answer_does_not_move_the_summary(make_decisions):
    rows = make_decisions()
    slow = rows.copy()
    slow.loc[0, "rt_s"] = 600.0

    before, after = reaction_times(rows)[0], reaction_times(slow)[0]
    assert after.mean_of_medians == pytest.approx(before.mean_of_medians, rel=0.01)
    assert after.trimmed_mean == pytest.approx(before.trimmed_mean, rel=0.01)
