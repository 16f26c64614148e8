"""Builders of stimuli by the kind of their recipe."""

from __future__ import annotations

from pathlib import Path

from protocols.display import Display
from protocols.errors import StudyError
from protocols.plugins import registered
from protocols.schema import StudyProtocol
from stimuli.recipes.base import Builder
from stimuli.recipes.files import FileBuilder
from stimuli.recipes.foveated_images import FoveatedBuilder
from stimuli.recipes.warped_clips import WarpedClipBuilder

BUILDERS: dict[str, type[Builder]] = registered(
    "builders",
    {
        "warped-clips": WarpedClipBuilder,
        "files": FileBuilder,
        "foveated-images": FoveatedBuilder,
    },
)


def builder_of(protocol: StudyProtocol, display: Display, folder: Path) -> Builder:
    """Return the builder of a study's stimuli; `folder` holds the files that it names.

    Raises
    ------
    StudyError
        If no builder was written for its recipe.
    """
    try:
        made = BUILDERS[protocol.stimuli.kind]
    except KeyError:
        raise StudyError(
            f"stimuli.kind {protocol.stimuli.kind!r}: building needs a builder of that name (there"
            f" are {', '.join(BUILDERS)}); the package that adds the recipe can add one"
        ) from None
    return made(protocol, display, folder)
