"""Built-in scenes by name. To add one, write its module and add one line to `SCENES`."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from pipeline.errors import InputError
from protocols.errors import must_be_one_of
from stimuli.rendering.world import World


@dataclass(frozen=True)
class SceneEntry:
    """One built-in scene; `module` has ``build(rng) -> World`` and is imported when needed."""

    name: str
    summary: str
    module: str


SCENES = tuple(
    SceneEntry(name, summary, f"stimuli.scenes.{name}")
    for name, summary in (
        ("garden", "a lawn and flower bed behind a picket fence, before a brick wall"),
        ("shed", "a wooden shed, barrels and a ladder on gravel"),
        ("castle", "towers and battlements seen past pines"),
        ("colonnade", "two rows of fluted columns on a stone floor"),
        ("tunnel", "a brick tunnel with rails, iron props and daylight at its end"),
        ("thicket", "branches and leaves before a forest floor"),
        ("street", "houses, shops with signs, kerbs, lamps, trees and parked cars, all around"),
    )
)


def scene_names() -> list[str]:
    """Return every built-in scene's name."""
    return [entry.name for entry in SCENES]


def scene_entry(name: str) -> SceneEntry:
    """Return the entry called `name`.

    Raises
    ------
    InputError
        If there is none, with the nearest name.
    """
    for entry in SCENES:
        if entry.name == name:
            return entry
    raise InputError(must_be_one_of("a built-in scene", name, scene_names()))


def build_scene(name: str, seed: int = 0, parameters: Mapping[str, Any] | None = None) -> World:
    """Build the scene called `name`.

    Parameters
    ----------
    seed : int
        Of every random placement and texture; another seed is another place of the same kind.
    parameters : mapping, optional
        Built-in scenes take none yet.

    Raises
    ------
    InputError
        If the name or a parameter is unknown.
    """
    entry = scene_entry(name)
    if parameters:
        raise InputError(
            f"the built-in scene {name!r} takes no parameters (got {', '.join(parameters)})"
        )
    module = importlib.import_module(entry.module)
    return cast(World, module.build(np.random.default_rng(seed)))
