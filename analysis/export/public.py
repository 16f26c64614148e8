"""Private data that a public export must not hold, and how they are kept out.

Every field is taken over by name. What is free text in a journal is left out, or let through only
where it is one of the words we know. `refuse_private` then reads the finished files again.
"""

import gzip
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pandas as pd

from analysis.journals import StudyReadings
from analysis.tidy import TidyTables
from protocols.disk.hashing import Chance
from protocols.errors import StudyError
from protocols.journal import Attempt
from protocols.study_file.schema import StudyProtocol

OTHER = "other"
"""Stands for a word that only its lab knows."""
LEFT_OUT = "[left out]"
_SYSTEMS = ("Linux", "Windows", "macOS", "Darwin")
_SOURCES = ("eyelink", "gazepoint", "lsl", "mouse", "pupil", "replay", "simulated", "tobii")
"""Gaze sources, also those of recordings by 0.3."""
_EVIDENCE = ("", "glXGetSyncValuesOML", "fence", "unverified", "software timer", "virtual")
_REVISION = re.compile(
    r"(unknown|[0-9]+(\.[0-9a-z]+)*) (unknown|[0-9a-f]{7,40}(\+dirty|\+unchecked)?)"
)

_FOLDERS = (
    "home|Users|root|mnt|media|tmp|var|opt|srv|run|data|work|scratch|Volumes|export|exports|net|nfs"
    "|nas|usr|etc|afs|gpfs|lustre|storage|share|shares|shared|project|projects|cluster|groups?"
)
_BYTE = r"(?:25[0-5]|2[0-4]\d|1?\d?\d)"
_PRIVATE = re.compile(
    rf"(?<![\w.:/<])/(?:{_FOLDERS})/[^\s\"',;]*"  # a path of Linux or macOS
    r"|(?<!\w)[A-Za-z]:[\\/]+[^\s\"',;]*"  # of Windows
    r"|\\\\+[\w.-]+\\[^\s\"',;]*"  # of a Windows share
    r"|(?<![\w:/.])//[\w.-]+/[^\s\"',;]*"  # the same with slashes
    r"|(?<!\w)(?:file|smb|nfs|afp|sftp|ssh|ftp):/+[^\s\"',;]*"  # an address of a file
    r"|(?<![\w~/])~(?:[A-Za-z_][\w.-]*)?/[^\s\"',;]*"  # of somebody's home
    rf"|(?<![\w.]){_BYTE}(?:\.{_BYTE}){{3}}(?!\w|\.\d)"  # an address of the internet
    r"|[\w.+-]+@[\w-]+(?:\.[\w-]+)+"  # a mail address
)


def scrub(text: str, *, public: bool) -> str:
    """Return a text of the protocol; in public without folders and mail addresses."""
    return _PRIVATE.sub(LEFT_OUT, text) if public else text


def system(platform: str, *, public: bool) -> str:
    """Return the operating system; in public only its family."""
    family = platform.partition("-")[0]
    return platform if not public else family if family in _SYSTEMS else OTHER


def gaze_source(name: str, *, public: bool) -> str:
    """Return the kind of gaze source; in public only kinds that come with metamerlab."""
    return name if not public or name in _SOURCES else OTHER


def _revisions(texts: Iterable[str]) -> str:
    """Return all versions and git revisions: which was whose tells who came before an update."""
    return "; ".join(sorted({t if _REVISION.fullmatch(t) else OTHER for t in texts}))


def choices(study: StudyProtocol, question: str) -> set[str]:
    """Return every choice that a closing question offers, in any language."""
    return {
        choice
        for texts in study.text.languages.values()
        for entry in texts.questions
        if entry.name == question
        for choice in entry.choices
    }


def public_readings(recorded: StudyReadings, study: StudyProtocol) -> StudyReadings:
    """Return sessions whose attempts say no words but those of the study's own conditions."""
    words, names = _words(study), {entry.name for entry in study.stimuli.pool()}

    def known(attempt: Attempt) -> Attempt:
        return attempt.model_copy(
            update={
                "condition": {
                    column: OTHER if isinstance(value, str) and value not in words else value
                    for column, value in attempt.condition.items()
                },
                "track": attempt.track if attempt.track in words else OTHER,
                "stimuli": tuple(
                    shown if shown.name in names else shown.model_copy(update={"name": OTHER})
                    for shown in attempt.stimuli
                ),
            }
        )

    readings = tuple(
        replace(
            reading,
            journal=replace(
                reading.journal,
                events=tuple(
                    known(event) if isinstance(event, Attempt) else event
                    for event in reading.journal.events
                ),
            ),
        )
        for reading in recorded.readings
    )
    return replace(recorded, readings=readings)


def _words(study: StudyProtocol) -> set[str | None]:
    """Return every text in the conditions of a study's trials, and the names of its tracks."""
    task = study.task
    rule = task.adaptation
    slots = rule.slots(task, study.pool, Chance("tracks")) if rule else ()
    return {
        None,
        *(slot.track for slot in slots),
        *(
            value
            for cell in study.cells()
            for arrangement in cell.arrangements
            for value in arrangement.condition.values()
            if isinstance(value, str)
        ),
    }


def public_tables(tidy: TidyTables, study: StudyProtocol, codes: dict[str, str]) -> TidyTables:
    """Return tidy tables without wall-clock times, folders, typed answers and private words.

    Parameters
    ----------
    tidy : TidyTables
        Tables of everyone who is exported.
    study : StudyProtocol
        Says which answers were offered, not typed.
    codes : dict
        Name of a participant in the export, by participant code.
    """
    told = ["slot", "plan_sha256", "unchecked_lines"]
    sessions = _renamed(tidy.sessions.drop(columns=told), codes)
    sessions["revision"] = _revisions(sessions["revision"])
    told_evidence = sessions["timing_evidence"].isin(_EVIDENCE)
    sessions["timing_evidence"] = sessions["timing_evidence"].where(told_evidence, OTHER)
    asked = zip(tidy.answers["question"], tidy.answers["text"], strict=True)
    said = tidy.answers.assign(text=[scrub(text, public=True) for text in tidy.answers["text"]])
    offered = pd.Series(
        [text in choices(study, question) for question, text in asked],
        index=tidy.answers.index,
        dtype=bool,
    )
    return replace(
        tidy,
        sessions=sessions,
        attempts=_renamed(tidy.attempts.drop(columns="at"), codes),
        decisions=_renamed(tidy.decisions, codes),
        answers=_renamed(said[offered], codes),
    )


def refuse_private(folder: Path, shown_as: Path) -> None:
    """Read every file of a finished public export, and refuse folders and addresses in it.

    Raises
    ------
    StudyError
        Naming the file and what was found.
    """
    for path in sorted(folder.rglob("*")):
        if not path.is_file():
            continue
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")
        if found := _PRIVATE.search(text):
            raise StudyError(
                f"{shown_as / path.relative_to(folder)}: a public export must name no folder and"
                f" no address (found {found.group()!r}); change --author or --licence"
            )


def _renamed(table: pd.DataFrame, codes: dict[str, str]) -> pd.DataFrame:
    """Return the rows under their new names, in the order of these."""
    named = table.assign(participant=table["participant"].map(codes))
    named["session"] = named["participant"]
    return named.sort_values("participant", kind="stable").reset_index(drop=True)
