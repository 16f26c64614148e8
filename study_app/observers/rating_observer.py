"""Observers who rate: a noisy place on an axis that thresholds cut into steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from protocols.plan import PlannedTrial
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rates import name_of
from protocols.tasks.rating import RatingsAnalysis
from study_app.observers.observer_model import Decision, ObserverModel, deviation

REACH = 1.5
"""The outer thresholds lie so far from the middle, in units of the noise."""


@dataclass(frozen=True)
class RaterModel(ObserverModel):
    """A population of observers whose noise is normal with standard deviation 1.

    A stimulus lies at ``strength[by]`` plus a participant's and a scene's deviation. Thresholds
    between steps are evenly spaced from -REACH to REACH.
    """

    strength: Mapping[str, float] = field(default_factory=dict)
    """Place on the axis, by value of `by`; one that is not named lies at 0."""
    participant_sd: float = 0.5
    """Standard deviation of the place between participants."""
    scene_sd: float = 0.3
    """The same between scenes."""
    by: str = "method"
    """The column of the condition that is compared."""

    @classmethod
    def of(cls, study: StudyProtocol) -> Self:
        """Return the default population: what is declared first is best, what comes last worst."""
        analysis = study.analysis
        assert isinstance(analysis, RatingsAnalysis)
        names = [name_of(value) for value in study.stimuli.values(analysis.by)]
        places = np.linspace(1.2, -1.2, len(names)).tolist()
        return cls(strength=dict(zip(names, places, strict=True)), by=analysis.by)

    def decide(
        self, trial: PlannedTrial, seed: int, participant: str, rng: np.random.Generator
    ) -> Decision:
        """Return the step in which place and noise fall."""
        place = self.strength.get(name_of(trial.condition.get(self.by, "")), 0.0)
        place += self.participant_sd * deviation(seed, "participant", participant)
        place += self.scene_sd * deviation(seed, "scene", str(trial.condition.get("scene", "")))
        steps = len(trial.answers)
        thresholds = np.linspace(-REACH, REACH, steps - 1)
        felt = place + float(rng.normal())
        step = int(np.searchsorted(thresholds, felt))
        if rng.uniform() < self.lapse:
            step = int(rng.integers(steps))
        nearest = float(np.abs(thresholds - felt).min())
        return Decision(trial.answers[step], math.exp(-4 * nearest), nearest)
