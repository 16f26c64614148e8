"""Answers that are worse than guessing, or fall where they should rise: mistakes of a table."""

import numpy as np
import pandas as pd
import scipy

RARE = 1e-4
"""Chance of a false alarm in a table whose answers are as they should be."""
_STEEP = 4.0
"""So many standard errors of the trend of all people together are no chance."""


def below_guessing(rows: pd.DataFrame, chance: float) -> tuple[str, ...]:
    """Return a note where right answers are fewer than guessing gives; else none."""
    right, trials = int(rows["correct"].sum()), len(rows)
    if scipy.stats.binom.cdf(right, trials, chance) >= RARE:
        return ()
    return (
        f"answers are below guessing ({right} of {trials} right): if correct is 1 for errors, say"
        " --map correct=COLUMN:errors; if answers are named the wrong way round, --answer",
    )


def below_at(rows: pd.DataFrame, level: str, chance: float) -> str:
    """Return levels with fewer right answers than guessing gives; empty: none."""
    counts = rows.groupby(level)["correct"].agg(["sum", "size"])
    low = counts[scipy.stats.binom.cdf(counts["sum"], counts["size"], chance) < RARE / len(counts)]
    if low.empty:
        return ""
    return (
        f"right answers are fewer than guessing at {chance:g} gives (at {level} {low.index[0]:g},"
        f" {low['sum'].iloc[0]} of {low['size'].iloc[0]})"
    )


def wrong_way(rows: pd.DataFrame, level: str, *, falling: bool) -> bool:
    """Return True if answers get worse along a level where they should get better, or turned.

    Cochran's and Armitage's test of trend, within participants.
    """
    rank = rows[level].astype(float).rank(method="dense")
    people = rows["participant"]
    away = rank - rank.groupby(people).transform("mean")
    mean = rows["correct"].groupby(people).transform("mean")
    spread = float((away**2 * mean * (1.0 - mean)).sum())
    if spread <= 0.0:
        return False
    trend = float((away * (rows["correct"] - mean)).sum()) / np.sqrt(spread)
    return bool(trend > _STEEP if falling else trend < -_STEEP)


def curve_mistake(rows: pd.DataFrame, level: str, guess: float | None, *, falling: bool) -> str:
    """Return the fault of a table that no psychometric function can have made, and the cure.

    Empty where nothing is.
    """
    low = "" if guess is None else below_at(rows, level, guess)
    if wrong_way(rows, level, falling=falling):
        share = rows.groupby(level)["correct"].mean()
        if low and share.max() < 0.85 and share.min() < 0.15:
            return (
                f"answers are below guessing and {'rise' if falling else 'fall'} with {level} (to"
                f" {share.min():.2f} right): correct seems to be 1 for errors; say"
                " --map correct=COLUMN:errors"
            )
        cure = "leave --falling away" if falling else "say --falling"
        return f"answers get {'better' if falling else 'worse'} as {level} rises; {cure}"
    return f"{low}; say --guess 0.25 if there were four answers, or --guess fit" if low else ""
