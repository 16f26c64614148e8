"""Ratings of one stimulus, alone or after its standard: from study to report."""

import json
from collections import Counter

import numpy as np
import pytest
from command_line import metamerlab

from analysis.tidy import read_sessions
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_study
from protocols.make_script import example_scripts
from protocols.plan import make_plan
from protocols.script import Frames
from protocols.study_file.new_study import study_files
from protocols.study_file.preregister import preregistration
from protocols.tasks.task_kinds import TASKS
from stimuli.recipes.example_pictures import example_files
from study_app.observers.rating_observer import REACH, RaterModel
from study_app.simulate import SimulatedStudy, simulate_study

DISPLAY = load_display("fhd27-60hz").model_copy(update={"name": "my-display"})
DECIDING = [name for name, kind in TASKS.items() if kind.task.decides]
FILES = study_files("pilot", "Pilot", DISPLAY, "rating")
STANDARD = ('stimulus_s = 0.5', 'stimulus_s = 0.5\nstandard = { blur_px = 0.0 }\n'
            'matched = ["scene", "texture"]\ngap_s = 0.5')  # fmt: skip


@pytest.fixture
def load(tmp_path):
    """Load the new study of ratings with replacements; return it and its display."""

    def loaded(*changes: tuple[str, str]):
        text = FILES["study.toml"]
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        (tmp_path / "display.toml").write_text(FILES["display.toml"], encoding="utf-8")
        (tmp_path / "stimuli.csv").write_bytes(example_files("rating")["stimuli.csv"])
        study, display = load_study(tmp_path / "study.toml")
        return study.in_any_order(), display

    return loaded


def test_a_trial_shows_one_stimulus_or_its_standard_and_then_it(load):
    alone, display = load()
    shown = [len(frames) for frames in example_scripts(alone, display)[0].frames]
    assert sum(shown) == 1
    after, _ = load(STANDARD)
    script = example_scripts(after, display)[0]
    names = [phase.name for phase in script.phases][1:5]
    assert names == ["standard", "gap", "stimulus", "respond"]
    of = [e.stimulus for p in script.phases for e in p.show if isinstance(e, Frames)]
    assert of == [0, 1]
    assert script.phases[4].question.answers == ("bad", "poor", "fair", "good", "excellent")
    by_name = {s.name: s.condition for s in after.stimuli.pool()}
    for trial in make_plan(after, virtual_manifest(after, display), "P1", 0).trials:
        standard, rated = (by_name[name] for name in trial.stimuli)
        assert standard == {**rated, "blur_px": 0.0}
        assert rated["blur_px"] != 0.0
        assert trial.condition == rated
    assert len(alone.task.cells(alone.pool)) == 20
    assert len(after.task.cells(after.pool)) == 16


@pytest.mark.slow
def test_it_is_simulated_tabled_and_reported_from_study_to_results(load, tmp_path):
    study, display = load(STANDARD, ("# baseline = 0.0", "baseline = 0.5"))
    simulate_study(SimulatedStudy(study, display, seed=3), tmp_path / "out", 4)
    rows = read_sessions(tmp_path / "out", study).analysed
    scale = list(study.task.scale)
    assert set(rows["rating"]) <= set(scale)
    assert [scale.index(r) + 1 for r in rows["rating"]] == list(rows["step"])
    means = rows.groupby("blur_px")["step"].mean()
    assert means[0.5] > means[2.0] + 0.5
    metamerlab(
        "analysis",
        "report",
        str(tmp_path / "out"),
        "--protocol",
        str(tmp_path / "study.toml"),
        "--out",
        str(tmp_path / "report"),
    )
    results = json.loads((tmp_path / "report" / "results.json").read_text())["results"]
    model = results["ratings"]["model"]
    assert list(model["categories"]) == scale
    assert {one["second"] for one in model["contrasts"]} == {"0.5"}
    assert "task: standard" not in repr(preregistration(study, display, revision="0"))
    assert "a rating in 5 steps" in repr(preregistration(study, display, revision="0"))


def test_observers_rate_as_their_model_says(load):
    """At 0 and without lapses, shares are those of a normal between evenly spaced thresholds."""
    study, display = load()
    trial = make_plan(study, virtual_manifest(study, display), "P1", 0).trials[-1]
    model = RaterModel(participant_sd=0.0, scene_sd=0.0, lapse=0.0, by="blur_px")
    count = 4000
    answers = Counter(
        model.decide(trial, 1, "P1", np.random.default_rng(seed)).answer for seed in range(count)
    )
    cuts = [model_cdf(x) for x in np.linspace(-REACH, REACH, 4)]
    shares = np.diff([0.0, *cuts, 1.0])
    found = [answers[name] / count for name in trial.answers]
    assert found == pytest.approx(shares, abs=4 * 0.5 / count**0.5)


def model_cdf(x: float) -> float:
    from statistics import NormalDist

    return NormalDist().cdf(x)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"good", "excellent"]', '"good", "good"]',
         "task.scale: every step must be given once (got bad, poor, fair, good, good)"),
        ('scale = ["bad", "poor", "fair", "good", "excellent"]', 'scale = ["bad", "good"]',
         "task.scale: "),
        ("feedback = false", "feedback = true",
         "design.practice.feedback: needs a known right answer: leave it out, for the task"
         " 'rating' has none"),
        ('by = "blur_px"', 'by = "blur"',
         "analysis.by: must name a column of the stimuli (scene, texture, blur_px) (got 'blur')"),
        ("# baseline = 0.0", "baseline = 0.7",
         "analysis.baseline: must be a value of 'blur_px' that is rated (0, 0.5, 1, 1.5, 2)"),
        ('side = "fixed"', 'side = "by-trial"',
         "design.side: must be 'fixed' for the task 'rating'"),
        ("stimulus_s = 0.5", "stimulus_s = 0.5\ngap_s = 0.5",
         "task.gap_s: must be left out where no standard is shown"),
        ("stimulus_s = 0.5", 'stimulus_s = 0.5\nmatched = ["scene"]',
         "task.matched: must be left out where no standard is shown"),
        ("stimulus_s = 0.5", "stimulus_s = 0.5\nstandard = { blur_px = 0.0 }",
         "task.matched: there must be one standard where scene = one"),
        ("stimulus_s = 0.5", "stimulus_s = 0.5\nstandard = { blur_px = 0.2 }",
         "task.standard.blur_px: must be a value that the stimuli have"),
        ("[design]", '[task.confidence]\nsteps = 3\nquestion = { en = "Sure?" }\n\n[design]',
         "task.confidence: must be left out for the task 'rating', whose answers are no decisions"
         f" that one can be sure of; tasks that may have it: {', '.join(DECIDING)}"),
    ],
)  # fmt: skip
def test_a_mistake_has_one_message_with_place_and_cure(load, old, new, message):
    with pytest.raises(StudyError) as caught:
        load((old, new))
    assert message in str(caught.value)


def test_power_is_simulated_and_says_by_which_test(load, tmp_path):
    load()
    words = ["analysis", "power", str(tmp_path / "study.toml"), "--studies", "100"]
    done = metamerlab(*words)
    assert "not by the report's mixed model" in " ".join(done.output.split())
