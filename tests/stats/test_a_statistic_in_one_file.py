"""A statistic that does not ship, `median_differences`: one file, and a report tells all of it."""

import importlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.report.content import content_of
from analysis.report.report_source import from_question
from analysis.tables.table import Table
from analysis.tasks import analysis_of

FOLDER = Path(__file__).parents[1] / "one_statistic"
NAME = "median_differences"


@pytest.fixture
def told(monkeypatch, tmp_path):
    """Content of a report of reaction times with the statistic alone."""
    monkeypatch.syspath_prepend(str(FOLDER))
    part = importlib.import_module(NAME).MedianDifferencesPart
    monkeypatch.setattr("analysis.parts.ADDED", {NAME: part})
    people = np.repeat([f"p{number}" for number in range(8)], 6)
    slower = np.tile([0.0, 0.1], 24)
    own = np.repeat(np.arange(8) / 100, 6)
    table = pd.DataFrame(
        {
            "participant": people,
            "scene": "x",
            "method": np.where(slower > 0, "slow", "fast"),
            "rt_s": 0.5 + own + slower * (1 + 10 * own),
        }
    )
    path = tmp_path / "times.csv"
    table.to_csv(path, index=False)
    analysis = analysis_of("reaction")
    return content_of(
        from_question(analysis, Table(path), analysis.options(by="method"), only=(NAME,))
    )


def test_it_is_one_file():
    assert [path.name for path in FOLDER.iterdir() if path.is_file()] == [f"{NAME}.py"]


def test_a_report_holds_its_numbers_its_table_and_its_words(told):
    """By hand: person k differs by 0.1 (1 + k / 10) s; of eight, limits are the ends."""
    (pair,) = told.numbers[NAME]["pairs"]
    assert pair["difference_s"] == pytest.approx(-0.135)
    assert (pair["lower"], pair["upper"]) == (pytest.approx(-0.17), pytest.approx(-0.1))
    table = told.tables[f"{NAME}.csv"]
    assert list(table) == ["first", "second", "difference_s", "lower", "upper", "participants"]
    assert any("had a median of" in text for text in told.sentences)
    assert "order statistics" in told.methods
    assert any(section.name == "checks" for section in told.sections)
