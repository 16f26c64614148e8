"""Sceneries of the scenes of a protocol, and what decides their pixels."""

from __future__ import annotations

import os.path
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import moderngl

from pipeline.errors import GLUnavailableError, InputError
from protocols.disk.hashing import Json, sha256_file
from protocols.recipes.warped_clips import (
    AroundScene,
    BuiltinScene,
    CameraView,
    ExrScene,
    MeshScene,
    RgbdScene,
    Scene,
    StereoScene,
)
from stimuli.rendering.scenery import RenderedScenery, Scenery
from stimuli.rendering.world import Vector, Viewpoint, World
from stimuli.scenes.builtin_scenes import build_scene, scene_entry

if TYPE_CHECKING:
    from stimuli.rendering.render import WorldRenderer

BASE_MODULES = (
    "stimuli.batch.clip",
    "stimuli.batch.footage",
    "stimuli.rendering.open_scene",
    "stimuli.rendering.solve",
)


def open_scenery(ctx: moderngl.Context | None, scene: Scene, folder: Path) -> Scenery:
    """Make the scenery of `scene`; its files lie relative to `folder`.

    Raises
    ------
    GLUnavailableError
        If the scene has to be drawn, and there is no context.
    InputError, OSError
        If a file is missing or broken, or the scene shows nothing.
    """
    if isinstance(scene, (BuiltinScene, MeshScene)):
        return RenderedScenery(open_renderer(ctx, scene, folder), scene.name)
    if isinstance(scene, AroundScene):
        from stimuli.scenes.surroundings import open_around

        drawn = scene.builtin is not None
        return open_around(scene, folder, open_renderer(ctx, scene, folder) if drawn else None)
    from stimuli.scenes.photo import open_rgbd, open_stereo
    from stimuli.scenes.sequence import open_sequence

    if isinstance(scene, StereoScene):
        return open_stereo(scene, folder)
    if isinstance(scene, RgbdScene):
        return open_rgbd(scene, folder)
    return open_sequence(scene, folder)


DrawnScene: TypeAlias = BuiltinScene | MeshScene | AroundScene


def open_renderer(ctx: moderngl.Context | None, scene: DrawnScene, folder: Path) -> WorldRenderer:
    """Put the world of a scene that is drawn on the GPU.

    Raises
    ------
    GLUnavailableError
        If there is no context.
    """
    from stimuli.rendering.render import WorldRenderer

    if ctx is None:
        raise GLUnavailableError(
            f"scene {scene.name!r} is drawn, for which OpenGL 4.3 is needed (there is none:"
            " 'metamerlab doctor' says why); take photographs with depth (rgbd, a stereo pair"
            " or exr), or build in the container or on another machine"
        )
    return WorldRenderer(ctx, open_world(scene, folder))


def open_world(scene: DrawnScene, folder: Path) -> World:
    """Make the world of a rendered scene, seen from the protocol's view where it gives one."""
    if isinstance(scene, BuiltinScene | AroundScene):
        assert scene.builtin is not None
        world = build_scene(scene.builtin, scene.seed, scene.parameters)
    else:
        from stimuli.scenes.mesh_file import load_world

        if scene.parameters:
            raise InputError(
                f"{scene.name}: a mesh scene takes no parameters"
                f" (got {', '.join(scene.parameters)})"
            )
        world = load_world(
            folder / scene.file,
            scale=scene.scale,
            lighting=scene.lighting,
            sun_direction=scene.sun_direction,
        )
    return world if scene.view is None else world.seen_from(viewpoint_of(scene.view, world))


def scene_inputs(scene: Scene, folder: Path) -> Json:
    """Inputs that decide the scene's pixels: its entry, its files' hashes, its sources."""
    entry = scene.model_dump(mode="json", exclude={"name", "label"})
    return {"scene": entry, "files": {name: sha256_file(path) for name, path in
                                      scene_files(scene, folder).items()}}  # fmt: skip


def scene_modules(scene: Scene) -> tuple[str, ...]:
    """The modules that make the scene, for `stimuli.batch.sources`."""
    if isinstance(scene, BuiltinScene):
        return ("stimuli.rendering.render", scene_entry(scene.builtin).module)
    if isinstance(scene, MeshScene):
        return ("stimuli.rendering.render", "stimuli.scenes.mesh_file")
    if isinstance(scene, AroundScene):
        drawn = () if scene.builtin is None else (scene_entry(scene.builtin).module,)
        return ("stimuli.scenes.surroundings", *drawn)
    if isinstance(scene, ExrScene):
        return ("stimuli.scenes.sequence",)
    return ("stimuli.scenes.photo",)


def scene_files(scene: Scene, folder: Path) -> dict[str, Path]:
    """The files that a scene reads, by their path from the protocol, or from the mesh.

    Raises
    ------
    FileNotFoundError
        If one is missing.
    """
    names: list[str] = []
    if isinstance(scene, MeshScene):
        from stimuli.scenes.mesh_inputs import files_of

        mesh = folder / scene.file
        return {path.relative_to(mesh.parent).as_posix(): path for path in files_of(mesh)}
    if isinstance(scene, StereoScene):
        from stimuli.scenes.photo import is_built_in

        if is_built_in(scene, folder):
            return {}
        names = [scene.left, scene.right, scene.disparity]
    elif isinstance(scene, AroundScene):
        names = [name for name in (scene.file, scene.rgb, scene.depth) if name is not None]
    elif isinstance(scene, RgbdScene):
        names = [scene.rgb, scene.depth]
    elif isinstance(scene, ExrScene):
        from pipeline.pictures.stored_frames import sequence_files

        return {
            Path(os.path.relpath(path, folder)).as_posix(): path
            for path in sequence_files(scene.file, folder)
        }
    found = {name: folder / name for name in names}
    for path in found.values():
        if not path.is_file():
            raise FileNotFoundError(2, "No such file", str(path))
    return found


def viewpoint_of(view: CameraView, world: World) -> Viewpoint:
    """The protocol's view; the field of view that it leaves out is the world's own."""
    chosen = Viewpoint(view.position_m, view.look_at_m, world.viewpoint.vertical_fov_deg)
    if view.vertical_fov_deg is not None:
        chosen = replace(chosen, vertical_fov_deg=view.vertical_fov_deg)
    return chosen


def view_line(view: Viewpoint) -> str:
    """Return a view as a protocol says it."""
    return (
        f"view = {{ position_m = {vector_text(view.position_m)}, look_at_m ="
        f" {vector_text(view.look_at_m)}, vertical_fov_deg = {view.vertical_fov_deg:g} }}"
    )


def vector_text(vector: Vector) -> str:
    """Return a vector as a protocol says it."""
    return "[" + ", ".join(f"{round(value, 6) + 0.0:.4g}" for value in vector) + "]"
