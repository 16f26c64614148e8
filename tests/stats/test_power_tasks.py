"""Power by simulating the task itself, and the made-up studies it is simulated with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.detection import yes_no
from analysis.ideal_observer import abx_share
from analysis.power_tasks import power_of_task
from analysis.rates import correct_rates, rate_contrasts
from analysis.simulated_tasks import (
    TaskDesign,
    simulate_abx,
    simulate_identification,
    simulate_yes_no,
)

COLUMNS = {"participant", "scene", "method", "order", "expected", "answer", "correct", "rt_s"}


def d_prime_p(trials):
    return yes_no(trials, ("method",), signal="inconsistent").d_prime_contrasts[0].p


def yes_no_study(effect):
    return lambda design, rng: simulate_yes_no(design, {"blur": 0.5 + effect, "ours": 0.5}, rng)


def test_power_rises_with_participants_and_an_absent_effect_keeps_the_level(rng, proof_count):
    studies = proof_count(500)
    designs = [TaskDesign(people, 6, 2) for people in (6, 12, 30)]
    effect = power_of_task(yes_no_study(1.0), d_prime_p, designs, rng=rng, studies=studies)
    nothing = power_of_task(yes_no_study(0.0), d_prime_p, designs[1:2], rng=rng, studies=studies)

    assert effect.power[0] < effect.power[2]
    assert effect.power[2] > 0.8
    assert effect.needed[0][0] == 0.8
    assert effect.needed[0][1] in (12, 30)
    assert nothing.power[0] <= 0.06 + 3.5 * np.sqrt(0.05 * 0.95 / studies)
    assert effect.standard_error(0.5) == pytest.approx(0.5 / np.sqrt(studies))


def test_power_of_a_test_against_chance_is_that_of_the_binomial_where_nobody_differs(rng):
    """One trial each: participants are independent trials. By hand, 40 people at .7."""

    def simulate(design, rng):
        # The rise is .4 (a width of 3.29 is a deviation of 1): .5 + .5 x .4 = .7.
        return simulate_identification(
            design, {"m": -stats.norm.ppf(0.4)}, rng, levels=[0.0], width=2 * 1.6448536, lapse=0.0
        )

    found = power_of_task(
        simulate,
        lambda trials: correct_rates(trials, chance=0.5)[0].p,
        [TaskDesign(40)],
        rng=rng,
        studies=400,
    )
    count = np.arange(41)
    ratio = np.abs(count / 40 - 0.5) / np.sqrt(0.25 / 39)  # 40 people
    rejected = 2 * stats.t.sf(ratio, 39) < 0.05
    by_hand = stats.binom.pmf(count, 40, 0.7)[rejected].sum()

    assert found.power[0] == pytest.approx(by_hand, abs=4 * np.sqrt(0.25 / 400))


def test_studies_without_answer_count_as_not_significant_and_are_said(rng):
    def analyse(_trials):
        if rng.random() < 0.5:
            raise ValueError("no answer")
        return 0.0

    found = power_of_task(
        yes_no_study(1.0), analyse, [TaskDesign(2)], rng=np.random.default_rng(1), studies=100
    )

    assert found.power[0] + found.undecided[0] == pytest.approx(1.0)
    assert 0.3 < found.undecided[0] < 0.7
    assert "gave no p" in found.warnings[0]
    told = []
    power_of_task(
        yes_no_study(1.0),
        lambda _trials: 1.0,
        [TaskDesign(2)],
        rng=rng,
        studies=3,
        progress=lambda done, of: told.append((done, of)),
    )
    assert told == [(1, 3), (2, 3), (3, 3)]
    with pytest.raises(ValueError, match="a design and a study"):
        power_of_task(yes_no_study(1.0), d_prime_p, [], rng=rng)


def test_scenes_and_repeats_can_be_planned_too(rng):
    designs = [TaskDesign(8, 2, 1), TaskDesign(8, 12, 2)]
    found = power_of_task(yes_no_study(1.2), d_prime_p, designs, rng=rng, studies=40)

    assert found.power[1] > found.power[0]
    assert found.needed == ()


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
    share = 0.98 * abx_share(4 * np.sqrt(0.75)) + 0.01
    assert two["correct"].mean() == pytest.approx(float(share), abs=0.01)


def test_what_conditions_share_does_not_blur_their_difference(rng):
    """All variance common: people's ability falls out of the comparison."""
    design = TaskDesign(10, 6, 40)
    spread = {"d_prime_sd": (1.0, 0.0), "criterion_sd": (0.0, 0.0)}
    errors = [
        rate_contrasts(
            simulate_yes_no(design, {"a": 1.0, "b": 1.0}, rng, common=common, **spread),
            ("method",),
        )[0].standard_error
        for common in (0.0, 1.0)
    ]

    assert errors[0] > 2 * errors[1]
