"""Practice to a criterion with feedback, catch trials, a break and closing questions in every task:
what is shown, what the journal says, what tables and report make of it."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from task_cases import CASES, CATCH, ROUND, case_text
from undrawn_reports import undrawn

from analysis.report.write_report import report_sessions
from analysis.tidy import read_sessions
from protocols.journal import Answer, BlockEnd, BlockStart, Break, Consent, SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_study
from study_app.conduct import conduct
from study_app.observers import ArtificialObserver, ObserverModel
from study_app.observers.observer_model import Decision
from study_app.opening import begin
from study_app.simulate import SimulatedStudy
from study_app.virtual import VirtualClock, VirtualStage

FEEDBACK_FLIPS = 12  # 0.2 s at 60 Hz
CARELESS = "P3"


@dataclass(frozen=True)
class Learner(ObserverModel):
    """Wrong in the first round of practice, right from then on; mostly right in main trials.

    One of them is careless: every answer to a catch trial is wrong.
    """

    lapse: float = 0.0
    rt_sigma: float = 0.0
    practised: list[str] = field(default_factory=list)

    def decide(self, trial, _seed, participant, rng):
        right = rng.random() < 0.8
        if trial.role == "practice":
            self.practised.append(trial.id)
            right = len(self.practised) > ROUND
        elif trial.role == "catch":
            right = participant != CARELESS
        answer = trial.correct or trial.answers[0]
        others = [name for name in trial.answers if name != answer]
        return Decision(answer if right else others[0], 0.0)


def sit(study, display, root, code):
    """Run a session on the virtual stage; return its journal, its pages and its pictures."""
    setup = SimulatedStudy(study, display).setup(root, clock := VirtualClock(), code)
    pages = []

    class Reader(ArtificialObserver):
        def turn_page(self, page):
            pages.append(page)
            return super().turn_page(page)

    observer = Reader(Learner(), study.response, 0, code)
    stage = VirtualStage(clock, display.refresh_hz, observer)
    stage.pictures = []
    recorder, plan = begin(setup, stage, None)
    with recorder:
        outcome = conduct(setup, plan, recorder, stage, None)
    assert outcome.reason == "completed"
    journal = read_journal(root / study.study.name / code / "journal.jsonl")
    return journal, pages, [picture for _, picture in stage.pictures]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_whole_session_is_shown_recorded_and_analysed(tmp_path, name):
    case = CASES[name]
    path = tmp_path / "study.toml"
    path.write_text(case_text(case), encoding="utf-8")
    study, display = load_study(path)
    sessions = tmp_path / "sessions"

    for code in ("P1", "P2", CARELESS):
        journal, pages, pictures = sit(study, display, sessions, code)
        check_journal(journal, code, case)
        check_what_was_shown(pages, pictures)
        if "adaptive" in case.task:
            check_levels(journal)
    check_tables(read_sessions(sessions, study), case)
    with undrawn():
        report_sessions(sessions, study, tmp_path / "report", figure_files="none")
    check_report(tmp_path / "report", case)


def check_journal(journal, code, case):
    events = journal.events
    kinds = [event for event in events if isinstance(event, BlockStart | BlockEnd | Break)]
    assert [(event.kind, getattr(event, "block", None)) for event in kinds] == [
        ("block-start", 0), ("block-end", 0), ("block-start", 1), ("block-end", 1),
        ("break", None), ("block-start", 2), ("block-end", 2),
    ]  # fmt: skip
    (pause,) = [event for event in events if isinstance(event, Break)]
    assert (pause.after_block, pause.duration_s) == (1, 7.0)
    assert [event.agreed for event in events if isinstance(event, Consent)] == [True]
    answers = [(e.question, e.text) for e in events if isinstance(e, Answer)]
    assert answers == [("strategy", "simulated"), ("glasses", "no")]
    assert isinstance(events[-1], SessionEnd)
    assert (events[-1].reason, events[-1].completed_trials) == ("completed", case.main)

    assert {attempt.outcome for attempt in journal.attempts} == {"completed"}
    roles = [attempt.role for attempt in journal.attempts]
    # A round that failed, a round that reached the criterion, and no third.
    assert roles[: 2 * ROUND] == ["practice"] * 2 * ROUND
    assert "practice" not in roles[2 * ROUND :]
    practice = journal.attempts[: 2 * ROUND]
    assert [attempt.correct for attempt in practice] == [False] * ROUND + [True] * ROUND
    catch = [attempt for attempt in journal.attempts if attempt.role == "catch"]
    assert [attempt.block for attempt in catch] == [1, 2]  # spread over the blocks
    assert [attempt.correct for attempt in catch] == [code != CARELESS] * CATCH
    assert {attempt.condition["level"] for attempt in catch} == {2}
    for attempt in journal.attempts:
        assert attempt.correct in (None, attempt.answer == attempt.expected)
        phases = [phase.phase for phase in attempt.phases]
        assert ("feedback" in phases) == (attempt.role == "practice")
    main = [attempt for attempt in journal.attempts if attempt.role == "main"]
    assert len(main) == case.main
    assert {attempt.block for attempt in main} == {1, 2}


def check_what_was_shown(pages, pictures):
    assert [page.name for page in pages] == [
        "consent", "instructions", "practice", "start", "break", "question", "question", "thanks",
    ]  # fmt: skip
    by_name = {page.name: page for page in pages}
    assert by_name["break"].text == "Block 1 of 2 is done."
    assert by_name["break"].least_s == 7.0
    assert pages[5].text == "What did you look at?"
    assert pages[6].choices == ("no", "yes")
    feedback = [p.notice.of.text for p in pictures if p.phase.name == "feedback"]
    assert feedback == ["Wrong."] * ROUND * FEEDBACK_FLIPS + ["Right."] * ROUND * FEEDBACK_FLIPS


def check_levels(journal):
    main = [attempt for attempt in journal.attempts if attempt.role == "main"]
    tracked = [attempt for attempt in main if attempt.track is not None]
    assert tracked
    assert {attempt.condition["level"] for attempt in tracked} == {1, 2}
    assert tracked[0].condition["level"] == 2
    assert all(a.track is None for a in journal.attempts if a.role in ("practice", "catch"))


def check_tables(tidy, case):
    kinds = tidy.decisions.groupby(["session", "kind"]).size().unstack()
    assert (kinds["practice"] == 2 * ROUND).all()
    assert (kinds["catch"] == CATCH).all()
    assert (kinds["main"] == case.main).all()
    careless = tidy.decisions["participant"] == CARELESS
    main = tidy.decisions["kind"] == "main"
    assert (tidy.decisions["included"] == (main & ~careless)).all()
    reasons = tidy.decisions[~main].groupby("kind")["exclusion"].unique()
    assert [list(reasons[kind]) for kind in ("practice", "catch")] == [
        ["practice trial"], ["catch trial"],
    ]  # fmt: skip
    sessions = tidy.sessions.set_index("participant")
    assert sessions["catch_correct"].to_dict() == {"P1": 1.0, "P2": 1.0, CARELESS: 0.0}
    assert (sessions["excluded"] != "").to_dict() == {"P1": False, "P2": False, CARELESS: True}
    assert len(tidy.answers) == 2 * len(sessions)


def check_report(folder: Path, case):
    rule = "fewer than 75 % of catch trials right"
    flow = json.loads((folder / "results.json").read_text(encoding="utf-8"))["flow"]
    out = {step["step"]: (step["sittings_out"], step["decisions_out"]) for step in flow}
    assert out.pop(rule) == (1, case.main)
    assert set(out.values()) == {(0, 0)}
    assert (flow[-1]["sittings_left"], flow[-1]["decisions_left"]) == (2, 2 * case.main)
    assert rule in (folder / "report.html").read_text(encoding="utf-8")
