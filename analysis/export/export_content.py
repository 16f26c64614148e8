"""Study as every form of export reads it, and the words that all forms need."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

from analysis.export.choices import ExportOptions
from analysis.export.exported_people import Person
from analysis.export.public import scrub
from analysis.journals import Progress
from analysis.tidy import TidyTables
from protocols.disk.hashing import Json
from protocols.outside import json_bytes, markdown
from protocols.prose import count_of
from protocols.revision import code_revision, package_version
from protocols.study_file.schema import StudyProtocol


@dataclass(frozen=True)
class ExportedStudy:
    """A study, ready to be written."""

    protocol: StudyProtocol
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
        return mark + scrub(self.protocol.study.title, public=self.public)

    @property
    def description(self) -> str:
        """Description of the study, a sentence or two."""
        study = self.protocol.study
        text = study.description or study.title
        if self.tables.simulated:
            text = "Made by artificial observers; nobody sat there. " + text
        return scrub(text, public=self.public)

    @property
    def source(self) -> str:
        """The publication whose design the study follows; may be empty."""
        return scrub(self.protocol.study.source, public=self.public)

    def readme(self, *paragraphs: str, lists_sessions: bool = True) -> str:
        """Return a README of the export; `lists_sessions` says if it has a table of them."""
        sessions = self.tables.sessions
        whole = int((sessions["status"] == "completed").sum())
        lines = [
            f"# {markdown(self.title)}",
            markdown(self.description),
            f"{count_of(len(sessions), 'participant')}, {whole} of them with a completed session."
            f" A trial: {self.protocol.task.description(self.protocol.pool)}."
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
            f"Protocol `{self.protocol.study.name}`, version {self.protocol.study.version},"
            f" SHA-256 `{self.protocol.sha256}`. Written by {_program()} from append-only"
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
