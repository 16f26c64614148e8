"""What other installed packages add to a registry of ours: Python entry points.

A package that declares, say, ``[project.entry-points."metamerlab.tasks"]`` with
``my-task = "my_package.tasks:MyTask"`` adds a task without a change here.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata
from typing import TypeVar

from protocols.errors import StudyError

T = TypeVar("T")


def registered(group: str, shipped: Mapping[str, T]) -> dict[str, T]:
    """Return what ships in a registry and what installed packages add to it, by name.

    Parameters
    ----------
    group : str
        The registry: entry points of ``metamerlab.<group>`` belong to it.
    shipped : mapping
        What comes with metamerlab.

    Raises
    ------
    StudyError
        If a package takes a name that is taken, or cannot be imported.
    """
    found = dict(shipped)
    for entry in metadata.entry_points(group=f"metamerlab.{group}"):
        owner = entry.dist.name if entry.dist else entry.value
        if entry.name in found:
            raise StudyError(
                f"package {owner!r}: a plug-in must have a name of its own in metamerlab.{group}"
                f" (got {entry.name!r}, which is taken); rename it, or uninstall the package"
            )
        try:
            found[entry.name] = entry.load()
        except Exception as error:
            raise StudyError(
                f"package {owner!r}: its plug-in {entry.name!r} of metamerlab.{group} must load"
                f" ({type(error).__name__}: {error}); mend or uninstall the package"
            ) from error
    return found
