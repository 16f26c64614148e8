"""Note of how a table of decisions is read and analysed: a small JSON file of the same name."""

import json
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import get_args

from pydantic import ValidationError

from analysis.plans.table_sections import keys_of, said_of
from analysis.tasks import analysis_of
from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError, did_you_mean
from protocols.gone import gone, without_gone
from protocols.load import with_tuples
from protocols.outside import json_bytes, parsed_json
from protocols.study_file.problems import problems_of
from protocols.tasks.base import Analysis

FORMAT = 2


def note_path(table: Path) -> Path:
    """Return the path of a table's note: ``decisions.json`` of ``decisions.csv``."""
    return table.with_suffix(".json")


def write_note(table: Path, section: Analysis) -> None:
    """Keep beside a table its section: the analysis, and how it is to be read."""
    content = {"format": FORMAT, "table": table.name, "analysis": said_of(section)}
    text = json.dumps(content, indent=1, ensure_ascii=False)
    note_path(table).write_bytes(json_bytes(text + "\n"))


def read_note(table: Path, notes: list[str] | None = None) -> Analysis | None:
    """Return the section in a table's note; None where there is no note.

    A key that was removed since is ignored, which `notes` then says.

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
        kind, found = str(said.pop("kind")), content["format"]
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{path}: must be {must}; {cure}") from None
    if found != FORMAT:
        raise StudyError(
            f"{path}: format must be {FORMAT} (got {found!r}, of another metamerlab); make it anew:"
            f" metamerlab analysis import {table} --task TASK --out FOLDER, or analysis tidy"
        )
    _, ignored = without_gone({"analysis": said})
    if notes is not None:
        notes += [
            f"{path.name}: {place} is ignored: it {gone(place)}"
            for place, value in ignored.items()
            if value  # a note names every key, also those that were left as they are
        ]
    said = {
        key: with_tuples(value) for key, value in said.items() if f"analysis.{key}" not in ignored
    }
    return _checked(kind, said, f"{path}: analysis")


def options_from(kind: str, texts: Mapping[str, str], known: Analysis | None = None) -> Analysis:
    """Return the section of a table from texts, as a command line gives them.

    `known` was told before.

    Raises
    ------
    StudyError
        If a key is unknown, or a value cannot be.
    """
    model = analysis_of(kind).options
    fields = model.model_fields
    values: dict[str, object] = {}
    if known is not None:
        values |= {name: getattr(known, name) for name in keys_of(model)}
    for key, text in texts.items():
        name, dot, part = key.partition(".")
        if dot:  # label.ours=Our method
            held = values.get(name)
            values[name] = {**(held if isinstance(held, dict) else {}), part: text.strip("\"'")}
        else:
            values[name] = _value(text, fields[name].annotation if name in fields else str)
    return _checked(kind, values, "--set")


def _value(text: str, wanted: object) -> object:
    """Return a number, true or false where such are wanted; else the text."""
    if _numeric(wanted):
        with suppress(ValueError, RecursionError):
            value = tomllib.loads(f"value = {text}")["value"]
            if isinstance(value, bool | int | float):
                return value
    return text.strip("\"'")


def _numeric(wanted: object) -> bool:
    return wanted in (bool, int, float) or any(map(_numeric, get_args(wanted)))


def _checked(kind: str, values: Mapping[str, object], place: str) -> Analysis:
    model = analysis_of(kind).options
    known = keys_of(model)
    for key in values:
        if message := gone(f"analysis.{key}"):
            raise StudyError(f"{place} {key}: {message}. Leave it out")
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
