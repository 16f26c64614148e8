"""Cures that messages name, each followed to the letter on what caused the message."""

import csv
import io
import re
import shlex
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from command_line import metamerlab, outcome_of, refusal_of
from task_cases import CASES, case_text
from web_kernel import running_kernel
from web_study import built

from pipeline.pictures.write import write_pixels
from protocols.load import load_study

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


# Files, commands and pictures: what a message names is taken from it, as ``{}``.

BROKEN = {  # A file, text in it, a mistake, and what stands for it after the cure.
    "a key": ("study.toml", "repeats", "repeets", "did you mean '(.+?)'", "{}"),
    "a section": ("study.toml", "design]", "desing]", "did you mean '(.+?)'", "{}]"),
    "a key in ms": ("study.toml", "gap_s = 0.5", "gap_ms = 500", r"(gap_s = [\d.]+)\?", "{}"),
    "a choice": ("study.toml", '"enforce"', '"enforced"', "did you mean ('enforce')", "{}"),
    "a display's file": ("study.toml", "desk.toml", "dekstop.toml", r"mean (desk\.toml)\?", "{}"),
    "a display's name": ("study.toml", "desk.toml", "fhd27", "did you mean '(fhd27-60hz)'", "{}"),
    "25 fps at 60 Hz": ("study.toml", "fps = 30.0", "fps = 25", r"nearest: (\d+) fps", "fps = {}"),
    "width in m": ("desk.toml", "width_mm = 192.0", "width_m = 0.192", r"(width_mm = 192)\?", "{}"),
    "width in cm": ("desk.toml", "192.0", "19.2", r"\(width_mm; .* should it be (192)\?", "{}"),
    "height in m": ("desk.toml", "144.0", "0.144", r"\(height_mm; .* should it be (144)\?", "{}"),
    "kHz": ("desk.toml", "60.0", "0.06", r"refresh_hz: .* should it be (60)\?", "{}"),
}
FOLLOWED = {  # A command, with [what is refused|what the cure puts in its place].
    "a study": ("protocol copy [dmo|{}] own.toml", "did you mean '(demo)'"),
    "a file that is there": ("protocol copy demo [study|other].toml", "choose a new name"),
    "a tracker": ("protocol check study.toml --gaze [lsll|{}]", "did you mean '(lsl)'"),
    "a task": ("new-study own --task [yesno|{}]", "did you mean '(yes-no)'"),
    "no clips": (
        "[protocol check study.toml --stimuli built|{0} study.toml {1}]",
        "run 'metamerlab (stimuli build) STUDY (--out built)' to the end",
    ),
    "sessions among clips": (
        "session simulate web.toml --out [stimuli/sessions|others]", "name another folder",
    ),
    "another observer": (
        "session simulate study.toml --out [sessions|others] --participants 3", "or another folder",
    ),
    "a study of sessions": ("session list sessions --study [dem|{}]", "did you mean '(demo)'"),
    "a participant": ("session [withdraw S077 --yes|{} sessions]", "metamerlab session (list)'"),
    "a session": ("session [status|{}] sessions", "'metamerlab session (list)' names them"),
    "a journal's study": ("session verify sessions[ --protocol web.toml|]", "or leave it out"),
    "no study": ("analysis report sessions --out r[| {} study.toml]", "(--protocol) must name"),
    "settings for sessions": (
        "analysis report sessions --protocol study.toml --out report[ --set alpha=0.1|]",
        "--where and --set must be left out",
    ),
    "sessions of another study": (
        "analysis tidy sessions --protocol [web|study].toml --out tidy", "give the protocol file",
    ),
    "results among what was read": (
        "analysis tidy sessions --protocol study.toml --out [sessions|tidy]", "another folder",
    ),
    "an earlier result": (
        "analysis tidy sessions --protocol study.toml --out earlier[| {}]", "or add (--replace)",
    ),
    "a folder that was imported": (
        "[analysis report imported|{}] --out report", r"metamerlab (analysis report \S+csv)\)",
    ),
    "a comparison": (
        "analysis report table.csv --out report --set primary=[our/blur|{}]", "mean '(.+?)'",
    ),
    "a setting": (
        "analysis report table.csv --out report --set [primry|{}]=ours/blur", "mean '(.+?)'",
    ),
    "a design in part": (
        "[analysis power --pairs 3|{} --studies 100]", "metamerlab (analysis power .*)$",
    ),
    "an export of no clips": (
        "session export-web web.toml --stimuli [clips|stimuli] --out web", "a finished batch",
    ),
    "results that are elsewhere": (
        "session import-web [result.txt|{}] --protocol web.toml --stimuli stimuli", r"mean (\S+)\?",
    ),
    "results of another study": (
        "session import-web results.txt --protocol [study|web].toml --stimuli stimuli",
        "name that study's file",
    ),
    "a condition": ("foveate a.png out.png --methods [metamr|{}]", "did you mean '(.+?)'"),
    "a display and an angle": (
        "foveate a.png out.png[ --fov 40|] --display fhd27-60hz", "give --display or --fov",
    ),
    "a gaze": ("foveate a.png out.png --gaze [20|{}]", r"such as (\S+deg,\S+deg)"),
    "all around": ("foveate around.png out.png [--fov 360|{}]", "takes (--panorama)"),
    "a kind of file": ("foveate a.png out[.xyz|{}]", r"must end in (\.png)"),
    "a method": ("warp a.png o.png --disparity turned.npy -m [push-pul|{}]", "mean '(.+?)'"),
    "two methods": (
        "warp a.png o.png --disparity turned.npy -m push-pull,telea[| {} sheet.png]",
        "add (--compare) FILE",
    ),
    "no depth": ("warp a.png o.png -m telea[| {} turned.npy]", "come with (--disparity) FILE"),
    "a parameter": (
        "warp a.png o.png --disparity turned.npy -m telea --set [radus_px|{}]=3", "mean '(.+?)'",
    ),
    "a source": ("warp a.png [a|o].png --disparity turned.npy -m telea", "write to another file"),
    "a scene": ("texture show [planett|{}] --out out.png --size-px 64", "did you mean '(.+?)'"),
    "a baked texture": ("texture bake a.png --out a[.moment|{}]", r"must end in (\.moments)"),
    "one picture": (
        "stimuli score a.png[| b.png --metrics psnr]", "metamerlab stimuli score TEST REFERENCE",
    ),
    "a metric": ("stimuli score a.png b.png --metrics [psnrr|{}]", "did you mean '(.+?)'"),
}  # fmt: skip
CAMERA = "warp a.png out.png --depth turned.npy --target-pose pose.txt:1 -m push-pull --camera "
ASKED = {
    "foveate around.png out.png --fov {}": ("0.2", "11.5", "degrees are meant: should it be 11.46"),
    "warp a.png out.png --disparity turned.npy -m push-pull --baseline-m {}": (
        "193", "0.193", "metres are meant: should it be 0.193?",
    ),
    CAMERA + "{}": ("1.2,1.2,0.5,0.5", "32,32,16,12", "are all of --camera pixels of it?"),
}  # fmt: skip


@pytest.fixture(scope="module")
def lab_once(tmp_path_factory, recorded_once):
    """Return a folder with studies, sessions, clips, tables and pictures; nobody changes it."""
    folder = recorded_once.copy(tmp_path_factory.mktemp("cures") / "lab").folder
    text = case_text(CASES["yes-no"]) + '\n[web]\ngaze = "none"\n'
    (folder / "web.toml").write_text(text)
    web = built(load_study(folder / "web.toml")[0], folder)
    with running_kernel(folder) as kernel:
        (folder / "results.txt").write_text("".join(web.session(kernel)["results"]))
    (folder / "table.csv").write_text(pairs())
    (folder / "pose.txt").write_text("0.1 0 0 0 0 0 1\n")
    picture_files(folder)
    around = np.random.default_rng(4).integers(0, 255, (64, 128, 3)).astype(np.uint8)
    write_pixels(folder / "around.png", around, "RGB")
    metamerlab("analysis", "import", folder / "table.csv", "--out", folder / "imported")
    tidy = ("--protocol", folder / "study.toml", "--out", folder / "earlier")
    metamerlab("analysis", "tidy", folder / "sessions", *tidy)
    return folder


@pytest.fixture
def lab(lab_once, tmp_path, monkeypatch):
    """Stand in a copy of the folder."""
    shutil.copytree(lab_once, tmp_path / "lab")
    monkeypatch.chdir(tmp_path / "lab")


def found_in(said: str, cure: str) -> tuple[str, ...]:
    match = re.search(cure, " ".join(said.split()))
    assert match, said
    return match.groups()


@pytest.mark.slow
@pytest.mark.usefixtures("lab")
@pytest.mark.parametrize("name", BROKEN)
def test_a_cure_of_a_file_puts_it_in_order(name):
    file, right, wrong, cure, mended = BROKEN[name]
    text = Path(file).read_text()
    assert right in text
    Path(file).write_text(text.replace(right, wrong, 1))
    found = found_in(refusal_of("protocol", "check")("study.toml"), cure)
    Path(file).write_text(text.replace(right, mended.format(*found), 1))
    metamerlab("protocol", "check", "study.toml")


@pytest.mark.slow
@pytest.mark.usefixtures("gl_context", "lab")
@pytest.mark.parametrize("name", FOLLOWED)
def test_a_cure_that_a_command_names_makes_it_work(name):
    command, cure = FOLLOWED[name]
    refused = re.sub(r"\[(.*?)\|.*?\]", r"\1", command)
    found = found_in(refusal_of(*shlex.split(refused))(), cure)
    metamerlab(*shlex.split(re.sub(r"\[.*?\|(.*?)\]", r"\1", command).format(*found)))


@pytest.mark.usefixtures("lab")
def test_a_study_is_made_one_for_browsers_as_the_message_says():
    web = Path("web.toml")
    web.write_text(web.read_text().partition("[web]")[0])
    export = ("session", "export-web", "web.toml", "--stimuli", "stimuli", "--out", "web")
    section, key = found_in(refusal_of(*export)(), r"add (\[web\]) with (gaze = \S+)")
    web.write_text(f"{web.read_text()}{section}\n{key}\n")
    metamerlab(*export)


@pytest.mark.usefixtures("lab")
def test_a_journal_that_was_changed_is_restored_from_a_copy():
    journal = Path("sessions/demo/S001/journal.jsonl")
    text = journal.read_text()
    journal.write_text(text.replace('"attempt"', '"attempd"', 1))
    found_in(refusal_of("session", "verify", "sessions")(), "1 of .* must be restored from a copy")
    journal.write_text(text)
    metamerlab("session", "verify", "sessions")


@pytest.mark.slow
@pytest.mark.usefixtures("gl_context", "lab")
@pytest.mark.parametrize("command", ASKED)
def test_a_number_of_a_picture_in_another_unit_is_asked_about(command):
    wrong, right, asked = ASKED[command]
    for given, told in ((wrong, True), (right, False)):
        done = metamerlab(*shlex.split(command.format(given)))
        assert (asked in " ".join(done.output.split())) == told
