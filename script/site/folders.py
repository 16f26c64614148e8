"""Write the table of folders in docs/architecture.md from the first sentence of each package.

python script/site/folders.py
"""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterable
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = "docs/architecture.md"
PACKAGES = ("protocols", "pipeline", "stimuli", "study_app", "analysis")
HEAD = "| folder | contents |\n| --- | --- |\n"
SENTENCE = re.compile(r"(.+?)\.(?= [A-Z]|\n\n|\s*$)", re.DOTALL)


def package_files(repository: Path) -> list[str]:
    """Return the `__init__.py` of every package, as git knows them, in the order of the table."""
    listed = subprocess.run(
        ["git", "-C", str(repository), "ls-files", "--", *PACKAGES],
        capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    found = [path for path in listed if path.endswith("__init__.py")]
    return sorted(found, key=lambda path: (PACKAGES.index(path.split("/")[0]), path[:-12]))


def folder_table(repository: Path, files: Iterable[str]) -> str:
    """Return the table: a line for each package, with the first sentence of its docstring.

    Raises
    ------
    ValueError
        If a package has no such sentence.
    """
    lines = []
    for path in files:
        told = ast.get_docstring(ast.parse((repository / path).read_text(encoding="utf-8")))
        sentence = SENTENCE.match(told or "")
        if sentence is None:
            raise ValueError(f"{path}: must say in a sentence what lies there")
        words = " ".join(sentence[1].split())
        lines.append(f"| `{path.removesuffix('__init__.py')}` | {words} |\n")
    return HEAD + "".join(lines)


def with_table(page: str, table: str) -> str:
    """Return the text of the page with that table in the place of its own."""
    before, _, after = page.partition(HEAD)
    return before + table + after[after.index("\n\n") + 1 :]


if __name__ == "__main__":
    found = folder_table(REPOSITORY, package_files(REPOSITORY))
    page = REPOSITORY / PAGE
    page.write_text(with_table(page.read_text(encoding="utf-8"), found), encoding="utf-8")
