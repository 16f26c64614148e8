"""Windows refuses to rename or delete a file that another program has open: that is waited for."""

import ast
import errno
import os
from pathlib import Path

import numpy as np
import pytest
import typer

from pipeline.pictures.write import write_pixels
from protocols.disk import whole_file
from protocols.disk.result_folder import whole_folder
from protocols.disk.whole_file import move, remove, write_whole
from study_app.cli.error_messages import user_errors

PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")


@pytest.fixture
def refuse(monkeypatch):
    """Give a function: have the system refuse a call of `os` so many times; nobody waits."""
    waits = []
    monkeypatch.setattr(whole_file.time, "sleep", waits.append)

    def refuse(name, times):
        left, done = [times], getattr(os, name)

        def held_open(*arguments, **named):
            if left[0] > 0:
                left[0] -= 1
                raise PermissionError(errno.EACCES, "Access is denied", str(arguments[0]))
            return done(*arguments, **named)

        monkeypatch.setattr(os, name, held_open)
        return waits

    return refuse


def writers():
    """Functions that write over a file, in their ways."""
    pixels = np.zeros((4, 4, 3), np.uint8)
    return {
        "bytes": ("old.txt", lambda path: write_whole(path, b"new")),
        "picture": ("old.png", lambda path: write_pixels(path, pixels, ("R", "G", "B"))),
    }


@pytest.mark.parametrize("kind", writers())
def test_a_file_that_is_read_for_a_moment_is_replaced_when_it_is_free(tmp_path, refuse, kind):
    name, write = writers()[kind]
    path = tmp_path / name
    path.write_bytes(b"old")
    waits = refuse("replace", 4)

    write(path)

    assert path.read_bytes() != b"old"
    assert list(tmp_path.iterdir()) == [path]
    assert len(waits) == 4
    assert waits == sorted(waits)


@pytest.mark.parametrize("kind", writers())
def test_a_file_that_stays_open_stays_as_it_is_and_is_named_with_a_cure(
    tmp_path, refuse, capsys, kind
):
    name, write = writers()[kind]
    path = tmp_path / name
    path.write_bytes(b"old")
    waits = refuse("replace", 1000)

    with pytest.raises(typer.Exit) as ended, user_errors():
        write(path)

    assert ended.value.exit_code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == (
        f"error: {path}: another program has it open, or you may not change it; close it there, or"
        " change its permissions, and run this again"
    )
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
    assert 1 < sum(waits) < 10


def test_a_result_is_replaced_once_nobody_reads_it_any_more(tmp_path, refuse):
    out = tmp_path / "result"
    for text in ("first", "second"):
        with whole_folder(out, replace=True) as work:
            (work / "numbers.txt").write_text(text)
            refuse("replace", 2)

    assert (out / "numbers.txt").read_text() == "second"
    assert [entry.name for entry in tmp_path.iterdir()] == ["result"]


def test_a_result_that_stays_open_is_the_earlier_one_still(tmp_path, refuse):
    out = tmp_path / "result"
    with whole_folder(out, replace=True) as work:
        (work / "numbers.txt").write_text("first")

    def write_again():
        with whole_folder(out, replace=True) as work:
            (work / "numbers.txt").write_text("second")
            refuse("replace", 7)

    with pytest.raises(OSError, match="another program has it open"):
        write_again()

    assert (out / "numbers.txt").read_text() == "first"
    assert [entry.name for entry in tmp_path.iterdir()] == ["result"]


def test_a_file_that_is_read_for_a_moment_is_removed_when_it_is_free(tmp_path, refuse):
    path = tmp_path / "file"
    path.write_bytes(b"")
    refuse("unlink", 3)
    remove(path)

    assert not path.exists()
    refuse("unlink", 1000)
    with pytest.raises(OSError, match="another program has it open"):
        remove(path)


def test_a_folder_in_the_way_is_no_reason_to_wait(tmp_path, refuse):
    (tmp_path / "from").mkdir()
    (tmp_path / "to").mkdir()
    waits = refuse("replace", 2)

    with pytest.raises(PermissionError):
        move(tmp_path / "from", tmp_path / "to")
    assert waits == []


def renames(source: str) -> list[int]:
    """Lines that rename a file or folder, or flush a file that is open to be read alone."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            name, given = ast.unparse(node.func), len(node.args) + len(node.keywords)
            of_a_path = name.endswith((".rename", ".replace")) and given == len(node.args) == 1
            no_table = not ast.unparse(node).endswith("(dict(answers))")
            if (of_a_path and no_table) or name in ("os.rename", "os.replace", "shutil.move"):
                found.append(node.lineno)
        if isinstance(node, ast.With) and ".open('rb')" in ast.unparse(node.items[0]):
            found += [node.lineno] * ("os.fsync" in ast.unparse(node))
    return found


def test_every_rename_is_one_that_waits_and_no_flush_is_of_a_file_open_to_read(repository):
    assert renames('p.rename(q)\nos.replace(a, b)\n"a".replace("b", "c")\nshutil.move(a, b)') == [
        1,
        2,
        4,
    ]
    assert renames('with p.open("rb") as f:\n    os.fsync(f)') == [1]
    found = [
        f"{path.relative_to(repository)}:{line}"
        for package in PACKAGES
        for path in sorted((repository / package).rglob("*.py"))
        if "node_modules" not in path.parts and path != Path(whole_file.__file__)
        for line in renames(path.read_text(encoding="utf-8"))
    ]

    assert not found, "\n".join(found)
