"""Old tables say what they mean: no answer, units, rows and names that are none, and the cures."""

import re
import shlex
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import result_of
from scipy.stats import norm
from typer.testing import Result

from analysis.models.cells import conditions
from analysis.parts.correct import below_guessing, curve_mistake
from analysis.tables.decisions import read_decisions
from analysis.tables.rating_table import read_ratings
from analysis.tables.table import Table
from analysis.tables.trials import read_times, read_trials
from protocols.errors import StudyError
from protocols.tasks.rates import name_of

run = result_of("analysis", env={"COLUMNS": "200"}, catch_exceptions=False)


def said(done: Result) -> str:
    return " ".join(done.output.split())


@pytest.fixture(scope="module")
def trials() -> pd.DataFrame:
    """Answers left and right of four people at five levels, threshold 2.5, with times."""
    rng = np.random.default_rng(5)
    rows = pd.DataFrame(
        product([f"P{n:02}" for n in range(1, 5)], range(8), ("blur", "ours"), (1, 2, 3, 4, 5)),
        columns=["participant", "time", "method", "level"],
    ).drop(columns="time")
    rows["expected"] = rng.choice(["left", "right"], len(rows))
    right = rng.random(len(rows)) < 0.5 + 0.49 * norm.cdf((rows["level"] - 2.5) / 0.8)
    other = rows["expected"].map({"left": "right", "right": "left"})
    rows["answer"] = rows["expected"].where(right, other)
    rows["correct"] = right.astype(int)
    rows["rt_s"] = (0.4 + rng.gamma(3.0, 0.1, len(rows))).round(3)
    return rows


@pytest.fixture
def table(tmp_path):
    """Return a writer of a table, or of a folder with a file for each participant."""

    def write(rows: pd.DataFrame, *, folder: bool = False) -> Path:
        if not folder:
            rows.to_csv(tmp_path / "old.csv", index=False)
            return tmp_path / "old.csv"
        (tmp_path / "old").mkdir(exist_ok=True)
        for who, own in rows.groupby(rows.columns[0]):
            own.to_csv(tmp_path / "old" / f"{who}.csv", index=False)
        return tmp_path / "old"

    return write


@pytest.fixture
def late(trials) -> pd.Series:
    return pd.Series(np.random.default_rng(6).random(len(trials)) < 0.15)


# No answer is never a wrong answer.


@pytest.mark.parametrize("folder", [False, True])
@pytest.mark.parametrize(
    "word",
    [
        "None",
        "null",
        "NA",
        "n/a",
        "#N/A",
        "nan",
        "",
        " ",
        "-",
        "timeout",
        "Time-out",
        "[]",
        "No response",
        "<none>",
        ".",
    ],
)
def test_a_word_for_missing_is_no_wrong_answer_and_is_counted(table, trials, late, word, folder):
    rows = trials.drop(columns=["correct", "rt_s"])
    rows["answer"] = rows["answer"].mask(late, word)
    read = Table(table(rows, folder=folder))
    found = read_trials(read, levels=("level",))

    answered = trials[~late]
    assert found["correct"].tolist() == answered["correct"].tolist()
    assert any(f"left out without an answer: {late.sum()} rows" in note for note in read.notes)


def test_a_word_for_missing_that_the_question_expects_is_an_answer(table, trials):
    rows = trials.replace({"left": "none"})
    assert len(read_trials(table(rows))) == len(rows)


@pytest.mark.parametrize(
    "change",
    [
        lambda rows, late: rows.assign(rt_s=rows["rt_s"].astype(object).mask(late, "")),
        lambda rows, late: rows.assign(rt_s=rows["rt_s"].mask(late, 0)),
        lambda rows, late: rows.assign(rt_s=rows["rt_s"].astype(object).mask(late, "null")).rename(
            columns={"rt_s": "key_resp.rt"}
        ),
        lambda rows, late: rows.drop(columns="rt_s").assign(
            response=np.where(late, "None", np.where(rows["level"] > 2, "f", "j"))
        ),
        lambda rows, late: rows.assign(RT=rows["rt_s"].mask(late, -1)).drop(columns="rt_s"),
        lambda rows, late: rows.drop(columns="rt_s").assign(timed_out=late.astype(int)),
        lambda rows, late: rows.drop(columns="rt_s").assign(responded=~late),
    ],
)
def test_a_timeout_that_counts_as_wrong_is_left_out(table, trials, late, change):
    rows = trials.drop(columns=["expected", "answer"])
    rows["correct"] = rows["correct"].mask(late, 0)
    read = Table(table(change(rows, late)))
    assert read_trials(read)["correct"].tolist() == trials["correct"][~late].tolist()
    assert f"left out without an answer: {late.sum()} rows" in read.notes[-1]


def test_right_answers_without_a_key_are_kept_as_are_wrong_ones(table, trials):
    """Not to press is right where there is nothing: an empty key then tells nothing."""
    rows = trials.drop(columns=["expected", "answer", "rt_s"])
    rows["key"] = np.where(rows["level"] > 2, "space", "")
    read = Table(table(rows))
    assert len(read_trials(read)) == len(rows)
    assert "key is empty in" in read.notes[-1]


def test_times_of_right_answers_alone_do_not_make_all_others_timeouts(table, trials):
    rows = trials.drop(columns=["expected", "answer"]).rename(columns={"rt_s": "rt"})
    rows["rt"] = rows["rt"].astype(object).mask(rows["correct"] == 0, "")
    with pytest.raises(StudyError) as refused:
        read_trials(table(rows))
    wheres = re.findall(r"--where '([^']+)'", str(refused.value))
    left = [len(read_trials(Table(table(rows), where=(one,)))) for one in wheres]
    assert left == [trials["correct"].sum(), len(trials)]


def test_missing_choices_and_ratings_are_left_out_but_methods_and_steps_of_the_name_are_not(table):
    pairs = [{"first": "a", "second": "b"}, {"first": "b", "second": "a"}]
    rows = pd.DataFrame([{"participant": f"P{n}", **pairs[n % 2], "chosen": "a"} for n in range(8)])
    rows.loc[2, "chosen"] = "None"
    assert len(read_decisions(table(rows))) == 7
    none = rows.replace({"b": "none"}).assign(chosen="none")
    assert len(read_decisions(table(none))) == 8
    rated = pd.DataFrame({"participant": rows["participant"], "method": rows["first"]})
    rated["rating"] = ["1", "2", "n/a", "4", "5", "3", "null", "2"]
    assert len(read_ratings(table(rated), by="method")) == 6
    words = rated.assign(rating=["none", "some"] * 4)
    assert len(read_ratings(table(words), by="method", scale=("none", "some"))) == 8


def jspsych(trials: pd.DataFrame, late: pd.Series) -> pd.DataFrame:
    """Milliseconds, true and false, null, and a row of another kind before each trial."""
    rows = pd.DataFrame(
        {
            "subject": trials["participant"],
            "condition": trials["method"],
            "rt": (1000 * trials["rt_s"]).round().astype(int).astype(str).mask(late, "null"),
            "response": trials["answer"].mask(late, "null"),
            "correct": trials["correct"].map({1: "true", 0: "false"}).mask(late, "false"),
        }
    )
    pages = rows.assign(condition="", rt="null", response="null", correct="")
    return pd.concat([pages, rows]).sort_index(kind="stable").reset_index(drop=True)


@pytest.mark.parametrize("folder", [False, True])
def test_reaction_reads_what_jspsych_writes(table, trials, late, folder):
    path = table(jspsych(trials, late), folder=folder)
    refused = run("reaction", path, "--by", "condition", "--map", "participant=subject",
                  "--map", "rt_s=rt", status=2)  # fmt: skip
    cure = re.search(r"--map rt_s=rt:ms", said(refused))
    assert cure
    done = run(
        "reaction", path, "--by", "condition", "--map", "participant=subject", *cure[0].split()
    )
    assert f"{(~late).sum()} reaction times of 4 participants" in said(done)
    assert f"left out without an answer: {len(trials) + late.sum()} rows" in said(done)
    control = trials[~late].rename(columns={"method": "condition"})
    path = table(control[["participant", "condition", "rt_s", "correct"]])
    plain = run("reaction", path, "--by", "condition", status=None).output.splitlines()
    assert [line for line in plain if "note" not in line] == [
        line for line in done.output.splitlines() if "note" not in line
    ]


# Units.


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1 / 60, "min")])
def test_times_of_another_unit_are_refused_and_the_cure_makes_seconds_of_them(
    table, trials, factor, unit
):
    path = table(trials.assign(rt_s=trials["rt_s"] * factor))
    for read in (read_trials, lambda one: read_times(one, by="method")):
        with pytest.raises(StudyError, match=f"seconds .*: --map rt_s=rt_s:{unit}"):
            read(Table(path))
    found = read_trials(Table(path, {"rt_s": f"rt_s:{unit}"}))
    assert found["rt_s"].to_numpy() == pytest.approx(trials["rt_s"].to_numpy())


def test_numbers_with_their_unit_behind_name_the_cure_and_it_works(table, trials):
    milliseconds = (1000 * trials["rt_s"]).round().astype(int).astype(str) + " ms"
    shares = (10 * trials["level"]).astype(str) + "%"
    for column, values, unit in (("rt_s", milliseconds, "ms"), ("level", shares, "percent")):
        path = table(trials.assign(**{column: values}))
        with pytest.raises(
            StudyError, match=f"must be a number .*: --map {column}={column}:{unit}"
        ):
            read_trials(path, levels=("level",))
        found = read_trials(Table(path, {column: f"{column}:{unit}"}), levels=("level",))
        right = trials[column] * (0.1 if column == "level" else 1.0)
        assert found[column].to_numpy() == pytest.approx(right.to_numpy())


def test_a_unit_in_a_columns_name_is_used_and_noted(table, trials):
    rows = trials.rename(columns={"rt_s": "RT (ms)"})
    rows["RT (ms)"] *= 1000
    read = Table(table(rows), {"rt_s": "RT (ms)"})
    assert read_trials(read)["rt_s"].to_numpy() == pytest.approx(trials["rt_s"].to_numpy())
    assert "RT (ms) read in ms, as its name says" in read.notes


def test_a_single_participant_in_milliseconds_is_named(table, trials):
    rows = trials.copy()
    rows.loc[rows["participant"] == "P03", "rt_s"] *= 1000
    with pytest.raises(StudyError, match=r"median of P03 is .*--where 'participant!=CODE'"):
        read_trials(table(rows, folder=True))
    assert len(read_trials(Table(table(rows), where=("participant!=P03",)))) == 240


def test_angles_and_shares_that_cannot_be_are_refused_with_a_cure_that_works(table, trials):
    path = table(trials.assign(ecc_deg=100 * trials["level"], grey_share=10 * trials["level"]))
    with pytest.raises(StudyError, match=r"degrees .*--map ecc_px=ecc_deg"):
        read_trials(path, levels=("ecc_deg",))
    assert len(read_trials(Table(path, {"ecc_px": "ecc_deg"}), levels=("ecc_px",)))
    with pytest.raises(StudyError, match=r"0 to 1 .*: --map grey_share=grey_share:percent"):
        read_trials(path, levels=("grey_share",))
    read = Table(path, {"grey_share": "grey_share:percent"})
    assert read_trials(read, levels=("grey_share",))["grey_share"].max() == 0.5
    with pytest.raises(StudyError, match=r"must end in one of s, ms, .*'hours'"):
        Table(path, {"rt_s": "rt_s:hours"})


@pytest.mark.parametrize(
    ("column", "code"), [("rt_s", 99), ("rt_s", 999), ("level", 999), ("level", -99)]
)
def test_codes_for_missing_numbers_are_refused_and_where_leaves_them_out(
    table, trials, late, column, code
):
    path = table(trials.assign(**{column: trials[column].mask(late, code)}))
    with pytest.raises(StudyError) as refused:
        read_trials(path, levels=("level",))
    wheres = re.findall(r"--where '([^']+)'", str(refused.value))
    assert len(wheres) == 2
    left = [len(read_trials(Table(path, where=(one,)), levels=("level",))) for one in wheres]
    assert left == [(~late).sum(), len(trials)]


@pytest.mark.parametrize("code", [99, 55, -1, 9])
def test_a_rating_far_from_the_scale_is_refused(table, code):
    rows = pd.DataFrame(
        product(range(5), "abcd", ("x", "y")), columns=["participant", "scene", "m"]
    )
    rows["rating"] = [1 + n % 5 for n in range(len(rows))]
    rows.loc[[3, 17], "rating"] = code
    with pytest.raises(StudyError, match=f"line 5: rating must be a value like .*got {code} in 2"):
        read_ratings(table(rows), by="m")
    kept = read_ratings(Table(table(rows), where=(f"rating!={code}",)), by="m")
    assert sorted(set(kept["rating"])) == [1, 2, 3, 4, 5]
    with pytest.raises(StudyError, match="rating must be one of 1, 2, 3, 4, 5"):
        read_ratings(table(rows), by="m", scale=tuple("12345"))


# A column called condition.


def test_detection_by_a_column_called_condition_splits(table):
    rows = [
        (f"P{p}", condition, expected, answer)
        for p, condition, expected in product(range(8), "ab", ("yes", "no"))
        for answer in (expected, "yes" if condition == "a" else expected)
    ]
    path = table(pd.DataFrame(rows, columns=["participant", "condition", "expected", "answer"]))
    done = run("detection", path, "--by", "condition", status=None)
    assert re.search(r"\n a +16 / 16 +8 / 16", done.output)
    assert re.search(r"\n b +16 / 16 +0 / 16", done.output)
    assert "b minus a" in done.output


@pytest.mark.parametrize("kind", [int, float])
def test_values_of_many_digits_are_conditions_of_their_own(kind):
    sizes = [kind(size) for size in (20240101, 20240102)]
    rows = pd.DataFrame({"size": sizes, "method": "ours"})

    assert [name for name, _ in conditions(rows, ["size", "method"])] == [
        "20240101, ours", "20240102, ours",
    ]  # fmt: skip
    assert [name_of(size) for size in sizes] == ["20240101", "20240102"]
    assert [name_of(size) for size in (5.0, 0.1, 2, True)] == ["5", "0.1", "2", "true"]


def test_a_report_compares_a_column_called_condition(table, trials):
    rows = trials.rename(columns={"method": "condition"}).drop(columns="rt_s")
    path = table(rows)
    out = path.parent / "in"
    options = ("--task", "identification", "--set", "by=condition")
    run("import", path, *options, "--out", out)
    done = run("report", out / "decisions.csv", "--no-figures", "--out", path.parent / "report")
    assert "ours minus blur" in done.output
    assert "no decisions of" not in done.output
    refused = run("import", path, "--task", "identification", "--set", "level=condition", "--out",
                  path.parent / "x", "--map", "condition=level", status=2)  # fmt: skip
    assert "--set level=condition: must not be 'condition'" in said(refused)


# Which answer, and whether it was right.


def test_answer_names_keys_and_expected_with_correct_determines_the_answer(table, trials):
    path = table(trials.replace({"answer": {"left": "f", "right": "j"}}).drop(columns="correct"))
    refused = run("detection", path, "--signal", "left", status=2)
    assert "expected holds left, right; answer f, j" in said(refused)
    assert "--answer f=...,j=..." in said(refused)
    done = run("detection", path, "--signal", "left", "--answer", "f=left,j=right")
    plain = run("detection", table(trials), "--signal", "left", status=None)
    derived = run(
        "detection", table(trials.drop(columns="answer")), "--signal", "left", status=None
    )
    assert "no column answer: it follows from expected and correct" in said(derived)
    results = [
        [line for line in one.output.splitlines() if "note" not in line]
        for one in (plain, done, derived)
    ]
    assert results[0] == results[1] == results[2]
    wrong = run("detection", table(trials), "--signal", "left", "--answer", "g=left", status=None)
    assert "must be an answer that the column answer holds (left, right)" in said(wrong)


def test_answers_written_otherwise_than_expected_are_refused_with_the_cure(table, trials):
    path = table(trials.assign(answer=trials["answer"].str.title()))
    with pytest.raises(StudyError) as refused:
        read_trials(path)
    cure = re.search(r"--answer (\S+)", str(refused.value))
    assert cure
    answers = dict(one.split("=") for one in cure[1].split(","))
    assert (
        read_trials(Table(path, answers=answers))["correct"].tolist() == trials["correct"].tolist()
    )


def test_correct_that_holds_the_right_answer_is_refused_and_yes_and_no_are_noted(table, trials):
    yes = trials.replace({"left": "yes", "right": "no"})
    asked = table(yes.assign(correct=yes["expected"]).drop(columns="expected"))
    with pytest.raises(StudyError, match="--map expected=correct --map answer=answer"):
        read_trials(asked)
    read = Table(asked, {"expected": "correct", "answer": "answer"})
    assert read_trials(read)["correct"].tolist() == trials["correct"].tolist()
    with pytest.raises(StudyError, match="if it holds the right answer, --map expected=COLUMN"):
        read_trials(table(trials.assign(correct=trials["expected"])))
    judged = trials.drop(columns=["expected", "answer"])
    judged["correct"] = judged["correct"].map({1: "Yes", 0: "No"})
    read = Table(table(judged))
    assert read_trials(read)["correct"].tolist() == trials["correct"].tolist()
    assert "correct says no and yes: read as right and wrong" in read.notes
    assert len(read_trials(table(judged.assign(glasses="no")))) == len(trials)


def test_errors_coded_one_falling_curves_and_four_answers_are_told_apart(trials):
    def mistake(rows, guess=0.5, *, falling=False):
        return curve_mistake(rows, "level", guess, falling=falling)

    rng = np.random.default_rng(0)
    four = 0.25 + 0.74 * norm.cdf((trials["level"] - 2.5) / 0.8)
    guessed = trials.assign(correct=(rng.random(len(trials)) < four).astype(int))
    assert mistake(trials) == ""
    assert mistake(trials.assign(level=-trials["level"]), falling=True) == ""
    assert mistake(guessed, 0.25) == ""
    assert mistake(guessed, None) == ""
    assert "--map correct=COLUMN:errors" in mistake(trials.assign(correct=1 - trials["correct"]))
    assert mistake(trials.assign(level=-trials["level"])).endswith("say --falling")
    assert mistake(trials, falling=True).endswith("leave --falling away")
    assert "say --guess 0.25 if there were four answers, or --guess fit" in mistake(guessed)
    assert below_guessing(trials.assign(correct=1 - trials["correct"]), 0.5)
    assert not below_guessing(trials, 0.5)


def test_each_command_says_that_answers_are_below_guessing_and_errors_turn(table, trials):
    path = table(trials.assign(correct=1 - trials["correct"]).drop(columns=["expected", "answer"]))
    refused = run("psychometric", path, "--level", "level", status=2)
    out = path.parent / "in"
    imported = run("import", path, "--task", "identification", "--set", "alternatives=2",
                   "--out", out, status=None)  # fmt: skip
    for done in (refused, run("reaction", path, status=None), imported):
        assert "answers are below guessing" in said(done)
    again = Table(path, {"correct": "correct:errors"})
    assert read_trials(again)["correct"].tolist() == trials["correct"].tolist()


# Rows.


@pytest.mark.parametrize("timed", [True, False])
def test_rows_that_were_pasted_twice_are_refused_by_every_reader(table, trials, timed):
    rows = trials if timed else trials.drop(columns="rt_s")
    third = rows[rows["participant"] == "P03"]
    for parts in ([rows, rows], [rows, third]):
        with pytest.raises(StudyError, match=r"must not repeat other rows"):
            Table(table(pd.concat(parts)))
    if timed:
        with pytest.raises(StudyError, match=r"must not repeat other rows"):
            Table(table(pd.concat([rows, rows]).sort_values(["participant", "rt_s"])))
    for n in range(8):  # once is no chance, twice is
        rows = rows.assign(note=f"n{n}" if n else "")
    assert len(Table(table(pd.concat([rows, rows.assign(note="again")]))).rows) == 640


def test_a_file_that_lies_twice_in_a_folder_is_refused(table, trials):
    path = table(trials, folder=True)
    assert len(Table(path).rows) == len(trials)
    (path / "P02 copy.csv").write_bytes((path / "P02.csv").read_bytes())
    with pytest.raises(StudyError, match=r"must hold rows of its own \(they are those of P02"):
        Table(path)


def test_headers_marks_and_sums_between_rows_are_left_out_and_counted(table, trials):
    path = table(trials)
    text = path.read_text()
    others = text.replace("P0", "Q0")
    path.write_text("\ufeff" + text + "\ufeff" + others + "Mean,,,,,0.8,0.7\n,,,,Total,640,\n")
    read = Table(path)
    assert len(read_trials(read, levels=("level",))) == 640
    assert read.notes[:2] == [
        "left out, the header again: 1 row (line 322)",
        "left out, summary of others: 2 rows (lines 643, 644)",
    ]


@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_tables_with_and_without_marks_are_read(table, trials, code):
    path = table(trials)
    path.write_bytes(path.read_text().encode(code))
    assert len(read_trials(path)) == len(trials)


@pytest.mark.parametrize(
    "date", ["2024-05-01", "2024-05-01 00:00:00", "5-Jan", "45413", "01/05/2024"]
)
@pytest.mark.parametrize("column", ["method", "participant"])
def test_names_that_a_spreadsheet_made_dates_of_are_refused(table, trials, date, column):
    name = trials[column].iloc[0]
    path = table(trials.replace({column: {name: date}}))
    with pytest.raises(StudyError, match=f"{column} must be a name, .*{date}") as refused:
        read_trials(path, conditions=("method",))
    condition = shlex.split(str(refused.value))[-1]
    left = read_trials(Table(path, where=(condition,)), conditions=("method",))
    assert len(left) == (trials[column] != name).sum()


def test_codes_that_look_alike_are_noted(table, trials):
    rows = trials.copy()
    rows["participant"] = ["1", "01", "P01", "p01"] * (len(rows) // 4)
    rows["method"] = np.where(rows.index < 100, "Blur", "blur")
    read = Table(table(rows))
    read_trials(read, conditions=("method",))
    assert "participant '01', '1', 'P01', 'p01' look alike: they count as 4" in read.notes
    assert "method 'Blur', 'blur' look alike: they count as 2" in read.notes
    bids = [f"sub-{n:02}" for n in range(1, 5)]
    plain = Table(table(trials.assign(participant=bids * 80)))
    read_trials(plain, conditions=("method",))
    assert plain.notes == []


def test_an_order_that_comes_twice_is_refused_by_every_reader(table):
    pair = {"participant": "A", "first": "a", "second": "b", "chosen": "a", "order": 1}
    rows = pd.DataFrame([pair, pair | {"chosen": "b"}]).assign(method="m", rating=1, correct=1)
    rows["rt_s"] = [0.5, 0.6]
    readers = (
        read_trials,
        read_decisions,
        lambda path: read_ratings(path, by="method"),
        lambda path: read_times(path, by="method"),
    )
    for read in readers:
        with pytest.raises(StudyError, match="line 3: order must not come twice"):
            read(table(rows))
        assert len(read(table(rows.assign(session=["x", "y"])))) == 2


# Which rows, which columns.


@pytest.mark.parametrize(
    ("condition", "left"),
    [("level>2", 192), ("level>=2", 256), ("level<2", 64), ("level<=2", 128), ("level=2", 64),
     ("level == 2.0", 64), ("level!=2", 256), ("method=ours", 160), ("note=none", 319),
     ("note!=none", 1)],
)  # fmt: skip
def test_where_keeps_the_rows_of_which_it_is_true_and_counts_the_others(
    table, trials, condition, left
):
    read = Table(table(trials.assign(note=["x", *[""] * 319])), where=(condition,))
    assert len(read.rows) == left
    assert f"left out by --where {condition}: {320 - left} row" in read.notes[0]


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("level", "must read COLUMN>0"),
        ("levle>2", "did you mean 'level'"),
        ("method>2", r"must compare numbers \(got 'blur'\)"),
        ("level>two", r"must compare numbers \(got 'two'\)"),
        ("method=our", "must leave a row .*did you mean 'ours'"),
    ],
)
def test_a_condition_that_cannot_be_is_refused(table, trials, condition, message):
    with pytest.raises(StudyError, match=message):
        Table(table(trials), where=(condition,))


def test_where_answer_and_map_are_options_of_every_command_on_tables(table, trials):
    path = table(trials)
    for command in ("psychometric", "detection", "reaction", "ratings", "import"):
        words = ("--level", "level") if command == "psychometric" else ()
        words = (
            ("--out", path.parent / "x", "--task", "identification")
            if command == "import"
            else words
        )
        for option in (
            ("--where", "nothing>1"),
            ("--answer", "nothing=1"),
            ("--map", "rt_s=nothing"),
        ):
            done = run(command, path, *words, *option, status=2)
            assert "nothing" in done.output
    done = run("report", path, "--where", "nothing>1", "--out", path.parent / "x", status=None)
    assert "--where nothing>1: must name a column" in said(done)


def test_contrast_zero_on_a_log_axis_is_left_out_as_the_message_says(table, trials):
    path = table(trials.assign(level=trials["level"] - 1))
    asked = ("psychometric", path, "--level", "level", "--log")
    refused = run(*asked, status=None)
    assert "--where 'level>0'" in said(refused)
    done = run(*asked, "--where", "level>0")
    assert "left out by --where level>0: 64 rows" in said(done)


def test_columns_and_names_of_no_use_are_noted_or_refused(table, trials):
    path = table(trials.rename(columns={"participant": "subject"}).assign(colour="red"))
    with pytest.raises(StudyError, match=r"which column holds it: --map participant=COLUMN; perhaps"
                       " 'subject'"):  # fmt: skip
        read_trials(path, own=False)
    read = Table(path, {"participant": "subject"})
    read_trials(read, levels=("level",), own=False)
    assert "columns that were not used: method, colour" in read.notes
    with pytest.raises(StudyError, match=r"--map colours=colour: must name one of"):
        read_trials(Table(path, {"participant": "subject", "colours": "colour"}), own=False)


def test_practice_catch_and_excluded_rows_are_counted(table, trials):
    kinds = ["practice"] * 3 + ["catch"] * 2 + ["main"] * 315
    read = Table(table(trials.assign(kind=kinds, included=[1] * 318 + [0] * 2)))
    assert len(read_trials(read)) == 313
    assert [note.partition(":")[0] for note in read.notes] == [
        "left out, practice", "left out, catch", "left out, not included",
    ]  # fmt: skip


def test_ties_name_the_command_that_takes_them_and_it_does(table):
    rows = pd.DataFrame(
        product([f"P{n}" for n in range(6)], "abcd"), columns=["participant", "scene"]
    )
    rows = rows.assign(first="ours", second="blur", chosen=["ours", "tie", "blur", "ours"] * 6)
    path = table(rows)
    refused = run("import", path, "--out", path.parent / "x", status=2)
    assert "got 'tie'); 'metamerlab analysis ratings' takes ties" in said(refused)
    assert read_ratings(path)["rating"].tolist() == [1, 0, -1, 1] * 6


def test_what_import_writes_is_what_commands_read(table, trials, late):
    rows = jspsych(trials, late).drop(columns="response")
    path = table(rows)
    out = path.parent / "in"
    maps = ("--map", "participant=subject", "--map", "rt_s=rt:ms")
    task = ("--task", "identification", "--set", "alternatives=2", "--set", "by=condition")
    run("import", path, *task, *maps, "--out", out)
    read = Table(out / "decisions.csv")
    again = read_trials(read, conditions=("condition",))
    assert again["correct"].tolist() == trials["correct"][~late].tolist()
    assert again["rt_s"].to_numpy() == pytest.approx(trials["rt_s"][~late].to_numpy())
    assert read.notes == []


def test_a_table_of_more_columns_than_a_spreadsheet_has_is_refused_at_once(tmp_path):
    file = tmp_path / "wide.csv"
    file.write_text(",".join(f"c{number}" for number in range(16_385)) + "\n")
    with pytest.raises(StudyError, match=r"at most 16,384 columns.*\(has 16,385\)"):
        Table(file)
