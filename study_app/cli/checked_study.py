"""Whether a study can be built and shown: every mistake at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import check_feasible
from protocols.manifest import Manifest
from protocols.plausible import display_notes
from protocols.schema import StudyProtocol
from stimuli.recipes import builder_of
from stimuli.recipes.base import Builder


def require_buildable(
    path: Path,
    study: StudyProtocol,
    display: Display,
    manifest: Manifest | None = None,
    *,
    also: Sequence[str] = (),
) -> Builder:
    """Check what the recipe names, the display, and clips where they are given.

    `also` holds further mistakes, to be told with these.

    Returns
    -------
    Builder
        Of the study's stimuli.

    Raises
    ------
    StudyError
        With a line for every mistake; `path` says where.
    """
    builder = builder_of(study, display, path.absolute().parent)
    unfit = check_feasible(study, display, manifest)
    if unfit:  # measures in other units are a likely cause
        unfit += display_notes(display)
    problems = [*builder.problems(), *unfit, *also]
    if problems:
        raise StudyError("\n".join(f"{path}: {problem}" for problem in problems))
    return builder
