"""Checks of the files of a study of warped clips before anything is built.

Files that are not there are no mistake here: where sessions run, built clips are enough.
"""

from __future__ import annotations

import importlib.util
import re
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.errors import InputError
from pipeline.methods.frames import FRAME, FramesOnDisk
from pipeline.methods.onnx import OnnxNetwork
from pipeline.methods.registry import create_method
from pipeline.pictures.header import stated_size_px
from pipeline.pictures.stored_frames import sequence_files
from protocols.errors import Problem
from protocols.recipes.warped_clips import ClipName, ExrScene, MeshScene, StereoScene
from stimuli.batch.build_plan import BuildPlan
from stimuli.rendering.open_scene import open_world
from stimuli.scenes.pair_check import judge_pair
from stimuli.scenes.photo import is_built_in, read_pair
from stimuli.scenes.sequence import SequenceScenery, too_small
from stimuli.scenes.truth_check import TruthVerdict


@dataclass(frozen=True)
class SceneFindings:
    """Mistakes that must change, and what may be one."""

    wrong: list[Problem] = field(default_factory=list)
    doubtful: list[Problem] = field(default_factory=list)
    missing: list[Problem] = field(default_factory=list)
    """Files that only a build needs."""


def look_at_scenes(plan: BuildPlan) -> SceneFindings:
    """Open what scenes name, as far as it is here."""
    found = SceneFindings()
    for index, scene in enumerate(plan.study.warped.scenes):
        place = f"stimuli.scenes[{index}]"
        try:
            if isinstance(scene, StereoScene):
                _pair(found, place, plan, scene)
            elif isinstance(scene, MeshScene):
                notes = open_world(scene, plan.folder).notes
                found.doubtful.extend(Problem(place, note) for note in notes)
            elif isinstance(scene, ExrScene) and scene.has_own_path:
                _sequence(found, place, plan, scene)
        except FileNotFoundError:
            continue
        except (InputError, OSError) as error:
            found.wrong.append(Problem(place, str(error)))
    return found


def look_at_fills(plan: BuildPlan) -> SceneFindings:
    """Open the networks and count the frames that methods name, as far as they are here."""
    found = SceneFindings()
    seen: set[str] = set()
    if not any(":" in method.registry_name for method in plan.study.warped.methods):
        return found
    for clip in plan.clip_names:
        method = plan.method(clip)
        kind, colon, _ = method.registry_name.partition(":")
        name = plan.registry_name(clip)
        if method.is_reference or not colon or name in seen:
            continue
        seen.add(name)
        place = f"stimuli.methods[{plan.study.warped.methods.index(method)}]"
        try:
            if kind == "frames":
                for note in _check_frames(plan, clip):
                    found.doubtful.append(Problem(place, note))
            elif kind == "onnx":
                _check_network(plan, clip)
        except ModuleNotFoundError as error:
            found.missing.append(Problem(place, str(error)))
        except FileNotFoundError as error:
            said = f"{error.filename}: is not there; 'metamerlab stimuli build' needs it"
            if (missing := Problem(place, said)) not in found.missing:
                found.missing.append(missing)
        except (InputError, OSError) as error:
            found.wrong.append(Problem(place, str(error)))
    return found


def _check_frames(plan: BuildPlan, clip: ClipName) -> list[str]:
    """Return notes on the header of a video of frames, or refuse the frames."""
    path = plan.method(clip).registry_name.partition(":")[2]
    unknown = set(re.findall(r"\{(.*?)\}", path)) - {"scene", "size", "frame"}
    if unknown or FRAME in str(Path(path).parent):
        raise InputError(
            "the path of frames may hold {scene}, {size} and, in its last part, {frame}"
            f" (got {path!r})"
        )
    alike = [other for other in plan.clip_names if other.method == clip.method]
    for column in ("scene", "size"):
        values = list(dict.fromkeys(getattr(other, column) for other in alike))
        if len(values) > 1 and f"{{{column}}}" not in path:
            raise InputError(
                f"the path of frames must hold {{{column}}}, for {' and '.join(values)} have other"
                f" frames (got {path!r})"
            )
    frames = FramesOnDisk(Path(plan.registry_name(clip).partition(":")[2]))
    wanted = plan.study.warped.clips.frames
    if len(frames) != wanted:
        raise InputError(
            f"{frames.path}: must hold as many frames as the clip has, {wanted} (has {len(frames)})"
        )
    size_px = stated_size_px(frames.first) if frames.video is None else frames.video.size_px
    frames.release()
    if size_px is not None and size_px != plan.render_px:
        raise InputError(
            f"{frames.first}: must be {plan.render_px[0]} x {plan.render_px[1]} px as the"
            f" warped frame (is {size_px[0]} x {size_px[1]})"
        )
    if frames.video is None:
        return []
    return [f"{frames.path}: {note}" for note in frames.video.notes]


def _check_network(plan: BuildPlan, clip: ClipName) -> None:
    if importlib.util.find_spec("onnxruntime") is None:
        raise ModuleNotFoundError(
            "ONNX Runtime is not installed; 'metamerlab stimuli build' needs it: pip install"
            " 'metamerlab[onnx]'"
        )
    network = create_method(plan.registry_name(clip), None, plan.method(clip).parameters)
    assert isinstance(network, OnnxNetwork)
    network.check_size((plan.render_px[1], plan.render_px[0]))


def _pair(found: SceneFindings, place: str, plan: BuildPlan, scene: StereoScene) -> None:
    if is_built_in(scene, plan.folder):
        return
    pair = read_pair(scene, plan.folder)
    verdict = judge_pair(pair, units_per_px=scene.units_per_px)
    _tell(found, place, f"{scene.left}, {scene.right}, {scene.disparity}", verdict)


def _tell(found: SceneFindings, place: str, files: str, verdict: TruthVerdict) -> None:
    if verdict.doubtful:
        problem = Problem(place, f"{files}: {verdict}")
        (found.wrong if verdict.refused else found.doubtful).append(problem)


def _sequence(found: SceneFindings, place: str, plan: BuildPlan, scene: ExrScene) -> None:
    files = sequence_files(scene.file, plan.folder)
    wanted = plan.study.warped.clips.frames
    if len(files) < wanted:
        found.wrong.append(
            Problem(
                f"{place}.file",
                f"a clip needs {wanted} frames (the sequence has {len(files)} files); shorten"
                " duration_s, or render more",
            )
        )
    size_px = stated_size_px(files[0])
    if size_px is not None and any(
        have < shown for have, shown in zip(size_px, plan.render_px, strict=True)
    ):
        found.wrong.append(Problem(f"{place}.file", too_small(size_px, plan.render_px)))
    scenery, last = SequenceScenery(scene, files), min(wanted, len(files)) - 2
    for frame in sorted({0, last // 2, last} if last >= 0 else ()):
        names = f"{files[frame].name}, {files[frame + 1].name}"
        _tell(found, place, names, scenery.judged(frame))
    sizes = [size.name for size in plan.study.warped.sizes if not size.is_own]
    if sizes:
        alike = f"; {' and '.join(sizes)} show the same clip" if len(sizes) > 1 else ""
        found.doubtful.append(
            Problem(
                place,
                f"{scene.name} is a sequence with its own motion: hole_share and extent_m do not"
                f" apply to it{alike}",
            )
        )
