"""Reads the journals of one study: what tables, reports and exports are made from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from protocols.against_plan import contradictions, plan_of
from protocols.browser.shared_links import session_marks, shared_links
from protocols.errors import StudyError
from protocols.journal import SessionStart
from protocols.journal_file import (
    DamagedLine,
    Journal,
    SideFiles,
    check_side_files,
    find_journals,
    read_journal,
)
from protocols.plugins import culprit
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.pairs import PairTask
from protocols.tasks.task_kinds import check_row

Progress = Callable[[str, int, int], None]
"""Told what is done, how much of it, and of how much; 0 where no end is known."""

COPIED_ATTEMPTS = 3
"""Fewer attempts than these may well look alike."""


@dataclass(frozen=True)
class JournalReading:
    """One session's journal, read past damage."""

    name: str
    """Its folder, relative to the folder that was searched."""
    journal: Journal
    """Without attempts that contradict the plan: they are among its damaged lines."""
    start: SessionStart
    planned: bool
    """True if the plan comes out as the session had it, so that attempts were compared with it."""
    files: SideFiles
    """The files beside the journal, held to their hashes."""


@dataclass(frozen=True)
class StudyReadings:
    """Every readable session of a study whose participant did not withdraw."""

    readings: tuple[JournalReading, ...]
    notes: tuple[str, ...]
    """Notes on what was left out, each with its reason."""
    withdrew: int = 0
    unreadable: int = 0
    """Sessions of whose journal the header cannot be read."""

    @property
    def simulated(self) -> bool:
        """True if artificial observers answered."""
        return self.readings[0].start.simulated


def read_study(
    folder: Path, study: StudyProtocol, *, progress: Progress | None = None
) -> StudyReadings:
    """Read every journal below `folder`.

    Raises
    ------
    StudyError
        If there is no journal, journals belong to another protocol or to several, one
        participant appears twice, or simulated and recorded sessions are mixed.
    """
    paths = find_journals(folder)
    if not paths:
        raise StudyError(
            f"{folder}: must hold at least one session (no journal.jsonl was found);"
            " name the folder that holds the recorded sessions"
        )
    readings: list[JournalReading] = []
    notes: list[str] = []
    withdrew = unreadable = 0
    for number, path in enumerate(paths):
        if progress:
            progress("reading journals", number, len(paths))
        name = path.parent.relative_to(folder).as_posix()
        name = folder.resolve().name if name == "." else name
        journal = read_journal(path, lenient=True)
        if journal.withdrawn:
            notes.append(f"{name}: the participant withdrew; nothing of theirs is used")
            withdrew += 1
            continue
        starts = [event for event in journal.events if isinstance(event, SessionStart)]
        if not starts:
            notes.append(f"{name}: left out, its first line (the header) cannot be read")
            unreadable += 1
            continue
        readings.append(JournalReading(name, journal, starts[0], False, SideFiles(0, ())))
    if progress:
        progress("reading journals", len(paths), len(paths))
    if not readings:
        raise StudyError(
            f"{folder}: must hold at least one readable session"
            f" (none of {len(paths)} journals can be used): " + "; ".join(notes)
        )
    _check_one_study(folder, readings, study)
    notes += _note_manifests(readings)
    notes += _note_shared_links(readings)
    for number, reading in enumerate(readings):
        if progress:
            progress("checking what was recorded", number, len(readings))
        readings[number] = _checked(reading, study)
    if progress:
        progress("checking what was recorded", len(readings), len(readings))
    every = (*notes, *_not_vouched_for(readings))
    return StudyReadings(tuple(readings), every, withdrew, unreadable)


def _checked(reading: JournalReading, study: StudyProtocol) -> JournalReading:
    """Return a session compared with its plan and its files."""
    journal = reading.journal
    plan = plan_of(study, reading.start)
    made = frozenset(entry.name for entry in study.stimuli.pool())
    wrong: dict[int, str] = {}
    if plan is not None:
        wrong = {
            attempt.n: reason for attempt, reason in contradictions(study, plan, journal.attempts)
        }
    for attempt in journal.attempts:
        if attempt.n in wrong:
            continue
        try:
            row = study.task.row(attempt)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            if plan is not None and (said := culprit(error)):  # the attempt is as planned
                raise StudyError(said) from error
            wrong[attempt.n] = f"{attempt.trial}: must be a trial of the study's task ({error!r})"
            continue
        check_row(study.task, study.pool, row)
        if unknown := _unknown(study, row, attempt.stimulus_names, made):
            wrong[attempt.n] = f"{attempt.trial}: {unknown}"
    if wrong:
        journal = replace(
            journal,
            events=tuple(event for event in journal.events if event.n not in wrong),
            damaged=(
                *journal.damaged,
                *(DamagedLine(number + 1, reason) for number, reason in wrong.items()),
            ),
        )
    files = check_side_files(reading.journal)
    return replace(reading, journal=journal, planned=plan is not None, files=files)


def _unknown(
    study: StudyProtocol, row: Mapping[str, object], shown: Sequence[str], made: frozenset[str]
) -> str:
    """Return the part of an attempt that the study does not have; nothing where all is known.

    The plan tells more, where it comes out as it was recorded.
    """
    task = study.task
    if isinstance(task, PairTask):
        known = tuple(map(str, study.stimuli.values(task.compare)))
        for side in ("first", "second"):
            if row[side] not in known:
                return f"{side} must be one of {', '.join(known)} (got {row[side]})"
    return next(
        (f"stimuli must be the study's (got {name})" for name in shown if name not in made), ""
    )


def _not_vouched_for(readings: Sequence[JournalReading]) -> list[str]:
    """Return notes on checks that were impossible, and on files that are not as recorded."""
    notes = []
    if bare := [reading.name for reading in readings if reading.journal.unchecked]:
        notes.append(
            f"{_named(bare)}: written without checksums, by an older version; a change to such"
            " lines may go unnoticed"
        )
    if other := [reading.name for reading in readings if not reading.planned]:
        notes.append(
            f"{_named(other)}: trials are not compared with the plan, which comes out otherwise"
            " than it was recorded, or needs the study's secret"
        )
    for reading in readings:
        wrong = reading.files.wrong
        if wrong:
            listed = ", ".join(f"{entry.file} {entry.reason}" for entry in wrong[:3])
            more = f", and {len(wrong) - 3} more" if len(wrong) > 3 else ""
            notes.append(
                f"{reading.name}: {len(wrong)} of {reading.files.checked} files beside the journal"
                f" are not as they were recorded: {listed}{more}"
            )
    return notes


def _named(names: Sequence[str]) -> str:
    if len(names) <= 3:
        return ", ".join(names)
    return f"{', '.join(names[:3])} and {len(names) - 3} more sessions"


def _check_one_study(
    folder: Path, readings: Sequence[JournalReading], study: StudyProtocol
) -> None:
    hashes: dict[str, list[str]] = {}
    for reading in readings:
        hashes.setdefault(reading.start.protocol_sha256, []).append(reading.name)
    if len(hashes) > 1:
        raise StudyError(
            f"{folder}: all sessions must follow one protocol (found {len(hashes)}:"
            f" {_each(hashes)}); analyse each study separately"
        )
    (digest,) = hashes
    if digest != study.sha256:
        raise StudyError(
            f"{folder}: sessions must follow the protocol given ({study.study.name},"
            f" {study.sha256[:12]}…) (got {digest[:12]}…); give the protocol file as it was"
            " when the sessions were recorded"
        )
    kinds = {reading.start.simulated for reading in readings}
    if len(kinds) > 1:
        simulated = [reading.name for reading in readings if reading.start.simulated]
        raise StudyError(
            f"{folder}: simulated and recorded sessions must not be mixed"
            f" (simulated: {', '.join(simulated[:5])}); keep them in separate folders"
        )
    people: dict[str, str] = {}
    for reading in readings:
        # Last: two studies or a simulation may well share a participant's code.
        code = reading.start.participant
        if code in people:
            raise StudyError(
                f"{folder}: every participant must have one session (got {code!r} in"
                f" {people[code]} and {reading.name}); move the copy out of this folder"
            )
        people[code] = reading.name
    _check_no_copy(folder, readings)


def _check_no_copy(folder: Path, readings: Sequence[JournalReading]) -> None:
    """Refuse one session under two codes: no two people answer at the same microseconds."""
    seen: dict[tuple[object, ...], str] = {}
    for reading in readings:
        told = tuple(
            (attempt.at, attempt.trial, *attempt.condition.values(), attempt.answer, attempt.rt_s)
            for attempt in reading.journal.attempts
        )
        if len(told) >= COPIED_ATTEMPTS and told in seen:
            raise StudyError(
                f"{folder}: every session must be recorded once (all {len(told)} attempts of"
                f" {reading.name} equal those of {seen[told]}, under another code); move the copy"
                " out of this folder"
            )
        seen[told] = reading.name


def _note_manifests(readings: Sequence[JournalReading]) -> list[str]:
    """Return a note for sessions that were shown different stimuli."""
    made: dict[str, list[str]] = {}
    for reading in readings:
        made.setdefault(reading.start.manifest_sha256, []).append(reading.name)
    if len(made) < 2:
        return []
    return [
        f"sessions used stimuli of {len(made)} different manifests ({_each(made)}): make sure that"
        " they may be taken together"
    ]


def _note_shared_links(readings: Sequence[JournalReading]) -> list[str]:
    """Return a note for each group of participants in browsers who share a link."""
    marks = {
        reading.start.participant: session_marks(reading.start, reading.journal.path.parent)
        for reading in readings
    }
    return [
        f"{shared}: one person may have taken part more than once, or a link was given to several"
        for shared in shared_links(marks)
    ]


def _each(hashes: Mapping[str, Sequence[str]]) -> str:
    """Return hashes, and a session that has each."""
    return "; ".join(
        f"{digest[:12]}… in {names[0]}" + (f" and {len(names) - 1} more" * (len(names) > 1))
        for digest, names in sorted(hashes.items())
    )
