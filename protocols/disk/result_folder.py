"""Folders that commands fill: each appears whole, and lists its files; only these are replaced."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from protocols.disk.hashing import sha256_file
from protocols.disk.locks import held
from protocols.disk.whole_file import move, remove
from protocols.errors import StudyError

LISTING = ".metamerlab-files.json"
"""The files of a result and their hashes, so that a later command knows what it may replace."""
_MARK, _NEW, _WAS = "unfinished.txt", "new", "was"


@contextmanager
def whole_folder(
    out: Path,
    *,
    replace: bool | None = None,
    reads: Iterable[Path] = (),
    keeps: str | None = None,
) -> Iterator[Path]:
    """Give a working folder that becomes `out` when the block ends well, and vanishes else.

    It lies beside `out`. A program that is killed leaves it there; the next one for the same
    `out` removes it.

    Parameters
    ----------
    out : Path
        Must not exist, or be empty. With `replace` it may hold an earlier result: files that its
        `LISTING` names, as they were written.
    replace : bool, optional
        Whether an earlier result is replaced. None: never, and the new folder gets no listing.
    reads : iterable of Path
        What the command reads, which must not lie in `out`.
    keeps : str, optional
        A folder within `out` that no listing names and that stays from result to result.

    Raises
    ------
    StudyError
        If `out` is a file, holds or is what the command reads, holds something else or the
        command itself, or lies below a file.
    OSError
        If it cannot be made.
    """
    place = check_result(out, replace=replace, reads=reads, keeps=keeps)
    with ExitStack() as undo:
        _make_parents(place.parent, undo)
        _clear(place, "unfinished")
        with _hidden(place, "unfinished") as hidden:
            work = hidden / _NEW
            work.mkdir()
            yield work
            if replace is not None:
                write_listing(work)
            if place.is_dir() and any(place.iterdir()):
                _swap(out, place, work, replace, keeps)
            else:
                _remove_empty(place)  # Windows moves no folder over another
                move(work, place)
        undo.pop_all()
    _clear(place, "old")  # a program killed between those two moves left the earlier result there


def check_result(
    out: Path,
    *,
    replace: bool | None = None,
    reads: Iterable[Path] = (),
    keeps: str | None = None,
) -> Path:
    """Refuse a folder as `whole_folder` does, before any work; return where it lies, without links.

    Raises
    ------
    StudyError
        As `whole_folder`.
    """
    place = _place(out)
    check_folder(out)
    if place.exists():
        _check_reads(out, place, reads)
        _check_held(out, place, replace, keeps)
    return place


def check_folder(folder: Path) -> None:
    """Refuse a folder that is not there and cannot be made.

    Raises
    ------
    StudyError
        Saying which part of the path stands in the way.
    """
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise StudyError(f"{folder}: must be a folder, and {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise StudyError(f"{folder}: must be writable; change its permissions, or choose another")


def stranger(folder: Path, keeps: str | None = None) -> str | None:
    """Return the things in `folder` that its `LISTING` does not name, in words; None: nothing.

    `keeps` is a folder in it that is not looked at.
    """
    for path in unlisted(folder):
        name = path.relative_to(folder).as_posix()
        if name.split("/")[0] != keeps:
            if path.is_symlink():
                return f"{name}, a symbolic link"
            if path.is_dir():
                return f"{name}, a folder"
            return f"{name}, which was changed since" if name in _listed(folder) else name
    return None


def unlisted(folder: Path, below: Path | None = None) -> Iterator[Path]:
    """Yield every file, link and empty folder that is not as the `LISTING` of `folder` says.

    `below` is the part of `folder` that is looked at; left out: all of it.
    """
    known = _listed(folder)
    return (path for path in files_below(below or folder) if not _is_own(path, folder, known))


def remove_listed(folder: Path, below: Path | None = None) -> None:
    """Remove the files that a result listed, as they were written, and folders that empty so.

    `below` is the part of `folder` that goes; left out: all of it.
    """
    known = _listed(folder)
    remove_own(below or folder, lambda path: _is_own(path, folder, known))


def remove_own(folder: Path, is_own: Callable[[Path], bool]) -> None:
    """Remove files and empty folders below `folder` that are ours, and all that empties so."""
    if folder.is_symlink() or not folder.is_dir():
        return
    ours = [path for path in files_below(folder) if not path.is_symlink() and is_own(path)]
    for path in sorted(ours, key=lambda path: path.name == LISTING):  # it vouches for the others
        if not path.is_dir():
            remove(path)
        for emptied in (path, *path.parents):
            if emptied.is_relative_to(folder):
                _remove_empty(emptied)
    _remove_empty(folder)


def _is_own(path: Path, folder: Path, known: Mapping[str, str]) -> bool:
    """Return True if a file is as a result listed it, or an empty folder held such a file."""
    name = path.relative_to(folder).as_posix()
    if path.is_symlink():
        return False
    if path.is_dir():
        return any(file.startswith(f"{name}/") for file in known)
    if not path.is_file():
        return False
    return name == LISTING if name not in known else known[name] == sha256_file(path)


def files_below(folder: Path) -> Iterator[Path]:
    """Yield every file, link and empty folder below a folder; links are not followed."""
    for entry in sorted(folder.iterdir()):
        if entry.is_dir() and not entry.is_symlink():
            below = list(files_below(entry))
            yield from below or [entry]
        else:
            yield entry


def without_links(path: Path) -> Path:
    """Return a path, absolute and without links.

    Raises
    ------
    StudyError
        If its links lead in a circle, or the folder that the program runs in was deleted.
    """
    try:
        place = path.resolve()
    except (OSError, RuntimeError):  # a circle is an error up to Python 3.12 alone
        place = None
    if place is None or any(part.is_symlink() for part in (place, *place.parents)):
        raise StudyError(
            f"{path}: must lead to a folder or a file (its links lead in a circle, or this folder"
            " is gone); choose another one"
        )
    return place


def _place(out: Path) -> Path:
    """Return the place of `out`, without links."""
    place, here = without_links(out), without_links(Path())
    if place.exists() and not place.is_dir():
        raise StudyError(f"{out}: must be a folder to fill (this is a file)")
    if here.is_relative_to(place):
        raise StudyError(
            f"{out}: must not be or hold the folder that this command runs in ({here}), as it"
            " appears only when whole; run it from another folder, or choose another"
        )
    if os.path.ismount(place):  # Python 3.11 on Windows has no Path.is_mount
        raise StudyError(
            f"{out}: must not be where a disk is mounted, as it appears only when whole; choose a"
            " folder in it"
        )
    return place


def _check_reads(out: Path, place: Path, reads: Iterable[Path]) -> None:
    for read in reads:
        if read.exists() and read.resolve().is_relative_to(place):
            raise StudyError(
                f"{out}: must not hold what this command reads ({read}); choose another folder"
            )


def _check_held(out: Path, place: Path, replace: bool | None, keeps: str | None) -> None:
    held_first = min((entry.name for entry in place.iterdir() if entry.name != keeps), default=None)
    if held_first is None:
        return
    if replace is None or not _listed(place):
        raise StudyError(
            f"{out}: must be empty or new (it holds {held_first}, and no list of what a"
            " command wrote here); choose another folder, or move away what you want to keep and"
            " delete this one yourself"
        )
    if strange := stranger(place, keeps):
        raise StudyError(
            f"{out}: must hold nothing but an earlier result (it holds {strange}, which is none of"
            " its own); move that away, or choose another folder"
        )
    if not replace:
        raise StudyError(
            f"{out}: must be empty or new (it holds an earlier result);"
            " choose another folder, or add --replace"
        )


def _make_parents(parent: Path, undo: ExitStack) -> None:
    """Make the folders above; those that were not there go again where nothing comes of it."""
    for folder in reversed((parent, *parent.parents)):
        if not folder.is_dir():
            folder.mkdir(exist_ok=True)
            undo.callback(_remove_empty, folder)


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def _swap(out: Path, place: Path, work: Path, replace: bool | None, keeps: str | None) -> None:
    """Put a result in the place of an earlier one, which goes if it is still as it was."""
    _check_held(out, place, replace, keeps)
    with _hidden(place, "old") as old:
        was = old / _WAS
        move(place, was)
        try:
            if strange := stranger(was, keeps):
                raise StudyError(
                    f"{out}: must stay as it is while it is replaced (somebody put {strange}"
                    " there); move that away, and run this again"
                )
            if keeps and (was / keeps).exists():
                move(was / keeps, work / keeps)
            move(work, place)
        except BaseException:
            if keeps and (work / keeps).exists():
                move(work / keeps, was / keeps)
            move(was, place)
            raise


def write_listing(folder: Path, without: Collection[Path] = ()) -> None:
    """List the files of a result as its own, but for those of somebody else.

    What stands of these in an earlier listing stays.
    """
    old = _listed(folder)
    files = {name: sha256 for name, sha256 in old.items() if folder / name in without} | {
        path.relative_to(folder).as_posix(): sha256_file(path)
        for path in files_below(folder)
        if path.is_file() and not path.is_symlink() and path not in without
    }
    files.pop(LISTING, None)
    text = json.dumps({"format": 1, "files": files}, indent=1, sort_keys=True)
    (folder / LISTING).write_bytes(f"{text}\n".encode())


def _listed(folder: Path) -> dict[str, str]:
    """Return the hashes of files that a result listed; none where there is no listing."""
    try:
        files = json.loads((folder / LISTING).read_bytes())["files"]
        return {str(name): str(sha256) for name, sha256 in files.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


@contextmanager
def _hidden(out: Path, kind: str) -> Iterator[Path]:
    """Give a folder beside `out` that no other program takes for a killed one's, then remove it."""
    with ExitStack() as stack:
        while True:
            try:
                folder = Path(tempfile.mkdtemp(prefix=f".{out.name}.{kind}-", dir=out.parent))
            except OSError as error:
                raise type(error)(error.errno, error.strerror, str(out.parent)) from None
            with suppress(FileNotFoundError):
                if stack.enter_context(held(folder)) is not False and folder.exists():
                    break
            # Cleared away by another program in the moment before it was held: once more.
        try:
            (folder / _MARK).write_bytes(_mark(out).encode())
            yield folder
        finally:
            _drop(folder)


def _mark(out: Path) -> str:
    """Return the mark of a working folder, which no other folder has."""
    return (
        f"metamerlab was writing {out.name!a} and was stopped. What lies here is unfinished:"
        " the next\ncommand that writes it deletes this.\n"
    )


def _drop(folder: Path) -> None:
    shutil.rmtree(folder / _NEW, ignore_errors=True)
    remove_listed(folder / _WAS)
    (folder / _MARK).unlink(missing_ok=True)
    _remove_empty(folder)


def _clear(out: Path, kind: str) -> None:
    """Remove what killed programs left of this result; what a living one holds stays."""
    left_behind = re.compile(rf"\.{re.escape(out.name)}\.{kind}-[a-z0-9_]{{8}}")
    for entry in sorted(out.parent.iterdir()):
        if left_behind.fullmatch(entry.name) and not entry.is_symlink():
            # Gone meanwhile, or someone else's.
            with suppress(OSError), held(entry) as stale:
                if stale and (entry / _MARK).read_bytes() == _mark(out).encode():
                    _drop(entry)
