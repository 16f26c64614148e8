"""Trials with right answers from other tools' CSV files."""

import numpy as np
import pytest
from made_up_trials import TaskDesign, simulate_abx, simulate_yes_no

from analysis.models.detection import yes_no
from analysis.tables.table import Table
from analysis.tables.trials import read_trials
from protocols.errors import StudyError

HEADER = "participant,scene,method,level,expected,answer\n"
ROW = "p1,park,ours,0.5,open,closed\n"


@pytest.fixture
def table(tmp_path):
    """Return a writer of a CSV."""

    def write(text):
        path = tmp_path / "trials.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_answers_become_correct_and_rows_get_their_order(table):
    rows = read_trials(table(HEADER + ROW + "p1,park,ours,0.5,open,open\n" + ROW))

    assert list(rows["correct"]) == [0, 1, 0]
    assert list(rows["order"]) == [1, 2, 3]
    assert rows["level"].dtype == float
    assert rows["rt_s"].isna().all()


def test_columns_of_other_tools_are_mapped_by_name(table):
    path = table("subj;hit;ecc\nA;TRUE;5\nA;false;10\n")

    rows = read_trials(
        Table(path, {"participant": "subj", "correct": "hit", "eccentricity_deg": "ecc"})
    )

    assert list(rows["correct"]) == [1, 0]
    assert list(rows["eccentricity_deg"]) == [5, 10]


@pytest.mark.parametrize("task", ["yes-no", "abx"])
def test_a_table_written_and_read_gives_the_same_statistics(tmp_path, rng, task):
    made = (
        simulate_yes_no(TaskDesign(4, 2, 3), {"a": 1.0}, rng)
        if task == "yes-no"
        else simulate_abx(TaskDesign(4, 2, 3), {"a": 0.2}, rng, scalings=[0.1, 0.3])
    )
    path = tmp_path / "out.csv"
    made.to_csv(path, index=False)
    back = read_trials(path, conditions=("method",))

    assert set(back.columns) == set(made.columns)
    for column in made.columns:
        assert list(back[column]) == list(made[column]), column
    if task == "yes-no":
        assert yes_no(back, ("method",), signal="inconsistent") == yes_no(
            made, ("method",), signal="inconsistent"
        )


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("", {}, "with a header"),
        ("participant,correct\n", {}, "at least one trial"),
        ("participant,level\na,1\n", {}, r"correct \(or expected, answer\).*--map correct"),
        ("participant,expected\na,x\n", {}, "must have the columns answer"),
        ("person,correct\na,1\n", {}, "must have the columns participant.*found: person, correct"),
        ("participant,correct\na,1\n", {"levels": ("level",)}, "must have the columns level"),
        ("participant,correct\na,1\nb,maybe\n", {}, "line 3: correct must be 1 or 0.*'maybe'"),
        ("participant,correct\n,1\n", {}, "line 2: participant must not be empty"),
        ("participant,correct\na,1,\n", {}, r"line 2: must have 2 cells.*found 3"),
        ("participant,correct\n\na,1\nb\n", {}, r"line 4: must have 2 cells.*found 1"),
        ("participant,correct,correct\na,1,1\n", {}, "names of their own"),
        ("participant,correct,rt_s\na,1,-1\n", {}, r"line 2: rt_s must be above 0"),
        ("participant,correct,rt_s\na,1,inf\n", {}, r"line 2: rt_s must be a number"),
        ("participant,correct,rt_s\na,1,1e999\n", {}, r"line 2: rt_s must be a number"),
        ("participant,correct,order\na,1,1.5\n", {}, r"line 2: order must be a whole"),
        ("participant,correct,order\na,1,1e30\n", {}, r"line 2: order must be a whole"),
        ("participant,correct,order\na,1,1\na,0,1\n", {}, r"line 3: order must not come twice"),
        (
            "participant,correct,level\na,1,high\n",
            {"levels": ("level",)},
            "line 2: level must be a number",
        ),
        (
            "participant,correct,level\na,1,\n",
            {"levels": ("level",)},
            "line 2: level must not be empty",
        ),
        (
            "participant,correct,method\na,1,\n",
            {"conditions": ("method",)},
            "line 2: method must not be empty",
        ),
        (HEADER + ROW + "p1,park,ours,0.5,Open,open\n", {}, "write an answer in one way"),
        (
            "participant,expected,answer,correct\na,x,y,1\n",
            {},
            "line 2: correct must agree with expected and answer",
        ),
    ],
)
def test_mistakes_are_told_with_place_value_and_cure(table, text, options, message):
    with pytest.raises(StudyError, match=message):
        read_trials(table(text), **options)


def test_an_unknown_mapping_suggests_the_nearest_column(table):
    with pytest.raises(StudyError, match="did you mean 'subject'"):
        read_trials(Table(table("subject,correct\na,1\n"), {"participant": "subjet"}))


def test_line_numbers_hold_where_lines_are_blank_and_cells_have_breaks(table):
    text = 'participant,correct,note\na,1,"two\nlines"\n\nb,5,x\n'
    with pytest.raises(StudyError, match="line 5: correct"):
        read_trials(table(text))


def test_a_hundred_thousand_rows_are_read(table):
    rows = read_trials(table("participant,correct,level\n" + "a,1,2.5\n" * 100_000))

    assert len(rows) == 100_000
    assert np.all(rows["level"] == 2.5)
