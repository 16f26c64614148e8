"""Observers of tasks with right answers, made up: studies for tests to analyse.

Each function returns the table that the statistics take: ``participant``, ``scene``, ``method``,
the level, ``order``, ``expected``, ``answer``, ``correct``, ``rt_s``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from analysis.models.curves.critical_likelihood import scaling_d_prime
from protocols.adaptive.answer_history import Shape
from protocols.adaptive.psychometric_function import sigmoid
from protocols.answer_rules import answer_rule

Floats = NDArray[np.float64]

COMMON = 0.5
"""Share of the variance between participants, and scenes, that all conditions have in common."""


@dataclass(frozen=True)
class TaskDesign:
    """Size of a study. `repeats`: trials per participant, scene, condition and level.

    A yes-no task has so many of the signal and so many of noise.
    """

    participants: int
    scenes: int = 1
    repeats: int = 1

    def __post_init__(self) -> None:
        """Refuse a study without trials."""
        if min(self.participants, self.scenes, self.repeats) < 1:
            raise ValueError(f"participants, scenes and repeats must be at least 1 (got {self})")


def simulate_yes_no(
    design: TaskDesign,
    d_prime: Mapping[str, float],
    rng: np.random.Generator,
    *,
    criterion: Mapping[str, float] | float = 0.0,
    criterion_sd: tuple[float, float] = (0.4, 0.4),
    d_prime_sd: tuple[float, float] = (0.4, 0.4),
    answers: tuple[str, str] = ("inconsistent", "consistent"),
    common: float = COMMON,
) -> pd.DataFrame:
    """Return a yes-no study.

    Parameters
    ----------
    d_prime, criterion : mapping of method to its typical value
    criterion_sd, d_prime_sd : (participants, scenes)
        Deviations, in standard deviations of the observer's noise.
    answers : (signal's, other)
    common : float
        `COMMON`.
    """
    blocks = []
    shape = (design.participants, design.scenes)
    shared = _effects(design, (criterion_sd, d_prime_sd), common, rng)
    for method, typical in d_prime.items():
        own = _effects(design, (criterion_sd, d_prime_sd), 1.0 - common, rng)
        middle = criterion[method] if isinstance(criterion, Mapping) else criterion
        c = middle + shared[0] + own[0]
        d = typical + shared[1] + own[1]
        for signal in (True, False):
            says = ndtr((0.5 if signal else -0.5) * d - c)
            said = rng.random((*shape, design.repeats)) < says[..., None]
            table = _block(said, method)
            table["expected"] = answers[0] if signal else answers[1]
            table["answer"] = np.where(table["correct"] == 1, answers[0], answers[1])
            table["correct"] = (table["expected"] == table["answer"]).astype(int)
            blocks.append(table)
    return _ordered(blocks, rng)


def simulate_confidence(
    participants: int,
    trials: int,
    d_prime: Mapping[str, float],
    rng: np.random.Generator,
    *,
    noise: float,
    signal_sd: float,
) -> pd.DataFrame:
    """Return a yes-no study with confidence: how far evidence lies from the criterion.

    Parameters
    ----------
    trials : int
        Per participant and method, half of them the signal.
    noise : float
        Standard deviation of what is added to evidence before it becomes confidence.
    signal_sd : float
        Of the signal's evidence; the noise's is 1.
    """
    answers = ("inconsistent", "consistent")
    blocks = []
    for person in range(participants):
        own = rng.normal(0.0, 0.3)
        for method, typical in d_prime.items():
            signal = np.arange(trials) % 2 == 1
            sd = np.where(signal, signal_sd, 1.0)
            evidence = (typical + own) * (signal - 0.5) + sd * rng.standard_normal(trials)
            said = evidence > 0.0
            felt = evidence + noise * rng.standard_normal(trials)
            blocks.append(
                pd.DataFrame(
                    {
                        "participant": f"P{person:02}",
                        "method": method,
                        "expected": np.where(signal, *answers),
                        "answer": np.where(said, *answers),
                        "correct": (signal == said).astype(int),
                        "confidence": 1 + np.digitize(np.where(said, felt, -felt), (0.4, 0.8, 1.3)),
                    }
                )
            )
    rows = pd.concat(blocks, ignore_index=True)
    return rows.assign(order=rows.groupby("participant").cumcount() + 1)


def simulate_identification(
    design: TaskDesign,
    thresholds: Mapping[str, float],
    rng: np.random.Generator,
    *,
    levels: Sequence[float],
    width: float,
    alternatives: int = 2,
    lapse: float = 0.02,
    participant_sd: float = 0.0,
    interaction_sd: float = 0.0,
    scene_sd: float = 0.0,
    shape: Shape = "gauss",
) -> pd.DataFrame:
    """Return a study of right and wrong answers by ``level``.

    Parameters
    ----------
    thresholds : mapping of method to the typical participant's
    width : float
        Negative where performance falls with the level.
    participant_sd, interaction_sd, scene_sd : float
        Deviations of thresholds: of a participant, of a participant with a method, of a scene.
    """
    guess = 1.0 / alternatives
    person = participant_sd * rng.standard_normal((design.participants, 1))
    scene = scene_sd * rng.standard_normal((1, design.scenes))
    blocks = []
    for method, typical in thresholds.items():
        own = interaction_sd * rng.standard_normal((design.participants, 1))
        place = typical + person + own + scene
        for level in levels:
            rise = sigmoid(level - place, 0.0, width, shape)
            share = guess + (1.0 - guess - lapse) * rise
            right = rng.random((*share.shape, design.repeats)) < share[..., None]
            blocks.append(_labelled(_block(right, method, level=level), alternatives, rng))
    return _ordered(blocks, rng)


def simulate_abx(
    design: TaskDesign,
    critical: Mapping[str, float],
    rng: np.random.Generator,
    *,
    scalings: Sequence[float],
    gain: float = 4.0,
    critical_sd: float = 0.25,
    gain_sd: float = 0.2,
    interaction_sd: float = 0.1,
    lapse: float = 0.02,
    rule: str = "differencing",
) -> pd.DataFrame:
    """Return an ABX study by ``scaling``; deviations are of natural logarithms."""
    blocks = []
    people = (design.participants, 1)
    shared, gains = (sd * rng.standard_normal(people) for sd in (critical_sd, gain_sd))
    for method, typical in critical.items():
        own = shared + interaction_sd * rng.standard_normal(people)
        for scaling in scalings:
            d = scaling_d_prime(np.array(scaling), typical * np.exp(own), gain * np.exp(gains))
            share = (1.0 - lapse) * answer_rule(rule).share(d) + 0.5 * lapse
            chance = np.broadcast_to(share, (design.participants, design.scenes))
            right = rng.random((*chance.shape, design.repeats)) < chance[..., None]
            blocks.append(_labelled(_block(right, method, scaling=scaling), 2, rng))
    return _ordered(blocks, rng)


def _effects(
    design: TaskDesign,
    deviations: Sequence[tuple[float, float]],
    part: float,
    rng: np.random.Generator,
) -> list[Floats]:
    """Draw sums of participants' and scenes' effects that have this part of their variance."""
    root = np.sqrt(part)
    return [
        root * person * rng.standard_normal((design.participants, 1))
        + root * scene * rng.standard_normal((1, design.scenes))
        for person, scene in deviations
    ]


def _block(right: NDArray[np.bool_], method: str, **columns: float) -> pd.DataFrame:
    person, scene, _ = np.indices(right.shape)
    table = pd.DataFrame(
        {
            "participant": np.char.add("P", np.char.zfill((person.ravel() + 1).astype(str), 3)),
            "scene": np.char.add("scene-", (scene.ravel() + 1).astype(str)),
            "method": method,
            "correct": right.ravel().astype(int),
        }
    )
    return table.assign(**columns)


def _labelled(table: pd.DataFrame, alternatives: int, rng: np.random.Generator) -> pd.DataFrame:
    """Add a right answer drawn from m labels, and the one given; wrong ones are any other."""
    labels = np.array([chr(ord("A") + place) for place in range(alternatives)])
    right = rng.integers(0, alternatives, len(table))
    wrong = (right + rng.integers(1, alternatives, len(table))) % alternatives
    given = np.where(table["correct"] == 1, right, wrong)
    return table.assign(expected=labels[right], answer=labels[given])


def _ordered(blocks: Sequence[pd.DataFrame], rng: np.random.Generator) -> pd.DataFrame:
    """Shuffle each participant's trials and number them; reaction times are log-normal."""
    table = pd.concat(blocks, ignore_index=True)
    table = table.iloc[rng.permutation(len(table))]
    table = table.sort_values("participant", kind="stable").reset_index(drop=True)
    table["order"] = table.groupby("participant").cumcount() + 1
    table["rt_s"] = np.exp(rng.normal(-0.2, 0.35, len(table)))
    return table
