"""Builders of stimuli by the kind of their recipe, and what a new study starts from."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from protocols.display import Display
from protocols.errors import StudyError
from protocols.plugins import based_on, registered
from protocols.study_file.schema import StudyProtocol
from stimuli.recipes.base import Builder

BUILDERS: dict[str, str | type[Builder]] = registered(
    "builders",
    {
        "warped-clips": "build_warped_clips:WarpedClipBuilder",
        "files": "build_files:FileBuilder",
        "foveated-images": "build_foveated_images:FoveatedBuilder",
    },
    "name a class based on stimuli.recipes.base.Builder",
    based_on(Builder),
)
"""Ours are imported when they are asked for: each knows libraries that the others do not need."""


def builder_of(study: StudyProtocol, display: Display, folder: Path) -> Builder:
    """Return the builder of a study's stimuli; `folder` holds the files that it names.

    Raises
    ------
    StudyError
        If no builder was written for its recipe.
    """
    try:
        made = BUILDERS[study.stimuli.kind]
    except KeyError:
        raise StudyError(
            f"stimuli.kind {study.stimuli.kind!r}: building needs a builder of that name (there"
            f" are {', '.join(BUILDERS)}); the package that adds the recipe can add one"
        ) from None
    if isinstance(made, str):
        module, _, name = made.partition(":")
        found: type[Builder] = getattr(import_module(f"stimuli.recipes.{module}"), name)
        return found(study, display, folder)
    return made(study, display, folder)
