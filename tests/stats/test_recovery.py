"""Simulated observers with a known preference, through journals and report, are recovered."""

import json
import re

import numpy as np
import pytest
from scipy.special import expit
from undrawn_reports import undrawn

from analysis.report.write_report import report_sessions
from protocols.load import load_display, load_protocol, shipped
from study_app.gaze.simulated import STEADY
from study_app.observers import PreferenceModel
from study_app.simulate import SimulatedStudy, simulate_study

pytestmark = pytest.mark.slow

UTILITIES = {"reference": 2.0, "metameric": 1.2, "push-pull": 0.0}
PARTICIPANT_SD, SCENE_SD, LAPSE = 0.5, 0.3, 0.02


def true_share(method: str, against: str) -> float:
    """The population's share: the observers' own formula, averaged over people and scenes."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(61)
    gap = UTILITIES[method] - UTILITIES[against]
    spread = np.hypot(PARTICIPANT_SD, SCENE_SD)
    mean = weights @ expit(gap + spread * nodes) / weights.sum()
    return float(LAPSE / 2 + (1 - LAPSE) * mean)


@pytest.fixture(scope="module")
def numbers(tmp_path_factory) -> dict[str, object]:
    """Results of the shipped study with its own eleven participants, and short clips: who answers
    by a formula need not look for long."""
    folder = tmp_path_factory.mktemp("recovery")
    text = shipped("studies")["inpainting-2afc"].read_text(encoding="utf-8")
    text, count = re.subn(
        r"^(duration_s|gap_s|fixation_s|iti_s) = .*$", r"\1 = 0.1", text, flags=re.M
    )
    assert count == 4
    (folder / "study.toml").write_text(text, encoding="utf-8")
    protocol = load_protocol(folder / "study.toml")
    simulation = SimulatedStudy(
        protocol,
        load_display(protocol.display.display),
        seed=7,
        gaze=STEADY,
        gaze_rate_hz=50.0,
        model=PreferenceModel(
            utilities=UTILITIES, participant_sd=PARTICIPANT_SD, scene_sd=SCENE_SD, lapse=LAPSE
        ),
    )
    simulate_study(simulation, folder / "s", protocol.study.participants)
    with undrawn():
        made = report_sessions(folder / "s", protocol, folder / "r", figure_files="none")
    loaded: dict[str, object] = json.loads(made.json.read_text())
    return loaded


def test_the_study_is_the_papers(numbers):
    assert numbers["simulated"] is True
    cells = numbers["results"]["preferences"]["table"]["cells"]
    assert [cell["trials"] for cell in cells] == [132] * 6
    assert {cell["participants"] for cell in cells} == {11}


def test_known_shares_lie_within_their_limits(numbers):
    """Six limits at 95 %: all six cover in three of four studies, five nearly always."""
    hits = [
        cell["lower"] <= true_share(cell["method"], cell["against"]) <= cell["upper"]
        for cell in numbers["results"]["preferences"]["table"]["cells"]
    ]

    assert sum(hits) >= 5
    primary = numbers["results"]["preferences"]["primary"]
    assert primary["lower"] <= true_share("metameric", "push-pull") <= primary["upper"]
    assert primary["verdict"] == "preferred"


def test_known_distances_lie_within_the_scales_limits(numbers):
    for one in numbers["results"]["scale"]["sizes"]:
        order = sorted(UTILITIES, key=UTILITIES.__getitem__)
        scores = dict(zip(one["scale"]["conditions"], one["scale"]["scores"], strict=True))
        assert sorted(scores, key=scores.__getitem__) == order


def test_no_bias_and_no_learning_is_found_where_none_was_simulated(numbers):
    order = numbers["results"]["bias"]["order"]

    assert order["lower"] <= 0.5 <= order["upper"]
    assert all(trend["p"] > 0.001 for trend in numbers["results"]["learning"]["trends"])


def test_nobody_was_left_out(numbers):
    assert numbers["flow"][-1]["decisions_left"] == 792
    assert all(step["sittings_out"] == 0 for step in numbers["flow"])
