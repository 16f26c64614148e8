"""Artificial observers answer as their model says."""

import math
from pathlib import Path

import numpy as np
import pytest

from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_protocol
from protocols.plan import make_plan
from study_app.observers import ArtificialObserver, PreferenceModel

DEMO = load_protocol(Path("demo"))
PLAN = make_plan(DEMO, virtual_manifest(DEMO, load_display("fhd27-60hz")), "P1", 0)
EVEN = {"participant_sd": 0.0, "scene_sd": 0.0, "lapse": 0.0}


def rate_of_first(model: PreferenceModel, trial, count: int = 4000) -> float:
    observer = ArtificialObserver(model, DEMO.response, 1, "P1")
    keys = DEMO.response.keys[trial.answers.index("first")]
    return sum(observer.answer(trial, attempt)[0] in keys for attempt in range(count)) / count


def pick(first: str, second: str):
    return next(
        t for t in PLAN.trials if (t.condition["first"], t.condition["second"]) == (first, second)
    )


# Four standard deviations of a share of 4000 answers.
NEAR = 4 * math.sqrt(0.25 / 4000)


def test_a_preference_of_075_is_answered_as_075_in_both_orders():
    model = PreferenceModel({"metameric": math.log(3.0)}, **EVEN)

    assert rate_of_first(model, pick("metameric", "push-pull")) == pytest.approx(0.75, abs=NEAR)
    assert rate_of_first(model, pick("push-pull", "metameric")) == pytest.approx(0.25, abs=NEAR)


def test_lapses_pull_towards_one_half_and_bias_towards_the_first():
    sure = {"metameric": 50.0}
    lapsing = PreferenceModel(sure, **(EVEN | {"lapse": 0.2}))
    biased = PreferenceModel({}, order_bias=math.log(3.0), **EVEN)

    assert rate_of_first(lapsing, pick("metameric", "push-pull")) == pytest.approx(0.9, abs=NEAR)
    assert rate_of_first(biased, pick("push-pull", "metameric")) == pytest.approx(0.75, abs=NEAR)


@pytest.mark.parametrize("which", ["participant_sd", "scene_sd"])
def test_logits_vary_between_participants_and_scenes_by_their_deviation(which):
    model = PreferenceModel({}, **(EVEN | {which: 0.8}))
    logits = []
    for number in range(2000):
        who = (f"P{number}", "garden") if which == "participant_sd" else ("P1", f"s{number}")
        p = model.choice_probability(3, *who, "metameric", "push-pull")
        logits.append(math.log(p / (1 - p)))

    # The standard error of a deviation of 0.8 from 2000 values is 0.8 / sqrt(4000) = 0.013.
    assert np.std(logits) == pytest.approx(0.8, abs=0.05)
    assert np.mean(logits) == pytest.approx(0.0, abs=0.08)


def test_answers_depend_on_seed_participant_trial_and_attempt_alone():
    trial = PLAN.trials[5]

    def answer(seed=1, participant="P1", attempt=1):
        return ArtificialObserver(PreferenceModel(), DEMO.response, seed, participant).answer(
            trial, attempt
        )

    assert answer() == answer()
    assert len({answer(), answer(seed=2), answer(participant="P2"), answer(attempt=2)}) == 4


def test_equals_take_longer_than_an_easy_pair():
    def median_rt_s(utility: float) -> float:
        observer = ArtificialObserver(
            PreferenceModel({"metameric": utility}, **EVEN), DEMO.response, 1, "P1"
        )
        trial = pick("metameric", "push-pull")
        return float(np.median([observer.answer(trial, k)[1] for k in range(2000)]))

    # The median's standard error: 1.25 x 0.35 / sqrt(2000) = 1 % of it.
    assert median_rt_s(50.0) == pytest.approx(0.7, rel=0.05)
    assert median_rt_s(0.0) == pytest.approx(1.2, rel=0.05)
