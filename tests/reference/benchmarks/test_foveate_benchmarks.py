"""Benchmarks of foveated pictures: tables and plots of their times."""

from benchmarks.shared import foveate_report
from benchmarks.shared.foveate_report import Line
from benchmarks.shared.output import conditions

LINES = [
    Line(512, "copy", "gpu", 2.0, 1.0, None, 0.1, 1.0, passes=1, held_bytes=0),
    Line(512, "blur", "gpu", 12.0, 10.0, None, 1.0, 10.0, 4.0, 6.0, 12, 2**20, 2**20),
    Line(512, "metamer", "gpu", 40.0, 30.0, None, 3.1, 31.0, 12.0, 18.0, 13, 8 * 2**20, 3 * 2**20),
    Line(512, "gen_metamer", "odak", 900.0, 800.0, 700.0),
]


def test_tables_say_time_ratio_and_memory_of_analysis_and_synthesis():
    text = foveate_report.markdown(LINES, "a card", "a processor, load 1")

    assert text.startswith("a card; a processor, load 1. ms per frame (least of the runs")
    assert "| `metamer` | gpu | 30 (3.10) | 13 | 32 |" in text
    assert "| `gen_metamer` | odak | 700 |  |  |" in text
    assert "| `metamer` | 512² | 12 | 18 | 3.0 | 5.0 |" in text


def test_a_plot_of_times_is_the_same_file_twice(tmp_path):
    files = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for file in files:
        foveate_report.plot(LINES, "a card", file)

    assert files[0].read_bytes() == files[1].read_bytes()
    text = files[0].read_text("utf-8")
    assert "its analysis" in text
    assert "gen_metamer (odak)" in text


def test_results_say_which_machine_and_how_busy_it_was():
    found = conditions("numpy", "a package that nobody has")

    assert set(found) == {
        "processor", "cores", "platform", "python", "libraries", "revision", "load_average_before",
    }  # fmt: skip
    assert list(found["libraries"]) == ["numpy"]
    assert found["load_average_before"] >= 0
