"""`metamerlab new-study`: a folder to start a study from."""

from __future__ import annotations

import re
import secrets
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from analysis.report.folder import whole_folder
from protocols.errors import StudyError
from protocols.load import SECRET_SUFFIX, load_display
from protocols.new_study import FOLDERS, PARTS, study_files
from protocols.own_stimuli import OwnScene, OwnStimuli
from protocols.units import NAME_LENGTH, NAME_PATTERN
from study_app.cli.errors import user_errors
from study_app.cli.progress import progress_line
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
    scene: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="A 3D file of yours (.glb, .gltf, .obj), or a built-in scene; may be given more"
            " than once. It is copied, with all that it names, and views of it are drawn.",
        ),
    ] = None,
    pair: Annotated[
        tuple[Path, Path, Path] | None,
        typer.Option(
            metavar="LEFT RIGHT DISPARITY",
            help="A rectified pair of photographs of yours, with the disparity of the left one.",
        ),
    ] = None,
    units_per_px: Annotated[
        float, typer.Option(help="What the disparity's file stores for one pixel.")
    ] = 1.0,
    focal_px: Annotated[
        float | None, typer.Option(help="Focal length of the pair; left out: assumed.")
    ] = None,
    baseline_m: Annotated[
        float | None,
        typer.Option(help="Metres between the pair's cameras; left out: assumed."),
    ] = None,
    offset_px: Annotated[
        float, typer.Option(help="Between the principal points of the pair.")
    ] = 0.0,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="Names from 'metamerlab warp --list', onnx:FILE, frames:FOLDER, and 'reference',"
            " the true view. The study's test compares the first with the second.",
        ),
    ] = None,
) -> None:
    """Make a folder to start a study from: protocol, display file, and where things belong.

    Every key is explained in the files; they pass 'metamerlab protocol check' as they are,
    and clips are small, so that the first build is short. The folder's README.md says what to
    do next. Tasks with a right answer start from a few small pictures and their table.

    With --scene, --pair and --methods the study holds what you name: files are copied below it,
    a pair is compared before, and every 3D file has a sheet of views, its line in study.toml.

    Examples:

        metamerlab new-study my-study

        metamerlab new-study my-thresholds --task yes-no

        metamerlab new-study mine --scene place.glb --pair left.png right.png disparity.pfm \\
            --methods metameric,push-pull,reference
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
        screen = load_display(display)
        study_files(named, shown, screen, task)  # a mistake is told before anything is copied
        rig = (units_per_px, focal_px, baseline_m, offset_px)
        if pair is None and rig != (1.0, None, None, 0.0):
            raise StudyError(
                "--units-per-px, --focal-px, --baseline-m and --offset-px are of a pair (got none);"
                " give it with --pair LEFT RIGHT DISPARITY, or leave them out"
            )
        from stimuli.example_pictures import example_files

        with whole_folder(folder, _NEVER_REPLACED) as work:
            own, notes = _own(work, folder, scene or [], pair and (*pair, *rig), methods)
            secret = secrets.token_hex(32)
            texts = study_files(named, shown, screen, task, secret=secret, own=own)
            made = {file: text.encode() for file, text in texts.items()} | example_files(task)
            for file, data in made.items():
                (work / file).parent.mkdir(exist_ok=True)
                (work / file).write_bytes(data)
                if file.endswith(SECRET_SUFFIX):
                    (work / file).chmod(0o600)
            for below in (*FOLDERS, PARTS[task][1]):
                (work / below).mkdir(exist_ok=True)
    for note in notes:
        say(f"note: {note}")
    say(f"{folder}: the study {named!r}, ready to be made yours. Next:")
    say(f"  cd {shlex.quote(str(folder))}")
    say("  metamerlab protocol check study.toml")
    say("and see README.md there.")


def _own(
    work: Path,
    folder: Path,
    scenes: list[str],
    pair: tuple[Path, Path, Path, float, float | None, float | None, float] | None,
    methods: str | None,
) -> tuple[OwnStimuli, list[str]]:
    """Copy scenes, a pair and networks into `work`; return them, and notes."""
    if not scenes and pair is None and methods is None:
        return OwnStimuli(), []
    # Imported here: they bring the renderer along.
    from pipeline.errors import GLUnavailableError
    from pipeline.gl.context import create_context, release_context
    from stimuli.bring_in import PairFiles, bring_methods, bring_pair, bring_scene
    from stimuli.scenes.mesh_inputs import ENDINGS

    fills = () if methods is None else bring_methods(methods, work, folder)
    found: list[OwnScene] = []
    pairs: list[OwnScene] = []
    notes: list[str] = []
    if pair is not None:  # before views are drawn: it may be refused
        brought, notes = bring_pair(PairFiles(*pair), work, ())
        pairs.append(brought)
    ctx = None
    if any(scene.lower().endswith(ENDINGS) for scene in scenes):
        try:
            ctx = create_context()
        except GLUnavailableError as error:
            notes.append(f"no views of 3D files were drawn: {error}")
    try:
        with progress_line("trying views") as report:
            for scene in scenes:
                taken = [each.name for each in (*pairs, *found)]
                shown = f"views of {Path(scene).name}"
                say_of = partial(_say_of, report, shown)
                found.append(bring_scene(scene, work, taken, ctx, say_of))
    finally:
        if ctx is not None:
            release_context(ctx)
    return OwnStimuli((*found, *pairs), fills), notes


def _say_of(report: Callable[[int, int, str], None], what: str, done: int, total: int) -> None:
    report(done, total, what)


def slug(text: str) -> str:
    """Return a folder's name as the name of a study may be."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
