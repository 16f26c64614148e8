"""Options, choice of methods, and checks of outputs that commands on single pictures share."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from protocols.disk.locks import clear_files
from protocols.disk.result_folder import check_folder
from protocols.errors import StudyError, did_you_mean
from study_app.cli.terminal import PlainConsole

if TYPE_CHECKING:
    import moderngl

    from stimuli.media.gaze_and_display import StatedViewing

LOOK = "To look at"
"""Panel of what is made to be looked at."""
FILE_ENDINGS = (".png", ".exr")


def gaze_option(default: str, more: str = "") -> Any:
    """``--gaze``, in pixels or degrees; `more` says what else it may be."""
    return typer.Option(
        metavar="X,Y",
        help="Gaze: pixels from the upper left corner (512,384), or degrees"
        rf" right of and below the middle (5deg,-3deg).{more} \[default: {default}]",
    )


GazeOption = Annotated[str | None, gaze_option("the middle")]
ShownOption = Annotated[
    str | None,
    typer.Option(
        help="The display that shows it, pixel for pixel: a shipped name or a .toml file."
    ),
]
FovOption = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help=r"Visual angle of the picture's width, instead of a display. \[default: 40]",
    ),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the noise.")]
NumpyOption = Annotated[bool, typer.Option("--numpy", help="Use the numpy reference, not OpenGL.")]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "--parameter",
        metavar="P=V",
        help="A parameter, as name=value, of every method that has it.",
    ),
]


@dataclass(frozen=True)
class PictureViewing:
    """The display or the angle at which a picture is seen."""

    display: ShownOption = None
    fov: FovOption = None

    def stated(self, gaze: str | None = None, panorama: bool = False) -> StatedViewing:
        """Return it with a gaze, as work on pictures takes it."""
        from stimuli.media.gaze_and_display import StatedViewing

        return StatedViewing(gaze, self.display, self.fov, panorama)


def method_option(what: str, default: str) -> Any:
    """``--methods``, several for a sheet."""
    return typer.Option(
        "--methods",
        "-m",
        metavar="A,B,...",
        help=f"{what}s; the first one makes OUT. Several are for --compare; the option may also be"
        rf" given again. \[default: {default}]",
    )


def named_methods(given: Sequence[str] | None) -> list[str]:
    """Return the methods of an option that takes several, joined by commas or given again.

    Raises
    ------
    StudyError
        If a name between commas is empty.
    """
    found = [name.strip() for text in given or () for name in text.split(",")]
    if "" in found:
        raise StudyError(
            f"--methods: must be names joined by commas (got {','.join(given or ())!r})"
        )
    return found


def list_option(what: str, show: Callable[[Console], None]) -> Any:
    """``--list``: print, and stop."""

    def stop(asked: bool) -> None:
        if asked:
            show(PlainConsole())
            raise typer.Exit

    return typer.Option("--list", help=f"List {what}, then stop.", callback=stop, is_eager=True)


def print_methods(
    console: Console, entries: Iterable[Any], parameters: Callable[[str], Mapping[str, Any]]
) -> None:
    """Print a registry: each method, what it is, and its parameters with their defaults."""
    table = Table("method", "what it is", "parameters (default)", box=None)
    for entry in entries:
        known = parameters(f"{entry.name}x" if entry.takes_path else entry.name)
        shown = ", ".join(k if v is None else f"{k} ({v})" for k, v in known.items())
        table.add_row(entry.shown_name, entry.summary, shown or "-")
    console.print(table)


def choose_methods(
    given: Sequence[str] | None,
    settings: Sequence[str] | None,
    *,
    every: Sequence[str],
    default: str,
    known: Callable[[str], Mapping[str, Any]],
    sheet: bool,
    sheets: str = "--compare FILE",
) -> list[tuple[str, dict[str, Any]]]:
    """Return methods and their parameters; the first one makes OUT.

    Parameters
    ----------
    every : sequence of str
        What a sheet shows unless methods are given.
    known : callable
        Gives the parameters of a name, and refuses one that is unknown. Each method gets those of
        `settings` that it has; a method alone gets all, to refuse what it has not.
    sheet : bool
        Whether something is asked for that shows several; `sheets` are the options that do.

    Raises
    ------
    StudyError, InputError
        If there are several methods and no sheet, or a name or a setting is wrong, or none has it.
    """
    methods = named_methods(given)
    if not methods:
        methods = sorted(every, key=lambda name: name != default) if sheet else [default]
    known_of = {name: known(name) for name in methods}
    if len(methods) > 1 and not sheet:
        raise StudyError(
            f"--methods: one makes one OUT (got {len(methods)}); add {sheets} to see them all"
        )
    parameters = read_parameters(settings or [])
    if len(methods) == 1:
        return [(methods[0], parameters)]
    every_one = sorted({key for one in known_of.values() for key in one})
    for key in parameters:
        if key not in every_one:
            raise StudyError(
                f"--set {key}: must be a parameter of {', '.join(methods)}, which have"
                f" {', '.join(every_one)}{did_you_mean(key, every_one)}"
            )
    return [
        (name, {key: value for key, value in parameters.items() if key in known_of[name]})
        for name in methods
    ]


def check_outputs(
    files: Mapping[str, tuple[Path | None, Sequence[str]]],
    folders: Iterable[Path | None],
    inputs: Iterable[Path | None],
) -> None:
    """Refuse before the work what could not be written after it.

    Parameters
    ----------
    files : mapping
        By argument or option, the file (None: not asked for) and the endings it may have.
    inputs : iterable of Path or None
        What is read, and must stay as it is.

    Raises
    ------
    StudyError
        If one cannot be written, two are the same file, or one would replace what is read.
    """
    read = [path for path in inputs if path is not None and path.exists()]
    asked = {name: path for name, (path, _) in files.items() if path is not None}
    for name, path in asked.items():
        check_file(path, files[name][1])
        if path.exists() and any(path.samefile(one) for one in read):
            raise StudyError(f"{name}: {path} is read by this command; write to another file")
    for folder in folders:
        if folder is None:
            continue
        check_folder(folder)
        if folder.absolute() in {path.absolute() for path in asked.values()}:
            raise StudyError(f"{folder}: must be a folder or a file, not both")
        if folder.exists() and any(folder.samefile(one.absolute().parent) for one in read):
            raise StudyError(f"{folder}: holds what this command reads; write to another folder")
    if len({path.absolute() for path in asked.values()}) < len(asked):
        *first, last = files
        raise StudyError(f"{', '.join(first)} and {last} must be different files")


def read_parameters(settings: Sequence[str]) -> dict[str, Any]:
    """Read ``name=value`` settings: numbers and true or false as such, the rest as text.

    Raises
    ------
    StudyError
        If one is not ``name=value``.
    """
    parameters: dict[str, Any] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or not name:
            raise StudyError(f"--set must be name=value (got {setting!r})")
        parameters[name] = _value(value)
    return parameters


def _value(text: str) -> Any:
    for kind in (json.loads, float):  # .3 is no JSON
        with suppress(ValueError, RecursionError):
            return kind(text)
    return text


def check_file(path: Path, endings: Sequence[str]) -> None:
    """Refuse before the work a file that could not be written after it.

    What a killed command left of it is removed.

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
    clear_files(path)


@contextmanager
def renderer(console: Console, numpy_only: bool) -> Iterator[moderngl.Context | None]:
    """A context where there is OpenGL; without it numpy works, and it is said."""
    from pipeline.errors import GLUnavailableError
    from pipeline.gl.context import NUMPY_INSTEAD, lent_context

    with ExitStack() as lent:
        ctx = None
        if not numpy_only:
            try:
                ctx = lent.enter_context(lent_context())
            except GLUnavailableError:
                console.print(f"note: {NUMPY_INSTEAD}")
        yield ctx
