"""Ordered ratings of a CSV file: a cumulative-link mixed model, ties and all."""

from collections.abc import Mapping, Sequence

import pandas as pd

from analysis.from_csv.found import Found, limits, number
from analysis.ordinal import OrdinalLink, RatingModel, paired_ratings, rating_model
from analysis.plots import sized
from analysis.plots.ratings import ratings_plot
from analysis.tables.ratings import read_ratings
from analysis.tables.table import Source, opened
from analysis.tasks.ratings.wording import apa_rating, rating_tables
from protocols.errors import StudyError


def ratings_of_csv(
    source: Source,
    mapping: Mapping[str, str] | None = None,
    *,
    by: str | None = None,
    scale: Sequence[str] = (),
    baseline: str | None = None,
    link: OrdinalLink = "probit",
    level: float = 0.95,
) -> Found:
    """Compare the ratings of a table.

    Parameters
    ----------
    source : Table or Path
        With ``participant`` and ``rating``; ``scene`` if scenes are several. Graded
        comparisons of pairs have ``first`` and ``second`` in place of `by`; their rating is the
        larger the more the first is better, 0 for a tie.
    scale : sequence of str
        Ratings from the lowest, where they are no numbers.

    Raises
    ------
    StudyError
        If the table lacks a column, or holds what cannot be.
    """
    pairs = by is None
    table = opened(source, mapping)
    rows = read_ratings(table, by=by, scale=scale)
    people = rows["participant"].nunique()
    try:
        model = (
            paired_ratings(rows, reference=baseline, link=link, level=level)
            if by is None
            else rating_model(
                rows, (by,), categories=scale or None, reference=baseline, link=link, level=level
            )
        )
    except ValueError as problem:
        raise StudyError(f"{table.path}: {problem}") from None
    simulated = bool(rows["simulated"].any())
    return Found(
        title=f"{len(rows)} {'graded comparisons' if pairs else 'ratings'} of {people}"
        f" participant{'s' * (people != 1)}" + (" (SIMULATED)" if simulated else ""),
        shown=_shown(model, pairs=pairs),
        sentences=tuple(apa_rating(one, model) for one in model.contrasts),
        notes=(*table.notes, *model.warnings),
        tables=rating_tables(model, pairs=pairs),
        figures={
            "ratings": sized(ratings_plot, model, shares=not pairs, simulated=simulated),
        },
        result=model,
    )


def _shown(model: RatingModel, *, pairs: bool) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {"condition": one.condition, "ratings": str(one.ratings)}
            | ({} if pairs else {"mean": f"{one.mean_rating:.2f}"})
            | {"place": number(one.place), "limits": limits(one.lower, one.upper)}
            for one in model.conditions
        ]
    )
