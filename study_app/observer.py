"""Artificial observers: Bradley-Terry preference, lapses, order bias, reaction times.

The probability to pick interval 1 is ``lapse / 2 + (1 - lapse) / (1 + exp(-(u1 - u2 + bias)))``
with utilities ``u = method + participant's + scene's deviation`` (Bradley and Terry 1952).
Every answer is a function of (seed, participant, trial, attempt): the same after a crash.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from protocols.hashing import Json, canonical_json
from protocols.plan import PlannedTrial
from protocols.session_schema import Response
from study_app.stage import Page, PageResult

DEFAULT_UTILITIES: Mapping[str, float] = {"reference": 2.5, "metameric": 1.4, "push-pull": 0.0}
"""Roughly the preferences of the inpainting paper's Fig. 10."""


@dataclass(frozen=True)
class ObserverModel:
    """A population of observers."""

    utilities: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_UTILITIES))
    """Logits by method; a method that is not named has 0."""
    participant_sd: float = 0.5
    """Standard deviation, between participants, of the logit of a pair of methods."""
    scene_sd: float = 0.5
    """The same between scenes."""
    lapse: float = 0.02
    """Share of answers given blindly."""
    order_bias: float = 0.0
    """Logit in favour of interval 1."""
    rt_median_s: float = 0.7
    """Median reaction time for an easy pair."""
    rt_sigma: float = 0.35
    """Standard deviation of its logarithm."""
    rt_hard_s: float = 0.5
    """How much longer a pair of equals takes."""

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

    def _utility(self, seed: int, participant: str, scene: str, method: str) -> float:
        # Each of the two methods of a pair brings half of the pair's variance.
        own = rng_of(seed, "participant", participant, method).normal()
        local = rng_of(seed, "scene", scene, method).normal()
        return (
            self.utilities.get(method, 0.0)
            + float(own) * self.participant_sd / math.sqrt(2)
            + float(local) * self.scene_sd / math.sqrt(2)
        )


class ArtificialObserver:
    """One observer before a stage."""

    def __init__(
        self, model: ObserverModel, response: Response, seed: int, participant: str
    ) -> None:
        self._model, self._response = model, response
        self._seed, self._participant = seed, participant

    def answer(self, trial: PlannedTrial, attempt: int) -> tuple[str, float]:
        """Return the key and the reaction time."""
        model = self._model
        probability = model.choice_probability(
            self._seed, self._participant, trial.scene, trial.first, trial.second
        )
        rng = rng_of(self._seed, "answer", self._participant, trial.id, attempt)
        picks_first = bool(rng.uniform() < probability)
        on_left = picks_first == (trial.first_side == "left")
        keys = self._response.left_keys if on_left else self._response.right_keys
        hardness = 1 - abs(2 * probability - 1)
        median_s = model.rt_median_s + model.rt_hard_s * hardness
        return keys[0], median_s * math.exp(float(rng.normal()) * model.rt_sigma)

    def turn_page(self, page: Page) -> PageResult:
        """Read for a while, agree, go on; but nobody can calibrate an artificial eye again."""
        keys = self._response.continue_keys
        if page.name == "calibration":
            keys = self._response.quit_keys
        answer = ""
        if page.name == "question":
            answer = page.choices[0] if page.choices else "simulated"
        return PageResult(keys[0], answer, max(2.0, page.least_s))


def rng_of(*parts: Json) -> np.random.Generator:
    """Return a generator fixed by its parts."""
    digest = hashlib.sha256(canonical_json(list(parts))).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "big"))
