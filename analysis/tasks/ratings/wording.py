"""Ratings in words and tables."""

import math

import pandas as pd

from analysis.columns import frame_of
from analysis.ordinal import RatingDifference, RatingModel
from analysis.report.wording import NOT_IDENTIFIED, leading, p_number, p_text


def apa_rating(one: RatingDifference, model: RatingModel) -> str:
    """Return how much higher one condition is rated as a sentence."""
    if math.isnan(one.difference):
        return f"How {one.first} was rated against {one.second} is {NOT_IDENTIFIED}."
    unit = "SD" if model.link == "probit" else "logits"
    return (
        f"{one.first} was rated {one.difference:.2f} {unit} above {one.second},"
        f" {100 * one.level:g}% CI [{one.lower:.2f}, {one.upper:.2f}], t({one.df:.1f}),"
        f" {p_text(one.p)} ({p_number(one.p_adjusted)} Holm-adjusted; cumulative"
        f" {model.link} mixed model); one showing of it is rated higher with a chance of"
        f" {leading(f'{one.superiority:.2f}')}."
    )


def rating_tables(model: RatingModel, *, pairs: bool) -> dict[str, pd.DataFrame]:
    """Return conditions, comparisons and thresholds, by file name."""
    lines: list[dict[str, object]] = []
    for one in model.conditions:
        line: dict[str, object] = {"condition": one.condition, "ratings": one.ratings}
        line |= {"place": one.place, "lower": one.lower, "upper": one.upper}
        if not pairs:
            line["mean_rating"] = one.mean_rating
            line |= {
                f"share_{name}": value
                for name, value in zip(model.categories, one.shares, strict=True)
            }
        lines.append(line)
    return {
        "ratings.csv": pd.DataFrame(lines),
        "comparisons.csv": frame_of(RatingDifference, model.contrasts),
        "thresholds.csv": pd.DataFrame(
            {
                "below": model.used[:-1],
                "above": model.used[1:],
                "threshold": model.thresholds,
            }
        ),
    }
