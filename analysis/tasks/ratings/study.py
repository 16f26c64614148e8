"""Every result of a table of ratings, in one frozen object."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from analysis.learning import Trend, trend
from analysis.ordinal import RatingModel, paired_ratings, rating_model
from analysis.reaction import ReactionTimes, reaction_times
from analysis.reaction_model import TimeModel, time_model
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
    times : TimeModel or None
        Of the logarithms of reaction times; None without times, and for pairs.
    """

    model: RatingModel
    levels: Mapping[str, tuple[int, ...]]
    learning: tuple[tuple[str, Trend], ...]
    reaction: tuple[ReactionTimes, ...]
    times: TimeModel | None
    warnings: tuple[str, ...]


def analyse(decisions: pd.DataFrame, settings: RatingSettings, step: Step) -> RatingResults:
    """Fit the cumulative-link model, and what all tasks have.

    Raises
    ------
    ValueError
        If there is nothing to compare (`ordinal.rating_model`).
    """
    step("ratings")
    model = fitted(decisions, settings)
    step("learning, reaction times")
    given = decisions["rating"].map(category)
    codes = given.map(model.steps).astype(float)
    levels = pd.crosstab(decisions["participant"], given)
    levels = levels.reindex(columns=list(model.categories), fill_value=0)
    by = () if settings.by is None else (settings.by,)
    learning = []
    if decisions["order"].notna().any():
        rows = decisions.assign(step=codes)
        found = trend(rows, "step", within=settings.columns, level=settings.confidence)
        learning.append(("rating, in steps of the scale", found))
    notes: list[str] = []
    times = None
    if by and decisions["rt_s"].notna().any():
        try:
            times = time_model(
                decisions[decisions["rt_s"] > 0],
                by,
                reference=settings.baseline,
                level=settings.confidence,
            )
        except ValueError as problem:
            notes.append(f"no model of reaction times: {problem}")
    return RatingResults(
        model=model,
        levels={str(who): tuple(map(int, row)) for who, row in levels.iterrows()},
        learning=tuple(learning),
        reaction=reaction_times(decisions, by, level=settings.confidence),
        times=times,
        warnings=tuple(notes),
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
