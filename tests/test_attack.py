"""No harmed file is more than one message; and the tool that harms them finds what falls."""

import faulthandler
import json
import math
import os
import re
import time
from dataclasses import dataclass
from pathlib import Path
from random import Random

import pytest
from attack import bombs, campaign, home_lines, mutations, outputs
from attack.__main__ import main
from attack.campaign import run_inputs
from attack.mutations import mutated
from attack.readers import READERS, Reader, absurd, write_samples

from protocols.errors import StudyError
from protocols.recipes.files import read_table as read_stimuli

INPUTS = 100_000
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
    pytest.mark.timeout(7200),  # --full
]


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    write_samples(folder)
    return folder


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_whole_files_are_read(samples, reader):
    assert absurd(reader.read(samples / reader.file), reader) is None


@pytest.mark.slow
def test_harmed_files_are_refused_in_one_message_or_read(full, tmp_path):
    """Some twenty for each reader, always the same; with --full 10^5, each run others."""
    seed = time.time_ns() % 10**6 if full else 24  # CI meets the same files each time
    results = run_inputs(seed, INPUTS if full else 20 * len(READERS), keep=tmp_path)

    assert [failure for result in results for failure in result.failures] == [], f"seed {seed}"
    assert all(result.refused for result in results if result.inputs > 15)
    assert any(result.refused < result.inputs for result in results)


def replaced(pattern: bytes, with_: bytes):
    return lambda data: re.sub(pattern, lambda _match: with_, data)


FOUND = [
    ("gaze-of-a-sitting", "a lone return", lambda data: data.replace(b"\n", b"\r", 3)[:60]),
    ("gaze-asc", "a blink that ends first", replaced(b"EBLINK L 136", b"EBLINK L 999")),
    ("display-toml", "400 digits", replaced(rb"width_px = \d+", b"width_px = " + b"9" * 400)),
    ("study-toml", "an endless pattern", replaced(rb"\{2,32\}", b"{" + b"9" * 30 + b"}")),
    ("mesh-gltf", "400 digits of bytes", replaced(rb'h": ?\d+', b'h":' + b"9" * 400)),
    ("mesh-gltf", "bytes without end", replaced(rb'h": ?\d+', b'h":1e999')),
    ("pose", "an infinite place", lambda _data: b"0 0 0 0 0 0 1\ninf 0 0 0 0 0 1\n"),
    ("mesh-gltf", "a name that is no text", replaced(rb'"name": ?"[^"]*"', rb'"name":"\ud800"')),
    ("study-toml", "clips of 1e308 s", replaced(rb"duration_s = 1.0", b"duration_s = 1e308")),
    ("network-onnx", "a size that is no text", lambda data: data.replace(b"\x01H", b"\x01\xff")),
]


@pytest.mark.parametrize(("name", "what", "harm"), FOUND, ids=[entry[1] for entry in FOUND])
def test_what_an_attack_found_once_is_refused_in_one_message(samples, capsys, name, what, harm):
    del what
    reader = next(reader for reader in READERS if reader.name == name)
    path = samples / reader.file
    data = path.read_bytes()
    harmed = harm(data)
    assert harmed != data
    path.write_bytes(harmed)
    try:
        assert campaign.meet(reader, path) == (None, True)
    finally:
        path.write_bytes(data)
    assert len(capsys.readouterr().err) < 5000


def test_a_number_of_400_digits_in_a_table_of_stimuli_is_text(tmp_path):
    path = tmp_path / "stimuli.csv"
    path.write_text("stimulus,file,scene,level\na,a.png,one," + "9" * 400 + "\n")
    (row,) = read_stimuli(path)
    assert row["condition"] == {"scene": "one", "level": "9" * 400}


@pytest.mark.slow
@pytest.mark.parametrize("name", bombs.QUICK)
def test_a_small_file_takes_no_machine(tmp_path, name):
    bomb = next(bomb for bomb in bombs.BOMBS if bomb.name == name)
    met = bombs.meet(bomb, tmp_path / "bomb")
    assert met.wrong is None
    assert met.status == 2


SEED_OF_CHEAP_BOMBS = 7
"""Two of them in seconds; with --full all are met, in minutes."""


@pytest.mark.slow
def test_no_small_file_takes_the_machine_whatever_the_command(full, tmp_path):
    """Always a journal whose lines were copied for each line, so that busy machines took 40 s."""
    met = bombs.run_bombs(len(bombs.BOMBS) if full else 2, SEED_OF_CHEAP_BOMBS)
    journal = next(bomb for bomb in bombs.BOMBS if bomb.name == "journal of 90 MB of lines")
    met.append(bombs.meet(journal, tmp_path / "journal"))
    assert [(one.name, one.wrong) for one in met if one.wrong] == []


SOME = [
    *(("new-study", place) for place in ("mine", "link", "dot", "full")),
    *(("copy", place) for place in ("mine", "full")),
]


@pytest.mark.slow
def test_whatever_place_a_command_is_given_a_users_files_stay():
    assert outputs.attack_outputs(SOME, 24) == (len(SOME), [])


@pytest.mark.slow
def test_whatever_place_any_command_is_given_a_users_files_stay(full):
    """A few places of each command, always the same; with --full all of them."""
    seed = time.time_ns() % 10**6 if full else 24
    cases = outputs.CASES if full else Random(seed).sample(outputs.CASES, 15)
    assert outputs.attack_outputs(cases, seed) == (len(cases), []), f"seed {seed}"


@pytest.mark.slow
def test_an_honest_participant_is_imported_whatever_another_sends(full, tmp_path):
    """Some edits of one task, always the same; with --full 2,000 of five tasks, each run others."""
    seed = time.time_ns() % 10**6 if full else 24
    tasks = home_lines.TASKS if full else home_lines.TASKS[:1]
    results = home_lines.attack_lines(2000 if full else 16, seed, tmp_path, tasks=tasks)
    assert [failure for result in results for failure in result.failures] == [], f"seed {seed}"
    assert sum(result.refused for result in results) > (1000 if full else 6)


@pytest.mark.slow
def test_an_honest_participant_who_is_lost_is_found_out(tmp_path, monkeypatch):
    monkeypatch.setattr(home_lines, "HOSTILE", home_lines.HONEST)  # both have one code
    (text, archive) = home_lines.attack_lines(4, 3, tmp_path, tasks=home_lines.TASKS[:1])
    found = [*text.failures, *archive.failures]
    assert found
    assert {failure.kind for failure in found} == {"traceback"}
    assert "the honest session is another" in found[0].said


# --- the tool itself ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Read:
    duration_s: float
    size_px: tuple[int, int] = (3, 4)


def grow(_path: Path) -> None:
    _ = bytearray(b"x") * (1 << 28)


def abort(_path: Path) -> None:
    faulthandler.disable()  # or pytest writes its whole stack into the log of a run that passes
    os.abort()


def say_nothing(_path: Path) -> None:
    raise StudyError("")


def read_as(behave) -> Reader:
    return Reader("broken", "poses.txt", mutations.PLAIN, behave)


@pytest.mark.parametrize(
    ("behave", "kind"),
    [
        (lambda _path: 1 / 0, "traceback"),
        (abort, "crash"),
        (lambda _path: __import__("time").sleep(1000), "hang"),
        (grow, "memory"),
        (lambda _path: Read(-1.0), "absurd"),
        (lambda _path: Read(math.nan), "absurd"),
        (lambda _path: Read(1.0, (-3, 4)), "absurd"),
        (say_nothing, "message"),
    ],
)
def test_a_reader_that_fails_is_found_out_and_its_input_kept(monkeypatch, tmp_path, behave, kind):
    if kind == "hang":
        monkeypatch.setattr(campaign, "HANG_WALL_S", 0.4)
    monkeypatch.setattr(campaign, "GROWTH_MIB", 100)
    count = 1 if kind in ("hang", "memory") else 3
    (result,) = run_inputs(5, count, readers=[read_as(behave)], keep=tmp_path)

    assert [failure.kind for failure in result.failures] == [kind] * count
    assert len(list(tmp_path.iterdir())) == count
    assert (result.inputs, result.refused) == (count, 0)


HARM = """
import pathlib, shutil, sys
out = pathlib.Path(sys.argv[-2]).resolve()
{harm}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "harm", "found"),
    [
        ("mine", "(out / 'thesis.txt').unlink()", "lost ['mine/thesis.txt']"),
        ("dot", "(out / 'study.secret').write_text('')", "lost ['mine/study.secret']"),
        ("link", "shutil.rmtree(out)", "lost ['mine'"),
        ("input", "sys.exit(2)", "refused without a word"),
        ("mine", "(out.parent / 'half').touch(); sys.exit('no')", "status 1: no"),
        ("mine", "(out / 'half').touch(); print('no', file=sys.stderr); sys.exit(2)",
         "refused, and changed ['mine/half']"),
        ("mine", "(out.parent / '.mine.unfinished-abc').mkdir()", "left ['.mine.unfinished-abc']"),
        ("mine", "1 / 0", "ZeroDivisionError"),
        ("new", "print('no', file=sys.stderr); sys.exit(2)", "refused: no"),
    ],
)  # fmt: skip
def test_a_command_that_harms_what_lies_at_its_place_is_found_out(monkeypatch, place, harm, found):
    monkeypatch.setattr(outputs.forked, "METAMERLAB", HARM.format(harm=harm))
    monkeypatch.setattr(outputs._Case, "_mine", lambda case: filled(case.folder / "mine"))
    done, failures = outputs.attack_outputs([("import", place)], 1)
    assert done == 1
    assert found in failures[0]


def filled(folder: Path) -> Path:
    outputs._fill(folder, outputs.MINE)
    return folder


def test_a_traceback_names_our_innermost_line():
    def falls(path: Path) -> None:
        raise RuntimeError(path.name)

    (result,) = run_inputs(5, 1, readers=[read_as(falls)])
    assert "tests/test_attack.py:" in result.failures[0].where


@pytest.mark.parametrize(
    ("code", "wrong"),
    [
        ("x = bytearray(b'x') * (300 << 20); print(len(x))", "MiB"), ("1 / 0", "status 1"),
        ("while True: pass", "status -9"), ("raise SystemExit(2)", "refused without a word"),
        ("pass", None),
    ],
)  # fmt: skip
def test_a_command_that_falls_to_a_bomb_is_found_out(monkeypatch, tmp_path, code, wrong):
    monkeypatch.setattr(bombs, "MOST_MIB", 200)
    monkeypatch.setattr(bombs, "MOST_CPU_S", 0.2 if "while" in code else 20.0)
    met = bombs.meet(bombs.Bomb("own", lambda _: None, "", code), tmp_path / "bomb")
    assert (met.wrong is None) == (wrong is None)
    assert wrong is None or wrong in met.wrong


def test_an_input_follows_from_seed_reader_and_number(samples):
    for reader in READERS[::4]:
        first, again, other = (campaign.harmed(seed, reader, 3, samples) for seed in (1, 1, 2))
        assert first == again
        assert first != other or len(first) < 40


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_what_packs_or_seals_a_file_is_no_shelter(samples, reader):
    """Most harm is done inside: taken apart and put together again, a file is still whole."""
    data = (samples / reader.file).read_bytes()
    shape = reader.shape
    again = samples / reader.file
    again.write_bytes(shape.outside(data, shape.inside(data)))
    try:
        assert absurd(reader.read(again), reader) is None
    finally:
        again.write_bytes(data)
    assert any(mutated(Random(n), data, shape) != data for n in range(20))


def test_the_command_writes_figures_and_a_table_and_reads_kept_files_again(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- attack: begin -->\nold\n<!-- attack: end -->\nafter\n")
    status = main(
        ["--inputs", "12", "--faults", "40", "--captures", "20", "--kills", "1", "--guesses", "2",
         "--bombs", "1",
         "--seed", "3", "--reader", "pose", "--json", "figures.json", "--page", str(page)]
    )  # fmt: skip
    figures = json.loads(Path("figures.json").read_text())

    assert status == 0
    counts = {"inputs": 12, "faults": 40, "captures": 20, "kills": 1, "guesses": 2, "bombs": 1}
    assert {kind: found["done"] for kind, found in figures.items()} == counts
    assert {found["seed"] for found in figures.values()} == {3}
    assert "| harmed files" in page.read_text()
    assert "old" not in page.read_text()
    Path("kept.txt").write_text("1 nan 0 0 0 0 0 1\n")
    assert main(["--reader", "pose", "--again", "kept.txt"]) == 0
    assert "refused" in capsys.readouterr().out
