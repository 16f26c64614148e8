"""Trials of a task as counts by condition, participant and scene."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.arrays import Floats, Ints
from analysis.models.contrasts import IN_CONDITION

ONE_SCENE = "all"


@dataclass(frozen=True)
class TrialGrid:
    """The participants and scenes of a table, in sorted order, and where each trial belongs.

    Conditions counted on one grid can be compared cell by cell. `person` and `scene` are numbers
    per trial, in the rows of a table numbered from 0 (`checked`).
    """

    participants: tuple[str, ...]
    scenes: tuple[str, ...]
    person: Ints
    scene: Ints

    @property
    def several(self) -> dict[str, Ints]:
        """Codes (trials,) of participants, and of scenes where there are several."""
        found = {"participant": self.person}
        return found | ({"scene": self.scene} if len(self.scenes) > 1 else {})

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Names of what the codes of `several` stand for."""
        return {"participant": self.participants, "scene": self.scenes}

    def in_conditions(self, condition: Ints) -> dict[str, Ints]:
        """Return codes (trials,) of `several` in a condition.

        Not where each has one trial there, nor where each has one condition (`one_condition`).
        """
        count = int(condition.max()) + 1
        return {
            name + IN_CONDITION: cell
            for name, code in self.several.items()
            if np.unique(cell := code * count + condition).size < len(cell)
            and not one_condition(code, condition)
        }

    def count(self, values: pd.Series) -> Floats:
        """Sum values (trials) into cells (participants, scenes)."""
        cells = np.zeros((len(self.participants), len(self.scenes)))
        rows = values.index.to_numpy()
        np.add.at(cells, (self.person[rows], self.scene[rows]), values.to_numpy(dtype=np.float64))
        return cells


def grid(trials: pd.DataFrame) -> TrialGrid:
    """Return the grid of a table; without a column ``scene`` all trials are of one scene."""
    scene = trials["scene"] if "scene" in trials.columns else pd.Series(ONE_SCENE, trials.index)
    people, person = np.unique(trials["participant"].astype(str), return_inverse=True)
    scenes, place = np.unique(scene.astype(str), return_inverse=True)
    return TrialGrid(
        participants=tuple(map(str, people)),
        scenes=tuple(map(str, scenes)),
        person=person.astype(np.int64),
        scene=place.astype(np.int64),
    )


def one_condition(code: Ints, condition: Ints) -> bool:
    """Return True if each level of a group (trials,) has one condition: no other differs there."""
    return len(set(zip(code.tolist(), condition.tolist(), strict=True))) == np.unique(code).size


def conditions(trials: pd.DataFrame, by: Sequence[str]) -> list[tuple[str, pd.DataFrame]]:
    """Return each condition's name and rows; the name joins the values, ``blur, 10``."""
    if not by:
        return [("all", trials)]
    return [
        (", ".join(_text(value) for value in key), rows)
        for key, rows in trials.groupby(list(by), sort=True, dropna=False)
    ]


def numbered(
    trials: pd.DataFrame, by: Sequence[str]
) -> tuple[list[tuple[str, pd.DataFrame]], Ints]:
    """Return the conditions of a checked table, and of each row which it is of."""
    parts = conditions(trials, by)
    number = np.zeros(len(trials), dtype=np.int64)
    for place, (_, part) in enumerate(parts):
        number[part.index.to_numpy()] = place
    return parts, number


def checked(trials: pd.DataFrame, columns: Sequence[str], by: Sequence[str] = ()) -> pd.DataFrame:
    """Return the table with rows numbered from 0, if statistics can be made of it.

    Raises
    ------
    ValueError
        If it is empty, lacks a column, or has no value where a trial must be grouped.
    """
    wanted = list(dict.fromkeys(("participant", *columns, *by)))
    missing = [column for column in wanted if column not in trials.columns]
    if missing or trials.empty:
        raise ValueError(f"trials must hold rows with the columns {wanted} (missing {missing})")
    grouping = ["participant", *by, *(["scene"] if "scene" in trials.columns else [])]
    for column in grouping:
        empty = trials[column].isna()
        if empty.any():
            raise ValueError(
                f"column {column!r} must have a value in every row"
                f" (row {int(np.argmax(empty.to_numpy())) + 1} has none)"
            )
    for column in columns:
        if column == "correct" and not trials[column].isin((0, 1)).all():
            raise ValueError("column 'correct' must hold 0 and 1 only, in every row")
    return trials.reset_index(drop=True)


def _text(value: object) -> str:
    return f"{value:.15g}" if isinstance(value, float) else str(value)
