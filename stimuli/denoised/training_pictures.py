"""Pairs of noisy and clean pictures: views of built-in scenes, path-traced and kept in a folder.

A view is rendered with 1, 1, 2, 4, 8 and 16 samples a pixel, which add up to 1, 2, 4, ... 32; so a
noisy picture for any gaze takes each pixel from the sum with its number of samples. The clean
picture has samples of its own.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.denoising.samples import Sampling, composed
from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat, FlatGeometry
from protocols.disk.whole_file import write_whole
from protocols.outside import reading
from stimuli.denoised.path_traced import PathTracer
from stimuli.rendering.world import Viewpoint, World
from stimuli.scenes.builtin_scenes import build_scene, scene_entry

WIDTH_DEG = 40.0
"""Of all pictures, on the eye."""
SCENE_SEED = 1
MOST_VIEWS = 1000
# How far views lie from where a scene begins: in distances to what it looks at, and degrees.
SHIFT = (0.16, 0.05, 0.12)  # right, down, forward
TURN_DEG = (22.0, 7.0)  # sideways, up

Progress = Callable[[str, int, int], None]
Pictures = NDArray[np.float32]


@dataclass(frozen=True)
class SceneView:
    """One camera in one built-in scene.

    Parameters
    ----------
    number : int
        Which view. A training takes the first ones; those after them are there to judge it.
    """

    scene: str
    number: int

    def __post_init__(self) -> None:
        scene_entry(self.scene)
        if self.number < 0:
            raise InputError(f"a view's number must be at least 0 (got {self.number})")

    @property
    def name(self) -> str:
        return f"{self.scene}-{self.number}"

    def path(self, folder: Path, rendering: Rendering) -> Path:
        """The file that keeps its pictures."""
        return folder / f"{self.name}-{rendering.edge_px}px-{rendering.clean_samples}.npz"

    def camera(self, world: World, edge_px: int) -> Camera:
        """A square camera near where the scene begins; view 0 is that place itself."""
        rng = np.random.default_rng((SCENE_SEED, self.number))
        start = world.viewpoint
        first = Viewpoint(start.position_m, start.look_at_m, WIDTH_DEG).camera(edge_px, edge_px)
        if self.number == 0:
            return first
        ahead_m = np.subtract(start.look_at_m, start.position_m)
        away_m = float(np.linalg.norm(ahead_m))
        moved = first.moved(away_m * np.multiply(SHIFT, rng.uniform(-1, 1, 3)))
        aside, up = np.radians(np.multiply(TURN_DEG, rng.uniform(-1, 1, 2)))
        pose = moved.world_from_camera
        forward = (
            np.cos(aside) * np.cos(up) * pose[:3, 2]
            + np.sin(aside) * np.cos(up) * pose[:3, 0]
            - np.sin(up) * pose[:3, 1]
        )
        position = pose[:3, 3]
        there = position + away_m * forward
        return Viewpoint(_vector(position), _vector(there), WIDTH_DEG).camera(edge_px, edge_px)


@dataclass(frozen=True, eq=False)
class TrainingPair:
    """One view, noisy and clean.

    Parameters
    ----------
    renders : ndarray of float32, shape (halvings + 1, H, W, 3)
        Encoded R'G'B' in [0, 1], with 1, 2, 4, ... samples a pixel.
    clean : ndarray of float32, shape (H, W, 3)
    """

    view: SceneView
    renders: Pictures
    clean: Pictures

    @property
    def geometry(self) -> FlatGeometry:
        height, width = self.clean.shape[:2]
        return Flat(WIDTH_DEG).of(width, height)

    def noisy(self, sampling: Sampling, gaze_px: tuple[float, float]) -> Pictures:
        """The picture of an eye that looks there: (H, W, 3)."""
        return composed(self.renders, sampling.exponents(self.geometry, gaze_px))


@dataclass(frozen=True)
class Rendering:
    """Settings by which views are rendered.

    Parameters
    ----------
    edge_px : int
        Of the square pictures; a multiple of 8.
    clean_samples : int
        A pixel of the clean picture has so many.
    halvings : int
        The noisiest has one sample a pixel, the least noisy 2 to this power.
    """

    edge_px: int = 256
    clean_samples: int = 128
    halvings: int = 5

    def __post_init__(self) -> None:
        if not (64 <= self.edge_px <= 1024 and self.edge_px % 8 == 0):
            raise InputError(
                f"training pictures must have a multiple of 8 from 64 to 1024 px an edge"
                f" (got {self.edge_px})"
            )
        if not 1 <= self.clean_samples <= 65536:
            raise InputError(
                f"clean pictures must have 1 to 65536 samples a pixel (got {self.clean_samples})"
            )

    @property
    def paths(self) -> int:
        """Paths traced for one view."""
        return self.edge_px**2 * (self.clean_samples + (1 << self.halvings))


def pairs_of(
    views: Sequence[SceneView], rendering: Rendering, folder: Path, progress: Progress | None = None
) -> list[TrainingPair]:
    """Return the pairs of views; what the folder holds already is not rendered again.

    Raises
    ------
    MissingExtraError
        If something must be rendered and Mitsuba is not installed.
    InputError
        If a file in the folder is damaged.
    """
    found: list[TrainingPair] = []
    tracer: tuple[str, World, PathTracer] | None = None
    for done, view in enumerate(views):
        path = view.path(folder, rendering)
        if not path.exists():
            if progress is not None:
                progress(f"rendering {view.name}", done, len(views))
            if tracer is None or tracer[0] != view.scene:
                world = build_scene(view.scene, SCENE_SEED)
                tracer = view.scene, world, PathTracer(world)
            _, world, traces = tracer
            made = render_pair(traces, world, view, rendering)
            folder.mkdir(parents=True, exist_ok=True)
            _write(path, made)
        found.append(_read(path, view, rendering))  # as it is kept: rounded to half floats
    return found


def render_pair(
    tracer: PathTracer, world: World, view: SceneView, rendering: Rendering
) -> TrainingPair:
    """Trace one view."""
    camera = view.camera(world, rendering.edge_px)
    seeds = np.random.default_rng((SCENE_SEED, view.number, 7)).integers(0, 2**31, 16)
    total = np.zeros((rendering.edge_px, rendering.edge_px, 3))
    renders, so_far = [], 0
    for index in range(rendering.halvings + 1):
        wanted = 1 << index
        more = wanted - so_far
        total += more * tracer.render(camera, more, int(seeds[index]))
        so_far = wanted
        renders.append(tracer.shown(total / wanted))
    clean = tracer.shown(tracer.render(camera, rendering.clean_samples, int(seeds[-1])))
    return TrainingPair(view, np.stack(renders), clean)


def seconds_for(scene: str, rendering: Rendering) -> float:
    """Estimate how long a view takes, by tracing a few paths of the scene's first one."""
    import time

    world = build_scene(scene, SCENE_SEED)
    tracer = PathTracer(world)
    camera = SceneView(scene, 0).camera(world, 64)
    started = time.perf_counter()
    tracer.render(camera, 8, 0)
    return (time.perf_counter() - started) * rendering.paths / (64 * 64 * 8)


def _vector(values: NDArray[np.floating]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _write(path: Path, pair: TrainingPair) -> None:
    held = io.BytesIO()
    np.savez(held, renders=pair.renders.astype(np.float16), clean=pair.clean.astype(np.float16))
    write_whole(path, held.getvalue())


def _read(path: Path, view: SceneView, rendering: Rendering) -> TrainingPair:
    edge = rendering.edge_px
    again = "delete it, and it is made again"
    # numpy would leave a damaged file open if it opened it itself.
    with (
        reading(path, "a pair that this command rendered", InputError, again),
        path.open("rb") as file,
        np.load(file, allow_pickle=False) as held,
    ):
        renders, clean = (held[name].astype(np.float32) for name in ("renders", "clean"))
    wanted = (rendering.halvings + 1, edge, edge, 3)
    if renders.shape != wanted or clean.shape != wanted[1:]:
        raise InputError(
            f"{path}: must hold pictures of shape {wanted} and {wanted[1:]} (has"
            f" {renders.shape} and {clean.shape}); {again}"
        )
    if not (np.isfinite(renders).all() and np.isfinite(clean).all()):
        raise InputError(f"{path}: must hold finite numbers; {again}")
    return TrainingPair(view, renders, clean)
