"""A folder that looks whole only when it is whole."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from protocols.errors import StudyError


@contextmanager
def whole_folder(out: Path, marker: str, *, replace: bool = False) -> Iterator[Path]:
    """Give a working folder that becomes `out` when the block ends well, and vanishes else.

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
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}.unfinished-", dir=out.parent))
    try:
        work.chmod(0o755)
        yield work
        if out.is_dir():
            old = Path(tempfile.mkdtemp(prefix=f".{out.name}.old-", dir=out.parent))
            out.rename(old / "was")
            work.rename(out)
            shutil.rmtree(old)
        else:
            work.rename(out)
    finally:
        shutil.rmtree(work, ignore_errors=True)
