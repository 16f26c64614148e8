"""Recovery of thresholds and scores by adaptive trials: `script/bench adaptive`.

Simulated observers answer by the same uniform numbers whoever chooses the level: our rules, and
those of maintained packages where Python finds them: questplus (GPL) for QUEST+, SweetSpot (CC0)
for weighted up-down, psychopy (GPL) for transformed up-down, and the module `asap_cpu` of ASAP's
authors (MIT, not on PyPI, needs networkx) for active pairs. None is needed: columns of packages
that are not here stay empty.
"""

from __future__ import annotations

import argparse
import os
import random
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import spearmanr

from benchmarks.shared.estimates import of_posterior, of_reversals
from benchmarks.shared.output import conditions, file_to_write, processor, write_record
from protocols.adaptive import active_pairs, quest_plus, up_down
from protocols.adaptive.psychometric_function import probability, slope_of
from protocols.adaptive.quest_plus import Axis, Grid
from protocols.adaptive.up_down import UpDown
from protocols.disk.hashing import Chance
from protocols.revision import code_revision

Floats = NDArray[np.float64]

LEVELS = tuple(float(level) for level in np.arange(0.0, 20.25, 0.5))
THRESHOLDS = (6.13, 8.21, 10.07, 12.33, 13.9)
"""Of the observers, in turn; on no grid."""
WIDTH = 5.0
LAPSE = 0.03
OBSERVERS = 1000

QUEST_TRIALS = 40
UP_DOWN_TRIALS = 60


@dataclass(frozen=True)
class Observers:
    """Simulated observers: cumulative normals that differ in threshold, and their chance.

    Attributes
    ----------
    threshold : ndarray (observers,)
    uniform : ndarray (observers, trials)
        A trial is answered correctly where its number is below the probability.
    guess : float
    """

    threshold: Floats
    uniform: Floats
    guess: float

    def probability(self, observer: int, level: float) -> float:
        """Return the probability of a correct answer."""
        return float(
            probability(
                level,
                threshold=self.threshold[observer],
                width=WIDTH,
                guess=self.guess,
                lapse=LAPSE,
            )
        )

    def answers(self, observer: int, trial: int, level: float) -> bool:
        """Tell whether the answer is correct."""
        return bool(self.uniform[observer, trial] < self.probability(observer, level))

    def level_at(self, share: float) -> Floats:
        """Return the level at which each observer answers that share correctly."""
        rise = (share - self.guess) / (1.0 - self.guess - LAPSE)
        return np.asarray(self.threshold + ndtri(rise) / slope_of(WIDTH, "gauss"))


def observers(count: int, trials: int, guess: float, seed: int) -> Observers:
    """Return `count` observers; the first ones are the same whatever the count."""
    uniform = np.stack([np.random.default_rng((seed, k)).random(trials) for k in range(count)])
    return Observers(np.resize(THRESHOLDS, count), uniform, guess)


@dataclass(frozen=True)
class Recovery:
    """Recovery of thresholds, in widths (.05 to .95) of the psychometric function.

    `worst_bias` is the bias furthest from 0 among the five thresholds. `lost` counts observers
    without an estimate. `same_levels` is the share of trials at the package's level.
    """

    rule: str
    observers: int
    trials: int
    bias: float
    worst_bias: float
    sd: float
    lost: int
    package: str
    package_bias: float | None = None
    package_sd: float | None = None
    sd_ratio: float | None = None
    same_levels: float | None = None


@dataclass(frozen=True)
class Run:
    """Run of one rule: estimates (observers,), NaN where lost, and levels (observers, trials)."""

    estimate: Floats
    level: Floats


def recovery(rule: str, truth: Floats, ours: Run, package: str, theirs: Run | None) -> Recovery:
    """Compare estimates with the truth, and with a package's."""
    error = (ours.estimate - truth) / WIDTH
    groups = np.arange(len(truth)) % len(THRESHOLDS)
    biases = [float(np.nanmean(error[groups == group])) for group in range(len(THRESHOLDS))]
    sd = float(np.nanstd(error, ddof=1))
    found = {
        "rule": rule,
        "observers": len(truth),
        "trials": ours.level.shape[1],
        "bias": float(np.nanmean(error)),
        "worst_bias": max(biases, key=abs),
        "sd": sd,
        "lost": int(np.isnan(error).sum()),
        "package": package,
    }
    if theirs is not None:
        other = (theirs.estimate - truth) / WIDTH
        package_sd = float(np.nanstd(other, ddof=1))
        found |= {
            "package_bias": float(np.nanmean(other)),
            "package_sd": package_sd,
            "sd_ratio": sd / package_sd,
            "same_levels": float(np.mean(np.isclose(ours.level, theirs.level, atol=1e-9))),
        }
    return Recovery(**found)


def quest_grid(*, yes_no: bool) -> Grid:
    """Return the grid of the benchmark: nothing of the observers lies on it."""
    return Grid(
        levels=LEVELS,
        threshold=Axis(tuple(float(value) for value in np.linspace(2.0, 18.0, 41))),
        width=Axis((2.0, 3.5, 5.5, 8.0, 12.0)),
        guess=Axis((0.02, 0.08, 0.15, 0.25)) if yes_no else Axis((0.5,)),
        lapse=Axis((0.0, 0.02, 0.05)),
    )


def run_quest(people: Observers, grid: Grid) -> Run:
    """Run our QUEST+ and return posterior means of the threshold."""
    found, shown = [], []
    for observer in range(len(people.threshold)):
        history: list[tuple[float, bool]] = []
        for trial in range(people.uniform.shape[1]):
            level = quest_plus.next_level(history, grid)
            history.append((level, people.answers(observer, trial, level)))
        found.append(of_posterior(history, grid).threshold.mean)
        shown.append([level for level, _ in history])
    return Run(np.array(found), np.array(shown))


def questplus_staircase(grid: Grid) -> Any:
    """Return a staircase of the package questplus on our grid."""
    return import_module("questplus").QuestPlus(
        stim_domain={"intensity": np.array(grid.levels)},
        param_domain={
            "lower_asymptote": np.array(grid.guess.values),
            "mean": np.array(grid.threshold.values),
            "sd": np.array(grid.width.values) / float(slope_of(1.0, "gauss")),
            "lapse_rate": np.array(grid.lapse.values),
        },
        outcome_domain={"response": ["correct", "wrong"]},
        func="norm_cdf",
        stim_scale="linear",
        stim_selection_method="min_entropy",
        param_estimation_method="mean",
    )


def run_questplus(people: Observers, grid: Grid) -> Run | None:
    """Run the package questplus, if it is here."""
    if find_spec("questplus") is None:
        return None
    staircase = questplus_staircase(grid)
    found, shown = [], []
    for observer in range(len(people.threshold)):
        staircase.posterior = staircase.prior.copy()
        levels = []
        for trial in range(people.uniform.shape[1]):
            stimulus = staircase.next_stim
            levels.append(stimulus["intensity"])
            correct = people.answers(observer, trial, levels[-1])
            staircase.update(stim=stimulus, outcome={"response": "correct" if correct else "wrong"})
        found.append(staircase.param_estimate["mean"])
        shown.append(levels)
    return Run(np.array(found), np.array(shown))


def run_up_down(people: Observers, settings: UpDown) -> Run:
    """Run our up-down track and return the mean level of its reversals."""
    found, shown = [], []
    for observer in range(len(people.threshold)):
        history: list[tuple[float, bool]] = []
        for trial in range(people.uniform.shape[1]):
            level = up_down.next_level(history, settings)
            history.append((level, people.answers(observer, trial, level)))
        level_found = of_reversals(history, settings).level
        found.append(np.nan if level_found is None else level_found)
        shown.append([level for level, _ in history])
    return Run(np.array(found), np.array(shown))


def run_sweetspot(people: Observers, settings: UpDown) -> Run | None:
    """Run SweetSpot's weighted up-down, if it is here; the same mean over its reversals."""
    if find_spec("SweetSpot") is None:
        return None
    make = import_module("SweetSpot.AdaptiveProcedures").WUD
    found, shown = [], []
    for observer in range(len(people.threshold)):
        track = make(
            start=settings.start,
            hitEffect=-settings.harder[0],
            target=up_down.performance(settings),
            reversals=10**6,
        )
        track.min, track.max = settings.levels[0], settings.levels[-1]
        levels = []
        for trial in range(people.uniform.shape[1]):
            levels.append(track.PendingValue())
            track.Observe(int(people.answers(observer, trial, levels[-1])))
        turns = [levels[trial] for trial in track.Reversals()]
        found.append(mean_of_reversals(turns, len(settings.harder)))
        shown.append(levels)
    return Run(np.array(found), np.array(shown))


def psychopy_staircase(settings: UpDown) -> Any:
    """Return a staircase of psychopy with our settings; it takes steps of one size both ways."""
    return import_module("psychopy.data.staircase").StairHandler(
        startVal=settings.start,
        stepSizes=list(settings.harder),
        stepType="lin",
        nUp=1,
        nDown=settings.in_a_row,
        applyInitialRule=settings.one_at_first,
        minVal=settings.levels[0],
        maxVal=settings.levels[-1],
        nTrials=10**6,
        autoLog=False,
    )


def run_psychopy(people: Observers, settings: UpDown) -> Run | None:
    """Run psychopy's transformed up-down, if it is here; the same mean over its reversals."""
    if find_spec("psychopy") is None:
        return None
    found, shown = [], []
    for observer in range(len(people.threshold)):
        track = psychopy_staircase(settings)
        for trial in range(people.uniform.shape[1]):
            track.addResponse(int(people.answers(observer, trial, next(track))))
        turns = list(track.reversalIntensities)
        found.append(mean_of_reversals(turns, len(settings.harder)))
        shown.append(track.intensities)
    return Run(np.array(found), np.array(shown))


def mean_of_reversals(turns: list[float], skipped: int) -> float:
    """Return the mean of an even number of the last reversals; NaN without any."""
    used = max(0, len(turns) - skipped) // 2 * 2
    return float(np.mean(turns[-used:])) if used else float("nan")


def up_down_rules() -> dict[str, UpDown]:
    """Return the tracks of the benchmark; 17 is easy for every observer."""
    return {
        "weighted .75": UpDown.weighted(LEVELS, start=17.0, target=0.75, harder=(1.0,)),
        "weighted .75, fine": UpDown.weighted(LEVELS, start=17.0, target=0.75, harder=(1.0, 0.5)),
        "2 in a row": UpDown.transformed(LEVELS, start=17.0, in_a_row=2, steps=(2.0, 1.0)),
        "3 in a row": UpDown.transformed(LEVELS, start=17.0, in_a_row=3, steps=(2.0, 1.0)),
    }


def recoveries(count: int) -> list[Recovery]:
    """Run every rule with `count` observers."""
    rows = []
    for name, yes_no in (("QUEST+, two alternatives", False), ("QUEST+, yes-no", True)):
        people = observers(count, QUEST_TRIALS, 0.1 if yes_no else 0.5, seed=21)
        grid = quest_grid(yes_no=yes_no)
        theirs = run_questplus(people, grid)
        rows.append(recovery(name, people.threshold, run_quest(people, grid), "questplus", theirs))
    people = observers(count, UP_DOWN_TRIALS, 0.5, seed=22)
    for name, settings in up_down_rules().items():
        truth = people.level_at(up_down.performance(settings))
        ours = run_up_down(people, settings)
        if settings.in_a_row > 1:
            package, other = "psychopy", run_psychopy(people, settings)
        elif len(settings.harder) == 1:
            package, other = "SweetSpot", run_sweetspot(people, settings)
        else:
            package, other = "none has it", None
        rows.append(recovery(f"up-down, {name}", truth, ours, package, other))
    return rows


@dataclass(frozen=True)
class PairRecovery:
    """Recovery of scores after 5, 10 and 15 batches of n - 1 comparisons.

    Root mean square error in JOD and rank correlation, both of the posterior mean under the
    prior that the scores were drawn with, whoever chose the pairs. `most` is how often the busiest
    condition came in one batch, after the first.
    """

    chosen_by: str
    conditions: int
    range_jod: float
    studies: int
    rmse_5: float
    rmse_10: float
    rmse_15: float
    rank_5: float
    rank_10: float
    rank_15: float
    most: int


Chooser = Callable[[NDArray[np.int64], int], list[tuple[int, int]]]


def pair_recoveries(studies: int) -> list[PairRecovery]:
    """Choose pairs by expected gain, at random, and by ASAP where it is here."""
    rows = []
    conditions = 10
    for range_jod in (3.0, 8.0):
        makers: dict[str, Callable[[int], Chooser]] = {
            "ours": _choose_active,
            "chance": lambda seed: _choose_random(seed, conditions),
        }
        if find_spec("asap_cpu") is not None:
            makers["ASAP"] = lambda seed: _choose_asap(seed, conditions)
        for name, make in makers.items():
            found = [
                _pair_study(make(study), study, conditions, range_jod) for study in range(studies)
            ]
            errors = [float(value) for value in np.mean([one[0] for one in found], axis=0)]
            ranks = [float(value) for value in np.mean([one[1] for one in found], axis=0)]
            most = max(one[2] for one in found)
            rows.append(
                PairRecovery(
                    name,
                    conditions,
                    range_jod,
                    studies,
                    rmse_5=errors[0],
                    rmse_10=errors[1],
                    rmse_15=errors[2],
                    rank_5=ranks[0],
                    rank_10=ranks[1],
                    rank_15=ranks[2],
                    most=most,
                )
            )
    return rows


def _pair_study(
    choose: Chooser, seed: int, conditions: int, range_jod: float
) -> tuple[list[float], list[float], int]:
    rng = np.random.default_rng((23, seed))
    truth = rng.uniform(0.0, range_jod, conditions)
    truth -= truth.mean()
    # The k-th comparison of a pair meets the same number, whoever asks for it and when.
    uniform = rng.random((conditions, conditions, 15 * conditions))
    wins = np.zeros((conditions, conditions), dtype=np.int64)
    rmse, rank, most = [], [], 0
    for batch in range(15):
        pairs = choose(wins, batch)
        if batch:
            most = max(most, int(np.bincount(np.ravel(pairs)).max()))
        for i, j in pairs:
            share = ndtr((truth[i] - truth[j]) / active_pairs.JOD_SIGMA)
            first = uniform[i, j, wins[i, j] + wins[j, i]] < share
            wins[(i, j) if first else (j, i)] += 1
        if batch in (4, 9, 14):
            mean = active_pairs.posterior(wins, prior_sd_jod=range_jod / np.sqrt(12.0)).mean
            rmse.append(float(np.sqrt(np.mean((mean - truth) ** 2))))
            rank.append(float(spearmanr(mean, truth).statistic))
    return rmse, rank, most


def _choose_active(seed: int) -> Chooser:
    return lambda wins, batch: list(active_pairs.next_batch(wins, Chance(seed, batch)))


def _choose_random(seed: int, conditions: int) -> Chooser:
    pairs = np.transpose(np.triu_indices(conditions, k=1))

    def choose(wins: NDArray[np.int64], batch: int) -> list[tuple[int, int]]:  # noqa: ARG001
        rng = np.random.default_rng((24, seed, batch))
        return [(int(i), int(j)) for i, j in rng.permutation(pairs)[: conditions - 1]]

    return choose


def _choose_asap(seed: int, conditions: int) -> Chooser:
    networkx: Any = import_module("networkx")
    if not hasattr(networkx, "from_numpy_matrix"):  # it went in networkx 3
        networkx.from_numpy_matrix = networkx.from_numpy_array
    asap = import_module("asap_cpu").ASAP(conditions)
    random.seed(seed)

    def choose(wins: NDArray[np.int64], batch: int) -> list[tuple[int, int]]:  # noqa: ARG001
        return [(int(min(pair)), int(max(pair))) for pair in asap.run_asap(wins.copy())]

    return choose


def _print(rows: list[Any]) -> None:
    tables = [
        {
            key: "-"
            if value is None
            else f"{value:.3f}"
            if isinstance(value, float)
            else str(value)
            for key, value in asdict(row).items()
        }
        for row in rows
    ]
    widths = {key: max(len(key), *(len(row[key]) for row in tables)) for key in tables[0]}
    print()
    for row in [{key: key for key in widths}, *tables]:
        print("  ".join(text.ljust(widths[key]) for key, text in row.items()).rstrip())


def main(argv: list[str]) -> int:
    """Print tables; with ``--json FILE`` also write them."""
    parser = argparse.ArgumentParser(prog="benchmarks.adaptive", description=__doc__)
    parser.add_argument("--json", type=file_to_write, help="file to write the numbers to")
    parser.add_argument("--quick", action="store_true", help="a tenth of the simulations")
    arguments = parser.parse_args(argv)
    share = 10 if arguments.quick else 1
    print(f"{processor()}, {os.cpu_count()} cores, revision {code_revision()}")
    tables: dict[str, list[Any]] = {
        "recovery": recoveries(OBSERVERS // share),
        "pairs": pair_recoveries(30 // share),
    }
    for rows in tables.values():
        _print(rows)
    if arguments.json:
        result = {
            **conditions("numpy", "scipy", "questplus", "SweetSpot", "psychopy"),
            "width": WIDTH,
            "lapse": LAPSE,
            **{name: [asdict(row) for row in rows] for name, rows in tables.items()},
        }
        write_record(arguments.json, result)
    return 0
