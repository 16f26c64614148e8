"""Input of `metamerlab warp`: a file, a picture with motion or depth, or a stereo pair."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.view import SCORED_DEG, square_view
from pipeline.frame import PanoramaFrame, SourceFrame, check_file_size
from pipeline.pictures.channels import Channels
from pipeline.pictures.colour_file import Transfer, load_colour
from pipeline.pictures.depth_and_flow import DEPTH_IS, DepthIs
from pipeline.pictures.header import check_fits
from pipeline.pictures.panorama_file import load_panorama
from pipeline.pictures.warp_input import (
    NEARER,
    WarpInput,
    from_depth,
    from_flow,
    from_the_side,
    load_warp_input,
    motion_between,
    read_pose,
)
from pipeline.warp.around import Outlook, seen_from
from pipeline.warp.settings import WarpSettings
from protocols.errors import StudyError, must_be_one_of
from protocols.plausible_numbers import hardly_meant
from protocols.recipes.warped_clips import AroundScene, LinePath
from stimuli.scenes.builtin_pictures import SEED
from stimuli.scenes.builtin_scenes import scene_names
from stimuli.scenes.pair_check import judge_pair
from stimuli.scenes.stereo import BUILT_IN, PAIR_WARP, StereoPair, built_in_pair, load_pair
from stimuli.scenes.truth_check import (
    Readings,
    TruthVerdict,
    flow_readings,
    judge_truth,
    no_readings,
    pose_readings,
    sideways_readings,
)
from stimuli.score.pair import read_colour, read_hole_mask
from study_app.cli.options import one_of
from study_app.cli.pictures.warp_options import (
    FileOptions,
    PairOptions,
    PanoramaOptions,
    PictureOptions,
    SourceOptions,
)
from study_app.cli.terminal import say

BUILTIN = "builtin:"
DEFAULT_PARALLAX = 0.03
"""Parallax of near things, in widths of the picture."""


_FILE_ONLY = "--clip, --encoded and --channel belong to files of colour, depth and flow"


class _DepthFile(TypedDict):
    depth_scale: float
    depth_is: DepthIs
    unknown: tuple[float, ...] | None


@dataclass(frozen=True)
class LoadedSource:
    """Input of a warp, its settings where nothing else is said, and the truth if it is known."""

    frame: WarpInput
    settings: WarpSettings
    truth: NDArray[np.float32] | None
    hole: NDArray[np.bool_] | None = None
    """Pixels to fill besides those that the warp uncovers."""
    readings: Readings = no_readings
    """Other readings of the files, if the warp does not show what the true view shows."""
    around: PanoramaFrame | None = None
    """Panorama that the frame looks out of, and the move of the eye."""
    move_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    view_deg: float | None = None
    """Visual angle of the frame's width, where the source tells it."""
    words: str | None = None
    """Line on how far pixels move, and what would make it wrong; for whoever has no true view."""


def load(source: str, given: SourceOptions) -> LoadedSource:
    """Read what to warp.

    With a mask the picture stays as it is, without depth, and what the mask marks is its hole.

    Raises
    ------
    StudyError
        If the source is nothing that can be warped, or an option belongs to another kind.
    OSError, InputError
        If a file is missing or not what it must be.
    """
    file, picture, pair, truth, mask = (
        given.file, given.picture, given.pair, given.truth, given.mask
    )  # fmt: skip
    if truth is not None and pair.right is not None:
        raise StudyError("--truth and --right name the same picture: give one of them")
    if source in BUILT_IN and not Path(source).exists():
        wanted = "--flow, --depth, cameras and poses need" if mask is None else "--mask needs"
        if mask is not None or picture != PictureOptions():
            raise StudyError(
                f"{source}: is a built-in pair, whose disparity makes its holes; {wanted} a picture"
                " file in its place, such as photo.png"
            )
    one_of("--nearer", picture.nearer, NEARER)
    one_of("--depth-is", picture.depth_is or "distance", DEPTH_IS)
    if given.panorama != PanoramaOptions() and not given.panorama.panorama:
        raise StudyError("--move, --look, --view-deg and --around need --panorama; add it")
    for path in filter(None, (Path(source), truth, pair.right, mask)):
        check_fits(path, "warp")
    if given.panorama.panorama:
        loaded = _load_around(source, given)
    elif mask is None:
        loaded = _load(source, file, pair, picture)
    elif (pair, picture) != (PairOptions(), PictureOptions()):
        raise StudyError(
            "--mask fills a picture as it is: give it without --flow, --depth, --disparity and"
            " what belongs to them"
        )
    else:
        loaded = _load_masked(Path(source), file, mask)
    if truth is None:
        if loaded.words is not None:
            say(loaded.words)
        return loaded
    shown = _load_colour(truth, file)
    check_file_size(truth, shown, f"the view of {source}", np.empty(loaded.frame.size))
    known = None if loaded.hole is None else ~loaded.hole
    verdict = judge_truth(loaded.frame, shown, loaded.readings, known)
    _obey(verdict, f"{truth}: {verdict}", "--truth")
    return replace(loaded, truth=shown)


def _load_around(source: str, given: SourceOptions) -> LoadedSource:
    """A flat view out of a panorama with distance; of a built-in scene with its truth."""
    asked, file, picture = given.panorama, given.file, given.picture
    plain = replace(picture, depth=None, depth_scale=1.0, depth_is=None, unknown=None)
    if plain != PictureOptions() or given.pair != PairOptions() or given.mask is not None:
        raise StudyError(
            "--panorama takes --depth, --depth-scale, --depth-is and --unknown; --move and --look"
            " say where the eye is: leave out --mask, --flow, --camera, poses, --parallax, and"
            " options of stereo pairs"
        )
    move_m = _numbers("--move", asked.move, (0.0, 0.0, 0.0), "X,Y,Z in metres, such as 0.2,0,-0.1")
    words = "RIGHT,DOWN in degrees, such as 90,-30"
    right, down = _numbers("--look", asked.look, (0.0, 0.0), words)
    view_deg = asked.view_deg or SCORED_DEG
    truth = None
    if source.startswith(BUILTIN):
        if picture != PictureOptions() or file != FileOptions():
            raise StudyError(f"{source}: brings its own distances; leave options of files out")
        frame, truth = _draw_around(source.removeprefix(BUILTIN), (right, down), view_deg, move_m)
    else:
        frame = load_panorama(
            Path(source), picture.depth, depth_scale=picture.depth_scale,
            depth_is=one_of("--depth-is", picture.depth_is or "ray", DEPTH_IS),
            unknown=picture.unknown, channels=_channels(file.channels),
            transfer=Transfer.ENCODED if file.encoded else None, clip=file.clip,
        )  # fmt: skip
    geometry = square_view(frame.distance_m.shape[1], view_deg)
    made = seen_from(frame, Outlook.towards(geometry, move_m, right, down))
    near_m = float(np.percentile(frame.distance_m, 5))
    words = f"the eye moves by {math.hypot(*move_m):.3g} m; what is near is {near_m:.3g} m away"
    told = LoadedSource(made, WarpSettings(), truth, words=words)
    return replace(told, around=frame, move_m=move_m, view_deg=view_deg)


def _draw_around(
    name: str, look_deg: tuple[float, float], view_deg: float, move_m: tuple[float, ...]
) -> tuple[PanoramaFrame, NDArray[np.float32]]:
    """Draw a built-in scene all around, and what an eye sees of it that has moved."""
    from pipeline.gl.context import lent_context
    from stimuli.rendering.open_scene import open_renderer
    from stimuli.scenes.surroundings import open_around

    if name not in scene_names():
        raise StudyError(must_be_one_of("a built-in scene", name, scene_names()))
    scene = AroundScene(
        kind="around", name=name, builtin=name, seed=SEED, camera=LinePath(kind="line"),
        right_deg=look_deg[0], down_deg=look_deg[1], view_deg=view_deg, parameters={},
    )  # fmt: skip
    with lent_context() as ctx:
        scenery = open_around(scene, Path(), open_renderer(ctx, scene, Path()))
        edge = square_view(2 * scene.height_px, scene.view_deg).width_px
        truth = scenery.view((edge, edge), np.asarray(move_m))
        scenery.release()
        return scenery.frame, truth


def _numbers(
    option: str, text: str | None, default: tuple[float, ...], words: str
) -> tuple[float, ...]:
    """Read numbers that commas part, as many as `default` has."""
    if text is None:
        return default
    with suppress(ValueError):
        found = tuple(float(part) for part in text.split(","))
        if len(found) == len(default) and all(map(math.isfinite, found)):
            return found
    raise StudyError(f"{option} must be {words} (got {text!r})")


def _load_colour(path: Path, file: FileOptions) -> NDArray[np.float32]:
    return load_colour(
        path,
        transfer=Transfer.ENCODED if file.encoded else None,
        clip=file.clip,
        channels=_channels(file.channels),
    )


def _load_masked(path: Path, file: FileOptions, mask: Path) -> LoadedSource:
    """A picture whose camera stays: all of it lies at one depth, and nothing moves."""
    colour = _load_colour(path, file)
    shown = read_colour(mask)
    check_file_size(mask, shown, path, colour)
    hole = read_hole_mask(mask, colour.shape[:2])
    must = f"{mask}: must be white in holes and black elsewhere (all of it is"
    if hole.all():
        light = "white" if shown.min() == 1 else f"at least {100 * shown.min():.0f} % of white"
        raise StudyError(f"{must} {light}); paint black what is to stay")
    if not hole.any():
        raise StudyError(f"{must} black); paint white what is to be filled")
    depth_m = np.ones(hole.shape, np.float32)
    frame = WarpInput(SourceFrame(colour, depth_m), np.zeros((*hole.shape, 2), np.float32))
    return LoadedSource(frame, WarpSettings(), None, hole)


def _load(
    source: str, file: FileOptions, pair: PairOptions, picture: PictureOptions
) -> LoadedSource:
    path = Path(source)
    if picture != PictureOptions():
        if pair != PairOptions():
            raise StudyError(
                "options of stereo pairs (--disparity, --right, --to-left, --amount ...) do not go"
                " with --flow or --depth"
            )
        if file != FileOptions():
            raise StudyError(_FILE_ONLY)
        return _load_picture(path, picture)
    if path.suffix.lower() == ".exr" and pair.disparity is None:
        if pair != PairOptions():
            raise StudyError(
                "options of stereo pairs (--right, --to-left, --amount, --focal-px ...) do not go"
                " with a file that has its flow (its truth is named by --truth)"
            )
        transfer = Transfer.ENCODED if file.encoded else None
        names = _channels(file.channels)
        frame = load_warp_input(path, channels=names, transfer=transfer, clip=file.clip)
        readings = flow_readings("name the frame that the motion leads to, or turn its signs")
        return LoadedSource(frame, WarpSettings(), None, readings=readings)
    if file != FileOptions():
        raise StudyError(_FILE_ONLY)
    loaded = _load_pair(source, pair)
    # Half way between the cameras there is no photograph to compare with.
    truth = loaded.right if pair.amount == 1.0 else None
    return LoadedSource(loaded.warp_input(pair.amount), PAIR_WARP, truth)


def _load_picture(path: Path, options: PictureOptions) -> LoadedSource:
    moved = (options.camera, options.pose, options.target_pose)
    told: _DepthFile = {
        "depth_scale": options.depth_scale,
        "depth_is": one_of("--depth-is", options.depth_is or "distance", DEPTH_IS),
        "unknown": options.unknown,
    }
    if options.flow is not None:
        if any(part is not None for part in (*moved, options.parallax)):
            raise StudyError(
                "--flow says where pixels go: --camera, --pose, --target-pose and --parallax do not"
                " go with it"
            )
        nearer = one_of("--nearer", options.nearer, NEARER)
        frame = from_flow(path, options.flow, options.depth, nearer=nearer, **told)
        readings = flow_readings(
            "give the one from the picture to the true view, or turn its signs"
        )
        fast_px = float(np.percentile(np.linalg.norm(frame.flow_px, axis=-1), 95))
        still = f"nothing moves by a pixel in {options.flow}: is it in pixels, and not in shares?"
        words = still if fast_px < 1 else None
        return LoadedSource(frame, PAIR_WARP, None, readings=readings, words=words)
    if options.depth is not None and moved == (None, None, None):
        share = DEFAULT_PARALLAX if options.parallax is None else options.parallax
        words = (
            f"the camera moves sideways until what is near moves by {100 * abs(share):g} % of the"
            f" width (--parallax; or give --camera and poses){_nearer(options)}"
        )
        frame, readings = (
            from_the_side(path, options.depth, share, **told),
            sideways_readings(share),
        )
        return LoadedSource(frame, PAIR_WARP, None, readings=readings, words=words)
    if options.depth is None or options.camera is None or options.target_pose is None:
        raise StudyError(
            "a picture needs --flow FILE or --depth FILE. With --depth alone the camera moves"
            " sideways; to move it otherwise, give --camera FX,FY,CX,CY and --target-pose (and"
            " --pose, if the picture's camera is not at the world's origin)"
        )
    if options.parallax is not None:
        raise StudyError("--parallax replaces --camera and poses: give one or the other")
    poses = (
        np.eye(4) if options.pose is None else read_pose(options.pose),
        read_pose(options.target_pose),
    )
    words = "FX,FY,CX,CY in pixels, such as 518,519,325.5,253.5"
    fx, fy, cx, cy = _numbers("--camera", options.camera, (0.0, 0.0, 0.0, 0.0), words)
    lens = fx, fy, cx, cy
    frame = from_depth(
        path, options.depth, intrinsics_px=lens, pose=poses[0], target_pose=poses[1], **told
    )
    depth_m = frame.source.depth_m
    far = motion_between(np.full_like(depth_m, np.inf), lens, *poses)[0]
    near_px = float(np.percentile(np.linalg.norm(frame.flow_px - far, axis=-1), 95))
    words = f"what is near moves by {near_px:.2g} px against what is far{_nearer(options)}"
    across_deg = 2 * math.degrees(math.atan(depth_m.shape[1] / 2 / lens[0]))
    if hardly_meant("view_deg", across_deg):
        words += f"; the camera sees {across_deg:.4g} degrees: are all of --camera pixels of it?"
    elif near_px < 1:
        words += "; that is less than a pixel: are depth (--depth-scale) and poses in metres?"
    readings = pose_readings(
        depth_m, lens, poses, depth_scale=options.depth_scale, depth_is=told["depth_is"]
    )
    return LoadedSource(frame, PAIR_WARP, None, readings=readings, words=words)


def _nearer(options: PictureOptions) -> str:
    """Return the words on what is near, and the option that turns it round."""
    inverse = options.depth_is == "inverse"
    near, other = ("large", "distance") if inverse else ("small", "inverse")
    return f"; {near} numbers in {options.depth} are near (if not: --depth-is {other})"


def _load_pair(source: str, options: PairOptions) -> StereoPair:
    path = Path(source)
    if source in BUILT_IN and not path.exists():
        if options.to_left:
            raise StudyError(
                f"{source}: only the left photograph's disparity is known; no --to-left"
            )
        if replace(options, amount=1.0) != PairOptions():
            raise StudyError(
                f"{source}: brings its own disparity, right photograph and cameras; --disparity,"
                " --right, --units-per-px, --focal-px, --baseline-m and --offset-px are for a pair"
                " of yours"
            )
        return built_in_pair(source)
    if options.disparity is not None:
        pair = load_pair(
            path,
            options.disparity,
            options.right,
            units_per_px=options.units_per_px,
            focal_px=options.focal_px,
            baseline_m=options.baseline_m,
            offset_px=options.offset_px,
            unknown=options.unknown,
        )
        pair = replace(pair, mirrored=options.to_left)
        if asked := hardly_meant("baseline_m", options.baseline_m):
            say(f"note: --baseline-m {options.baseline_m:g}{asked}")
        if options.right is not None:
            _check_pair(pair, options)
        return pair
    if options.unknown is not None:
        raise StudyError("--unknown is about the numbers of --disparity or --depth: give one")
    if path.exists():
        raise StudyError(
            f"{path}: must be an .exr file with colour, depth and flow, or come with"
            " --disparity FILE, --flow FILE or --depth FILE (the camera then moves sideways, or"
            " between two poses)"
        )
    raise StudyError(f"{source}: no such file, and not a built-in pair ({', '.join(BUILT_IN)})")


def _check_pair(pair: StereoPair, options: PairOptions) -> None:
    verdict = judge_pair(pair, units_per_px=options.units_per_px)
    said = str(verdict).replace("units_per_px = ", "--units-per-px ")
    if verdict.wide is not None:
        raise StudyError(f"{options.disparity}: {said}")
    _obey(verdict, f"{options.right}: {said}", "--right")


def _obey(verdict: TruthVerdict, said: str, option: str) -> None:
    """Refuse files that do not belong together, and say what to look at."""
    if verdict.refused:
        raise StudyError(f"{said}; without {option} the picture is warped unmeasured")
    if verdict.doubtful:
        say(f"note: {said}")


def _channels(settings: Iterable[str] | None) -> Channels:
    known = [field.name for field in fields(Channels)]
    given: dict[str, tuple[str, ...]] = {}
    for setting in settings or ():
        what, equals, name = setting.partition("=")
        if not equals or not name:
            raise StudyError(f"--channel: must read WHAT=NAME (got {setting!r})")
        given[one_of("--channel: WHAT", what, known)] = (name,)
    return Channels(**given)
