"""The issue's own cases: where commands were told to write, a user's files went."""

import signal
import time
from pathlib import Path

import pytest
from command_line import metamerlab
from forked import Forked
from PIL import Image

from protocols.disk.result_folder import LISTING

TABLE = "participant,method,rt_s\n" + "".join(
    f"P{n % 4},{'ab'[n % 2]},{0.4 + n / 50}\n" for n in range(24)
)
PRECIOUS = (
    "study.toml", "study.secret", "sessions/made/P01/journal.jsonl",
    "sessions/made/P02/journal.jsonl", "sessions/made/P03/journal.jsonl", "results.json",
    "decisions.csv", "power.json",
)  # fmt: skip
"""Among them, each file by which a folder once was taken for an earlier result."""


def run(*words: object) -> tuple[int, str]:
    done = metamerlab(*words, catch_exceptions=False, status=None)
    return done.exit_code, " ".join(done.output.split())


def held(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def study(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in PRECIOUS:
        (tmp_path / "study" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "study" / name).write_text("precious")
    (tmp_path / "study" / "t.csv").write_text(TABLE)
    return tmp_path / "study"


@pytest.mark.parametrize("out", ["study", "study/../study", "{here}/study", "link"])
def test_a_study_is_never_replaced_by_what_is_found_in_it(study, out):
    Path("link").symlink_to("study")
    before = held(Path())

    code, said = run(
        "analysis", "reaction", "study/t.csv", "--by", "method",
        "--out", out.format(here=Path.cwd()), "--replace",
    )  # fmt: skip

    assert code == 2
    assert "must not hold what this command reads (study/t.csv)" in said
    assert held(Path()) == before
    assert study.is_dir()


@pytest.mark.parametrize(
    "words",
    [
        ("reaction", "t.csv", "--by", "method"),
        ("import", "t.csv", "--task", "ratings", "--map", "rating=rt_s", "--set", "by=method"),
        ("power", "--pairs", "1", "--scenes", "2", "--repeats", "2", "--participants", "4",
         "--rate", "0.8", "--studies", "100"),
    ],
)  # fmt: skip
def test_a_folder_with_a_file_called_as_a_results_is_no_earlier_result(study, words):
    (study / "t.csv").rename("t.csv")
    before = held(Path())

    code, said = run("analysis", *words, "--out", "study", "--replace")

    assert code == 2
    assert "must be empty or new (it holds decisions.csv, and no list of what" in said
    assert held(Path()) == before


SLOW = [
    *(
        f"analysis {name} no-table.csv"
        for name in (
            "reaction --by method", "detection", "ratings --by method", "import", "report",
            "psychometric --level level",
        )
    ),
    "analysis power no-study.toml",
    "analysis export no-sessions --protocol demo --format bids",
]  # fmt: skip


@pytest.mark.usefixtures("study")
@pytest.mark.parametrize("out", ["study", "study/t.csv", "study/t.csv/below"])
@pytest.mark.parametrize("words", SLOW)
def test_a_bad_place_is_told_before_anything_is_read(words, out):
    """Files to be read are not there, so a command that looks at them first says that."""
    Path("no-table.csv").write_bytes(b"")
    before = held(Path())

    code, said = run(*words.split(), "--out", out)

    assert code == 2
    assert said.startswith(f"error: {out}: ")
    assert held(Path()) == before


@pytest.mark.slow
def test_a_result_is_never_replaced_from_a_table_of_its_own(study):
    (study / "t.csv").rename("t.csv")
    words = ("analysis", "reaction", "t.csv", "--by", "method", "--out", "times")
    assert run(*words)[0] == run(*words, "--replace")[0] == 0
    before = held(Path("times"))
    table = next(name for name in before if name.endswith(".csv"))

    code, said = run("analysis", "reaction", f"times/{table}", "--by", "method", "--out", "times",
                     "--replace")  # fmt: skip

    assert code == 2
    assert held(Path("times")) == before, said


def test_tables_over_the_sessions_that_they_are_of_are_refused(
    tmp_path, demo_protocol, write_journals
):
    write_journals(tmp_path / "sessions", people=1)
    (tmp_path / "sessions" / "decisions.csv").write_text("an earlier version wrote this")
    before = held(tmp_path)

    place = tmp_path / "sessions"
    code, said = run(
        "analysis", "tidy", place, "--protocol", demo_protocol.study.name, "--out", place,
        "--replace",
    )  # fmt: skip

    assert code == 2
    assert "must not hold what this command reads" in said
    assert held(tmp_path) == before


@pytest.mark.slow
@pytest.mark.parametrize("out", [".", "../times", "{here}"])
def test_from_inside_a_result_it_is_refused_and_nothing_is_put_beside_it(study, monkeypatch, out):
    (study / "t.csv").rename("t.csv")
    words = ("analysis", "reaction", Path("t.csv").resolve(), "--by", "method", "--out")
    assert run(*words, "times")[0] == 0
    before = held(Path())
    monkeypatch.chdir("times")

    for _ in range(2):
        code, said = run(*words, out.format(here=Path.cwd()), "--replace")
        assert code == 2
        assert "run it from another folder" in said
    monkeypatch.chdir("..")
    assert held(Path()) == before
    assert names(Path()) == ["study", "t.csv", "times"]
    assert run(*words, "times", "--replace")[0] == 0


@pytest.mark.slow
def test_a_result_of_an_earlier_version_is_left_to_its_user(study):
    """It has no listing: what the message says must work."""
    (study / "t.csv").rename("t.csv")
    words = ("analysis", "reaction", "t.csv", "--by", "method", "--out", "times", "--replace")
    assert run(*words)[0] == 0
    (Path("times") / LISTING).unlink()

    code, said = run(*words)

    assert (code, "delete this one yourself" in said) == (2, True)
    for path in sorted(Path("times").rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    assert run(*words)[0] == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_clip_of_frames_takes_nothing_of_a_users_and_the_next_goes_on(tmp_path, number):
    frames, out = tmp_path / "frames", tmp_path / "out"
    frames.mkdir()
    for index in range(60):  # more than end while the test waits for its turn
        Image.new("RGB", (128, 96), (index, 90, 30)).save(frames / f"{index:06d}.png")
    words = ("foveate", frames, out, "--numpy", "--method", "metamer")
    process = Forked(*words)
    began = time.monotonic()
    while not list(tmp_path.glob(".out.unfinished-*/new/*.png")):
        assert process.poll() is None
        assert time.monotonic() - began < 100
        time.sleep(0.01)
    out.mkdir()
    (out / "thesis.txt").write_text("precious")
    process.send_signal(number)
    assert process.wait() != 0

    if number == signal.SIGINT:
        assert names(out) == ["thesis.txt"]
    assert (out / "thesis.txt").read_text() == "precious"
    (out / "thesis.txt").unlink()
    assert run(*words[:-1], "blur")[0] == 0
    assert names(out) == names(frames)
