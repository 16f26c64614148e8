"""Arguments and options that several commands take: one wording for one thing."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from protocols.errors import StudyError, must_be_one_of
from study_app.cli.terminal import say_notes

if TYPE_CHECKING:
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
