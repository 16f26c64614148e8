"""Scenes, photographs and networks of a user's own, copied into the folder of a new study.

What cannot be a scene is refused before a study is written: a mesh that cannot be read, photographs
that do not belong together, a network without its weights.
"""

from __future__ import annotations

import os.path
import re
import shlex
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Final

import moderngl

from pipeline.errors import InputError
from pipeline.foveation.conditions import check_condition_name, condition_names
from pipeline.methods.registry import check_method_name, method_names
from pipeline.pictures.colour_file import Transfer, read_any, stored_transfer
from pipeline.pictures.decode import read_parts
from pipeline.pictures.header import display_size
from pipeline.pictures.stored_frames import sequence_files
from protocols.display import Display
from protocols.gone import gone
from protocols.recipes.warped_clips import ExrScene
from protocols.study_file.own_stimuli import (
    REFERENCE,
    OwnClips,
    OwnMethod,
    OwnScene,
    methods_of,
    quoted,
    unused_name,
)
from stimuli.rendering.scene_views import ScenePreview, look_around
from stimuli.scenes.builtin_scenes import scene_names
from stimuli.scenes.mesh_file import load_world
from stimuli.scenes.mesh_inputs import ENDINGS, files_of
from stimuli.scenes.pair_check import judge_pair
from stimuli.scenes.sequence import load_picture, motion_of
from stimuli.scenes.stereo import ASSUMED_BASELINE_M, BUILT_IN, built_in_pair, load_pair

VIEWS: Final = 8
VIEWS_FILE: Final = "views.png"
SCENES: Final = "scenes"
PICTURES: Final = "pictures"
NETWORKS: Final = "networks"


@dataclass(frozen=True)
class PairFiles:
    """A stereo pair as a user names it; see `stimuli.scenes.stereo.load_pair`."""

    left: Path
    right: Path
    disparity: Path
    units_per_px: float = 1.0
    focal_px: float | None = None
    baseline_m: float | None = None
    offset_px: float = 0.0
    unknown: tuple[float, ...] | None = None

    @property
    def is_built_in(self) -> bool:
        """True if it is one that comes with a package, named three times."""
        names = {str(self.left), str(self.right), str(self.disparity)}
        return len(names) == 1 and names <= set(BUILT_IN) and not self.left.exists()


def bring_scene(
    scene: str,
    study: Path,
    taken: Collection[str],
    ctx: moderngl.Context | None,
    report: Callable[[int, int], None] = lambda _done, _total: None,
    note: Callable[[str], None] = lambda _: None,
) -> OwnScene:
    """Copy a 3D file with all that it names to ``scenes/NAME``, and draw views of it there.

    Parameters
    ----------
    scene : str
        A ``.glb`` or ``.gltf`` file, or the name of a built-in scene.
    study : Path
        Folder of the new study.
    taken : collection of str
        Names of the scenes before it.
    ctx : moderngl.Context, optional
        Left out: no views are drawn, and the camera is the file's own.
    report : callable
        Is told views tried and views in all.
    note : callable
        Is told what the file says and is not drawn.

    Raises
    ------
    InputError, OSError
        If a file is missing, broken, or of another kind.
    """
    path = Path(scene)
    if scene in scene_names() and not path.exists():
        name = unused_name(scene, taken)
        made = (f'builtin = "{scene}"', f"seed = {len(taken) + 1}")
        return OwnScene(name, _label(scene), ('kind = "builtin"', *made, _CIRCLE))
    if path.suffix.lower() not in ENDINGS and gone(path.suffix.lower()) is None:
        raise InputError(
            f"--scene {scene}: must be a {' or '.join(ENDINGS)} file, or a"
            f" built-in scene ({', '.join(scene_names())}). Photographs are given with --photos,"
            " OpenEXR frames with --exr, and a pair with --pair; a picture with a depth file is"
            " written into study.toml, where a new study has an example"
        )
    name = unused_name(path.stem, taken)
    folder = study / SCENES / name
    for line in load_world(path).notes:
        note(line)
    for file in files_of(path):
        _copy(file, folder / os.path.relpath(file, path.parent))
    lines = ('kind = "mesh"', f"file = {quoted(f'{SCENES}/{name}/{path.name}')}")
    if ctx is None:
        camera: tuple[str, ...] = (
            f"# metamerlab stimuli look {shlex.quote(f'{SCENES}/{name}/{path.name}')}",
            "# draws views, with the line for each.",
            "#? view = { position_m = [0, 1.6, 4], look_at_m = [0, 1, 0], vertical_fov_deg = 50 }",
        )
    else:
        preview = ScenePreview(str(folder / path.name))
        views = look_around(ctx, preview, folder / VIEWS_FILE, VIEWS, report=report)
        first, *others = [line.partition(": ")[2] for line in views]
        camera = (
            f"# View 0 of {SCENES}/{name}/{VIEWS_FILE}. Views 1 to {len(others)} of that sheet:",
            *(f"#   {line}" for line in others),
            first,
        )
    return OwnScene(name, _label(path.stem), (*lines, *camera, _CIRCLE))


def bring_pair(pair: PairFiles, study: Path, taken: Collection[str]) -> tuple[OwnScene, list[str]]:
    """Copy a stereo pair to ``scenes/NAME``; return it, and notes of what to look at.

    Raises
    ------
    InputError, OSError
        If a file is missing or broken, or the three do not belong together.
    """
    name = unused_name("pair", taken)
    if pair.is_built_in:
        name = unused_name(str(pair.left), taken)
        rig = built_in_pair(str(pair.left))
        files = dict.fromkeys(("left", "right", "disparity"), str(pair.left))
        pair = replace(
            pair, focal_px=rig.focal_px, baseline_m=rig.baseline_m, offset_px=rig.offset_px
        )
        notes = []
    else:
        loaded = load_pair(
            pair.left, pair.disparity, pair.right, units_per_px=pair.units_per_px,
            focal_px=pair.focal_px, baseline_m=pair.baseline_m or ASSUMED_BASELINE_M,
            offset_px=pair.offset_px, unknown=pair.unknown,
        )  # fmt: skip
        verdict = judge_pair(loaded, units_per_px=pair.units_per_px)
        if verdict.refused:
            raise InputError(f"--pair: {verdict}")
        notes = [f"{name}: {verdict}"] if verdict.doubtful else []
        files = {}
        for side in ("left", "right", "disparity"):
            file: Path = getattr(pair, side)
            place = study / SCENES / name / f"{side}{file.suffix.lower()}"
            _copy(file, place)
            files[side] = place.relative_to(study).as_posix()
        if pair.focal_px is None or pair.baseline_m is None:
            notes.append(
                f"{name}: focal_px and baseline_m are assumed where not given; depths are then"
                " right in ratio, which is all that filling needs"
            )
            pair = replace(
                pair, focal_px=loaded.focal_px, baseline_m=pair.baseline_m or ASSUMED_BASELINE_M
            )
    units = () if pair.units_per_px == 1 else (f"units_per_px = {pair.units_per_px:g}",)
    told = pair.unknown or ()
    unknown = () if pair.unknown is None else (f"unknown = [{', '.join(map(str, told))}]",)
    offset = () if pair.offset_px == 0 else (f"offset_px = {pair.offset_px:g}",)
    lines = (
        'kind = "stereo"',
        *(f"{side} = {quoted(file)}" for side, file in files.items()),
        *units,
        *unknown,
        f"focal_px = {pair.focal_px:g}",
        f"baseline_m = {pair.baseline_m:g}",
        *offset,
        'camera = { kind = "stereo" }',
    )
    return OwnScene(name, _label(name), lines), notes


def bring_photographs(
    photographs: Sequence[Path], study: Path, screen_px: tuple[int, int]
) -> tuple[list[OwnScene], tuple[int, int], list[str]]:
    """Copy photographs to ``pictures/``; return them, the size of stills, and notes.

    Stills are as large as the screen, or in its shape as large as the smallest photograph allows,
    so that none is enlarged. Sizes are (width, height).

    Raises
    ------
    InputError, OSError
        If a file is missing or no picture.
    """
    found: list[OwnScene] = []
    notes: list[str] = []
    share, smallest = 1.0, ""
    for path in photographs:
        height, width = read_any(path).colour.shape[:2]
        covered = min(width / screen_px[0], height / screen_px[1])
        if covered < share:
            share, smallest = covered, f"{path.name}, {width} x {height} px"
        name = unused_name(path.stem, [each.name for each in found])
        file = f"{PICTURES}/{name}{path.suffix.lower()}"
        _copy(path, study / file)
        found.append(OwnScene(name, None, (f"file = {quoted(file)}",)))
    size_px = max(1, int(share * screen_px[0])), max(1, int(share * screen_px[1]))
    if smallest:
        notes.append(
            f"stills are {size_px[0]} x {size_px[1]} px, so that no photograph is enlarged (the"
            f" smallest is {smallest}; the display has {screen_px[0]} x {screen_px[1]}); larger"
            " photographs fill the display"
        )
    return found, size_px, notes


def bring_frames(
    pattern: str, study: Path, taken: Collection[str], channels: Mapping[str, str]
) -> tuple[OwnScene, OwnClips | None]:
    """Copy OpenEXR frames to ``scenes/NAME``; return the scene, and what it asks of clips.

    Several frames are a sequence with its own motion: every second one is shown, the others are
    warped from it. One frame is a picture with depth, which asks nothing.

    Parameters
    ----------
    pattern : str
        A file, or a path in which ``####`` stands for the number of a frame.
    channels : mapping
        Names of channels that are not recognised, by the keys of `ExrScene.channels`.

    Raises
    ------
    InputError, OSError
        If there is no file, a number is missing in between, or the first or last frame lacks
        colour, depth or motion.
    """
    files = sequence_files(pattern, Path())
    name = unused_name(Path(re.sub("#+", "", pattern)).stem, taken)
    several = len(files) > 1
    said = stored_transfer(files[0], read_parts(files[0], encoded=True).attributes)
    scene = ExrScene.model_validate(
        {
            "kind": "exr", "name": name, "file": pattern, "channels": dict(channels),
            "camera": {"kind": "upsampling", "real_every": 2},
            "transfer": "linear" if said is Transfer.ENCODED else "srgb",
        }
    )  # fmt: skip
    try:
        for file in dict.fromkeys((files[0], files[-1])):
            height, width = load_picture(file, scene).frame.size
        for file in files:
            found = display_size(file)
            if found != (width, height):
                raise InputError(
                    f"{file}: frames of a sequence must have one size (got {found[0]}x{found[1]} px"
                    f" here and {width}x{height} in {files[-1].name}); render it anew"
                )
        if several:
            motion_of(files[0], read_parts(files[0], judged=True).planes, scene)
    except InputError as error:
        channel = "motion_x" if " for motion (" in str(error) else "depth"
        cure = _CHANNEL.format(channel) + _ONE_FRAME * (channel == "motion_x")
        raise InputError(
            re.sub(r"name (it|both) in the protocol: .*", cure, f"--exr: {error}")
        ) from None
    for file in files:
        _copy(file, study / SCENES / name / file.name)
    lines = [
        'kind = "exr"',
        f"file = {quoted(f'{SCENES}/{name}/{Path(pattern).name}')}",
        *(["channels = " + _table(channels)] if channels else []),
        *(['transfer = "linear"'] if scene.transfer == "linear" else []),
        "#? focal_px = 1000.0",
        'camera = { kind = "upsampling", real_every = 2 }' if several else _CIRCLE,
    ]
    clips = OwnClips(width, height, len(files), alone=True) if several else None
    return OwnScene(name, _label(name), tuple(lines), has_truth=several), clips


def _table(texts: Mapping[str, str]) -> str:
    return "{ " + ", ".join(f"{key} = {quoted(text)}" for key, text in texts.items()) + " }"


def clips_of(asked: Sequence[OwnClips], screen: Display, scenes: int) -> OwnClips | None:
    """Return the wishes of all sequences together for clips; None where there is none.

    That is the smallest of their sizes, in whole pairs of pixels, on a screen that holds it, and
    as many frames as each has and as fit twice two clips into the screen's memory.

    Parameters
    ----------
    asked : sequence of OwnClips
        What each sequence asks.
    scenes : int
        How many scenes the study has in all.
    """
    if not asked:
        return None
    width_px, height_px = (
        min(whole, *(getattr(one, edge) for one in asked)) // 2 * 2
        for edge, whole in (("width_px", screen.width_px), ("height_px", screen.height_px))
    )
    fit = screen.clip_memory_mib * 2**20 // (4 * 4 * width_px * height_px)
    frames = min(fit, *(one.frames for one in asked))
    return OwnClips(width_px, height_px, max(1, frames), alone=len(asked) == scenes)


def bring_methods(
    text: str, study: Path, target: Path, *, stills: bool = False
) -> tuple[OwnMethod, ...]:
    """Return the methods that ``a,b,onnx:FILE`` names; networks are copied into the study.

    Parameters
    ----------
    text : str
        Names joined by commas; `reference` is the true view.
    study : Path
        The folder that is filled.
    target : Path
        Where it will lie: paths of frames that are there already are told from it.
    stills : bool
        They prepare stills for a gaze, as `metamerlab foveate` does; else they fill holes.

    Raises
    ------
    InputError, StudyError, OSError
        If a method is unknown, with the nearest name, or its file cannot be read.
    """
    names = condition_names() if stills else [REFERENCE, *method_names()]
    check = check_condition_name if stills else check_method_name
    known = [name for name in names if ":" not in name]
    return tuple(_brought(method, study, target, check) for method in methods_of(text, known))


def _brought(
    method: OwnMethod, study: Path, target: Path, check: Callable[[str], object]
) -> OwnMethod:
    if method.method is None:
        return method
    check(method.method)
    kind, _, given = method.method.partition(":")
    path = Path(given)
    if kind == "onnx":
        from pipeline.methods.onnx_files import network_files

        folder = study / NETWORKS / method.name
        for file in network_files(path):
            _copy(file, folder / os.path.relpath(file, path.parent))
        return replace(method, method=f"onnx:{NETWORKS}/{method.name}/{path.name}")
    fixed = Path(*takewhile(lambda part: "{" not in part, path.parts))  # before {scene} and such
    if not path.is_absolute() and fixed.exists():
        return replace(method, method=f"{kind}:{os.path.relpath(path, target)}")
    return method


def _copy(file: Path, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, place)


def _label(name: str) -> str:
    plain = re.sub(r"[-_\s]+", " ", name).strip()
    return plain[:1].upper() + plain[1:]


_CHANNEL = "name it: --channel {}=NAME (r, g, b, depth, motion_x or motion_y)"
_ONE_FRAME = ", render the frames with motion, or give one of them alone"
_CIRCLE = 'camera = { kind = "circle", turns = 1.0 }'
