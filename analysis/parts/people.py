"""People and scenes: how often each answered right."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import ClassVar, TypeVar

import numpy as np
import pandas as pd

from analysis.models.clustered import limits_by_scene
from analysis.models.compared_methods import cell_counts
from analysis.parts import AnalysisPlan, PartFigure, Presentation, SimplePart
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots import heat_map
from analysis.report.result_table import ResultColumn, ResultTable
from analysis.report.wording import NONE, share, share_range
from protocols.blocks import Block, FigurePlace

Pairs = tuple[tuple[str, float], ...]
Limits = tuple[tuple[float, float], ...]
Shares = Mapping[str, Pairs]
Label = Callable[[str], str]
K = TypeVar("K")
NO_LIMITS = repeat((math.nan, math.nan))
MOST_SCENES, MOST_COLUMNS = 30, 6
"""More scenes, or columns, are shown by the figure and the file alone."""


@dataclass(frozen=True)
class People:
    """Share of right answers of each participant, and of each scene, by condition.

    `scene_limits` are those of `scenes`, one by one.
    """

    participants: Shares
    scenes: Shares
    scene_limits: Mapping[str, Limits]
    notes: tuple[str, ...] = ()


class PeoplePart(SimplePart[RatePlan, People]):
    """Shares of right answers by participant, and by scene."""

    name: ClassVar[str] = "people"
    section: ClassVar[tuple[str, str]] = ("people", "Participants")

    def of(self, table: pd.DataFrame, plan: RatePlan) -> People:
        """Return shares by participant and scene."""
        people = _shares(table, plan, "participant")
        if "scene" not in table:
            return People(people, {}, {})
        return People(people, _shares(table, plan, "scene"), _limits(table, plan))

    def show(self, found: People, plan: RatePlan) -> Presentation:
        """Return a heat map of each, and how far people lie apart."""
        lines = [
            {"of": group, "name": who, "condition": name, "share": value, "lower": low, "upper": up}
            for group, shares in (("participant", found.participants), ("scene", found.scenes))
            for name, pairs in shares.items()
            for (who, value), (low, up) in zip(
                pairs, found.scene_limits[name] if group == "scene" else NO_LIMITS, strict=False
            )
        ]
        sentences = [
            f"In condition {plan.label(name)}, participants' shares of right answers lay between"
            f" {share(min(value for _, value in pairs))} and"
            f" {share(max(value for _, value in pairs))}."
            for name, pairs in found.participants.items()
        ]
        return Presentation(
            title="Participants and scenes" if found.scenes else "",
            blocks=(
                FigurePlace("participants"),
                FigurePlace("scenes"),
                *scenes_table(
                    "Share of right answers", found.scenes, found.scene_limits, plan, plan.label
                ),
            ),
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


def _limits(table: pd.DataFrame, plan: RatePlan) -> dict[str, Limits]:
    found = {}
    for name in shown_in(table, plan):
        part = table[table[plan.compared[0]] == name]
        cells = cell_counts(part, part["correct"].to_numpy(dtype=np.float64))[:2]
        found[name] = tuple(zip(*map(list, limits_by_scene(*cells, plan.confidence)), strict=True))
    return found


def scenes_table(
    what: str,
    shares: Mapping[K, Pairs],
    limits: Mapping[K, Limits],
    plan: AnalysisPlan,
    column: Callable[[K], str],
) -> tuple[Block, ...]:
    """Return the table of shares by scene with limits; nothing of one scene, or of very many.

    Parameters
    ----------
    shares, limits : mapping of column to (scene, share), and to limits of these
    """
    names = sorted({scene for pairs in shares.values() for scene, _ in pairs})
    if not 1 < len(names) <= MOST_SCENES or len(shares) > MOST_COLUMNS:
        return ()

    def told(key: K, scene: str) -> str:
        for (name, value), ends in zip(shares[key], limits[key], strict=True):
            if name == scene:
                return f"{share(value)} {share_range(*ends)}"
        return NONE

    table = ResultTable.of(
        f"{what} by scene, with {plan.limits} of people like these",
        names,
        ResultColumn("Scene", "l", plan.label),
        *(ResultColumn(column(key), "n", partial(told, key)) for key in shares),
    )
    return (table.block(),)


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
