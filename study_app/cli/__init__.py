"""The front door: the one command `metamerlab` and its groups.

A command's module is imported when the command runs, so that `metamerlab
--help` answers at once. To add a command, write its module in this folder and
add one line to `SLOTS`.
"""

from __future__ import annotations

import importlib
import re
import signal
import sys
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from pipeline.errors import notes_printed
from protocols.errors import StudyError
from protocols.limits import check_limits_variable
from study_app.cli.complete import completing
from study_app.cli.error_messages import user_errors
from study_app.cli.option_groups import CommandGroup
from study_app.cli.terminal import say

if TYPE_CHECKING:
    from typer._click import Command, Context


@dataclass(frozen=True)
class CommandSlot:
    """A place for one command or group of commands.

    `target` is ``module:attribute``: a `typer.Typer` (a group) or a function
    (one command); `made_by` is the class of that command, in the same module.
    """

    name: str
    help: str
    target: str
    made_by: str | None = None

    def load(self) -> Command:
        """Import the module and return its command, under the slot's name."""
        module, _, attribute = self.target.partition(":")
        target = getattr(importlib.import_module(module), attribute)
        if isinstance(target, typer.Typer):
            group = typer.main.get_group(target)
            group.name = self.name
            return completing(group)
        single = CommandGroup(add_completion=False)
        made_by = getattr(importlib.import_module(module), self.made_by) if self.made_by else None
        single.command(self.name, cls=made_by)(target)
        return completing(typer.main.get_command(single))


class LazyGroup(TyperGroup):
    """A group that lists its `slots` and imports only the one that is called."""

    slots: ClassVar[tuple[CommandSlot, ...]] = ()

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        for slot in self.slots:
            self.add_command(_LazyCommand(slot))


class _LazyCommand(TyperCommand):
    """Stands in for a slot's command in listings; becomes it when called."""

    def __init__(self, slot: CommandSlot) -> None:
        super().__init__(slot.name, help=slot.help)
        self._slot = slot

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: Context | None = None,
        **extra: Any,
    ) -> Context:
        return self._slot.load().make_context(info_name, args, parent=parent, **extra)


__all__ = ["SLOTS", "app", "main", "user_errors"]

SLOTS = tuple(
    CommandSlot(name, text, f"study_app.cli.{target}", *made_by)
    for name, text, target, *made_by in (
        # name, help (the first line of `metamerlab --help`), place below this folder
        ("doctor", "Check that this machine is fit for the job.", "doctor:doctor"),
        ("demo", "Run the whole chain as a demonstration.", "demo.command:demo"),
        ("warp", "Warp one picture and fill its holes.", "pictures.warp:warp"),
        ("foveate", "Make metamers of a picture for one gaze.", "pictures.foveate:foveate"),
        ("live", "Show a picture that follows the gaze.", "pictures.live:live"),
        ("compress", "Compress a picture for a gaze.", "pictures.compress:compress"),
        ("decompress", "Restore a compressed picture.", "pictures.compress:decompress"),
        ("texture", "Bake textures into statistics.", "pictures.texture_commands:app"),
        ("denoise", "Make metamers of noisy renders.", "pictures.denoise_commands:app"),
        (
            "new-study",
            "Make a folder to start a study from.",
            "new_study_command:new_study",
            "FileListCommand",
        ),
        ("protocol", "Write, check and plan a study.", "protocol_commands:app"),
        ("stimuli", "Build and check a study's clips.", "stimuli_commands:app"),
        ("figure", "Draw a paper's opening figure.", "pictures.figure_command:figure"),
        ("session", "Run sessions with participants.", "sessions.session_commands:app"),
        ("analysis", "Statistics, plots and the report.", "analysis_commands:app"),
    )
)


_OLD_SPELLINGS: dict[tuple[str, ...], dict[str, str]] = {
    ("analysis", "power"): {"--people": "--participants"},
    ("analysis", "report"): {"--no-figures": "--figures=none"},
    ("demo",): {"--observers": "--participants"},
    **{(name,): {"--method": "--methods"} for name in ("warp", "foveate", "live")},
    **{
        ("analysis", name): {"--confidence": "--coverage"}
        for name in ("psychometric", "detection", "reaction", "ratings")
    },
}
"""Earlier names of options by command, before one thing had one name; no help shows them."""


_HOME = re.compile(r"(?:^|(?<=[=:,]))~(?=[/\\]|$)")
"""The home folder where a path begins; shells leave the one of ``--out=~/x`` to us."""


class _FrontDoor(LazyGroup):
    slots = SLOTS

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:
        """Read old spellings as those of today and ``~`` as the home; refuse what was removed."""
        from protocols.gone import gone_from_command

        completing(self)
        if message := gone_from_command(args):
            with user_errors():
                raise StudyError(message)
        for command, today in _OLD_SPELLINGS.items():
            if tuple(args[: len(command)]) == command:
                parts = [arg.partition("=") for arg in args]
                args = [today.get(name, name) + sign + value for name, sign, value in parts]
        args = [_HOME.sub(lambda _: str(Path.home()), arg) for arg in args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_FrontDoor,
    no_args_is_help=True,
    # A traceback is a bug report: plain, complete, and the same with and without a terminal.
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    epilog="Example: [bold]metamerlab doctor[/bold]. Then [bold]metamerlab COMMAND --help[/] lists"
    " the options of a command, with examples.",
)


def _print_version(asked: bool) -> None:
    if asked:
        from protocols.revision import code_revision, package_version

        typer.echo(f"metamerlab {package_version()} (git revision {code_revision()})")
        raise typer.Exit


@app.callback()
def metamerlab(
    context: typer.Context,
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Print the version and the git revision, then stop.",
            callback=_print_version,
            is_eager=True,
        ),
    ] = False,
) -> None:
    """Perceptual studies of image warping, hole filling and foveated pictures."""
    context.with_resource(notes_printed(lambda line: say(line, file=sys.stderr)))
    with user_errors():
        check_limits_variable()


_ENDINGS = {getattr(signal, name, signal.SIGTERM) for name in ("SIGTERM", "SIGHUP", "SIGBREAK")}


def _stop(_number: int, _frame: object) -> None:
    """Stop a command as Ctrl-C does; a terminal that closes sends more than one signal."""
    for number in _ENDINGS:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line given in `sys.argv`; the console script `metamerlab`."""
    for number in _ENDINGS:
        if signal.getsignal(number) == signal.SIG_DFL:  # under nohup, a terminal may close
            signal.signal(number, _stop)
    for stream in (sys.stdout, sys.stderr):  # a console of Windows may know 256 characters
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with user_errors():  # what is found while commands are imported: plug-ins that do not load
            try:
                app(prog_name="metamerlab")
            except SystemExit as end:  # of every command that ran to its end
                code = end.code
        sys.exit(code)
    except typer.Exit as end:
        sys.exit(end.exit_code)
    except KeyboardInterrupt:  # while a command was imported
        sys.exit(130)
