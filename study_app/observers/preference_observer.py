"""An observer who prefers: Bradley-Terry utilities, lapses, order bias.

The probability to pick the first of two is ``lapse / 2 + (1 - lapse) / (1 + exp(-(u1 - u2 +
bias)))`` with utilities ``u = method + participant's + scene's deviation`` (Bradley and Terry
1952).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from protocols.plan import PlannedTrial
from protocols.study_file.schema import StudyProtocol
from study_app.observers.observer_model import Decision, ObserverModel, deviation, evidence_of

DEFAULT_UTILITIES: Mapping[str, float] = {
    "reference": 2.5,
    "metameric": 1.4,
    "coherence-transport": 1.4,
    "push-pull": 0.0,
}
"""Roughly the preferences of the inpainting paper's Fig. 10; one that it lacks is made up."""


@dataclass(frozen=True)
class PreferenceModel(ObserverModel):
    """A population of observers who prefer one of two."""

    utilities: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_UTILITIES))
    """Logits by method; a method that is not named has 0."""
    participant_sd: float = 0.5
    """Standard deviation, between participants, of the logit of a pair of methods."""
    scene_sd: float = 0.5
    """The same between scenes."""
    order_bias: float = 0.0
    """Logit in favour of the first of the two."""
    answers: tuple[str, str] = ("first", "second")
    """The task's names for the two."""

    @classmethod
    def of(cls, study: StudyProtocol) -> PreferenceModel:
        """Return the default population for a study."""
        first, second = study.task.answers()
        return cls(answers=(first, second))

    def choice_probability(
        self, seed: int, participant: str, scene: str, first: str, second: str
    ) -> float:
        """Return the probability that this participant picks `first` in this scene."""
        logit = (
            self._utility(seed, participant, scene, first)
            - self._utility(seed, participant, scene, second)
            + self.order_bias
        )
        return self.lapse / 2 + (1 - self.lapse) / (1 + math.exp(-logit))

    def decide(
        self, trial: PlannedTrial, seed: int, participant: str, rng: np.random.Generator
    ) -> Decision:
        """Return the preferred one of the two."""
        first, second = self.answers
        probability = self.choice_probability(
            seed,
            participant,
            str(trial.condition.get("scene", "")),
            str(trial.condition[first]),
            str(trial.condition[second]),
        )
        draw = rng.uniform()
        return Decision(
            first if draw < probability else second,
            1 - abs(2 * probability - 1),
            evidence_of(probability, draw),
        )

    def _utility(self, seed: int, participant: str, scene: str, method: str) -> float:
        # Each of the two methods of a pair brings half of the pair's variance.
        own = deviation(seed, "participant", participant, method)
        local = deviation(seed, "scene", scene, method)
        return (
            self.utilities.get(method, 0.0)
            + own * self.participant_sd / math.sqrt(2)
            + local * self.scene_sd / math.sqrt(2)
        )
