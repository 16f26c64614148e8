"""Decisions of other tools."""

from __future__ import annotations

import pytest

from analysis.plain_csv import read_decisions
from analysis.preference import preferences
from protocols.errors import StudyError

PWCMP = {
    "participant": "observer",
    "first": "condition_A",
    "second": "condition_B",
    "chose_first": "is_A_selected",
}
HEADER = "observer,scene,condition_A,condition_B,is_A_selected\n"


@pytest.fixture
def table(tmp_path):
    """Return a writer of a CSV."""

    def write(text, encoding="utf-8"):
        path = tmp_path / "votes.csv"
        path.write_bytes(text.encode(encoding) if isinstance(text, str) else text)
        return path

    return write


def test_a_table_of_pwcmp_is_read_by_naming_its_columns(table):
    path = table(HEADER + "o1,park,ours,pp,1\no1,park,pp,ours,0\no2,park,ours,pp,0\n")

    rows = read_decisions(path, PWCMP)

    assert list(rows["chosen"]) == ["ours", "ours", "pp"]
    assert list(rows["rejected"]) == ["pp", "pp", "ours"]
    assert list(rows["order"]) == [1, 2, 1]
    assert preferences(rows).cells[0].chosen == 2


@pytest.mark.parametrize("separator", [";", "\t"])
def test_semicolons_tabs_and_a_byte_order_mark_are_understood(table, separator):
    text = "participant,first,second,chosen\nä,x,y,x\nb,x,y,y\n".replace(",", separator)

    rows = read_decisions(table("\ufeff" + text))

    assert list(rows["participant"]) == ["ä", "b"]
    assert list(rows["chosen"]) == ["x", "y"]


def test_our_own_table_comes_back_as_it_was(tmp_path, make_decisions):
    rows = make_decisions(people=3)
    rows.to_csv(tmp_path / "d.csv", index=False)

    back = read_decisions(tmp_path / "d.csv")

    assert list(back["chosen"]) == list(rows["chosen"])
    assert list(back["order"]) == list(rows["order"])
    assert back["rt_s"].to_list() == pytest.approx(rows["rt_s"].to_list())


@pytest.mark.parametrize(
    ("text", "mapping", "message"),
    [
        (HEADER, PWCMP, "no rows"),
        ("", {}, "CSV table with a header"),
        (HEADER + "o,s,a,b,1\n", {}, "must have the columns participant, first, second"),
        (HEADER + "o,s,a,b,1\n", {**PWCMP, "first": "conditionA"}, "did you mean 'condition_A'"),
        (HEADER + "o,s,a,b,1\n", {"particpant": "observer"}, "did you mean 'participant'"),
        (HEADER + "o,s,a,b,1\no,s,a,b,maybe\n", PWCMP, "line 3: chose_first must be 1 or 0"),
        (HEADER + "o,s,a,a,1\n", PWCMP, "line 2: first and second must differ"),
        (HEADER + ",s,a,b,1\n", PWCMP, "line 2: participant must not be empty"),
        ("participant,first,second,chosen\no,a,b,c\n", {}, "line 2: chosen must be 'a' or 'b'"),
        ("participant,first,second,chosen,rt_s\no,a,b,a,slow\n", {}, "rt_s must be a number"),
    ],
)
def test_what_is_wrong_is_said_with_its_line_and_cure(table, text, mapping, message):
    with pytest.raises(StudyError, match=message):
        read_decisions(table(text), mapping)


def test_text_that_is_not_utf8_is_refused_with_its_line(table):
    with pytest.raises(StudyError, match="line 2: must be UTF-8"):
        read_decisions(table(HEADER.encode() + b"\xe4,s,a,b,1\n"), PWCMP)
