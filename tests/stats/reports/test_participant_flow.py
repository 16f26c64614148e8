"""Participants from the first page to the analysis: counted, said, and told by their answers."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd
import pytest
from undrawn_reports import undrawn

from analysis.report.content import participant_blocks
from analysis.report.write_report import report_sessions
from analysis.tidy import TidyTables, read_sessions
from protocols.journal import (
    Answer,
    AnyEvent,
    Consent,
    SessionEnd,
    SessionStart,
    Withdrawal,
    event_line,
)
from protocols.journal_file import read_journal
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import ClosingQuestion

CHOICES = ("under 30", "30 to 49", "50 or more")
GERMAN = ("unter 30", "30 bis 49", "ab 50")


def changed(
    folder: Path, code: str, change: Callable[[list[AnyEvent]], Sequence[AnyEvent]]
) -> None:
    """Write a session's journal anew, its events numbered from 0."""
    path = folder / code / "journal.jsonl"
    events = [
        event.model_copy(update={"n": number})
        for number, event in enumerate(change(list(read_journal(path).events)))
    ]
    path.write_bytes(b"".join(map(event_line, events)))


def ended(reason: str, keep: int) -> Callable[[list[AnyEvent]], list[AnyEvent]]:
    """Keep so many events, and end the session for a reason."""

    def change(events: list[AnyEvent]) -> list[AnyEvent]:
        end = next(event for event in events if isinstance(event, SessionEnd))
        return [*events[:keep], end.model_copy(update={"reason": reason, "completed_trials": 0})]

    return change


def refused(events: list[AnyEvent]) -> list[AnyEvent]:
    start, consent = events[:2]
    assert isinstance(consent, Consent)
    _, end = ended("consent-refused", 1)(events)
    return [start, consent.model_copy(update={"agreed": False}), end]


def withdrew(events: list[AnyEvent]) -> list[AnyEvent]:
    start = events[0]
    assert isinstance(start, SessionStart)
    return [Withdrawal(n=0, t_s=0.0, at=start.at, study=start.study, slot=start.slot)]


def answering(text: str) -> Callable[[list[AnyEvent]], list[AnyEvent]]:
    def change(events: list[AnyEvent]) -> list[AnyEvent]:
        end = events[-1]
        said = Answer(n=0, t_s=end.t_s, at=end.at, question="age-group", text=text)
        return [*events[:-1], said, end]

    return change


@pytest.fixture(scope="module")
def study(demo_protocol) -> StudyProtocol:
    """The demonstration with a question that has choices, in two languages."""
    english = demo_protocol.text.languages["en"]
    asked = ClosingQuestion(name="age-group", text="How old are you?", choices=CHOICES)
    languages = {
        "en": english.model_copy(update={"questions": (asked,)}),
        "de": english.model_copy(
            update={
                "questions": (asked.model_copy(update={"text": "Wie alt?", "choices": GERMAN}),)
            }
        ),
    }
    text = demo_protocol.text.model_copy(update={"languages": languages})
    return demo_protocol.model_copy(update={"text": text})


@pytest.fixture(scope="module")
def sessions(tmp_path_factory, study, write_journals) -> Path:
    """Nine people: each of the first six leaves at another step."""
    folder = write_journals(tmp_path_factory.mktemp("flow") / "s", people=9, study=study)
    changed(folder, "P01", withdrew)
    changed(folder, "P02", refused)
    changed(folder, "P03", ended("quit", 1))
    changed(folder, "P04", ended("tracker-lost", 12))
    changed(folder, "P05", answering(CHOICES[0]))
    (folder / "P06" / "journal.jsonl").write_bytes(b"{}\n")
    changed(folder, "P07", answering(GERMAN[0]))
    changed(folder, "P08", answering(CHOICES[2]))
    return folder


@pytest.fixture(scope="module")
def tidy(sessions, study) -> TidyTables:
    return read_sessions(sessions, study)


def test_every_participant_is_counted_at_the_step_they_reached(tidy):
    assert tidy.participants.steps == (
        ("began", "", 9),
        ("began", "withdrew", 1),
        ("began", "journal cannot be read", 1),
        ("began", "refused consent", 1),
        ("began", "ended before consent", 1),
        ("consented", "", 5),
        ("completed the session", "", 4),
        ("completed the session", "tracker-lost", 1),
        ("analysed", "", 4),
        ("analysed", "fewer than 80 % of the planned trials decided", 1),
    )


def test_one_whose_every_answer_is_too_slow_is_left_out_by_the_rules_of_trials(
    study, write_journals, tmp_path
):
    rules = study.analysis.exclusions.model_copy(update={"rt_max_s": 1.0})
    analysis = study.analysis.model_copy(update={"exclusions": rules})
    study = study.model_copy(update={"analysis": analysis})
    write_journals(tmp_path / "slow", people=1, study=study, rt_s=1.5)
    write_journals(tmp_path / "quick", people=2, study=study, rt_s=0.5)
    (tmp_path / "slow" / "P01").rename(tmp_path / "quick" / "P09")
    changed(
        tmp_path / "quick", "P09",
        lambda events: [events[0].model_copy(update={"participant": "P09"}), *events[1:]],
    )  # fmt: skip
    found = read_sessions(tmp_path / "quick", study).participants

    assert (found.consented, found.completed, found.analysed) == (3, 3, 2)
    assert sum(found.left_out.values()) == 1
    assert "single trials" in next(iter(found.left_out))


def test_where_no_consent_is_asked_everyone_took_part(study, write_journals, tmp_path):
    private = study.privacy.model_copy(update={"consent_required": False})
    study = study.model_copy(update={"privacy": private})
    write_journals(tmp_path, people=2, study=study)
    changed(tmp_path, "P01", lambda events: [e for e in events if not isinstance(e, Consent)])
    changed(tmp_path, "P02", lambda events: [e for e in events if not isinstance(e, Consent)])
    found = read_sessions(tmp_path, study).participants

    assert ("took part", "", 2) in found.steps
    assert "consented" not in {step for step, _, _ in found.steps}


def test_choices_are_counted_in_their_order_whatever_the_language(tidy):
    found = tidy.demographics

    assert found["answer"].tolist() == [*CHOICES, "no answer"]
    assert found["participants"].tolist() == [2, 0, 1, 1]
    assert found["analysed"].tolist() == [2, 0, 1, 1]
    assert set(found["asked"]) == {"How old are you?"}


@pytest.mark.slow
def test_the_report_shows_says_and_stores_the_flow(sessions, study, tmp_path):
    with undrawn():
        report_sessions(sessions, study, tmp_path / "r", figure_files="none")
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    stored = json.loads((tmp_path / "r" / "results.json").read_text())["participants"]
    steps = pd.read_csv(tmp_path / "r" / "tables" / "participants.csv")
    asked = pd.read_csv(tmp_path / "r" / "tables" / "demographics.csv")

    assert "Participants, from the first page to the analysis" in page
    assert (
        "9 participants began (withdrew: 1, journal cannot be read: 1, refused consent: 1, ended"
        " before consent: 1), 5 consented, 4 completed the session (stopped: tracker-lost: 1), and"
        " 4 were analysed (left out: fewer than 80 % of the planned trials decided: 1)."
    ) in page
    assert "How old are you?" in page
    assert "of these withdrew" in page
    assert stored["began"] == 9
    assert stored["left_out"] == {"fewer than 80 % of the planned trials decided": 1}
    assert steps["participants"].tolist()[0] == 9
    assert asked["participants"].sum() == 4


def test_a_study_without_choices_has_no_table_of_them(demo_protocol, write_journals, tmp_path):
    english = demo_protocol.text.languages["en"].model_copy(update={"questions": ()})
    text = demo_protocol.text.model_copy(update={"languages": {"en": english}})
    study = demo_protocol.model_copy(update={"text": text})
    tidy = read_sessions(write_journals(tmp_path, people=2, study=study), study)

    assert tidy.demographics.empty
    assert [type(block).__name__ for block in participant_blocks(tidy)] == ["TableBlock"]
