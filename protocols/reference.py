"""The reference of a format for people: a table per class, made from the published schema."""

from __future__ import annotations

from typing import Any

from protocols.publish import json_schema

_BOUNDS = (
    ("exclusiveMinimum", ">"),
    ("minimum", ">="),
    ("exclusiveMaximum", "<"),
    ("maximum", "<="),
)


def reference_text(name: str) -> str:
    """Return the Markdown reference of a format.

    Parameters
    ----------
    name : str
        One of `protocols.publish.schema_names`.
    """
    schema: dict[str, Any] = dict(json_schema(name))
    definitions: dict[str, Any] = schema.get("$defs", {})
    lines = [
        f"# Reference: {schema['title']}",
        "",
        f"Made by `metamerlab protocol schema {name} --markdown` from the classes that the program"
        " itself reads.",
    ]
    if "properties" in schema:
        lines += _table(str(schema["title"]), schema)
    for title, definition in definitions.items():
        if "properties" in definition:
            lines += _table(title, definition)
    return "\n".join(lines).rstrip() + "\n"


def _table(title: str, schema: dict[str, Any]) -> list[str]:
    required = set(schema.get("required", []))
    lines = ["", f"## {title}", ""]
    if schema.get("description"):
        lines += [*str(schema["description"]).splitlines(), ""]
    lines += ["| field | type | left out | meaning |", "| --- | --- | --- | --- |"]
    for field, value in schema["properties"].items():
        default = "needed" if field in required else f"`{_toml(value.get('default'))}`"
        if field not in required and "default" not in value:
            default = "empty"
        meaning = " ".join(str(value.get("description", "")).split())
        row = (f"`{field}`", _type(value), default, meaning)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
    return lines


def _toml(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + "}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _type(schema: dict[str, Any]) -> str:
    """Return a type in words, with unit and range."""
    if "$ref" in schema:
        name = str(schema["$ref"]).rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf"):
        if key in schema:
            return " or ".join(dict.fromkeys(_type(part) for part in schema[key]))
    if "const" in schema:
        return f"`{_toml(schema['const'])}`"
    if "enum" in schema:
        return " or ".join(f"`{_toml(entry)}`" for entry in schema["enum"])
    kind = schema.get("type")
    if kind == "array":
        if "prefixItems" in schema:
            return "list of " + " and ".join(map(_type, schema["prefixItems"]))
        least = f", at least {schema['minItems']}" if schema.get("minItems") else ""
        return f"list of {_type(schema.get('items', {}))}{least}"
    if kind == "object":
        entries: object = schema.get("additionalProperties") or next(
            iter(schema.get("patternProperties", {}).values()), {}
        )
        return f"table of {_type(entries)}" if isinstance(entries, dict) else "table"
    words = {
        "string": "text",
        "integer": "whole number",
        "number": "number",
        "boolean": "true or false",
        "null": "none",
    }
    bounds = [f"{sign} {schema[key]:g}" for key, sign in _BOUNDS if key in schema]
    unit = f" {schema['unit']}" if "unit" in schema else ""
    pattern = f" `{schema['pattern']}`" if "pattern" in schema else ""
    return f"{words.get(str(kind), 'any value')}{pattern}{unit}" + (
        f" {', '.join(bounds)}" if bounds else ""
    )
