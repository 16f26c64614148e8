"""Bayesian preferences of a CSV file, pair by pair."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd
from matplotlib.figure import Figure

from analysis.bayesian import BayesianPreference, bayesian_preference
from analysis.from_csv.found import Found, Progress
from analysis.pairings import found_pairings
from analysis.plots.style import BLUE, GREY, LIGHT, new_figure, share_axis, style, wrapped
from analysis.report.wording import NONE, NOT_IDENTIFIED, leading, share, share_range
from analysis.tables.decisions import read_decisions
from analysis.tables.table import Source, opened
from protocols.errors import StudyError
from protocols.prose import count_of
from protocols.suggest import did_you_mean


@dataclass(frozen=True)
class BayesFound:
    """Every number of the analysis."""

    comparisons: tuple[BayesianPreference, ...]


def bayes_of_csv(
    source: Source,
    mapping: Mapping[str, str] | None = None,
    *,
    method: str | None = None,
    against: str | None = None,
    margin: float = 0.1,
    level: float = 0.95,
    progress: Progress | None = None,
) -> Found:
    """Return posteriors of the preferences in a table.

    Parameters
    ----------
    source : Table or Path
        As `analysis.tables.decisions.read_decisions` reads it.
    method, against : str, optional
        Left out: every pair, or every pair with the one that is named.

    Raises
    ------
    StudyError
        If the table lacks a column, holds what cannot be, or NumPyro is missing.
    """
    table = opened(source, mapping)
    rows = read_decisions(table)
    names = sorted({*rows["first"], *rows["second"]})
    for option, name in (("--method", method), ("--against", against)):
        if name is not None and name not in names:
            raise StudyError(
                f"{option} {name}: must be one of {', '.join(names)}{did_you_mean(name, names)}"
            )
    chosen = []
    for one, other in found_pairings(rows):
        # The pair the way round it was asked for.
        ways = [
            way
            for way in ((one, other), (other, one))
            if method in (None, way[0]) and against in (None, way[1])
        ]
        chosen += ways[:1]
    if not chosen:
        raise StudyError(f"{table.path}: must compare {method} with {against} (no decision does)")
    found = []
    for place, (one, other) in enumerate(chosen):
        if progress is not None:
            progress(f"sampling {one} over {other}", place, len(chosen))
        try:
            found.append(bayesian_preference(rows, one, other, margin=margin, level=level))
        except ValueError as problem:
            raise StudyError(f"{table.path}: {problem}") from None
    people = rows["participant"].nunique()
    return Found(
        title=f"{count_of(len(rows), 'decision')} of {count_of(people, 'participant')}",
        shown=_shown(found),
        sentences=tuple(apa_bayes(one) for one in found),
        notes=(
            *table.notes,
            *(f"{one.method} over {one.against}: {note}" for one in found for note in one.warnings),
        ),
        tables={"posteriors.csv": _table(found)},
        figures={"posteriors": lambda width: _figure(found, width)},
        result=BayesFound(tuple(found)),
    )


def apa_bayes(one: BayesianPreference) -> str:
    """Return a posterior as a sentence."""
    if one.unidentified:
        return f"How often {one.method} is chosen over {one.against} is {NOT_IDENTIFIED}."
    others = "; ".join(
        f"{check.prior} prior {share(check.share.median)}"
        f" {share_range(check.share.lower, check.share.upper)}"
        for check in one.sensitivity[1:]
    )
    return (
        f"{one.method} was chosen over {one.against} with a share of {share(one.share.median)},"
        f" {100 * one.level:g}% credible {share_range(one.share.lower, one.share.upper)}"
        f" (hierarchical logit model, {one.participants} participants, {one.scenes} scenes);"
        f" P(share > .50) = {leading(f'{one.better:.3f}')}, P(within {leading(f'{one.margin:g}')}"
        f" of .50) = {leading(f'{one.in_rope:.3f}')}: {one.verdict} ({others})."
    )


def _shown(found: list[BayesianPreference]) -> pd.DataFrame:
    return pd.DataFrame(
        [
            dict.fromkeys(("share", "limits", "P(> .5)", "P(in ROPE)", "verdict"), NONE)
            | {"comparison": f"{one.method} over {one.against}"}
            if one.unidentified
            else {
                "comparison": f"{one.method} over {one.against}",
                "share": share(one.share.median),
                "limits": share_range(one.share.lower, one.share.upper),
                "P(> .5)": leading(f"{one.better:.3f}"),
                "P(in ROPE)": leading(f"{one.in_rope:.3f}"),
                "verdict": one.verdict,
            }
            for one in found
        ]
    )


def _table(found: list[BayesianPreference]) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "method": one.method,
                "against": one.against,
                "prior": check.prior,
                "share": check.share.median,
                "lower": check.share.lower,
                "upper": check.share.upper,
                "in_rope": check.in_rope,
                "verdict": check.verdict,
            }
            for one in found
            for check in one.sensitivity
            if not one.unidentified
        ]
    )


def _figure(found: list[BayesianPreference], width_in: float) -> Figure:
    """Draw shares with limits, thick the default prior, thin the others; the ROPE is grey."""
    with style(width_in):
        figure = new_figure(width_in, 0.8 + 0.45 * len(found), simulated=False)
        axes = figure.subplots()
        axes.axvspan(0.5 - found[0].margin, 0.5 + found[0].margin, color=LIGHT, lw=0)
        for y, one in enumerate(found):
            for place, check in enumerate(() if one.unidentified else one.sensitivity):
                colour, wide = (BLUE, 1.6) if place == 0 else (GREY, 0.8)
                at = y + 0.18 * place
                axes.plot([check.share.lower, check.share.upper], [at, at], color=colour, lw=wide)
                axes.plot(check.share.median, at, "o", color=colour, ms=4 if place == 0 else 2.5)
        axes.axvline(0.5, color="black", lw=0.8, ls=(0, (4, 3)))
        names = [wrapped(f"{one.method} over {one.against}", width_in) for one in found]
        axes.set_yticks(range(len(found)), names)
        axes.set_ylim(len(found) - 0.3, -0.5)
        axes.tick_params(axis="y", length=0)
        share_axis(axes, "Share of choices, credible limits")
    return figure
