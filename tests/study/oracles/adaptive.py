"""Make adaptive.json: what maintained packages did with the answers of simulated observers.

It needs questplus, psychopy (both GPL, so not among ours), SweetSpot (CC0), and on the path the
module `asap_cpu` of https://github.com/gfxdisp/asap (MIT) with networkx.

Run from the repository:

    PYTHONPATH=.:tests/helpers:FOLDER_OF_ASAP python tests/study/oracles/adaptive.py
"""

import json
import random
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import numpy as np
from adaptive_recovery import THRESHOLDS, Observers
from up_down_rules import performance, transformed, weighted

from protocols.adaptive.psychometric_function import slope_of
from protocols.adaptive.quest_plus import Axis, Grid
from protocols.adaptive.up_down import UpDown

AXES = {"guess": "lower_asymptote", "threshold": "mean", "width": "sd", "lapse": "lapse_rate"}
LEVELS = tuple(float(level) for level in np.arange(0.0, 20.25, 0.5))


def even(low: float, high: float, count: int) -> Axis:
    """Return an axis with a flat prior."""
    return Axis(tuple(round(float(value), 6) for value in np.linspace(low, high, count)))


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


def quest_case(name: str, grid: Grid, guess: float, seed: int) -> dict[str, object]:
    """Record 40 trials of questplus: levels, entropies expected, marginals at the end."""
    rng = np.random.default_rng((31, seed))
    people = Observers(np.array([THRESHOLDS[seed]]), rng.random((1, 40)), guess)
    staircase = questplus_staircase(grid)
    history, entropy = [], []
    for trial in range(40):
        stimulus = staircase.next_stim
        level = stimulus["intensity"]
        correct = people.answers(0, trial, level)
        history.append([level, correct])
        entropy.append(staircase.entropy)
        answer = "correct" if correct else "wrong"
        staircase.update(stim=stimulus, outcome={"response": answer})
    marginals = {
        ours: staircase.marginal_posterior[theirs].tolist() for ours, theirs in AXES.items()
    }
    axes = {ours: getattr(grid, ours).values for ours in AXES}
    return {
        "name": name,
        "levels": grid.levels,
        **axes,
        "history": history,
        "entropy_nats": entropy,
        "marginals": marginals,
    }


def quest_cases() -> list[dict[str, object]]:
    """Two alternatives, four alternatives and yes-no; even and uneven levels."""
    two = Grid(LEVELS, even(2, 18, 33), Axis((2.0, 3.5, 5.5, 8.0, 12.0)), Axis((0.5,)))
    four = Grid(
        tuple(float(level) for level in np.geomspace(1.0, 20.0, 17)),
        even(3, 18, 31),
        Axis((3.0, 6.0, 9.0)),
        Axis((0.25,)),
        Axis((0.01, 0.03, 0.06)),
    )
    yes_no = Grid(
        LEVELS, even(2, 18, 25), Axis((2.5, 5.0, 10.0)), Axis((0.02, 0.1, 0.2)), Axis((0.01, 0.04))
    )
    return [
        quest_case("two alternatives", two, 0.5, 0),
        quest_case("four alternatives, uneven levels", four, 0.25, 1),
        quest_case("yes-no", yes_no, 0.1, 2),
    ]


def track_cases() -> list[dict[str, object]]:
    """Record 60 trials of SweetSpot's weighted, and of psychopy's transformed up-down."""
    rules = {
        "SweetSpot, .75": weighted(LEVELS, start=15.0, target=0.75, harder=(0.5,)),
        "SweetSpot, .5": weighted(LEVELS, start=9.5, target=0.5, harder=(1.0,)),
        "psychopy, 2 in a row": transformed(
            LEVELS, start=17.0, in_a_row=2, steps=(4.0, 2.0, 1.0, 0.5)
        ),
        "psychopy, 3 in a row": transformed(LEVELS, start=20.0, in_a_row=3, steps=(2.0,)),
        "psychopy, 3 in a row from the first trial": UpDown(
            LEVELS, 12.0, (2.0, 1.0), (2.0, 1.0), in_a_row=3, one_at_first=False
        ),
    }
    cases = []
    for number, (name, rule) in enumerate(rules.items()):
        uniform = np.random.default_rng((32, number)).random((1, 60))
        people = Observers(np.array([THRESHOLDS[number]]), uniform, 0.5)
        history: list[list[float | bool]] = []
        if name.startswith("psychopy"):
            staircase = psychopy_staircase(rule)
            for trial in range(60):
                level = float(next(staircase))
                history.append([level, people.answers(0, trial, level)])
                staircase.addResponse(int(history[-1][1]))
            turns, last = staircase.reversalIntensities, staircase._nextIntensity
        else:
            wud = import_module("SweetSpot.AdaptiveProcedures").WUD
            track = wud(
                start=rule.start,
                hitEffect=-rule.harder[0],
                target=performance(rule),
                reversals=10**6,
            )
            track.min, track.max = LEVELS[0], LEVELS[-1]
            for trial in range(60):
                level = float(track.PendingValue())
                history.append([level, people.answers(0, trial, level)])
                track.Observe(int(history[-1][1]))
            turns, last = [history[trial][0] for trial in track.Reversals()], track.PendingValue()
        cases.append(
            {
                "name": name,
                "levels": LEVELS,
                "start": rule.start,
                "harder": rule.harder,
                "easier": rule.easier,
                "in_a_row": rule.in_a_row,
                "one_at_first": rule.one_at_first,
                "history": history,
                "next_level": float(last),
                "reversal_levels": [float(turn) for turn in turns],
            }
        )
    return cases


def asap_cases() -> list[dict[str, object]]:
    """Record ASAP's posterior of scores, in its own unit: an answer has variance 1."""
    asap = import_module("asap_cpu")
    cases = []
    for number, (conditions, votes) in enumerate(((4, 30), (8, 100), (15, 300))):
        rng = np.random.default_rng((33, number))
        truth = rng.normal(0.0, 0.7, conditions)
        wins = np.zeros((conditions, conditions), dtype=int)
        for _ in range(votes):
            i, j = rng.choice(conditions, 2, replace=False)
            first = truth[i] + rng.normal() > truth[j]
            wins[(i, j) if first else (j, i)] += 1
        random.seed(0)
        solver = asap.ASAP(conditions)
        games = solver.unroll_mat(wins.copy())
        mean, variance = solver.ts_solver.solve(games, num_iters=50)
        cases.append({"wins": wins.tolist(), "mean": mean.tolist(), "variance": variance.tolist()})
    return cases


recorded = {
    "packages": {name: metadata.version(name) for name in ("questplus", "psychopy", "SweetSpot")},
    "quest_plus": quest_cases(),
    "up_down": track_cases(),
    "active_pairs": asap_cases(),
}
Path(__file__).with_suffix(".json").write_text(json.dumps(recorded) + "\n", encoding="utf-8")
