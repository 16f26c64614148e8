"""Confidence: a second question after each answer, of every task that decides something."""

import json
import re
from statistics import mean

import pytest
from command_line import metamerlab
from undrawn_reports import undrawn

from analysis.report.write_report import report_sessions
from analysis.tidy import read_sessions
from protocols.against_plan import contradictions, plan_of
from protocols.errors import StudyError
from protocols.feasibility import session_duration_s, virtual_manifest
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, load_study
from protocols.make_script import example_scripts
from protocols.plan import make_plan
from protocols.study_file.new_study import study_files
from protocols.study_file.preregister import preregistration
from protocols.tasks.task_kinds import TASKS
from stimuli.recipes.example_pictures import example_files
from study_app.observers import ArtificialObserver
from study_app.observers.right_or_wrong import SensitivityModel
from study_app.simulate import SimulatedStudy, simulate_study

SECTION = """
[task.confidence]
steps = 4
question = { en = "How sure are you?" }
labels = { en = ["guessed", "unsure", "rather sure", "sure"] }
keys = [["1"], ["2"], ["3"], ["4"]]
"""
DISPLAY = load_display("fhd27-60hz").model_copy(update={"name": "my-display"})
DECIDING = [task for task in TASKS if TASKS[task].task.decides]


def text_of(task: str, section: str = SECTION) -> str:
    text = study_files("pilot", "Pilot", DISPLAY, task)["study.toml"]
    return text.replace("[design]", f"{section}\n[design]", 1)


@pytest.fixture
def load(tmp_path):
    """Load a new study of a task with a section; return it and its display."""

    def loaded(task: str, section: str = SECTION):
        files = study_files("pilot", "Pilot", DISPLAY, task) | {
            "study.toml": text_of(task, section)
        }
        for name in ("study.toml", "display.toml"):
            (tmp_path / name).write_text(files[name], encoding="utf-8")
        if "warped" not in TASKS[task].recipe:
            (tmp_path / "stimuli.csv").write_bytes(example_files(task)["stimuli.csv"])
        study, display = load_study(tmp_path / "study.toml")
        return study.in_any_order(), display

    return loaded


@pytest.mark.parametrize("task", DECIDING)
def test_every_task_that_decides_asks_for_confidence_after_its_answer(load, task):
    study, display = load(task)
    for script in example_scripts(study, display):
        asked = [phase for phase in script.phases if phase.question]
        assert [phase.question.name for phase in asked] == ["answer", "confidence"]
        assert asked[1].question.keys == (("1",), ("2",), ("3",), ("4",))
        (words,) = asked[1].show
        assert words.of.text == "How sure are you?"
        assert words.of.labels == ("guessed", "unsure", "rather sure", "sure")
        names = [phase.name for phase in script.phases]
        assert names[names.index("confidence") - 1] == "respond"
        assert names[names.index("confidence") + 1] in ("feedback", "iti")


def test_a_study_without_it_says_nothing_of_it_and_one_with_it_all(load):
    plain, _ = load("yes-no", "")
    asked, display = load("yes-no")
    assert "confidence" not in plain.model_dump_json()
    assert plain.sha256 != asked.sha256
    said = 'Then, without time limit: "How sure are you?" Answers: guessed / unsure / rather sure'
    assert said in repr(preregistration(asked, display, revision="0"))
    assert "without time limit:" not in repr(preregistration(plain, display, revision="0"))
    assert session_duration_s(asked, 10) == session_duration_s(plain, 10) + 15


def test_steps_alone_are_answered_by_the_digits_that_label_them(load):
    study, display = load("yes-no", '[task.confidence]\nsteps = 3\nquestion = { en = "Sure?" }')
    phase = example_scripts(study, display)[0].phases[-3]
    assert phase.question.keys == (("1",), ("2",), ("3",))
    assert phase.show[0].of.labels == ("1", "2", "3")


def test_tables_events_and_their_dictionary_have_confidence(load, tmp_path):
    study, display = load("yes-no")
    simulate_study(SimulatedStudy(study, display, seed=3), tmp_path / "out", 1)
    tidy = read_sessions(tmp_path / "out", study)
    given = tidy.decisions["confidence"]
    assert given.between(1, 4).all()
    assert given.nunique() > 1
    assert (tidy.decisions["confidence_rt_s"] > 0).all()
    assert {"confidence", "confidence_rt_s"} <= set(tidy.attempts)
    journal = next((tmp_path / "out").rglob("journal.jsonl"))
    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    assert lines[0]["task"] == "yes-no"
    attempts = [line for line in lines if line["kind"] == "attempt" and "further" in line]
    by_trial = {line["trial"]: int(line["further"][0]["answer"]) for line in attempts}
    assert dict(zip(tidy.decisions["trial"], given, strict=True)) == by_trial


@pytest.mark.slow
@pytest.mark.parametrize("task", ["two-interval", "yes-no", "abx"])
def test_a_report_of_a_study_that_asks_for_it_keeps_its_column(load, tmp_path, task):
    study, display = load(task)
    simulate_study(SimulatedStudy(study, display, seed=3), tmp_path / "out", 3)
    with undrawn():
        made = report_sessions(tmp_path / "out", study, tmp_path / "report", figure_files="none")
    tables = made.html.parent / "tables"
    assert "confidence" in (tables / "decisions.csv").read_text().splitlines()[0].split(",")
    assert "Confidence in the answer, in steps" in (tables / "dictionary.csv").read_text()
    assert "confidence" not in json.loads(made.json.read_text())["results"]


def test_a_journal_whose_confidence_no_key_could_give_contradicts_its_study(load, tmp_path):
    study, display = load("yes-no")
    simulate_study(SimulatedStudy(study, display, seed=3), tmp_path / "out", 1)
    journal = read_journal(next((tmp_path / "out").rglob("journal.jsonl")))
    plan = plan_of(study, journal.start)
    assert not list(contradictions(study, plan, journal.attempts))
    attempt = next(a for a in journal.attempts if a.outcome == "completed")
    (given,) = attempt.further
    for further, said in (
        ((), "confidence must be one of 1, 2, 3, 4 (got nothing)"),
        ((given, given), "further must have each question once (got confidence, confidence)"),
        ((given.model_copy(update={"answer": "abc"}),), "must be one of 1, 2, 3, 4 (got 'abc')"),
        ((given.model_copy(update={"key": "z"}),), "must come from one of its keys"),
        ((given.model_copy(update={"key": "pointer"}),), "(got pointer)"),
    ):
        changed = attempt.model_copy(update={"further": further})
        ((_, why),) = contradictions(study, plan, [changed])
        assert said in why


@pytest.mark.slow
def test_exports_hold_confidence_and_say_what_it_is(load, tmp_path):
    study, display = load("yes-no")
    simulate_study(SimulatedStudy(study, display, seed=3), tmp_path / "out", 1)
    words = [
        "analysis", "export", tmp_path / "out", "--protocol", tmp_path / "study.toml",
        "--format", "bids",
        "--out", tmp_path / "bids",
    ]  # fmt: skip
    metamerlab(*words)
    found = list((tmp_path / "bids").rglob("*.tsv"))
    heads = [p.read_text().splitlines()[0] for p in found]
    assert any(re.search(r"\bconfidence\b", h) and "confidence_rt_s" in h for h in heads)
    docs = "".join(p.read_text() for p in (tmp_path / "bids").rglob("*.json"))
    assert "Confidence in the answer, in steps from 1, the least" in docs
    events = next(p for p in found if p.name.endswith("_events.tsv")).read_text().splitlines()
    place = events[0].split("\t").index("response_time")
    rows = [row.split("\t") for row in events[1:] if "\tconfidence\t" in row]
    assert rows
    assert all(float(row[place]) > 0 for row in rows)


@pytest.mark.parametrize(
    ("task", "old", "new", "message"),
    [
        ("yes-no", ', ["4"]]', "]",
         "task.confidence.keys: must have a list of keys for each of the 4 steps (got 3); give"
         " every step one, or leave keys out for up to 9"),
        ("yes-no", "steps = 4", "steps = 3",
         "task.confidence.keys: must have a list of keys for each of the 3 steps (got 4)"),
        ("yes-no", ', "sure"] }', "] }",
         "task.confidence.labels.en: must label each of the 4 steps (got 3 labels)"),
        ("yes-no", '["4"]', '["3"]',
         "task.confidence.keys[3]: a key must do one thing (got '3', which"
         " task.confidence.keys[2] has); give the step another key"),
        ("yes-no", '["4"]', '["escape"]',
         "task.confidence.keys[3]: a key must do one thing (got 'escape', which"
         " response.quit_keys has)"),
        ("yes-no", 'question = { en', 'question = { de',
         "task.confidence.question: must be in the languages of the study: en (got de); add en and"
         " leave out de"),
        ("yes-no", "How sure are you?", "Left is {letf}",
         "task.confidence.question.en: {...} must be one of left, right, continue, quit, done,"
         " total (got {letf}); did you mean 'left'?"),
        ("yes-no", "steps = 4", "steps = 12", "task.confidence.steps"),
        ("two-interval", "steps = 4", "stpes = 4",
         "task.confidence.stpes: unknown key; did you mean 'steps'?"),
    ],
)  # fmt: skip
def test_a_mistake_has_one_message_with_place_and_cure(load, task, old, new, message):
    assert old in SECTION
    with pytest.raises(StudyError) as caught:
        load(task, SECTION.replace(old, new))
    assert message in str(caught.value)


def test_a_column_of_the_stimuli_may_not_take_its_name(load, tmp_path):
    load("yes-no", "")
    (tmp_path / "stimuli.csv").write_text(
        (tmp_path / "stimuli.csv").read_text().replace("noise", "confidence", 1)
    )
    text = text_of("yes-no").replace('"noise"', '"confidence"')
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    with pytest.raises(StudyError, match="must not be called 'confidence'"):
        load_protocol(tmp_path / "study.toml")


def confidences(model, study, trial, count=3000):
    """(right, step) of answers to one trial."""
    question = next(
        phase.question
        for phase in example_scripts(study, DISPLAY)[0].phases
        if phase.name == "confidence"
    )
    observer = ArtificialObserver(model, study.response, 1, "P1")
    found = []
    for attempt in range(count):
        key = observer.answer(trial, attempt)[0]
        answer = trial.answers[[key in keys for keys in study.response.keys].index(True)]
        sure, rt_s = observer.answer_further(question, trial, attempt)
        assert rt_s > 0
        found.append((answer == trial.correct, int(sure)))
    return found


def test_who_guesses_uses_all_steps_and_who_knows_is_surer_when_right(load):
    """Criteria are the quartiles of a guesser's evidence."""
    study, display = load("yes-no")
    trial = next(
        trial
        for trial in make_plan(study, virtual_manifest(study, display), "P1", 0).trials
        if trial.role == "main"
    )
    even = {"participant_sd": 0.0, "scene_sd": 0.0, "lapse": 0.0, "by": ("noise",)}
    noise = str(trial.condition["noise"])
    guesses = SensitivityModel(strength={noise: -9.0}, confidence_noise=0.0, **even)
    steps = [step for _, step in confidences(guesses, study, trial)]
    assert [steps.count(step) / len(steps) for step in (1, 2, 3, 4)] == pytest.approx(
        [0.25] * 4, abs=0.04
    )
    knows = SensitivityModel(strength={noise: 1.2}, **even)
    told = confidences(knows, study, trial)
    right, wrong = ([step for ok, step in told if ok is which] for which in (True, False))
    assert mean(right) > mean(wrong) + 0.3
    assert mean(right) > mean(steps) + 0.3
