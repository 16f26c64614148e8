"""Schemas of formats for programs, and references for people, a section per class."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import TypeAdapter

from protocols.browser.web_lines import LINE
from protocols.browser.web_study import WebStudy
from protocols.disk.hashing import Json
from protocols.display import Display
from protocols.journal import EVENT
from protocols.manifest import Manifest
from protocols.plan import Plan
from protocols.results import Results
from protocols.script import TrialScript
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import KEY_PATTERN, KEYS_IN_WORDS
from protocols.units import NAME_LENGTH, NAME_PATTERN

_FORMATS: dict[str, tuple[Callable[[], dict[str, Json]], str]] = {
    "study": (TypeAdapter(StudyProtocol).json_schema, "metamerlab study protocol"),
    "display": (TypeAdapter(Display).json_schema, "metamerlab display"),
    "manifest": (TypeAdapter(Manifest).json_schema, "metamerlab manifest of clips"),
    "journal": (EVENT.json_schema, "one line of a metamerlab session journal"),
    "plan": (TypeAdapter(Plan).json_schema, "trials of one participant of a metamerlab study"),
    "script": (TypeAdapter(TrialScript).json_schema, "metamerlab trial, as it is drawn"),
    "web-study": (TypeAdapter(WebStudy).json_schema, "metamerlab study, as a browser runs it"),
    "web-line": (LINE.json_schema, "one line that a browser sends home"),
    "results": (TypeAdapter(Results).json_schema, "results of a metamerlab report"),
}


def schema_names() -> tuple[str, ...]:
    """Return the names of the published formats."""
    return tuple(_FORMATS)


def json_schema(name: str) -> dict[str, Json]:
    """Return the JSON Schema (2020-12) of a format; `KeyError` if there is none of that name."""
    made, title = _FORMATS[name]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **made(),
        "title": title,
    }


@cache
def schema_text(name: str) -> str:
    """Return the content of a published schema file."""
    return json.dumps(json_schema(name), indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def schema_path(name: str) -> Path:
    """Return the path of the published schema of a format."""
    return Path(str(files("protocols"))) / "schemas" / f"{name}.schema.json"


def publish() -> list[Path]:
    """Write every schema file; return those that changed."""
    changed = []
    for name in _FORMATS:
        path, text = schema_path(name), schema_text(name)
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8", newline="\n")
            changed.append(path)
    return changed


Schema: TypeAlias = dict[str, Any]
"""A part of a JSON Schema."""
_BOUNDS = (
    ("exclusiveMinimum", ">"),
    ("minimum", ">="),
    ("exclusiveMaximum", "<"),
    ("maximum", "<="),
)
_NEAR_NOTHING, _MUCH = 0.01, 1000
_SCALAR = "true or false, whole number, number, text"
_TYPES = {
    f"text `{NAME_PATTERN}`": "name",
    f"text `{KEY_PATTERN}`": "key",
    "text `^[0-9a-f]{64}$`": "hash",
    "whole number >= 1": "count",
    "whole number >= 0": "number from 0",
    "degrees > 0, < 180": "angle",
    "share >= 0, <= 1": "share",
    f"{_SCALAR}, list of {_SCALAR}": "values",
    _SCALAR: "value",
}
"""Types that come often, by how they would be written out."""
_MEANINGS = {
    "name": "lower-case letters and digits, in words joined by single `-` or `_`, at most"
    f" {NAME_LENGTH} characters",
    "key": KEYS_IN_WORDS.removeprefix("a key: "),
    "hash": "SHA-256 in 64 hexadecimal digits",
    "count": "whole number above 0",
    "share": "number from 0 to 1",
    "angle": "degrees, above 0 and below 180",
    "value": "true or false, a number, or text",
    "values": "a value, or a list of values",
}
_UNITS = {
    "s": "seconds",
    "µs": "microseconds",
    "Hz": "hertz",
    "deg": "degrees",
    "px": "pixels",
    "mm": "millimetres",
    "m": "metres",
    "MB": "megabytes",
    "cd/m2": "cd/m2",
    "share of 1": "share",
}
_NAMED_OWNERS = 6
_FEW = 3
_MANY = {1: "one or more", 2: "two or more"}
_LEAST_SAVING = 40
"""Words that a section of shared keys must save."""


@dataclass(frozen=True)
class _Row:
    """One key of a class, as it is printed."""

    key: str
    text: str


def reference_text(name: str) -> str:
    """Return the Markdown reference of a format.

    Keys that several classes share are explained once, in a section before the first of these.

    Parameters
    ----------
    name : str
        One of `protocols.formats.format_reference.schema_names`.
    """
    schema: Schema = dict(json_schema(name))
    sections = _in_reading_order(schema)
    rows = {title: [*_rows(section)] for title, section in sections.items()}
    shared = _shared(rows)
    body: list[str] = []
    for title, section in sections.items():
        groups = [owners for owners in shared if title in owners]
        for owners in groups:
            if owners[0] == title:
                body += [
                    "",
                    f"## {_shared_title(owners)}",
                    "",
                    *(row.text for row in shared[owners]),
                ]
        body += ["", f"## {title}", ""]
        if section.get("description"):
            body += [*str(section["description"]).splitlines(), ""]
        taken = {row for owners in groups for row in shared[owners]}
        body += [row.text for row in rows[title] if row not in taken]
        for owners in groups:
            keys = ", ".join(f"`{row.key}`" for row in shared[owners])
            body.append(f"- {keys}: [shared](#{_anchor(_shared_title(owners))})")
    used = [word for word in _MEANINGS if any(_says(line, word) for line in body)]
    return "\n".join([
        f"# Reference: {schema['title']}",
        "",
        f"Made by `metamerlab protocol schema {name} --markdown`. Keys without a default are"
        " required. Unknown keys are refused.",
        *(["", *(f"- *{word}*: {_MEANINGS[word]}" for word in used)] if used else []),
        *body,
    ]).rstrip() + "\n"  # fmt: skip


def _says(line: str, word: str) -> bool:
    """Return True if a line's type has a word of ours."""
    return f" {word}" in line.partition("):")[0].replace("(", " ")


def _in_reading_order(schema: Schema) -> dict[str, Schema]:
    """Return the classes with keys, each after the one that first mentions it."""
    definitions: Schema = schema.get("$defs", {})
    found: dict[str, Schema] = {}
    waiting = [(str(schema["title"]), {k: v for k, v in schema.items() if k != "$defs"})]
    while waiting:
        title, section = waiting.pop(0)
        if title not in found:
            found[title] = section
            waiting = [(name, definitions[name]) for name in _named_in(section)] + waiting
    return {title: section for title, section in found.items() if "properties" in section}


def _named_in(value: object) -> Iterator[str]:
    """Yield the names of the classes that a schema refers to."""
    if isinstance(value, dict):
        if "$ref" in value:
            yield str(value["$ref"]).rpartition("/")[2]
        for key, entry in value.items():
            if key != "discriminator":
                yield from _named_in(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _named_in(entry)


def _rows(section: Schema) -> Iterator[_Row]:
    required = set(section.get("required", []))
    for key, value in section["properties"].items():
        default, said = value.get("default"), ""
        if key not in required and value.get("const", ...) != default:
            plain = default in (None, "", []) or isinstance(default, dict)
            said = "; optional" if plain else f"; default `{toml_text(default)}`"
        meaning = " ".join(str(value.get("description", "")).split())
        kind = _type(value)
        if value.get("default", 0) is None:
            kind = re.sub("(,| or) none$", "", kind)
        yield _Row(key, f"- `{key}` ({kind}{said})" + (f": {meaning}" if meaning else ""))


def _shared(rows: dict[str, list[_Row]]) -> dict[tuple[str, ...], list[_Row]]:
    """Return the rows that several classes share, by these classes, where that saves words."""
    owners: dict[_Row, list[str]] = {}
    for title, own in rows.items():
        for row in own:
            owners.setdefault(row, []).append(title)
    found: dict[tuple[str, ...], list[_Row]] = {}
    for row, titles in owners.items():
        if len(titles) > 1:
            found.setdefault(tuple(titles), []).append(row)
    return {
        titles: same
        for titles, same in found.items()
        if sum(len(row.text.split()) for row in same) * (len(titles) - 1)
        - len(titles) * (len(same) + 3)
        >= _LEAST_SAVING
    }


def _shared_title(owners: tuple[str, ...]) -> str:
    if len(owners) > _NAMED_OWNERS:
        return f"Shared by {owners[0]} and {len(owners) - 1} others"
    return f"Shared by {', '.join(owners[:-1])} and {owners[-1]}"


def _anchor(heading: str) -> str:
    """Return the anchor that GitHub gives a heading."""
    return heading.lower().replace(",", "").replace(" ", "-")


def toml_text(value: object) -> str:
    """Return a value as a study file writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml_text(entry)}" for key, entry in value.items()) + "}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _type(schema: Schema) -> str:
    """Return a type in words, with unit and range."""
    written = _written_out(schema)
    for text, word in _TYPES.items():
        written = written.replace(text, word)
    return written


def bounds_in_words(schema: Schema) -> list[str]:
    """Return the bounds of a number that somebody may meet, such as ``<= 1`` of a share.

    Of those that only keep mistakes out, a smallest one is said as ``> 0``, and none else.
    """
    bounds = []
    for key, sign in _BOUNDS:
        value = schema.get(key)
        if value is None or abs(value) >= _MUCH:
            continue
        tiny = key == "minimum" and 0 < value <= _NEAR_NOTHING
        bounds.append("> 0" if tiny else f"{sign} {value:g}")
    return bounds


def _written_out(schema: Schema) -> str:
    if "$ref" in schema:
        name = str(schema["$ref"]).rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf"):
        if key in schema:
            parts = list(dict.fromkeys(_written_out(part) for part in schema[key]))
            return (", " if len(parts) > _FEW else " or ").join(parts)
    if "const" in schema:
        return f"`{toml_text(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{toml_text(entry)}`" for entry in schema["enum"])
    kind = schema.get("type")
    if kind == "array":
        if "prefixItems" in schema:
            parts = [_written_out(part) for part in schema["prefixItems"]]
            same = len([*takewhile(lambda part: part == parts[0], parts)]) == len(parts)
            return f"{len(parts)} x {parts[0]}" if same else "list of " + " and ".join(parts)
        entry = schema.get("items", {})
        many = _MANY.get(schema.get("minItems", 0)) if entry.get("type") != "array" else None
        return f"{many or 'list of'} {_written_out(entry)}"
    if kind == "object":
        entries: object = schema.get("additionalProperties") or next(
            iter(schema.get("patternProperties", {}).values()), {}
        )
        return f"table of {_written_out(entries)}" if isinstance(entries, dict) else "table"
    words = {
        "string": "text",
        "integer": "whole number",
        "number": "number",
        "boolean": "true or false",
        "null": "none",
    }
    bounds = bounds_in_words(schema)
    said = _UNITS[schema["unit"]] if "unit" in schema else words.get(str(kind), "any value")
    pattern = f" `{schema['pattern']}`" if "pattern" in schema else ""
    return f"{said}{pattern}" + (f" {', '.join(bounds)}" if bounds else "")
