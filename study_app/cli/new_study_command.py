"""`metamerlab new-study`: a folder to start a study from."""

from __future__ import annotations

import os
import re
import secrets
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from typer.core import TyperCommand

from protocols.disk.result_folder import whole_folder, without_links
from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import SECRET_SUFFIX, load_display
from protocols.study_file.new_study import FOLDERS, TEMPLATES, inputs_folder, study_files
from protocols.study_file.own_stimuli import OwnClips, OwnScene, OwnStimuli
from protocols.units import NAME_IN_WORDS, NAME_LENGTH, NAME_PATTERN
from study_app.cli.options import one_of, unknown_numbers
from study_app.cli.options import pairs as pairs_of
from study_app.cli.progress import progress_line
from study_app.cli.terminal import say, say_notes

if TYPE_CHECKING:
    from stimuli.recipes.bring_in import PairFiles

_PAIR_FILES: Final = ("LEFT", "RIGHT", "DISPARITY")
_BETWEEN: Final = "\0"  # no path holds it
_CHANNELS: Final = ("r", "g", "b", "depth", "motion_x", "motion_y")


_SEVERAL: Final = {"--pair": len(_PAIR_FILES), "--photos": sys.maxsize, "--exr": sys.maxsize}


class FileListCommand(TyperCommand):
    """A command whose options take several files, as a shell writes them for ``*.jpg``.

    Typer knows options of three values, and options given again, but not both: of two pairs the
    first would be lost without a word. So the files behind an option reach it as one value.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join the files behind each such option, then read the line as ever."""
        joined: list[str] = []
        rest = list(args)
        while rest:
            joined.append(rest.pop(0))
            files: list[str] = []
            while rest and len(files) < _SEVERAL.get(joined[-1], 0) and rest[0][:1] != "-":
                files.append(rest.pop(0))
            if len(files) > 1 and _is_new_folder(files[-1]) and joined[-1] != "--pair":
                rest.insert(0, files.pop())  # the folder stands last: --photos *.jpg mine
            elif not files:
                continue
            joined.append(_BETWEEN.join(files))
        return super().parse_args(ctx, joined)


def _is_new_folder(name: str) -> bool:
    return not Path(name).suffix and "*" not in name and not Path(name).is_file()


@dataclass(frozen=True)
class OwnOptions:
    """Scenes, pairs, pictures and methods of the user's own."""

    scene: Annotated[list[str] | None, typer.Option(metavar="FILE")] = None
    """A 3D file of yours (.glb, .gltf), or a built-in scene; may be given more than once. It
    is copied, with all that it names, and views of it are drawn."""
    pair: Annotated[list[str] | None, typer.Option(metavar="LEFT RIGHT DISPARITY")] = None
    """A rectified pair of photographs of yours, with the disparity of the left one; may be given
    more than once."""
    units_per_px: list[float] | None = None
    """Number in the disparity file for one pixel; left out: 1. Give this and the next three once
    for all pairs, or once for each pair in order."""
    focal_px: list[float] | None = None
    """Focal length of a pair; left out: assumed."""
    baseline_m: list[float] | None = None
    """Metres between a pair's cameras; left out: assumed."""
    offset_px: list[float] | None = None
    """Offset of a pair's principal points (doffs); left out: 0."""
    photos: Annotated[list[str] | None, typer.Option(metavar="FILE ...")] = None
    """Photographs of yours, such as *.jpg: each is shown as methods prepare it for an eye that
    looks at its middle."""
    quick: bool = False
    """With --photos alone: a metamer test of yourself. 60 trials of ABX tell up to which scaling of
    their pools pictures and their metamers look the same to you; no tracker is needed."""
    exr: Annotated[list[str] | None, typer.Option(metavar="FRAMES")] = None
    """OpenEXR frames of yours with depth and motion, such as 'shot_####.exr'; or one with depth;
    may be given more than once."""
    channel: Annotated[list[str] | None, typer.Option(metavar="WHAT=NAME")] = None
    """A channel of --exr that is not recognised: r, g, b, depth, motion_x or motion_y; may be given
    more than once."""
    unknown: Annotated[list[str] | None, typer.Option(metavar="NUMBER")] = None
    """A number in the disparity files that stands for unknown, as it is stored; may be repeated.
    none: no further number does."""
    methods: Annotated[str | None, typer.Option(metavar="A,B,...")] = None
    """Names from 'metamerlab warp --list', onnx:FILE, frames:FOLDER, and 'reference', the true
    view; with --photos names from 'metamerlab foveate --list'. The study's test compares the first
    with the second."""

    def pairs(self) -> list[PairFiles]:
        """Return the pairs, each with its rig: what is given once holds for all of them.

        Raises
        ------
        StudyError
            If a pair is not three files, or an option is given another number of times.
        """
        named = self.pair or []
        rigs: list[dict[str, Any]] = [{} for _ in named]
        for key in ("units_per_px", "focal_px", "baseline_m", "offset_px"):
            values = getattr(self, key)
            if not values:
                continue
            option = f"--{key.replace('_', '-')}"
            if not named:
                raise StudyError(
                    f"{option}: --units-per-px, --focal-px, --baseline-m and --offset-px are of a"
                    " pair (got none); give it with --pair LEFT RIGHT DISPARITY, or leave them out"
                )
            if len(values) not in (1, len(named)):
                raise StudyError(
                    f"{option}: must be given once for all pairs, or once for each (got"
                    f" {len(values)} times, and {len(named)} pairs)"
                )
            for index, rig in enumerate(rigs):
                rig[key] = values[index if len(values) > 1 else 0]
        unknown = unknown_numbers(self.unknown)
        if not named:
            return []
        from stimuli.recipes.bring_in import PairFiles

        pairs = []
        for text, rig in zip(named, rigs, strict=True):
            files = text.split(_BETWEEN)
            if len(files) != len(_PAIR_FILES):
                raise StudyError(
                    f"--pair: must be followed by three files, {' '.join(_PAIR_FILES)} (got"
                    f" {', '.join(files)}); '--pair left.png right.png disparity.pfm' is an example"
                )
            left, right, disparity = map(Path, files)
            pairs.append(replace(PairFiles(left, right, disparity), **rig, unknown=unknown))
        return pairs


def new_study(
    folder: Annotated[Path, typer.Argument(help="New folder.", metavar="DIR")],
    name: Annotated[
        str | None,
        typer.Option(help="Name of the study in files and folders; default: the folder's name."),
    ] = None,
    title: Annotated[
        str | None, typer.Option(help="Title for people to read; default: the name.")
    ] = None,
    display: Annotated[
        str, typer.Option(help="Display to start from: a shipped name or a .toml file.")
    ] = "fhd27-60hz",
    task: Annotated[
        str, typer.Option(metavar="NAME", help=f"Task of participants: {', '.join(TEMPLATES)}.")
    ] = "two-interval",
    *,
    own: OwnOptions,
) -> None:
    """Make a folder to start a study from: protocol, display file, and where things belong.

    The files explain every key, and pass 'metamerlab protocol check' as they are. Clips are
    small, so the first build is short. The folder's README.md says what to do next. Tasks with a
    right answer start from a few small pictures and their table.

    With --scene, --pair, --exr, --photos and --methods the study uses what you name. Files are
    copied into the folder. The photographs of a pair are checked against each other. Views of
    every 3D file are drawn on a sheet, and the first view is written into study.toml.

    Examples:

        metamerlab new-study my-study

        metamerlab new-study my-thresholds --task yes-no

        metamerlab new-study mine --scene place.glb --pair left.png right.png disparity.pfm \\
            --methods coherence-transport,push-pull,reference

        metamerlab new-study seen --photos *.jpg --methods blur,metamer

        metamerlab new-study me --photos a.jpg b.jpg --quick

        metamerlab new-study shot --exr 'shot_####.exr'
    """
    named = slug(folder.absolute().name) if name is None else name
    named = study_name(named, "--name", "give one with --name")
    words = named.replace("-", " ").replace("_", " ").capitalize()
    shown = study_title(words if title is None else title)
    screen = load_display(display)
    study_files(named, shown, screen, task)  # a mistake is told before anything is copied
    if own.quick:
        if task != "two-interval" or own.methods is not None or not own.photos:
            raise StudyError(
                "--quick: must be given with --photos and without --task and --methods (it is ABX"
                " of photographs and their metamers); leave those out, or --quick"
            )
        task = "abx"
    pairs = own.pairs()
    from stimuli.recipes.example_pictures import example_files

    with whole_folder(folder) as work:
        taken, notes = _own(work, folder, own, pairs, screen)
        secret = secrets.token_hex(32)
        texts = study_files(named, shown, screen, task, secret=secret, own=taken)
        made = {file: text.encode() for file, text in texts.items()} | example_files(task)
        for file, data in made.items():
            (work / file).parent.mkdir(exist_ok=True)
            with open(work / file, "wb", opener=open_new) as written:
                written.write(data)
        for below in (*FOLDERS, inputs_folder(task, taken)):
            (work / below).mkdir(exist_ok=True)
    say_notes(notes)
    say(f"{folder}: the study {named!r}, ready to be made yours. Next:")
    say(f"  cd {shlex.quote(str(folder))}")
    begin = "stimuli build study.toml --out clips" if own.quick else "protocol check study.toml"
    say(f"  metamerlab {begin}")
    say("and see README.md there.")


def _channels(given: list[str] | None) -> dict[str, str]:
    named = pairs_of("--channel", given or ())
    return {one_of("--channel", key, _CHANNELS): name for key, name in named.items()}


def _own(
    work: Path, folder: Path, own: OwnOptions, pairs: list[PairFiles], screen: Display
) -> tuple[OwnStimuli, list[str]]:
    """Copy what is named into `work`; return it, and notes."""
    channels = _channels(own.channel)
    if channels and not own.exr:
        raise StudyError("--channel: is of OpenEXR frames (got none); give them with --exr")
    if not (own.scene or pairs or own.photos or own.exr or own.methods is not None):
        return OwnStimuli(), []
    if own.photos:
        if own.scene or pairs or own.exr:
            raise StudyError(
                "--photos: must be given without --scene, --pair and --exr (a study shows pictures"
                " for a gaze, or clips of scenes); make a study of each"
            )
        return _own_photographs(work, folder, own, screen)
    return _own_scenes(work, folder, own, pairs, screen)


def _own_photographs(
    work: Path, folder: Path, own: OwnOptions, screen: Display
) -> tuple[OwnStimuli, list[str]]:
    from stimuli.recipes.bring_in import bring_methods, bring_photographs

    files: list[str] = []
    for name in (name for group in own.photos or () for name in group.split(_BETWEEN)):
        files += _found(name)
    _each_once("--photos", [str(without_links(Path(file))) for file in files])
    methods = own.methods
    shown = () if methods is None else bring_methods(methods, work, folder, stills=True)
    whole = screen.width_px, screen.height_px
    scenes, size_px, notes = bring_photographs(list(map(Path, files)), work, whole)
    return OwnStimuli(tuple(scenes), shown, stills_px=size_px, quick=own.quick), notes


def _found(name: str) -> list[str]:
    """Return the files that a pattern of a shell stands for; what is missing stays, and is said."""
    found = [name] if Path(name).exists() else sorted(glob(name))  # noqa: PTH207  also absolute
    return found or [name]


def _each_once(option: str, names: Sequence[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise StudyError(f"{option}: names {Path(twice[0]).name} twice; name each once")


def _pattern(given: list[str]) -> str:
    """Return a sequence as one name, its number as ``####``; a shell may have written it out."""
    from pipeline.pictures.stored_frames import sequence_files

    files = [file for name in given for file in _found(name)]
    for folder in filter(Path.is_dir, map(Path, files)):
        raise StudyError(
            f"--exr {folder}: must be frames (this is a folder); name those in it, such as"
            f" '{folder}/shot_####.exr'"
        )
    if len(files) == 1:
        return re.sub(r"%0?(\d)d", lambda n: "#" * int(n[1]), files[0])
    names = {
        name if "#" in name else re.sub(r"\d+(?=\D*$)", lambda n: "#" * len(n[0]), name)
        for name in files
    }
    if len({re.sub("#+", "#", name) for name in names}) > 1:
        raise StudyError(
            "--exr: must be frames of one sequence, such as 'shot_####.exr' (got"
            f" {' and '.join(sorted(names)[:2])}); give --exr once for each"
        )
    pattern = min(names, key=len)
    known = {str(file) for file in sequence_files(pattern, Path())}
    if left := sorted(known - {str(Path(file)) for file in files}):
        raise StudyError(
            f"--exr: must name every frame of {pattern} (got {len(files)}, and not {left[0]}); name"
            f" '{pattern}', or copy the frames that you want into a folder of their own"
        )
    return pattern


def _own_scenes(
    work: Path, folder: Path, own: OwnOptions, pairs: list[PairFiles], screen: Display
) -> tuple[OwnStimuli, list[str]]:
    scenes, methods, channels = own.scene or [], own.methods, _channels(own.channel)
    # Imported here: they bring the renderer along.
    from pipeline.errors import GLUnavailableError
    from pipeline.gl.context import create_context, release_context
    from stimuli.recipes.bring_in import (
        bring_frames,
        bring_methods,
        bring_pair,
        bring_scene,
        clips_of,
    )
    from stimuli.scenes.mesh_inputs import ENDINGS

    fills = () if methods is None else bring_methods(methods, work, folder)
    found: list[OwnScene] = []
    photographed: list[OwnScene] = []
    notes: list[str] = []
    for pair in pairs:  # before views are drawn: it may be refused
        brought, of_it = bring_pair(pair, work, [each.name for each in photographed])
        photographed.append(brought)
        notes += of_it
    asked = []
    patterns = [_pattern(files.split(_BETWEEN)) for files in own.exr or ()]
    _each_once("--exr", patterns)
    for pattern in patterns:
        names = [each.name for each in photographed]
        brought, clips = bring_frames(pattern, work, names, channels)
        photographed.append(brought)
        asked += [] if clips is None else [clips]
    ctx = None
    if any(scene.lower().endswith(ENDINGS) for scene in scenes):
        try:
            ctx = create_context()
        except GLUnavailableError as error:
            notes.append(f"no views of 3D files were drawn: {error}")
    try:
        with progress_line("trying views") as report:
            for scene in scenes:
                taken = [each.name for each in (*photographed, *found)]
                say_of = partial(_say_of, report, f"views of {Path(scene).name}")
                found.append(bring_scene(scene, work, taken, ctx, say_of, notes.append))
    finally:
        if ctx is not None:
            release_context(ctx)
    of_all = clips_of(asked, screen, len(found) + len(photographed))
    if of_all is not None:
        notes += _left_away(asked, of_all)
    return OwnStimuli((*found, *photographed), fills, of_all), notes


def _left_away(asked: Sequence[OwnClips], of_all: OwnClips) -> list[str]:
    """Return notes on parts of the sequences that no clip shows."""
    notes, kept_px = list[str](), (of_all.width_px, of_all.height_px)
    for clips in asked:
        size_px = clips.width_px, clips.height_px
        if kept_px != size_px:
            notes.append(
                f"clips show the middle {kept_px[0]} x {kept_px[1]} px of frames of {size_px[0]} x"
                f" {size_px[1]}: what the display, and the smallest sequence, has room for, in"
                " whole pairs of pixels"
            )
    longest = max((clips.frames for clips in asked), default=0)
    if of_all.frames < longest:
        notes.append(
            f"clips have {of_all.frames} of {longest} frames: as many as the shortest sequence has"
            " and as twice two clips fit into clip_memory_mib of display.toml"
        )
    return notes


def _say_of(report: Callable[[int, int, str], None], what: str, done: int, total: int) -> None:
    report(done, total, what)


def open_new(path: str, flags: int) -> int:
    """Open a file of a study that is written: nobody but its owner ever reads a secret."""
    return os.open(path, flags, 0o600 if path.endswith(SECRET_SUFFIX) else 0o666)


def study_name(name: str, where: str, cure: str) -> str:
    """Return a study's name; `StudyError` says where another must be given."""
    if not re.fullmatch(NAME_PATTERN, name) or len(name) > NAME_LENGTH:
        raise StudyError(
            f"{where}: must be {NAME_IN_WORDS}, at most {NAME_LENGTH} characters (got {name!r});"
            f" {cure}"
        )
    return name


def study_title(title: str) -> str:
    """Return a title as TOML may hold it; `StudyError` says what it must be."""
    shown = title.strip()
    if not shown or re.search(r'["\\\x00-\x1f]', shown):
        raise StudyError(
            "--title: must hold no quotes, backslashes and line ends, and not be empty (got"
            f" {shown!r})"
        )
    return shown


def slug(text: str) -> str:
    """Return a folder's name as the name of a study may be."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
