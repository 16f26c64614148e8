"""The name under which metamerlab is installed; importing it lets our five packages be found first.

`analysis`, `pipeline`, `protocols`, `stimuli` and `study_app` are plain names that other installed
packages, or folders of yours, may have too. The wheel therefore keeps the five in one folder of
their own. A path file makes them importable in every program, behind all other packages; the
command `metamerlab`, and ``import metamerlab`` at the head of a program, put them in front.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

__all__ = ["PACKAGES", "main"]

PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")


def _folder() -> str:
    """Folder of the five: beside this file in a checkout, one folder deeper once installed."""
    here = Path(__file__).absolute().parent
    installed = here / "metamerlab-packages"
    return str(installed if installed.is_dir() else here)


def _put_first(folder: str) -> None:
    """Let the five be found in `folder` before anywhere else.

    Raises
    ------
    ImportError
        If another package of one of the five names was imported before.
    """
    for name in PACKAGES:
        if (taken := sys.modules.get(name)) is not None:
            found = (*getattr(taken, "__path__", ()), getattr(taken, "__file__", None))[0]
            if found is None or Path(found).resolve() != Path(folder, name).resolve():
                raise ImportError(
                    f"the package {name!r} must be metamerlab's, of {folder}"
                    f" (got {found}, which was imported before);"
                    " write 'import metamerlab' before that import"
                )
    sys.path[:] = [folder, *(entry for entry in sys.path if entry != folder)]


_put_first(_folder())


def main() -> None:
    """Run the command line given in `sys.argv`; the console script `metamerlab`."""
    # Our matrices are small: threads that wait for each other took up to four times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from study_app.cli import main as front_door

    front_door()


if __name__ == "__main__":
    main()
