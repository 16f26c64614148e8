"""Candidate views of a 3D scene on one sheet, with the lines to copy into a protocol."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import moderngl
import numpy as np

from pipeline.errors import InputError
from pipeline.foveation.geometry import EquirectangularGeometry, Flat, pixel_centres
from pipeline.foveation.view import flat_view, turn
from pipeline.frame import SourceFrame
from pipeline.pictures import drawing
from pipeline.pictures.panorama_file import load_panorama
from protocols.recipes.warped_clips import CameraView
from stimuli.rendering.open_scene import vector_text, view_line, viewpoint_of
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.world import Vector, Viewpoint, World, vector
from stimuli.scenes.builtin_scenes import build_scene, scene_names
from stimuli.scenes.mesh_file import load_world

Lighting: TypeAlias = Literal["unlit", "sun"]
LIGHTINGS: tuple[Lighting, ...] = ("unlit", "sun")

TRIED = 64
MOST_BEHIND = 0.3  # share of what is seen: more means that the eye is inside a body, or underground
FIELD_DEG = 50.0
SMALL_PX = (96, 72)
TILE_PX = (480, 360)
EYE_HEIGHT_M = 1.6
LEAST_SEEN = 0.8  # share of a view that must not be background
SPREAD = (0.7548777, 0.5698403)  # steps of directions that fill a square evenly (R2 of Roberts)
LEAST_NEAR = 0.02  # of the scene's radius: nothing may fill the view


@dataclass(frozen=True)
class ScenePreview:
    """A scene to look around in, as a mesh scene in a protocol says it.

    Parameters
    ----------
    scene : str
        A file, or a built-in scene's name.
    scale : float
        Metres per unit of a file.
    seed : int
        Of a built-in scene.
    chosen : sequence of CameraView
        Views that are asked for; empty: the best are looked for.
    lighting, sun_direction : optional
        Light of a file.
    """

    scene: str
    scale: float = 1.0
    seed: int = 0
    chosen: Sequence[CameraView] = ()
    lighting: Lighting | None = None
    sun_direction: Vector | None = None

    @property
    def is_built_in(self) -> bool:
        """True if it comes with metamerlab."""
        return self.scene in scene_names() and not Path(self.scene).exists()

    def light_lines(self) -> list[str]:
        """Return the light's lines of a protocol.

        Raises
        ------
        InputError
            If a scene cannot be lit so.
        """
        lines = [] if self.lighting is None else [f'lighting = "{self.lighting}"']
        if self.sun_direction is None:
            return lines
        if self.lighting == "unlit":
            raise InputError(
                "--sun-direction needs --lighting sun (got unlit); leave one of them out"
            )
        if not (np.isfinite(self.sun_direction).all() and any(self.sun_direction)):
            raise InputError(
                "--sun-direction must be finite and not zero (got"
                f" {vector_text(self.sun_direction)}); give it as -1 1 0.5, say"
            )
        return [*lines, f"sun_direction = {vector_text(self.sun_direction)}"]

    def world(self) -> World:
        """Return the scene, with metres per unit and a light of its own.

        Raises
        ------
        InputError, OSError
            If it cannot be read, or cannot be lit so.
        """
        if not self.is_built_in:
            return load_world(
                Path(self.scene), scale=self.scale, lighting=self.lighting,
                sun_direction=self.sun_direction,
            )  # fmt: skip
        if self.lighting or self.sun_direction:
            raise InputError(
                f"{self.scene}: a built-in scene has a light of its own (got --lighting or"
                " --sun-direction, which are for files); leave it out"
            )
        return build_scene(self.scene, self.seed)


def look_around(
    ctx: moderngl.Context,
    preview: ScenePreview,
    out: Path,
    count: int,
    *,
    report: Callable[[int, int], None] = lambda _done, _total: None,
    note: Callable[[str], None] = lambda _: None,
) -> list[str]:
    """Draw the `count` best of many views, or the chosen ones, into `out`; a line for each.

    Views that uncover much when the camera moves come first: those with many jumps in depth
    that show little background. Views of surfaces from behind come last: from inside a closed
    body, from under a terrain, from outside a room. `report` is told views tried and views in all,
    `note` what the file says and is not drawn. A light that is asked for gets its lines as well.

    Raises
    ------
    InputError, OSError
        If the scene cannot be read, or cannot be lit so.
    """
    light, world = preview.light_lines(), preview.world()
    for line in world.notes:
        note(line)
    renderer = WorldRenderer(ctx, world)
    try:
        views = [viewpoint_of(view, world) for view in preview.chosen] or _best(
            renderer, count, report, sided=not preview.is_built_in
        )
        tiles, lines = [], []
        for number, view in enumerate(views):
            frame = renderer.render(view.camera(*TILE_PX))
            seen = np.isfinite(frame.depth_m)
            near = float(np.percentile(frame.depth_m[seen], 5)) if seen.any() else float("inf")
            tiles.append((f"{number}: near {near:.3g} m", drawing.of_colour(frame.colour)))
            lines.append(f"{number}: {view_line(view)}")
    finally:
        renderer.release()
    out.parent.mkdir(parents=True, exist_ok=True)
    drawing.save_picture(out, drawing.sheet(tiles))
    return lines + light


def look_out(panorama: Path, out: Path, count: int) -> list[str]:
    """Draw directions of a panorama with distance into `out`; a line of a protocol for each.

    The directions spread over the sphere, the middle first.

    Raises
    ------
    InputError, OSError
        As `load_panorama`.
    """
    frame = load_panorama(panorama)
    height, width = frame.distance_m.shape
    view = Flat(width_deg=90).of(TILE_PX[1], TILE_PX[1])
    tiles, lines = [], []
    for number in range(count):
        across, up = ((number * step + 0.5) % 1 for step in SPREAD)
        right, down = round(360 * across - 180), round(math.degrees(math.asin(2 * up - 1)))
        rays = view.directions(*pixel_centres(view)) @ turn(right, down).T
        x, y = EquirectangularGeometry(width, height).positions(rays)
        seen_m = frame.distance_m[y.astype(int).clip(0, height - 1), x.astype(int) % width]
        shown = flat_view(frame.colour, view, right_deg=right, down_deg=down)
        near = f"{number}: near {np.percentile(seen_m, 5):.3g} m"
        tiles.append((near, drawing.of_colour(shown)))
        lines.append(f"{number}: right_deg = {right}, down_deg = {down}")
    out.parent.mkdir(parents=True, exist_ok=True)
    drawing.save_picture(out, drawing.sheet(tiles))
    return lines


def _best(
    renderer: WorldRenderer, count: int, report: Callable[[int, int], None], *, sided: bool
) -> list[Viewpoint]:
    """The views of most interest; `sided`: those of surfaces from behind come last."""
    views = list(_views(renderer.world))
    interest = []
    for index, view in enumerate(views):
        interest.append(_interest(renderer, view))
        report(index + 1, len(views))
    order = sorted(range(len(views)), key=lambda index: (-interest[index], index))
    good: list[Viewpoint] = []
    behind: list[Viewpoint] = []
    for index in order:
        if len(good) == count:
            break
        shown = not sided or _behind(renderer, views[index]) <= MOST_BEHIND
        (good if shown else behind).append(views[index])
    return [*good, *behind][:count]


def _behind(renderer: WorldRenderer, view: Viewpoint) -> float:
    """Share of the seen pixels that show a surface from behind, as corners are ordered in files."""
    camera = view.camera(*SMALL_PX)
    depth, fronts = (renderer.render(camera, fronts_only=only).depth_m for only in (False, True))
    seen = np.isfinite(depth)
    return float((fronts[seen] > depth[seen]).mean()) if seen.any() else 1.0


def _views(world: World) -> Iterator[Viewpoint]:
    """The scene's own view, rings around it and its detail, and a walk over level ground."""
    yield world.viewpoint
    low, high = world.bounds_m
    radius = float(np.linalg.norm(high - low)) / 2
    yield from _ring((low + high) / 2, 1.5 * radius)
    detail, spread = _detail(world)
    yield from _ring(detail, 2.5 * spread)
    rng = np.random.default_rng(0)
    ground = _level_ground(world)
    if not len(ground):
        return
    eye = min(EYE_HEIGHT_M, 0.3 * radius)
    for index in range(TRIED):
        place = ground[rng.integers(len(ground))] + np.array([0.0, eye, 0.0])
        turn = 2 * np.pi * index / 16
        ahead = np.array([np.sin(turn), -0.05, np.cos(turn)]) * 0.3 * radius
        yield Viewpoint(vector(place), vector(place + ahead), FIELD_DEG)


def _ring(centre: np.ndarray, distance_m: float) -> Iterator[Viewpoint]:
    for index in range(TRIED // 4):
        turn, lift = 2 * np.pi * index / (TRIED // 4), (0.12, 0.45)[index % 2]
        way = np.array([np.sin(turn), lift, np.cos(turn)])
        yield Viewpoint(vector(centre + distance_m * way), vector(centre), FIELD_DEG)


def _detail(world: World) -> tuple[np.ndarray, float]:
    """Middle and spread (m) of the vertices; a wide ground of few triangles does not count."""
    corners = np.concatenate([part.mesh.position_m for part in world.parts]).astype(np.float64)
    middle = np.median(corners, axis=0)
    return middle, float(np.median(np.linalg.norm(corners - middle, axis=1)))


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


def _interest(renderer: WorldRenderer, view: Viewpoint) -> float:
    camera = view.camera(*SMALL_PX)
    frame: SourceFrame = renderer.render(camera)
    seen = np.isfinite(frame.depth_m)
    if seen.mean() < 0.2:
        return -1.0 + float(seen.mean())
    low, high = renderer.world.bounds_m
    near = float(np.percentile(frame.depth_m[seen], 2))
    # The scene's far end before the sky uncovers nothing; what stands out against it does.
    inverse = near / np.minimum(frame.depth_m, frame.depth_m[seen].max())
    jumps = np.abs(np.diff(inverse, axis=1)).mean() + np.abs(np.diff(inverse, axis=0)).mean()
    score = float(jumps) * min(1.0, float(seen.mean()) / LEAST_SEEN)
    if near < LEAST_NEAR * float(np.linalg.norm(high - low)) / 2:
        score *= 0.2
    return score
