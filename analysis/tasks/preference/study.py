"""The whole analysis of a 2AFC study: every result a report shows, in one frozen object."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.bias import Bias, order_bias, side_bias
from analysis.bootstrap import ScaleIntervals, bootstrap_scale
from analysis.consistency import (
    Agreement,
    Transitivity,
    Triads,
    agreement,
    circular_triads,
    majority,
    transitivity,
)
from analysis.models import ModelFit, glmm_logit
from analysis.observers import ObserverCheck, check_observers
from analysis.paired_model import PairedModel, paired_model
from analysis.pairings import ALL_SIZES, Comparisons, counts, numbered
from analysis.plans.preference import Settings
from analysis.preference import Preference, PreferenceTable, preference, preferences
from analysis.scaling import Contrast, Scale, contrasts, scale
from analysis.seed import SEED
from analysis.tasks.base import Step

Floats = NDArray[np.float64]

BOOTSTRAP_SAMPLES = 2000


@dataclass(frozen=True)
class SizeScale:
    """Scale of the methods at one size, and whether the answers fit on one axis."""

    size: str
    scale: Scale
    intervals: ScaleIntervals | None
    contrasts: tuple[Contrast, ...]
    triads: tuple[tuple[str, Triads], ...]
    agreement: Agreement | None
    transitivity: Transitivity
    observers: ObserverCheck
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class StudyResults:
    """Everything a report of a 2AFC preference study shows."""

    primary: Preference | None
    table: PreferenceTable
    models: tuple[tuple[str, str, str, ModelFit], ...]
    paired: tuple[tuple[str, PairedModel], ...]
    scales: tuple[SizeScale, ...]
    order: Bias
    side: Bias | None
    participant_shares: Mapping[tuple[str, str, str], tuple[tuple[str, float], ...]]
    scene_shares: Mapping[tuple[str, str, str], tuple[tuple[str, float], ...]]
    warnings: tuple[str, ...]


def analyse(
    decisions: pd.DataFrame, settings: Settings, *, step: Step | None = None
) -> StudyResults:
    """Run the whole analysis on the decisions that exclusions kept.

    Parameters
    ----------
    decisions : DataFrame
        As `analysis.tidy` or `analysis.tables.decisions` return them.
    step : callable, optional
        Told the name of each part before it runs.
    """
    say = step or (lambda _name: None)
    notes: list[str] = []
    grouped = Comparisons(decisions)
    decisions = grouped.decisions
    say("preferences")
    table = preferences(
        grouped,
        pairings=settings.pairings,
        sizes=settings.sizes,
        alpha=settings.alpha,
        margin=settings.margin,
        test=settings.test,
        correction="holm" if settings.correction == "holm" else "none",
    )
    notes += table.warnings
    primary = primary_of(grouped, settings)
    if settings.primary is not None and primary is None:
        method, against, _ = settings.primary
        notes.append(f"the primary comparison ({method} with {against}) has no decisions")
    say("mixed models")
    models = tuple(
        (cell.method, cell.against, cell.size, _mixed(grouped, cell)) for cell in table.cells
    )
    paired = _all_pairings(decisions, settings, notes)
    scales = []
    for size in settings.sizes:
        say(f"scale, {settings.label(size)}")
        made = _size_scale(decisions, settings, size, notes)
        if made is not None:
            scales.append(made)
    say("bias")
    return StudyResults(
        primary=primary,
        table=table,
        models=models,
        paired=paired,
        scales=tuple(scales),
        order=order_bias(decisions, alpha=settings.alpha),
        side=side_bias(decisions, alpha=settings.alpha),
        participant_shares=_shares(grouped, table, by_scene=False),
        scene_shares=_shares(grouped, table, by_scene=True),
        warnings=tuple(notes),
    )


def vote_tensor(decisions: pd.DataFrame, methods: tuple[str, ...]) -> tuple[Floats, list[str]]:
    """Count votes (participants, scenes, k, k) for i over j; also return the participants."""
    person, people = numbered(decisions["participant"])
    scene, scenes = numbered(decisions["scene"])
    place = {name: index for index, name in enumerate(methods)}
    won = decisions["chosen"].map(place).to_numpy(dtype=np.int64)
    lost = decisions["rejected"].map(place).to_numpy(dtype=np.int64)
    votes = np.zeros((len(people), len(scenes), len(methods), len(methods)))
    np.add.at(votes, (person, scene, won, lost), 1.0)
    return votes, list(people)


def primary_of(grouped: Comparisons, settings: Settings) -> Preference | None:
    """Return the primary comparison; None where there is none, or no decision makes it."""
    if settings.primary is None:
        return None
    method, against, size = settings.primary
    rows = grouped.rows(method, against, size)
    if rows.empty:
        return None
    return preference(
        rows,
        method,
        against,
        size,
        alpha=settings.alpha,
        margin=settings.margin,
        test=settings.test,
    )


def _mixed(grouped: Comparisons, cell: Preference) -> ModelFit:
    """Mixed model of one comparison; the intercept is the preference without order bias."""
    rows = grouped.rows(cell.method, cell.against, cell.size)
    table = pd.DataFrame(
        {
            "preferred": (rows["chosen"] == cell.method).astype(int),
            "shown_first": np.where(rows["first"] == cell.method, 0.5, -0.5),
            "participant": rows["participant"],
            "scene": rows["scene"],
        }
    )
    groups = [column for column in ("participant", "scene") if table[column].nunique() > 1]
    terms = "1 + shown_first" if table["shown_first"].nunique() > 1 else "1"
    return glmm_logit(
        f"preferred ~ {terms}", table, groups=groups or ["participant"], level=cell.estimate.level
    )


def _all_pairings(
    decisions: pd.DataFrame, settings: Settings, notes: list[str]
) -> tuple[tuple[str, PairedModel], ...]:
    """One model of all pairings at each size; with two methods it would be the pairing's own."""
    found = []
    for size in settings.sizes:
        rows, methods = _at_size(decisions, settings, size)
        if len(methods) < 3:
            continue
        try:
            found.append((size, paired_model(rows, methods)))
        except ValueError as problem:
            notes.append(f"no model of all pairings at {size}: {problem}")
    return tuple(found)


def _at_size(
    decisions: pd.DataFrame, settings: Settings, size: str
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return the decisions at one size, and the methods they compare."""
    together = size == ALL_SIZES and "all" not in set(decisions["size"])
    rows = decisions if together else decisions[decisions["size"] == size]
    shown = set(rows["first"]) | set(rows["second"])
    return rows, tuple(name for name in settings.methods if name in shown)


def _size_scale(
    decisions: pd.DataFrame, settings: Settings, size: str, notes: list[str]
) -> SizeScale | None:
    rows, methods = _at_size(decisions, settings, size)
    if len(methods) < 2:
        notes.append(f"no scale at {size}: fewer than two methods were compared")
        return None
    votes, people = vote_tensor(rows, methods)
    total = votes.sum(axis=(0, 1))
    try:
        fitted = scale(total, methods)
    except ValueError as problem:
        notes.append(f"no scale at {size}: {problem}")
        return None
    found: list[str] = []
    intervals = None
    if len(people) > 1:
        try:
            intervals = bootstrap_scale(
                votes,
                rng=np.random.default_rng(SEED),
                samples=BOOTSTRAP_SAMPLES,
                level=1.0 - settings.alpha,
            )
        except ValueError as problem:
            found.append(str(problem))
    by_person = votes.sum(axis=1)
    upper = np.triu_indices(len(methods), 1)
    seen = (by_person + by_person.swapaxes(-1, -2))[:, upper[0], upper[1]]
    complete = bool(np.all(seen > 0)) and len(methods) > 2
    answers = np.array([majority(one) for one in by_person])
    agreed = None
    if complete and len(people) > 2:
        agreed = agreement(answers.sum(axis=0))
        if np.any((answers == 0.5) & ~np.eye(len(methods), dtype=bool)):
            found.append("some participants were even on a pair: Kendall's u is approximate")
    elif len(methods) > 2:
        found.append("not everyone saw every pair: no triads, no agreement")
    return SizeScale(
        size=size,
        scale=fitted,
        intervals=intervals,
        contrasts=tuple(_clustered(one, methods, intervals) for one in contrasts(total, methods)),
        triads=tuple(
            (name, circular_triads(one)) for name, one in zip(people, answers, strict=True)
        )
        if complete
        else (),
        agreement=agreed,
        transitivity=transitivity(total),
        observers=check_observers(
            by_person, people, rng=np.random.default_rng(SEED), alpha=settings.alpha
        ),
        warnings=tuple(found),
    )


def _clustered(
    one: Contrast, methods: tuple[str, ...], intervals: ScaleIntervals | None
) -> Contrast:
    if intervals is None:
        return one
    place = methods.index(one.first), methods.index(one.second)
    return replace(
        one,
        clustered_p=float(intervals.difference_p[place]),
        clustered_p_adjusted=float(intervals.difference_p_adjusted[place]),
    )


def _shares(
    grouped: Comparisons, table: PreferenceTable, *, by_scene: bool
) -> dict[tuple[str, str, str], tuple[tuple[str, float], ...]]:
    result = {}
    for cell in table.cells:
        rows = grouped.rows(cell.method, cell.against, cell.size)
        chosen, shown, people, scenes = counts(rows, cell.method)
        axis, names = (0, scenes) if by_scene else (1, people)
        share = chosen.sum(axis=axis) / shown.sum(axis=axis)
        result[cell.method, cell.against, cell.size] = tuple(
            zip(names, map(float, share), strict=True)
        )
    return result
