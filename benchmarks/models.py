"""Error rates of the mixed models and of unbalanced designs: `python -m benchmarks.models`.

No condition has an effect on the typical participant and scene, but conditions differ by scene.
Each table counts p below .05 (of the likelihood ratio, where the report prints it first) and 95 %
limits that hold the truth. Cells take turns, ``ROUND`` studies each, so that ``--minutes`` leave
all with as many. A file keeps the models left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from analysis.models.bootstrap import bootstrap_scale
from analysis.models.cells import checked, grid
from analysis.models.clustered import two_way
from analysis.models.critical_scaling import (
    CriticalModel,
    critical_misfits,
    critical_scalings,
)
from analysis.models.curves.critical_likelihood import scaling_d_prime
from analysis.models.curves.goodness_of_fit import misfits
from analysis.models.curves.response import CurveForm
from analysis.models.detection import yes_no
from analysis.models.logistic import glmm_logit
from analysis.models.mixed.reaction_model import time_model
from analysis.models.ordinal import paired_ratings, rating_model
from analysis.models.right_answers import rate_contrasts, share_interactions
from analysis.models.thresholds import fit_thresholds
from benchmarks.shared.output import file_to_write, write_record
from protocols.adaptive.psychometric_function import sigmoid
from protocols.answer_rules import answer_rule
from protocols.revision import code_revision

Floats = NDArray[np.float64]
Outcome = tuple[float, bool | None] | None
"""p, and whether limits hold the truth (None: the test has none); None where there is no result."""

ROUND = 5


@dataclass(frozen=True)
class Design:
    """A study: its size, and the deviations of people and of scenes, in all and in one condition.

    The unit of deviations is the model's: of levels, of ln s, of the noise of one rating, logits.
    `lapse` is the least rate of lapses, `lapse_more` the mean of what people add to it. So many
    `first_people` saw the first condition alone, the others the second; so of scenes.
    """

    people: int = 10
    scenes: int = 1
    repeats: int = 6
    person: tuple[float, float] = (0.6, 0.3)
    scene: tuple[float, float] = (0.0, 0.0)
    conditions: int = 2
    levels: tuple[float, ...] = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
    width: float = 3.0
    guess: float = 0.5
    lapse: float = 0.02
    lapse_more: float = 0.0
    first_people: int | None = None
    first_scenes: int | None = None


@dataclass(frozen=True)
class Cell:
    """Rates over studies of one design; `without` counts studies without a result."""

    model: str
    name: str
    studies: int
    false_positives: float | None
    coverage: float | None
    without: int
    cpu_s: float
    design: Design = field(repr=False)


THRESHOLDS = {
    "10 people x 7 levels x 6": Design(),
    "20 repeats": Design(repeats=20),
    "40 people, 2 repeats": Design(people=40, repeats=2),
    "curves steeper than people differ": Design(width=1.0, person=(0.8, 0.4)),
    "steeper yet": Design(width=0.6, person=(1.0, 0.5)),
    "3 levels": Design(levels=(-2.0, 0.0, 2.0), repeats=10),
    "people's lapses differ": Design(people=20, repeats=8, lapse_more=0.06),
    "4 alternatives": Design(guess=0.25),
    "yes-no": Design(guess=0.0),
    "3 conditions, 12 people": Design(people=12, repeats=8, conditions=3),
    "6 scenes": Design(scenes=6, repeats=1, scene=(0.4, 0.0)),
    "6 scenes, x condition": Design(scenes=6, repeats=1, scene=(0.4, 0.3)),
}

FITTING = ("10 people x 7 levels x 6", "20 repeats", "people's lapses differ", "4 alternatives")
"""Studies of thresholds, by name, of which goodness of fit is judged."""

_SCALINGS = tuple(np.log([0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0]).tolist())
CRITICAL = {
    "10 people x 8 scalings x 18": Design(
        repeats=18, person=(0.3, 0.15), levels=_SCALINGS, lapse=0.02
    ),
    "10 people x 8 scalings x 7 scenes x 2": Design(
        scenes=7, repeats=2, person=(0.3, 0.15), scene=(0.1, 0.1), levels=_SCALINGS
    ),
}
"""Studies of scalings, whose logarithms are the levels; deviations are of ln s_c."""

SIZES = {"11x6x2": (11, 6, 2), "6x3x2": (6, 3, 2), "30x20x1": (30, 20, 1)}


def _alike(people: int, scenes: int, repeats: int, *, first_scenes: int | None = None) -> Design:
    """Return a study whose conditions differ by person and by scene."""
    spread = (0.6, 0.3), (0.3, 0.25)
    return Design(people, scenes, repeats, *spread, first_scenes=first_scenes)


APART = {
    **{
        f"{first} people against {more}, 6 scenes x 4": Design(
            first + more, 6, 4, (0.6, 0.3), (0.3, 0.0), first_people=first
        )
        for first, more in ((10, 10), (4, 16), (3, 12), (2, 10))
    },
    "11 people, 6 scenes against 6": _alike(11, 12, 4, first_scenes=6),
    "20 people, 4 scenes against 16": _alike(20, 20, 2, first_scenes=4),
}
"""Studies whose people, or scenes, are of one condition each."""

COMPARED = {
    **{size: _alike(*of) for size, of in SIZES.items()},
    "40x6x1": _alike(40, 6, 1),
    "12x5x2": _alike(12, 5, 2),
    **APART,
}
"""Studies whose two conditions are compared; deviations are logits, and of d'."""


def _crossed(design: Design, rng: np.random.Generator, *more: int) -> tuple[pd.DataFrame, Floats]:
    """Return the trials of a study, and what people and scenes add to each."""
    counts = (design.people, design.scenes, design.conditions, design.repeats, *more)
    axes = np.meshgrid(*(np.arange(count) for count in counts), indexing="ij")
    person, scene, condition, *_ = places = [axis.ravel() for axis in axes]
    shift = np.zeros(person.size)
    for code, (all_of_it, own) in ((person, design.person), (scene, design.scene)):
        count = int(code.max()) + 1
        shift += rng.normal(0.0, all_of_it, count)[code]
        shift += rng.normal(0.0, own, (count, design.conditions))[code, condition]
    table = pd.DataFrame(
        {"participant": person.astype(str), "method": np.array(list("abc"))[condition]}
    )
    if design.scenes > 1:
        table["scene"] = scene.astype(str)
    return table.assign(last=places[-1]), shift


def _answered(design: Design, rng: np.random.Generator) -> pd.DataFrame:
    """Simulate a study of thresholds, all 0."""
    table, shift = _crossed(design, rng, len(design.levels))
    more = rng.exponential(design.lapse_more, design.people) if design.lapse_more else 0.0
    lapses = np.broadcast_to(np.minimum(design.lapse + more, 0.4), design.people)
    person = table["participant"].astype(int).to_numpy()
    lapse = lapses[person]
    level = np.array(design.levels)[table["last"]]
    rise = sigmoid(level - shift, 0.0, design.width, "gauss")
    right = rng.random(level.size) < design.guess + (1.0 - design.guess - lapse) * rise
    return table.assign(level=level, correct=right.astype(int))


def thresholds(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate and judge a study of thresholds."""
    table = _answered(design, rng)
    model = fit_thresholds(
        table[_one_sided(table, design)], "level", ("method",), CurveForm(design.guess),
        scenes=design.scenes > 1,
    )  # fmt: skip
    one = model.thresholds[0]
    if one.lower is None or one.upper is None or not model.contrasts:
        return None
    return model.contrasts[0].p, one.lower <= 0.0 <= one.upper


def goodness(design: Design, rng: np.random.Generator) -> list[Outcome]:
    """Simulate a study that the model fits; judge its deviance and its residuals by level."""
    table = _answered(design, rng)
    model = fit_thresholds(table, "level", ("method",), CurveForm(design.guess))
    found, _ = misfits(table, "level", table["method"], model.population, rng)
    deviance, by_level = zip(
        *((one.p_adjusted, one.level_p_adjusted) for one in found), strict=True
    )
    return [(min(deviance), None), (min(by_level), None)]


def _critical(design: Design, rng: np.random.Generator) -> tuple[pd.DataFrame, CriticalModel]:
    """Simulate and fit an ABX study of scalings, with s_c of .2 and a gain of 4."""
    table, shift = _crossed(design, rng, len(design.levels))
    gain = 4.0 * np.exp(rng.normal(0.0, 0.2, design.people))
    scaling = np.exp(np.array(design.levels)[table["last"]])
    d_prime = scaling_d_prime(
        scaling, 0.2 * np.exp(shift), gain[table["participant"].astype(int).to_numpy()]
    )
    lapsed = rng.random(shift.size) < design.lapse
    share = np.where(lapsed, 0.5, answer_rule("differencing").share(d_prime))
    table = table.assign(scaling=scaling, correct=(rng.random(shift.size) < share).astype(int))
    return table, critical_scalings(table, ("method",))


def critical(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate and judge the difference of ln s_c."""
    model = _critical(design, rng)[1]
    if not model.contrasts:
        return None
    one = model.contrasts[0]
    return one.p, one.lower <= 0.0 <= one.upper


def critical_goodness(design: Design, rng: np.random.Generator) -> list[Outcome]:
    """Simulate a study of scalings that the model fits; judge deviance and residuals by level."""
    found, _ = critical_misfits(_critical(design, rng)[1], rng)
    return [
        (min(one.p_adjusted for one in found), None),
        (min(one.level_p_adjusted for one in found), None),
    ]


def times(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate and judge a study of reaction times."""
    table, shift = _crossed(design, rng)
    table["rt_s"] = np.exp(shift + rng.normal(0.0, 0.35, shift.size))
    one = time_model(table[_one_sided(table, design)], ("method",)).ratios[0]
    return one.p, one.lower <= 1.0 <= one.upper


def ratings(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate and judge a study of ratings."""
    table, shift = _crossed(design, rng)
    latent = shift + rng.standard_normal(shift.size)
    table["rating"] = np.digitize(latent, [-1.2, -0.4, 0.4, 1.2])
    one = rating_model(table[_one_sided(table, design)], ("method",)).contrasts[0]
    return None if np.isnan(one.p) else (one.p, one.lower <= 0.0 <= one.upper)


def graded(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate and judge a study of graded pairs of two methods."""
    table, shift = _crossed(replace(design, conditions=1), rng)
    other = _crossed(replace(design, conditions=1), rng)[1]
    latent = shift - other + rng.standard_normal(shift.size)
    table["rating"] = np.digitize(latent, [-1.0, -0.3, 0.3, 1.0]) - 2
    turned = rng.random(shift.size) < 0.5
    table["first"], table["second"] = np.where(turned, ["b"], ["a"]), np.where(turned, "a", "b")
    table["rating"] = np.where(turned, -table["rating"], table["rating"])
    one = paired_ratings(table).contrasts[0]
    return None if np.isnan(one.p) else (one.p, one.lower <= 0.0 <= one.upper)


def _one_sided(table: pd.DataFrame, design: Design) -> pd.Series:
    """Return which trials remain where people, or scenes, are of one condition each."""
    kept = pd.Series(True, index=table.index)
    for name, first in (("participant", design.first_people), ("scene", design.first_scenes)):
        if first is not None:
            kept &= (table[name].astype(int) < first) == (table["method"] == "a")
    return kept


def right_shares(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate a study of right answers, and judge the difference of two shares."""
    table, shift = _crossed(design, rng)
    table["correct"] = (rng.random(shift.size) < expit(0.8 + shift)).astype(int)
    (one,) = rate_contrasts(table[_one_sided(table, design)], ("method",))
    return one.p, one.lower <= 0.0 <= one.upper


def d_primes(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate a yes-no study, d' 1.5, and judge the difference of d'; people set criteria."""
    table, shift = _crossed(design, rng, 2)
    signal = table["last"] == 1
    criterion = rng.normal(0.0, 0.4, design.people)[table["participant"].astype(int)]
    said = signal * (1.5 + shift) - 0.75 - criterion + rng.standard_normal(shift.size) > 0.0
    table["expected"] = np.where(signal, "yes", "no")
    table["answer"] = np.where(said, "yes", "no")
    (one,) = yes_no(table[_one_sided(table, design)], ("method",), signal="yes").d_prime_contrasts
    return one.p, one.lower <= 0.0 <= one.upper


def choices(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate and judge a study of choices by the mixed model of its one comparison."""
    table, shift = _crossed(replace(design, conditions=1), rng)
    table["shown_first"] = rng.choice([-0.5, 0.5], shift.size)
    table["preferred"] = (rng.random(shift.size) < expit(shift)).astype(int)
    groups = ("participant", "scene")
    one = glmm_logit(
        "preferred ~ 1 + shown_first", table, groups=groups, between=True
    ).coefficients[0]
    return one.p, one.lower <= 0.0 <= one.upper


def scales(design: Design, rng: np.random.Generator) -> Outcome:
    """Simulate three equal methods, and judge one difference in JOD."""
    person = rng.normal(0.0, design.person[1], (design.people, 1, 3))
    taste = person + rng.normal(0.0, design.scene[1], (1, design.scenes, 3))
    wins = np.zeros((design.people, design.scenes, 3, 3))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        won = rng.binomial(design.repeats, ndtr(taste[..., i] - taste[..., j]))
        wins[..., i, j], wins[..., j, i] = won, design.repeats - won
    found = bootstrap_scale(wins, rng=rng)
    lower, upper = found.difference_lower[0, 1], found.difference_upper[0, 1]
    return float(found.difference_p[0, 1]), bool(lower <= 0.0 <= upper)


def interaction(apart: bool) -> Callable[..., Outcome]:
    """Return what simulates and judges whether a preference differs between two sizes.

    `apart`: each scene is shown at one size; else at both.
    """

    def judged(design: Design, rng: np.random.Generator) -> Outcome:
        table, shift = _crossed(design, rng)
        large = table["method"] == "b"
        if apart:
            kept = large == (table["scene"].astype(int) % 2 == 0)
            table, shift, large = table[kept], shift[kept], large[kept]
        preferred = rng.random(shift.size) < expit(0.5 + shift)
        rows = checked(table.assign(preferred=preferred.astype(int)), ())
        at = rows["method"].map({"a": "small", "b": "large"})
        moved = {size: {"ours": rows.loc[at == size, "preferred"]} for size in ("small", "large")}
        (one,) = share_interactions(moved, grid(rows), "share", 0.95)
        return one.p, one.lower <= 0.0 <= one.upper

    return judged


def share(seen: Callable[[np.random.Generator], Floats]) -> Callable[..., Outcome]:
    """Return what simulates and judges a share of cells (participants, scenes) so often seen."""

    def judged(design: Design, rng: np.random.Generator) -> Outcome:
        shown = seen(rng)
        people, scenes = shown.shape
        logit = rng.normal(0.0, design.person[0], (people, 1))
        logit = logit + rng.normal(0.0, design.scene[0], (1, scenes))
        found = two_way(rng.binomial(shown.astype(int), expit(logit)).astype(float), shown)
        lower, upper = found.limits()
        return float(found.p_value()), bool(lower <= 0.5 <= upper)

    return judged


def _often(people: int, scenes: int, repeats: int, first: int) -> Callable[..., Floats]:
    """Return how often each scene is seen: the first so many times as often as the others."""
    weights = np.full((people, scenes), float(repeats))
    weights[:, 0] *= first
    return lambda _rng: weights.copy()


def _some(people: int, scenes: int, of_them: int, repeats: int) -> Callable[..., Floats]:
    """Return how often each scene is seen where each person sees some of them."""

    def seen(rng: np.random.Generator) -> Floats:
        order = rng.permuted(np.tile(np.arange(scenes), (people, 1)), axis=1)
        return np.where(order < of_them, float(repeats), 0.0)

    return seen


UNBALANCED = {
    "11x6, one scene ten times": _often(11, 6, 1, 10),
    "20x12, one scene ten times": _often(20, 12, 1, 10),
    "30 people see 2 of 20": _some(30, 20, 2, 4),
    "60 people see 2 of 20": _some(60, 20, 2, 2),
    **{f"{people}x{count}x2": _often(people, count, 2, 1)
       for people in (40, 200) for count in (2, 3)},
}  # fmt: skip


def cells() -> list[tuple[str, str, Design, Callable[..., Outcome]]]:
    """Return model, name and design of each cell, and what judges a study of it."""
    found: list[tuple[str, str, Design, Callable[..., Outcome]]] = []
    for name, seen in UNBALANCED.items():
        for own in (0.43, 1.0):
            design = Design(person=(0.63, 0.0), scene=(own, 0.0))
            found.append(("share", f"{name}, scenes {own:g}", design, share(seen)))
    found += [("thresholds", name, design, thresholds) for name, design in THRESHOLDS.items()]
    for judge in (right_shares, d_primes):
        for name, design in COMPARED.items():
            found.append((judge.__name__, name, design, judge))
    for first, more in ((10, 10), (4, 16)):
        design = Design(first + more, first_people=first)
        name = f"{first} people against {more}"
        found.append(("thresholds of groups", name, design, thresholds))
    found += [("critical", name, design, critical) for name, design in CRITICAL.items()]
    models: tuple[tuple[Callable[..., Outcome], tuple[float, float], tuple[float, ...]], ...] = (
        (times, (0.3, 0.1), (0.1, 0.2)),
        (ratings, (0.5, 0.3), (0.25, 0.5)),
        (graded, (0.4, 0.0), (0.25, 0.5)),
    )
    for size, (people, scenes, repeats) in SIZES.items():
        for judge, person, deviations in models:
            for own in deviations:
                scene = (own, 0.0) if judge is graded else (0.3, own)
                design = Design(people, scenes, repeats, person, scene)
                found.append((judge.__name__, f"{size}, scene x condition {own:g}", design, judge))
    for judge in (times, ratings):
        for name, design in APART.items():
            found.append((judge.__name__, name, design, judge))
    for size, (people, scenes, repeats) in SIZES.items():
        for own in (0.43, 1.0):
            design = Design(people, scenes, repeats, (0.63, 0.0), (own, 0.0))
            found.append(("choices", f"{size}, scenes {own:g}", design, choices))
        for own in (0.0, 0.3):
            design = Design(people, scenes, repeats, (0.0, 0.4), (0.0, own))
            found.append(("scales", f"{size}, scene x method {own:g}, difference", design, scales))
        design = Design(people, scenes, repeats, (0.6, 0.3), (0.4, 0.3))
        for apart in (False, True):
            told = f"{size}, each scene at {'one size' if apart else 'both sizes'}"
            found.append(("interaction", told, design, interaction(apart)))
    return found


def cells_of_one_study() -> list[
    tuple[list[tuple[str, str]], Design, Callable[..., list[Outcome]]]
]:
    """Return the cells, as models and names, that one judge asks of the same studies."""
    found: list[tuple[list[tuple[str, str]], Design, Callable[..., list[Outcome]]]] = []
    for model, name, design, judge in cells():
        found.append(([(model, name)], design, lambda *at, asked=judge: [asked(*at)]))
    fitting: list[tuple[str, Design, Callable[..., list[Outcome]]]] = [
        *((name, THRESHOLDS[name], goodness) for name in FITTING),
        *((f"scalings, {name}", design, critical_goodness) for name, design in CRITICAL.items()),
    ]
    for name, design, several in fitting:
        named = [("goodness", f"{name}, {told}") for told in ("deviance", "by level")]
        found.append((named, design, several))
    return found


@dataclass
class _Running:
    """Cells whose studies are being simulated."""

    named: list[tuple[str, str]]
    design: Design
    judge: Callable[..., list[Outcome]]
    rng: np.random.Generator
    outcomes: list[list[Outcome]] = field(default_factory=list)
    cpu_s: float = 0.0

    def go_on(self, studies: int) -> None:
        """Simulate so many more."""
        began = time.process_time()
        self.outcomes += [self.judge(self.design, self.rng) for _ in range(studies)]
        self.cpu_s += time.process_time() - began

    def cells(self) -> list[Cell]:
        """Return the rates so far."""
        found = []
        for (model, name), outcomes in zip(
            self.named, zip(*self.outcomes, strict=True), strict=True
        ):
            known = [one for one in outcomes if one is not None]
            held = [one[1] for one in known if one[1] is not None]
            found.append(
                Cell(
                    model,
                    name,
                    len(outcomes),
                    float(np.mean([p < 0.05 for p, _ in known])) if known else None,
                    float(np.mean(held)) if held else None,
                    len(outcomes) - len(known),
                    self.cpu_s / len(outcomes),
                    self.design,
                )
            )
        return found


def _write(path: Path, kept: Sequence[object], running: Sequence[_Running]) -> None:
    rows = [row for one in running for row in one.cells()]
    told = [vars(row) | {"design": vars(row.design)} for row in rows]
    write_record(path, {"cells": [*kept, *({"revision": code_revision()} | one for one in told)]})


def main(argv: list[str]) -> int:
    """Print rates; with ``--json FILE`` also write them."""
    parser = argparse.ArgumentParser(prog="benchmarks.models", description=__doc__)
    parser.add_argument("--json", type=file_to_write, help="file to write the numbers to")
    parser.add_argument("--studies", type=int, default=500, help="simulated in each cell")
    parser.add_argument("--minutes", type=float, help="to end after, with what was simulated")
    parser.add_argument("--only", metavar="MODEL,...", help="such as thresholds,times")
    arguments = parser.parse_args(argv)
    every = [
        _Running(named, design, judge, np.random.default_rng(number))
        for number, (named, design, judge) in enumerate(cells_of_one_study())
    ]
    models = {model for one in every for model, _ in one.named}
    asked = models & set(arguments.only.split(",")) if arguments.only else models
    running = [one for one in every if asked & {model for model, _ in one.named}]
    asked = {model for one in running for model, _ in one.named}
    end = np.inf if arguments.minutes is None else time.monotonic() + 60.0 * arguments.minutes
    kept = []
    if arguments.json and arguments.json.is_file():
        kept = json.loads(arguments.json.read_text(encoding="utf-8"))["cells"]
        kept = [one for one in kept if one["model"] not in asked]
    for done, one in product(range(0, arguments.studies, ROUND), running):
        if time.monotonic() > end:
            break
        # Shares take no time.
        one.go_on(min(ROUND, arguments.studies - done) * (40 if one.named[0][0] == "share" else 1))
        if arguments.json and one is running[-1]:
            _write(arguments.json, kept, running)
    if arguments.json:
        _write(arguments.json, kept, running)
    for row in (row for one in running for row in one.cells()):
        rates = [
            f"{name} {'-' if rate is None else f'{rate:.3f}'}"
            for name, rate in (("p<.05", row.false_positives), ("held", row.coverage))
        ]
        print(f"{row.model:14} {row.name:44} {row.studies:6} {' '.join(rates)}"
              f" without {row.without} {row.cpu_s:.2f} s")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
