"""A display that cannot keep up is named, and the participant is blamed for none of it."""

import itertools
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_line import metamerlab

from protocols.display import Display, Viewing
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, shipped
from protocols.manifest import write_manifest
from protocols.study_file.schema import StudyProtocol
from study_app.conduct import conduct
from study_app.desktop.display_check import check_display, shortfall
from study_app.desktop.window import FlipStamp
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.open_source import MouseGaze
from study_app.gaze.source import GazeSample, SourceInfo
from study_app.gaze.trusted import TrustedGaze
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.opening import begin, resume
from study_app.session_setup import LATE_MOST
from study_app.simulate import SimulatedStudy
from study_app.trial import GazeVerdict
from study_app.virtual import EPOCH, Fault, VirtualClock, VirtualStage

FAST = load_display("fhd24-144hz")
VIEWING = Viewing.of(FAST)


def demo(**sections: dict[str, object]) -> StudyProtocol:
    plain = load_protocol(Path("demo")).model_dump()
    plain["stimuli"]["clips"] |= {"fps": 36.0, "duration_s": 0.5}
    plain["gaze"] |= {"mode": "enforce"}
    for section, fields in sections.items():
        plain[section] |= fields
    return StudyProtocol.model_validate(plain)


class Cursor(MouseGaze):
    """A tracker that says its last sample when asked, and does not say that it does."""

    def info(self) -> SourceInfo:
        return SourceInfo("asked", "", 144.0)


class Session:
    """A session before a display of any rate, with the mouse on the dot."""

    def __init__(
        self, folder: Path, study: StudyProtocol, true_hz: float, *, on=None, of=MouseGaze
    ):
        self.study, self.clock = study, VirtualClock()
        observer = ArtificialObserver(PreferenceModel(), study.response, 0, "S001")
        self.stage = VirtualStage(
            self.clock, true_hz, observer, nominal_hz=144.0, on_prepare=on or (lambda _t, _a: {})
        )
        dot_px = VIEWING.to_px(0.0, 0.0)
        self.gaze = TrustedGaze(of(lambda: dot_px, self.clock, 144.0), self.clock)
        self.setup = SimulatedStudy(study, FAST).setup(folder, self.clock, "S001")
        self.path = folder / "demo" / "S001" / "journal.jsonl"

    def run(self, open_=begin):
        recorder, plan = open_(self.setup, self.stage, self.gaze)
        with recorder:
            return conduct(self.setup, plan, recorder, self.stage, self.gaze)

    def stopped(self, open_=begin) -> str:
        with pytest.raises(StudyError, match="the display cannot keep up") as caught:
            self.run(open_)
        return str(caught.value)

    @property
    def attempts(self):
        return read_journal(self.path).attempts


@pytest.mark.parametrize("true_hz", [36.0, 72.0, 100.0, 7.0])
def test_a_slow_renderer_is_named_after_a_few_attempts_and_the_eye_is_not(tmp_path, true_hz):
    """Before, gaps between samples of a mouse counted as a lost eye: the dot was asked for."""
    session = Session(tmp_path, demo(), true_hz)
    message = session.stopped()

    (told_hz,) = re.findall(r"cannot keep up \((.*) Hz instead of 144: ", message)
    assert float(told_hz) == pytest.approx(true_hz, rel=0.04)
    assert "session resume" in message
    assert [a.void_reason for a in session.attempts] == ["dropped-frames"] * LATE_MOST
    assert all(a.gaze.lost_share == 0.0 for a in session.attempts)
    end = read_journal(session.path).events[-1]
    assert isinstance(end, SessionEnd)
    assert (end.reason, end.message) == ("error", message)


def test_what_was_stopped_goes_on_before_a_faster_machine(tmp_path):
    Session(tmp_path, demo(), 36.0).stopped()
    again = Session(tmp_path, demo(), 36.0)
    again.stopped(resume)
    assert len(again.attempts) == 2 * LATE_MOST

    outcome = Session(tmp_path, demo(), 144.0).run(resume)

    assert (outcome.reason, outcome.main_done) == ("completed", 24)


def test_every_flip_that_the_log_marks_is_counted_where_the_operator_looks(tmp_path):
    """The wait for fixation is no stimulus, and counts in the state of the machine all the same."""
    session = Session(tmp_path, demo(), 36.0)
    message = session.stopped()
    missed = 0
    for attempt in session.attempts:
        rows = (session.path.parent / attempt.flips_file.file).read_text().splitlines()[2:]
        marked = sum(int(row.split(",")[3]) - 1 for row in rows)
        assert attempt.missed == marked > attempt.dropped
        missed += marked

    told = metamerlab(
        "session", "status", str(session.path.parent), terminal_width=400, status=None
    )
    lines = {row[0]: row[1] for line in told.output.splitlines() if len(row := cells(line)) == 2}
    assert lines["missed refreshes"].startswith(f"{missed} of ")
    assert lines["gaze lost"].startswith("0.0 %")
    assert lines["state"] == "stopped"
    assert f"void: {LATE_MOST} dropped-frames" in lines["attempts"]
    assert message.split(";")[0].split(": ", 1)[1][:40] in " ".join(
        re.sub("[│|]", " ", told.output).split()
    )


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("│| ").replace("|", "│").split("│")]


def test_a_tolerant_study_goes_on_before_a_late_display_and_counts_what_it_missed(tmp_path):
    study = demo(trial={"dropped_frames_max": 10_000}, design={"repeats": 1})
    session = Session(tmp_path, study, 36.0)

    assert session.run().reason == "completed"
    assert {a.outcome for a in session.attempts} == {"completed"}
    assert all(a.missed > 0.7 * a.refreshes for a in session.attempts)


def test_single_late_attempts_stop_nothing(tmp_path):
    """All but every third are late."""
    number = itertools.count(1)

    def faults(_trial, _attempt):
        return {} if next(number) % LATE_MOST == 0 else {80: Fault("missed", 9.0)}

    study = demo(design={"repeats": 1, "max_attempts": 50})
    session = Session(tmp_path, study, 144.0, on=faults)

    assert session.run().reason == "completed"
    reasons = [a.void_reason for a in session.attempts]
    assert reasons[:LATE_MOST] == ["dropped-frames"] * (LATE_MOST - 1) + [None]
    assert len(reasons) > 40


@pytest.mark.parametrize("of", [MouseGaze, Cursor])
def test_a_machine_that_stands_still_at_the_onset_of_a_clip_lost_no_eye(tmp_path, of):
    """No gaze was read for as long as nothing was shown, so silence says nothing of the eye."""
    once = iter([True])

    def faults(_trial, _attempt):
        return {72: Fault("missed", 60.0)} if next(once, False) else {}

    session = Session(tmp_path, demo(design={"repeats": 1}), 144.0, on=faults, of=of)
    session.run()
    first = session.attempts[0]

    assert next(p.phase for p in first.phases if p.dropped) == "fixate"
    assert first.void_reason != "data-loss"
    assert {a.void_reason for a in session.attempts[1:]} == {None}


def test_a_source_that_is_asked_is_lost_where_it_answers_no_more():
    rules = demo().gaze
    for polled, lost in ((True, GazeVerdict.HELD), (False, GazeVerdict.LOSS)):
        monitor = FixationMonitor(rules, VIEWING, (0.0, 0.0), 144.0, polled=polled)
        monitor.watch(0.0, 1.0)
        dot_px = VIEWING.to_px(0.0, 0.0)
        monitor.feed(GazeSample(t_s, t_s, *dot_px) for t_s in (0.0, 0.3, 0.6))
        assert monitor.verdict(0.6) is lost
        assert monitor.verdict(0.6 + 2 * rules.silence_s) is GazeVerdict.LOSS


# --- the measurement before a session ---------------------------------------------------------


class SlowWindow:
    """Swaps at its own rate, whatever its display should do."""

    pacing, evidence, monitor_name, monitor_mm = "software", "software timer", "", (0, 0)
    mode_hz, size, now = 144.0, (1920, 1080), None

    def __init__(self, display: Display, gaps_s: list[float]) -> None:
        self.display, self._gaps_s, self._now_s = display, itertools.cycle(gaps_s), 0.0
        self.ctx = SimpleNamespace(clear=lambda *_: None, info={}, version_code=430)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def flip(self) -> FlipStamp:
        self._now_s += next(self._gaps_s)
        return FlipStamp(self._now_s, "software timer")


def measured(monkeypatch, *gaps: int):
    monkeypatch.setattr("study_app.desktop.display_check.describe", lambda _ctx: "a renderer")
    window = SlowWindow(FAST, [gap / 144 for gap in gaps])
    return check_display(window, lambda: EPOCH.strftime("%Y-%m-%dT%H:%M:%SZ"), 120)


@pytest.mark.parametrize(("gaps", "rate"), [((4,), "36"), ((2,), "72"), ((1, 2, 2), "86.5")])
def test_a_display_that_is_late_at_most_flips_is_named_with_its_rate(monkeypatch, gaps, rate):
    assert f"cannot keep up ({rate} Hz instead of 144: " in shortfall(measured(monkeypatch, *gaps))


@pytest.mark.parametrize("gaps", [(1,), (1, 1, 1, 2), (1, 1, 3)])
def test_a_display_that_is_in_time_at_most_flips_is_not(monkeypatch, gaps):
    assert shortfall(measured(monkeypatch, *gaps)) == ""


def test_check_display_fails_where_most_refreshes_were_missed(monkeypatch, tmp_path):
    """The report is written all the same: it holds the intervals."""
    monkeypatch.setattr("study_app.desktop.display_check.describe", lambda _ctx: "a renderer")
    commands = "study_app.cli.sessions.session_run_commands"
    monkeypatch.setattr(f"{commands}._own_latency", lambda _window: None)
    words = ["session", "check-display", FAST.name, "--software-pacing", "--out", str(tmp_path)]
    for gap, status in ((4, 2), (1, 0)):
        window = SlowWindow(FAST, [gap / 144])
        shown = partial(lambda window, *_, **__: window, window)
        monkeypatch.setattr("study_app.desktop.window.Window", shown)
        done = metamerlab(*words, status=None)
        assert done.exit_code == status, done.output
        assert ("cannot keep up (36 Hz instead of 144: " in done.stderr) == bool(status)
    assert len(list((tmp_path / "display-reports").iterdir())) == 2


@pytest.mark.parametrize(("tolerated", "said"), [(2, "cannot keep up (15 Hz"), (500, "presented")])
def test_a_late_display_is_refused_before_a_session_unless_the_study_tolerates_it(
    monkeypatch, tmp_path, tolerated, said
):
    display = load_display("fhd27-60hz")
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    text = text.replace("dropped_frames_max = 2", f"dropped_frames_max = {tolerated}")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    study = load_protocol(tmp_path / "study.toml")
    clips = tmp_path / "clips"
    clips.mkdir()
    write_manifest(clips, virtual_manifest(study, display))

    def presented(*_: object, **__: object) -> None:
        raise StudyError("presented")

    monkeypatch.setattr("study_app.run.check_files", lambda *_: None)
    monkeypatch.setattr("study_app.desktop.display_check.describe", lambda _ctx: "a renderer")
    monkeypatch.setattr("study_app.run.Window", lambda *_, **__: SlowWindow(display, [4 / 60]))
    monkeypatch.setattr("study_app.run.Presenter", presented)
    words = ["session", "run", str(tmp_path / "study.toml"), "--participant", "P1", "--simulate"]
    words += ["--stimuli", str(clips), "--out", str(tmp_path / "sessions")]
    done = metamerlab(*words, "--software-pacing", status=None)

    assert (done.exit_code, said in done.stderr) == (2, True), done.output
    assert ("note: display" in done.stdout) == (tolerated == 500)
    assert not (tmp_path / "sessions").exists()


# --- what is said before a window covers the screen --------------------------------------------


def run_without_a_screen(monkeypatch, tmp_path, mode: str, *more: str):
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    (tmp_path / "study.toml").write_text(re.sub('mode = "[a-z]+"', f'mode = "{mode}"', text))
    monkeypatch.setattr("study_app.run.Window", lambda *_, **__: pytest.fail("a window opened"))
    words = ["session", "run", str(tmp_path / "study.toml"), "--participant", "P1"]
    words += ["--stimuli", str(tmp_path), "--out", str(tmp_path / "sessions"), *more]
    return metamerlab(*words, status=2)


@pytest.mark.parametrize("mode", ["enforce", "warn", "monitor"])
def test_a_study_that_watches_gaze_is_told_what_it_needs_before_a_window_opens(
    monkeypatch, tmp_path, mode
):
    said = run_without_a_screen(monkeypatch, tmp_path, mode).stderr

    assert f"needs a gaze source (gaze.mode = '{mode}', at least 50 Hz): eyelink, lsl" in said
    assert "gaze.mode = 'none'" in said
    unknown = run_without_a_screen(monkeypatch, tmp_path, mode, "--gaze", "lls:eye").stderr
    known = "lsl, mouse, replay, eyelink"
    assert f"--gaze: must be one of {known} (got 'lls:eye'); did you mean 'lsl'" in unknown


def test_the_operator_is_told_where_no_eye_is_watched(monkeypatch, tmp_path):
    none = run_without_a_screen(monkeypatch, tmp_path, "none")
    assert "note: gaze is not controlled (gaze.mode = 'none' in the study)" in none.stdout
    given = run_without_a_screen(monkeypatch, tmp_path, "none", "--gaze", "mouse").stderr
    assert "this protocol watches no gaze" in given
    mouse = run_without_a_screen(monkeypatch, tmp_path, "enforce", "--gaze", "mouse")
    assert "note: the mouse stands in for an eye" in mouse.stdout
