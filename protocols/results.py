"""The file `results.json` of a report: every number, by part."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from protocols.errors import StudyError
from protocols.outside import bounded_bytes, parsed_json
from protocols.units import Model

FORMAT = 2
NAME = "results.json"
Row = dict[str, Any]


class Results(Model):
    """Every number of a report. Numbers that are not finite are null."""

    format: Literal[2]
    simulated: bool
    """Some of the data are of artificial observers."""
    settings: Row
    """The section `[analysis]`, or what the table was told, and what else the parts read."""
    results: dict[str, Row]
    """The numbers of each part of the report, by its name; a part that could not be had is not
    there. Installed packages add parts of their own."""
    deciding: dict[str, list[str]] | None = None
    """Columns whose p decides, by table in `tables/`; numbers here have the same
    names. Null: of an earlier metamerlab."""
    flow: list[Row]
    """Counts of what each rule of exclusion left out, in order; empty for a table."""
    participants: Row | None = None
    """Counts of participants who began, consented, completed the session and are analysed, and why
    the others are not; null for a table."""
    without_exclusions: Row | None
    """The main numbers with and without exclusions; null: nothing was left out."""
    sessions: list[Row]
    """A row per session, as in `sessions.csv`; empty for a table."""
    warnings: list[str]
    """Notes on what is odd about the data as a whole, and why a number is not there."""
    provenance: Row
    """Hashes, versions and seeds that the numbers depend on."""


def read_results(path: Path) -> Results:
    """Read such a file.

    Raises
    ------
    StudyError
        If it is none, or of an earlier metamerlab.
    FileNotFoundError
        If it is not there.
    """
    must = "the results.json of a report"
    found = parsed_json(path, bounded_bytes(path, StudyError), must, StudyError)
    if not isinstance(found, dict) or "format" not in found:
        raise StudyError(f"{path}: must be {must}")
    if found["format"] != FORMAT:
        raise StudyError(
            f"{path}: format must be {FORMAT} (got {found['format']!r}, of another metamerlab);"
            " write the report anew with 'metamerlab analysis report'"
        )
    try:
        return Results.model_validate(found)
    except ValidationError as problem:
        place = ".".join(map(str, problem.errors()[0]["loc"]))
        raise StudyError(f"{path}: must be {must} ({place} is not as its format says)") from None
