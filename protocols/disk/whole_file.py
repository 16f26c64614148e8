"""Files that are there whole or not at all, and files read whole: one message says why not."""

from __future__ import annotations

import codecs
import errno
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import BinaryIO

from protocols.errors import StudyError
from protocols.outside import bounded_bytes

PART = ".part"
"""Ending of a file while it is written; a killed program leaves it behind."""


_WAITS_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Waits for another program that has a file open, one after another."""


def move(source: Path, target: Path) -> None:
    """Rename a file or folder; a file at `target` is replaced.

    Windows refuses it while another program has the file, or one in the folder, open, as a virus
    scanner or a synchronised folder does for moments. So it is tried again, for three seconds.

    Raises
    ------
    OSError
        If the system refuses; of number EBUSY if it does so all the time.
    """
    _patiently(lambda: source.replace(target), target)


def remove(path: Path) -> None:
    """Remove a file, if it is there, as patiently as `move` renames one.

    Raises
    ------
    OSError
        As `move`.
    """
    _patiently(lambda: path.unlink(missing_ok=True), path)


def _patiently(act: Callable[[], object], path: Path) -> None:
    for wait_s in _WAITS_S:
        with suppress(PermissionError):
            act()
            return
        if path.is_dir():
            break  # a folder makes no room, however long one waits
        time.sleep(wait_s)
    try:
        act()
    except PermissionError as error:
        if path.is_dir():
            raise
        reason = "another program has it open, or you may not change it"
        raise OSError(errno.EBUSY, reason, str(path)) from error


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under a temporary name, flush it to the disk, then rename it.

    Raises
    ------
    OSError
        If the disk is full or fails; nothing is left behind then.
    """
    with whole_file(path) as file:
        file.write(data)


def write_new(path: Path, data: bytes, *, waits: bool = True) -> None:
    """Write a file that is not there yet; with `waits` it is on the disk when this returns.

    Raises
    ------
    FileExistsError
        If there is one of this name: it stays as it is.
    OSError
        If the disk is full or fails; nothing is left behind then.
    """
    file = path.open("xb")
    try:
        with file:
            file.write(data)
            file.flush()
            if waits:
                os.fsync(file.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        raise


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file to be written piece by piece; it appears under its name when all went well.

    Raises
    ------
    OSError
        If the disk is full or fails; whatever is raised within, nothing is left behind.
    """
    with whole_path(path) as temporary, temporary.open("w+b") as file:
        yield file


@contextmanager
def whole_path(path: Path, ending: str = "") -> Iterator[Path]:
    """Give a name to write to; the file is synced and renamed when all went well.

    For libraries that open files themselves. Many report no failed write, so the caller reads back.

    Parameters
    ----------
    path : Path
        Where the file goes.
    ending : str
        What the name to write to has to end in, if the library goes by it.

    Raises
    ------
    OSError
        If the disk is full or fails; whatever is raised within, nothing is left behind.
    """
    temporary = path.with_name(f".{path.name.removesuffix(ending)}.{os.getpid()}{PART}{ending}")
    try:
        temporary.touch()  # what the system has against it, it says better than a library
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        move(temporary, path)
    except BaseException as error:
        remove(temporary)
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise type(error)(error.errno, error.strerror, str(path)) from None
        raise


def sync_folder(folder: Path) -> None:
    """Have the disk know of what was put into a folder, where a folder can be flushed to it."""
    if os.name != "posix":
        return  # Windows opens no folder; its file systems keep a journal of names
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


_BESIDE_MOST = 1000
"""Files of a folder among which a name is looked for."""


def read_bytes(path: Path, what: str, name: str = "text") -> bytes:
    """Read a file, if the limit `name` allows its size; `StudyError` says why it is not read."""
    try:
        return bounded_bytes(path, StudyError, name)
    except FileNotFoundError:
        cure = _near(path)
        raise StudyError(f"{path}: {what} must exist (there is no such file); {cure}") from None
    except IsADirectoryError:
        inside = [str(file) for file in sorted(path.glob("*.toml"))] if name == "toml" else []
        cure = f"name {' or '.join(inside)}" if inside else "name the file in it"
        raise StudyError(f"{path}: {what} must be a file (this is a folder); {cure}") from None
    except OSError as error:
        raise StudyError(f"{path}: {what} must be readable ({error.strerror})") from None


def _near(path: Path) -> str:
    """Return the cure for a missing file: one beside it may be meant."""
    try:
        beside = [file.name for file in path.parent.iterdir()]
    except OSError:
        beside = []
    near = get_close_matches(path.name, beside[:_BESIDE_MOST], 1)
    return f"did you mean {path.with_name(near[0])}?" if near else "check the path"


def decode_utf8(data: bytes, path: Path) -> str:
    """Decode; `StudyError` names the line and the byte that are not UTF-8, or says it is no text.

    What holds a zero byte is no text, unless it begins as UTF-16 does.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in data[:4096] and not data.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise StudyError(
                f"{path}: must be a text file (it holds other data, as pictures and archives do);"
                " check which file is named"
            ) from None
        line = data.count(b"\n", 0, error.start) + 1
        raise StudyError(
            f"{path}: line {line}: must be UTF-8 text (got byte 0x{data[error.start]:02x});"
            " save the file as UTF-8"
        ) from None


_MARKS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def _utf16(data: bytes) -> str:
    """Return the codec of UTF-16, by its mark or by the zeros in its letters; else nothing."""
    head, unmarked = data[:200], ""
    if head[:2] not in _MARKS and len(head) > 3 and 0 in head:
        half = len(head) // 2
        unmarked = next(
            (
                code
                for code, place in (("utf-16-le", 1), ("utf-16-be", 0))
                if head[place::2].count(0) > 0.8 * half
            ),
            "",
        )
    return _MARKS.get(head[:2], unmarked)


def written_text(data: bytes, path: Path) -> str:
    """Return a text that people wrote, in UTF-8 or, as some editors save it, UTF-16.

    Names must match to the letter: no other encoding is guessed.
    """
    with suppress(UnicodeDecodeError):
        if code := _utf16(data):
            return data.decode(code).removeprefix("\ufeff")
    return decode_utf8(data, path)


def separator_of(text: str) -> str:
    """Return the separator of a table's cells, by its header: a comma, a semicolon or a tab."""
    return max(",;\t", key=text.split("\n", maxsplit=1)[0].count)


def decoded_text(data: bytes, notes: list[str]) -> str:
    """Return a text from outside, however it is encoded: a table, gaze, lines of browsers.

    UTF-16 is known by its mark, or by the zeros in its letters. What can be no UTF-8 either is
    Windows' Latin-1. `notes` gets a word on what is not UTF-8, once.
    """
    if code := _utf16(data):
        note, text = "read as UTF-16", data.decode(code, "replace")
    else:
        with suppress(UnicodeDecodeError):
            return data.decode("utf-8-sig")
        note = "read as Windows' Latin-1: it is no UTF-8; look whether names are right"
        text = data.decode("cp1252", "replace")
    if note not in notes:
        notes.append(note)
    return text
