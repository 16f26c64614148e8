"""Folders that commands fill: whole or absent; what is no result of ours stays as it was."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from protocols.disk.result_folder import LISTING, whole_folder
from protocols.errors import StudyError


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Return every file and folder below, with what files hold."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def earlier(out: Path, **files: str) -> Path:
    """Write a result that lists its files."""
    with whole_folder(out, replace=False) as work:
        for name, text in ({"m.json": "old"} | files).items():
            (work / name).parent.mkdir(exist_ok=True)
            (work / name).write_text(text)
    return out


def again(out: Path, **options: object) -> None:
    with whole_folder(out, replace=True, **options) as work:
        (work / "m.json").write_text("new")


def test_a_result_appears_whole_or_not_at_all(tmp_path):
    def stop_half_way() -> None:
        with whole_folder(tmp_path / "out") as work:
            (work / "half.txt").write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        stop_half_way()

    assert list(tmp_path.iterdir()) == []
    with whole_folder(tmp_path / "out") as work:
        (work / "m.json").write_text("{}")
        assert not (tmp_path / "out").exists()
    assert (tmp_path / "out" / "m.json").exists()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_result_is_replaced_by_the_next_with_all_its_files(tmp_path):
    out = earlier(tmp_path / "out", **{"tables/a.csv": "1"})
    (out / "tables" / "a.csv").unlink()  # what is missing is no loss

    again(out)

    assert {path.name for path in out.iterdir()} == {"m.json", LISTING}
    assert (out / "m.json").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


REPORTING = """
import sys, time
from pathlib import Path
from protocols.disk.result_folder import whole_folder
with whole_folder(Path(sys.argv[1]), replace=True) as work:
    (work / "half.txt").write_text("half")
    print(work.parent.name, flush=True)
    time.sleep(600)
"""


def start_reporting(out) -> tuple[subprocess.Popen, str]:
    """Start a program that is half way; return it and the name of its working folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", REPORTING, out], stdout=subprocess.PIPE, text=True
    )
    return process, process.stdout.readline().strip()


def test_what_a_killed_program_left_is_cleared_by_the_next_and_what_a_living_one_holds_is_not(
    tmp_path,
):
    out = tmp_path / "a report"
    foreign = tmp_path / ".a report.unfinished-by hand"
    foreign.mkdir()
    killed, left = start_reporting(out)
    living, held = start_reporting(out)
    other, others = start_reporting(tmp_path / "b")
    with killed, living, other:
        try:
            killed.kill()
            killed.wait()
            other.kill()
            other.wait()
            assert {left, held, others} <= {path.name for path in tmp_path.iterdir()}

            again(out)

            names = {path.name for path in tmp_path.iterdir()}
            assert names == {"a report", foreign.name, held, others}
            assert (tmp_path / held / "new" / "half.txt").read_text() == "half"
            assert (out / "m.json").exists()
        finally:
            living.kill()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_result_killed_between_its_two_moves_is_cleared_once_there_is_a_new_one(tmp_path):
    """The earlier result lies in `.out.old-*` then, and goes when there is another."""
    out = earlier(tmp_path / "out")
    child = os.fork()
    if not child:
        replace = Path.replace
        Path.replace = lambda self, to: os._exit(9) if self.name == "new" else replace(self, to)
        again(out)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    (old,) = tmp_path.glob(".out.old-*")

    with pytest.raises(RuntimeError), whole_folder(out):
        raise RuntimeError
    assert (old / "was" / "m.json").read_text() == "old"

    again(out)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("kind", ["unfinished", "old"])
def test_a_folder_that_is_only_called_like_a_killed_programs_stays(tmp_path, kind):
    mine = tmp_path / f".out.{kind}-abcd1234"
    for below in ("new", "was"):
        (mine / below).mkdir(parents=True)
        (mine / below / "thesis.txt").write_text("precious")
    before = snapshot(tmp_path)

    earlier(tmp_path / "out")
    again(tmp_path / "out")

    assert before.items() <= snapshot(tmp_path).items()


def test_a_replacement_that_cannot_be_moved_puts_the_earlier_result_back(tmp_path, monkeypatch):
    out = earlier(tmp_path / "out")
    before = snapshot(tmp_path)
    replace = Path.replace

    def fail(self, target):
        if self.name == "new":
            raise OSError(errno.EIO, "Input/output error", str(self))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="Input/output"):
        again(out)

    assert snapshot(tmp_path) == before


def put(name: str):
    def change(out: Path) -> None:
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("precious")

    return change


STRANGE = {
    "thesis.txt": put("thesis.txt"),
    "tables/notes.txt": put("tables/notes.txt"),
    ".hidden": put(".hidden"),
    "m.json, which was changed": put("m.json"),
    "kept, a folder": lambda out: (out / "kept").mkdir(),
    "linked, a symbolic link": lambda out: (out / "linked").symlink_to("m.json"),
    "m.json, a symbolic link": lambda out: [
        (out / "m.json").rename(out.parent / "m.json"),
        (out / "m.json").symlink_to("../m.json"),
    ],
    "m.json, which": lambda out: [(out / "m.json").unlink(), os.mkfifo(out / "m.json")],
}


@pytest.mark.parametrize("named", STRANGE)
def test_what_a_result_does_not_list_is_named_and_nothing_is_replaced(tmp_path, named):
    out = earlier(tmp_path / "out", **{"tables/a.csv": "1"})
    STRANGE[named](out)
    before = snapshot(tmp_path)

    with pytest.raises(StudyError) as caught:
        again(out)

    assert f"it holds {named}" in str(caught.value)
    assert "move that away" in str(caught.value)
    assert snapshot(tmp_path) == before


def test_what_is_put_there_while_a_result_is_replaced_stays(tmp_path):
    out = earlier(tmp_path / "out")

    def disturbed() -> None:
        with whole_folder(out, replace=True) as work:
            (work / "m.json").write_text("new")
            (out / "thesis.txt").write_text("precious")

    with pytest.raises(StudyError, match=r"thesis\.txt"):
        disturbed()

    assert (out / "thesis.txt").read_text() == "precious"
    assert (out / "m.json").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    "listing",
    ["", "[]", "{}", '{"files": []}', '{"files": {"../precious": 3}}', "[" * 100_000, "\xff"],
)
def test_a_folder_without_a_listing_that_can_be_read_is_left_alone(tmp_path, listing):
    """As results of versions before this one have none."""
    (tmp_path / "precious").write_text("mine")
    out = tmp_path / "out"
    out.mkdir()
    (out / "results.json").write_text("{}")
    (out / LISTING).write_bytes(listing.encode("latin-1"))
    before = snapshot(tmp_path)

    with pytest.raises(StudyError, match=r"delete this one yourself|move that away"):
        again(out)

    assert snapshot(tmp_path) == before


def test_a_folder_that_holds_what_the_command_reads_is_refused(tmp_path):
    out = earlier(tmp_path / "out")
    (tmp_path / "link").symlink_to("out")
    before = snapshot(tmp_path)

    for read in (out / "m.json", out, tmp_path / "link" / "m.json"):
        with pytest.raises(StudyError, match="must not hold what this command reads"):
            again(out, reads=[read])
    assert snapshot(tmp_path) == before
    again(out, reads=[tmp_path, tmp_path / "none"])


@pytest.mark.parametrize("asked", [".", "../out", "..", "../out/../out", "{out}"])
def test_the_folder_that_the_command_runs_in_is_refused(tmp_path, monkeypatch, asked):
    out = earlier(tmp_path / "out")
    before = snapshot(tmp_path)
    monkeypatch.chdir(out)

    with pytest.raises(StudyError, match="run it from another folder"):
        again(Path(asked.format(out=out)))

    assert snapshot(tmp_path) == before


def test_a_link_to_a_folder_stays_a_link_and_its_folder_is_filled(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to("disk/out")

    for _ in range(2):
        again(tmp_path / "out")

    assert (tmp_path / "out").is_symlink()
    assert (tmp_path / "disk" / "out" / "m.json").read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "out"]
    assert [path.name for path in (tmp_path / "disk").iterdir()] == ["out"]


def test_links_in_a_circle_and_files_are_refused(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    (tmp_path / "file").write_text("precious")

    for out in (tmp_path / "a", tmp_path / "a" / "out"):
        with pytest.raises(StudyError, match="in a circle"):
            again(out)
    for out in (tmp_path / "file", tmp_path / "file" / "out"):
        with pytest.raises(StudyError, match="file"):
            again(out)
    assert (tmp_path / "file").read_text() == "precious"


def test_folders_above_go_where_nothing_comes_of_it(tmp_path):
    with pytest.raises(RuntimeError), whole_folder(tmp_path / "a" / "b" / "out"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_what_a_result_keeps_goes_on_from_one_to_the_next(tmp_path):
    out = tmp_path / "out"
    (out / ".cache").mkdir(parents=True)
    (out / ".cache" / "a.json").write_text("measured")

    for _ in range(2):
        again(out, keeps=".cache")

    assert {path.name for path in out.iterdir()} == {".cache", "m.json", LISTING}
    assert (out / ".cache" / "a.json").read_text() == "measured"
    assert ".cache" not in (out / LISTING).read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    (out / "thesis.txt").write_text("precious")
    with pytest.raises(StudyError, match=r"thesis\.txt"):
        again(out, keeps=".cache")
