"""Sentences about tasks with right answers say what the results hold."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fixed_studies import PLAN
from made_up_trials import TaskDesign, simulate_abx, simulate_identification, simulate_yes_no

from analysis.models.critical_scaling import critical_scaling
from analysis.models.detection import discrimination, yes_no
from analysis.models.right_answers import correct_rates
from analysis.models.thresholds import fit_thresholds
from analysis.models.trends import trend
from analysis.parts.correct import apa_rate
from analysis.parts.curves.critical import apa_critical
from analysis.parts.learning import apa_trend
from analysis.parts.levels import apa_thresholds
from analysis.parts.sensitivity import (
    apa_discrimination,
    apa_yes_no,
    methods_discrimination,
    methods_yes_no,
)
from analysis.parts.shared import apa_difference
from protocols.answer_rules import Alternatives, answer_rule


@pytest.fixture(scope="module")
def told():
    rng = np.random.default_rng(3)
    return simulate_yes_no(TaskDesign(10, 4, 4), {"blur": 1.5, "ours": 0.2}, rng)


def test_a_rate_says_count_limits_and_chance(told):
    (rate, _) = correct_rates(told, ("method",), chance=0.5)
    text = apa_rate(rate, name="Blur")

    assert text.startswith(f"In condition Blur, {rate.count} of {rate.trials} answers were correct")
    assert f"{rate.share:.2f}".lstrip("0") in text
    assert "95% CI [." in text
    assert "against chance (.50; 10 participants, 4 scenes)" in text


def test_yes_no_says_sensitivity_criterion_and_bias(told):
    found = yes_no(told, ("method",), signal="inconsistent", bias_answer="consistent")
    one = found["blur"]
    text = apa_yes_no(one)

    assert f"d' = {one.d_prime.value:.2f}, 95% CI" in text
    assert f"t({one.d_prime.df:.1f}) = " in text
    assert '"consistent" was answered in' in text
    assert "log-linear" in methods_yes_no(found)
    control = told[(told["method"] == "ours") & (told["expected"] == "consistent")]
    alone = yes_no(control, signal="inconsistent")["all"]
    assert "not both shown: no d'" in apa_yes_no(alone)
    one_person = yes_no(told[told["participant"] == "P001"], signal="inconsistent")["all"]
    assert "z = " in apa_yes_no(one_person)


def test_a_difference_says_which_way_and_how_it_was_adjusted(told):
    found = yes_no(told, ("method",), signal="inconsistent").d_prime_contrasts[0]
    text = apa_difference(found, PLAN)

    assert text.startswith(f"blur minus ours: {found.difference:.2f} in d', 95% CI [")
    assert "Holm" not in text
    rows = simulate_identification(
        TaskDesign(6, 2, 6),
        {"a": 0.0, "b": 0.5, "c": 1.0},
        np.random.default_rng(1),
        levels=[0.0],
        width=2.0,
    )
    three = discrimination(rows, Alternatives(2), ("method",)).contrasts
    assert any("Holm-adjusted" in apa_difference(one, PLAN) for one in three)


def test_abx_says_its_rule_and_an_endless_limit():
    rows = simulate_abx(
        TaskDesign(8, 1, 10),
        {"v1": 0.1},
        np.random.default_rng(2),
        scalings=[0.05, 0.9],
        gain=30.0,
        lapse=0.0,
    )
    found = discrimination(rows, answer_rule("independent"), ("scaling",))
    text = apa_discrimination(found["0.9"], found.rule)

    assert "ABX, independent rule" in text
    assert "∞]" in text
    assert "mapped to d'" in methods_discrimination(found)


def test_thresholds_and_critical_scalings_say_model_limits_and_spread():
    rng = np.random.default_rng(4)
    rows = simulate_identification(
        TaskDesign(6, 1, 12),
        {"a": 14.0, "b": 17.0},
        rng,
        levels=[5, 10, 15, 20, 25],
        width=-12.0,
        participant_sd=2.0,
        interaction_sd=1.0,
    )
    model = fit_thresholds(rows, "level", ("method",))
    text = apa_thresholds(model, unit="deg")
    assert re.search(r"a 1\d\.\d deg, 95% CI \[\d", text)
    assert "participants x conditions SD" in text
    assert "lapse rate .0" in text
    flat = replace(model, interaction_sd=5.63e-6, scene_sd=3.6e-12)
    assert "participants x conditions SD = 0.00, scenes SD = 0.00," in apa_thresholds(flat)
    endless = tuple(replace(one, lower=None, upper=None) for one in model.thresholds)
    assert "participants SD = 0.34," in apa_thresholds(
        replace(model, thresholds=endless, participant_sd=0.3391)
    )

    match = simulate_abx(TaskDesign(6, 1, 15), {"v1": 0.2}, rng, scalings=[0.06, 0.12, 0.25, 0.5])
    assert "SD of ln s_c" in apa_critical(critical_scaling(match))


def test_trends_are_sentences(told):
    text = apa_trend(trend(told, "correct"))
    assert "over 10 participants" in text
