"""Reads protocol and display files: all mistakes at once, with place, value and cure."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from protocols.disk.hashing import sha256_bytes
from protocols.disk.whole_file import read_bytes, written_text
from protocols.display import Display
from protocols.errors import Problem, StudyError, did_you_mean, refuse_format_1
from protocols.gone import gone, without_gone
from protocols.limits import FIXED
from protocols.outside import CONTROL, reading
from protocols.recipes.base import Recipe
from protocols.recipes.warped_clips import CameraView
from protocols.study_file.problems import problems_of
from protocols.study_file.schema import AnyRecipe, StudyProtocol, problems_between
from protocols.tasks.task_kinds import TASKS

M = TypeVar("M", bound=BaseModel)
SECRET_SUFFIX = ".secret"
"""A study's secret lies beside its file, under the same name."""
_MOST_PARTS = FIXED["keys"].most
_LONG_KEY = re.compile(
    r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
    r"""(?:[ \t]*+\.[ \t]*+(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+'))"""
    f"{{{_MOST_PARTS},}}"
)
"""A dotted key that a parser of TOML takes long for: the square of its parts."""
_RECIPE = TypeAdapter[Recipe](AnyRecipe)


def load_protocol(path: str | Path, *, recorded: bool = False) -> StudyProtocol:
    """Read a study protocol.

    Parameters
    ----------
    path : str or Path
        A TOML file. The name of a study that comes with metamerlab (`demo`) is also taken.
    recorded : bool
        True where the study is that of recorded sessions: keys that were removed since are
        ignored, and `StudyProtocol.gone_notes` says so. A new study is refused for them.

    Raises
    ------
    StudyError
        With one line per mistake: file, place, what must hold, what was found, the cure.
    """
    path = _shipped(Path(path), "studies")
    raw = read_toml(path)
    study = protocol_of(raw, path, recorded=recorded)
    return _with_secret(study, path.with_suffix(SECRET_SUFFIX))


def control_characters(value: object, place: str = "") -> Iterator[Problem]:
    """Yield every text with a character that no page, figure or terminal can show."""
    if isinstance(value, str) and (found := CONTROL.search(value)):
        yield Problem(place, f"must hold no control characters (got {found.group()!a})")
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield from control_characters(entry, f"{place}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for index, entry in enumerate(value):
            yield from control_characters(entry, f"{place}[{index}]")


def _with_secret(study: StudyProtocol, path: Path) -> StudyProtocol:
    """Return a study with its secret, where it has one and it is here."""
    wanted = study.privacy.secret_sha256
    if wanted is None or not path.exists():
        return study
    secret = written_text(read_bytes(path, "the study's secret"), path).strip()
    if sha256_bytes(secret.encode()) != wanted:
        raise StudyError(
            f"{path}: must be the secret that privacy.secret_sha256 names ({wanted[:12]}, its hash"
            " is another); restore it from the lab's folder"
        )
    return study.with_secret(secret)


def protocol_of(raw: dict[str, object], path: Path, *, recorded: bool = False) -> StudyProtocol:
    """Return the study that a parsed file says; `path` is for messages and tables.

    `recorded` is as in `load_protocol`.

    Raises
    ------
    StudyError
        With one line per mistake.
    """
    if is_display(raw):
        raise StudyError(
            f"{path}: must be a study (this is a display); 'metamerlab protocol check' checks"
            " displays too, and a study names its display in [display], or takes it by --display"
        )
    if not ({"format", *StudyProtocol.model_fields} - {"display"}) & set(raw):
        keys = ", ".join(map(str, raw)) or "nothing"
        raise StudyError(
            f"{path}: must be a study, with [study], [stimuli], [task] and so on, or a display (has"
            f" {keys}); 'metamerlab new-study' makes both, with every key explained"
        )
    refuse_format_1(path, raw, "'metamerlab protocol upgrade FILE --out NEW' there writes format 2")
    problems: list[Problem] = list(control_characters(raw))
    if not problems:
        raw = _with_tables(raw, path.parent)
        problems += control_characters(raw)
    if problems:
        raise study_error(path, problems)
    raw, said = without_gone(raw)
    refused = [] if recorded else [Problem(place, f"{gone(place)}. Delete it") for place in said]
    try:
        study = StudyProtocol.model_validate(raw)
        if refused:
            raise study_error(path, refused)
        return study.with_gone(said) if said else study
    except ValidationError as error:
        problems = [*refused, *_one_kind(raw, problems_of(error, raw, StudyProtocol))]
        for problem in problems_between(_valid_sections(raw)):
            if problem not in problems:
                problems.append(problem)
        raise study_error(path, problems) from None


def _one_kind(raw: dict[str, object], problems: list[Problem]) -> list[Problem]:
    """Say of an analysis of the wrong kind that alone: its keys are another's."""
    task, analysis = raw.get("task"), raw.get("analysis")
    if not (isinstance(task, dict) and isinstance(analysis, dict) and "kind" in analysis):
        return problems
    kind = task.get("kind")
    known = TASKS.get(kind) if isinstance(kind, str) else None
    if known is None:
        return problems
    wanted = known.task.analysis.own_kind()
    kinds = [each.task.analysis.own_kind() for each in TASKS.values()]
    if analysis["kind"] == wanted or analysis["kind"] not in kinds:
        return problems
    found = f"must be {wanted!r} for the task {task['kind']!r} (got {analysis['kind']!r})"
    others = [problem for problem in problems if not problem.place.startswith("analysis")]
    return [*others, Problem("analysis.kind", found)]


def _with_tables(raw: dict[str, object], folder: Path) -> dict[str, object]:
    """Return the file with what its recipe has in tables beside it read in."""
    try:
        recipe = _RECIPE.validate_python(raw.get("stimuli"))
    except ValidationError:
        return raw
    found = recipe.resolved(folder)
    return raw if found is recipe else raw | {"stimuli": found.model_dump()}


def load_display(name_or_path: str, beside: Path | None = None) -> Display:
    """Read a display: one that comes with metamerlab by name, or a TOML file.

    Parameters
    ----------
    name_or_path : str
        `fhd27-60hz`, or a path that ends in ``.toml``.
    beside : Path, optional
        The protocol file; a relative path is looked up in its folder first.

    Raises
    ------
    StudyError
        If there is no such display, or the file has mistakes.
    """
    path = Path(name_or_path)
    if beside is not None and path.suffix == ".toml" and (beside.parent / path).exists():
        path = beside.parent / path
    return load_toml(_shipped(path, "displays"), Display)


def load_study(
    path: Path, display: str | None = None, *, recorded: bool = False
) -> tuple[StudyProtocol, Display]:
    """Read a protocol and its display, or `display` in that one's place.

    `recorded` is as in `load_protocol`.

    Raises
    ------
    StudyError
        As `load_protocol` and `load_display`.
    """
    study = load_protocol(path, recorded=recorded)
    named = study.display.display if display is None else display
    return study, load_display(named, beside=path)


def is_display(raw: Mapping[str, object]) -> bool:
    """True if a parsed file is meant as a display, also where most of its keys are misspelt."""
    own = set(Display.model_fields) - {"name", "description"}
    return bool(own & set(raw)) and not {"study", "stimuli", "scenes"} & set(raw)


def load_toml(path: Path, model: type[M]) -> M:
    """Read any TOML file into `model`; `StudyError` lists every mistake."""
    raw = read_toml(path)
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        raise study_error(path, problems_of(error, raw, model)) from None


def parse_view(text: str) -> CameraView:
    """Read a scene's line ``view = { ... }``, as a protocol or `stimuli look` has it."""
    table = re.sub(r"^\s*(\d+:)?\s*(view\s*=)?\s*", "", text)
    must = "--view: must be a line as in a protocol, view = { position_m = [x, y, z], look_at_m ="
    try:
        raw = {key: with_tuples(value) for key, value in tomllib.loads(f"view = {table}").items()}
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{must} [x, y, z] }} (got {text!r}: {error})") from None
    try:
        return CameraView.model_validate(raw["view"])
    except ValidationError as error:
        told = raw["view"] if isinstance(raw["view"], dict) else {}
        raise study_error(Path("--view"), problems_of(error, told, CameraView)) from None


def shipped(folder: str) -> dict[str, Path]:
    """Return the files that come with metamerlab in `studies` or `displays`, by name."""
    root = Path(str(files("protocols"))) / folder
    return {path.stem: path for path in sorted(root.glob("*.toml"))}


def _shipped(path: Path, folder: str) -> Path:
    """Return the path of a shipped file where only its name was given."""
    known = shipped(folder)
    if str(path) in known and not path.is_file():
        return known[str(path)]
    if path.suffix == ".toml" or (path.exists() and path != Path()):
        return path
    raise StudyError(
        f"{path}: must be a .toml file or one of {', '.join(known)}{did_you_mean(str(path), known)}"
    )


def read_toml(path: Path) -> dict[str, object]:
    """Return a parsed TOML file, its lists as tuples; `StudyError` says what is wrong."""
    text = written_text(read_bytes(path, "the TOML file", "toml"), path)
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise StudyError(
            f"{path}: line {line}: must be valid TOML with keys of at most {_MOST_PARTS} parts"
            " (has more); mend the file"
        )
    with reading(path, "valid TOML", StudyError, "mend the file"):
        return {key: with_tuples(value) for key, value in tomllib.loads(text).items()}


def with_tuples(value: object) -> object:
    """Return `value` with lists as tuples: our models are frozen through and through."""
    if isinstance(value, dict):
        return {key: with_tuples(entry) for key, entry in value.items()}
    return tuple(map(with_tuples, value)) if isinstance(value, list) else value


def _valid_sections(raw: dict[str, object]) -> dict[str, object]:
    """Return the sections that are right by themselves."""
    valid: dict[str, object] = {}
    for name, field in StudyProtocol.model_fields.items():
        with suppress(ValidationError, KeyError):
            valid[name] = TypeAdapter[object](field.annotation or object).validate_python(raw[name])
    return valid


def study_error(path: Path, problems: list[Problem]) -> StudyError:
    """Return the error of a file with a line for each mistake."""
    return StudyError("\n".join(f"{path}: {problem}" for problem in problems))
