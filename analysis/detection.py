"""Detection ([BB] 6.3): hits, false alarms, d', criterion; correct and bias proportions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats
from scipy.special import ndtri

from analysis.clustered import participant_t, two_way, wilson


@dataclass(frozen=True)
class Sensitivity:
    """d' and criterion from one table of hits and false alarms.

    `corrected`: half a trial was added to every cell (log-linear), because a rate was 0 or 1.
    """

    d_prime: float
    standard_error: float
    criterion: float
    hit_rate: float
    false_alarm_rate: float
    corrected: bool


@dataclass(frozen=True)
class Proportion:
    """A share with clustered limits, and the pooled exact binomial p the papers print."""

    count: int
    trials: int
    share: float
    lower: float
    upper: float
    p: float
    exact_p: float


@dataclass(frozen=True)
class Detection:
    """What observers could tell about one method.

    Attributes
    ----------
    hits, misses, false_alarms, correct_rejections : int
        A hit is "inconsistent" said to an inconsistent image.
    pooled : Sensitivity
        From the summed table.
    d_prime, d_lower, d_upper, d_p : float
        Mean of the participants' d' (log-linear correction), t limits and p.
    criterion : float
        Mean of the participants' criteria; negative: inclined to say "inconsistent".
    correct, bias : Proportion
        Share answered correctly, and share answered "consistent" ([BB] Fig. 20).
    warnings : tuple of str
    """

    method: str
    hits: int
    misses: int
    false_alarms: int
    correct_rejections: int
    pooled: Sensitivity | None
    d_prime: float | None
    d_lower: float | None
    d_upper: float | None
    d_p: float | None
    criterion: float | None
    correct: Proportion
    bias: Proportion
    participants: int
    warnings: tuple[str, ...]


def sensitivity(
    hits: float, misses: float, false_alarms: float, correct_rejections: float
) -> Sensitivity:
    """Return d' = z(hits) - z(false alarms) and the criterion -(z + z) / 2.

    Notes
    -----
    Standard error: Gourevitch and Galanter 1967. Rates of 0 or 1 get the log-linear
    correction (Hautus 1995): half a trial in every cell.
    """
    if min(hits + misses, false_alarms + correct_rejections) <= 0:
        raise ValueError("signal and noise trials must both be present")
    corrected = 0 in (hits, misses, false_alarms, correct_rejections)
    extra = 0.5 if corrected else 0.0
    signal, noise = hits + misses + 2 * extra, false_alarms + correct_rejections + 2 * extra
    hit, alarm = (hits + extra) / signal, (false_alarms + extra) / noise
    z_hit, z_alarm = float(ndtri(hit)), float(ndtri(alarm))
    variance = hit * (1 - hit) / (signal * stats.norm.pdf(z_hit) ** 2)
    variance += alarm * (1 - alarm) / (noise * stats.norm.pdf(z_alarm) ** 2)
    return Sensitivity(
        d_prime=z_hit - z_alarm,
        standard_error=float(np.sqrt(variance)),
        criterion=-0.5 * (z_hit + z_alarm),
        hit_rate=hit,
        false_alarm_rate=alarm,
        corrected=corrected,
    )


def forced_choice_d_prime(correct: float, trials: float) -> tuple[float, float]:
    """Return d' = sqrt(2) z(share correct) of two-alternative forced choice, and its error."""
    share = correct / trials
    if not 0.0 < share < 1.0:
        share = (correct + 0.5) / (trials + 1.0)
    z = float(ndtri(share))
    error = np.sqrt(2.0 * share * (1.0 - share) / trials) / stats.norm.pdf(z)
    return float(np.sqrt(2.0) * z), float(error)


def detection(
    trials: pd.DataFrame,
    *,
    method: str = "method",
    signal: str = "inconsistent",
    answer: str = "answered_inconsistent",
    control: Sequence[str] = (),
    level: float = 0.95,
) -> tuple[Detection, ...]:
    """Analyse a yes/no detection experiment, method by method.

    Parameters
    ----------
    trials : DataFrame, one row per trial
        Columns ``participant``, ``scene``, the method shown, whether the image was inconsistent
        (0/1), and whether the observer said so (0/1).
    control : sequence of str
        Methods shown only without signal, such as the reference: their correct share is
        reported, d' is not.

    Raises
    ------
    ValueError
        If columns are missing or hold anything but 0 and 1.
    """
    needed = ("participant", "scene", method, signal, answer)
    missing = [column for column in needed if column not in trials.columns]
    if missing or trials.empty:
        raise ValueError(
            f"trials must hold rows with the columns {list(needed)} (missing {missing})"
        )
    for column in (signal, answer):
        if not trials[column].isin((0, 1)).all():
            raise ValueError(f"column {column!r} must hold 0 and 1 only")
    return tuple(
        _one_method(str(name), rows, signal, answer, str(name) in control, level)
        for name, rows in trials.groupby(method, sort=True)
    )


def _one_method(
    name: str, rows: pd.DataFrame, signal: str, answer: str, control: bool, level: float
) -> Detection:
    said, there = rows[answer].astype(bool), rows[signal].astype(bool)
    table = pd.DataFrame(
        {
            "participant": rows["participant"],
            "hits": said & there,
            "misses": ~said & there,
            "false_alarms": said & ~there,
            "correct_rejections": ~said & ~there,
        }
    )
    people = table.groupby("participant", sort=True).sum()
    totals = people.sum()
    notes = []
    pooled = d_prime = d_lower = d_upper = d_p = criterion = None
    balanced = (
        min(
            totals["hits"] + totals["misses"], totals["false_alarms"] + totals["correct_rejections"]
        )
        > 0
    )
    if balanced and not control:
        pooled = sensitivity(*map(float, totals))
        each = [
            sensitivity(*map(float, row))
            for row in people.to_numpy()
            if row[0] + row[1] > 0 and row[2] + row[3] > 0
        ]
        values = np.array([one.d_prime for one in each])
        mean, error, df, p = participant_t(values)
        d_prime, criterion = mean, float(np.mean([one.criterion for one in each]))
        if df > 0 and np.isfinite(p):
            reach = float(stats.t.ppf(0.5 + 0.5 * level, df)) * error
            d_lower, d_upper, d_p = mean - reach, mean + reach, p
        else:
            notes.append("participants do not differ, or are too few: no limits for d'")
        extreme = sum(one.corrected for one in each)
        if extreme:
            notes.append(
                f"{extreme} of {len(each)} participants had a rate of 0 or 1: corrected,"
                " d' is drawn towards 0"
            )
    elif not control:
        notes.append("only consistent or only inconsistent images were shown: no d'")
    return Detection(
        method=name,
        hits=int(totals["hits"]),
        misses=int(totals["misses"]),
        false_alarms=int(totals["false_alarms"]),
        correct_rejections=int(totals["correct_rejections"]),
        pooled=pooled,
        d_prime=d_prime,
        d_lower=d_lower,
        d_upper=d_upper,
        d_p=d_p,
        criterion=criterion,
        correct=_proportion(rows, said == there, level),
        bias=_proportion(rows, ~said, level),
        participants=len(people),
        warnings=tuple(notes),
    )


def _proportion(rows: pd.DataFrame, event: pd.Series, level: float) -> Proportion:
    people, person = np.unique(rows["participant"].astype(str), return_inverse=True)
    scenes, scene = np.unique(rows["scene"].astype(str), return_inverse=True)
    shown = np.zeros((people.size, scenes.size))
    happened = np.zeros_like(shown)
    np.add.at(shown, (person, scene), 1.0)
    np.add.at(happened, (person, scene), event.to_numpy(dtype=np.float64))
    total, count = int(shown.sum()), int(happened.sum())
    exact = stats.binomtest(count, total)
    if people.size < 2:
        limits = exact.proportion_ci(level, method="exact")
        lower, upper, p = float(limits.low), float(limits.high), float(exact.pvalue)
    else:
        estimate = two_way(happened, shown)
        low, high = wilson(estimate.share, estimate.effective_n, estimate.df, level)
        lower, upper = float(low), float(high)
        # Where all answers agree the smallest p of a sign-flip test is all there is to say.
        p = float(estimate.p_value()) if estimate.standard_error > 0 else 2.0 / 2.0**people.size
    return Proportion(count, total, count / total, lower, upper, p, float(exact.pvalue))
