"""The made-up studies that tests of the statistics analyse are those that they ask for."""

import numpy as np
import pytest
from made_up_trials import TaskDesign, simulate_abx, simulate_identification, simulate_yes_no

from analysis.models.right_answers import rate_contrasts
from protocols.answer_rules import answer_rule

COLUMNS = {"participant", "scene", "method", "order", "expected", "answer", "correct", "rt_s"}


def test_a_design_without_trials_is_refused():
    with pytest.raises(ValueError, match="at least 1"):
        TaskDesign(5, 0)


def simulated(rng):
    design = TaskDesign(3, 2, 4)
    return {
        "yes-no": simulate_yes_no(design, {"a": 1.0, "b": 0.0}, rng),
        "identification": simulate_identification(
            design, {"a": 0.0}, rng, levels=[0.0, 1.0], width=2.0, alternatives=4
        ),
        "abx": simulate_abx(design, {"a": 0.2}, rng, scalings=[0.1, 0.4]),
    }


@pytest.mark.parametrize("task", ["yes-no", "identification", "abx"])
def test_simulated_tables_have_every_column_and_agree_with_themselves(rng, task):
    table = simulated(rng)[task]

    assert set(table.columns) >= COLUMNS
    assert len(table) == 3 * 2 * 4 * (4 if task == "yes-no" else 2)
    assert ((table["expected"] == table["answer"]) == (table["correct"] == 1)).all()
    for _, part in table.groupby("participant"):
        assert list(part["order"]) == list(range(1, len(part) + 1))
    assert (table["rt_s"] > 0).all()


def test_simulated_shares_are_those_of_the_observers(rng):
    design = TaskDesign(1, 1, 40_000)
    one = simulate_identification(
        design, {"a": 0.0}, rng, levels=[1.0], width=2.0, alternatives=4, lapse=0.04
    )
    rise = 0.25 + 0.71 * 0.95
    assert one["correct"].mean() == pytest.approx(rise, abs=0.01)
    assert set(one["answer"]) == set("ABCD")

    two = simulate_abx(
        design, {"a": 0.2}, rng, scalings=[0.4], critical_sd=0.0, gain_sd=0.0, interaction_sd=0.0
    )
    share = 0.98 * answer_rule("differencing").share(4 * np.sqrt(0.75)) + 0.01
    assert two["correct"].mean() == pytest.approx(float(share), abs=0.01)


def test_what_conditions_share_does_not_blur_their_difference(rng):
    """All variance common: people's ability falls out of the comparison."""
    design = TaskDesign(10, 6, 40)
    spread = {"d_prime_sd": (1.0, 0.0), "criterion_sd": (0.0, 0.0)}
    errors = [
        rate_contrasts(
            simulate_yes_no(design, {"a": 1.0, "b": 1.0}, rng, common=common, **spread), ("method",)
        )[0].standard_error
        for common in (0.0, 1.0)
    ]

    assert errors[0] > 2 * errors[1]
