"""What such an analysis hands back, and the folder it becomes."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from analysis.plots import ONE_COLUMN_IN, TWO_COLUMNS_IN, save_figure
from analysis.report.values import as_json
from analysis.tables.write import write_table
from protocols.outside import json_bytes

Progress = Callable[[str, int, int], object]
RESULTS = "results.json"


@dataclass(frozen=True)
class Found:
    """The answer, ready to print, to draw and to write.

    Attributes
    ----------
    title : str
        What was analysed.
    shown : DataFrame
        The table to print: texts, one row per condition.
    sentences, notes : tuple of str
        Results ready to paste; when not to trust them.
    tables : mapping of file name to DataFrame
    figures : mapping of name to callable
        From a width in inches to the figure.
    result : object
        Every number, for `results.json`.
    """

    title: str
    shown: pd.DataFrame
    sentences: tuple[str, ...]
    notes: tuple[str, ...]
    tables: Mapping[str, pd.DataFrame]
    figures: Mapping[str, Callable[[float], Figure]]
    result: object


def write_found(found: Found, folder: Path) -> None:
    """Write tables, figures at both widths, and every number as JSON into a folder."""
    for name, table in found.tables.items():
        write_table(table, folder / name)
    for name, draw in found.figures.items():
        for kind, width in (("1-column", ONE_COLUMN_IN), ("2-column", TWO_COLUMNS_IN)):
            save_figure(draw(width), folder, f"{name}-{kind}")
    content = {
        "title": found.title,
        "sentences": list(found.sentences),
        "notes": list(found.notes),
        "result": as_json(found.result),
    }
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False)
    (folder / RESULTS).write_bytes(json_bytes(text + "\n"))
