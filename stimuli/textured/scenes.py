"""Globes before an eye: the scenes of Beyond Blur's Fig. 12 and Fig. 13."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from protocols.errors import must_be_one_of

WIDTH_DEG = 40.0
"""Of the picture, as long as nothing else is said."""


@dataclass(frozen=True)
class Globe:
    """A textured globe.

    Parameters
    ----------
    centre_m : (x, y, z)
        In camera axes: right, down, forward.
    radius_m : float
    turn_deg : float
        The longitude that faces the viewer.
    """

    centre_m: tuple[float, float, float]
    radius_m: float
    turn_deg: float = 0.0


@dataclass(frozen=True)
class TexturedScene:
    """Globes, their light, and where the eye rests unless told otherwise.

    `gaze_share`: of the picture's width and height. `light`: towards it, in camera axes.
    """

    name: str
    what: str
    globes: tuple[Globe, ...]
    gaze_share: tuple[float, float]
    light: tuple[float, float, float]
    ambient: float


def _spheres() -> tuple[Globe, ...]:
    """Four globes of 4.2 degrees radius, 10 degrees apart."""
    places = [math.radians(angle) for angle in (-15, -5, 5, 15)]
    radius = math.sin(math.radians(4.2))
    return tuple(
        Globe((math.sin(a), 0.0, math.cos(a)), radius, turn_deg=180 + 70 * n)
        for n, a in enumerate(places)
    )


SCENES = {
    scene.name: scene
    for scene in (
        TexturedScene(
            "planet",
            "a planet that fills the picture; the eye rests left of its middle",
            (Globe((0.0, 0.0, 3.0), 1.0, turn_deg=200.0),),
            (0.3, 0.45),
            (-0.55, -0.45, -0.7),
            0.12,
        ),
        TexturedScene(
            "spheres",
            "four globes, 0, 10, 20 and 30 degrees from the gaze",
            _spheres(),
            (0.5 - 0.5 * math.tan(math.radians(15)) / math.tan(math.radians(20)), 0.5),
            (-0.3, -0.4, -0.85),
            0.25,
        ),
    )
}


def open_textured_scene(name: str) -> TexturedScene:
    """A scene by its name.

    Raises
    ------
    InputError
        If there is none.
    """
    if name not in SCENES:
        raise InputError(must_be_one_of("the scene", name, SCENES))
    return SCENES[name]


ROWS = 96
"""Of a globe's triangles, from pole to pole."""


@lru_cache(maxsize=8)
def globe_vertices(
    globe: Globe, turn_deg: float = 0.0
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """A globe's vertices and triangles.

    Parameters
    ----------
    turn_deg : float
        Turned by so much about its axis, which is vertical; the surface moves to the right.

    Returns
    -------
    vertices : ndarray of float32, shape (N, 8)
        Position, outward normal, and u and v: longitude and colatitude in 0..1.
    triangles : ndarray of uint32, shape (M, 3)

    Both are kept for the next frame, and read-only.
    """
    rows, columns = ROWS, 2 * ROWS
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    longitude = 2 * np.pi * u - math.radians(globe.turn_deg - turn_deg)
    colatitude = np.pi * v
    normal = np.stack(
        [
            np.sin(longitude) * np.sin(colatitude),
            -np.cos(colatitude),
            -np.cos(longitude) * np.sin(colatitude),
        ],
        axis=-1,
    )
    position = np.asarray(globe.centre_m) + globe.radius_m * normal
    vertices = np.concatenate([position, normal, u[..., None], v[..., None]], axis=-1)
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)
    quads = np.stack([corner, corner + 1, corner + columns + 1, corner + columns + 2], axis=-1)
    triangles = np.concatenate([quads[..., [0, 1, 2]], quads[..., [1, 3, 2]]]).reshape(-1, 3)
    found = (
        np.array(vertices.reshape(-1, 8), np.float32, order="C"),
        np.array(triangles, np.uint32, order="C"),
    )
    for array in found:
        array.flags.writeable = False
    return found
