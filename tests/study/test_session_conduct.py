"""A whole session on a virtual display: flow, requeue, resume, and what was shown."""

import csv
import dataclasses
import math
import os
import random
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from gaze_persistence import persistence_s

from protocols.disk.hashing import sha256_bytes, sha256_file
from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import (
    Attempt,
    Break,
    Consent,
    Pause,
    SessionResume,
    Withdrawal,
    event_line,
)
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from protocols.make_script import Scripts
from protocols.phases import ITI
from protocols.plan import make_plan
from protocols.script import Frames
from protocols.study_file.schema import StudyProtocol
from study_app.attempt import GazeWatcher, run_attempt
from study_app.conduct import conduct
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.open_source import ReplaySource
from study_app.gaze.recording import load_recording
from study_app.gaze.simulated import STEADY, GazeBehaviour, GazeEvent, SimulatedGaze
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.opening import begin, resume
from study_app.session import remaining
from study_app.session_folders import find_sessions, next_slot
from study_app.simulate import SimulatedStudy, simulate_session, simulate_study
from study_app.stage import PageResult
from study_app.virtual import Fault, VirtualClock, VirtualStage

DEMO = load_protocol(Path("demo"))
FHD = load_display("fhd27-60hz")


def changed(study: StudyProtocol, *, clips=None, **sections: dict[str, object]) -> StudyProtocol:
    plain = study.model_dump()
    plain["stimuli"]["clips"] |= clips or {}
    for section, fields in sections.items():
        plain[section] |= fields
    return StudyProtocol.model_validate(plain)


SHORT = changed(
    DEMO,
    clips={"duration_s": 0.2},
    trial={"fixation_s": 0.1, "iti_s": 0.1, "fixation_timeout_s": 5.0},
    task={"gap_s": 0.1},
    gaze={"mode": "enforce"},
)
NO_GAZE = changed(SHORT, gaze={"mode": "none"})
RESTLESS = GazeBehaviour(away_per_s=0.25, blink_per_s=0.3, loss_per_s=0.05)


def simulation(protocol=SHORT, **fields) -> SimulatedStudy:
    return SimulatedStudy(protocol, FHD, **({"gaze": STEADY} | fields))


def journal_of(root: Path, participant: str = "S001"):
    return read_journal(root / SHORT.study.name / participant / "journal.jsonl")


def test_an_undisturbed_session_shows_the_plan_in_order(tmp_path):
    outcome = simulate_session(simulation(), tmp_path, "S001")
    journal = journal_of(tmp_path)
    manifest = virtual_manifest(SHORT, FHD)
    plan = make_plan(SHORT, manifest, "S001", journal.start.slot)

    assert outcome.reason == "completed"
    assert outcome.main_done == outcome.main_planned == 24
    assert [attempt.trial for attempt in journal.attempts] == [trial.id for trial in plan.trials]
    for attempt, trial in zip(journal.attempts, plan.trials, strict=True):
        for name in ("role", "condition", "answers", "repeat", "block"):
            assert getattr(attempt, name) == getattr(trial, name)
        assert attempt.stimulus_names == trial.stimuli
        assert [shown.sha256 for shown in attempt.stimuli] == [
            manifest.clip(name).sha256 for name in trial.stimuli
        ]
        assert [shown.frames_shown for shown in attempt.stimuli] == [6, 6]
        assert attempt.dropped == 0
        # fixation gate, 0.2 s, 0.1 s, 0.2 s at 60 Hz
        assert [(p.phase, p.refreshes, p.stimuli) for p in attempt.phases[1:4]] == [
            ("first", 12, (0,)), ("gap", 6, ()), ("second", 12, (1,)),
        ]  # fmt: skip


def test_the_header_holds_every_hash_and_says_simulated(tmp_path):
    simulate_session(simulation(), tmp_path, "S001")
    start = journal_of(tmp_path).start

    assert start.simulated
    assert start.protocol_sha256 == SHORT.sha256
    assert start.stimuli_sha256 == SHORT.stimuli_sha256
    assert start.manifest_sha256 == virtual_manifest(SHORT, FHD).sha256
    assert start.plan_sha256 == make_plan(SHORT, virtual_manifest(SHORT, FHD), "S001", 0).sha256
    assert start.seed == SHORT.design.seed
    assert start.gaze.source == "simulated"
    assert start.timing_evidence == "virtual"
    assert {"python", "numpy", "pydantic"} <= set(start.versions)
    assert start.revision


def test_a_session_has_consent_blocks_breaks_questions_and_an_end(tmp_path):
    simulate_session(simulation(), tmp_path, "S001")
    events = journal_of(tmp_path).events
    kinds = [event.kind for event in events if event.kind != "attempt"]

    assert kinds == [
        "session-start", "consent", "block-start", "block-end", "block-start", "block-end",
        "break", "block-start", "block-end", "answer", "answer", "session-end",
    ]  # fmt: skip
    assert next(e for e in events if isinstance(e, Break)).duration_s >= SHORT.design.break_s
    assert next(e for e in events if isinstance(e, Consent)).agreed
    blocks = [event.block for event in events if isinstance(event, Attempt)]
    assert blocks == sorted(blocks)


def test_pages_name_the_keys_and_count_the_blocks(tmp_path):
    texts = changed(SHORT, gaze={"mode": "none"}, design={"blocks": 3}).model_dump()
    english = texts["text"]["languages"]["en"]
    english["instructions"] = ("Press {left} or {right}; {continue} turns the page.",)
    protocol = StudyProtocol.model_validate(texts)
    pages = []

    class Reader(ArtificialObserver):
        def turn_page(self, page):
            pages.append((page.name, page.text))
            return super().turn_page(page)

    clock = VirtualClock()
    stage = VirtualStage(clock, 60.0, Reader(PreferenceModel(), protocol.response, 0, "S001"))
    setup = simulation(protocol).setup(tmp_path, clock, "S001")
    recorder, plan = begin(setup, stage, None)
    with recorder:
        conduct(setup, plan, recorder, stage, None)

    assert [name for name, _ in pages] == [
        "consent", "instructions", "practice", "start", "break", "break",
        "question", "question", "thanks",
    ]  # fmt: skip
    assert pages[1][1] == "Press left or right; space turns the page."
    assert pages[4][1] == "Block 1 of 3 is done. Rest your eyes."
    assert pages[5][1] == "Block 2 of 3 is done. Rest your eyes."
    consent = next(e for e in journal_of(tmp_path).events if isinstance(e, Consent))
    assert consent.text_sha256 == sha256_bytes(pages[0][1].encode())


def test_gaze_and_flips_lie_beside_the_journal_as_hashed(tmp_path):
    simulate_session(simulation(), tmp_path, "S001")
    journal = journal_of(tmp_path)
    folder = journal.path.parent
    for attempt in journal.attempts:
        for side in (attempt.gaze_file, attempt.flips_file):
            assert sha256_file(folder / side.file) == side.sha256
    attempt = journal.attempts[3]
    with (folder / attempt.flips_file.file).open() as file:
        flips = list(csv.DictReader(file))
    assert [int(f["clip_frame"]) for f in flips if f["phase"] == "first"] == [
        k // 2 for k in range(12)
    ]  # 30 fps at 60 Hz
    with (folder / attempt.gaze_file.file).open() as file:
        rows = list(csv.DictReader(file))
    watched = [r for r in rows if attempt.phases[1].onset_s <= float(r["t_s"])]
    assert len(watched) >= 0.5 * 250  # 0.5 s watched at 250 Hz


def test_void_attempts_come_again_later_in_their_block_and_all_are_kept(tmp_path):
    outcome = simulate_session(simulation(gaze=RESTLESS, seed=4), tmp_path, "S001")
    journal = journal_of(tmp_path)
    voids = [a for a in journal.attempts if a.outcome == "void"]

    assert len(voids) >= 4
    assert {a.void_reason for a in voids} <= {"gaze-break", "data-loss", "no-fixation"}
    for void in voids:
        again = [a for a in journal.attempts if a.trial == void.trial and a.attempt > void.attempt]
        assert again or void.attempt == SHORT.design.max_attempts
        assert all(a.block == void.block and a.position > void.position for a in again)
    tries = Counter(a.trial for a in journal.attempts)
    assert max(tries.values()) <= SHORT.design.max_attempts
    assert outcome.main_done + sum(i.startswith("main") for i in outcome.given_up) == 24
    # The next trial is another one wherever another was left in the block.
    for early, late in pairwise(journal.attempts):
        if early.outcome == "void" and early.trial == late.trial:
            plan = make_plan(SHORT, virtual_manifest(SHORT, FHD), "S001", 0)
            before = [a for a in journal.attempts if a.position < late.position]
            assert len(remaining(SHORT, plan, late.block, before)) == 1


def test_a_void_trial_comes_back_at_a_seeded_place_beside_other_pairs(sample_sessions):
    """For 60 participants the first trial of block 1 is void once."""
    template = read_journal(sample_sessions / "demo" / "S001" / "journal.jsonl").attempts[0]
    manifest = virtual_manifest(DEMO, FHD)
    strict = changed(DEMO, design={"max_attempts": 1})
    places = Counter()
    for number in range(60):
        plan = make_plan(DEMO, manifest, f"P{number}", number)
        queue = list(plan.block(1))
        void = template.model_copy(
            update={"trial": queue[0].id, "block": 1, "void_reason": "gaze-break", "attempt": 1}
        )
        after = remaining(DEMO, plan, 1, [void])
        assert after == remaining(DEMO, plan, 1, [void])
        place = after.index(queue[0])
        places[place] += 1
        assert [trial for trial in after if trial is not queue[0]] == queue[1:]
        assert all(early.shown != late.shown for early, late in pairwise(after))
        assert remaining(strict, plan, 1, [void]) == queue[1:]  # given up
        quit_ = void.model_copy(update={"void_reason": "quit"})
        assert queue[0] in remaining(strict, plan, 1, [quit_])  # not the participant's fault

    assert 0 not in places
    assert len(places) >= 8  # of 12
    assert max(places.values()) <= 15


def script_of(protocol, display, trial):
    return Scripts(protocol, display, "en", virtual_manifest(protocol, display)).of(trial)


def attempt_with_keys(*presses):
    """Run one attempt of 0.1 + 0.2 + 0.1 + 0.2 s in which these keys go down at these times."""
    plan = make_plan(NO_GAZE, virtual_manifest(NO_GAZE, FHD), "P1", 0)
    observer = ArtificialObserver(PreferenceModel(), NO_GAZE.response, 0, "P1")
    stage = VirtualStage(VirtualClock(), 60.0, observer)
    # Not prepared, the stage has nobody who answers but these keys.
    hurried = changed(NO_GAZE, response={"timeout_s": 1.0})
    script = script_of(hurried, FHD, plan.trials[0])
    for key, t_s in presses:
        stage.press(key, t_s)
    return run_attempt(script, stage, None, lambda *_: None)


def test_only_an_answer_key_after_the_question_is_taken():
    """The question is on at 37/60 s; what is pressed before, or means nothing, does not count."""
    onset_s = 37 / 60
    result = attempt_with_keys(
        ("left", 0.0), ("left", 0.2), ("left", onset_s - 0.001), ("q", onset_s + 0.01),
        ("space", onset_s + 0.02), ("right", onset_s + 0.1), ("left", onset_s + 0.2),
    )  # fmt: skip

    assert result.trial.answer == "second"
    assert result.log.given["answer"].press.key == "right"
    assert result.log.given["answer"].press.t_s - onset_s == pytest.approx(0.1)
    assert attempt_with_keys(("left", 0.3)).trial.void_reason == "too-late"


def test_the_first_of_two_answers_in_one_frame_counts():
    result = attempt_with_keys(("j", 0.700), ("f", 0.701))

    assert result.log.given["answer"].press.key == "j"
    assert result.trial.answer == "second"


def test_quit_wins_over_pause_and_both_are_remembered():
    result = attempt_with_keys(("p", 0.1), ("escape", 0.1))

    assert result.trial.void_reason == "quit"
    assert result.interrupts == ("quit",)


def test_a_trial_is_given_up_after_the_allowed_attempts(tmp_path):
    blind = GazeBehaviour(jitter_deg=20.0)
    outcome = simulate_session(
        simulation(changed(SHORT, trial={"fixation_timeout_s": 0.5}), gaze=blind), tmp_path, "S001"
    )
    attempts = journal_of(tmp_path).attempts

    assert outcome.reason == "completed"
    assert outcome.main_done == 0
    assert len(outcome.given_up) == 28
    assert len(attempts) == 28 * 3
    assert {a.void_reason for a in attempts} == {"no-fixation"}


def test_missed_refreshes_void_by_the_protocol_s_tolerance(tmp_path):
    simulate_session(simulation(missed_per_flip=0.05, seed=2), tmp_path, "S001")
    attempts = journal_of(tmp_path).attempts

    assert any(a.void_reason == "dropped-frames" for a in attempts)
    for attempt in attempts:
        dropped = sum(p.dropped for p in attempt.phases if p.phase in ("first", "gap", "second"))
        assert attempt.dropped == dropped
        assert (attempt.dropped > 2) == (attempt.void_reason == "dropped-frames")
        for phase in attempt.phases[1:4]:  # the duration holds but for a late last flip
            if attempt.outcome == "completed":
                assert phase.planned <= phase.refreshes <= phase.planned + 2


@pytest.mark.parametrize(
    ("refresh_hz", "fps"),
    [(60.0, 30.0), (60.0, 60.0), (90.0, 45.0), (120.0, 60.0), (144.0, 72.0), (240.0, 60.0)],
)
def test_200_planted_faults_are_in_the_flip_log_at_their_flips(tmp_path, refresh_hz, fps):
    """Through a whole session: the side files name every planted fault, and no other."""
    patient = changed(
        NO_GAZE,
        clips={"fps": fps, "duration_s": 18 / fps},
        trial={
            "dropped_frames_max": 100,
            **{f"{name}_s": 18 / refresh_hz for name in ("fixation", "iti")},
            "fixation_timeout_s": 10.0,
        },
        task={"gap_s": 18 / refresh_hz},
    )
    display = FHD.model_copy(update={"refresh_hz": refresh_hz})
    chance = random.Random(int(refresh_hz + fps))
    planted: dict[tuple[str, int], dict[int, Fault]] = {}

    def faults(trial, attempt):
        made = {}
        for flip in chance.sample(range(1, 50), 8):
            kind = chance.choice(["late", "missed", "doubled"])
            made[flip] = Fault(kind, {"late": 0.3, "missed": 2.0, "doubled": 0.0}[kind])
        planted[trial.id, attempt] = made
        return made

    clock = VirtualClock()
    observer = ArtificialObserver(PreferenceModel(), patient.response, 0, "S001")
    stage = VirtualStage(clock, refresh_hz, observer, on_prepare=faults)
    setup = SimulatedStudy(patient, display).setup(tmp_path, clock, "S001")
    recorder, plan = begin(setup, stage, None)
    with recorder:
        conduct(setup, plan, recorder, stage, None)

    assert sum(map(len, planted.values())) >= 200
    for attempt in journal_of(tmp_path).attempts:
        with (recorder.folder / attempt.flips_file.file).open() as file:
            rows = list(csv.DictReader(file))
        found = {
            i: row["kind"] for i, row in enumerate(rows) if row["kind"] not in ("first", "on-time")
        }
        made = planted[attempt.trial, attempt.attempt]
        assert found == {flip: fault.kind for flip, fault in made.items()}
        # Each shown clip frame is the one that is due at its refresh.
        per_frame = refresh_hz / fps
        for name in ("first", "second"):
            inside = [row for row in rows if row["phase"] == name]
            passed = 0
            for row in inside:
                passed += int(row["refreshes"]) if row is not inside[0] else 0
                due = passed - (0 if row is inside[0] else int(row["refreshes"]) - 1)
                assert int(row["clip_frame"]) == int(due // per_frame)


@pytest.mark.parametrize("rate_hz", [60.0, 250.0, 500.0, 1000.0])
@pytest.mark.parametrize(
    ("kind", "reason"), [("away", "gaze-break"), ("loss", "data-loss"), ("death", "data-loss")]
)
def test_gaze_that_leaves_ends_the_attempt_in_time(rate_hz, kind, reason):
    """Through the attempt's own loop: one frame and one sample after the rule at the latest."""
    protocol = changed(SHORT, clips={"duration_s": 3.0})
    rules = protocol.gaze
    rule_s = {
        "away": persistence_s(rules, rate_hz),
        "loss": (math.floor(rules.blink_s * rate_hz + 1e-9) + 1) / rate_hz,
        "death": rules.silence_s,
    }[kind]
    plan = make_plan(protocol, virtual_manifest(protocol, FHD), "P1", 0)
    script = script_of(protocol, FHD, plan.trials[0])
    observer = ArtificialObserver(PreferenceModel(), protocol.response, 0, "P1")
    for seed in range(5):
        clock = VirtualClock()
        stage = VirtualStage(clock, 60.0, observer)
        gaze = SimulatedGaze(clock, Viewing.of(FHD), (0.0, 0.0), rate_hz=rate_hz)
        at_s = 1.0 + random.Random(seed).uniform(0, 1)
        gaze.restart(seed, [GazeEvent(kind, at_s)])
        monitor = FixationMonitor(rules, Viewing.of(FHD), (0.0, 0.0), rate_hz)
        result = run_attempt(script, stage, GazeWatcher(gaze, monitor), lambda *_: None)
        assert result.trial.void_reason == reason
        blank = len(script.phases) - 1
        flips = [(phase, flip.t_s) for phase, _, flip in result.log.flips]
        last_shown = max(t_s for phase, t_s in flips if phase != blank)
        assert at_s <= last_shown <= at_s + rule_s + 1 / 60 + 1 / rate_hz + 1e-6
        after = min(t_s for phase, t_s in flips if phase == blank)
        assert after == pytest.approx(last_shown + 1 / 60)  # gone with the next flip


def test_a_real_recording_drives_an_attempt_and_is_kept_as_it_was(shared_data):
    """A person who fixated the centre, at 1000 Hz: the gate opens and the attempt completes."""
    recording = load_recording(shared_data / "gaze" / "eyeris_memory_1000hz.asc.gz")
    protocol = SHORT
    plan = make_plan(protocol, virtual_manifest(protocol, FHD), "P1", 0)
    clock = VirtualClock(7.0)
    observer = ArtificialObserver(PreferenceModel(), protocol.response, 0, "P1")
    stage = VirtualStage(clock, 60.0, observer)
    source = ReplaySource(recording, clock)
    source.open()
    script = script_of(protocol, FHD, plan.trials[0])
    stage.prepare(plan.trials[0], script, 1)
    monitor = FixationMonitor(protocol.gaze, Viewing.of(FHD), (0.0, 0.0), recording.rate_hz)

    result = run_attempt(script, stage, GazeWatcher(source, monitor), lambda *_: None)

    assert result.trial.completed
    samples = result.log.samples
    assert [sample.raw_t for sample in samples] == list(recording.raw_t[: len(samples)])
    assert len(samples) > 600
    assert result.log.quality.samples >= 499  # 0.5 s watched
    assert result.log.quality.mean_deg < 1.5
    assert result.log.quality.lost_share == 0.0


# --- presented = planned -------------------------------------------------------------------


def random_protocol(chance: random.Random) -> tuple[StudyProtocol, float]:
    """A protocol that a display of the returned rate can do, with everything varied."""
    refresh_hz = chance.choice([60.0, 90.0, 120.0, 144.0, 240.0])
    per_frame = chance.choice([1, 2, 3, 4])
    fps = refresh_hz / per_frame

    def whole(low, high):
        return chance.randint(low, high) / refresh_hz

    protocol = changed(
        DEMO,
        clips={"fps": fps, "duration_s": chance.randint(1, 12) / fps},
        design={
            "repeats": chance.randint(1, 2),
            "side": chance.choice(["by-participant", "by-trial", "fixed"]),
            "scene_order": chance.choice(["random", "balanced"]),
            "scenes": (chance.choice(["garden", "colonnade"]),),
            "practice": None,
            "seed": chance.randint(0, 2**31),
        },
        trial={
            "fixation_s": whole(1, 6),
            "fixation_timeout_s": whole(10, 20),
            "iti_s": whole(1, 4),
        },
        task={"pairings": (("push-pull", "metameric"),), "catch": None, "gap_s": whole(1, 6)},
        gaze={"mode": "none"},
        response={"timeout_s": None},
    )
    return protocol, refresh_hz


def test_presented_is_planned_over_random_protocols(proof_count):
    chance = random.Random(11)
    for number in range(proof_count(1000)):
        protocol, refresh_hz = random_protocol(chance)
        display = FHD.model_copy(update={"refresh_hz": refresh_hz})
        plan = make_plan(protocol, virtual_manifest(protocol, display), f"P{number}", number)
        observer = ArtificialObserver(PreferenceModel(), protocol.response, number, "P")
        stage = VirtualStage(VirtualClock(chance.uniform(0, 9)), refresh_hz, observer)
        for trial in plan.trials:
            script = script_of(protocol, display, trial)
            stage.prepare(trial, script, 1)
            stage.pictures = []
            result = run_attempt(script, stage, None, lambda *_: None)
            clips = protocol.warped.clips
            per_frame = round(refresh_hz / clips.fps)
            clip = [k // per_frame for k in range(clips.frames * per_frame)]
            shown = [
                (
                    picture.phase.name,
                    tuple(
                        (entry.stimulus, entry.frame(picture.refreshes))
                        for entry in picture.phase.show
                        if isinstance(entry, Frames)
                    ),
                )
                for _, picture in stage.pictures
            ]
            assert shown == [
                (script.phases[index].name, frames) for index, frames, _ in result.log.flips
            ]
            asked = [entry for entry in shown if entry[0] == "respond"]
            assert shown == [
                *[("fixate", ())] * round(protocol.trial.fixation_s * refresh_hz),
                *[("first", ((0, frame),)) for frame in clip],
                *[("gap", ())] * round(protocol.task.gap_s * refresh_hz),
                *[("second", ((1, frame),)) for frame in clip],
                *asked,
                *[(ITI, ())] * round(protocol.trial.iti_s * refresh_hz),
            ]
            assert result.trial.completed
            assert {flip.kind for _, _, flip in result.log.flips[1:]} == {"on-time"}
            stamps = [t_s for t_s, picture in stage.pictures if picture.phase.name == "first"]
            assert stamps[-1] - stamps[0] == pytest.approx(
                clips.duration_s - 1 / refresh_hz, abs=1e-9
            )


# --- killed, resumed -----------------------------------------------------------------------


def test_a_session_that_was_quit_goes_on_where_it_stopped(tmp_path):
    sim = simulation()
    clock = VirtualClock()
    setup = sim.setup(tmp_path, clock, "S001")

    class Tired(ArtificialObserver):
        """Presses the quit key during the sixth trial, and means it when asked."""

        trials = 0

        def answer(self, trial, attempt):
            self.trials += 1
            key, after_s = super().answer(trial, attempt)
            return ("escape", 0.1) if self.trials == 6 else (key, after_s)

        def turn_page(self, page):
            if page.name == "quit":
                return PageResult("escape", "", 1.0)
            return super().turn_page(page)

    plain = dataclasses.replace(sim, study=changed(SHORT, gaze={"mode": "none"}))
    setup = plain.setup(tmp_path, clock, "S001")
    observer = Tired(PreferenceModel(), SHORT.response, 0, "S001")
    stage = VirtualStage(clock, 60.0, observer)
    recorder, plan = begin(setup, stage, None)
    with recorder:
        outcome = conduct(setup, plan, recorder, stage, None)
    assert outcome.reason == "quit"
    assert journal_of(tmp_path).attempts[-1].void_reason == "quit"
    assert find_sessions(tmp_path)[0].state == "stopped"

    recorder, plan = resume(setup, stage, None)
    with recorder:
        outcome = conduct(setup, plan, recorder, stage, None)
    journal = journal_of(tmp_path)
    assert outcome.main_done == 24
    assert sum(isinstance(event, SessionResume) for event in journal.events) == 1
    done = [a.trial for a in journal.attempts if a.outcome == "completed"]
    assert sorted(done) == sorted(trial.id for trial in plan.trials)


def test_the_pause_key_voids_rests_and_goes_on(tmp_path):
    sim = simulation(changed(SHORT, gaze={"mode": "none"}))
    clock = VirtualClock()

    class Thirsty(ArtificialObserver):
        trials = 0

        def answer(self, trial, attempt):
            self.trials += 1
            return ("p", 0.1) if self.trials == 3 else super().answer(trial, attempt)

    stage = VirtualStage(clock, 60.0, Thirsty(PreferenceModel(), SHORT.response, 0, "S001"))
    setup = sim.setup(tmp_path, clock, "S001", "de")
    recorder, plan = begin(setup, stage, None)
    with recorder:
        assert conduct(setup, plan, recorder, stage, None).main_done == 24
    events = journal_of(tmp_path).events
    paused = next(i for i, event in enumerate(events) if isinstance(event, Pause))
    assert events[paused - 1].void_reason == "paused"
    assert events[0].language == "de"


def test_refused_consent_ends_the_session_and_frees_the_slot(tmp_path):
    sim = simulation(changed(SHORT, gaze={"mode": "none"}))
    clock = VirtualClock()

    class Unwilling(ArtificialObserver):
        def turn_page(self, _page):
            return PageResult("escape", "", 1.0)

    stage = VirtualStage(clock, 60.0, Unwilling(PreferenceModel(), SHORT.response, 0, "S001"))
    setup = sim.setup(tmp_path, clock, "S001")
    recorder, plan = begin(setup, stage, None)
    with recorder:
        assert conduct(setup, plan, recorder, stage, None).reason == "consent-refused"
    assert not journal_of(tmp_path).attempts
    assert next_slot(tmp_path, "demo") == 0
    with pytest.raises(StudyError, match=r"the session is over \(consent-refused\)"):
        resume(setup, stage, None)


# --- slots, codes, mistakes ----------------------------------------------------------------


def test_each_new_participant_gets_the_next_free_slot(tmp_path):
    simulate_study(simulation(), tmp_path, 3)
    assert [s.journal.start.slot for s in find_sessions(tmp_path)] == [0, 1, 2]

    stone = journal_of(tmp_path, "S002").path
    gone = Withdrawal(n=0, t_s=0.0, at="2026-01-01T00:00:00Z", study="demo", slot=1)
    stone.write_bytes(event_line(gone))
    simulate_session(simulation(), tmp_path, "S009")

    assert journal_of(tmp_path, "S009").start.slot == 1
    assert {s.participant: s.state for s in find_sessions(tmp_path)}["S002"] == "withdrawn"


def start(
    tmp_path,
    participant,
    protocol=SHORT,
    *,
    manifest=None,
    language="en",
    display=FHD,
    true_hz=None,
):
    clock = VirtualClock()
    sim = SimulatedStudy(protocol, display, gaze=STEADY, manifest=manifest)
    stage = VirtualStage(
        clock,
        true_hz or display.refresh_hz,
        ArtificialObserver(PreferenceModel(), protocol.response, 0, "S"),
    )
    recorder, _ = begin(sim.setup(tmp_path, clock, participant, language), stage, None)
    recorder.close()


def test_a_participant_code_is_used_once(tmp_path):
    start(tmp_path, "P1", NO_GAZE)
    before = journal_of(tmp_path, "P1").path.read_bytes()
    with pytest.raises(StudyError, match=r"a code is used once \(got 'P1'"):
        start(tmp_path, "P1", NO_GAZE)
    assert journal_of(tmp_path, "P1").path.read_bytes() == before


@pytest.mark.parametrize("left", [None, b"", b'{"kind":"session-st'])
def test_a_session_killed_before_its_first_line_leaves_its_code_and_slot_free(tmp_path, left):
    folder = tmp_path / "demo" / "P1"
    folder.mkdir(parents=True)
    if left is not None:
        (folder / "journal.jsonl").write_bytes(left)
    assert next_slot(tmp_path, "demo") == 0

    start(tmp_path, "P2", NO_GAZE)
    start(tmp_path, "P1", NO_GAZE)

    assert journal_of(tmp_path, "P2").start.slot == 0
    assert journal_of(tmp_path, "P1").start.slot == 1
    assert [path.read_bytes() for path in folder.glob("torn-line*")] == ([left] if left else [])


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_sessions_begun_at_once_get_different_slots(tmp_path):
    children = []
    for number in range(6):
        child = os.fork()
        if child == 0:
            try:
                start(tmp_path, f"P{number}", NO_GAZE)
            finally:
                os._exit(0)
        children.append(child)
    for child in children:
        os.waitpid(child, 0)

    assert sorted(s.journal.start.slot for s in find_sessions(tmp_path)) == list(range(6))


def test_a_display_at_another_rate_is_refused_and_one_slightly_off_is_not(tmp_path):
    with pytest.raises(StudyError, match=r"must refresh at 60 Hz within 0.5 % \(got 75 Hz\)"):
        start(tmp_path, "P1", NO_GAZE, true_hz=75.0)
    start(tmp_path, "P1", NO_GAZE, true_hz=59.94)
    assert journal_of(tmp_path, "P1").start.refresh_hz == 59.94


def test_a_slow_tracker_is_refused(tmp_path):
    with pytest.raises(StudyError, match=r"must send at least 50 Hz \(got 30 Hz from simulated\)"):
        simulate_session(simulation(gaze_rate_hz=30.0), tmp_path, "S001")
    assert not list(tmp_path.iterdir())


def test_without_leave_no_gaze_is_stored_and_without_need_no_consent_is_asked(tmp_path):
    private = changed(SHORT, privacy={"store_gaze": False, "consent_required": False})
    simulate_session(simulation(private), tmp_path, "S001")
    journal = journal_of(tmp_path)

    assert not (journal.path.parent / "gaze").exists()
    assert all(a.gaze_file is None and a.gaze is not None for a in journal.attempts)
    assert not any(isinstance(event, Consent) for event in journal.events)


@pytest.mark.parametrize("code", ["", "Ada Lovelace", "../P1", "P1/..", "ä", "x" * 40, "-"])
def test_a_code_that_is_none_is_refused(tmp_path, code):
    with pytest.raises(StudyError, match="participant: a code must"):
        start(tmp_path, code, NO_GAZE)
    assert not list(tmp_path.iterdir())


def test_what_does_not_fit_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(StudyError, match="mode 'enforce' needs a gaze source"):
        start(tmp_path, "P1", SHORT)
    with pytest.raises(StudyError, match=r"language: must be one of en, de, ja \(got 'fr'\)"):
        start(tmp_path, "P1", NO_GAZE, language="fr")
    with pytest.raises(StudyError, match=r"language: must be one of en, de, ja \(got ''\)"):
        simulate_session(simulation(NO_GAZE), tmp_path, "P1", language="")
    with pytest.raises(StudyError, match="must be whole refreshes at 144 Hz"):
        start(tmp_path, "P1", changed(NO_GAZE, task={"gap_s": 0.15}),
              display=load_display("fhd24-144hz"))  # fmt: skip
    other = changed(NO_GAZE, clips={"width_deg": 9.0})
    manifest = virtual_manifest(other, FHD)
    clips = tuple(clip.model_copy(update={"width_px": 314}) for clip in manifest.clips)
    foreign = manifest.model_copy(update={"clips": clips})
    with pytest.raises(StudyError, match="must be built from this protocol's"):
        start(tmp_path, "P1", NO_GAZE, manifest=foreign)
    with pytest.raises(StudyError, match="never rescaled"):
        start(tmp_path, "P1", NO_GAZE, manifest=virtual_manifest(other, FHD))
    assert not list(tmp_path.iterdir())


def test_a_resumed_session_must_be_what_it_was(tmp_path):
    sim = simulation(NO_GAZE)
    start_clock = VirtualClock()
    start(tmp_path, "P1", NO_GAZE)
    observer = ArtificialObserver(PreferenceModel(), NO_GAZE.response, 0, "P1")
    stage = VirtualStage(start_clock, 60.0, observer)

    def again(what):
        resume(what.setup(tmp_path, start_clock, "P1"), stage, None)[0].close()

    with pytest.raises(StudyError, match="the protocol must be the one the session began with"):
        again(simulation(changed(NO_GAZE, trial={"iti_s": 0.2})))
    manifest = virtual_manifest(NO_GAZE, FHD).model_copy(update={"revision": "other"})
    with pytest.raises(StudyError, match="the manifest of the clips must be the one"):
        again(simulation(NO_GAZE, manifest=manifest))
    with pytest.raises(StudyError, match="the display must be the one"):
        again(dataclasses.replace(sim, display=FHD.model_copy(update={"distance_mm": 701.0})))
    real = dataclasses.replace(sim.setup(tmp_path, start_clock, "P1"), simulated=False)
    with pytest.raises(StudyError, match="simulated and real sessions must not be mixed"):
        resume(real, stage, None)
    before = journal_of(tmp_path, "P1").events
    again(sim)
    assert journal_of(tmp_path, "P1").events[:-1] == before
    with pytest.raises(StudyError, match="there is no journal"):
        resume(sim.setup(tmp_path, start_clock, "P2"), stage, None)
