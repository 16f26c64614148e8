"""Did answers or speed change over the session?"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.arrays import Floats
from analysis.models.clustered import participant_t, sign_flip_p
from analysis.models.numeric import ROUNDING, tied, two_sided_p, two_sided_quantile


@dataclass(frozen=True)
class Trend:
    """A trend over the session, judged between participants.

    Attributes
    ----------
    outcome : str
    change, lower, upper : float
        Mean change from the first to the last trial of a participant, with t limits.
    t, df, p : float
        t test of the participants' changes against 0; t is NaN where all changed alike, and p
        the sign-flip test's.
    sign_flip_p : float
    spearman_rho, spearman_p : float
        All trials pooled, as the papers; finds "learning" too often when trends vary.
    changes : ndarray (participants,)
    warnings : tuple of str
        What they say cannot be had is NaN.
    """

    outcome: str
    change: float
    lower: float
    upper: float
    df: float
    p: float
    sign_flip_p: float
    spearman_rho: float
    spearman_p: float
    participants: int
    changes: Floats
    warnings: tuple[str, ...]
    t: float


@dataclass(frozen=True)
class Course:
    """An outcome over the session, cut into equal parts.

    Attributes
    ----------
    places : ndarray (parts,)
        Middles of the parts, from 0 (first trial) to 1.
    people : ndarray (participants, parts)
        Each participant's mean; NaN where there is none.
    """

    places: Floats
    people: Floats


def course(decisions: pd.DataFrame, outcome: str) -> Course:
    """Return participants' means of a column in parts of the session, by their own ``order``."""
    parts = 6
    rows = decisions[["participant", "order", outcome]].dropna().astype({outcome: float})
    rows["participant"] = rows["participant"].astype(str)
    rank = rows.groupby("participant")["order"].rank(method="first")
    size = rows.groupby("participant")["order"].transform("size")
    rows["part"] = np.minimum((parts * (rank - 1) / size).astype(int), parts - 1)
    each = rows.pivot_table(index="participant", columns="part", values=outcome, sort=True)
    places = (np.asarray(each.columns, dtype=np.float64) + 0.5) / parts
    return Course(places, each.to_numpy(dtype=np.float64))


def trend(
    decisions: pd.DataFrame, outcome: str, *, within: tuple[str, ...] = (), level: float = 0.95
) -> Trend:
    """Test whether a column drifts over the session.

    Parameters
    ----------
    decisions : DataFrame
        Columns ``participant``, ``order`` and `outcome` (0/1 or a number).
    within : tuple of str
        Columns that define cells; the outcome is centred in each, so that a change in which
        trials come early or late does not look like learning.

    Raises
    ------
    ValueError
        If no row has a participant, an order and an outcome.

    Notes
    -----
    One least-squares slope per participant, then a one-sample t test and a sign-flip test.
    """
    rows = decisions[["participant", "order", outcome, *within]].dropna()
    if rows.empty:
        raise ValueError(f"decisions must hold participants, order and {outcome!r}")
    value = pd.to_numeric(rows[outcome]).astype(float)
    if within:
        value = value - value.groupby([rows[column] for column in within]).transform("mean")
    order = rows["order"].astype(float)
    changes = []
    for index in rows.groupby("participant", sort=True).groups.values():
        y, x = value.loc[index].to_numpy(), order.loc[index].to_numpy()
        if np.ptp(x) == 0 or x.size < 3:
            continue
        place = (x - x.mean()) / np.ptp(x)
        changes.append(float(place @ (y - y.mean()) / (place @ place)))
    drift = np.array(changes)
    notes = []
    if len(value) < 3 or np.ptp(value) <= ROUNDING or np.ptp(order) == 0:
        rho, rho_p = np.nan, np.nan
        notes.append("all values are equal, or too few: no rank correlation")
    else:
        ranks = order.rank(), pd.Series(tied(np.asarray(value, dtype=np.float64))).rank()
        rho, free = float(np.corrcoef(*ranks)[0, 1]), len(value) - 2
        rho_p = 0.0
        if abs(rho) < 1.0:
            rho_p = float(two_sided_p(rho * np.sqrt(free / ((1.0 - rho) * (1.0 + rho))), free))
    mean, error, df, p, flipped = float(drift[0]) if drift.size else np.nan, *[np.nan] * 4
    if drift.size < 2:
        notes.append("fewer than two participants with three trials: no test between participants")
    else:
        (mean, error, df, p), flipped = participant_t(drift), sign_flip_p(drift)
        if not np.isfinite(p):
            p = flipped
            notes.append("all participants changed alike: p is the sign-flip test's")
    reach = float(two_sided_quantile(level, df)) * error
    return Trend(
        outcome=outcome,
        change=mean,
        lower=mean - reach,
        upper=mean + reach,
        df=df,
        p=p,
        sign_flip_p=flipped,
        spearman_rho=rho,
        spearman_p=rho_p,
        participants=drift.size,
        changes=drift,
        warnings=tuple(notes),
        t=mean / error if error > 0.0 else np.nan,
    )
