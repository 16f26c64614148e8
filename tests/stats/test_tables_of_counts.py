"""Square tables of counts, imported as the decisions that they count."""

from pathlib import Path

import pandas as pd
import pytest
from command_line import metamerlab

from analysis.models.order_and_side import came_both_ways
from analysis.parts.bias import BiasPart

WINS = "won over,a,b,c\nc,5,4,-\na,-,7,2\nb,3,9,1\n"
"""Rows in another order than columns; the diagonal counts nothing."""


def imported(tmp_path: Path, table: Path, *more: str) -> tuple[pd.DataFrame, str]:
    words = ["analysis", "import", str(table), "--out", str(tmp_path / "imported"), *more]
    done = metamerlab(*words)
    rows = pd.read_csv(tmp_path / "imported/decisions.csv", dtype=str, keep_default_na=False)
    return rows, " ".join(done.stdout.split())


def test_every_choice_that_is_counted_becomes_a_decision(tmp_path):
    (tmp_path / "wins.csv").write_text(WINS)
    rows, said = imported(tmp_path, tmp_path / "wins.csv")
    counts = rows.groupby(["chosen", "rejected"]).size().to_dict()
    assert counts == {
        ("a", "b"): 7, ("a", "c"): 2, ("b", "a"): 3, ("b", "c"): 1, ("c", "a"): 5, ("c", "b"): 4,
    }  # fmt: skip
    assert "counts of 22 decisions, won over's was chosen over the column's" in said
    assert (
        "says neither who decided (all stand as the participant 'wins') nor in which order" in said
    )
    assert set(rows["participant"]) == {"wins"}


def test_a_folder_of_counts_has_a_participant_a_file(tmp_path):
    folder = tmp_path / "people"
    folder.mkdir()
    (folder / "P01.csv").write_text(WINS)
    (folder / "P02.csv").write_text(",a,b,c\na,0,1,1\nb,2,0,1\nc,0,3.0,0\n")
    rows, _ = imported(tmp_path, folder)
    assert rows.groupby("participant").size().to_dict() == {"P01": 22, "P02": 8}
    assert not BiasPart().wanted(rows, None), "counts do not say which came first"


def test_counts_of_answers_are_right_on_the_diagonal(tmp_path):
    (tmp_path / "seen.csv").write_text("expected,left,right\nleft,8,2\nright,1,9\n")
    rows, said = imported(tmp_path, tmp_path / "seen.csv", "--task", "identification")
    assert rows.groupby("correct").size().to_dict() == {"1": 17, "0": 3}
    assert "the column was answered where the row was right" in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (",a,b\na,0,1.5\nb,2,0\n", "line 2: a count must be a whole number (got '1.5', a by b)"),
        (",a,b\na,0,-3\nb,2,0\n", "line 2: a count must be a whole number (got '-3', a by b)"),
        (",a,b\na,0,0\nb,0,9\n", "must count at least one decision"),
        (",a,b\na,0,999999999999\nb,2,0\n", "cells"),
        (",a,b\na,0,1\nc,2,0\n", "must have the columns participant"),
        (",a,b,total\na,0,7,7\nb,3,0,3\ntotal,3,7,10\n", "row and column 'total' are those"),
        (",a,b,Summe\na,-,7,7\nb,3,-,3\nSumme,3,7,10\n", "row and column 'Summe' are those"),
        (",a,b,all\na,2,7,9\nb,3,2,5\nall,5,9,\n", "row and column 'all' are those"),
        (",a,b,n\na,0,7,7\nb,3,0,3\n", "a row and a column of each name, once (got n otherwise)"),
        (",a,b\na,0,7\nb,3,0\nsum,3,7\n", "each name, once (got sum otherwise); leave sums away"),
        (",a,b\na,0,70%\nb,30%,0\n", "(got '70%', a by b); give how often, no shares"),
    ],
)
def test_what_is_no_count_or_a_sum_or_share_among_them_is_told(tmp_path, text, said):
    (tmp_path / "wins.csv").write_text(text)
    words = ["analysis", "import", str(tmp_path / "wins.csv"), "--out", str(tmp_path / "out")]
    done = metamerlab(*words, status=2)
    assert said in " ".join(done.stderr.split())
    assert not (tmp_path / "out").exists()


def test_an_order_is_known_only_where_a_pair_came_both_ways():
    one = pd.DataFrame({"first": ["a", "a", "b"], "second": ["b", "c", "c"]})
    assert not came_both_ways(one)
    assert came_both_ways(pd.concat([one, pd.DataFrame({"first": ["c"], "second": ["b"]})]))


def test_counts_that_add_up_by_chance_are_taken(tmp_path):
    (tmp_path / "wins.csv").write_text(",a,b,c\na,0,5,5\nb,7,0,7\nc,7,5,0\n")
    assert len(imported(tmp_path, tmp_path / "wins.csv")[0]) == 36
