"""Artificial observers by task: each with stated parameters, and defaults for any study."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from protocols.errors import StudyError
from protocols.plugins import misfit, named, registered, taking
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.task_kinds import TASKS
from study_app.observers.observer_model import ArtificialObserver, ObserverModel, rng_of
from study_app.observers.preference_observer import DEFAULT_UTILITIES, PreferenceModel

MAKERS: Mapping[str, str | Callable[..., object]] = registered(
    "observers",
    {task: kind.observer for task, kind in TASKS.items() if kind.observer},
    "name a function from a study to an observer model",
    taking(1),
)
"""Makers of models by task; one that ships is named, and imported when it is asked for."""


def default_model(study: StudyProtocol) -> ObserverModel:
    """Return the population that a study is tried on.

    Raises
    ------
    StudyError
        If no observer was written for its task.
    """
    kind = study.task.kind
    if kind not in MAKERS:
        raise StudyError(
            f"task {kind!r}: simulating needs an artificial observer of that name"
            f" (there are {', '.join(MAKERS)}); the package that adds the task can add one"
        )
    model = named(MAKERS[kind])(study)
    if not isinstance(model, ObserverModel):
        must = "return a model based on study_app.observers.ObserverModel"
        raise misfit("observers", kind, must, model)
    return model


__all__ = [
    "DEFAULT_UTILITIES",
    "ArtificialObserver",
    "ObserverModel",
    "PreferenceModel",
    "default_model",
    "rng_of",
]
