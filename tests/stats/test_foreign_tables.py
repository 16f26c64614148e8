"""Old data: what other tools and spreadsheets write comes in as it is meant, and it is said."""

import io
import zipfile
from pathlib import Path

import pandas as pd
import pytest
from attack.readers import write_ods
from command_line import result_of

from analysis.tables.spreadsheet import read_spreadsheet
from analysis.tables.table import Table
from protocols.errors import StudyError

MAP = ("--map", "participant=Vpn", "--map", "first=A", "--map", "second=B")
PLAIN = [
    ("Vpn", "A", "B", "Wahl", "rt_s", "scene"),
    ("Jörg", "ours", "blur", "ours", "0.5", "Garten"),
    ("Jörg", "blur", "ours", "ours", "1.25", "Garten"),
    ("Änne", "ours", "blur", "blur", "2", "Haus"),
    ("Änne", "blur", "ours", "ours", "0.75", "Haus"),
]
run = result_of(catch_exceptions=False)


def text_of(rows, separator=","):
    return "\n".join(separator.join(row) for row in rows) + "\n"


def imported(path: Path, *more, chosen="chosen=Wahl") -> tuple[pd.DataFrame, str]:
    out = path.parent / "imported"
    done = run("analysis", "import", path, *MAP, "--map", chosen, *more, "--out", out)
    return pd.read_csv(out / "decisions.csv"), " ".join(done.stdout.split())


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> pd.DataFrame:
    path = tmp_path_factory.mktemp("plain") / "old.csv"
    path.write_text(text_of(PLAIN), encoding="utf-8")
    found, said = imported(path)
    assert "note:" not in said
    return found


def xlsx(path: Path, rows, *, sheets: int = 1, shared: bool = True, skip_row: int = 0) -> Path:
    """Write a workbook as Excel does: shared strings, numbers with 17 digits, places on cells."""
    main = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    links = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    texts: list[str] = []
    lines = []
    for number, row in enumerate(rows, 1):
        cells = []
        for column, value in enumerate(row):
            place = f"{chr(65 + column)}{number + skip_row * (number > 1)}"
            try:
                cells.append(f'<c r="{place}"><v>{float(value):.17g}</v></c>')
                continue
            except ValueError:
                pass
            if shared:
                texts.append(value)
                cells.append(f'<c r="{place}" t="s"><v>{len(texts) - 1}</v></c>')
            else:
                cells.append(f'<c r="{place}" t="inlineStr"><is><t>{value}</t></is></c>')
        lines.append(f'<row r="{number + skip_row * (number > 1)}">{"".join(cells)}</row>')
    half = "".join(
        f"<si><r><t>{text[:2]}</t></r><r><t>{text[2:]}</t></r><rPh><t>nonsense</t></rPh></si>"
        for text in texts
    )
    files = {
        "xl/workbook.xml": f'<workbook {main} xmlns:r="{links}"><sheets>'
        + "".join(f'<sheet name="S{k}" r:id="rId{k}"/>' for k in range(1, sheets + 1))
        + "</sheets></workbook>",
        "_rels/.rels": f'<Relationships><Relationship Id="r" Type="{links}/officeDocument"'
        ' Target="xl/workbook.xml"/></Relationships>',
        "xl/_rels/workbook.xml.rels": "<Relationships>"
        + "".join(
            f'<Relationship Id="rId{k}" Type="{links}/worksheet" Target="worksheets/sheet{k}.xml"/>'
            for k in range(1, sheets + 1)
        )
        + "</Relationships>",
        "xl/sharedStrings.xml": f"<sst {main}>{half}</sst>",
        **{
            f"xl/worksheets/sheet{k}.xml": f"<worksheet {main}><sheetData>{''.join(lines)}"
            "</sheetData></worksheet>"
            for k in range(1, sheets + 1)
        },
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, text in files.items():
            packed.writestr(name, text)
    return path


def decimal_commas():
    return [PLAIN[0], *((*row[:4], row[4].replace(".", ","), row[5]) for row in PLAIN[1:])]


@pytest.mark.parametrize(
    ("data", "notes"),
    [
        (text_of(PLAIN, ";").encode(), []),
        (text_of(decimal_commas(), ";").encode(), ["decimal commas read as points: rt_s"]),
        (text_of(PLAIN, "\t").encode("utf-16"), ["read as UTF-16"]),
        (text_of(PLAIN).encode("cp1252"), ["read as Windows' Latin-1"]),
        (
            text_of(decimal_commas(), ";").encode("cp1252"),
            ["read as Windows' Latin-1", "decimal commas read as points"],
        ),
    ],
)
def test_other_encodings_separators_and_decimals_give_the_same_decisions(
    tmp_path, expected, data, notes
):
    (tmp_path / "old.csv").write_bytes(data)
    found, said = imported(tmp_path / "old.csv")
    pd.testing.assert_frame_equal(found, expected)
    assert said.count("note:") == len(notes)
    for note in notes:
        assert note in said


@pytest.mark.parametrize("words", [("left", "right"), ("First", "SECOND"), ("1", "2")])
def test_an_answer_by_place_becomes_the_name_that_stood_there(tmp_path, expected, words):
    rows = [PLAIN[0]]
    rows += [(*row[:3], words[row[3] != row[1]], *row[4:]) for row in PLAIN[1:]]
    (tmp_path / "old.csv").write_text(text_of(rows), encoding="utf-8")
    found, said = imported(tmp_path / "old.csv")
    pd.testing.assert_frame_equal(found, expected)
    assert "read as the columns A and B" in said


def test_yes_and_no_are_read_and_methods_called_left_keep_their_names(tmp_path, expected):
    rows = [(*PLAIN[0][:3], "erste", *PLAIN[0][4:])]
    rows += [(*row[:3], "yes" if row[3] == row[1] else "no", *row[4:]) for row in PLAIN[1:]]
    (tmp_path / "old.csv").write_text(text_of(rows), encoding="utf-8")
    found, _ = imported(tmp_path / "old.csv", chosen="chose_first=erste")
    pd.testing.assert_frame_equal(found, expected)

    (tmp_path / "b").mkdir()
    places = (("right", "left"), ("left", "right"))
    named = [PLAIN[0], *(("P", *both, "left", "1", "s") for both in places)]
    (tmp_path / "b" / "old.csv").write_text(text_of(named))
    found, said = imported(tmp_path / "b" / "old.csv")
    assert list(found["chosen"]) == ["left", "left"]
    assert "read as the columns" not in said


def test_rows_without_an_answer_are_left_out_by_line_and_the_lines_after_keep_theirs(
    tmp_path, expected
):
    empty = ("Änne", "ours", "blur", "", "", "Haus")
    rows = [*PLAIN[:3], empty, *PLAIN[3:], ("", "", "", "", "", "")]
    (tmp_path / "old.csv").write_text(text_of(rows), encoding="utf-8")
    found, said = imported(tmp_path / "old.csv")
    pd.testing.assert_frame_equal(found.drop(columns="trial"), expected.drop(columns="trial"))
    assert "left out without an answer: 1 row (line 4)" in said
    assert list(found["trial"]) == ["row-2", "row-3", "row-5", "row-6"]


def test_a_mistake_further_down_is_told_by_the_users_file_and_line(tmp_path):
    rows = [*decimal_commas(), ("P", "ours", "blur", "neither", "1,5", "s")]
    (tmp_path / "old.csv").write_text(text_of(rows, ";"), encoding="utf-8")
    done = run("analysis", "import", tmp_path / "old.csv", *MAP, "--map", "chosen=Wahl",
               "--out", tmp_path / "o", status=2)  # fmt: skip
    said = " ".join(done.stderr.split())
    assert f"{tmp_path / 'old.csv'}: line 6: chosen must be 'ours' or 'blur'" in said
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("shared", [True, False])
def test_a_workbook_gives_the_same_decisions(tmp_path, expected, shared):
    found, said = imported(xlsx(tmp_path / "old.xlsx", PLAIN, shared=shared))
    pd.testing.assert_frame_equal(found, expected)
    assert "note:" not in said


def test_of_several_sheets_the_first_is_read_and_blank_rows_keep_line_numbers(tmp_path):
    notes: list[str] = []
    rows = read_spreadsheet(xlsx(tmp_path / "old.xlsx", PLAIN, sheets=3, skip_row=2), notes)
    assert notes == ["the first of 3 sheets was read: S1"]
    assert rows[0] == list(PLAIN[0])
    assert rows[1:3] == [[], []]
    assert rows[3:] == [list(row) for row in PLAIN[1:]]


def test_a_harmed_workbook_is_refused_in_one_message(tmp_path):
    whole = xlsx(tmp_path / "old.xlsx", PLAIN).read_bytes()
    entity = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(whole)) as given, zipfile.ZipFile(entity, "w") as made:
        for name in given.namelist():
            text = given.read(name)
            if name == "xl/workbook.xml":
                text = b'<!DOCTYPE x [<!ENTITY a "b">]>' + text
            made.writestr(name, text)
    for data in (whole[:200], b"no zip", entity.getvalue()):
        (tmp_path / "bad.xlsx").write_bytes(data)
        with pytest.raises(StudyError, match=r"bad\.xlsx: must be an \.xlsx file"):
            read_spreadsheet(tmp_path / "bad.xlsx", [])


def test_a_workbook_that_unpacks_to_too_much_is_refused_before(tmp_path, monkeypatch):
    monkeypatch.setenv("METAMERLAB_LIMITS", "text=100")
    with pytest.raises(StudyError, match="must have at most 100 bytes in its sheets"):
        read_spreadsheet(xlsx(tmp_path / "old.xlsx", PLAIN), [])


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("old.csv", "Jörg;1\n".encode("cp1252"), "metamerlab analysis import"),
        ("old.xlsx", b"PK", "must be an .xlsx file"),
    ],
)
def test_the_report_of_such_a_file_says_what_helps(tmp_path, name, data, said):
    (tmp_path / name).write_bytes(data)
    done = run("analysis", "report", tmp_path / name, "--out", tmp_path / "r", status=2)
    assert said in " ".join(done.stderr.split())


@pytest.fixture
def folder(tmp_path) -> Path:
    """A file for each participant, as PsychoPy leaves them: columns differ, one run was ended."""
    data = tmp_path / "data"
    data.mkdir()
    head, *rows = PLAIN
    start = (("Jörg", "", "", "", "", ""),)
    (data / "P1.csv").write_text(text_of((head, *start, *rows[:2])), encoding="utf-8")
    mouse = [(*row, "0,5") for row in rows[2:]]
    xlsx(data / "P2.xlsx", [(*head, "mouse"), *mouse])
    (data / "P3.csv").write_text("")
    for name in ("P1.log", "._P1.csv", "~$P2.xlsx"):
        (data / name).write_text("not a table")
    return data


def test_a_folder_with_a_file_for_each_participant_is_read_as_one_table(folder, expected):
    found, said = imported(folder)

    pd.testing.assert_frame_equal(found.drop(columns="trial"), expected.drop(columns="trial"))
    assert f"3 tables of {folder} read as one" in said
    assert "left out without an answer: 1 row (line 2 of P1.csv)" in said
    assert "P3.csv: left out: it is empty" in said


@pytest.mark.parametrize(
    ("name", "line", "said"),
    [
        ("P1.csv", "Jörg,ours,ours,ours,1,Garten\n", "line 5: first and second must differ"),
        ("P1.csv", "Jörg,ours\n", "line 5: must have 6 cells like the header"),
        ("P4.csv", "A,A\n1,2\n", "columns must have names of their own"),
    ],
)
def test_a_mistake_in_a_folder_is_told_with_its_file_and_line(folder, name, line, said):
    with (folder / name).open("a", encoding="utf-8") as file:
        file.write(line)
    done = run(
        "analysis", "import", folder, *MAP, "--map", "chosen=Wahl", "--out", folder / "i", status=2
    )

    assert f"{folder / name}: {said}" in " ".join(done.stderr.split())
    assert not (folder / "i").exists()


def test_a_folder_without_tables_is_refused(tmp_path):
    done = run("analysis", "reaction", tmp_path, "--by", "method", status=2)
    assert f"{tmp_path}: must hold tables (.csv, .tsv, .xlsx, .ods)" in " ".join(
        done.stderr.split()
    )


def test_another_spreadsheet_says_how_to_save_it(tmp_path):
    (tmp_path / "old.numbers").write_bytes(b"PK")
    with pytest.raises(StudyError, match="save it as one of them"):
        Table(tmp_path / "old.numbers")


def cell(kind: str, text: str, value: str = "") -> str:
    """A cell as LibreOffice writes it."""
    named = f' office:{"" if kind == "float" else f"{kind}-"}value="{value}"' if value else ""
    start = f'<table:table-cell office:value-type="{kind}"{named}>'
    return f"{start}<text:p>{text}</text:p></table:table-cell>"


def test_a_spreadsheet_of_libreoffice_gives_the_same_decisions(tmp_path, expected):
    head, *body = PLAIN
    rows = [[cell("string", text) for text in head]]
    rows += [
        [cell("float", "1", text) if text[0].isdigit() else cell("string", text) for text in row]
        for row in body
    ]
    write_ods(tmp_path / "old.ods", *("".join(row) for row in rows))
    found, said = imported(tmp_path / "old.ods")
    pd.testing.assert_frame_equal(found, expected)
    assert "note:" not in said


@pytest.mark.parametrize(
    ("kind", "value", "got"),
    [
        ("date", "2024-05-03", "2024-05-03"),
        ("date", "2024-05-03T10:11:12", "2024-05-03 10:11:12"),
        ("time", "PT01H02M03S", "01:02:03"),
    ],
)
@pytest.mark.parametrize(
    ("column", "ours", "must", "format_"),
    [("A", "first", "a name", "text"), ("rt_s", "rt_s", "a number", "numbers")],
)
def test_a_date_is_no_name_and_no_number(tmp_path, kind, value, got, column, ours, must, format_):
    rows = [[cell("string", text) for text in row] for row in PLAIN]
    rows[2][PLAIN[0].index(column)] = cell(kind, "3.5.24", value)
    write_ods(tmp_path / "old.ods", *("".join(row) for row in rows))
    done = run("analysis", "import", tmp_path / "old.ods", *MAP, "--map", "chosen=Wahl",
               "--out", tmp_path / "o", status=2)  # fmt: skip
    assert (
        f"{tmp_path / 'old.ods'}: line 3: {ours} must be {must}, not a date or a time (got {got!r}"
        f" in the spreadsheet's column {column!r}); format the column's cells as {format_} and"
        " write them again"
    ) in " ".join(done.stderr.split())


def test_an_error_of_a_workbook_is_a_text_and_a_date_is_as_its_style_says(tmp_path):
    path = xlsx(tmp_path / "old.xlsx", [("Vpn", "A"), ("45292", "45292")])
    with zipfile.ZipFile(path) as given:
        files = {name: given.read(name).decode() for name in given.namelist()}
    sheet = files["xl/worksheets/sheet1.xml"].replace('r="A2"', 'r="A2" s="1"')
    sheet = sheet.replace('<c r="B2"><v>45292', '<c r="B2" t="e"><v>#DIV/0!')
    style = '<styleSheet><cellXfs><xf numFmtId="0"/><xf numFmtId="14"/></cellXfs></styleSheet>'
    main = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    files["xl/worksheets/sheet1.xml"] = sheet
    files["xl/styles.xml"] = style.replace("<styleSheet>", f"<styleSheet {main}>")
    with zipfile.ZipFile(path, "w") as made:
        for name, text in files.items():
            made.writestr(name, text)
    assert read_spreadsheet(path, []) == [["Vpn", "A"], ["2024-01-01", "#DIV/0!"]]


def test_of_a_plain_table_nothing_is_noted(tmp_path):
    (tmp_path / "old.csv").write_text(text_of(PLAIN), encoding="utf-8")
    assert Table(tmp_path / "old.csv", {"chosen": "Wahl"}).notes == []


@pytest.mark.parametrize("place", ["B" + "2" * 200, "B3", "b2", ""])
def test_a_cell_at_no_place_of_its_row_is_refused_before_the_library_meets_it(tmp_path, place):
    path = xlsx(tmp_path / "old.xlsx", PLAIN)
    with zipfile.ZipFile(path) as given:
        files = {name: given.read(name).decode() for name in given.namelist()}
    with zipfile.ZipFile(path, "w") as made:
        for name, text in files.items():
            made.writestr(name, text.replace('"B2"', f'"{place}"'))
    with pytest.raises(StudyError, match=r"old\.xlsx: must be an \.xlsx file \(.*a cell of row 2"):
        read_spreadsheet(path, [])
