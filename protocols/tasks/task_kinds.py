"""Tasks by kind: what ships, and what installed packages add."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real

from protocols.plugins import based_on, check_methods, misfit, registered
from protocols.recipes.base import Pool
from protocols.tasks.abx import Abx
from protocols.tasks.base import Task
from protocols.tasks.identification import Identification
from protocols.tasks.pairs import TwoAlternative, TwoInterval
from protocols.tasks.rating import Rating
from protocols.tasks.which_half import WhichHalf
from protocols.tasks.yes_no import YesNo


@dataclass(frozen=True)
class TaskKind:
    """A kind of task: its class, and where all else of it lies.

    Analysis, observer and example are named as ``module:NAME``; the packages that need them import
    them when they are asked for. A plug-in names its own by entry points.
    """

    task: type[Task]
    analysis: str = ""
    """An `analysis.tasks.base.TaskAnalysis`, of all tasks with the same section `[analysis]`."""
    observer: str = ""
    """A function from a study to a `study_app.observers.ObserverModel`."""
    recipe: str = ""
    """Recipe that a new study starts from; empty: none is written."""
    example: str = ""
    """A function that yields the pictures of a new study with the recipe `files`."""


_PREFERENCE = "analysis.tasks.preference:PreferenceOfPairs"
_DISCRIMINATION = "analysis.tasks.rates:DiscriminationRates"
_PREFERRING = "study_app.observers.preference_observer:PreferenceModel.of"
_RIGHT, _EXAMPLES = "study_app.observers.right_or_wrong", "stimuli.recipes.example_pictures"
_DIFFERING = _DISCRIMINATION, f"{_RIGHT}:DifferenceModel.of", "files"
_TEXTURES = f"{_EXAMPLES}:blurred_textures"
SHIPPED = {
    "two-interval": TaskKind(TwoInterval, _PREFERENCE, _PREFERRING, "warped-clips"),
    "two-alternative": TaskKind(TwoAlternative, _PREFERENCE, _PREFERRING, "warped-clips"),
    "yes-no": TaskKind(
        YesNo,
        "analysis.tasks.rates:DetectionRates",
        f"{_RIGHT}:DetectionModel.of",
        "files",
        f"{_EXAMPLES}:gratings_in_noise",
    ),
    "identification": TaskKind(
        Identification,
        _DISCRIMINATION,
        f"{_RIGHT}:SensitivityModel.of",
        "files",
        f"{_EXAMPLES}:rings",
    ),
    "abx": TaskKind(Abx, *_DIFFERING, _TEXTURES),
    "which-half": TaskKind(WhichHalf, *_DIFFERING, _TEXTURES),
    "rating": TaskKind(
        Rating,
        "analysis.tasks.rating_analysis:RatingsTask",
        "study_app.observers.rating_observer:RaterModel.of",
        "files",
        _TEXTURES,
    ),
}
"""Tasks that ship, by name."""
TASKS = SHIPPED | {
    name: TaskKind(task)
    for name, task in registered(
        "tasks",
        {name: kind.task for name, kind in SHIPPED.items()},
        "name a class based on protocols.tasks.base.Task, whose kind is the entry's name",
        based_on(Task),
    ).items()
    if name not in SHIPPED
}
_ASKED = (
    "answers", "cells", "catch_cells", "durations", "shown_s", "description", "design_sentence",
    "right_answer", "condition_columns", "answer_columns", "own_columns", "labels",
)  # fmt: skip


def check_returns(task: Task, pool: Pool | None = None) -> None:
    """Refuse the task of a plug-in of which a method returns something else than it must.

    Every method says so when it is called. Called at once are those without arguments; with a pool
    those that take one, which a study without mistakes may ask.

    Raises
    ------
    StudyError
        Naming the plug-in and the method.
    """
    if type(task).__module__.startswith("protocols."):
        return
    for plugged in (type(task), type(task).analysis):
        check_methods("tasks", task.kind, plugged)
    if task.adaptation is not None:
        check_methods("tasks", task.kind, type(task.adaptation))
    for name in _ASKED:
        if (len(inspect.signature(getattr(Task, name)).parameters) > 1) == (pool is not None):
            getattr(task, name)(*[pool] if pool else [])


def check_row(task: Task, pool: Pool, row: Mapping[str, object]) -> None:
    """Refuse the task of a plug-in whose `row` is not what its columns say; None says nothing.

    Raises
    ------
    StudyError
        Naming the plug-in and the column.
    """
    if type(task).__module__.startswith("protocols."):
        return
    for column in (*task.condition_columns(pool), *task.answer_columns()):
        if column.name not in row:
            place = f" with {', '.join(row) or 'nothing'}"
            must = f"return its column {column.name!r} from row"
            raise misfit("tasks", task.kind, must, row, place)
        value = row[column.name]
        wanted = (Real, str) if column.kind in ("text", "value") else Real
        if value is not None and not isinstance(value, wanted):
            must = f"return from row, in its column {column.name!r}, what is {column.kind!r}"
            raise misfit("tasks", task.kind, must, value)
