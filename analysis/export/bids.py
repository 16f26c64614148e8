"""BIDS 1.11: behaviour, events, and gaze as eye-tracking recordings.

One participant is one `sub-`; every run of the program is one `run-`, since its clock starts at 0
(a resumed session has several). All onsets of a run are seconds on that clock.
"""

from pathlib import Path

import pandas as pd

from analysis.data_dictionary import SESSION_COLUMNS, attempt_columns
from analysis.export.bids_events import (
    EVENT_COLUMNS,
    column_docs,
    event_kinds,
    event_rows,
    told,
    write_tsv,
)
from analysis.export.bids_gaze import write_gaze
from analysis.export.export_content import (
    ExportedStudy,
    Person,
    Run,
    generated_by,
    label,
    write_json,
)
from analysis.export.public import gaze_source, scrub, system
from protocols.columns import Column
from protocols.disk.hashing import Json, sha256_json
from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import SessionStart
from protocols.outside import markdown, page_bytes

VERSION = "1.11.1"
_NOT_IN_BEH = ("session", "participant", "simulated", "remote")
_NOT_OF_PEOPLE = ("session", "participant", "protocol_sha256", "stimuli_sha256")


def write_bids(content: ExportedStudy, folder: Path) -> tuple[str, ...]:
    """Write the data set; return what is odd about gaze files.

    Raises
    ------
    StudyError
        If the display file of a session is not among the options' displays.
    """
    displays = {person.code: _display(content, person) for person in content.people}
    notes: list[str] = []
    for number, person in enumerate(content.people):
        content.progress("writing participants", number, len(content.people))
        for run in person.runs:
            notes += _write_run(content, folder, person, run, displays[person.code])
    content.progress("writing participants", len(content.people), len(content.people))
    _write_people(content, folder)
    _write_answers(content, folder)
    _write_stimuli(content, folder)
    write_json(folder / "dataset_description.json", _description(content))
    readme = content.readme(
        "`beh/` of each participant holds, for every run of the program (a session that was resumed"
        " has several), a table of attempts (`_beh.tsv`), what was shown when (`_events.tsv`), and,"
        " where gaze was stored, its samples (`_physio.tsv.gz`). Gaze is recorded during attempts"
        " only: go by the column `timestamp`, not by the sampling rate. `stimuli/clips.tsv` lists"
        " the clips with their hashes; their pixels are not part of this data set.",
        *(() if content.public else _odd(content.tables.warnings)),
    )
    (folder / "README.md").write_bytes(page_bytes(readme))
    return tuple(notes)


def subject(person: Person) -> str:
    """Return ``sub-LABEL``; '-' and '_' of a code become '+' and '++', so that codes stay apart."""
    return "sub-" + person.code.replace("-", "+").replace("_", "++")


def _write_run(
    content: ExportedStudy, folder: Path, person: Person, run: Run, display: Display
) -> list[str]:
    task = label(content.study.study.name)
    stem = f"{subject(person)}_task-{task}_run-{run.number}"
    beh = folder / subject(person) / "beh"
    beh.mkdir(parents=True, exist_ok=True)
    about = _about(content, person, run, display)
    rows = event_rows(run, public=content.public, left_out=content.left_out)
    described = [column for column in EVENT_COLUMNS if column.name in rows[0]]
    write_tsv(beh / f"{stem}_events.tsv", pd.DataFrame(rows, dtype=object), described)
    kinds = {"trial_type": event_kinds(run)}
    write_json(beh / f"{stem}_events.json", about | column_docs(described, kinds))
    attempts = content.tables.attempts
    mine = attempts[attempts["participant"] == person.code]
    table = mine
    if "position" in mine:
        numbers = {attempt.position for attempt in run.attempts}
        table = mine[[int(position) in numbers for position in mine["position"]]]
    if len(table):
        known = attempt_columns(content.study)
        columns = [c for c in known if c.name in table and c.name not in _NOT_IN_BEH]
        write_tsv(beh / f"{stem}_beh.tsv", table, columns)
        write_json(beh / f"{stem}_beh.json", about | column_docs(columns))
    return write_gaze(content, beh, stem, person, run)


def _about(content: ExportedStudy, person: Person, run: Run, display: Display) -> dict[str, Json]:
    """Return the fields of a whole run: the task, and the screen."""
    start, study = person.reading.start, content.study
    texts = study.text.languages.get(start.language)
    found: dict[str, Json] = {
        "TaskName": study.study.name,
        "TaskDescription": content.description,
    }
    if texts is not None:
        found["Instructions"] = scrub("\n".join(texts.instructions), public=content.public)
    screen: dict[str, Json] = {
        "ScreenDistance": display.distance_mm / 1000,
        "ScreenOrigin": ["top", "left"],
        "ScreenRefreshRate": run.refresh_hz,
        "ScreenResolution": [display.width_px, display.height_px],
        "ScreenSize": [display.width_mm / 1000, display.height_mm / 1000],
        "SoftwareName": "metamerlab",
        "SoftwareVersion": str(content.tables.sessions["revision"].iloc[0])
        if content.public  # of all sessions together
        else run.opening.revision,
        "OperatingSystem": system(start.platform, public=content.public),
    }
    return found | {"StimulusPresentation": screen}


def _display(content: ExportedStudy, person: Person) -> Display:
    start = person.reading.start
    for given in content.options.displays:
        display = given.at_rate(start.refresh_hz, 0.0) if start.remote else given
        if sha256_json(display) == start.display_sha256:
            return display
    known = ", ".join(display.name for display in content.options.displays) or "none"
    raise StudyError(
        f"{person.reading.name}: BIDS needs the display that it was recorded on, {start.display!r}"
        f" with hash {start.display_sha256[:12]} (given: {known}); name its file, as it was then,"
        " with --display"
    )


def _write_people(content: ExportedStudy, folder: Path) -> None:
    table = content.tables.sessions.copy()
    by_code = {person.code: person for person in content.people}
    people = [by_code[code] for code in table["participant"]]
    extra = {
        "participant_id": [subject(person) for person in people],
        "code": list(table["participant"]),
        "species": ["n/a" if content.tables.simulated else "homo sapiens" for _ in people],
        "language": [person.reading.start.language for person in people],
        "gaze_source": [_source(person.reading.start, content) for person in people],
        "runs": [len(person.runs) for person in people],
    }
    columns = [
        told("participant_id", "Participant, as in the names of folders"),
        told("code", "Pseudonymous code"),
        told("species", "Species of the participant; not given for artificial observers"),
        told("language", "Language of the session"),
        told("gaze_source", "Source of gaze; 'none' where it was not watched"),
        told("runs", "Runs of the program in this session"),
        *(c for c in SESSION_COLUMNS if c.name not in _NOT_OF_PEOPLE and c.name in table),
    ]
    write_tsv(folder / "participants.tsv", table.assign(**extra), columns)
    write_json(folder / "participants.json", column_docs(columns[1:]))


def _source(start: SessionStart, content: ExportedStudy) -> str:
    return gaze_source(start.gaze.source, public=content.public) if start.gaze else "none"


def _write_answers(content: ExportedStudy, folder: Path) -> None:
    """Write the closing questions as a measurement tool, one column per question."""
    answers = content.tables.answers
    if answers.empty:
        return
    names = {person.code: subject(person) for person in content.people}
    wide = answers.drop_duplicates(["participant", "question"], keep="last").pivot(
        index="participant", columns="question", values="text"
    )
    wide.insert(0, "participant_id", [names[str(code)] for code in wide.index])
    asked = {
        question.name: question.text
        for texts in content.study.text.languages.values()
        for question in texts.questions
    }
    default = content.study.text.languages[content.study.text.default_language]
    asked |= {question.name: question.text for question in default.questions}
    columns = [told("participant_id", "Participant")] + [
        told(str(name), scrub(asked.get(str(name), str(name)), public=content.public))
        for name in wide.columns[1:]
    ]
    (folder / "phenotype").mkdir()
    write_tsv(folder / "phenotype" / "closing_questions.tsv", wide, columns)
    tool: dict[str, Json] = {
        "MeasurementToolMetadata": {"Description": "Questions asked after the last trial"}
    }
    write_json(
        folder / "phenotype" / "closing_questions.json",
        tool | column_docs(columns[1:]),
    )


def _write_stimuli(content: ExportedStudy, folder: Path) -> None:
    """List every stimulus that was shown to anybody."""
    shown = {
        stimulus.name: stimulus
        for person in content.people
        for attempt in person.reading.journal.attempts
        for stimulus in attempt.stimuli
    }
    recipe = content.study.stimuli
    pool = [entry for entry in recipe.pool() if entry.name in shown]
    if not pool:
        return
    rows = []
    for entry in pool:
        stimulus = shown[entry.name]
        rows.append(
            {
                "stimulus": entry.name,
                **entry.condition,
                "stimulus_sha256": stimulus.sha256,
                "frames": stimulus.frames_planned,
                "fps": recipe.frame_hz if recipe.frames > 1 else None,
            }
        )
    columns = [
        told("stimulus", "Its name"),
        *(told(name, "Column of the stimuli's conditions") for name in recipe.columns()),
        told("stimulus_sha256", "SHA-256 over the hashes of its frames, as in the manifest"),
        told("frames", "Frames; a still has one"),
        Column("fps", "number", "Hz", "Frames per second; n/a for stills"),
    ]
    (folder / "stimuli").mkdir()
    write_tsv(folder / "stimuli" / "clips.tsv", pd.DataFrame(rows), columns)
    write_json(folder / "stimuli" / "clips.json", column_docs(columns))


def _description(content: ExportedStudy) -> dict[str, Json]:
    found: dict[str, Json] = {
        "Name": content.title,
        "BIDSVersion": VERSION,
        "DatasetType": "raw",
    }
    if content.options.licence:
        found["License"] = content.options.licence
    if content.options.authors:
        found["Authors"] = list(content.options.authors)
    if content.source:
        found["ReferencesAndLinks"] = [content.source]
    return found | {"GeneratedBy": generated_by()}


def _odd(warnings: tuple[str, ...]) -> tuple[str, ...]:
    if not warnings:
        return ()
    return (
        "What is odd about these data:",
        "\n".join(f"- {markdown(warning)}" for warning in warnings),
    )
