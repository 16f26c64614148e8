"""Every result of a study of right and wrong answers, in one frozen object."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.cells import grid
from analysis.critical_scaling import CriticalScaling, critical_scalings
from analysis.detection import DiscriminationResults, YesNoResults
from analysis.guessing import below_at, below_guessing, wrong_way
from analysis.ideal_observer import AbxRule
from analysis.models import ModelFit, ModelsBeside, glmm_probit, models_beside
from analysis.plans.rates import RateSettings, baseline_in, prepared, shown_in
from analysis.psychometric import Psychometric, fit_psychometric
from analysis.rates import Difference, Rate, correct_rates, rate, rate_contrasts
from analysis.tasks.base import Step
from analysis.thresholds import ThresholdModel, fit_thresholds

Floats = NDArray[np.float64]
T = TypeVar("T")
BY = ("condition",)


@dataclass(frozen=True)
class Counts:
    """Right answers and trials of a condition by level, all participants together."""

    levels: tuple[float, ...]
    right: tuple[int, ...]
    trials: tuple[int, ...]


@dataclass(frozen=True)
class RateResults:
    """Everything a report of right and wrong answers shows.

    Attributes
    ----------
    rates : tuple of Rate
        Right answers by condition, against chance.
    sensitivity : YesNoResults or DiscriminationResults
        d' by condition, and its differences from the baseline.
    comparisons : tuple of Difference
        The planned tests against the baseline: of d' (yes-no), of shares of right answers, or of
        thresholds where levels were chosen from the answers.
    typical : tuple of (condition, ModelFit)
        Yes-no: probit mixed models; their slope is d' of the typical participant.
    answered : Rate or None
        How often the first answer was given (abx), against one half.
    confusion : tuple of tuple of float
        Share of each answer (columns, as `answers`) where each was right (rows).
    counts, curves : by condition
        Of the levels; a curve is fitted to all participants together.
    thresholds : ThresholdModel or None
        Hierarchical over participants, lapse rate shared.
    critical, critical_contrasts
        Of ABX by scaling.
    models : ModelsBeside or None
        ``logit(correct) ~ 1 + level + by``.
    """

    rates: tuple[Rate, ...]
    sensitivity: YesNoResults | DiscriminationResults
    comparisons: tuple[Difference, ...]
    typical: tuple[tuple[str, ModelFit], ...]
    answered: Rate | None
    answers: tuple[str, ...]
    confusion: tuple[tuple[float | None, ...], ...]
    counts: Mapping[str, Counts]
    curves: Mapping[str, Psychometric]
    thresholds: ThresholdModel | None
    critical: tuple[CriticalScaling, ...]
    critical_contrasts: tuple[Difference, ...]
    models: ModelsBeside | None
    participant_shares: Mapping[str, tuple[tuple[str, float], ...]]
    scene_shares: Mapping[str, tuple[tuple[str, float], ...]]
    warnings: tuple[str, ...]

    @property
    def by_scene(self) -> bool:
        """Whether errors are clustered by scene too: where a condition has several scenes."""
        return any(one.scenes > 1 for one in self.rates)

    @property
    def groups(self) -> tuple[str, ...]:
        """What the models of right answers cluster by: what has several values in the table."""
        found = {"participant": self.participant_shares, "scene": self.scene_shares}
        return tuple(
            group
            for group, shares in found.items()
            if len({name for pairs in shares.values() for name, _ in pairs}) > 1
        )

    @property
    def measure(self) -> str:
        """What the planned comparisons compare."""
        return self.comparisons[0].measure if self.comparisons else ""


Sense = Callable[[pd.DataFrame], YesNoResults | DiscriminationResults]


def analyse_rates(
    decisions: pd.DataFrame,
    settings: RateSettings,
    step: Step,
    sense: Sense,
    *,
    signal: str | None = None,
    scaling: AbxRule | None = None,
) -> RateResults:
    """Run the analysis that tasks with right answers share.

    Parameters
    ----------
    decisions : DataFrame
        As `analysis.tidy` or `analysis.tables.trials` return them.
    sense : callable
        From prepared rows to d' by ``condition``.
    signal : str, optional
        Yes-no: the answer that is right where the signal is.
    scaling : str, optional
        ABX: the decision rule for d' against the level.
    """
    rows = prepared(decisions, settings)
    notes: list[str] = []
    level = settings.confidence
    step("right answers")
    shown = shown_in(rows, settings)
    rates = correct_rates(rows, BY, chance=settings.chance, level=level)
    notes += odd_answers(rows, settings)
    step("sensitivity")
    tabled = rows if signal is None else with_shared_noise(rows, signal)
    if tabled is not rows:
        notes.append("conditions without noise trials of their own share those of the others")
    sensitivity = _sorted_sensitivity(sense(tabled), shown)
    reference = baseline_in(rows, settings)
    step("levels")
    counts, curves, thresholds = {}, {}, None
    if settings.level is not None:
        counts = {name: _counts(rows[rows["condition"] == name], settings.level) for name in shown}
        curves = _curves(counts, settings, notes)
        step("thresholds")
        thresholds = _tried(
            lambda: fit_thresholds(
                rows,
                str(settings.level),
                BY,
                guess=settings.chance,
                shape=settings.shape,
                falling=settings.falling,
                logarithmic=settings.shape == "weibull",
                scenes="scene" in rows,
                reference=reference,
                level=level,
            ),
            "no thresholds over participants",
            notes,
        )
        if thresholds is not None:
            thresholds = replace(
                thresholds,
                thresholds=_in_order(thresholds.thresholds, shown, lambda one: one.condition),
                contrasts=_in_order(thresholds.contrasts, shown, lambda one: one.first),
            )
    critical: tuple[CriticalScaling, ...] = ()
    critical_contrasts: tuple[Difference, ...] = ()
    if scaling is not None and settings.level is not None and not settings.falling:
        step("critical scaling")
        critical, critical_contrasts = _critical(rows, settings, scaling, notes)
    step("models")
    models = _tried(lambda: _models(rows, settings, reference), "no models", notes)
    typical = _typical(tabled, signal, shown, level, notes) if signal is not None else ()
    answered = None
    answers = _answers(rows, settings)
    if scaling is not None and answers:
        said = (rows["answer"] == answers[0]).astype(float)
        answered = rate(said, grid(rows), condition=answers[0], level=level)
    if settings.adaptive:
        comparisons = thresholds.contrasts if thresholds is not None else ()
        notes.append(
            "levels were chosen from the answers: shares of right answers and d' are the rule's"
            " doing and compare nothing; thresholds do"
        )
    elif isinstance(sensitivity, YesNoResults):
        comparisons = sensitivity.d_prime_contrasts
    elif reference is not None:
        comparisons = _tested(rate_contrasts(rows, BY, reference=reference, level=level))
    else:
        comparisons = ()
    if reference is not None and rows["participant"].nunique() < 2:
        notes.append("one participant only: no test between conditions speaks about people")
    missing = [settings.label(name) for name in settings.values if name not in shown]
    if missing:
        notes.append(f"no decisions of {', '.join(missing)}")
    return RateResults(
        rates=_in_order(rates, shown, lambda one: one.condition),
        sensitivity=sensitivity,
        comparisons=_in_order(comparisons, shown, lambda one: one.first),
        typical=typical,
        answered=answered,
        answers=answers,
        confusion=_confusion(rows, answers),
        counts=counts,
        curves=curves,
        thresholds=thresholds,
        critical=_in_order(critical, shown, lambda one: one.condition),
        critical_contrasts=critical_contrasts,
        models=models,
        participant_shares=_shares(rows, shown, "participant"),
        scene_shares=_shares(rows, shown, "scene") if "scene" in rows else {},
        warnings=tuple(notes),
    )


def odd_answers(rows: pd.DataFrame, settings: RateSettings) -> list[str]:
    """Return notes on answers that are below guessing, or get worse where they should not."""
    notes = [] if settings.adaptive else list(below_guessing(rows, settings.chance))
    if settings.level is not None and wrong_way(rows, settings.level, falling=settings.falling):
        change = ("better", "false") if settings.falling else ("worse", "true")
        notes.append(
            f"answers get {change[0]} as {settings.level} rises: curves and thresholds mean"
            f" nothing; say falling = {change[1]} (--set falling={change[1]})"
        )
    elif settings.level is not None and not notes:
        low = below_at(rows, settings.level, settings.chance)
        if low and not settings.adaptive:
            notes.append(f"{low}: were there more than {settings.alternatives} answers?")
    return notes


def with_shared_noise(rows: pd.DataFrame, signal: str) -> pd.DataFrame:
    """Give conditions that hold the signal in every trial the noise trials of those without any.

    Where methods are compared with a reference that never holds the signal, all methods share its
    trials. A difference between two methods takes them away again. Conditions that never hold the
    signal then have no d' of their own, and are left out.
    """
    there = (rows["expected"].astype(str) == signal).groupby(rows["condition"]).agg(["any", "all"])
    only_signal = there.index[there["all"]]
    only_noise = there.index[~there["any"]]
    if only_signal.empty or only_noise.empty:
        return rows
    noise = rows[rows["condition"].isin(only_noise)]
    shared = [noise.assign(condition=name) for name in only_signal]
    kept = rows[~rows["condition"].isin(only_noise)]
    return pd.concat([kept, *shared], ignore_index=True)


def _tried(make: Callable[[], T], otherwise: str, notes: list[str]) -> T | None:
    """Return what can be made of the data, or None and a note that says why not."""
    try:
        return make()
    except ValueError as problem:
        notes.append(f"{otherwise}: {problem}")
        return None


def _in_order(found: Sequence[T], order: Sequence[str], name: Callable[[T], str]) -> tuple[T, ...]:
    """Sort results by the order of conditions that the study declares."""
    place = {value: index for index, value in enumerate(order)}
    return tuple(sorted(found, key=lambda one: place.get(name(one), len(place))))


def _sorted_sensitivity(
    found: YesNoResults | DiscriminationResults, order: Sequence[str]
) -> YesNoResults | DiscriminationResults:
    def contrasts(several: Sequence[Difference]) -> tuple[Difference, ...]:
        return _in_order(_tested(several), order, lambda one: one.first)

    if isinstance(found, YesNoResults):
        return replace(
            found,
            conditions=_in_order(found.conditions, order, lambda one: one.condition),
            d_prime_contrasts=contrasts(found.d_prime_contrasts),
            criterion_contrasts=contrasts(found.criterion_contrasts),
            bias_contrasts=contrasts(found.bias_contrasts),
        )
    return replace(
        found,
        conditions=_in_order(found.conditions, order, lambda one: one.condition),
        contrasts=contrasts(found.contrasts),
    )


def _tested(several: Sequence[Difference]) -> tuple[Difference, ...]:
    """Leave out differences that nothing can be said of: of a single participant."""
    return tuple(one for one in several if np.isfinite(one.p))


def _counts(rows: pd.DataFrame, level: str) -> Counts:
    table = rows.groupby(pd.to_numeric(rows[level]))["correct"].agg(["sum", "size"])
    return Counts(
        tuple(map(float, table.index)),
        tuple(map(int, table["sum"])),
        tuple(map(int, table["size"])),
    )


def _curves(
    counts: Mapping[str, Counts], settings: RateSettings, notes: list[str]
) -> dict[str, Psychometric]:
    """Fit a psychometric function to each condition, all participants together."""
    found = {}
    for name, one in counts.items():
        x, right, trials = (
            np.array(values, dtype=np.float64) for values in (one.levels, one.right, one.trials)
        )
        fit = _tried(
            partial(
                fit_psychometric,
                x,
                right,
                trials,
                guess=settings.chance,
                shape=settings.shape,
                falling=settings.falling,
                level=settings.confidence,
            ),
            f"{settings.label(name)}: no psychometric function",
            notes,
        )
        if fit is not None:
            found[name] = fit
    return found


def _critical(
    rows: pd.DataFrame, settings: RateSettings, rule: AbxRule, notes: list[str]
) -> tuple[tuple[CriticalScaling, ...], tuple[Difference, ...]]:
    column, level = str(settings.level), settings.confidence
    if (pd.to_numeric(rows[column]) <= 0).any():
        notes.append(f"no critical scaling: {column} is not positive everywhere")
        return (), ()
    found = _tried(
        lambda: critical_scalings(rows, BY, column=column, rule=rule, level=level),
        "no critical scaling",
        notes,
    )
    return found or ((), ())


def _models(
    rows: pd.DataFrame, settings: RateSettings, reference: str | None
) -> ModelsBeside | None:
    """Fit ``logit(correct) ~ 1 + level + by``, with names that a formula can hold."""
    terms, names = [], {}
    if settings.level is not None:
        terms.append(_identifier(settings.level))
        names[terms[-1]] = pd.to_numeric(rows[settings.level]).astype(float)
    compared = _identifier(settings.by) if settings.by is not None else None
    if reference is not None and compared is not None:
        terms.append(compared)
        names[compared] = rows["condition"]
    if not terms:
        return None
    table = rows[["participant", "correct", *(["scene"] if "scene" in rows else [])]]
    return models_beside(
        "logit(correct) ~ 1 + " + " + ".join(terms),
        table.assign(**names),
        reference={compared: reference} if reference is not None and compared else None,
        level=settings.confidence,
    )


def _identifier(name: str) -> str:
    """Return a column's name as a formula can hold it."""
    plain = re.sub(r"\W+", "_", name)
    # What these mean in a formula or in the table of the model is taken.
    taken = plain in ("C", "Q", "I", "correct", "participant", "scene") or not plain.isidentifier()
    return f"x_{plain}" if taken else plain


def _typical(
    rows: pd.DataFrame, signal: str, shown: Sequence[str], level: float, notes: list[str]
) -> tuple[tuple[str, ModelFit], ...]:
    """Fit d' of the typical participant, condition by condition."""
    found = []
    for name in shown:
        part = rows[rows["condition"] == name]
        there, said = (part[column].astype(str) == signal for column in ("expected", "answer"))
        if there.all() or not there.any():
            continue
        groups = [column for column in ("participant", "scene") if column in part]
        groups = [column for column in groups if part[column].nunique() > 1]
        if not groups:
            continue
        table = part[groups].assign(said=said.astype(int), signal=there.astype(float) - 0.5)
        fit = _tried(
            partial(
                glmm_probit,
                "said ~ 1 + signal",
                table,
                groups=groups,
                slopes=[("signal", "participant")] if "participant" in groups else (),
                level=level,
            ),
            f"{name}: no mixed model",
            notes,
        )
        if fit is not None:
            found.append((name, fit))
    return tuple(found)


def _shares(
    rows: pd.DataFrame, shown: Sequence[str], group: str
) -> dict[str, tuple[tuple[str, float], ...]]:
    found = {}
    for name in shown:
        part = rows[rows["condition"] == name]
        share = part.groupby(part[group].astype(str))["correct"].mean()
        found[name] = tuple((str(who), float(value)) for who, value in share.items())
    return found


def _answers(rows: pd.DataFrame, settings: RateSettings) -> tuple[str, ...]:
    """Return the answers of a table of confusions; none where it does not say them."""
    if "expected" not in rows or "answer" not in rows or (rows["answer"] == "").any():
        return ()
    given = {*rows["expected"].astype(str), *rows["answer"].astype(str)}
    return settings.answers if given <= set(settings.answers) else tuple(sorted(given))


def _confusion(
    rows: pd.DataFrame, answers: tuple[str, ...]
) -> tuple[tuple[float | None, ...], ...]:
    found = []
    for right in answers:
        part = rows[rows["expected"].astype(str) == right]
        said = part["answer"].astype(str)
        found.append(tuple(float((said == one).mean()) if len(part) else None for one in answers))
    return tuple(found)
