"""Sessions whose levels and pairs follow from the answers: pure, undisturbed by voids and kills."""

from collections import Counter
from itertools import product
from pathlib import Path

import pytest

from protocols.feasibility import virtual_manifest
from protocols.journal import Attempt
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from protocols.plan import chosen, make_plan
from protocols.study_file.schema import StudyProtocol
from study_app.gaze.simulated import STEADY, GazeBehaviour
from study_app.session import RunTrial, following, next_step, remaining
from study_app.simulate import SimulatedStudy, simulate_session

FHD = load_display("fhd27-60hz")
LEVELS = (5.0, 10.0, 15.0, 20.0, 25.0)
UP_DOWN = {"rule": "up-down", "start": 5.0, "harder": (5.0,), "easier": (5.0,)}
QUEST = {"rule": "quest-plus", "threshold": (5.0, 10.0, 15.0, 20.0), "width": (5.0, 10.0)}
PAIRS = {"rule": "active-pairs", "trials": 24}


def detection(adaptive: dict[str, object]) -> StudyProtocol:
    """Yes or no on stills of two methods at five levels, a track for each method."""
    plain = load_protocol(Path("demo")).model_dump()
    entries = [
        {
            "name": f"{method}-{level:.0f}-{scene}-{cut}",
            "file": f"{method}-{level:.0f}-{scene}-{cut}.png",
            "condition": {
                "method": method, "eccentricity_deg": level, "scene": scene, "cut": cut,
            },
        }
        for method, level, scene, cut in product(
            ("plain", "noise"), LEVELS, ("lawn", "wall"), ("whole", "cut")
        )
    ]  # fmt: skip
    plain["stimuli"] = {
        "kind": "files", "width_px": 64, "height_px": 64, "entries": tuple(entries),
    }  # fmt: skip
    plain["task"] = {
        "kind": "yes-no",
        "stimulus_s": 0.1,
        "signal": {"cut": ("cut",)},
        "adaptive": {
            "trials": 12, "column": "eccentricity_deg", "by": ("method",), "falling": True,
        } | adaptive,
    }  # fmt: skip
    plain["analysis"] = {
        "kind": "detection", "by": "method", "level": "eccentricity_deg", "falling": True,
    }  # fmt: skip
    plain["design"] |= {"practice": None, "blocks": 2, "repeats": 1}
    plain["trial"] |= {"fixation_s": 0.1, "iti_s": 0.1}
    plain["gaze"]["mode"] = "enforce"
    for texts in plain["text"]["languages"].values():
        texts["answers"] = {"yes": "yes", "no": "no"}
    return StudyProtocol.model_validate(plain)


def preference() -> StudyProtocol:
    """Pairs of three methods, chosen in batches."""
    plain = load_protocol(Path("demo")).model_dump()
    plain["stimuli"]["clips"]["duration_s"] = 0.1
    plain["task"] |= {"sampling": PAIRS, "gap_s": 0.1}
    plain["design"] |= {"repeats": 1, "practice": None}
    plain["trial"] |= {"fixation_s": 0.1, "iti_s": 0.1}
    plain["gaze"]["mode"] = "enforce"
    return StudyProtocol.model_validate(plain)


STUDIES = {"up-down": detection(UP_DOWN), "quest-plus": detection(QUEST), "pairs": preference()}
EVERY = pytest.mark.parametrize("rule", STUDIES)
OF_LEVELS = pytest.mark.parametrize("rule", ["up-down", "quest-plus"])
RESTLESS = GazeBehaviour(away_per_s=0.4, blink_per_s=0.3)


def simulation(rule: str, gaze: GazeBehaviour = RESTLESS) -> SimulatedStudy:
    return SimulatedStudy(STUDIES[rule], FHD, seed=6, gaze=gaze)


def attempts_of(root: Path, rule: str) -> tuple[Attempt, ...]:
    return read_journal(root / STUDIES[rule].study.name / "S001" / "journal.jsonl").attempts


def plan_of(rule: str):
    return make_plan(STUDIES[rule], virtual_manifest(STUDIES[rule], FHD), "S001", 0)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory) -> dict[str, Path]:
    """One whole session of every rule, with void attempts."""
    roots = {}
    for rule in STUDIES:
        roots[rule] = tmp_path_factory.mktemp(rule)
        assert simulate_session(simulation(rule), roots[rule], "S001").reason == "completed"
        assert any(attempt.outcome == "void" for attempt in attempts_of(roots[rule], rule))
    return roots


@EVERY
def test_what_an_adaptive_trial_shows_follows_from_the_journal_alone(sessions, rule):
    """Every attempt of a finished session, chosen again from the lines before it."""
    path = sessions[rule] / STUDIES[rule].study.name / "S001" / "journal.jsonl"
    events, plan = read_journal(path).events, plan_of(rule)
    seen = 0
    for number, event in enumerate(events):
        if isinstance(event, Attempt):
            step = next_step(STUDIES[rule], plan, events[:number], "en")
            assert isinstance(step, RunTrial)
            assert (step.trial.id, step.attempt, step.position) == (
                event.trial, event.attempt, event.position,
            )  # fmt: skip
            assert step.trial.condition == event.condition
            assert step.trial.stimuli == event.stimulus_names
            assert step.trial.correct == event.expected
            seen += event.track is not None
    assert seen > 24


@OF_LEVELS
def test_every_track_has_its_trials_and_levels_that_there_are(sessions, rule):
    done = [a for a in attempts_of(sessions[rule], rule) if a.outcome == "completed"]

    assert Counter(attempt.track for attempt in done) == {
        "method=plain": 12, "method=noise": 12,
    }  # fmt: skip
    for attempt in done:
        assert attempt.track == f"method={attempt.condition['method']}"
        assert attempt.condition["eccentricity_deg"] in LEVELS
        assert attempt.expected == ("yes" if attempt.condition["cut"] == "cut" else "no")
    assert len({attempt.condition["eccentricity_deg"] for attempt in done}) >= 3


def test_up_down_levels_are_those_worked_by_hand(sessions):
    """One step out after a right answer, one step in after a wrong one, kept on the scale."""
    for track in ("method=plain", "method=noise"):
        level = 5.0
        for attempt in attempts_of(sessions["up-down"], "up-down"):
            if attempt.track != track:
                continue
            assert attempt.condition["eccentricity_deg"] == level
            if attempt.outcome == "completed":
                level = min(25.0, level + 5.0) if attempt.correct else max(5.0, level - 5.0)


@OF_LEVELS
def test_a_void_attempt_does_not_advance_its_track(sessions, rule):
    attempts, plan = attempts_of(sessions[rule], rule), plan_of(rule)
    voids = 0
    for number, attempt in enumerate(attempts):
        if attempt.outcome == "void":
            voids += 1
            trial = next(trial for trial in plan.trials if trial.id == attempt.trial)
            again = chosen(STUDIES[rule], plan, trial, attempts[: number + 1])
            assert again.condition["eccentricity_deg"] == (attempt.condition["eccentricity_deg"])
            assert again.condition["method"] == attempt.condition["method"]
    assert voids


@EVERY
def test_voids_taken_out_of_a_journal_change_no_later_level(sessions, rule):
    """Of pairs: no later pair."""
    study, plan = STUDIES[rule], plan_of(rule)
    attempts = attempts_of(sessions[rule], rule)
    done = [attempt for attempt in attempts if attempt.outcome == "completed"]
    trial = next(trial for trial in plan.trials if trial.track is not None)
    for count in range(len(attempts)):
        kept = [attempt for attempt in attempts[:count] if attempt.outcome == "completed"]
        with_voids, without = (
            chosen(study, plan, trial, past).condition for past in (attempts[:count], kept)
        )
        for column in ("eccentricity_deg", "method"):
            assert with_voids.get(column) == without.get(column)
        if rule == "pairs":
            pairs = [{said["first"], said["second"]} for said in (with_voids, without)]
            assert pairs[0] == pairs[1]
    assert done


@OF_LEVELS
def test_answers_of_one_track_say_nothing_in_another(sessions, rule):
    study, plan = STUDIES[rule], plan_of(rule)
    attempts = attempts_of(sessions[rule], rule)
    levels: dict[str, list[bool]] = {"method=plain": [], "method=noise": []}
    for trial in plan.trials:
        if trial.track is not None:
            for count in (8, 16, len(attempts)):
                kept = [a for a in attempts[:count] if a.track != "method=noise"]
                before, after = (
                    chosen(study, plan, trial, past).condition["eccentricity_deg"]
                    for past in (attempts[:count], kept)
                )
                levels[trial.track].append(before == after)

    assert all(levels["method=plain"])
    assert not all(levels["method=noise"])


@EVERY
@pytest.mark.parametrize("kept", [3, 9, 20])
def test_a_killed_session_keeps_its_levels(sessions, rule, kept, tmp_path):
    """Cut within a line, as a power cut does; the session that goes on is the undisturbed one."""
    whole = sessions[rule] / STUDIES[rule].study.name / "S001" / "journal.jsonl"
    lines = whole.read_bytes().splitlines(keepends=True)
    attempts = [i for i, line in enumerate(lines) if b'"kind":"attempt"' in line]
    cut = attempts[kept]
    folder = tmp_path / STUDIES[rule].study.name / "S001"
    folder.mkdir(parents=True)
    (folder / "journal.jsonl").write_bytes(b"".join(lines[:cut]) + lines[cut][:60])

    assert simulate_session(simulation(rule), tmp_path, "S001").reason == "completed"

    def facts(root: Path):
        return [
            (a.trial, a.attempt, a.outcome, a.condition, a.stimulus_names, a.answer, a.track)
            for a in attempts_of(root, rule)
        ]

    assert facts(tmp_path) == facts(sessions[rule])


@EVERY
def test_what_an_adaptive_trial_shows_is_not_loaded_before_its_answer_is_known(rule):
    plan, study = plan_of(rule), STUDIES[rule]
    first = remaining(study, plan, 1, [])[0]
    adaptive = [trial for trial in plan.trials if trial.track is not None]

    assert all(trial.stimuli == () for trial in adaptive)
    follower = following(study, plan, [], first)
    assert follower is None or follower.stimuli


def test_a_session_with_pairs_chosen_shows_catch_trials_too(tmp_path):
    simulate_session(simulation("pairs", STEADY), tmp_path, "S001")
    attempts = attempts_of(tmp_path, "pairs")

    assert Counter(attempt.role for attempt in attempts) == {"main": 24, "catch": 2}
    for attempt in attempts:
        assert (attempt.track == "pairs") == (attempt.role == "main")
        assert attempt.condition["first"] != attempt.condition["second"]
    groups = Counter(
        (a.condition["scene"], a.condition["size"]) for a in attempts if a.role == "main"
    )
    assert set(groups.values()) == {6}  # four scenes and sizes, equally often
