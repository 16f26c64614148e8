"""Benchmarks refuse what they could not write before they measure for minutes."""

import importlib
import json

import pytest

from benchmarks.shared.output import PagePart, write_record


@pytest.mark.parametrize(
    ("name", "option"),
    [
        ("analysis", "--json"),
        ("fill", "--json"),
        ("fill", "--plot"),
        ("foveate", "--json"),
        ("scores", "--json"),
        ("session", "--json"),
        ("stimuli", "--json"),
    ],
)
def test_a_file_in_no_folder_is_refused(name, option, tmp_path, capsys):
    main = importlib.import_module(f"benchmarks.{name}").main

    for path in (tmp_path / "none" / "x.svg", tmp_path):
        with pytest.raises(SystemExit) as stopped:
            main([option, str(path)])

        assert stopped.value.code == 2
        told = capsys.readouterr().err
        assert f"{option}: must be a file in a folder that exists (got {path})" in told


@pytest.mark.parametrize(
    ("name", "options", "part"),
    [
        ("fill", [], "fill table"),
        ("foveate", [], "foveation times"),
        ("quality", [], "quality table"),
        ("scores", [], "scores"),
    ],
)
def test_a_page_without_the_part_is_refused(name, options, part, tmp_path, capsys):
    main = importlib.import_module(f"benchmarks.{name}").main
    page = tmp_path / "page.md"
    page.write_text("<!-- another: begin -->\n<!-- another: end -->\n", encoding="utf-8")

    for path in (page, tmp_path / "none.md"):
        with pytest.raises(SystemExit) as stopped:
            main([*options, "--docs", str(path)])

        assert stopped.value.code == 2
        told = capsys.readouterr().err
        assert f"--docs: must be a page with the lines <!-- {part}: begin --> and" in told


def test_a_part_is_replaced_and_the_rest_stays(tmp_path):
    part, page = PagePart("numbers"), tmp_path / "page.md"
    page.write_text(f"a\n{part.begin}\nold\n{part.end}\nb\n", encoding="utf-8")

    part.replace(part.page(str(page)), "new")

    assert page.read_text(encoding="utf-8") == f"a\n{part.begin}\nnew\n{part.end}\nb\n"


def test_a_record_keeps_six_digits_of_every_number_and_all_else(tmp_path):
    rows = [{"x": 1e-9, "y": [True, "é"]}, {}]
    record = {"a": 0.123456789, "n": 123456789, "none": None, "rows": rows}
    write_record(tmp_path / "record.json", record)

    text = (tmp_path / "record.json").read_text(encoding="utf-8")
    assert json.loads(text) == {**record, "a": 0.123457}
    assert len(text.splitlines()) == 12
