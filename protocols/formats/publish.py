"""The JSON Schema files that editors and other programs read, made from the models."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from pathlib import Path

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
