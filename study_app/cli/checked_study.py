"""Check that a study can be built and shown: every mistake at once."""

from __future__ import annotations

from pathlib import Path

from protocols.display import Display
from protocols.errors import StudyError
from protocols.manifest import Manifest
from protocols.study_file.plausible import display_notes
from protocols.study_file.schema import StudyProtocol
from stimuli.recipes import builder_of
from stimuli.recipes.base import Builder
from study_app.shown_texts import shortcomings


def require_buildable(
    path: Path,
    study: StudyProtocol,
    display: Display,
    manifest: Manifest | None = None,
) -> tuple[Builder, dict[str, str]]:
    """Check the recipe's names, the display, and clips where they are given.

    Returns
    -------
    Builder, dict
        Of the study's stimuli; and why no font here writes a language, of each that none writes.

    Raises
    ------
    StudyError
        With a line for every mistake; `path` says where.
    """
    builder = builder_of(study, display, path.absolute().parent)
    found = shortcomings(study, display, manifest)
    unfit = found.problems
    if unfit:  # measures in other units are a likely cause
        unfit += display_notes(display)
    problems = [*builder.problems(), *unfit]
    if problems:
        raise StudyError("\n".join(f"{path}: {problem}" for problem in problems))
    return builder, found.unwritten
