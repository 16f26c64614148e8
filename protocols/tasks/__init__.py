"""Tasks by kind: `kind` in the section `[task]` of a study names one."""

from __future__ import annotations

from protocols.plugins import registered
from protocols.tasks.abx import Abx
from protocols.tasks.base import Task
from protocols.tasks.identification import Identification
from protocols.tasks.two_alternative import TwoAlternative
from protocols.tasks.two_interval import TwoInterval
from protocols.tasks.yes_no import YesNo

TASKS: dict[str, type[Task]] = registered(
    "tasks",
    {
        "two-interval": TwoInterval,
        "two-alternative": TwoAlternative,
        "yes-no": YesNo,
        "identification": Identification,
        "abx": Abx,
    },
)
