"""The front door: the one command `metamerlab` and its groups.

A command's module is imported when the command runs, so that `metamerlab
--help` answers at once. To add a command, write its module in this folder and
add one line to `SLOTS`.
"""

from __future__ import annotations

import sys
from io import TextIOWrapper
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.errors import notes_printed
from protocols.errors import StudyError
from protocols.limits import check_limits_variable
from study_app.cli.complete import completing
from study_app.cli.error_messages import user_errors
from study_app.cli.lazy import CommandSlot, LazyGroup
from study_app.cli.terminal import say

if TYPE_CHECKING:
    from typer._click import Context

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
    ("demo",): {"--observers": "--participants"},
    **{(name,): {"--method": "--methods"} for name in ("warp", "foveate", "live")},
    **{
        ("analysis", name): {"--confidence": "--coverage"}
        for name in ("psychometric", "detection", "reaction", "ratings")
    },
}
"""Of commands: what options were called before one thing had one name; no help shows it."""


class _FrontDoor(LazyGroup):
    slots = SLOTS

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:
        """Read old spellings as those of today, and refuse what was removed."""
        from protocols.gone import gone_from_command

        completing(self)
        if message := gone_from_command(args):
            with user_errors():
                raise StudyError(message)
        for command, today in _OLD_SPELLINGS.items():
            if tuple(args[: len(command)]) == command:
                parts = [arg.partition("=") for arg in args]
                args = [today.get(name, name) + sign + value for name, sign, value in parts]
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


def main() -> None:
    """Run the command line given in `sys.argv`; the console script `metamerlab`."""
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
