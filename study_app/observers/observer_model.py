"""Artificial observers: a model with stated parameters decides, and presses the key for it.

Every answer is a function of (seed, participant, trial, attempt): the same after a crash.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from protocols.disk.hashing import Json, canonical_json
from protocols.plan import PlannedTrial
from protocols.script import ScriptQuestion
from protocols.study_file.session_schema import Response
from protocols.tasks.confidence_question import CONFIDENCE
from study_app.stage import Page, PageResult

NORMAL = NormalDist()


class Decision(NamedTuple):
    """Decision of a model in one trial."""

    answer: str
    hardness: float
    """0: plain; 1: a guess. Hard decisions take longer."""
    evidence: float | None = None
    """Distance of the decision variable from the criterion, in standard deviations of its noise.
    None: it follows from the hardness, as -ln(hardness)."""

    @property
    def distance(self) -> float:
        """The evidence for the answer, at least 0."""
        if self.evidence is not None:
            return abs(self.evidence)
        return -math.log(max(self.hardness, 1e-9))


@dataclass(frozen=True, kw_only=True)
class ObserverModel:
    """A population of observers: what the models of all tasks have."""

    lapse: float = 0.02
    """Share of answers given blindly."""
    rt_median_s: float = 0.7
    """Median reaction time for an easy decision."""
    rt_sigma: float = 0.35
    """Standard deviation of its logarithm."""
    rt_hard_s: float = 0.5
    """Time that a guess takes longer than a plain answer."""
    confidence_noise: float = 0.3
    """Standard deviation, in that of the decision variable, of what blurs confidence."""

    def decide(
        self, trial: PlannedTrial, seed: int, participant: str, rng: np.random.Generator
    ) -> Decision:
        """Return the answer of a participant; `rng` belongs to this attempt alone."""
        raise NotImplementedError

    def confidence(self, decision: Decision, steps: int, rng: np.random.Generator) -> int:
        """Return the step, from 0, that an answer's evidence and noise reach.

        Criteria are such that who only guesses, and without noise, gives each step equally often.
        """
        felt = abs(decision.distance + self.confidence_noise * float(rng.normal()))
        return min(steps - 1, int(steps * (2 * NORMAL.cdf(felt) - 1)))


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
        rng = rng_of(self._seed, "answer", self._participant, trial.id, attempt)
        decision = model.decide(trial, self._seed, self._participant, rng)
        keys = self._response.keys[trial.answers.index(decision.answer)]
        median_s = model.rt_median_s + model.rt_hard_s * decision.hardness
        return keys[0], median_s * math.exp(float(rng.normal()) * model.rt_sigma)

    def answer_further(
        self, question: ScriptQuestion, trial: PlannedTrial, attempt: int
    ) -> tuple[str, float]:
        """Return the key and the reaction time: confidence by the model, all else by chance."""
        purpose = self._seed, "answer", self._participant, trial.id, attempt
        rng, model = rng_of(*purpose, question.name), self._model
        place = int(rng.integers(len(question.keys)))
        if question.name == CONFIDENCE:
            decision = model.decide(trial, self._seed, self._participant, rng_of(*purpose))
            place = model.confidence(decision, len(question.keys), rng)
        keys = question.keys[place]
        return keys[0], model.rt_median_s * math.exp(float(rng.normal()) * model.rt_sigma)

    def turn_page(self, page: Page) -> PageResult:
        """Read for a while, agree, go on; but nobody can calibrate an artificial eye again.

        Whether to quit is asked when a person pressed the key, or Ctrl-C: that is granted.
        """
        keys = self._response.continue_keys
        if page.name in ("calibration", "quit"):
            keys = self._response.quit_keys
        answer = ""
        if page.name == "question":
            answer = page.choices[0] if page.choices else "simulated"
        return PageResult(keys[0], answer, max(2.0, page.least_s))


def evidence_of(probability: float, draw: float) -> float:
    """Return the normal decision variable that exceeds 0 where a draw is below a probability."""
    high, low = (min(max(p, 1e-9), 1 - 1e-9) for p in (probability, draw))
    return NORMAL.inv_cdf(high) - NORMAL.inv_cdf(low)


def rng_of(*parts: Json) -> np.random.Generator:
    """Return a generator fixed by its parts."""
    digest = hashlib.sha256(canonical_json(list(parts))).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "big"))


def deviation(seed: int, what: str, *name: Json) -> float:
    """Return a standard normal number that belongs to a participant, a scene, ..."""
    return float(rng_of(seed, what, *name).normal())
