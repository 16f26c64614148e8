"""Cures that messages name, each followed to the letter on what caused the message."""

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from command_line import metamerlab, outcome_of, refusal_of

from pipeline.pictures.write import write_pixels

HEAD = ["participant", "first", "second", "chosen", "rt"]
BOTH = ["ours", "blur"]
BY_METHOD = ("--task", "identification", "--set", "by=method", "--set", "alternatives=2")
RATED = ("--task", "rating", "--set", "by=method")


def rows_of_pairs(rt: Callable[[float], str] = "{:.3f}".format) -> list[list[str]]:
    """Decisions of 4 people between ours and blur, 640 to 930 ms each."""
    return [
        [
            f"P{p}",
            *BOTH[:: 1 if k % 2 else -1],
            BOTH[k % 3 == 0],
            rt(0.64 + (p * 7 + k * 3 % 29) / 100),
        ]
        for p in range(4)
        for k in range(8)
    ]


def table_text(header: list[str], rows: list[list[str]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([header, *rows])
    return out.getvalue()


def pairs(rt: Callable[[float], str] = "{:.3f}".format, rt_name: str = "rt_s") -> str:
    return table_text([*HEAD[:-1], rt_name], rows_of_pairs(rt))


def ratings(*, odd: str = "4") -> str:
    rows = [[f"P{p}", "ab"[k % 2], str(1 + (p + k) % 5)] for p in range(4) for k in range(10)]
    rows[3][2] = odd
    return table_text(["participant", "method", "rating"], rows)


@dataclass(frozen=True)
class Cure:
    """A table, how it is imported, what the message says, and the edit that it names.

    The edit is of the table's text, or of the command: words that are added, or that stand in
    others' places.
    """

    table: str
    command: tuple[str, ...]
    said: str
    edit: Callable[[str], str] = str
    words: tuple[str, ...] = ()
    instead: Mapping[str, str] | None = None


def swapped(old: str, new: str, times: int = -1) -> Callable[[str], str]:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, times)

    return edit


def without_line(number: int) -> Callable[[str], str]:
    def edit(text: str) -> str:
        lines = text.splitlines(keepends=True)
        del lines[number - 1]
        return "".join(lines)

    return edit


MS = pairs(lambda s: f"{1000 * s:.0f}", "rt")
CURES = {
    "milliseconds": Cure(
        MS, ("--map", "rt_s=rt"), "say its unit: metamerlab analysis import TABLE --map rt_s=rt:ms",
        instead={"rt_s=rt": "rt_s=rt:ms"},
    ),
    "milliseconds, said to be minutes": Cure(
        MS, ("--map", "rt_s=rt:min"),
        "say its unit: metamerlab analysis import TABLE --map rt_s=rt:ms",
        instead={"rt_s=rt:min": "rt_s=rt:ms"},
    ),
    "seconds, said to be microseconds": Cure(
        pairs(lambda s: f"{1e3 * s:.0f}", "rt"), ("--map", "rt_s=rt:us"), "--map rt_s=rt:ms",
        instead={"rt_s=rt:us": "rt_s=rt:ms"},
    ),
    "microseconds": Cure(
        pairs(lambda s: f"{1e6 * s:.0f}", "rt"), ("--map", "rt_s=rt"), "--map rt_s=rt:us",
        instead={"rt_s=rt": "rt_s=rt:us"},
    ),
    "a unit behind each number": Cure(
        pairs(lambda s: f"{1000 * s:.0f} ms", "rt"), ("--map", "rt_s=rt"), "--map rt_s=rt:ms",
        instead={"rt_s=rt": "rt_s=rt:ms"},
    ),
    "a unit that is none": Cure(
        MS, ("--map", "rt_s=rt:sekunden"), "must end in one of s, ms, us, ns, min after the colon",
        instead={"rt_s=rt:sekunden": "rt_s=rt:ms"},
    ),
    "a time of 0": Cure(
        pairs().replace("0.640", "0.000"), (), "--where 'rt_s>0'", words=("--where", "rt_s>0"),
    ),
    "lists of several": Cure(
        pairs(lambda s: f"[{s:.3f}, {s + 1:.3f}]" if s > 0.9 else f"[{s:.3f}]"), (),
        "write in each one's place the entry that counts: the first",
        edit=lambda text: "".join(
            line.replace('"[', "[").partition(", ")[0] + ("]\n" if ", " in line else "")
            for line in text.splitlines(keepends=True)
        ),
    ),
    "a name of a spreadsheet's date": Cure(
        pairs().replace("P0,blur,ours,blur", "P0,5-Jan,ours,5-Jan", 1), (),
        "write the name again in a column of text, or", edit=swapped("5-Jan", "blur"),
    ),
    "sep=": Cure("sep=,\n" + pairs(), (), "delete this line", edit=without_line(1)),
    "a name twice": Cure(
        pairs().replace("rt_s", "first", 1), (), "columns must have names of their own",
        edit=lambda text: text.replace("chosen,first", "chosen,rt_s", 1),
    ),
    "a row too long": Cure(
        pairs().replace(",0.640\n", ",0.640,\n", 1), (), "a separator at its end counts as a cell",
        edit=swapped(",0.640,\n", ",0.640\n"),
    ),
    "a decimal comma": Cure(
        pairs().replace("0.640", '"0,640"', 1), (), "write decimals with a point",
        edit=swapped('"0,640"', "0.640"),
    ),
    "no such column": Cure(
        pairs(), ("--map", "participant=participnt"), "did you mean 'participant'",
        instead={"participant=participnt": "participant=participant"},
    ),
    "no such name of ours": Cure(
        pairs(), ("--map", "frist=first"), "did you mean 'first'",
        instead={"frist=first": "first=first"},
    ),
    "no such column to filter by": Cure(
        pairs(), ("--where", "rt_z>0"), "did you mean 'rt_s'", instead={"rt_z>0": "rt_s>0"},
    ),
    "no such answer": Cure(
        pairs(), ("--answer", "ourz=ours"), "did you mean 'ours'",
        instead={"ourz=ours": "ours=ours"},
    ),
    "a code for no answer": Cure(
        ratings(odd="999"), RATED, "leave it out with", words=("--where", "rating!=999"),
    ),
    "a code that is meant": Cure(
        ratings(odd="999"), RATED, "say --where 'rating<=999'", words=("--where", "rating<=999"),
    ),
}  # fmt: skip


def words_of(cure: Cure) -> list[str]:
    return [(cure.instead or {}).get(word, word) for word in cure.command] + [*cure.words]


@pytest.mark.parametrize("name", CURES)
def test_a_cure_of_a_table_makes_it_importable(tmp_path, name):
    cure = CURES[name]
    table, out = tmp_path / "table.csv", tmp_path / "out"
    table.write_text(cure.table)
    said = refusal_of("analysis", "import")(table, "--out", out, *cure.command)
    assert cure.said in " ".join(said.split())
    assert not out.exists()
    table.write_text(cure.edit(cure.table))
    metamerlab("analysis", "import", table, "--out", out, *words_of(cure))
    assert len(list(out.iterdir())) >= 1


# What is read without a cure.


def test_lists_of_one_are_their_entry_as_psychopy_writes_them(tmp_path):
    rows = [
        [
            f"P{p}",
            "ab"[k % 2],
            "['left']" if k % 3 else '["right"]',
            "['left']",
            f"[{0.5 + k / 10}]",
        ]
        for p in range(3)
        for k in range(6)
    ]
    rows[0][4], rows[1][4] = "[0.7,]", "[ 7e-1 ]"
    names = ["participant", "method", "answer", "expected", "rt_s"]
    for name, text in (
        ("lists", table_text(names, rows)),
        ("plain", table_text(names, [[cell.strip("[]'\", ") for cell in row] for row in rows])),
    ):
        (tmp_path / f"{name}.csv").write_text(text)
        out = tmp_path / name
        _, notes, _ = outcome_of("analysis", "import")(
            tmp_path / f"{name}.csv", "--out", out, *BY_METHOD
        )
        read = "note: lists of one read as their entry: answer, expected, rt_s"
        assert (read in " ".join(notes.split())) == (name == "lists")
    imported = [(tmp_path / name / "decisions.csv").read_text() for name in ("lists", "plain")]
    assert imported[0].replace("7e-1", "0.7") == imported[1].replace("7e-1", "0.7")
    assert "[" not in imported[0]


@pytest.mark.parametrize("titles", [0, 1])
@pytest.mark.parametrize("quote", ['{{"ImportId":"QID{}"}}', "{{'ImportId': 'QID{}'}}"])
def test_further_lines_of_a_header_of_qualtrics_are_left_out(tmp_path, titles, quote):
    """A line of questions, and one of the program's own names."""
    again = [["Response ID", "Which?", "Which?", "Choice", "Timing"]][:titles]
    ids = [quote.format(number) for number in range(5)]
    table = tmp_path / "table.csv"
    table.write_text(table_text([*HEAD[:-1], "rt_s"], [*again, ids, *rows_of_pairs()]))
    _, said, _ = outcome_of("analysis", "import")(table, "--out", tmp_path / "out")
    assert "Qualtrics' further lines of the header" in " ".join(said.split())
    assert "32 decisions of 4 participants" in said


# Pictures: a folder, a command that is refused, and the option or the file that the message names.


def picture_files(folder: Path) -> None:
    rng = np.random.default_rng(3)
    for name in ("a.png", "b.png"):
        write_pixels(folder / name, rng.integers(70, 150, (24, 32, 3)).astype(np.uint8), "RGB")
    disparity = rng.uniform(2, 4, (24, 32)).astype(np.float32)
    np.save(folder / "negative.npy", -disparity)
    np.save(folder / "turned.npy", disparity)
    disparity[:6] = -1000
    np.save(folder / "holes.npy", disparity)
    np.save(folder / "nan.npy", np.where(disparity < 0, np.nan, disparity))
    np.save(folder / "vectors.npy", np.ones((24, 32, 3), np.float32))
    np.save(folder / "flow.npy", np.ones((24, 32, 2), np.float32))


PICTURES = {
    "disparity of the other sign": (
        "--disparity negative.npy", "write it with its sign turned", "--disparity turned.npy",
    ),
    "a number for unknown": (
        "--disparity holes.npy", "--unknown -1000", "--disparity holes.npy --unknown -1000",
    ),
    "a number for unknown, written as NaN": (
        "--disparity holes.npy", "if it stands for unknown", "--disparity nan.npy",
    ),
    "no flow": (
        "--flow vectors.npy", "numpy.save(file, flow), of floats of shape (H, W, 2)",
        "--flow flow.npy",
    ),
}  # fmt: skip


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize("name", PICTURES)
def test_a_cure_of_a_picture_makes_it_warpable(tmp_path, monkeypatch, name):
    refused, cure, taken = PICTURES[name]
    monkeypatch.chdir(tmp_path)
    picture_files(tmp_path)
    words = ("a.png", "out.png", "-m", "push-pull")
    assert cure in " ".join(refusal_of("warp")(*words, *refused.split()).split())
    assert not (tmp_path / "out.png").exists()
    metamerlab("warp", *words, *taken.split())
    assert (tmp_path / "out.png").is_file()
