"""Small pictures that a new study starts from, each with its row in the table of stimuli.

They are there so that a fresh study can be built, simulated and reported at once. Levels are evenly
spaced, from hard to plain, and every combination of the columns has its picture.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from protocols.disk.hashing import sha256_bytes
from protocols.plugins import named
from protocols.tasks.task_kinds import TASKS
from protocols.units import Scalar
from stimuli.media.png import encode_bytes

EDGE_PX = 128
CONTRASTS = (0.04, 0.08, 0.12, 0.16, 0.2)
BLURS_PX = (0.0, 0.5, 1.0, 1.5, 2.0)
SCENES = ("one", "two")

GreyPicture: TypeAlias = NDArray[np.float64]
"""Encoded grey around 0: black is -0.5, white 0.5."""


@dataclass(frozen=True)
class ExamplePicture:
    """One stimulus."""

    name: str
    condition: dict[str, Scalar]
    picture: NDArray[np.uint8]
    """Shape (EDGE_PX, EDGE_PX, 3)."""


def gratings_in_noise() -> Iterator[ExamplePicture]:
    """Yield gratings in fine or coarse noise, and the same number of pictures of noise alone."""
    x = np.arange(EDGE_PX) / EDGE_PX
    grating = np.tile(np.sin(2 * np.pi * 8 * x), (EDGE_PX, 1)) * _window()
    for scene, noise, pattern, contrast in product(
        SCENES, ("fine", "coarse"), ("grating", "none"), CONTRASTS
    ):
        name = f"{scene}-{noise}-{pattern}-{round(100 * contrast):02d}"
        grey = 0.1 * _texture(name, 0.5 if noise == "fine" else 2.0) * _window()
        if pattern == "grating":
            grey = grey + contrast / 2 * grating
        yield ExamplePicture(
            name,
            {"scene": scene, "noise": noise, "pattern": pattern, "contrast": contrast},
            _stored(grey),
        )


def rings() -> Iterator[ExamplePicture]:
    """Yield dark rings with a gap on one of four sides, thick or thin."""
    centre = (EDGE_PX - 1) / 2
    y, x = np.mgrid[:EDGE_PX, :EDGE_PX] - centre
    radius = np.hypot(x, y)
    sides = {"left": (-x, y), "up": (-y, x), "down": (y, x), "right": (x, y)}
    for stroke, gap, contrast in product(("thick", "thin"), sides, CONTRASTS):
        width = 16.0 if stroke == "thick" else 8.0
        along, across = sides[gap]
        ring = np.clip(width / 2 - abs(radius - 32.0) + 0.5, 0, 1)
        opening = np.where(along > 0, np.clip(width / 2 - abs(across) + 0.5, 0, 1), 0)
        yield ExamplePicture(
            f"{stroke}-{gap}-{round(100 * contrast):02d}",
            {"stroke": stroke, "gap": gap, "contrast": contrast},
            _stored(-contrast / 2 * ring * (1 - opening)),
        )


def blurred_textures() -> Iterator[ExamplePicture]:
    """Yield textures, sharp (blur 0, the standard) and blurred."""
    for scene, texture, blur_px in product(SCENES, ("fine", "coarse"), BLURS_PX):
        sharp = _texture(f"{scene}-{texture}", 0.7 if texture == "fine" else 2.0)
        grey = gaussian_filter(sharp, blur_px, mode="wrap") if blur_px else sharp
        yield ExamplePicture(
            f"{scene}-{texture}-{round(10 * blur_px):02d}",
            {"scene": scene, "texture": texture, "blur_px": blur_px},
            _stored(0.15 * grey * _window()),
        )


def example_files(task: str) -> dict[str, bytes]:
    """Return the files that a new study of a task starts from, by name: table and pictures.

    Empty for tasks whose stimuli are rendered.
    """
    if not TASKS[task].example:
        return {}
    yielded = named(TASKS[task].example)()
    assert isinstance(yielded, Iterator)
    examples: list[ExamplePicture] = list(yielded)
    text = io.StringIO()
    columns = list(examples[0].condition)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["stimulus", "file", *columns])
    found: dict[str, bytes] = {}
    for example in examples:
        file = f"pictures/{example.name}.png"
        writer.writerow([example.name, file, *example.condition.values()])
        found[file] = encode_bytes(example.picture)
    return {"stimuli.csv": text.getvalue().encode()} | found


def _texture(name: str, blur_px: float) -> GreyPicture:
    """Return noise of standard deviation 1 that belongs to a name and repeats at the edges."""
    rng = np.random.default_rng(int(sha256_bytes(name.encode())[:16], 16))
    noise = gaussian_filter(rng.normal(size=(EDGE_PX, EDGE_PX)), blur_px, mode="wrap")
    return np.asarray((noise - noise.mean()) / noise.std())


def _window() -> GreyPicture:
    """Return a soft round window: 1 in the middle, 0 at the edges."""
    centre = (EDGE_PX - 1) / 2
    y, x = np.mgrid[:EDGE_PX, :EDGE_PX] - centre
    return np.asarray(np.clip((centre - np.hypot(x, y)) / (EDGE_PX / 8), 0, 1))


def _stored(grey: GreyPicture) -> NDArray[np.uint8]:
    """Return grey around the middle, as the background of a study is, in three channels."""
    stored = np.clip(np.rint(255 * (grey + 0.5)), 0, 255).astype(np.uint8)
    return np.repeat(stored[..., None], 3, axis=-1)
