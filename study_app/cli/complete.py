"""Completions of a shell, for studies, displays, tasks, methods and files; types in help."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from protocols.errors import must_be_one_of

if TYPE_CHECKING:
    from typer._click import Command, Context

Completer = Callable[["Context", object, str], list[str]]


def completing(command: Command) -> Command:
    """Return a command whose parameters complete their values, by what they are called.

    Those of a group's commands do, too. What has a completion of its own keeps it. Help names types
    in plain words, and a value that is refused is named.
    """
    for one in getattr(command, "commands", {}).values():
        completing(one)
    for parameter in command.get_params(typer.Context(command)):
        typer_says = getattr(parameter, "display_type_rich", None)
        if typer_says is not None:
            vars(parameter)["display_type_rich"] = _in_words(typer_says)
        vars(parameter)["process_value"] = _naming_value(parameter.process_value)
        complete = _OF.get(parameter.name or "")
        if complete is not None and parameter._custom_shell_complete is None:
            parameter._custom_shell_complete = complete
    return command


def _in_words(typer_says: Callable[..., str | None]) -> Callable[..., str]:
    """Return the namer of a type in plain words: a flag has none, a list has its parts'."""

    def told(ctx: Context) -> str:
        said = re.sub(r"^<list\[(.*)\]>$", r"<\1>", typer_says(ctx=ctx) or "")
        return _WORDS.get(said, said)

    return told


def _naming_value(process: Callable[[Context, Any], Any]) -> Callable[[Context, Any], Any]:
    """Return the reader of a value, which names one that it refuses."""

    def processed(ctx: Context, value: Any) -> Any:
        try:
            return process(ctx, value)
        except typer.BadParameter as error:
            must, typers_own, rest = error.message.partition("Input should be ")
            if typers_own and not must:
                word = rest.partition(",")[0].replace("integer", "whole number")
                error.message = f"must be {word} (got {str(value)!r})"
            found, choice, known = error.message.partition(" is not one of ")
            if choice:
                names = re.findall("'([^']*)'", known)
                error.message = must_be_one_of("it", found.partition("'")[2][:-1], names)
            raise

    return processed


def _with_files(known: Iterable[str], typed: str, ending: str) -> list[str]:
    """Return the names that begin as typed, then folders and files of an ending that do."""
    head, slash, tail = typed.rpartition("/")
    place = Path(head + slash)
    files = sorted(place.iterdir()) if place.is_dir() else []
    found = [
        f"{head}{slash}{file.name}" + "/" * file.is_dir()
        for file in files
        if file.name.startswith(tail)
        and (tail or file.name[0] != ".")
        and (file.is_dir() or file.name.endswith(ending))
    ]
    return [name for name in known if name.startswith(typed)] + found


def _studies(_context: Context, _parameter: object, typed: str) -> list[str]:
    from protocols.load import shipped

    return _with_files(shipped("studies"), typed, ".toml")


def _displays(_context: Context, _parameter: object, typed: str) -> list[str]:
    from protocols.load import shipped

    return _with_files(shipped("displays"), typed, ".toml")


def _tasks(context: Context, _parameter: object, typed: str) -> list[str]:
    from protocols.study_file.new_study import TEMPLATES
    from protocols.tasks.task_kinds import TASKS

    known = TEMPLATES if context.info_name == "new-study" else (*TASKS, "ratings", "reaction")
    return [name for name in known if name.startswith(typed)]


def _methods(context: Context, _parameter: object, typed: str) -> list[str]:
    """Complete the last of several names that commas join."""
    from pipeline.foveation.conditions import condition_names
    from pipeline.methods.registry import method_names

    if context.info_name == "figure":
        return []  # the study's own
    fills = context.info_name == "warp" or (
        context.info_name == "new-study" and not context.params.get("photos")
    )
    known = method_names() if fills else condition_names()
    if context.info_name == "new-study" and fills:
        known = ["reference", *known]
    before, comma, last = typed.rpartition(",")
    named = before.split(",")
    plain = (name for name in known if ":" not in name and name not in named)
    return [f"{before}{comma}{name}" for name in plain if name.startswith(last)]


_OF: dict[str, Completer] = {
    "protocol": _studies,
    "study": _studies,
    "display": _displays,
    "task": _tasks,
    "methods": _methods,
}
_WORDS = {"<bool>": "", "<str>": "<text>", "<Path>": "<path>", "<dir>": "<folder>"} | dict.fromkeys(
    ("<int>", "<int range>", "<float>", "<float range>"), "<number>"
)
