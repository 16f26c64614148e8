"""Tasks by kind: what ships, and what installed packages add."""

from __future__ import annotations

import inspect
from typing import get_type_hints

from pydantic import TypeAdapter, ValidationError

from protocols.plugins import based_on, misfit, registered
from protocols.pool import Pool
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
_CHECKED = (
    "answers", "cells", "catch_cells", "durations", "shown_s", "description", "design_sentence",
    "right_answer", "condition_columns", "answer_columns", "own_columns", "labels",
)  # fmt: skip


def check_returns(task: Task, pool: Pool | None = None) -> None:
    """Refuse the task of a plug-in of which a method returns something else than it must.

    With a pool these are the methods that take one, which a study without mistakes may ask.

    Raises
    ------
    StudyError
        Naming the plug-in and the method.
    """
    for name in _CHECKED if not type(task).__module__.startswith("protocols.") else ():
        method = getattr(Task, name)
        if (len(inspect.signature(method).parameters) > 1) != (pool is not None):
            continue
        found = getattr(task, name)(*[pool] if pool else [])
        wanted = get_type_hints(method)["return"]
        try:
            TypeAdapter(wanted).validate_python(found)
        except ValidationError:
            said = f"return {inspect.formatannotation(wanted)} from {name}"
            raise misfit("tasks", task.kind, said, found) from None
