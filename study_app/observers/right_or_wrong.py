"""Observers of tasks with a right answer: a psychometric function, or a signal in noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from protocols.answer_rules import AnswerRule, answer_rule
from protocols.plan import PlannedTrial
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.rates import RatesAnalysis, value_of
from protocols.tasks.single import RightOrWrong
from study_app.observers.observer_model import Decision, ObserverModel, deviation, evidence_of

PLAIN = 10.0
"""Sensitivity to catch trials: only lapses miss them."""


@dataclass(frozen=True)
class SensitivityModel(ObserverModel):
    """A population whose sensitivity depends on method and level.

    Sensitivity (d', or logits above guessing) is ``strength[by] + slope (level - middle)``, plus a
    participant's and a scene's deviation.
    """

    strength: Mapping[str, float] = field(default_factory=dict)
    """Sensitivity at the middle level, by value of `by`; one that is not named has 1.5."""
    slope: float = 0.0
    """Change of the sensitivity over the range of levels."""
    participant_sd: float = 0.3
    """Standard deviation of the sensitivity between participants."""
    scene_sd: float = 0.2
    """The same between scenes."""
    criterion: float = 0.0
    """Tendency to say no (yes-no), in units of the noise."""
    by: tuple[str, ...] = ("method",)
    """The columns of the condition that name what is compared."""
    level: str | None = None
    """The column of levels."""
    levels: tuple[float, float] = (0.0, 1.0)
    """Lowest and highest level."""
    alternatives: tuple[str, ...] = ("yes", "no")
    """The task's answers."""

    @classmethod
    def of(cls, study: StudyProtocol) -> Self:
        """Return the default population for a study: harder towards the hard end of the levels."""
        analysis = study.analysis
        assert isinstance(analysis, RatesAnalysis)
        numbers = [
            float(value)
            for value in study.stimuli.values(analysis.level or "")
            if not isinstance(value, str)
        ] or [0.0, 1.0]
        compared = analysis.ordered(study.task, study.pool)
        slope = 0.0 if analysis.level is None else -2.0 if analysis.falling else 2.0
        return cls(
            strength={name: 1.0 + 0.6 * (place % 3) for place, name in enumerate(compared)},
            slope=slope,
            by=analysis.by_columns,
            level=analysis.level,
            levels=(min(numbers), max(numbers)),
            alternatives=study.task.answers(),
        )

    def sensitivity(self, trial: PlannedTrial, seed: int, participant: str) -> float:
        """Return the sensitivity of a participant to a trial; to a catch trial, which is plain."""
        if trial.role == "catch":
            return PLAIN
        condition = trial.condition
        scene = str(condition.get("scene", ""))
        found = self.strength.get(value_of(condition, self.by), 1.5)
        if self.level is not None and self.level in condition:
            low, high = self.levels
            share = (float(condition[self.level]) - low) / ((high - low) or 1.0)
            found += self.slope * (share - 0.5)
        found += self.participant_sd * deviation(seed, "participant", participant)
        return found + self.scene_sd * deviation(seed, "scene", scene)

    def right_probability(self, sensitivity: float) -> float:
        """Return the probability of a right answer without lapses: guessing, then a logistic."""
        guess = 1 / len(self.alternatives)
        return guess + (1 - guess) / (1 + math.exp(-2 * (sensitivity - 1)))

    def decide(
        self, trial: PlannedTrial, seed: int, participant: str, rng: np.random.Generator
    ) -> Decision:
        """Return the right answer as often as the sensitivity says, else another."""
        right = self.right_probability(self.sensitivity(trial, seed, participant))
        draw, blind = rng.uniform(), rng.uniform() < self.lapse
        others = [answer for answer in trial.answers if answer != trial.correct]
        answer = str(trial.correct) if draw < right else others[int(rng.integers(len(others)))]
        if blind:
            answer = trial.answers[int(rng.integers(len(trial.answers)))]
        guess = 1 / len(self.alternatives)
        return Decision(answer, 1 - abs(right - guess) / (1 - guess), evidence_of(right, draw))


@dataclass(frozen=True)
class DetectionModel(SensitivityModel):
    """Yes or no by a criterion: equal-variance signal detection."""

    def decide(
        self, trial: PlannedTrial, seed: int, participant: str, rng: np.random.Generator
    ) -> Decision:
        """Say yes where signal and noise together exceed the criterion."""
        d_prime = self.sensitivity(trial, seed, participant)
        mean = d_prime / 2 if trial.correct == "yes" else -d_prime / 2
        evidence = mean + float(rng.normal()) - self.criterion
        answer = "yes" if evidence > 0 else "no"
        if rng.uniform() < self.lapse:
            answer = trial.answers[int(rng.integers(2))]
        return Decision(answer, math.exp(-abs(evidence)), evidence)


@dataclass(frozen=True)
class DifferenceModel(SensitivityModel):
    """Stimuli are told apart by how much they differ, as the task's answer rule says.

    Along a rising level above 0, such as the scaling of pools, sensitivity is 0 up to a critical
    level and ``gain sqrt(1 - critical^2 / level^2)`` above it (Freeman and Simoncelli 2011).
    Deviations between participants and scenes are then those of its natural logarithm.
    """

    critical: Mapping[str, float] = field(default_factory=dict)
    """Level at which the sensitivity leaves 0, by value of `by`; a value that is not named has the
    sensitivity of `strength` and `slope`."""
    gain: float = 4.0
    """Sensitivity far above the critical level."""
    rule: AnswerRule = field(default_factory=lambda: answer_rule("differencing"))
    """Rule by which right answers follow from the sensitivity."""

    @classmethod
    def of(cls, study: StudyProtocol) -> Self:
        """Return the default population: critical levels in the lower half of those shown."""
        task = study.task
        assert isinstance(task, RightOrWrong)
        model = replace(super().of(study), rule=answer_rule(task.rule, len(task.answers())))
        found = [x for x in study.stimuli.values(model.level or "") if isinstance(x, int | float)]
        positive = [float(x) for x in found if x > 0]
        if positive and not getattr(study.analysis, "falling", False):
            low, high = min(positive), max(positive)
            critical = {
                name: low * (high / low) ** (0.3 + 0.12 * (place % 3))
                for place, name in enumerate(model.strength)
            }
            model = replace(model, critical=critical, participant_sd=0.25, scene_sd=0.1)
        return model

    def sensitivity(self, trial: PlannedTrial, seed: int, participant: str) -> float:
        """Return the distance of the two stimuli, in deviations of the noise."""
        critical = self.critical.get(value_of(trial.condition, self.by))
        if critical is None or trial.role == "catch":
            return super().sensitivity(trial, seed, participant)
        scene = str(trial.condition.get("scene", ""))
        away = self.participant_sd * deviation(seed, "participant", participant)
        own = critical * math.exp(away + self.scene_sd * deviation(seed, "scene", scene))
        level = float(trial.condition[str(self.level)])
        return self.gain * math.sqrt(max(0.0, 1 - (own / level) ** 2))

    def right_probability(self, sensitivity: float) -> float:
        """Return the share of right answers by the rule; no sensitivity lies below 0."""
        return float(self.rule.share(max(0.0, sensitivity)))
