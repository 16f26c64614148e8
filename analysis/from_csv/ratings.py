"""Ordered ratings of a CSV file: a cumulative-link mixed model, ties and all."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from analysis.csv_table import FIRST_LINE, IMPORT_HINT, read_table, renamed, shortened, text_column
from analysis.from_csv.found import Found, limits, number
from analysis.ordinal import (
    OrdinalLink,
    RatingDifference,
    RatingModel,
    paired_ratings,
    rating_model,
)
from analysis.plots.ratings import ratings_plot
from analysis.report.wording import leading, p_number, p_text
from analysis.trials_csv import analysed_rows
from protocols.errors import StudyError
from protocols.suggest import did_you_mean


def ratings_of_csv(
    path: Path,
    mapping: Mapping[str, str] | None = None,
    *,
    by: str | None = None,
    scale: Sequence[str] = (),
    baseline: str | None = None,
    link: OrdinalLink = "probit",
    level: float = 0.95,
) -> Found:
    """Compare the ratings of a CSV file.

    Parameters
    ----------
    path : Path
        CSV with ``participant`` and ``rating``; ``scene`` if scenes are several. Graded
        comparisons of pairs have ``first`` and ``second`` in place of `by`; their rating is the
        larger the more the first is better, 0 for a tie.
    scale : sequence of str
        Ratings from the lowest, where they are no numbers.

    Raises
    ------
    StudyError
        If the table lacks a column, or holds what cannot be.
    """
    table = analysed_rows(path, renamed(path, read_table(path), mapping or {}, None))
    pairs = by is None
    wanted = ["participant", "rating", *(("first", "second") if by is None else (by,))]
    missing = [name for name in wanted if name not in table]
    if missing:
        cure = " (or name the column of conditions with --by)" if pairs else ""
        raise StudyError(
            f"{path}: must have the columns {', '.join(missing)}{cure}"
            f" (found: {', '.join(map(str, table.columns))}); {IMPORT_HINT} {missing[0]}=COLUMN"
            f"{did_you_mean(missing[0], list(map(str, table.columns)))}"
        )
    if pairs and scale:
        raise StudyError("--scale must be left out for pairs: their ratings are numbers around 0")
    rows = pd.DataFrame(
        {name: text_column(path, table, name) for name in (*wanted, *_scene(table))},
        index=table.index,
    )
    _check_ratings(path, rows["rating"], scale)
    if pairs:
        same = rows.index[rows["first"] == rows["second"]]
        if len(same):
            raise StudyError(
                f"{path}: line {same[0] + FIRST_LINE}: first and second must differ"
                f" (got {shortened(rows.loc[same[0], 'first'])!r} twice)"
            )
    if not scale:
        rows["rating"] = pd.to_numeric(rows["rating"])
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
        raise StudyError(f"{path}: {problem}") from None
    simulated = "simulated" in table and bool((table["simulated"] == "1").any())
    return Found(
        title=f"{len(rows)} {'graded comparisons' if pairs else 'ratings'} of {people}"
        f" participant{'s' * (people != 1)}" + (" (SIMULATED)" if simulated else ""),
        shown=_shown(model, pairs=pairs),
        sentences=tuple(apa_rating(one, model) for one in model.contrasts),
        notes=model.warnings,
        tables=_tables(model, pairs=pairs),
        figures={
            "ratings": lambda width: ratings_plot(
                model, shares=not pairs, width_in=width, simulated=simulated
            )
        },
        result=model,
    )


def _scene(table: pd.DataFrame) -> tuple[str, ...]:
    return ("scene",) if "scene" in table else ()


def _check_ratings(path: Path, ratings: pd.Series, scale: Sequence[str]) -> None:
    known = ratings.isin(list(scale)) if scale else pd.to_numeric(ratings, errors="coerce").notna()
    wrong = ratings.index[~known]
    if not len(wrong):
        return
    got = shortened(ratings[wrong[0]])
    must = (
        f"one of {', '.join(scale)}"
        if scale
        else "a number, or the ratings be named from the lowest on with --scale bad,fair,good"
    )
    hint = did_you_mean(got, list(scale)) if scale else ""
    raise StudyError(
        f"{path}: line {wrong[0] + FIRST_LINE}: rating must be {must} (got {got!r}){hint}"
    )


def apa_rating(one: RatingDifference, model: RatingModel) -> str:
    """Return how much higher one condition is rated as a sentence."""
    unit = "SD" if model.link == "probit" else "logits"
    return (
        f"{one.first} was rated {one.difference:.2f} {unit} above {one.second},"
        f" {100 * one.level:g}% CI [{one.lower:.2f}, {one.upper:.2f}], t({one.df:.0f}),"
        f" {p_text(one.p)} ({p_number(one.p_adjusted)} Holm-adjusted; cumulative"
        f" {model.link} mixed model); one showing of it is rated higher with a chance of"
        f" {leading(f'{one.superiority:.2f}')}."
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


def _tables(model: RatingModel, *, pairs: bool) -> dict[str, pd.DataFrame]:
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
        "comparisons.csv": pd.DataFrame(
            [vars(one) for one in model.contrasts],
            columns=list(RatingDifference.__dataclass_fields__),
        ),
        "thresholds.csv": pd.DataFrame(
            {
                "below": model.categories[:-1],
                "above": model.categories[1:],
                "threshold": model.thresholds,
            }
        ),
    }
