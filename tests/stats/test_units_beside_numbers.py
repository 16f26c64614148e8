"""Percentages, marks between thousands, and codes and slots of several people are said."""

import re
import zipfile

import pandas as pd
import pytest
from attack.readers import write_ods, write_xlsx

from analysis.tables.column_units import cure
from analysis.tables.spreadsheet import read_spreadsheet
from analysis.tables.table import Table
from analysis.tables.trials import read_trials
from protocols.errors import StudyError

LEVELS = [0.125, 0.43, 0.285, 0.57]
MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'


def workbook(path, style, attribute="", formula=""):
    """Write a workbook of trials whose levels have a style; 3 and 4 have formats of their own."""
    write_xlsx(path)
    with zipfile.ZipFile(path) as given:
        files = {name: given.read(name).decode() for name in given.namelist()}
    texts = ("participant", "correct", "level")
    rows = ["".join(f'<c t="inlineStr"><is><t>{one}</t></is></c>' for one in texts)]
    for k, level in enumerate(LEVELS):
        rows.append(
            f'<c t="inlineStr"><is><t>P{k % 2}</t></is></c><c><v>{k % 2}</v></c>'
            f'<c s="{style}"{attribute}>{formula}<v>{level}</v></c>'
        )
    sheet = "".join(f"<row>{row}</row>" for row in rows)
    files["xl/worksheets/sheet1.xml"] = (
        f"<worksheet {MAIN}><sheetData>{sheet}</sheetData></worksheet>"
    )
    formats = ("0.0%;[Red]-0.0%", "0.0\\%&quot;%&quot;")
    own = "".join(f'<numFmt numFmtId="{164 + k}" formatCode="{one}"/>'
                  for k, one in enumerate(formats))  # fmt: skip
    used = "".join(f'<xf numFmtId="{one}"/>' for one in (0, 9, 10, 164, 165))
    files["xl/styles.xml"] = (
        f"<styleSheet {MAIN}><numFmts>{own}</numFmts>"
        f'<cellStyleXfs><xf numFmtId="9"/></cellStyleXfs><cellXfs>{used}</cellXfs></styleSheet>'
    )
    with zipfile.ZipFile(path, "w") as made:
        for name, text in files.items():
            made.writestr(name, text)
    return path


def opened(path, **mapping):
    return read_trials(Table(path, mapping), levels=("level",))


def asked(path):
    """Return the levels as the cure of the message gives them."""
    with pytest.raises(StudyError, match=r"level must be a number \(got '12.5 ?%'\)") as refused:
        opened(path)
    unit = re.search(r"--map level=(level:percent)", str(refused.value))
    return opened(path, level=unit[1])["level"].to_list()


@pytest.mark.parametrize(
    ("style", "attribute", "formula"),
    [(1, "", ""), (2, ' t="n"', ""), (3, "", "<f>A1&gt;2</f>")],
)
def test_a_percentage_of_a_workbook_is_as_it_is_shown_and_asked_about(
    tmp_path, style, attribute, formula
):
    assert asked(workbook(tmp_path / "t.xlsx", style, attribute, formula)) == LEVELS


@pytest.mark.parametrize("style", [0, 4])
def test_a_number_without_a_percent_format_stays(tmp_path, style):
    assert opened(workbook(tmp_path / "t.xlsx", style))["level"].to_list() == LEVELS


@pytest.mark.parametrize(
    "attributes",
    [
        'office:value-type="percentage" office:value="{}"',
        'office:value="{}" office:value-type="percentage"',
        'table:formula="of:=[.A1]" office:value-type="percentage" office:value="{}"',
    ],
)
def test_a_percentage_of_libreoffice_is_not_rounded_as_it_is_shown(tmp_path, attributes):
    write_ods(
        tmp_path / "t.ods",
        *(f"<table:table-cell {attributes.format(one)}><text:p>1 %</text:p></table:table-cell>"
          for one in LEVELS),
    )  # fmt: skip
    found = read_spreadsheet(tmp_path / "t.ods", [])
    assert found == [[f"{100 * one:.12g}%"] for one in LEVELS]


def written(path, levels, head="participant,correct,level", sign=","):
    rows = [f"P{k % 2}{sign}{k % 2}{sign}{one}" for k, one in enumerate(levels)]
    path.write_text("\n".join([head.replace(",", sign), *rows]) + "\n")
    return path


@pytest.mark.parametrize("sign", [",", ";"])
def test_percentages_in_text_are_asked_about(tmp_path, sign):
    texts = [f"{100 * one:g} %" for one in LEVELS]
    texts = [one.replace(".", ",") for one in texts] if sign == ";" else texts
    assert asked(written(tmp_path / "t.csv", texts, sign=sign)) == LEVELS


@pytest.mark.parametrize("odd", ["0.5", "1", ".005"])
def test_a_share_beside_percentages_is_refused(tmp_path, odd):
    path = written(tmp_path / "t.csv", ["12.5%", "50%", odd])
    with pytest.raises(StudyError, match="line 4: level must have % in all cells or in none"):
        opened(path, level="level:percent")


def test_each_cell_has_the_unit_that_stands_behind_it(tmp_path):
    path = written(tmp_path / "t.csv", ["534 ms", "0.6 s", "700"], "participant,correct,rt")
    found = read_trials(Table(path, {"rt_s": "rt:ms"}))
    assert found["rt_s"].to_list() == [0.534, 0.6, 0.7]


@pytest.mark.parametrize(
    ("text", "ways"),
    [
        ("1,043", ["1043", "1.043"]),
        ("-2,500 ms", ["-2500 ms", "-2.500 ms"]),
        ("1,043,000", ["1043000"]),
        ("1.043,5", ["1043.5"]),
        ("1\u202f043", ["1043"]),
        ("0,43", ["0.43"]),
        ("$1,043", ["1043", "1.043"]),
        ("3,50 €", ["3.50"]),
        ("USD 12", ["12"]),
        ("left", []),
        ("1-2", []),
    ],
)
def test_the_cure_for_a_cell_names_each_reading(text, ways):
    assert re.findall(r": ([^,]+)", cure(text, "--map x=x")) == ways


@pytest.mark.parametrize("text", ["1:02.5", "0:01:02", "01:02"])
def test_a_duration_with_colons_is_to_be_seconds(text):
    assert cure(text, "--map x=x") == "; write durations as one number of seconds"


@pytest.mark.parametrize("way", [0, 1])
def test_each_cure_for_a_comma_is_read_as_it_says(tmp_path, way):
    levels = ['"1,043"', "350", "999", '"2,100"']
    with pytest.raises(StudyError, match=r"got '1,043'.*: 1043, or .*: 1.043"):
        opened(written(tmp_path / "t.csv", levels))
    cured = [one.strip('"').replace(",", ("", ".")[way]) for one in levels]
    cured = cured if way == 0 else cured[::3]
    found = opened(written(tmp_path / "t.csv", cured))["level"]
    assert found.iloc[0] == (1043, 1.043)[way]


def test_a_decimal_comma_is_noted_with_its_reading(tmp_path):
    table = Table(written(tmp_path / "t.csv", ["1,043", "2,500"], sign=";"))
    assert table.notes == ["decimal commas read as points: level (1,043 is 1.043)"]


@pytest.mark.parametrize("column", ["lab", "Site_ID", "group"])
def test_a_code_in_several_labs_is_noted_and_the_cure_joins_both(tmp_path, column):
    rows = pd.DataFrame({column: list("AABB"), "subject": ["1", "2"] * 2, "correct": [1, 0, 0, 1]})
    rows.to_csv(tmp_path / "t.csv", index=False)
    (note,) = Table(tmp_path / "t.csv", {"participant": "subject"}).notes
    assert f"2 of 2 participant codes come in several of {column}" in note
    cured = Table(tmp_path / "t.csv", {"participant": note.rpartition("participant=")[2]})
    assert cured.notes == []
    assert read_trials(cured)["participant"].to_list() == ["A-1", "A-2", "B-1", "B-2"]


@pytest.mark.parametrize("column", ["session", "condition", "method"])
def test_what_one_person_has_several_of_is_not_noted(tmp_path, column):
    rows = pd.DataFrame({column: list("AABB"), "participant": ["1", "2"] * 2})
    rows.to_csv(tmp_path / "t.csv", index=False)
    assert Table(tmp_path / "t.csv").notes == []


@pytest.mark.parametrize(("slots", "said"), [("0011", False), ("0000", True), ("0010", True)])
def test_a_slot_of_several_people_is_noted(tmp_path, slots, said):
    rows = pd.DataFrame({"slot": list(slots), "participant": list("aabb")})
    rows.to_csv(tmp_path / "t.csv", index=False)
    notes = Table(tmp_path / "t.csv").notes
    assert notes == ["2 participants share slot 0 (a, b)"] * said
