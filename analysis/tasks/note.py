"""Which task a table of decisions is of: a small JSON file beside it, of the same name."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from analysis.tasks import analysis_of
from analysis.tasks.base import TableOptions
from protocols.errors import StudyError
from protocols.outside import json_bytes, parsed_json
from protocols.problems import problems_of
from protocols.read_file import read_bytes
from protocols.suggest import did_you_mean

FORMAT = 1


def note_path(table: Path) -> Path:
    """Return where the note of a table lies: ``decisions.json`` of ``decisions.csv``."""
    return table.with_suffix(".json")


def write_note(table: Path, kind: str, options: TableOptions) -> None:
    """Say beside a table by which analysis, and how, it is to be read."""
    content = {
        "format": FORMAT,
        "table": table.name,
        "analysis": {"kind": kind, **options.model_dump(mode="json")},
    }
    text = json.dumps(content, indent=1, ensure_ascii=False)
    note_path(table).write_bytes(json_bytes(text + "\n"))


def read_note(table: Path) -> tuple[str, TableOptions] | None:
    """Return kind and options of the analysis that a note names; None where there is no note.

    Raises
    ------
    StudyError
        If the file beside the table is no note, or says what cannot be.
    """
    path = note_path(table)
    if not path.is_file():
        return None
    must = "what 'metamerlab analysis import' notes of the table beside it"
    cure = "move it away, or import the table anew"
    content = parsed_json(path, read_bytes(path, "the note"), must, StudyError, cure)
    try:
        said = dict(content["analysis"])
        kind = str(said.pop("kind"))
        known = content["format"] == FORMAT
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{path}: must be {must}; {cure}") from None
    if not known:
        raise StudyError(f"{path}: format must be {FORMAT} (got {content['format']!r})")
    return kind, _checked(kind, said, f"{path}: analysis")


def options_from(kind: str, texts: Mapping[str, str]) -> TableOptions:
    """Return the options of an analysis from texts, as a command line gives them.

    Raises
    ------
    StudyError
        If a key is unknown, or a value cannot be.
    """
    values: dict[str, Any] = {}
    for key, text in texts.items():
        name, dot, part = key.partition(".")
        if dot:  # label.ours=Our method
            values.setdefault(name, {})[part] = text.strip("\"'")
        else:
            values[name] = _value(text)
    return _checked(kind, values, "--set")


def _value(text: str) -> object:
    """Return a number, true or false, or a text."""
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
    return value if isinstance(value, bool | int | float) else text.strip("\"'")


def _checked(kind: str, values: Mapping[str, Any], place: str) -> TableOptions:
    model = analysis_of(kind).options
    known = list(model.model_fields)
    for key in values:
        if key not in known:
            raise StudyError(
                f"{place}: must have keys of the analysis {kind!r} ({', '.join(known)})"
                f" (got {key!r}){did_you_mean(key, known)}"
            )
    try:
        return model.model_validate(values)
    except ValidationError as error:
        problems = problems_of(error, dict(values), model)
        raise StudyError("\n".join(f"{place} {problem}" for problem in problems)) from None
