"""Globes before an eye, the scenes of Beyond Blur's Fig. 12 and Fig. 13, and a planet's map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from protocols.errors import must_be_one_of

WIDTH_DEG = 40.0
"""Width of the picture, as long as nothing else is said."""


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
"""Rows of a globe's triangles, from pole to pole."""


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


FloatPlane = NDArray[np.float32]

# Height to encoded colour: dark plains, rust, dust, pale highlands.
_RAMP = np.array(
    [
        (0.0, 0.20, 0.12, 0.10),
        (0.35, 0.42, 0.21, 0.13),
        (0.6, 0.68, 0.38, 0.21),
        (0.8, 0.80, 0.55, 0.35),
        (1.0, 0.90, 0.74, 0.56),
    ]
)
_CRATERS = 1400
_POLE_DEG = 72.0  # of latitude: beyond it lies ice


def planet_map(height_px: int) -> NDArray[np.uint8]:
    """Draw an equirectangular map: (height, 2 * height, 3), encoded R'G'B'.

    It goes on at its other side. It is the same planet at every size, but for what is finer than
    a pixel of the smaller one.
    """
    rng = np.random.default_rng(0)
    latitude = (0.5 - (np.arange(height_px) + 0.5) / height_px) * np.pi
    ground = _fractal(height_px, 0, 1.55)
    ground += _craters(height_px, latitude, rng)
    stains = _fractal(height_px, 1, 1.3)
    # A low sun in the west makes relief of slopes.
    slope = np.roll(ground, -1, axis=1) - ground
    slope *= height_px / 512 / np.maximum(np.cos(latitude), 0.1)[:, None]
    level = np.clip(0.5 + 0.17 * ground + 0.13 * stains, 0, 1)
    shade = np.clip(1 + 1.3 * slope, 0.45, 1.5)
    ice = np.abs(np.degrees(latitude))[:, None] + 3.5 * ground > _POLE_DEG
    colour = np.empty((height_px, 2 * height_px, 3), np.uint8)
    for channel in range(3):
        plane = np.interp(level, _RAMP[:, 0], _RAMP[:, 1 + channel])
        plane = np.where(ice, 0.86 + 0.03 * channel, plane) * shade
        colour[..., channel] = np.rint(255 * plane.clip(0, 1))
    return colour


def _fractal(height_px: int, seed: int, exponent: float) -> FloatPlane:
    """Noise of amplitude 1 / f^exponent and unit variance, periodic along x.

    Frequencies are in cycles per turn, each with a phase of its own whatever the size.
    """
    rows, columns = 2 * height_px, 2 * height_px  # twice as high: the poles do not meet
    y = np.fft.fftfreq(rows, 1 / rows)
    spectrum = np.zeros((rows, columns // 2 + 1), np.complex64)
    # From coarse to fine, ring by ring, so that a larger map has the same waves and more.
    edge = 4
    while edge <= rows // 2:
        inner = edge // 2 if edge > 4 else 0
        rng = np.random.default_rng((seed, edge))
        part = rng.standard_normal((2 * edge, edge)).astype(np.float32) * np.complex64(1)
        part += 1j * rng.standard_normal((2 * edge, edge)).astype(np.float32)
        frequency = np.hypot(
            np.fft.fftfreq(2 * edge, 1 / (2 * edge))[:, None], np.arange(edge)[None]
        )
        part *= np.where((frequency >= inner) & (frequency < edge), 1, 0)
        rows_of_part = np.fft.fftfreq(2 * edge, 1 / (2 * edge)).astype(int)
        spectrum[rows_of_part, :edge] += part
        edge *= 2
    frequency = np.hypot(y[:, None], np.arange(columns // 2 + 1)[None]).astype(np.float32)
    spectrum *= np.maximum(frequency, 2.0) ** np.float32(-exponent)
    spectrum[0, 0] = 0
    plane = np.fft.irfft2(spectrum, (rows, columns))[:height_px].astype(np.float32)
    return np.asarray(plane / plane.std())


def _craters(height_px: int, latitude: NDArray[np.float64], rng: np.random.Generator) -> FloatPlane:
    """Bowls with rims, many small and few large, evenly over the globe."""
    width_px = 2 * height_px
    relief = np.zeros((height_px, width_px), np.float32)
    for _ in range(_CRATERS):
        radius = 0.004 * (1 - rng.random()) ** -0.7  # radians
        up, lon = math.asin(rng.uniform(-0.98, 0.98)), rng.uniform(0, 2 * np.pi)
        depth = rng.uniform(0.4, 1.3)
        radius = min(radius, 0.12)
        reach = 1.6 * radius
        rows = np.flatnonzero(np.abs(latitude - up) < reach)
        if not len(rows):
            continue
        half = reach / max(math.cos(up) - 0.5 * reach, 0.05)
        first = math.floor((lon - half) / (2 * np.pi) * width_px)
        count = min(width_px, math.ceil(2 * half / (2 * np.pi) * width_px) + 1)
        columns = np.arange(first, first + count)
        away = ((columns + 0.5) / width_px * 2 * np.pi - lon) * np.cos(latitude[rows])[:, None]
        distance = np.hypot(away, (latitude[rows] - up)[:, None]) / radius
        bowl = np.where(distance < 1, -0.9 * (1 - distance**2) + 0.25 * distance**6, 0)
        rim = np.where(distance >= 1, 0.25 * np.clip(1 - (distance - 1) / 0.6, 0, 1) ** 2, 0)
        relief[np.ix_(rows, columns % width_px)] += (depth * (bowl + rim)).astype(np.float32)
    return relief
