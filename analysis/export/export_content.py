"""Study and people as every form of export reads them, and the words that all forms need."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

from analysis.export import ExportOptions
from analysis.export.public import scrub
from analysis.journals import JournalReading, Progress, StudyReadings
from analysis.tidy import TidyTables
from protocols.disk.hashing import Json, sha256_bytes
from protocols.errors import count_of
from protocols.journal import (
    AnyEvent,
    Attempt,
    Consent,
    SessionResume,
    SessionStart,
)
from protocols.outside import json_bytes, markdown
from protocols.revision import code_revision, package_version
from protocols.study_file.schema import StudyProtocol


@dataclass(frozen=True)
class Run:
    """Record of one run of the program; its clock starts at 0."""

    number: int
    """From 1; a resumed session has several."""
    opening: SessionStart | SessionResume
    events: tuple[AnyEvent, ...]
    refresh_hz: float
    """Refresh rate of the display."""

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
    recorded: StudyReadings, study: StudyProtocol, *, public: bool
) -> tuple[tuple[Person, ...], tuple[str, ...]]:
    """Return everyone who may be exported, and what is to be said of the others.

    Withdrawn participants are no readings at all. Where the protocol asks for consent, a session
    whose journal does not hold it is left out. A public export numbers people anew, in an order
    that says neither when they came nor what they were called: it follows from what they did.
    """
    kept, notes = [], []
    for reading in recorded.readings:
        if study.privacy.consent_required and not _agreed(reading.journal.events):
            notes.append(f"{reading.name}: left out, its journal holds no consent")
            continue
        kept.append(reading)
    if public:
        kept.sort(key=sorting_key)
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


def sorting_key(reading: JournalReading) -> str:
    """Return the key that sorts participants: nobody can compute it without the journal."""
    return sha256_bytes(b"order of participants\0" + reading.journal.path.read_bytes())


def runs_of(reading: JournalReading) -> tuple[Run, ...]:
    """Return a journal's events by runs of the program."""
    runs: list[tuple[SessionStart | SessionResume, list[AnyEvent], float]] = []
    rate_hz = 0.0
    for event in reading.journal.events:
        if isinstance(event, SessionStart | SessionResume):
            rate_hz = event.refresh_hz or rate_hz
            runs.append((event, [], rate_hz))
        if runs:  # what stands before the header has no clock
            runs[-1][1].append(event)
    return tuple(
        Run(number, opening, tuple(events), rate_hz)
        for number, (opening, events, rate_hz) in enumerate(runs, 1)
    )


def _agreed(events: tuple[AnyEvent, ...]) -> bool:
    answers = [event.agreed for event in events if isinstance(event, Consent)]
    return bool(answers) and all(answers)


@dataclass(frozen=True)
class ExportedStudy:
    """A study, ready to be written."""

    study: StudyProtocol
    people: tuple[Person, ...]
    tables: TidyTables
    options: ExportOptions
    progress: Progress
    shifts: dict[str, dict[int, float]] | None = None
    """By session and line of an attempt: seconds added to its times, so that the order of trials
    does not show; None: times are as recorded."""
    left_out: frozenset[str] = frozenset()
    """Columns that would tell a participant's place in the counterbalancing."""

    @property
    def public(self) -> bool:
        """True if everything that could tell people and places is left out."""
        return self.options.public

    @property
    def title(self) -> str:
        """The study's title; simulated data says so first."""
        mark = "SIMULATED: " if self.tables.simulated else ""
        return mark + scrub(self.study.study.title, public=self.public)

    @property
    def description(self) -> str:
        """Description of the study, a sentence or two."""
        study = self.study.study
        text = study.description or study.title
        if self.tables.simulated:
            text = "Made by artificial observers; nobody sat there. " + text
        return scrub(text, public=self.public)

    @property
    def source(self) -> str:
        """The publication whose design the study follows; may be empty."""
        return scrub(self.study.study.source, public=self.public)

    def readme(self, *paragraphs: str, lists_sessions: bool = True) -> str:
        """Return a README of the export; `lists_sessions` says if it has a table of them."""
        sessions = self.tables.sessions
        whole = int((sessions["status"] == "completed").sum())
        lines = [
            f"# {markdown(self.title)}",
            markdown(self.description),
            f"{count_of(len(sessions), 'participant')}, {whole} of them with a completed session."
            f" A trial: {self.study.task.description(self.study.pool)}."
            + (
                " Sessions that were cut short are here as they are: see the column `status`."
                if lists_sessions
                else ""
            ),
            *paragraphs,
        ]
        if self.source:
            lines.append(f"Design after: {markdown(self.source)}")
        if self.public:
            lines.append(
                "This is a public version. Participants were numbered anew; wall-clock times,"
                " typed answers, notes, and the names of machines and devices were left out."
            )
        if self.shifts is not None:
            lines.append(
                "The order of trials follows from the participants' codes, or from when they came,"
                " in this study, so it was left out: main trials stand in an order that all"
                " participants share, times begin anew at each, and practice, catch trials, blocks,"
                " repeats and sessions that are not whole are not here."
            )
        if self.left_out:
            lines.append(
                "What came first in a trial, and which key stood for which answer, follow from"
                " when participants came, so they were left out."
            )
        lines += [
            f"Protocol `{self.study.study.name}`, version {self.study.study.version},"
            f" SHA-256 `{self.study.sha256}`. Written by {_program()} from append-only"
            " journals, which stay with the lab"
            + ("; `journal_sha256` names each." if lists_sessions else "."),
        ]
        return "\n\n".join(lines) + "\n"


def generated_by() -> list[Json]:
    """Return the program that wrote the export, as BIDS names it."""
    return [
        {
            "Name": "metamerlab",
            "Version": package_version(),
            "Description": f"git revision {code_revision()}",
        }
    ]


def label(name: str) -> str:
    """Return a name as letters and digits alone, as keywords of file names must be."""
    return re.sub(r"[^A-Za-z0-9]", "", name)


def write_json(path: Path, value: Json) -> None:
    """Write indented JSON, keys in the order given."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(json_bytes(json.dumps(value, indent=2, ensure_ascii=False) + "\n"))


def _program() -> str:
    return f"metamerlab {package_version()} (revision {code_revision()})"
