"""Arguments and options that several commands take: one wording for one thing.

Among them are options of the form NAME=VALUE, and what a simulation takes for true.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import typer

from protocols.errors import StudyError, did_you_mean, must_be_one_of
from study_app.cli.terminal import say_notes

if TYPE_CHECKING:
    from analysis.power import Assumption
    from protocols.study_file.schema import StudyProtocol


SESSIONS_PROTOCOL_HELP = "File of the study that was run (.toml), or a shipped study's name."

ProtocolArgument = Annotated[
    Path, typer.Argument(help="The study's file (.toml), or the name of a shipped study.")
]
DisplayOption = Annotated[
    str | None, typer.Option(help="A display other than the protocol's: a name or a .toml file.")
]
SessionsArgument = Annotated[
    Path, typer.Argument(help="Folder of sessions, searched to any depth.")
]
SessionsOption = Annotated[Path, typer.Option(help="Folder of sessions.")]
SessionArgument = Annotated[
    Path, typer.Argument(help="Folder of one session: SESSIONS/STUDY/CODE.")
]
SessionsProtocolOption = Annotated[Path, typer.Option(help=SESSIONS_PROTOCOL_HELP)]
NewFolderOption = Annotated[
    Path, typer.Option(help="Folder to fill. It appears only when complete.")
]
FiguresOption = Annotated[
    Literal["svg", "pdf", "png", "all", "none"],
    typer.Option(
        help="Files of the page's figures: one format for two columns (7 in); or all formats, for"
        " one column (3.33 in) too."
    ),
]
ReplaceOption = Annotated[bool, typer.Option("--replace", help="Replace an earlier result.")]

T = TypeVar("T", bound=str)


def one_of(option: str, text: str, known: Collection[T]) -> T:
    """Return the choice that an option names.

    Raises
    ------
    StudyError
        If it is none of them, with the nearest one.
    """
    for name in known:
        if name == text:
            return name
    raise StudyError(must_be_one_of(f"{option}:", text, known))


def recorded_protocol(path: Path) -> StudyProtocol:
    """Return the study of recorded sessions, and say which of its keys were removed since.

    Raises
    ------
    StudyError
        As `load_protocol`.
    """
    from protocols.load import load_protocol

    study = load_protocol(path, recorded=True)
    say_notes(f"{path}: {note}" for note in study.gone_notes)
    return study


def unknown_numbers(given: list[str] | None) -> tuple[float, ...] | None:
    """Return the numbers of `--unknown`; none for ``none``, None where it is not given.

    Raises
    ------
    StudyError
        If it is neither a number nor ``none``, or both.
    """
    if given is None or given == ["none"]:
        return None if given is None else ()
    try:
        return tuple(float(number) for number in given)
    except ValueError:
        raise StudyError(
            f"--unknown must be a number as the file stores it, or none (got {', '.join(given)})"
        ) from None


def pairs(option: str, entries: Iterable[str]) -> dict[str, str]:
    """Return entries of the form NAME=VALUE as a dictionary."""
    sides = {"--map": "OURS=THEIRS", "--answer": "THEIRS=OURS,..."}.get(option, "NAME=VALUE")
    found = {}
    for entry in entries:
        name, sign, value = (part.strip() for part in entry.partition("="))
        if not sign or not name or not value:
            raise StudyError(f"{option} must read {sides} (got {entry!r})")
        found[name] = value
    return found


def assumed_values(
    known: Sequence[Assumption], given: Mapping[str, str], own: Container[str] = ()
) -> dict[str, float]:
    """Return a value for every assumption: the one given, or its own.

    Those in `own` may have been given by an option of their name.
    """
    assumptions = {one.name: one for one in known}
    values = {one.name: one.value for one in known}
    for name, text in given.items():
        if name not in assumptions:
            listed = "; ".join(f"{one.name}: {one.meaning}" for one in known)
            raise StudyError(
                f"--set: must name what this task's simulation takes for true ({listed})"
                f" (got {name!r}){did_you_mean(name, list(assumptions))}"
            )
        one = assumptions[name]
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not one.lowest <= value <= one.highest:
            option = f"--{name.replace('_', '-')}" if name in own else f"--set {name}"
            percent = one.highest <= 1 < value <= 100
            cure = f"; {value:g} % is {value / 100:g}" if percent else ""
            raise StudyError(
                f"{option}: must be a number from {one.lowest:g} to {one.highest:g}"
                f" (got {text!r}){cure}"
            )
        values[name] = value
    return values
