"""Decisions of other tools."""

import pandas as pd
import pytest

from analysis.models.preference import preferences
from analysis.tables.decisions import read_decisions
from analysis.tables.table import Table
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

    rows = read_decisions(Table(path, PWCMP))

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
        ("sep=;\n" + HEADER, PWCMP, "line 1: must be the header .*delete this line"),
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
        read_decisions(Table(table(text), mapping))


def test_text_that_is_not_utf8_is_read_and_it_is_noted(table):
    rows = Table(table(HEADER.encode() + b"\xe4,s,a,b,1\n"), PWCMP)
    assert list(read_decisions(rows)["participant"]) == ["ä"]
    assert "read as Windows' Latin-1" in rows.notes[0]


GOOD = [
    {"participant": f"P{n % 4}", "scene": f"s{n % 2}", "size": "x", "first": "a", "second": "b",
     "chosen": "a" if n % 3 else "b"}
    for n in range(8)
]  # fmt: skip


def csv_of(tmp_path, column, value):
    rows = pd.DataFrame(GOOD)
    rows[column] = [value, *(rows[column][1:] if column in rows else ["1"] * 7)]
    path = tmp_path / "votes.csv"
    rows.to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("order", "1.5", "line 2: order must be a whole number from 0 on (got '1.5')"),
        ("order", "1e30", "line 2: order must be a whole number from 0 on (got '1e30')"),
        ("order", "9" * 5000, "(got '" + "9" * 60 + "...')"),
        ("order", "inf", "order must be a number (got 'inf')"),
        ("repeat", "-1", "repeat must be a whole number from 0 on"),
        ("simulated", ".5", "line 2: simulated must be 1 or 0 (got '.5')"),
        ("rt_s", "inf", "rt_s must be a number"),
        ("rt_s", "1e308", "rt_s must be above 0 seconds and below a day (got '1e308')"),
        ("rt_s", "-1", "rt_s must be above 0 seconds and below a day"),
        ("included", "", "line 2: included must be 1 or 0 (got '')"),
        ("included", "2", "included must be 1 or 0"),
        ("chose_first", "1", "line 2: chosen and chose_first must say the same"),
        ("size", "all", "a size must not be called 'all' beside others"),
        ("scene", " ", "line 2: scene must not be empty"),
    ],
)
def test_cells_that_would_give_silent_wrong_numbers_are_refused(tmp_path, column, value, message):
    with pytest.raises(StudyError) as caught:
        read_decisions(csv_of(tmp_path, column, value))

    assert message in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("kind", ["Main", "MAIN ", "test"])
def test_a_kind_is_written_as_we_write_it(tmp_path, kind):
    path = tmp_path / "votes.csv"
    pd.DataFrame(GOOD).assign(kind=["main"] * 7 + [kind]).to_csv(path, index=False)
    with pytest.raises(StudyError, match=r"line 9: kind must be one of main, practice, catch"):
        read_decisions(path)


def test_a_scene_with_a_blank_behind_its_name_is_the_same_scene(tmp_path):
    rows = read_decisions(csv_of(tmp_path, "scene", "s0 "))

    assert set(rows["scene"]) == {"s0", "s1"}
