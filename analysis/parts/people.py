"""People and scenes: how often each answered right."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, TypeVar

import numpy as np
import pandas as pd

from analysis.parts import PartFigure, Presentation, SimplePart
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots import heat_map
from analysis.report.wording import share
from protocols.blocks import FigurePlace

Pairs = tuple[tuple[str, float], ...]
Shares = Mapping[str, Pairs]
Label = Callable[[str], str]
K = TypeVar("K")


@dataclass(frozen=True)
class People:
    """Share of right answers of each participant, and of each scene, by condition."""

    participants: Shares
    scenes: Shares
    notes: tuple[str, ...] = ()


class PeoplePart(SimplePart[RatePlan, People]):
    """Shares of right answers by participant, and by scene."""

    name: ClassVar[str] = "people"
    section: ClassVar[tuple[str, str]] = ("people", "Participants")

    def of(self, table: pd.DataFrame, plan: RatePlan) -> People:
        """Return shares by participant and scene."""
        scenes = _shares(table, plan, "scene") if "scene" in table else {}
        return People(_shares(table, plan, "participant"), scenes)

    def show(self, found: People, plan: RatePlan) -> Presentation:
        """Return a heat map of each, and how far people lie apart."""
        lines = [
            {"of": group, "name": who, "condition": name, "share": value}
            for group, shares in (("participant", found.participants), ("scene", found.scenes))
            for name, pairs in shares.items()
            for who, value in pairs
        ]
        sentences = [
            f"In condition {plan.label(name)}, participants' shares of right answers lay between"
            f" {share(min(value for _, value in pairs))} and"
            f" {share(max(value for _, value in pairs))}."
            for name, pairs in found.participants.items()
        ]
        return Presentation(
            title="Participants and scenes" if found.scenes else "",
            blocks=(FigurePlace("participants"), FigurePlace("scenes")),
            sentences=sentences,
            methods="Shares of right answers of single participants are as counted.",
            tables={"shares.csv": pd.DataFrame(lines)},
            figures=[
                shares_figure(
                    name,
                    f"Share of right answers, by {name.removesuffix('s')}.",
                    shares,
                    plan.label,
                    plan.label,
                )
                for name, shares in (("participants", found.participants), ("scenes", found.scenes))
                if shares
            ],
        )


def _shares(table: pd.DataFrame, plan: RatePlan, group: str) -> Shares:
    each = table.groupby([plan.compared[0], table[group].astype(str)])["correct"].mean()
    return {
        name: tuple((str(who), float(value)) for who, value in each[name].items())
        for name in shown_in(table, plan)
    }


def shares_figure(
    name: str, caption: str, shares: Mapping[K, Pairs], label: Label, column: Callable[[K], str]
) -> PartFigure:
    """Return the heat map of shares of participants, or of scenes: a row each.

    Parameters
    ----------
    name : str
        Of the rows, such as ``participants``; so is the figure's.
    shares : mapping of column to (name of row, share)
    """
    rows = sorted({row for pairs in shares.values() for row, _ in pairs})
    table = np.array([[dict(pairs).get(row, np.nan) for pairs in shares.values()] for row in rows])
    labels, columns = list(map(label, rows)), list(map(column, shares))
    title = name.removesuffix("s").capitalize()
    return PartFigure(name, caption, partial(heat_map, table, labels, columns, row_title=title))
