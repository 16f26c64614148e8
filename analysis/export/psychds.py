"""Psych-DS: tidy tables as CSV files whose columns JSON-LD metadata explains.

The rules are those of the Psych-DS schema (https://psych-ds.github.io); tests check them on what
was written.
"""

from pathlib import Path

import pandas as pd

from analysis.data_dictionary import (
    SESSION_COLUMNS,
    attempt_columns,
    decision_columns,
)
from analysis.export.export_content import ExportedStudy, label, write_json
from analysis.tables.write_table import write_table
from protocols.columns import IDENTITY_COLUMNS, Column
from protocols.disk.hashing import Json
from protocols.outside import page_bytes

_ROW = Column("row_id", "text", "", "Names this row; each occurs once in this file")
_ANSWER_COLUMNS = (
    *IDENTITY_COLUMNS,
    Column("question", "text", "", "Name of the closing question"),
    Column("text", "text", "", "Answer as typed or chosen"),
)
_KEYWORDS = ("psychophysics", "image quality", "image warping", "foveated rendering")


def write_psych_ds(content: ExportedStudy, folder: Path) -> tuple[str, ...]:
    """Write the data set.

    Raises
    ------
    RuntimeError
        If what was written breaks a rule of Psych-DS, which would be a mistake of ours.
    """
    tables = content.tables
    study = label(content.protocol.study.name)
    written: dict[str, Column] = {}
    for name, table, columns in (
        ("sittings", tables.sessions, SESSION_COLUMNS),
        ("attempts", tables.attempts, attempt_columns(content.protocol)),
        ("decisions", tables.decisions, decision_columns(content.protocol)),
        ("answers", tables.answers, _ANSWER_COLUMNS),
    ):
        if table.empty:
            continue
        used = (_ROW, *(column for column in columns if column.name in table))
        stem = f"study-{study}_description-{name}_data"
        path = folder / "data" / f"{stem}.csv"
        path.parent.mkdir(exist_ok=True)
        write_table(_with_row_ids(table), path)
        write_json(path.with_suffix(".json"), {"variableMeasured": _variables(used)})
        for column in used:
            written.setdefault(column.name, column)
    write_json(folder / "dataset_description.json", _description(content, tuple(written.values())))
    readme = content.readme(
        "`data/` holds one table each of sessions (`sittings`), attempts (void ones included),"
        " decisions and answers to closing questions. `dataset_description.json`, and"
        " the JSON file beside each table, say what every column means."
    )
    (folder / "README.md").write_bytes(page_bytes(readme))
    return ()


def _with_row_ids(table: pd.DataFrame) -> pd.DataFrame:
    named = table.copy()
    named.insert(0, "row_id", [f"r{number:06d}" for number in range(1, len(table) + 1)])
    return named


def _description(content: ExportedStudy, columns: tuple[Column, ...]) -> dict[str, Json]:
    found: dict[str, Json] = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": content.title,
        "description": content.description,
        "version": content.protocol.study.version,
        "keywords": list(_KEYWORDS),
        "measurementTechnique": f"{content.protocol.task.kind}, with a gaze-fixation gate",
        "variableMeasured": _variables(columns),
    }
    if content.source:
        found["citation"] = content.source
    if content.options.licence:
        found["license"] = content.options.licence
    if content.options.authors:
        found["creator"] = [
            {"@type": "Person", "name": author} for author in content.options.authors
        ]
    return found


def _variables(columns: tuple[Column, ...]) -> list[Json]:
    variables: list[Json] = []
    for column in columns:
        entry: dict[str, Json] = {
            "@type": "PropertyValue",
            "name": column.name,
            "description": f"{column.meaning} ({column.kind})",
        }
        if column.unit:
            entry["unitText"] = column.unit
        variables.append(entry)
    return variables
