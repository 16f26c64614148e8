"""Reads a study's sessions and writes them as one export, whole or not at all; pwcmp's table."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from analysis.export import ExportOptions, Format
from analysis.export.bids import write_bids
from analysis.export.export_content import ExportedStudy, people_of
from analysis.export.order import (
    refuse_adaptive,
    telling_columns,
    tells_codes,
    tells_order,
    unordered_tables,
    without_columns,
    without_order,
)
from analysis.export.public import public_readings, public_tables, refuse_private
from analysis.journals import Progress, StudyReadings, read_study
from analysis.tables.table_files import write_table
from analysis.tidy import pwcmp_table, tidy_tables
from protocols.disk.result_folder import check_result, whole_folder, without_links
from protocols.errors import StudyError
from protocols.outside import page_bytes
from protocols.study_file.schema import StudyProtocol

NAME = "pwcmp.csv"


def write_pwcmp(content: ExportedStudy, folder: Path) -> tuple[str, ...]:
    """Write the decisions that the protocol's rules keep, and a README."""
    table = pwcmp_table(content.tables.analysed)
    write_table(table, folder / NAME)
    first = "comes first in the alphabet" if content.left_out else "was shown first"
    text = content.readme(
        f"`{NAME}`: one decision per row, main trials that the protocol's exclusion rules keep."
        " `observer` and `session` name the participant; `scene` is scene and amount of"
        " disocclusion, since only clips of one amount were compared; `condition_A`"
        f" {first}; `is_A_selected` is 1 where it was preferred. `scene_name` and `size` are scene"
        " and amount apart; pwcmp passes over them, and `analysis import --map scene=scene_name`"
        " takes them.",
        lists_sessions=False,
    )
    (folder / "README.md").write_bytes(page_bytes(text))
    return ()


_WRITERS: dict[Format, Callable[[ExportedStudy, Path], tuple[str, ...]]] = {
    "bids": write_bids,
    "pwcmp": write_pwcmp,
}


@dataclass(frozen=True)
class Export:
    """Export that was written."""

    folder: Path
    participants: int
    simulated: bool
    notes: tuple[str, ...]
    """Notes on people and data left out, and on what is odd about the rest."""


def export_study(
    sessions: Path,
    study: StudyProtocol,
    out: Path,
    form: Format,
    options: ExportOptions | None = None,
    *,
    progress: Progress = lambda _what, _done, _total: None,
) -> Export:
    """Write every session below `sessions` into the new folder `out`.

    Journals are only read. Withdrawn participants, and those who did not consent, are left out;
    sessions that were cut short are exported as they are, and say so.

    Raises
    ------
    StudyError
        If the sessions are not those of one study and this protocol, nobody may be exported,
        `out` is not empty or lies among the sessions, a BIDS export lacks a display, pwcmp
        cannot take answers of the study's task, or a public export would tell codes.
    """
    options = options or ExportOptions()
    if form == "pwcmp" and study.analysis.kind != "preference":
        raise StudyError(
            f"--format: pwcmp takes preferences between pairs (the task is {study.task.kind!r});"
            " choose bids"
        )
    if without_links(out).is_relative_to(without_links(sessions)):
        raise StudyError(f"{out}: must lie outside the folder of sessions ({sessions})")
    check_result(out)
    recorded = read_study(sessions, study, progress=progress)
    unordered, left_out = None, frozenset[str]()
    if options.public:
        recorded, left_out = public_readings(recorded, study), telling_columns(study)
        if tells_codes(study):
            refuse_adaptive(study)
        if tells_order(study):
            unordered = without_order(recorded, study)
    by_name = {reading.name: reading for reading in recorded.readings}
    recorded = unordered.recorded if unordered else recorded
    people, absent = people_of(recorded, study, public=options.public)
    notes = (*recorded.notes, *absent)
    if not people:
        raise StudyError(
            f"{sessions}: must hold a session that may be exported: " + "; ".join(notes)
        )
    kept = StudyReadings(tuple(by_name[person.reading.name] for person in people), notes)
    tables = tidy_tables(kept, study)
    if unordered:
        tables = unordered_tables(tables, unordered)
    if options.public:
        codes = {person.reading.start.participant: person.code for person in people}
        tables = public_tables(without_columns(tables, left_out), study, codes)
    shifts = unordered.shifts if unordered else None
    content = ExportedStudy(study, people, tables, options, progress, shifts, left_out)
    with whole_folder(out) as work:  # never replaced
        found = _WRITERS[form](content, work)
        if options.public:
            refuse_private(work, out)
    return Export(out, len(people), recorded.simulated, (*tables.warnings, *found))
