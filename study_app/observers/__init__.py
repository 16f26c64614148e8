"""Artificial observers by task: each with stated parameters, and defaults for any study."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from protocols.errors import StudyError
from protocols.plugins import registered
from protocols.schema import StudyProtocol
from study_app.observers.base import ArtificialObserver, ObserverModel, rng_of
from study_app.observers.right_or_wrong import DetectionModel, DifferenceModel, SensitivityModel
from study_app.observers.two_interval import DEFAULT_UTILITIES, PreferenceModel

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
    },
)


def default_model(study: StudyProtocol) -> ObserverModel:
    """Return the population that a study is tried on.

    Raises
    ------
    StudyError
        If no observer was written for its task.
    """
    try:
        return OBSERVERS[study.task.kind](study)
    except KeyError:
        raise StudyError(
            f"task {study.task.kind!r}: simulating needs an artificial observer of that name"
            f" (there are {', '.join(OBSERVERS)}); the package that adds the task can add one"
        ) from None


__all__ = [
    "DEFAULT_UTILITIES",
    "ArtificialObserver",
    "ObserverModel",
    "PreferenceModel",
    "default_model",
    "rng_of",
]
