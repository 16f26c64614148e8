"""The kernel of the browser says what Python says: plans, steps, trials, flips and levels."""

import json
import random
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from timelines import OBSERVED, TIMELINES
from web_kernel import Kernel, running_kernel

from protocols.browser import head_poses
from protocols.browser.browser_window import shows_all
from protocols.browser.web_study import adaptive_column, web_design
from protocols.disk.hashing import sha256_json
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import (
    Answer,
    AnyEvent,
    Attempt,
    BlockEnd,
    BlockStart,
    Break,
    BrowserWindow,
    Consent,
    ShownStimulus,
)
from protocols.load import load_display, load_protocol, shipped
from protocols.make_script import example_scripts
from protocols.plan import Plan, PlannedTrial, make_plan
from protocols.script import GazeMode, TrialScript
from protocols.study_file.schema import StudyProtocol
from study_app.pacing import Pacer
from study_app.session import (
    AskConsent,
    AskQuestion,
    EndBlock,
    Finish,
    RunTrial,
    StartBlock,
    Step,
    TakeBreak,
    following,
    next_step,
)
from study_app.trial import FlipObservation, Trial, advance

FHD = load_display("fhd27-60hz")
SHIPPED = shipped("studies")
SLOW = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
BROWSERS = ("refreshes", "answer", "interrupt")
"""Events that a browser observes: none of gaze."""
VOIDS = ("gaze-break", "data-loss", "no-fixation", "too-late", "dropped-frames", "paused", "quit")


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    with running_kernel(tmp_path_factory.mktemp("kernel")) as kernel:
        yield kernel


@cache
def study_of(name: str) -> StudyProtocol:
    return load_protocol(Path(name)).in_any_order()


@given(
    window_px=st.tuples(*[st.integers(1, 9000)] * 2),
    need_px=st.tuples(*[st.integers(1, 3000)] * 2),
    scale=st.integers(1, 4),
    off=st.integers(-1, 1),
)
@SLOW
def test_what_a_window_shows_is_what_python_says(kernel, window_px, need_px, scale, off):
    for size in (window_px, tuple(scale * edge + off for edge in need_px)):
        window = {
            "window_px": [max(1, edge) for edge in size], "device_pixel_ratio": 1.5,
            "scale": scale, "full_screen": False,
        }  # fmt: skip
        shown = shows_all(BrowserWindow.model_validate_json(json.dumps(window)), need_px)
        assert kernel.ask("window", window=window, need_px=need_px) == shown


@given(
    axes=st.lists(st.tuples(*[st.floats(-1, 1)] * 3, st.floats(0, 180)), min_size=1, max_size=9),
    most_deg=st.floats(0.5, 180),
)
@SLOW
def test_poses_of_a_head_are_what_python_says(kernel, axes, most_deg):
    angles = np.radians([angle for *_, angle in axes])[:, None] / 2
    along = np.array([axis for *axis, _ in axes]) + 1e-9
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    quaternions = np.hstack([along * np.sin(angles), np.cos(angles)])
    told = kernel.ask("poses", quaternions=quaternions.tolist(), most_deg=most_deg)
    poses = head_poses.poses_of(quaternions)
    assert told["text"] == head_poses.encoded_poses(poses)
    assert (head_poses.decoded_poses(told["text"]) == poses).all()
    assert told["away"] == head_poses.turned_away(poses, most_deg).tolist()


def tell(kernel: Kernel, study: StudyProtocol) -> str:
    """Hand the kernel a design; return the name that it has there."""
    name = study.study.name + study.sha256
    kernel.ask("design", name=name, design=web_design(study).model_dump(mode="json"))
    return name


def person(plan: Plan) -> dict[str, Any]:
    return {"seed": plan.seed, "participant": plan.participant, "slot": plan.slot}


def plan_of(
    study: StudyProtocol, seed: int, participant: str, slot: int, key: int | None = None
) -> Plan:
    return make_plan(study.ordered_by(seed, key), virtual_manifest(study, FHD), participant, slot)


def track_of(study: StudyProtocol, name: str | None) -> str | None:
    """The name of a track in the kernel: a number."""
    rule = study.task.adaptation
    return name and rule and str(list(rule.tracks(study.task, study.pool)).index(name))


def plain(study: StudyProtocol, trial: PlannedTrial) -> dict[str, Any]:
    """A trial as the kernel has it: what it shows in place of its condition.

    It is told the right answer where it needs it: by rules that choose, and in judged practice.
    """
    column, practice = adaptive_column(study), study.design.practice
    told = trial.track or (trial.role == "practice" and practice and practice.judged)
    level = trial.condition.get(column) if column and trial.track and trial.stimuli else None
    return {
        "id": trial.id,
        "block": trial.block,
        "role": trial.role,
        "repeat": trial.repeat,
        "stimuli": list(trial.stimuli),
        "answers": list(trial.answers),
        "correct": trial.correct if told else None,
        "track": track_of(study, trial.track),
        "level": level,
    }


def check_plan(kernel: Kernel, study: StudyProtocol, plan: Plan, **key: int | None) -> None:
    told = kernel.ask("plan", name=tell(kernel, study), person=person(plan) | key)
    assert told == [plain(study, trial) for trial in plan.trials]


@pytest.mark.parametrize(
    "slots", [range(2), pytest.param(range(2, 50), marks=pytest.mark.full)], ids=["few", "many"]
)
@pytest.mark.parametrize("name", SHIPPED)
def test_plans_of_shipped_studies_are_python_s(kernel, name, slots):
    study = study_of(name)
    for slot in slots:
        check_plan(kernel, study, plan_of(study, 2**53 - 1 - slot, f"W{slot:04d}", slot))


def redesigned(study: StudyProtocol, **design: object) -> StudyProtocol:
    text = study.model_dump()
    text["design"] |= design
    return StudyProtocol.model_validate(text)


@given(
    name=st.sampled_from(["demo", "showcase"]),
    design=st.fixed_dictionaries(
        {
            "repeats": st.integers(1, 4),
            "scene_order": st.sampled_from(["random", "balanced"]),
            "places": st.sampled_from(["by-arrival", "drawn"]),
            "blocks": st.integers(1, 4),
        }
    ),
    side=st.sampled_from(["by-participant", "by-trial", "fixed"]),
    seed=st.integers(0, 2**53 - 1),
    key=st.none() | st.integers(0, 2**53 - 1),
    slot=st.integers(0, 10_000),
    participant=st.from_regex(r"[A-Za-z0-9]{1,8}([-_][A-Za-z0-9]{1,4})?", fullmatch=True),
)
@settings(SLOW, max_examples=40)
def test_any_design_is_planned_as_python_plans_it(
    kernel, name, design, side, seed, key, slot, participant
):
    study = study_of(name)
    if not study.task.sided and len(study.task.answers()) == 2:
        design = design | {"side": side}
    study = redesigned(study, **design)
    try:
        plan = plan_of(study, seed, participant, slot, key)
    except StudyError:
        with pytest.raises(AssertionError, match="no such order"):
            kernel.ask("plan", name=tell(kernel, study), person=person_of(seed, participant, slot))
        return
    check_plan(kernel, study, plan, places_key=key)


def person_of(seed: int, participant: str, slot: int) -> dict[str, Any]:
    return {"seed": seed, "participant": participant, "slot": slot}


def walk(study: StudyProtocol, plan: Plan, chance: random.Random) -> tuple[list[Any], list[Any]]:
    """Go through a session with void attempts; return its events and steps as the kernel has them.

    Python decides each step; the kernel must give the same for every beginning of the events.
    """
    events: list[AnyEvent] = []
    steps: list[dict[str, Any]] = []
    void_share = chance.choice([0.0, 0.2, 0.6])
    while True:
        step = next_step(study, plan, events, study.text.default_language)
        after = isinstance(step, RunTrial) and following(study, plan, events, step.trial)
        steps.append({**step_of(step, study), "following": after.id if after else None})
        match step:
            case AskConsent():
                events.append(Consent.model_construct(agreed=chance.random() < 0.9))
            case StartBlock(block):
                events.append(BlockStart.model_construct(block=block))
            case EndBlock(block):
                events.append(BlockEnd.model_construct(block=block))
            case TakeBreak(block):
                events.append(Break.model_construct(after_block=block))
            case AskQuestion(question):
                events.append(Answer.model_construct(question=question.name))
            case RunTrial():
                events.append(attempt_of(step, chance, void_share))
            case Finish():
                return [event_of(event, study) for event in events], steps


def attempt_of(step: RunTrial, chance: random.Random, void_share: float) -> Attempt:
    trial, void = step.trial, chance.random() < void_share
    answer = None if void else chance.choice(trial.answers)
    judged = None if void or trial.correct is None else answer == trial.correct
    return Attempt.model_construct(
        trial=trial.id,
        attempt=step.attempt,
        position=step.position,
        condition=trial.condition,
        track=trial.track,
        stimuli=tuple(ShownStimulus.model_construct(name=name) for name in trial.stimuli),
        outcome="void" if void else "completed",
        void_reason=chance.choice(VOIDS) if void else None,
        answer=answer,
        correct=judged,
    )


def event_of(event: AnyEvent, study: StudyProtocol) -> dict[str, Any]:
    column = adaptive_column(study)
    match event:
        case Consent():
            return {"kind": "consent", "agreed": event.agreed}
        case BlockStart() | BlockEnd():
            return {"kind": event.kind, "block": event.block}
        case Break():
            return {"kind": "break", "after_block": event.after_block}
        case Answer():
            return {"kind": "answer", "question": event.question}
        case Attempt():
            return {
                "kind": "attempt",
                "trial": event.trial,
                "attempt": event.attempt,
                "outcome": event.outcome,
                "void_reason": event.void_reason,
                "correct": event.correct,
                "track": track_of(study, event.track),
                "level": event.condition.get(column) if column and event.track else None,
                "stimuli": list(event.stimulus_names),
            }
    raise AssertionError(event)


def step_of(step: Step, study: StudyProtocol) -> dict[str, Any]:
    match step:
        case AskConsent():
            return {"step": "ask-consent"}
        case StartBlock(block, first=first):
            return {"step": "start-block", "block": block, "first": first}
        case EndBlock(block):
            return {"step": "end-block", "block": block}
        case TakeBreak(block):
            return {"step": "take-break", "after_block": block}
        case AskQuestion(question):
            return {"step": "ask-question", "question": question.name}
        case Finish(consented):
            return {"step": "finish", "consented": consented}
        case RunTrial(trial, attempt, position):
            return {
                "step": "run-trial",
                "trial": plain(study, trial),
                "attempt": attempt,
                "position": position,
            }


def check_walk(kernel: Kernel, study: StudyProtocol, seed: int, slot: int) -> list[Any]:
    plan = plan_of(study, seed, f"W{slot:04d}", slot)
    events, steps = walk(study.ordered_by(seed), plan, random.Random(seed))
    told = kernel.ask("walk", name=tell(kernel, study), person=person(plan), events=events)
    assert told == steps
    return events


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_sessions_of_shipped_studies_go_on_as_in_python(kernel, name, full):
    for slot in range(3 if full else 1):
        check_walk(kernel, study_of(name), slot, slot)


@given(seed=st.integers(0, 2**53 - 1), slot=st.integers(0, 100))
@settings(SLOW, max_examples=8)
def test_rounds_of_practice_end_as_in_python(kernel, seed, slot):
    check_walk(kernel, yes_no(None, practice=PRACTICE, blocks=3), seed, slot)


def shared(study: StudyProtocol, share: float, places: str) -> StudyProtocol:
    """Return the study with a share of its scenes for each participant at home."""
    text = study.model_dump() | {"web": {"gaze": "none", "share": share}}
    text["design"] |= {"places": places}
    return StudyProtocol.model_validate(text)


SHARED = {
    **{name: partial(study_of, name) for name in ("demo", "critical-scaling", "beyond-blur-task")},
    "quest-plus": lambda: adaptive("quest-plus"),
    "up-down by scene": lambda: adaptive("up-down", by=("method", "scene")),
    "practice": lambda: yes_no(None, practice=PRACTICE, blocks=3),
    "practice elsewhere": lambda: yes_no(
        None, scenes=("lawn", "pond", "roof"), practice=PRACTICE | {"scenes": ("wall",)}
    ),
}


@pytest.mark.parametrize("name", SHARED)
@given(
    share=st.sampled_from([0.01, 0.3, 0.4, 0.5, 0.7]),
    places=st.sampled_from(["by-arrival", "drawn"]),
    seed=st.integers(0, 2**53 - 1),
    slot=st.integers(0, 10_000),
)
@settings(SLOW, max_examples=3)
def test_sessions_with_a_share_of_the_scenes_go_on_as_in_python(
    kernel, name, share, places, seed, slot
):
    study = shared(SHARED[name](), share, places)
    check_plan(kernel, study, plan_of(study, seed, "W-1", slot))
    if len(study.task.cells(study.pool)) < 100:
        check_walk(kernel, study, seed, slot)


LEVELS = (2.0, 4.0, 6.0, 8.0, 10.0)
RULES = {
    "quest-plus": {
        "rule": "quest-plus", "threshold": (3.0, 5.0, 7.0, 9.0), "width": (1.0, 2.0, 4.0),
        "guess": (0.0, 0.1), "lapse": (0.0, 0.05),
    },
    "up-down": {
        "rule": "up-down", "start": 2.0, "harder": (4.0, 2.0), "easier": (4.0, 2.0), "in_a_row": 2,
    },
}  # fmt: skip


SCENES = ("lawn", "pond", "roof", "wall")
PRACTICE = {"trials": 3, "criterion_share": 0.75, "rounds_max": 4}


def adaptive(rule: str, **more: object) -> StudyProtocol:
    """A study with a track of eight trials for each method."""
    track = {"trials": 8, "column": "level", "by": ("method",), "falling": True}
    return yes_no(track | RULES[rule] | more)


def yes_no(rule: dict[str, object] | None, **design: object) -> StudyProtocol:
    """Yes or no on stills of two methods at five levels."""
    text = study_of("demo").model_dump()
    entries = tuple(
        {
            "name": f"{method}-{level:.0f}-{scene}-{cut}",
            "file": f"{method}-{level:.0f}-{scene}-{cut}.png",
            "condition": {"method": method, "level": level, "scene": scene, "cut": cut},
        }
        for method, level, scene, cut in product("ab", LEVELS, SCENES, ("whole", "cut"))
    )
    text["stimuli"] = {"kind": "files", "width_px": 64, "height_px": 64, "entries": entries}
    text["task"] = {
        "kind": "yes-no",
        "stimulus_s": 0.1,
        "signal": {"cut": ("cut",)},
        "adaptive": rule,
    }
    text["analysis"] = {"kind": "detection", "by": "method", "level": "level", "falling": True}
    text["design"] |= {"practice": None, "blocks": 2, "repeats": 1} | design
    for texts in text["text"]["languages"].values():
        texts["answers"] = {"yes": "yes", "no": "no"}
    return StudyProtocol.model_validate(text)


@pytest.mark.parametrize("rule", RULES)
@given(seed=st.integers(0, 2**53 - 1), slot=st.integers(0, 100))
@settings(SLOW, max_examples=10)
def test_adaptive_trials_show_what_python_would(kernel, rule, seed, slot):
    events = check_walk(kernel, adaptive(rule), seed, slot)
    shown = {event["level"] for event in events if event["kind"] == "attempt"}
    assert not shown or shown <= set(LEVELS)


@pytest.mark.parametrize(
    ("rule", "more"),
    [
        *[("quest-plus", {"shape": shape}) for shape in ("gauss", "logistic", "gumbel")],
        ("up-down", {"in_a_row": 3, "one_at_first": False}),
        ("up-down", {"harder": (4.0, 2.0, 0.7), "easier": (8.0, 6.0, 2.1), "in_a_row": 1}),
    ],
    ids=str,
)
@given(answers=st.lists(st.booleans(), min_size=20, max_size=60))
@settings(SLOW, max_examples=15)
def test_levels_are_python_s_after_any_answers(kernel, rule, more, answers):
    check_levels(kernel, adaptive(rule, **more), answers)


def check_levels(kernel: Kernel, study: StudyProtocol, answers: list[bool]) -> int:
    """Compare the level after each of these answers; return how many were chosen."""
    section, design = study.task.adaptation, web_design(study)
    history: list[tuple[float, bool]] = []
    levels = []
    for answer in (*answers, True):
        levels.append(section.next_level(LEVELS, history))
        history.append((levels[-1], answer))
    said = design.adaptive.rule.model_dump(mode="json")
    assert kernel.ask("levels", rule=said, history=history[:-1]) == levels
    return len(levels)


@pytest.mark.full
@pytest.mark.parametrize("shape", ["gauss", "logistic", "gumbel"])
def test_a_thousand_choices_of_quest_plus_are_python_s(kernel, shape):
    chance, chosen = random.Random(shape), 0
    while chosen < 1000:
        right = chance.uniform(0.3, 1)
        answers = [chance.random() < right for _ in range(60)]
        chosen += check_levels(kernel, adaptive("quest-plus", shape=shape), answers)


def test_pairs_that_are_chosen_while_it_runs_are_refused_by_name():
    text = study_of("demo").model_dump()
    text["task"] |= {"sampling": {"rule": "active-pairs", "trials": 24}}
    text["design"] |= {"repeats": 1, "practice": None}
    study = StudyProtocol.model_validate(text)
    with pytest.raises(StudyError, match=r"task.adaptive.rule: .*got 'active-pairs'"):
        web_design(study)


def test_a_design_holds_no_secret():
    """The order of everybody's trials follows from it."""
    study = study_of("demo")
    text = web_design(study).model_dump_json()
    assert study.design.seed > 10**6
    assert str(study.design.seed) not in text
    assert str(study.with_secret("abc").order_seed) not in text


@given(
    refresh_hz=st.sampled_from([59.94, 60.0, 72.0, 90.0, 144.0]),
    steps=st.lists(
        st.tuples(st.sampled_from([0, 1, 1, 1, 1, 2, 3, 50]), st.floats(-0.2, 0.7)), max_size=200
    ),
)
@settings(SLOW, max_examples=60)
def test_flips_are_judged_as_python_judges_them(kernel, refresh_hz, steps):
    check_flips(kernel, refresh_hz, steps)


@pytest.mark.full
def test_a_hundred_thousand_flips_are_judged_as_python_judges_them(kernel):
    chance, judged = random.Random(11), 0
    while judged < 100_000:
        steps = [
            (chance.choice([1] * 40 + [2, 3, 50]), chance.uniform(-0.2, 0.7)) for _ in range(2000)
        ]
        judged += check_flips(kernel, chance.choice([59.94, 60.0, 72.0, 90.0, 144.0]), steps)


def check_flips(kernel: Kernel, refresh_hz: float, steps: list[tuple[int, float]]) -> int:
    """Compare what is said of flips so many refreshes apart, and so late; return their number."""
    stamps_s, line_s = [0.0], 0.0
    for refreshes, late_share in steps:
        line_s += refreshes / refresh_hz
        stamps_s.append(line_s + late_share / refresh_hz)
    pacer = Pacer(refresh_hz)
    judged = []
    for t_s in stamps_s:
        try:
            judged.append(pacer.flip(t_s).refreshes)
        except ValueError:
            stamps_s = stamps_s[: len(judged)]
            break
    assert kernel.ask("flips", refresh_hz=refresh_hz, stamps_s=stamps_s) == judged
    return len(judged)


def web_script(script: TrialScript) -> dict[str, Any]:
    """A script as the browser has it: pictures by the names of their files, and nothing live."""
    text = script.model_dump(mode="json")
    for phase in text["phases"]:
        for entry in phase["show"]:
            if entry["kind"] == "live":
                entry |= {"kind": "frames", "every": 0, "last": 0, "crop": None}
        pictures = [entry for entry in phase["show"] if entry["kind"] == "picture"]
        for picture in [*pictures, *phase["follows"].values()]:
            picture["of"] = sha256_json(picture["of"])
    return text


def states(script: TrialScript, observed: list[FlipObservation]) -> list[dict[str, Any]]:
    """Every state of a trial, and what the flip before showed."""
    trial, found = Trial(), []
    for seen in observed:
        if trial.done(script):
            break
        shows = [list(one) for one in trial.shown_frames(script)]
        told = trial.follows(script)
        trial = advance(trial, seen, script)
        state = trial._asdict() | {"further": list(trial.further)}
        del state["waited"], state["warned"]  # of gaze
        of = sha256_json(told.of) if told else None
        found.append(state | {"shows": shows, "told": of})
    return found


def check_attempt(kernel: Kernel, script: TrialScript, observed: list[FlipObservation]) -> int:
    """Compare every state of a trial; return how many flips it took."""
    said = [{key: seen._asdict()[key] for key in BROWSERS} for seen in observed]
    script = script.model_copy(update={"gaze": GazeMode.NONE})
    told = kernel.ask("attempt", script=web_script(script), observed=said)
    wanted = states(script, observed)
    assert told == wanted
    return len(wanted)


@given(script=TIMELINES, observed=st.lists(OBSERVED, max_size=60))
@settings(SLOW, max_examples=200)
def test_a_trial_goes_on_as_in_python_whatever_happens(kernel, script, observed):
    check_attempt(kernel, script, observed)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_scripts_of_shipped_studies_run_as_in_python(kernel, name, full):
    """With `--full` each study has 12,500 flips, so that eight have a hundred thousand."""
    study, least = study_of(name), 6250 if full else 1
    display = load_display(study.display.name) if hasattr(study.display, "name") else FHD
    chance = random.Random(7)
    for script in example_scripts(study, display):
        answers = [None, *study.task.answers()]
        flips = runs = 0
        while runs < 4 or flips < least:
            observed = [
                FlipObservation(
                    refreshes=chance.choice([1] * 400 + [2, 3]),
                    answer=chance.choice(answers) if chance.random() < 0.02 else None,
                )
                for _ in range(2500)
            ]
            flips += check_attempt(kernel, script, observed)
            runs += 1
