"""Tasks by kind: `kind` in the section `[task]` of a study names one."""

from __future__ import annotations

from protocols.plugins import based_on, registered
from protocols.tasks.base import Task

TASKS: dict[str, type[Task]]
"""What ships, and what installed packages add. Read when first asked for, so that the modules of
a package may import from here while they are loaded."""


def _read(shipped: dict[str, type[Task]]) -> dict[str, type[Task]]:
    must = "name a class based on protocols.tasks.base.Task, whose kind is the entry's name"
    return registered("tasks", shipped, must, based_on(Task))


def __getattr__(name: str) -> object:
    if name != "TASKS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from protocols.tasks.abx import Abx
    from protocols.tasks.identification import Identification
    from protocols.tasks.two_alternative import TwoAlternative
    from protocols.tasks.two_interval import TwoInterval
    from protocols.tasks.which_half import WhichHalf
    from protocols.tasks.yes_no import YesNo

    shipped: dict[str, type[Task]] = {
        "two-interval": TwoInterval,
        "two-alternative": TwoAlternative,
        "yes-no": YesNo,
        "identification": Identification,
        "abx": Abx,
        "which-half": WhichHalf,
    }
    return globals().setdefault(name, _read(shipped))
