"""Stimulus recipes by kind: `kind` in the section `[stimuli]` of a study names one."""

from __future__ import annotations

from protocols.plugins import registered
from protocols.recipes.base import Recipe
from protocols.recipes.files import Files
from protocols.recipes.foveated_images import FoveatedImages
from protocols.recipes.warped_clips import WarpedClips

RECIPES: dict[str, type[Recipe]] = registered(
    "recipes",
    {"warped-clips": WarpedClips, "files": Files, "foveated-images": FoveatedImages},
)
