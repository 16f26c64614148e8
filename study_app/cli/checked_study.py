"""Whether a study can be built and shown: every mistake at once."""

from __future__ import annotations

from pathlib import Path

from pipeline.methods.registry import method_names, method_parameters
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import check_feasible
from protocols.manifest import Manifest
from protocols.registries import check_methods, check_scenes
from protocols.schema import StudyProtocol
from stimuli.scenes.registry import scene_names


def require_buildable(
    path: Path, study: StudyProtocol, display: Display, manifest: Manifest | None = None
) -> None:
    """Check names of methods and scenes, the display, and clips where they are given.

    Raises
    ------
    StudyError
        With a line for every mistake; `path` says where.
    """
    problems = check_methods(study, method_names(), method_parameters)
    problems += check_scenes(study, scene_names())
    problems += check_feasible(study, display, manifest)
    if problems:
        raise StudyError("\n".join(f"{path}: {problem}" for problem in problems))
