"""Error rates of the statistics, and speed of a bootstrap: `python -m benchmarks.analysis`.

The rates are the full simulations behind the moderate ones in `tests/stats`. With `--quick` a
tenth of them.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from scipy.special import expit

from analysis.models.bootstrap import bootstrap_scale, bootstrap_scores
from analysis.models.clustered import two_way
from analysis.models.mixed.reaction_model import time_model
from analysis.models.observers import check_observers
from analysis.models.paired.paired_counts import choice_share, pair_index
from analysis.models.scaling import scale
from analysis.models.trends import trend
from analysis.parts.times import TimesPart
from analysis.simulations import mean_logit
from analysis.tasks import analysis_of
from benchmarks.shared.output import conditions, file_to_write, processor, write_record
from protocols.load import load_protocol
from protocols.revision import code_revision

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Timing:
    """Milliseconds, median and range of several runs in one process."""

    name: str
    median_ms: float
    best_ms: float
    worst_ms: float
    runs: int


@dataclass(frozen=True)
class TestRates:
    """False positives at nominal .05, and coverage of the 95 % limits, without any effect."""

    participants: int
    scenes: int
    repeats: int
    participant_sd: float
    scene_sd: float
    studies: int
    pooled: float
    participant_t: float
    sign_flip: float
    two_way: float
    coverage: float


@dataclass(frozen=True)
class ShareRates:
    """Rates of p and of 95 % limits of a share at a true rate: one line of decision 0160's table.

    `significant` is the share of studies with p < .05 against one half: false positives where the
    rate is .5. `contradictions` counts studies whose p and limits disagree.
    """

    participants: int
    scenes: int
    repeats: int
    participant_sd: float
    scene_sd: float
    rate: float
    studies: int
    significant: float
    coverage: float
    contradictions: int


@dataclass(frozen=True)
class ScaleCoverage:
    """Share of 95 % limits of JOD scores that hold the truth, 11 observers x 6 scenes x 2."""

    conditions: int
    observer_sd: float
    scene_sd: float
    studies: int
    two_way: float
    observers_only: float


@dataclass(frozen=True)
class ObserverRates:
    """Share of clean studies in which the observer check flags anyone (nominal .05).

    Observers differ by a normal law, or by t with `tail_df` degrees of freedom.
    """

    observers: int
    conditions: int
    observer_sd: float
    tail_df: float | None
    studies: int
    family_wise: float


@dataclass(frozen=True)
class TimesPower:
    """Shares of studies whose reaction times at two sizes differ at .05, by two tests of each.

    `closed` is `analysis power`'s closed form, `model` the likelihood ratio that a report prints
    first; `alike` is how often both decide the same. A `ratio` of 1: false positives.
    """

    participants: int
    scenes: int
    repeats: int
    ratio: float
    studies: int
    closed: float
    model: float
    alike: float


@dataclass(frozen=True)
class LearningRates:
    """False positives of trend tests where each participant drifts their own way."""

    drift_sd: float
    studies: int
    pooled_spearman: float
    between_participants: float


def timings() -> list[Timing]:
    """Time 1,000 bootstraps of a scale, as README tells it, after one warm-up."""
    rng = np.random.default_rng(0)
    votes = simulate_votes(rng, np.linspace(1.0, -1.0, 6), 0.5, 0.3)
    times = []
    for _ in range(31):
        began = time.perf_counter()
        bootstrap_scores(votes, rng=rng, samples=1000)
        times.append(1e3 * (time.perf_counter() - began))
    times = times[1:]
    name = "1,000 JOD bootstraps, 6 conditions x 11 observers"
    return [Timing(name, statistics.median(times), min(times), max(times), len(times))]


def simulate_shares(
    rng: np.random.Generator,
    shape: tuple[int, int, int],
    participant_sd: float,
    scene_sd: float,
    studies: int,
    rate: float = 0.5,
) -> Floats:
    """Draw counts (studies, participants, scenes) whose mean rate is `rate`."""
    people, scenes, repeats = shape
    typical = mean_logit(rate, float(np.hypot(participant_sd, scene_sd)))
    logit = typical + rng.normal(0, participant_sd, (studies, people, 1))
    logit = logit + rng.normal(0, scene_sd, (studies, 1, scenes))
    drawn = rng.binomial(repeats, expit(np.broadcast_to(logit, (studies, people, scenes))))
    return np.asarray(drawn, dtype=np.float64)


def test_rates(scale_down: int) -> list[TestRates]:
    """Simulate studies of several shapes and count wrong alarms."""
    rng = np.random.default_rng(1)
    shapes = [(11, 6, 2), (20, 6, 2), (11, 12, 1), (8, 4, 3), (11, 3, 4), (30, 20, 1), (40, 2, 2)]
    spreads = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.5, 0.5), (0.63, 0.43), (0.0, 0.5), (0.5, 1.0)]
    studies = 20_000 // scale_down
    return [_rates(rng, shape, spread, studies) for shape, spread in product(shapes, spreads)]


def _rates(
    rng: np.random.Generator,
    shape: tuple[int, int, int],
    spread: tuple[float, float],
    studies: int,
) -> TestRates:
    people, scenes, repeats = shape
    counts = simulate_shares(rng, shape, *spread, studies)
    found = two_way(counts, np.asarray(float(repeats)))
    alone = two_way(counts.sum(axis=2, keepdims=True), np.asarray(float(scenes * repeats)))
    lower, upper = found.limits()
    total = people * scenes * repeats
    exact = np.array([stats.binomtest(k, total).pvalue for k in range(total + 1)])
    deviation = counts.mean(axis=2) / repeats - 0.5
    return TestRates(
        people,
        scenes,
        repeats,
        *spread,
        studies,
        pooled=float(np.mean(exact[counts.sum(axis=(1, 2)).astype(int)] < 0.05)),
        participant_t=float(
            np.mean(
                2 * stats.t.sf(np.abs(alone.share - 0.5) / alone.standard_error, alone.df) < 0.05
            )
        ),
        sign_flip=float(np.mean(_sign_flip_p(rng, deviation) < 0.05)),
        two_way=float(np.mean(found.p_value() < 0.05)),
        coverage=float(np.mean((lower <= 0.5) & (upper >= 0.5))),
    )


def share_rates(scale_down: int) -> list[ShareRates]:
    """Simulate shares at rates from .5 to .99 and judge p and limits."""
    rng = np.random.default_rng(5)
    shapes = [((11, 6, 2), 20_000), ((6, 3, 2), 20_000), ((30, 20, 1), 10_000)]
    spreads = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.5, 0.5), (0.63, 0.43)]
    rows = []
    for (shape, most), rate, spread in product(shapes, (0.5, 0.65, 0.8, 0.9, 0.95, 0.99), spreads):
        studies = most // scale_down
        counts = simulate_shares(rng, shape, *spread, studies, rate)
        found = two_way(counts, np.asarray(float(shape[2])))
        p, (lower, upper) = found.p_value(), found.limits()
        rows.append(
            ShareRates(
                *shape,
                *spread,
                rate,
                studies,
                significant=float(np.mean(p < 0.05)),
                coverage=float(np.mean((lower <= rate) & (rate <= upper))),
                contradictions=int(np.sum((p < 0.05) != ((lower > 0.5) | (upper < 0.5)))),
            )
        )
    return rows


def _sign_flip_p(rng: np.random.Generator, deviation: Floats) -> Floats:
    """Sign-flip p of many studies at once; all patterns up to 11 people, else 2,000."""
    people = deviation.shape[1]
    if people <= 11:
        codes = np.arange(2 ** (people - 1))[:, None] >> np.arange(people)[None, :] & 1
        signs = 1.0 - 2.0 * codes
    else:
        signs = 2.0 * rng.integers(0, 2, (2000, people)) - 1.0
    observed = np.abs(deviation.sum(axis=1)) - 1e-9
    parts = np.array_split(np.arange(len(deviation)), max(1, len(deviation) // 2000))
    return np.concatenate(
        [(np.abs(deviation[p] @ signs.T) >= observed[p, None]).mean(axis=1) for p in parts]
    )


def simulate_votes(
    rng: np.random.Generator,
    quality: Floats,
    observer_sd: float,
    scene_sd: float,
    *,
    people: int = 11,
    scenes: int = 6,
    repeats: int = 2,
    tail_df: float | None = None,
) -> Floats:
    """Draw votes (observers, scenes, k, k) under Thurstone's Case V."""
    count = quality.size
    taste = rng.standard_normal((people, 1, count))
    if tail_df is not None:
        taste = rng.standard_t(tail_df, taste.shape) / np.sqrt(tail_df / (tail_df - 2.0))
    own = quality + observer_sd * taste
    own = own + rng.normal(0, scene_sd, (1, scenes, count))
    first, second = pair_index(count)
    answers = rng.binomial(repeats, choice_share(own[..., first] - own[..., second]))
    votes = np.zeros((people, scenes, count, count))
    votes[..., first, second] = answers
    votes[..., second, first] = repeats - answers
    return votes


def scale_coverage(scale_down: int) -> list[ScaleCoverage]:
    """Simulate scales with known scores and count the limits that hold them."""
    rng = np.random.default_rng(2)
    studies = 1000 // scale_down
    found = []
    for count, (observer_sd, scene_sd) in product(
        (3, 6), ((0.0, 0.0), (0.5, 0.0), (0.8, 0.0), (0.5, 0.4), (0.6, 0.4))
    ):
        quality = np.linspace(1.0, -1.0, count)
        names = [str(index) for index in range(count)]
        # The truth is the scale that infinitely many observers and scenes would give.
        wide = simulate_votes(
            rng,
            quality,
            float(np.hypot(observer_sd, scene_sd)),
            0.0,
            people=200_000,
            scenes=1,
            repeats=1,
        )
        truth = scale(wide.sum(axis=(0, 1)), names).scores
        hits: dict[bool, list[float]] = {True: [], False: []}
        for _ in range(studies):
            votes = simulate_votes(rng, quality, observer_sd, scene_sd)
            for scenes in hits:
                limits = bootstrap_scale(votes, rng=rng, samples=500, scenes=scenes)
                hits[scenes].append(
                    float(np.mean((limits.lower <= truth) & (truth <= limits.upper)))
                )
        found.append(
            ScaleCoverage(
                count,
                observer_sd,
                scene_sd,
                studies,
                float(np.mean(hits[True])),
                float(np.mean(hits[False])),
            )
        )
    return found


def observer_rates(scale_down: int) -> list[ObserverRates]:
    """Simulate clean studies and count those in which someone is flagged."""
    rng = np.random.default_rng(3)
    studies = 1000 // scale_down
    found = []
    cases = (
        *((11, 3, spread, None) for spread in (0.0, 0.5, 1.5)),
        *((11, 6, spread, None) for spread in (0.5, 1.5)),
        (20, 4, 0.3, None),
        *((11, count, 0.7, 3.0) for count in (3, 6)),
    )
    for people, count, spread, tail_df in cases:
        names = [str(index) for index in range(people)]
        quality = np.linspace(1.0, -1.0, count)
        flagged = [
            bool(
                check_observers(
                    simulate_votes(rng, quality, spread, 0.0, people=people, tail_df=tail_df).sum(
                        axis=1
                    ),
                    names,
                    rng=rng,
                    studies=200,
                ).flagged
            )
            for _ in range(studies)
        ]
        found.append(
            ObserverRates(people, count, spread, tail_df, studies, float(np.mean(flagged)))
        )
    return found


def learning_rates(scale_down: int) -> list[LearningRates]:
    """Simulate sessions in which participants drift their own ways, none on average."""
    rng = np.random.default_rng(4)
    studies = 500 // scale_down
    found = []
    order = np.tile(np.arange(1, 73), 11)
    place = np.tile(np.linspace(-0.5, 0.5, 72), 11)
    for drift in (0.0, 0.3, 0.6):
        pooled, between = [], []
        for _ in range(studies):
            slope = np.repeat(rng.normal(0, drift, 11), 72)
            share = np.clip(0.5 + slope * place, 0.0, 1.0)
            rows = pd.DataFrame(
                {
                    "participant": np.repeat(np.arange(11), 72),
                    "order": order,
                    "y": (rng.random(share.size) < share).astype(float),
                }
            )
            result = trend(rows, "y")
            pooled.append(result.spearman_p < 0.05)
            between.append(result.p < 0.05)
        found.append(LearningRates(drift, studies, float(np.mean(pooled)), float(np.mean(between))))
    return found


def times_power(scale_down: int) -> list[TimesPower]:
    """Draw times as `analysis power` does; judge them by its closed form and by the model."""
    study = load_protocol(Path("inpainting-2afc"))
    timed = study.analysis.model_copy(update={"reaction": "models"})
    study = study.model_copy(update={"analysis": timed})
    chosen = analysis_of("preference").simulation(study).deciding()
    rng, studies, rows = np.random.default_rng(11), max(10, 100 // scale_down), []
    for people, scenes, repeats, effect in ((11, 6, 2, 1.25), (6, 3, 2, 1.5), (30, 20, 1, 1.1)):
        simulation = chosen.resized(scenes, repeats)
        assert simulation is not None, "pairs are shown in as many scenes as asked for"
        own = {one.name: one.value for one in simulation.assumptions}
        for ratio in (1.0, effect):
            answers = simulation.drawn(own | {"rt_ratio": ratio}, studies, people, rng)
            test = TimesPart().planned_over(answers, (people,), simulation.plan)["times"]
            closed = test()[:, 0, 0] < 0.05
            tables = (simulation.table(answers.of(number, people)) for number in range(studies))
            models = (time_model(table, ("size",)) for table in tables)
            model = np.array([one.ratios[0].p for one in models]) < 0.05
            rates = [float(np.mean(each)) for each in (closed, model, closed == model)]
            rows.append(TimesPower(people, scenes, repeats, ratio, studies, *rates))
    return rows


def main(argv: list[str]) -> int:
    """Print tables; with ``--json FILE`` also write them."""
    parser = argparse.ArgumentParser(prog="benchmarks.analysis", description=__doc__)
    parser.add_argument("--json", type=file_to_write, help="file to write the numbers to")
    parser.add_argument("--quick", action="store_true", help="a tenth of the simulations")
    parser.add_argument("--only", metavar="TABLE", help="one table, such as share_rates")
    arguments = parser.parse_args(argv)
    scale_down = 10 if arguments.quick else 1
    print(f"{processor()}, {os.cpu_count()} cores, revision {code_revision()}")
    tables: dict[str, list[dict[str, object]]] = {}
    parts: dict[str, Callable[[int], list[object]]] = {
        "timings": lambda _n: list(timings()),
        "test_rates": lambda n: list(test_rates(n)),
        "share_rates": lambda n: list(share_rates(n)),
        "scale_coverage": lambda n: list(scale_coverage(n)),
        "observer_rates": lambda n: list(observer_rates(n)),
        "learning_rates": lambda n: list(learning_rates(n)),
        "times_power": lambda n: list(times_power(n)),
    }
    only = arguments.only
    if only is not None and only not in parts:
        parser.error(f"--only must be one of {', '.join(parts)} (got {only!r})")
    for name, job in parts.items():
        if only not in (None, name):
            continue
        tables[name] = [dict(vars(row)) for row in job(scale_down)]
        _print(name, tables[name])
    if arguments.json:
        write_record(arguments.json, conditions("numpy", "scipy") | tables)
    return 0


def _print(name: str, rows: list[dict[str, object]]) -> None:
    print(f"\n{name}")
    print(pd.DataFrame(rows).to_string(index=False, float_format=lambda value: f"{value:.3f}"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
