"""What the commands on single pictures share: parameters of a method, and places to write to."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from protocols.errors import StudyError


def read_parameters(settings: Sequence[str], methods: Sequence[str]) -> dict[str, Any]:
    """Read ``name=value`` settings: numbers and true or false as such, the rest as text.

    Raises
    ------
    StudyError
        If there are settings and not exactly one method, or one is not ``name=value``.
    """
    if settings and len(methods) > 1:
        raise StudyError("--set needs exactly one --method: whose parameter it is is not clear")
    parameters: dict[str, Any] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or not name:
            raise StudyError(f"--set must be name=value (got {setting!r})")
        try:
            parameters[name] = json.loads(value)
        except json.JSONDecodeError:
            parameters[name] = value
    return parameters


def check_file(path: Path, endings: Sequence[str]) -> None:
    """Refuse before the work a file that could not be written after it.

    Raises
    ------
    StudyError
        If its ending is another, or it is or lies in what is not right.
    """
    if path.suffix.lower() not in endings:
        raise StudyError(f"{path}: must end in {' or '.join(endings)}")
    if path.is_dir():
        raise StudyError(f"{path}: must be a file, and is a folder")
    check_folder(path.parent)


def check_folder(folder: Path) -> None:
    """Refuse a folder that is not there and cannot be made.

    Raises
    ------
    StudyError
        Saying which part of the path stands in the way.
    """
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise StudyError(f"{folder}: must be a folder, and {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise StudyError(f"{folder}: must be writable; change its permissions, or choose another")
