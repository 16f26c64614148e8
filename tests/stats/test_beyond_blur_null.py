"""With nothing to find in Beyond Blur's studies, the planned tests find something in .05 of them.

People and scenes differ, as they do; every method is alike. The papers' pooled tests are reported
beside these, under that name, and decide nothing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.detection import yes_no
from analysis.tasks import analysis_of
from analysis.tasks.detection import judge_bias
from analysis.tasks.preference.power import Assumptions, _batch
from analysis.tasks.rates.power import _events, cell_design
from protocols.load import load_study

BAND = (0.035, 0.065)
MANY = 8000
"""Of 2,000 studies a share of .05 has an error of .005: the least of 13 is luck then."""
PEOPLE = {"beyond-blur-task": 14, "beyond-blur-preference": 10, "beyond-blur-detection": 10}
NOTHING = {"difference": 0.0, "participant_sd": 0.4, "scene_sd": 0.2}


def p_values_of_rates(name: str, studies: int, rng: np.random.Generator, **more: float):
    """p of each planned comparison, not corrected, shape (studies, comparisons)."""
    study, _ = load_study(Path(name), None)
    analysis = analysis_of(study.analysis.kind)
    settings = analysis.settings(study)
    design = cell_design(study.task.cells(study.pool), settings, study.design.repeats)
    draw, judge, people = analysis.draw(settings), analysis.judge(), PEOPLE[name]
    assumed = {"d_prime": 1.22, **NOTHING, **more}
    return np.array(
        [
            judge(_events(design, assumed, people, draw, rng), design, (people,), settings)[0]
            for _ in range(studies)
        ]
    )


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
    p = p_values_of_rates("beyond-blur-task", studies, rng, slope=1.6)
    assert p.shape == (studies, 5)
    check_level(p, studies)


def test_detection_keeps_its_level(rng, full):
    studies = MANY if full else 200
    p = p_values_of_rates(
        "beyond-blur-detection", studies, rng, d_prime=0.5, criterion=0.0, criterion_sd=0.4
    )
    assert p.shape == (studies, 2)  # the reference never is inconsistent, and has no d'
    check_level(p, studies)


def test_preference_keeps_its_level(rng, full):
    studies = 5 * MANY if full else 200  # cheap, and near the band's edge
    study, _ = load_study(Path("beyond-blur-preference"), None)
    settings = analysis_of("preference").settings(study)
    picks = np.array([PEOPLE["beyond-blur-preference"] - 1])
    p, primary, _ = _batch(settings, Assumptions(0.5), studies, picks, rng)
    assert p.shape == (studies, 1, 6)
    check_level(np.column_stack([p[:, 0], primary[:, 0]]), studies)


# --- power -------------------------------------------------------------------------------


def power_of(name: str, rng: np.random.Generator, studies: int = 100, **assumed: float):
    study, _ = load_study(Path(name), None)
    analysis = analysis_of(study.analysis.kind)
    values = {one.name: one.value for one in analysis.assumptions(study)} | assumed
    return analysis.power(study, values, rng=rng, studies=studies)


@pytest.mark.slow
def test_power_of_each_condition_follows_its_own_difference(rng):
    found = power_of(
        "beyond-blur-task", rng, **{"difference": 0.0, "difference.blur-140": -1.5, "d_prime": 2.0}
    )
    assert found.columns[:6] == (
        "participants", "Blur 0.35", "Blur 0.70", "Blur 1.05", "Blur 1.40", "Ours",
    )  # fmt: skip
    planned = next(row for row in found.rows if "planned" in row[0])
    assert float(planned[4]) > 0.9
    assert max(float(planned[k]) for k in (1, 2, 3, 5)) < 0.2


@pytest.mark.slow
def test_power_of_detection_leaves_the_reference_out_which_holds_no_signal(rng):
    found = power_of("beyond-blur-detection", rng, difference=3.0, d_prime=0.5)
    assert found.result.comparisons == 2  # blur and F&S against ours
    assert float(next(row for row in found.rows if "planned" in row[0])[1]) > 0.9


@pytest.mark.slow
def test_power_of_bias_follows_the_criterion_and_not_sensitivity(rng):
    """[BB] Fig. 20, right: methods that are called inconsistent more often than `ours`."""
    same = {"d_prime": 0.5, "difference": 0.0, "studies": 50}
    found = power_of("beyond-blur-detection", rng, **same, criterion_difference=-1.2)
    planned = found.result.participants.index(10)
    assert found.result.also["bias: every comparison"][planned] > 0.9
    assert found.result.each[planned] < 0.2
    assert "bias: a comparison" in found.columns
    assert any(one.startswith("bias: a comparison, power 80%") for one in found.needed)

    none = power_of("beyond-blur-detection", rng, **same, criterion_difference=0.0)
    assert none.result.also["bias: a comparison"].max() < 0.2
    assert none.result.also["bias: false positives"].max() < 0.2
    one = power_of(
        "beyond-blur-detection", rng, **same,
        **{"criterion_difference": 0.0, "criterion.blur": -1.5},
    )  # fmt: skip
    assert one.result.also["bias: a comparison"][planned] == pytest.approx(0.5, abs=0.15)
    assert one.result.also["bias: every comparison"][planned] < 0.2


def test_bias_is_judged_as_the_report_judges_it(rng):
    """The same answers, as a table to the report's analysis and as counts to the simulation."""
    study, _ = load_study(Path("beyond-blur-detection"), None)
    analysis = analysis_of("detection")
    settings = analysis.settings(study)
    design = cell_design(study.task.cells(study.pool), settings, 1)
    assumed = {"d_prime": 0.5, **NOTHING, "criterion_difference": -0.5, "criterion_sd": 0.4}
    events = _events(design, assumed, 10, analysis.draw(settings), rng)
    rows = [
        {
            "participant": f"P{person}", "scene": str(design.scene[cell]),
            "condition": design.conditions[design.condition[cell]],
            "expected": "yes" if design.signal[cell] else "no",
            "answer": "yes" if events[person, cell] else "no",
        }
        for person in range(10) for cell in range(events.shape[1])
    ]  # fmt: skip
    reported = yes_no(pd.DataFrame(rows), ("condition",), signal="yes", reference="ours")
    named = {one.first: one.p for one in reported.bias_contrasts}

    p = judge_bias(events, design, (10,), settings)[0]
    wanted = [named[name] for name in design.conditions[1:]]
    np.testing.assert_allclose(p, wanted, rtol=1e-9)
