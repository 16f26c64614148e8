"""Sensitivity and bias by detection theory: yes-no, identification, ABX, by condition."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np
import pandas as pd
from scipy.special import ndtri

from analysis.arrays import Floats
from analysis.models.cells import TrialGrid, checked, conditions, grid
from analysis.models.clustered import held_p
from analysis.models.contrasts import Difference
from analysis.models.numeric import two_sided_p, two_sided_quantile
from analysis.models.right_answers import (
    CorrectedRates,
    Influence,
    Rate,
    contrasts,
    event_influence,
    rate,
    rate_contrasts,
)
from protocols.answer_rules import AnswerRule

Correction = Literal["log-linear", "none"]


@dataclass(frozen=True)
class Measure:
    """A quantity with t limits and p against 0 that respect participants and scenes."""

    value: float
    standard_error: float
    df: float
    lower: float
    upper: float
    level: float
    p: float

    @property
    def t(self) -> float:
        """Value in standard errors."""
        return self.value / max(self.standard_error, 1e-12)

    @property
    def held(self) -> str:
        """Reason that holds p above that of t; empty if there is none."""
        return held_p(self.t, self.df, self.p)


@dataclass(frozen=True)
class YesNoCondition:
    """Sensitivity of observers in one condition of a yes-no task.

    Attributes
    ----------
    hits, misses, false_alarms, correct_rejections : int
        A hit is the signal's answer given where the signal was.
    d_prime, criterion : Measure or None
        Of the whole table: what the population's hit and false-alarm rates say. None where only
        one of signal and noise was shown. Criterion negative: inclined to the signal's answer.
    correct : Rate
        Against one half.
    bias : Rate
        Share of trials with the answer `bias_answer`, against one half ([BB] Fig. 20).
    """

    condition: str
    hits: int
    misses: int
    false_alarms: int
    correct_rejections: int
    d_prime: Measure | None
    criterion: Measure | None
    correct: Rate
    bias: Rate
    bias_answer: str
    participants: int
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class YesNoResults:
    """All conditions of a yes-no task, and the differences between them (Holm per measure)."""

    conditions: tuple[YesNoCondition, ...]
    d_prime_contrasts: tuple[Difference, ...]
    criterion_contrasts: tuple[Difference, ...]
    bias_contrasts: tuple[Difference, ...]
    correction: Correction

    def __getitem__(self, condition: str) -> YesNoCondition:
        return {one.condition: one for one in self.conditions}[condition]


@dataclass(frozen=True)
class Discrimination:
    """d' of one condition of an identification or ABX task, from the share of right answers.

    `lower` and `upper` are the limits of the share, mapped; so they hold 0 exactly where the
    share's limits hold chance, and the p of `correct` is that of both.
    """

    condition: str
    d_prime: float
    lower: float
    upper: float
    correct: Rate
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class DiscriminationResults:
    """All conditions, and differences between them, which are tested as shares of right answers.

    `rule` says which observer turns shares into d'.
    """

    conditions: tuple[Discrimination, ...]
    contrasts: tuple[Difference, ...]
    rule: str
    correction: Correction

    def __getitem__(self, condition: str) -> Discrimination:
        return {one.condition: one for one in self.conditions}[condition]


def yes_no(
    trials: pd.DataFrame,
    by: Sequence[str] = (),
    *,
    signal: str,
    bias_answer: str | None = None,
    correction: Correction = "log-linear",
    reference: str | None = None,
    level: float = 0.95,
) -> YesNoResults:
    """Analyse a yes-no task condition by condition.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial
        ``participant``, ``scene`` (optional), ``expected`` and ``answer`` (each one of the
        task's two answers), and the columns `by`.
    signal : str
        The answer that is right where the signal is, such as ``inconsistent``.
    bias_answer : str, optional
        The answer whose share is reported as bias; left out, the signal's.
    correction : {"log-linear", "none"}
        Half a trial in every cell of every condition, or nowhere.
    reference : str, optional
        Condition that the others are compared with; left out, all pairs.

    Raises
    ------
    ValueError
        If columns are missing or more than two answers occur.

    Notes
    -----
    d' = z(H) - z(F) and c = -(z(H) + z(F)) / 2 of the condition's whole table. Their errors
    come from each trial's influence on z(H) and z(F), summed over participants and scenes as in
    `clustered.two_way`, never below the error of independent trials. Participants who set
    different criteria make the whole table's d' smaller than the mean of their own; that mean
    is what `logistic.glmm_probit` estimates. Differences take the same participants' cells away
    from each other.
    """
    rows = checked(trials, ("expected", "answer"), by)
    answers = sorted(set(rows["expected"].astype(str)) | set(rows["answer"].astype(str)))
    if signal not in answers or len(answers) > 2:
        raise ValueError(
            "columns 'expected' and 'answer' must hold two answers, one of them the signal's"
            f" {signal!r} (found {answers})"
        )
    shown = bias_answer or signal
    if bias_answer is not None and bias_answer not in answers:
        raise ValueError(f"bias_answer must be one of {answers} (got {bias_answer!r})")
    places = grid(rows)
    found, d_moved, c_moved, b_moved = [], {}, {}, {}
    for name, part in conditions(rows, by):
        table = _table(part, places, signal)
        one, moved = _yes_no(name, part, places, table, shown, correction, level)
        found.append(one)
        said = (part["answer"].astype(str) == shown).astype(float)
        b_moved[name] = event_influence(said, places)
        if moved is not None:
            d_moved[name], c_moved[name] = moved
    between = partial(contrasts, level=level)
    with_signal = reference if reference in d_moved else None
    if reference is not None and reference not in b_moved:
        raise ValueError(f"reference must be one of {list(b_moved)} (got {reference!r})")
    return YesNoResults(
        conditions=tuple(found),
        d_prime_contrasts=between("d'", d_moved, reference=with_signal),
        criterion_contrasts=between("criterion", c_moved, reference=with_signal),
        bias_contrasts=between(f"share {shown!r}", b_moved, reference=reference),
        correction=correction,
    )


def discrimination(
    trials: pd.DataFrame,
    rule: AnswerRule,
    by: Sequence[str] = (),
    *,
    correction: Correction = "log-linear",
    reference: str | None = None,
    level: float = 0.95,
) -> DiscriminationResults:
    """Return d' of right answers by condition, as a rule takes it from corrected shares.

    Columns and errors are those of `right_answers.correct_rates`; chance is the rule's.
    """
    rows = checked(trials, ("correct",), by)
    places = grid(rows)
    found = []
    for name, part in conditions(rows, by):
        correct = rate(part["correct"], places, condition=name, chance=rule.chance, level=level)
        share = corrected_share(correct.count, correct.trials, rule.chance, correction)
        # The correction draws towards chance: it must not carry d' past its own limits.
        share = np.clip(share, correct.lower, correct.upper)
        d, lower, upper = map(
            float, rule.d_prime(np.array([float(share), correct.lower, correct.upper]))
        )
        notes = list(correct.warnings)
        if correct.count in (0, correct.trials):
            notes.append("all answers agree: d' stands on the correction and is a bound")
        found.append(Discrimination(name, d, lower, upper, correct, tuple(notes)))
    return DiscriminationResults(
        conditions=tuple(found),
        contrasts=rate_contrasts(rows, by, reference=reference, level=level),
        rule=rule.words,
        correction=correction,
    )


def d_prime_influence(
    hits: Floats, signal: Floats, alarms: Floats, noise: Floats, correction: Correction
) -> tuple[Influence, Influence]:
    """Return the influence of cells (participants, scenes) on d' and on the criterion."""
    z_hit = _z_influence(hits, signal, correction)
    z_alarm = _z_influence(alarms, noise, correction)
    shown = signal + noise
    least = z_hit[2] + z_alarm[2]
    count, total = (
        np.stack([one.sum(axis=(-2, -1)) for one in cells], axis=-1)
        for cells in ((hits, alarms), (signal, noise))
    )
    found = []
    for hit, alarm in ((1.0, -1.0), (-0.5, -0.5)):
        rates = CorrectedRates(count, total, (hit, alarm)) if correction == "log-linear" else None
        value, cells = (hit * z_hit[k] + alarm * z_alarm[k] for k in (0, 1))
        found.append(Influence(value, cells, shown, hit**2 * least, rates=rates))
    return found[0], found[1]


def _yes_no(
    name: str,
    part: pd.DataFrame,
    places: TrialGrid,
    table: tuple[Floats, Floats, Floats, Floats],
    shown: str,
    correction: Correction,
    level: float,
) -> tuple[YesNoCondition, tuple[Influence, Influence] | None]:
    hits, signal, alarms, noise = table
    totals = [int(cells.sum()) for cells in table]
    people = int(((signal + noise).sum(axis=1) > 0).sum())
    notes: list[str] = []
    moved = None
    if min(totals[1], totals[3]) == 0:
        notes.append("only signal or only noise was shown: no d'")
    elif correction == "none" and (totals[0] in (0, totals[1]) or totals[2] in (0, totals[3])):
        notes.append("a rate is 0 or 1 and no correction was asked for: d' is infinite")
    else:
        moved = d_prime_influence(hits, signal, alarms, noise, correction)
        if totals[0] in (0, totals[1]) or totals[2] in (0, totals[3]):
            notes.append("a rate is 0 or 1: d' stands on the correction and is a lower bound")
        if people < 2:
            notes.append("one participant only: limits take trials as independent")
    correct = (part["answer"].astype(str) == part["expected"].astype(str)).astype(float)
    bias = (part["answer"].astype(str) == shown).astype(float)
    measures = (None, None) if moved is None else tuple(_measure(one, level) for one in moved)
    for quantity, measure in zip(("d'", "c"), measures, strict=True):
        if measure is not None and measure.held:
            notes.append(f"{quantity}: {measure.held}")
    result = YesNoCondition(
        condition=name,
        hits=totals[0],
        misses=totals[1] - totals[0],
        false_alarms=totals[2],
        correct_rejections=totals[3] - totals[2],
        d_prime=measures[0],
        criterion=measures[1],
        correct=rate(correct, places, condition=name, level=level),
        bias=rate(bias, places, condition=name, level=level),
        bias_answer=shown,
        participants=people,
        warnings=tuple(notes),
    )
    return result, moved


def _measure(moved: Influence, level: float) -> Measure:
    if int((moved.shown.sum(axis=1) > 0).sum()) < 2:
        value, error = float(moved.value), float(np.sqrt(moved.least))
        reach = float(two_sided_quantile(level)) * error
        p = float(two_sided_p(value / error))
        return Measure(value, error, np.inf, value - reach, value + reach, level, p)
    found = moved.estimate()
    lower, upper = found.limits(level)
    return Measure(
        value=float(found.value),
        standard_error=float(found.standard_error),
        df=float(found.df),
        lower=float(lower),
        upper=float(upper),
        level=level,
        p=float(found.p_value()),
    )


def _table(
    part: pd.DataFrame, places: TrialGrid, signal: str
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return hits, signal trials, false alarms and noise trials by cell."""
    there = (part["expected"].astype(str) == signal).astype(float)
    said = (part["answer"].astype(str) == signal).astype(float)
    return (
        places.count(said * there),
        places.count(there),
        places.count(said * (1.0 - there)),
        places.count(1.0 - there),
    )


def _z_influence(
    happened: Floats, shown: Floats, correction: Correction
) -> tuple[Floats, Floats, Floats]:
    """Return z of a rate, the influence of cells on it, and its variance for independent trials."""
    count, total = happened.sum(axis=(-2, -1)), shown.sum(axis=(-2, -1))
    share = np.asarray(corrected_share(count, total, 0.5, correction))
    z = np.asarray(ndtri(share))
    slope = total * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    centred = happened - shown * (count / total)[..., None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.where(
            (share > 0) & (share < 1), share * (1 - share) * total / slope**2, np.inf
        )
        return z, centred / slope[..., None, None], variance


def corrected_share(
    count: Floats | float, total: Floats | float, chance: float, correction: Correction
) -> Floats:
    """Return count / total, or with one trial at chance added (`log-linear`, Hautus 1995).

    The correction is for every condition or for none, so that conditions stay comparable.
    """
    if correction not in get_args(Correction):
        raise ValueError(f"correction must be one of {get_args(Correction)} (got {correction!r})")
    extra = 1.0 if correction == "log-linear" else 0.0
    return np.asarray(
        (np.asarray(count, dtype=np.float64) + extra * chance) / (np.asarray(total) + extra)
    )
