"""Tasks by kind: what ships, and what installed packages add."""

from __future__ import annotations

from protocols.plugins import based_on, registered
from protocols.tasks.abx import Abx
from protocols.tasks.base import Task
from protocols.tasks.identification import Identification
from protocols.tasks.rating import Rating
from protocols.tasks.two_alternative import TwoAlternative
from protocols.tasks.two_interval import TwoInterval
from protocols.tasks.which_half import WhichHalf
from protocols.tasks.yes_no import YesNo

TASKS: dict[str, type[Task]] = registered(
    "tasks",
    {
        "two-interval": TwoInterval,
        "two-alternative": TwoAlternative,
        "yes-no": YesNo,
        "identification": Identification,
        "abx": Abx,
        "which-half": WhichHalf,
        "rating": Rating,
    },
    "name a class based on protocols.tasks.base.Task, whose kind is the entry's name",
    based_on(Task),
)
