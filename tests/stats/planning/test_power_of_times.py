"""Reaction times have a planned test of their own, whose power is simulated."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.models.mixed.reaction_model import time_model
from analysis.parts.times import TimesPart
from analysis.pilot import time_deviations
from analysis.power import power
from analysis.tasks import analysis_of
from protocols.load import load_protocol
from protocols.study_file.preregister import _analysis, _power


def study_of(name: str, reaction: str = "models"):
    study = load_protocol(Path(name))
    changed = study.analysis.model_copy(update={"reaction": reaction})
    return study.model_copy(update={"analysis": changed})


def simulation_of(name: str, reaction: str = "models"):
    study = study_of(name, reaction)
    return analysis_of(study.analysis.kind).simulation(study)


def assumed_of(simulation) -> dict[str, float]:
    return {one.name: one.value for one in simulation.assumptions if not np.isnan(one.value)}


@pytest.mark.parametrize("name", ["demo", "beyond-blur-detection"])
def test_power_of_times_is_that_of_differences_and_alpha_without(name, rng):
    simulation = simulation_of(name)
    assumed = {"rt_ratio": 1.6, "rt_scene_sd": 0.0}
    found = power(simulation, assumed, rng=rng, studies=200, participants=(4, 16))
    several = len(simulation.names) > 2
    curve = found.curves["times: a comparison" if several else "times"]
    assert curve[0] < curve[1]
    assert curve[1] > 0.9
    assert found.wrong["times: false positives"][1] < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 200)
    assert any("reaction times are compared" in note for note in found.warnings)
    told = _power({**found.numbers, "planned": 16})
    assert f"{curve[1]:.2f} for reaction times" in told
    assert "false positives" not in told


def test_times_that_are_not_tested_are_not_drawn(rng):
    simulation = simulation_of("demo", "summary")
    assert not any(one.name.startswith("rt_") for one in simulation.assumptions)
    assert simulation.drawn(assumed_of(simulation), 1, 2, rng).times is None


def test_answers_are_the_same_whether_times_are_drawn_or_not():
    given = [
        one.drawn(assumed_of(one), 2, 4, np.random.default_rng(5)).given
        for one in (simulation_of("beyond-blur-detection", how) for how in ("summary", "models"))
    ]
    np.testing.assert_array_equal(*given)


def test_p_of_simulated_times_ranks_studies_as_the_model_of_their_tables_does(rng):
    """With two scenes the closed form is somewhat bolder, as `power` says of so few."""
    simulation = simulation_of("demo")
    answers = simulation.drawn(assumed_of(simulation), 5, 9, rng)
    fast = TimesPart().planned_over(answers, (9,), simulation.plan)["times"]()[:, 0, 0]
    model = [
        time_model(simulation.table(answers.of(study, 9)), simulation.plan.compared).ratios[0].p
        for study in range(5)
    ]
    np.testing.assert_array_equal(np.argsort(fast), np.argsort(model))


def test_deviations_of_times_are_those_of_a_pilot(rng):
    simulation = simulation_of("demo")
    sds = {"rt_participant_sd": 0.5, "rt_scene_sd": 0.0, "rt_sd": 0.3}
    table = simulation.table(simulation.drawn(assumed_of(simulation) | sds, 1, 20, rng))
    values, notes = time_deviations(({"scene_sd": 0.1}, ()), table, simulation.plan)
    assert values["rt_participant_sd"] == pytest.approx(0.5, rel=0.4)
    assert values["rt_sd"] == pytest.approx(0.3, rel=0.1)
    assert values["scene_sd"] == 0.1
    assert notes == ()
    rows = pd.DataFrame(table).drop(columns="rt_s")
    values, notes = time_deviations(({}, ()), rows, simulation.plan)
    assert values == {}
    assert "it holds none" in notes[0]


def test_a_preregistration_says_that_times_are_tested():
    said = _analysis(study_of("demo")).blocks[0][-1]
    assert "Reaction times are a question of their own" in said
    assert "alpha = 0.05, Holm-adjusted" in said
    assert not any("Reaction" in one for one in _analysis(study_of("demo", "summary")).blocks[0])
