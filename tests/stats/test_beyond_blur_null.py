"""With nothing to find in Beyond Blur's studies, the planned tests find something in .05 of them.

People and scenes differ, as they do; every method is alike. The papers' pooled tests are reported
beside these, under that name, and decide nothing.
"""

from pathlib import Path

import numpy as np
import pytest

from analysis.models.detection import yes_no
from analysis.power import power
from analysis.tasks import analysis_of
from protocols.load import load_study

BAND = (0.035, 0.065)
MANY = 8000
"""Of 2,000 studies a share of .05 has an error of .005: the least of 13 is luck then."""
PEOPLE = {"beyond-blur-task": 14, "beyond-blur-preference": 10, "beyond-blur-detection": 10}


def p_values(name: str, studies: int, rng: np.random.Generator, test: str = "", **more: float):
    """p of each comparison of a test, not corrected, shape (studies, comparisons)."""
    study, _ = load_study(Path(name), None)
    simulation = analysis_of(study.analysis.kind).simulation(study)
    simulation.plan = simulation.plan.but(correction="none")
    assumed = {one.name: one.value for one in simulation.assumptions if not np.isnan(one.value)}
    nothing = simulation.nothing(assumed) | more
    found = []
    for _ in range(0, studies, simulation.at_once):
        answers = simulation.draw(nothing, simulation.at_once, PEOPLE[name], rng)
        tests = {}
        for part in simulation.parts:
            tests |= part.planned_over(answers, (PEOPLE[name],), simulation.plan)
        found.append(tests[test]()[:, 0])
    return np.concatenate(found)[:studies]


@pytest.mark.parametrize("name", PEOPLE)
def test_the_planned_test_respects_participants_and_scenes(name):
    study, _ = load_study(Path(name), None)
    assert study.analysis.test == "participant-scene"
    said = " ".join(study.analysis.plain_sentences(study.task, study.pool))
    assert "respecting variation of participants and of scenes" in said


def check_level(p: np.ndarray, studies: int) -> None:
    """Every comparison keeps the level; few studies have room for their own error."""
    slack = 0 if studies >= MANY else 3.5 * np.sqrt(0.05 * 0.95 / studies)
    found = (p < 0.05).mean(axis=0)
    assert np.all(found > BAND[0] - slack), found
    assert np.all(found < BAND[1] + slack), found


def test_task_performance_keeps_its_level(rng, full):
    studies = MANY if full else 200
    p = p_values("beyond-blur-task", studies, rng, d_prime=1.22, slope=1.6)
    assert p.shape == (studies, 5)
    check_level(p, studies)


def test_detection_keeps_its_level(rng, full):
    studies = MANY if full else 200
    p = p_values("beyond-blur-detection", studies, rng, d_prime=0.5)
    assert p.shape == (studies, 2)  # the reference never is inconsistent, and has no d'
    check_level(p, studies)


def test_preference_keeps_its_level(rng, full):
    studies = 5 * MANY if full else 200  # cheap, and near the band's edge
    p = p_values("beyond-blur-preference", studies, rng)
    assert p.shape == (studies, 6)
    primary = p_values("beyond-blur-preference", studies, rng, "primary")
    check_level(np.column_stack([p, primary]), studies)


# --- power -------------------------------------------------------------------------------


def power_of(name: str, rng: np.random.Generator, studies: int = 100, **assumed: float):
    study, _ = load_study(Path(name), None)
    simulation = analysis_of(study.analysis.kind).simulation(study)
    return power(simulation, assumed, rng=rng, studies=studies)


@pytest.mark.slow
def test_power_of_each_condition_follows_its_own_difference(rng):
    found = power_of(
        "beyond-blur-task", rng, **{"difference": 0.0, "difference.blur-140": -1.5, "d_prime": 2.0}
    )
    assert list(found.curves)[:5] == ["Blur 0.35", "Blur 0.70", "Blur 1.05", "Blur 1.40", "Ours"]
    planned = next(row for row in found.rows() if "planned" in row["participants"])
    assert float(planned.pop("Blur 1.40")) > 0.9
    assert max(float(planned[k]) for k in ("Blur 0.35", "Blur 0.70", "Blur 1.05", "Ours")) < 0.2


@pytest.mark.slow
def test_power_of_detection_leaves_the_reference_out_which_holds_no_signal(rng):
    found = power_of("beyond-blur-detection", rng, difference=3.0, d_prime=0.5)
    assert found.numbers["comparisons"] == 2  # blur and F&S against ours
    assert found.numbers["each"][found.participants.index(10)] > 0.9


@pytest.mark.slow
def test_power_of_bias_follows_the_criterion_and_not_sensitivity(rng):
    """[BB] Fig. 20, right: methods that are called inconsistent more often than `ours`."""
    same = {"d_prime": 0.5, "difference": 0.0, "studies": 50}
    found = power_of("beyond-blur-detection", rng, **same, criterion_difference=-1.2)
    planned = found.participants.index(10)
    assert found.curves["bias: every comparison"][planned] > 0.9
    assert found.numbers["each"][planned] < 0.2
    assert any(one.startswith("bias: a comparison, power 80%") for one in found.needs())

    none = power_of("beyond-blur-detection", rng, **same, criterion_difference=0.0)
    assert none.curves["bias: a comparison"].max() < 0.2
    assert none.wrong["bias: false positives"].max() < 0.2
    one = power_of(
        "beyond-blur-detection", rng, **same,
        **{"criterion_difference": 0.0, "criterion.blur": -1.5},
    )  # fmt: skip
    assert one.curves["bias: a comparison"][planned] == pytest.approx(0.5, abs=0.15)
    assert one.curves["bias: every comparison"][planned] < 0.2


def test_bias_is_judged_as_the_report_judges_it(rng):
    """The same answers, as a table to the report's analysis and as counts to the simulation."""
    study, _ = load_study(Path("beyond-blur-detection"), None)
    simulation = analysis_of("detection").simulation(study)
    assumed = {one.name: one.value for one in simulation.assumptions if not np.isnan(one.value)}
    answers = simulation.draw(assumed, 1, 10, rng)
    rows = simulation.table(answers)
    reported = yes_no(rows, ("condition",), signal=simulation.plan.answers[0], reference="ours")
    named = {one.first: one.p for one in reported.bias_contrasts}

    sensitivity = simulation.parts[1]
    simulation.plan = simulation.plan.but(correction="none")
    p = sensitivity.planned_over(answers, (10,), simulation.plan)["bias"]()[0, 0]
    # The reference never holds the signal: it has no d', and its bias is not simulated.
    wanted = [named[name] for name in simulation.names[1:] if name != "reference"]
    np.testing.assert_allclose(p, wanted, rtol=1e-9)
