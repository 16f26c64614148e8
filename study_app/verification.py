"""Proves a session whole: checksums, files, and every attempt against protocol and plan."""

from __future__ import annotations

from dataclasses import dataclass

from protocols.against_plan import contradictions, plan_of
from protocols.errors import StudyError
from protocols.journal import Attempt, SessionStart
from protocols.journal_file import Journal, check_side_files
from protocols.plan import Plan
from protocols.study_file.schema import StudyProtocol
from study_app.session import RunTrial, next_step
from study_app.session_folders import SessionFolder

OTHER_STUDY = "protocol: must be the one that the session began with"


@dataclass(frozen=True)
class SessionFinding:
    """Findings about one session."""

    session: SessionFolder
    files: int
    """Number of files beside the journal that were hashed."""
    problems: tuple[str, ...]
    """Differences from what was recorded; empty: none."""
    notes: tuple[str, ...]
    """Checks that could not be made."""


def verify(session: SessionFolder, study: StudyProtocol | None = None) -> SessionFinding:
    """Check everything that was recorded of a session.

    Parameters
    ----------
    session : SessionFolder
        As it stands on the disk.
    study : StudyProtocol, optional
        Compares every attempt with the plan and, one after the other, with what the session had
        to do next; left out: only checksums and files are checked.

    Raises
    ------
    StudyError
        If a file that is there cannot be read.
    """
    journal = session.journal
    problems = [f"line {line.line}: {line.reason}" for line in journal.damaged]
    notes = []
    if journal.unchecked:
        notes.append(f"{checksums_of(journal)}; a change to the others may go unnoticed")
    if journal.torn:
        notes.append("the last line is unfinished: the program was killed while writing it")
    files = check_side_files(journal)
    problems += [f"{entry.file} {entry.reason}" for entry in files.wrong]
    if study is not None and journal.has_lines and not journal.withdrawn:
        told, left = _compare(journal, study)
        problems, notes = problems + told, notes + left
    return SessionFinding(session, files.checked, tuple(problems), tuple(notes))


def checksums_of(journal: Journal) -> str:
    """Return a sentence on which lines of a journal have a checksum."""
    lines = len(journal.events) + len(journal.damaged)
    if not journal.unchecked:
        return "every line has one"
    if journal.events and journal.events[-1].chain is not None:
        return f"from line {journal.unchecked + 1} on; lines before were written without"
    return f"none of {lines} lines has one: written by an older version"


def _compare(journal: Journal, study: StudyProtocol) -> tuple[list[str], list[str]]:
    """Return the contradictions of the plan, and what could not be compared."""
    start = journal.events[0] if journal.events else None
    if not isinstance(start, SessionStart):
        return [], ["trials are not compared with the plan: the first line is damaged"]
    if start.protocol_sha256 != study.sha256:
        return [f"{OTHER_STUDY} ({start.protocol_sha256[:12]}, got {study.sha256[:12]})"], []
    plan = plan_of(study, start)
    if plan is None:
        return [
            f"the plan must come out as it did (hash {start.plan_sha256[:12]}); verify with the"
            f" study's secret and revision {start.revision}, or see whether code or slot changed"
        ], []
    found = [
        f"line {attempt.n + 1}: {reason}"
        for attempt, reason in contradictions(study, plan, journal.attempts)
    ]
    if found or journal.damaged:
        return found, ["the order of trials is not compared: lines are damaged"]
    return _out_of_order(journal, study, plan, start.language), []


def _out_of_order(journal: Journal, study: StudyProtocol, plan: Plan, language: str) -> list[str]:
    """Return the first attempt that was not what came next after all events before it."""
    for index, event in enumerate(journal.events):
        if not isinstance(event, Attempt):
            continue
        place = f"line {event.n + 1}"
        try:
            step = next_step(study, plan, journal.events[:index], language)
        except (StudyError, StopIteration, KeyError) as error:
            return [f"{place}: cannot follow from the lines before it ({error})"]
        if not isinstance(step, RunTrial):
            return [f"{place}: no trial was due"]
        due = (step.trial.id, step.attempt, step.position)
        if due != (event.trial, event.attempt, event.position):
            return [
                f"{place}: must be {due[0]}, attempt {due[1]}, position {due[2]}"
                f" (got {event.trial}, {event.attempt}, {event.position})"
            ]
        if (step.trial.condition, step.trial.stimuli, step.trial.correct) != (
            event.condition,
            event.stimulus_names,
            event.expected,
        ):
            return [
                f"{place}: {event.trial} must show what follows from the answers before it"
                f" ({', '.join(step.trial.stimuli)}) (got {', '.join(event.stimulus_names)})"
            ]
    return []
