"""Simulated observers get their thresholds and scores back."""

import json

import numpy as np
import pytest
from adaptive_recovery import (
    OBSERVERS,
    QUEST_TRIALS,
    UP_DOWN_TRIALS,
    Recovery,
    observers,
    pair_recoveries,
    quest_grid,
    recovery,
    run_quest,
    run_up_down,
    up_down_rules,
)
from up_down_rules import performance


def found(rule: str, count: int) -> Recovery:
    """Run one rule of the benchmark with the first observers of the benchmark."""
    if rule.startswith("QUEST+"):
        yes_no = rule.endswith("yes-no")
        people = observers(count, QUEST_TRIALS, 0.1 if yes_no else 0.5, seed=21)
        ours = run_quest(people, quest_grid(yes_no=yes_no))
        return recovery(people.threshold, ours)
    settings = up_down_rules()[rule.removeprefix("up-down, ")]
    people = observers(count, UP_DOWN_TRIALS, 0.5, seed=22)
    truth = people.level_at(performance(settings))
    return recovery(truth, run_up_down(people, settings))


RULES = [
    "QUEST+, two alternatives",
    "QUEST+, yes-no",
    *(f"up-down, {name}" for name in up_down_rules()),
]


@pytest.mark.slow
@pytest.mark.parametrize("rule", RULES)
def test_thresholds_of_simulated_observers_are_recovered(rule, proof_count, repository):
    """Bias below a tenth of the function's spread, SD at most 1.15 times the package's.

    A tenth of the observers knows its bias to a tenth of its SD, so it may be as much larger.
    """
    count = proof_count(OBSERVERS)

    got = found(rule, count)

    assert got.lost == 0
    slack = 0.0 if count == OBSERVERS else 2.0 * got.sd / np.sqrt(count)
    assert abs(got.bias) < 0.1 + slack
    file = repository / "benchmarks/results/adaptive.json"
    if not file.is_file():
        pytest.skip("needs benchmarks/results for the packages' SD, which an archive leaves out")
    rows = json.loads(file.read_text(encoding="utf-8"))["recovery"]
    recorded = next(row for row in rows if row["rule"] == rule)
    if recorded["package_sd"] is not None:
        assert got.sd <= 1.15 * recorded["package_sd"] * (1.0 if count == OBSERVERS else 1.15)
    if count == OBSERVERS:
        assert got.bias == pytest.approx(recorded["bias"], abs=1e-6)
        assert got.sd == pytest.approx(recorded["sd"], abs=1e-6)


def test_active_pairs_rank_conditions_better_than_random_ones(proof_count):
    """On a scale of 8 JOD, where most pairs are settled before they are shown."""
    rows = pair_recoveries(proof_count(100), range_jod=8.0)

    assert rows["ours"].rmse_10 < rows["chance"].rmse_10
    assert rows["ours"].rmse_15 < rows["chance"].rmse_15
    assert rows["ours"].rank_15 > 0.9
