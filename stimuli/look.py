"""Candidate views of a 3D scene on one sheet, with the lines to copy into a protocol."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import moderngl
import numpy as np

from pipeline.frame import SourceFrame
from stimuli import pictures
from stimuli.render import Renderer
from stimuli.scenes.mesh_file import load_world
from stimuli.scenes.registry import build_scene, scene_names
from stimuli.world import Vector, Viewpoint, World

TRIED = 64
FIELD_DEG = 50.0
SMALL_PX = (96, 72)
TILE_PX = (480, 360)
EYE_HEIGHT_M = 1.6
LEAST_SEEN = 0.5  # share of a view that must not be background
LEAST_NEAR = 0.02  # of the scene's radius: nothing may fill the view


def look_around(
    ctx: moderngl.Context, scene: str, out: Path, *, scale: float, count: int, seed: int
) -> list[str]:
    """Draw the `count` best of many views into `out`; return a line per view.

    Views that uncover much when the camera moves come first: those with many jumps in depth
    that show little background.

    Raises
    ------
    InputError, OSError
        If the scene cannot be read.
    """
    world = _world(scene, scale, seed)
    renderer = Renderer(ctx, world)
    try:
        ranked = sorted(
            ((_interest(renderer, view), index, view) for index, view in enumerate(_views(world))),
            key=lambda entry: (-entry[0], entry[1]),
        )
        tiles, lines = [], []
        for number, (_, _, view) in enumerate(ranked[:count]):
            frame = renderer.render(view.camera(*TILE_PX))
            seen = np.isfinite(frame.depth_m)
            near = float(np.percentile(frame.depth_m[seen], 5)) if seen.any() else float("inf")
            tiles.append((f"{number}: near {near:.3g} m", pictures.of_colour(frame.colour)))
            lines.append(f"{number}: {_line(view)}")
    finally:
        renderer.release()
    out.parent.mkdir(parents=True, exist_ok=True)
    pictures.save_picture(out, pictures.sheet(tiles))
    return lines


def _world(scene: str, scale: float, seed: int) -> World:
    if scene in scene_names() and not Path(scene).exists():
        return build_scene(scene, seed)
    return load_world(Path(scene), scale=scale)


def _views(world: World) -> Iterator[Viewpoint]:
    """The scene's own view, a ring around the middle, and a walk over level ground."""
    yield world.viewpoint
    low, high = world.bounds_m
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    for index in range(TRIED // 4):
        turn, lift = 2 * np.pi * index / (TRIED // 4), (0.12, 0.45)[index % 2]
        way = np.array([np.sin(turn), lift, np.cos(turn)])
        yield Viewpoint(_vector(centre + 1.5 * radius * way), _vector(centre), FIELD_DEG)
    rng = np.random.default_rng(0)
    ground = _level_ground(world)
    if not len(ground):
        return
    eye = min(EYE_HEIGHT_M, 0.3 * radius)
    for index in range(TRIED):
        place = ground[rng.integers(len(ground))] + np.array([0.0, eye, 0.0])
        turn = 2 * np.pi * index / 16
        ahead = np.array([np.sin(turn), -0.05, np.cos(turn)]) * 0.3 * radius
        yield Viewpoint(_vector(place), _vector(place + ahead), FIELD_DEG)


def _level_ground(world: World) -> np.ndarray:
    """Middles of triangles that one could stand on, large ones more often."""
    middles = []
    for part in world.parts:
        if part.material.cutout:
            continue
        corner = part.mesh.position_m[part.mesh.triangles].astype(np.float64)
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        area = np.linalg.norm(normal, axis=1)
        level = np.abs(normal[:, 1]) > 0.9 * np.maximum(area, 1e-12)
        if level.any():
            order = np.argsort(-area[level], kind="stable")
            middles.append(corner[level][order].mean(axis=1)[:200])
    return np.concatenate(middles) if middles else np.zeros((0, 3))


def _interest(renderer: Renderer, view: Viewpoint) -> float:
    camera = view.camera(*SMALL_PX)
    frame: SourceFrame = renderer.render(camera)
    seen = np.isfinite(frame.depth_m)
    if seen.mean() < 0.2:
        return -1.0 + float(seen.mean())
    low, high = renderer.world.bounds_m
    near = float(np.percentile(frame.depth_m[seen], 2))
    inverse = near / frame.depth_m
    jumps = np.abs(np.diff(inverse, axis=1)).mean() + np.abs(np.diff(inverse, axis=0)).mean()
    score = float(jumps) * min(1.0, float(seen.mean()) / LEAST_SEEN)
    if near < LEAST_NEAR * float(np.linalg.norm(high - low)) / 2:
        score *= 0.2
    return score


def _line(view: Viewpoint) -> str:
    place, target = (
        "[" + ", ".join(f"{value:.4g}" for value in vector) + "]"
        for vector in (view.position_m, view.look_at_m)
    )
    return (
        f"view = {{ position_m = {place}, look_at_m = {target},"
        f" vertical_fov_deg = {view.vertical_fov_deg:g} }}"
    )


def _vector(values: np.ndarray) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])
