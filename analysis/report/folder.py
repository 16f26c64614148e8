"""A folder that looks whole only when it is whole."""

import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from protocols.errors import StudyError
from protocols.folder_hold import held


@contextmanager
def whole_folder(out: Path, marker: str, *, replace: bool = False) -> Iterator[Path]:
    """Give a working folder that becomes `out` when the block ends well, and vanishes else.

    It lies beside `out`. A program that is killed leaves it there; the next one for the same
    `out` removes it.

    Parameters
    ----------
    out : Path
        Must not exist, or be empty. With `replace` it may hold an earlier result, known by the
        file `marker`.

    Raises
    ------
    StudyError
        If `out` is a file, holds something else, or its parent cannot be made.
    """
    if out.exists() and not out.is_dir():
        raise StudyError(f"{out}: must be a folder to fill (this is a file)")
    if out.is_dir() and any(out.iterdir()):
        if not (out / marker).is_file():
            raise StudyError(
                f"{out}: must be empty or new (it holds files that are no earlier result);"
                " choose another folder"
            )
        if not replace:
            raise StudyError(
                f"{out}: must be empty or new (it holds an earlier result);"
                " choose another folder, or add --replace"
            )
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise StudyError(f"{out.parent}: must be a folder (this is a file)") from None
    except NotADirectoryError:
        raise StudyError(f"{out}: a part of this path is a file, not a folder") from None
    _clear(out, "unfinished")
    with _hidden(out, "unfinished") as work:
        work.chmod(0o755)
        yield work
        if out.is_dir():
            with _hidden(out, "old") as old:
                out.rename(old / "was")
                try:
                    work.rename(out)
                except OSError:
                    (old / "was").rename(out)
                    raise
        else:
            work.rename(out)
    _clear(out, "old")  # a program killed between those two moves left the earlier result there


@contextmanager
def _hidden(out: Path, kind: str) -> Iterator[Path]:
    """Give a folder beside `out` that no other program takes for a killed one's, then remove it."""
    with ExitStack() as stack:
        while True:
            folder = Path(tempfile.mkdtemp(prefix=f".{out.name}.{kind}-", dir=out.parent))
            with suppress(FileNotFoundError):
                if stack.enter_context(held(folder)) is not False and folder.exists():
                    break
            # Cleared away by another program in the moment before it was held: once more.
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _clear(out: Path, kind: str) -> None:
    """Remove what killed programs left of this result; what a living one holds stays."""
    left_behind = re.compile(rf"\.{re.escape(out.name)}\.{kind}-[a-z0-9_]{{8}}")
    for entry in sorted(out.parent.iterdir()):
        if left_behind.fullmatch(entry.name):
            with suppress(OSError), held(entry) as stale:  # gone meanwhile, or someone else's
                if stale:
                    shutil.rmtree(entry, ignore_errors=True)
