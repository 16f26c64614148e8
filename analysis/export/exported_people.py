"""Participants who are exported, and the name of each."""

from dataclasses import dataclass

from analysis.journals import JournalReading, StudyReadings
from protocols.disk.hashing import sha256_bytes
from protocols.journal import (
    AnyEvent,
    Attempt,
    Consent,
    SessionResume,
    SessionStart,
)
from protocols.study_file.schema import StudyProtocol


@dataclass(frozen=True)
class Run:
    """Record of one run of the program; its clock starts at 0."""

    number: int
    """From 1; a resumed session has several."""
    opening: SessionStart | SessionResume
    events: tuple[AnyEvent, ...]

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        """Every attempt of this run, in order."""
        return tuple(event for event in self.events if isinstance(event, Attempt))


@dataclass(frozen=True)
class Person:
    """A participant's session, under the name the export gives."""

    code: str
    """Participant code: as recorded, or its number in a public export."""
    reading: JournalReading
    runs: tuple[Run, ...]


def people_of(
    study: StudyReadings, protocol: StudyProtocol, *, public: bool
) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return everyone who may be exported, and what is to be said of the others.

    Withdrawn participants are no readings at all. Where the protocol asks for consent, a session
    whose journal does not hold it is left out. A public export numbers people anew, in an order
    that says neither when they came nor what they were called: it follows from what they did.
    """
    kept, notes = [], []
    for reading in study.readings:
        if protocol.privacy.consent_required and not _agreed(reading.journal.events):
            notes.append(f"{reading.name}: left out, its journal holds no consent")
            continue
        kept.append(reading)
    if public:
        kept.sort(key=drawn)
    width = max(3, len(str(len(kept))))
    people = tuple(
        Person(
            f"P{number:0{width}d}" if public else reading.start.participant,
            reading,
            runs_of(reading),
        )
        for number, reading in enumerate(kept, start=1)
    )
    return people, tuple(notes)


def drawn(reading: JournalReading) -> str:
    """Return the key that sorts participants: nobody can compute it without the journal."""
    return sha256_bytes(b"order of participants\0" + reading.journal.path.read_bytes())


def runs_of(reading: JournalReading) -> tuple[Run, ...]:
    """Return a journal's events by runs of the program."""
    runs: list[tuple[SessionStart | SessionResume, list[AnyEvent]]] = []
    for event in reading.journal.events:
        if isinstance(event, SessionStart | SessionResume):
            runs.append((event, []))
        if runs:  # what stands before the header has no clock
            runs[-1][1].append(event)
    return tuple(
        Run(number, opening, tuple(events)) for number, (opening, events) in enumerate(runs, 1)
    )


def _agreed(events: tuple[AnyEvent, ...]) -> bool:
    answers = [event.agreed for event in events if isinstance(event, Consent)]
    return bool(answers) and all(answers)
