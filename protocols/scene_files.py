"""Which files of a protocol's scenes are not there."""

from __future__ import annotations

from pathlib import Path

from protocols.errors import Problem
from protocols.schema import StudyProtocol

_KEYS = ("file", "left", "right", "disparity", "rgb", "depth")


def missing_files(protocol: StudyProtocol, folder: Path) -> list[Problem]:
    """Return a problem for every file of a scene that is not below `folder`.

    Only what is plainly a file is looked for: patterns of sequences (``shot.####.exr``) and names
    of built-in pairs, which have no suffix, are left to whoever reads them.
    """
    problems = []
    for index, scene in enumerate(protocol.scenes):
        for key in _KEYS:
            name = getattr(scene, key, None)
            if not isinstance(name, str) or "#" in name or not Path(name).suffix:
                continue
            if not (folder / name).exists():
                problems.append(
                    Problem(
                        f"scenes[{index}].{key}",
                        f"the file is not there (looked for {folder / name});"
                        " 'metamerlab stimuli build' needs it",
                    )
                )
    return problems
