"""Stimulus recipes by kind: `kind` in the section `[stimuli]` of a study names one."""

from __future__ import annotations

from protocols.plugins import based_on, registered
from protocols.recipes.base import Recipe

RECIPES: dict[str, type[Recipe]]
"""What ships, and what installed packages add. Read when first asked for, so that the modules of
a package may import from here while they are loaded."""


def _read(shipped: dict[str, type[Recipe]]) -> dict[str, type[Recipe]]:
    must = "name a class based on protocols.recipes.base.Recipe, whose kind is the entry's name"
    return registered("recipes", shipped, must, based_on(Recipe))


def __getattr__(name: str) -> object:
    if name != "RECIPES":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from protocols.recipes.files import Files
    from protocols.recipes.foveated_images import FoveatedImages
    from protocols.recipes.warped_clips import WarpedClips

    shipped: dict[str, type[Recipe]] = {
        "warped-clips": WarpedClips,
        "files": Files,
        "foveated-images": FoveatedImages,
    }
    return globals().setdefault(name, _read(shipped))
