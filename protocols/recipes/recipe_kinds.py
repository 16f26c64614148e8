"""Stimulus recipes by kind: what ships, and what installed packages add."""

from __future__ import annotations

from protocols.plugins import based_on, registered
from protocols.recipes.base import Recipe
from protocols.recipes.files import Files
from protocols.recipes.foveated_images import FoveatedImages
from protocols.recipes.warped_clips import WarpedClips

RECIPES: dict[str, type[Recipe]] = registered(
    "recipes",
    {"warped-clips": WarpedClips, "files": Files, "foveated-images": FoveatedImages},
    "name a class based on protocols.recipes.base.Recipe, whose kind is the entry's name",
    based_on(Recipe),
)
