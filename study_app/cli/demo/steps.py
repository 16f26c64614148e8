"""The steps of a demonstration: commands of metamerlab, and what its page shows of each.

A process runs one command after the other, so that it reads their modules once.
"""

from __future__ import annotations

import io
import os
import shlex
import sys
import time
import tomllib
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from protocols.errors import StudyError
from study_app.cli import main

SCREEN = "screen.toml"

Said: TypeAlias = tuple[list[tuple[str, str]], float]
"""Commands with what each said, and the seconds that all took."""


@dataclass(frozen=True)
class Options:
    """Wishes of who runs `metamerlab demo`."""

    out: Path = Path("out/demo")
    """Folder to fill; made if it is missing."""
    all: bool = False
    """Also a real window, every clip, foveated studies and another task."""
    participants: Annotated[int, typer.Option(min=2)] = 12
    """Simulated observers."""
    display: Annotated[str | None, typer.Option(show_default=False)] = None
    r"""Show the window of --all on this machine's screen, described by this display file (or name).
    \[default: a screen of its own without a monitor]"""
    fresh: bool = False
    """Delete an earlier demonstration there first."""
    seed: Annotated[int, typer.Option(min=0)] = 0
    """Seed of noise and observers: same seed, same results."""
    study: str = "glimpse"  # or an absolute path


@dataclass(frozen=True)
class Step:
    """One step: an entry of ``steps.toml``, whose texts may name options in braces."""

    name: str
    title: str
    text: str
    commands: list[str]
    """Run one after the other, in the folder of the demonstration."""
    when: str = ""
    """``all``: it runs with --all only; ``window``: then, and before a window, with the machine to
    itself; empty: it always runs."""
    each: list[str] = field(default_factory=lambda: [""])
    """Names that ``{name}`` stands for: all is done for each."""
    makes: list[str] = field(default_factory=list)
    """Files that a finished step leaves."""
    links: dict[str, str] = field(default_factory=dict)
    """Place and words of what the page leads to."""
    shows: list[str] = field(default_factory=list)
    """Patterns of pictures and videos that the page shows."""
    needs: list[str] = field(default_factory=list)
    """Steps whose results it reads: it is done again with them."""
    clears: list[str] = field(default_factory=list)
    """Patterns of what an earlier demonstration made, which goes before it is made anew."""

    def chains(self) -> list[list[list[str]]]:
        """Return the words of every command, for each name."""
        return [
            [shlex.split(text.replace("{name}", name)) for text in self.commands]
            for name in self.each
        ]

    def named(self, texts: list[str]) -> list[str]:
        """Return `texts` for each name."""
        return [text.replace("{name}", name) for name in self.each for text in texts]


def steps_of(options: Options, folder: str) -> list[Step]:
    """Return all steps that are asked for, in their order; `folder` is that of the sessions."""
    from stimuli.batch.executors import cores

    values = {
        "study": shlex.quote(options.study),
        "folder": folder,
        "display": shlex.quote(options.display or SCREEN),
        "pacing": "" if options.display else "--software-pacing",
        "seed": str(options.seed),
        "virtual": str(options.participants - options.all),  # one sits before the window
        "workers": str(max(1, cores() - 1)),  # the pictures are made beside the clips
        "name": "{name}",
    }
    text = (files("study_app.cli.demo") / "steps.toml").read_text(encoding="utf-8")
    steps = [Step(**entry) for entry in tomllib.loads(text)["steps"]]
    filled = ("commands", "makes", "clears")
    return [
        Step(**vars(step) | {key: [one.format(**values) for one in vars(step)[key]]
                             for key in filled})
        for step in steps if options.all or not step.when
    ]  # fmt: skip


def run_commands(commands: list[list[str]], folder: Path, env: Mapping[str, str]) -> Said:
    """Run commands in this process, one after the other.

    Raises
    ------
    StudyError
        If one fails, with what it said.
    """
    os.chdir(folder)
    os.environ.update(env)
    began_s, said = time.monotonic(), []
    for command in commands:
        sys.argv = ["metamerlab", *command]
        words, text = shlex.join(sys.argv), io.StringIO()
        with redirect_stdout(text), redirect_stderr(text):
            try:
                main()
            except SystemExit as end:
                status = end.code
        said.append((words, text.getvalue().rstrip()))
        if status:
            raise StudyError(
                f"'{words}' must end well in {folder} (it ended with status {status}); mend that,"
                f" and run this again: it goes on from there. It said:\n{said[-1][1]}"
            )
    return said, time.monotonic() - began_s
