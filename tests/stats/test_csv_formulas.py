"""CSV tables that spreadsheets show and do not run."""

import csv

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.tables.decisions import read_decisions
from analysis.tables.table import Table
from analysis.tables.table_files import write_table
from analysis.tidy import read_sessions, write_tables
from protocols.outside import original_cell, safe_cell

BEGINNINGS = ("=", "+", "-", "@", "\t", "\r", "\x00", "\x1b", "\x7f")


@pytest.mark.parametrize("beginning", BEGINNINGS)
@pytest.mark.parametrize("before", ["", "'", "''"])
def test_no_text_cell_begins_like_a_formula(beginning, before):
    text = f"{before}{beginning}HYPERLINK(1)"

    assert safe_cell(text) == "'" + text
    assert original_cell(safe_cell(text)) == text


@given(st.text())
def test_every_text_comes_back_as_it_was(text):
    written = safe_cell(text)

    assert original_cell(written) == text
    assert written == text or text.lstrip("'")[:1] in BEGINNINGS or ord(text.lstrip("'")[0]) < 32


def test_numbers_and_plain_texts_stay_as_they_are(tmp_path):
    table = pd.DataFrame(
        {"d": [-1.5, np.nan], "n": [-2, 3], "who": ["it's", "'quoted'"], "=x": ["a=b", "-c"]}
    )
    write_table(table, tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.reader(file))

    assert rows == [
        ["d", "n", "who", "'=x"],
        ["-1.5", "-2", "it's", "a=b"],
        ["", "3", "'quoted'", "'-c"],
    ]
    read = Table(tmp_path / "t.csv").rows
    assert list(read.columns) == ["d", "n", "who", "=x"]
    assert list(read["=x"]) == ["a=b", "-c"]


def test_methods_named_like_formulas_survive_an_export_and_an_import(tmp_path):
    rows = pd.DataFrame(
        {"participant": ["@p", "p2"], "first": "=1+1", "second": "b", "chosen": ["=1+1", "b"]}
    )
    rows.to_csv(tmp_path / "raw.csv", index=False)
    once = read_decisions(tmp_path / "raw.csv")
    write_table(once, tmp_path / "ours.csv")
    again = read_decisions(tmp_path / "ours.csv")

    text = (tmp_path / "ours.csv").read_text()
    assert ",=1+1" not in text
    assert "'=1+1" in text
    for column in ("participant", "first", "chosen", "rejected"):
        assert list(again[column]) == list(once[column])


def test_an_answer_typed_as_a_formula_is_written_as_text(tmp_path, write_journals, demo_protocol):
    folder = write_journals(tmp_path / "in", people=1, answer='=HYPERLINK("x")')
    (tmp_path / "out").mkdir()
    write_tables(read_sessions(folder, demo_protocol), demo_protocol, tmp_path / "out")
    with (tmp_path / "out" / "answers.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)

    assert row["text"] == '\'=HYPERLINK("x")'
