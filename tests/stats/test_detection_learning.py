"""Detection, learning, order and side bias, reaction times."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.bias import order_bias, side_bias
from analysis.detection import detection, forced_choice_d_prime, sensitivity
from analysis.learning import trend
from analysis.reaction import reaction_times


def test_d_prime_by_hand():
    """Half hits, 3 of 23 false alarms: z(.5) - z(3/23)."""
    found = sensitivity(10, 10, 3, 20)

    assert found.d_prime == pytest.approx(-stats.norm.ppf(3 / 23))
    assert found.criterion == pytest.approx(-0.5 * stats.norm.ppf(3 / 23))
    assert not found.corrected


def test_perfect_rates_are_corrected_and_say_so():
    found = sensitivity(10, 0, 0, 10)

    assert found.corrected
    assert found.d_prime == pytest.approx(2 * stats.norm.ppf(10.5 / 11))


def test_forced_choice_d_prime_by_hand():
    d, error = forced_choice_d_prime(76, 100)

    assert d == pytest.approx(np.sqrt(2) * stats.norm.ppf(0.76))
    assert 0 < error < 0.3
    assert np.isfinite(forced_choice_d_prime(10, 10)[0])


def detection_study(rng, *, d_prime, criterion, people=10, scenes=7):
    rows = []
    for person in range(people):
        for scene in range(scenes):
            for k in range(12):
                signal = k % 2
                said = rng.normal(d_prime * (signal - 0.5)) > criterion
                rows.append(
                    {
                        "participant": person,
                        "scene": scene,
                        "method": "ours",
                        "inconsistent": signal,
                        "answered_inconsistent": int(said),
                    }
                )
            rows += [
                {
                    "participant": person,
                    "scene": scene,
                    "method": "reference",
                    "inconsistent": 0,
                    "answered_inconsistent": int(rng.random() < 0.15),
                }
                for _ in range(6)
            ]
    return pd.DataFrame(rows)


def test_d_prime_and_criterion_of_simulated_observers_are_recovered(rng):
    ours, reference = detection(
        detection_study(rng, d_prime=0.8, criterion=0.3), control=("reference",)
    )

    assert ours.d_lower < 0.8 < ours.d_upper
    assert ours.criterion == pytest.approx(0.3, abs=0.12)
    assert ours.hits + ours.misses == 420
    assert reference.pooled is None
    assert reference.correct.share == pytest.approx(0.85, abs=0.05)


def test_observers_who_cannot_tell_show_bias_without_correctness(rng):
    """[BB] Fig. 20: correct at chance, "consistent" said far more often than not."""
    ours, _ = detection(detection_study(rng, d_prime=0.0, criterion=0.6), control=("reference",))

    assert ours.correct.lower < 0.5 < ours.correct.upper
    assert ours.bias.lower > 0.6
    assert ours.bias.exact_p < 1e-6


def test_correct_and_bias_shares_are_what_counting_gives():
    rows = pd.DataFrame(
        {
            "participant": [0, 0, 1, 1],
            "scene": [0, 1, 0, 1],
            "method": "x",
            "inconsistent": [1, 0, 1, 0],
            "answered_inconsistent": [1, 0, 0, 0],
        }
    )
    (found,) = detection(rows)

    assert (found.correct.count, found.bias.count) == (3, 3)


def test_detection_needs_its_columns_and_plain_answers():
    with pytest.raises(ValueError, match=r"missing \['scene'"):
        detection(pd.DataFrame({"participant": [1]}))
    rows = pd.DataFrame(
        {
            "participant": [1],
            "scene": [1],
            "method": ["x"],
            "inconsistent": [2],
            "answered_inconsistent": [0],
        }
    )
    with pytest.raises(ValueError, match="0 and 1"):
        detection(rows)


def sittings(rng, slopes, trials=60):
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
    found = trend(sittings(rng, np.full(11, 0.6)), "y")

    assert found.lower > 0
    assert found.p < 0.01
    assert found.lower < 0.6 < found.upper


def test_trends_that_vary_fool_the_pooled_correlation_and_not_the_default(rng):
    """No learning on average; each person drifts their own way."""
    pooled, between = [], []
    for _ in range(150):
        found = trend(sittings(rng, rng.normal(0, 0.6, 11)), "y")
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


def test_constant_answers_and_single_participants_give_flagged_results(rng):
    constant = sittings(rng, np.zeros(4)).assign(y=1.0)
    alone = sittings(rng, [0.5])

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
