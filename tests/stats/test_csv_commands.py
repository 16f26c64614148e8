"""`analysis psychometric`, `detection` and the others of one CSV: what they say and write."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import result_of
from scipy.stats import norm
from typer.main import get_group

from analysis.tasks import analysis_of
from study_app.cli import analysis_commands

run = result_of("analysis", env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def acuity(tmp_path_factory) -> Path:
    """Thresholds 16 and 11 deg, falling, of four people."""
    rng = np.random.default_rng(0)
    shown = product(range(4), ("plain", "blur"), (4, 8, 12, 16, 20), range(14))
    rows = pd.DataFrame(shown, columns=["who", "method", "ecc", "time"])
    person = rows["who"].map(dict(enumerate(rng.normal(0, 1, 4))))
    place = rows["method"].map({"plain": 16.0, "blur": 11.0}) + person
    right = 0.5 + 0.49 * norm.sf((rows["ecc"] - place) / 3.0)
    rows["hit"] = (rng.random(len(rows)) < right).astype(int)
    file = tmp_path_factory.mktemp("acuity") / "acuity.csv"
    rows.drop(columns="time").to_csv(file, index=False)
    return file


@pytest.fixture(scope="module")
def seen(tmp_path_factory) -> Path:
    """d' 2 and 0.5 of six people."""
    rng = np.random.default_rng(1)
    shown = product(range(6), "abcd", ("blur", "ours"), (True, False), range(6))
    rows = pd.DataFrame(shown, columns=["participant", "scene", "method", "there", "time"])
    apart = rows["method"].map({"blur": 2.0, "ours": 0.5})
    evidence = apart * (rows["there"] - 0.5) + rng.standard_normal(len(rows))
    for name, said in (("truth", rows["there"]), ("said", evidence > 0)):
        rows[name] = np.where(said, "seen", "unseen")
    file = tmp_path_factory.mktemp("seen") / "seen.csv"
    rows.drop(columns=["time", "there"]).to_csv(file, index=False)
    return file


@pytest.mark.parametrize("kind", ["psychometric", "detection", "reaction", "ratings"])
def test_what_a_command_asks_is_what_the_format_of_its_kind_says(kind):
    told = analysis_of(kind).options
    given = get_group(analysis_commands.app).commands[kind].params
    common = {"table", "columns", "where", "answer", "coverage", "out", "figures", "replace"}
    own = {one.name: one for one in given if one.name not in common}
    described = told.model_json_schema()["properties"]

    assert own
    for name, option in own.items():
        assert option.help == " ".join(described[name]["description"].replace("`", "").split())
        assert option.required or str(option.default or "") == str(
            told.model_fields[name].get_default(call_default_factory=True) or ""
        )


@pytest.mark.slow
def test_psychometric_of_one_person_is_drawn(acuity, tmp_path):
    one = tmp_path / "one.csv"
    rows = pd.read_csv(acuity)
    rows[rows["who"] == 0].to_csv(one, index=False)
    run(
        "psychometric", one, "--level", "ecc", "--by", "method", "--falling",
        "--map", "participant=who", "--map", "correct=hit", "--out", tmp_path / "out",
    )  # fmt: skip

    assert len(pd.read_csv(tmp_path / "out" / "tables" / "people.csv")) == 2
    assert list((tmp_path / "out").rglob("*.svg"))


@pytest.mark.slow
def test_psychometric_tells_thresholds_of_people_and_of_all(acuity, tmp_path):
    out = tmp_path / "out"
    result = run(
        "psychometric", acuity, "--level", "ecc", "--by", "method", "--falling",
        "--map", "participant=who", "--map", "correct=hit", "--out", out,
    )  # fmt: skip

    assert "560 answers of 4 participants · by ecc" in result.output
    all_people = pd.read_csv(out / "tables" / "thresholds.csv")
    all_people = all_people[all_people["participant"].isna()].set_index("condition")
    for name, truth in (("plain", 16.0), ("blur", 11.0)):
        assert all_people.loc[name, "lower"] < truth < all_people.loc[name, "upper"]
        assert all_people.loc[name, "width"] < 0
    people = pd.read_csv(out / "tables" / "people.csv")
    assert len(people) == 8
    assert (people["threshold_lower"] < people["threshold"]).all()
    assert (people["width"] < 0).all()
    compared = pd.read_csv(out / "tables" / "comparisons_of_people.csv")
    assert (compared["within"] == "participant").sum() == 4
    assert (compared["within"] == "condition").sum() == 2 * 6
    between = pd.read_csv(out / "tables" / "threshold_differences.csv")
    assert (between["first"] + " " + between["second"]).tolist() == ["blur plain"]
    assert between["upper"][0] < 0
    assert (out / "figures" / "psychometric-2-column.svg").stat().st_size > 2000
    noted = json.loads((out / "results.json").read_text())
    assert noted["results"]["thresholds"]["participants"] == 4
    assert "Thresholds (gauss functions of 4 participants" in " ".join(result.output.split())


@pytest.mark.slow
def test_a_file_of_psychopy_and_a_spreadsheets_export_are_read_as_they_are(acuity, tmp_path):
    """PsychoPy writes a row for each page of instructions; a German spreadsheet decimal commas."""
    rows = pd.read_csv(acuity).rename(columns={"who": "participant", "hit": "key_resp.corr"})
    rows["key_resp.rt"] = 0.5 + 0.01 * np.arange(len(rows)) % 0.7
    page = pd.DataFrame({"participant": [0, 0]})
    pages = pd.concat([page, rows, page]).convert_dtypes()
    pages.to_csv(tmp_path / "psychopy.csv", index=False)
    asked = ("--level", "ecc", "--by", "method", "--falling")

    result = run(
        "psychometric", tmp_path / "psychopy.csv", *asked, "--map", "correct=key_resp.corr",
        "--out", tmp_path / "out",
    )  # fmt: skip
    note = "left out without an answer: 4 rows (lines 2, 3, 564, 565)"
    assert note in result.output
    assert note in json.loads((tmp_path / "out/results.json").read_text())["warnings"]
    plain = run(
        "psychometric",
        acuity,
        *asked,
        "--map",
        "participant=who",
        "--map",
        "correct=hit",
        status=None,
    )
    assert plain.output.splitlines()[0] in result.output

    times = run(
        "reaction", tmp_path / "psychopy.csv", "--map", "rt_s=key_resp.rt", "--by", "method"
    )
    assert "560" in times.output
    assert "4 rows" in times.output

    rows.to_csv(tmp_path / "german.csv", sep=";", decimal=",", index=False, encoding="utf-16")
    german = run("reaction", tmp_path / "german.csv", "--map", "rt_s=key_resp.rt", "--by", "method")
    assert "decimal commas read as points: key_resp.rt" in german.output


def test_one_person_is_not_compared_between_conditions(seen, tmp_path):
    one = tmp_path / "one.csv"
    rows = pd.read_csv(seen)
    rows[rows["participant"] == 0].to_csv(one, index=False)
    result = run(
        "detection", one, "--signal", "seen", "--by", "method",
        "--map", "expected=truth", "--map", "answer=said",
    )  # fmt: skip

    assert "one participant only: conditions are not compared" in result.output
    assert "nan" not in result.output


def test_a_table_with_the_lines_of_old_macs_is_read_and_a_broken_spreadsheet_refused(
    acuity, tmp_path
):
    columns = ("--level", "ecc", "--by", "method", "--falling")
    named = ("--map", "participant=who", "--map", "correct=hit")
    old = tmp_path / "old.csv"
    old.write_bytes(acuity.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r"))
    assert "560 answers" in run("psychometric", old, *columns, *named, status=None).output
    sheet = tmp_path / "sheet.csv"
    sheet.write_bytes(b"PK\x03\x04" + bytes(100))
    refused = run("psychometric", sheet, *columns, *named, status=2)
    assert "must be an .xlsx file" in refused.output


@pytest.mark.slow
def test_detection_tells_d_prime_criterion_and_what_differs(seen, tmp_path):
    out = tmp_path / "out"
    result = run(
        "detection", seen, "--signal", "seen", "--by", "method", "--baseline", "ours",
        "--map", "expected=truth", "--map", "answer=said", "--out", out,
    )  # fmt: skip

    rows = pd.read_csv(out / "tables" / "sensitivity.csv").set_index("condition")
    assert rows.loc["blur", "d_prime_lower"] < 2.0 < rows.loc["blur", "d_prime_upper"]
    assert rows.loc["ours", "d_prime"] == pytest.approx(0.5, abs=0.4)
    compared = pd.read_csv(out / "tables" / "sensitivity_differences.csv")
    assert set(compared["second"]) == {"ours"}
    assert "blur minus ours" in result.output
    assert {path.name for path in (out / "figures").glob("*-2-column.svg")} == {
        "detection-2-column.svg",
        "sensitivity-2-column.svg",
    }


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("psychometric", "--level", "eccc"), "did you mean 'ecc'"),
        (("psychometric", "--level", "ecc", "--guess", "half"), "--guess: must be a rate"),
        (("psychometric", "--level", "ecc", "--guess", ""), "--guess: must be a rate"),
        (("psychometric", "--level", "ecc", "--shape", "gaus"), "did you mean 'gauss'"),
        (("psychometric", "--level", "ecc", "--map", "who"), "OURS=THEIRS"),
        (("psychometric", "--level", "who", "--log"), "leave --log away"),
        (("detection",), "must have the columns"),
    ],
)
def test_mistakes_get_one_message_and_leave_nothing(acuity, tmp_path, arguments, said):
    command, *rest = arguments
    maps = ("--map", "participant=who", "--map", "correct=hit")
    result = run(command, acuity, *maps, *rest, "--out", tmp_path / "out", status=2)

    assert said in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


def test_tables_of_simulated_answers_say_so(acuity, tmp_path):
    rows = pd.read_csv(acuity).query("who < 1")
    file = tmp_path / "rows.csv"
    rows.assign(simulated=1).to_csv(file, index=False)
    result = run(
        "psychometric", file, "--level", "ecc", "--by", "method", "--falling",
        "--map", "participant=who", "--map", "correct=hit", status=None
    )  # fmt: skip

    assert "SIMULATED" in result.output
    assert "one participant only" in result.output


@pytest.mark.filterwarnings("error")
def test_levels_that_place_no_threshold_have_no_deviation_and_each_note_once(tmp_path):
    shown = product(range(4), ("plain", "blur"), (1, 2, 4, 8), range(3))
    rows = pd.DataFrame(shown, columns=["participant", "method", "level", "time"])
    rows.assign(correct=1).to_csv(tmp_path / "all.csv", index=False)

    said = run("psychometric", tmp_path / "all.csv", "--level", "level", "--by", "method", "--log")

    assert "not identified" in said.output
    assert "none" not in said.output.split("Mean lapse rate", 1)[1].split("\n", 1)[0]
    assert "SD = none" not in said.output
    assert said.output.count("its prior decides with it") == 1


def test_a_mixed_model_without_a_maximum_has_no_sentence_and_one_person_no_clusters(tmp_path):
    shown = product((1,), "abcd", ("blur", "ours"), ("yes", "no"), range(4))
    rows = pd.DataFrame(shown, columns=["participant", "scene", "method", "expected", "time"])
    wrong = (rows["method"] == "ours") & (rows["time"] == 0)
    rows["answer"] = rows["expected"].where(
        ~wrong, rows["expected"].map({"yes": "no", "no": "yes"})
    )
    rows.to_csv(tmp_path / "one.csv", index=False)

    said = run("detection", tmp_path / "one.csv", "--by", "method", "--out", tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()

    assert "d' in condition ours was" in said.output
    assert "was none" not in said.output
    assert "clustered" not in page
    assert "trials taken as independent" in page
