"""`metamerlab new-study`: a folder to start a study from."""

from __future__ import annotations

import re
import secrets
import shlex
from pathlib import Path
from typing import Annotated

import typer

from analysis.report.folder import whole_folder
from protocols.errors import StudyError
from protocols.load import SECRET_SUFFIX, load_display
from protocols.new_study import FOLDERS, PARTS, study_files
from protocols.units import NAME_LENGTH, NAME_PATTERN
from study_app.cli.errors import user_errors
from study_app.cli.terminal import say

_NEVER_REPLACED = ".no-earlier-study"


def new_study(
    folder: Annotated[Path, typer.Argument(help="New folder.", metavar="DIR")],
    name: Annotated[
        str | None,
        typer.Option(help="Name of the study in files and folders; default: the folder's name."),
    ] = None,
    title: Annotated[str | None, typer.Option(help="What people read; default: the name.")] = None,
    display: Annotated[
        str, typer.Option(help="Display to start from: a shipped name or a .toml file.")
    ] = "fhd27-60hz",
    task: Annotated[
        str,
        typer.Option(metavar="NAME", help=f"What participants do: {', '.join(PARTS)}."),
    ] = "two-interval",
) -> None:
    """Make a folder to start a study from: protocol, display file, and where things belong.

    Every key is explained in the files; they pass 'metamerlab protocol check' as they are,
    and clips are small, so that the first build is short. The folder's README.md says what to
    do next. Tasks with a right answer start from a few small pictures and their table.

    Examples:

        metamerlab new-study my-study

        metamerlab new-study my-thresholds --task yes-no
    """
    with user_errors():
        named = name or slug(folder.absolute().name)
        if not re.fullmatch(NAME_PATTERN, named) or len(named) > NAME_LENGTH:
            raise StudyError(
                "--name: must be lower-case letters and digits, joined by single dashes, at most"
                f" {NAME_LENGTH} (got {named!r}); give one with --name"
            )
        shown = (title or named.replace("-", " ").replace("_", " ").capitalize()).strip()
        if re.search(r'["\\\x00-\x1f]', shown):
            raise StudyError(
                f"--title: must hold no quotes, backslashes and line ends (got {shown!r})"
            )
        texts = study_files(named, shown, load_display(display), task, secret=secrets.token_hex(32))
        from stimuli.example_pictures import example_files

        made = {file: text.encode() for file, text in texts.items()} | example_files(task)
        with whole_folder(folder, _NEVER_REPLACED) as work:
            for file, data in made.items():
                (work / file).parent.mkdir(exist_ok=True)
                (work / file).write_bytes(data)
                if file.endswith(SECRET_SUFFIX):
                    (work / file).chmod(0o600)
            for below in (*FOLDERS, PARTS[task][1]):
                (work / below).mkdir(exist_ok=True)
    say(f"{folder}: the study {named!r}, ready to be made yours. Next:")
    say(f"  cd {shlex.quote(str(folder))}")
    say("  metamerlab protocol check study.toml")
    say("and see README.md there.")


def slug(text: str) -> str:
    """Return a folder's name as the name of a study may be."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
