"""Artificial observers by task: each with stated parameters, and defaults for any study."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from protocols.errors import StudyError
from protocols.plugins import misfit, registered, taking
from protocols.study_file.schema import StudyProtocol
from study_app.observers.observer_model import ArtificialObserver, ObserverModel, rng_of
from study_app.observers.preference_observer import DEFAULT_UTILITIES, PreferenceModel
from study_app.observers.rating_observer import RaterModel
from study_app.observers.right_or_wrong import DetectionModel, DifferenceModel, SensitivityModel

Maker = Callable[[StudyProtocol], ObserverModel]

OBSERVERS: Mapping[str, Maker] = registered(
    "observers",
    {
        "two-interval": PreferenceModel.of,
        "two-alternative": PreferenceModel.of,
        "yes-no": DetectionModel.of,
        "identification": SensitivityModel.of,
        "abx": DifferenceModel.of,
        "which-half": DifferenceModel.of,
        "rating": RaterModel.of,
    },
    "name a function from a study to an observer model",
    taking(1),
)


def default_model(study: StudyProtocol) -> ObserverModel:
    """Return the population that a study is tried on.

    Raises
    ------
    StudyError
        If no observer was written for its task.
    """
    kind = study.task.kind
    if kind not in OBSERVERS:
        raise StudyError(
            f"task {kind!r}: simulating needs an artificial observer of that name"
            f" (there are {', '.join(OBSERVERS)}); the package that adds the task can add one"
        )
    model = OBSERVERS[kind](study)
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
