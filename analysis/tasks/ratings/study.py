"""Every result of a table of ratings, in one frozen object."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from analysis.learning import Trend, trend
from analysis.ordinal import RatingModel, paired_ratings, rating_model
from analysis.tasks.base import Step
from analysis.tasks.ratings.settings import RatingSettings


@dataclass(frozen=True)
class RatingResults:
    """Everything a report of ratings shows.

    Attributes
    ----------
    model : RatingModel
        Places of conditions on the latent axis, and their comparisons.
    levels : mapping
        How often each participant gave each rating, in the order of the model's categories.
    """

    model: RatingModel
    levels: Mapping[str, tuple[int, ...]]
    learning: tuple[tuple[str, Trend], ...]


def analyse(decisions: pd.DataFrame, settings: RatingSettings, step: Step) -> RatingResults:
    """Fit the cumulative-link model, and what all tasks have.

    Raises
    ------
    ValueError
        If there is nothing to compare (`ordinal.rating_model`).
    """
    step("ratings")
    model = fitted(decisions, settings)
    step("learning")
    given = decisions["rating"].map(category)
    codes = given.map(model.steps).astype(float)
    levels = pd.crosstab(decisions["participant"], given)
    levels = levels.reindex(columns=list(model.categories), fill_value=0)
    learning = []
    if decisions["order"].notna().any():
        rows = decisions.assign(step=codes)
        found = trend(rows, "step", within=settings.columns, level=settings.confidence)
        learning.append(("rating, in steps of the scale", found))
    return RatingResults(
        model=model,
        levels={str(who): tuple(map(int, row)) for who, row in levels.iterrows()},
        learning=tuple(learning),
    )


def fitted(decisions: pd.DataFrame, settings: RatingSettings) -> RatingModel:
    """Return the cumulative-link mixed model of all ratings."""
    if settings.by is None:
        return paired_ratings(
            decisions,
            reference=settings.baseline,
            link=settings.link,
            level=settings.confidence,
        )
    rows = decisions
    if "scene" in rows and (rows["scene"] == "").all():
        rows = rows.drop(columns="scene")
    return rating_model(
        rows,
        (settings.by,),
        categories=settings.scale or None,
        reference=settings.baseline,
        link=settings.link,
        level=settings.confidence,
    )


def category(value: object) -> str:
    """Return a rating as the model names it."""
    return f"{value:g}" if isinstance(value, int | float) else str(value)
