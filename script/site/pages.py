"""Pages of the site for Sphinx: README and docs/ as they are, and pages made of lists.

Pages stay plain Markdown that reads well beside the code. What only the site needs, tables of
contents and the list of Python calls, is made here from `site.toml`.
"""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
FRONT = "index"  # the README's name on the site

LINK = re.compile(r"(?P<before>!?\[(?:[^\[\]]|\[[^\]]*\])*\])\((?P<target>[^)\s]+)\)")
FENCE = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)


def site() -> dict[str, Any]:
    """Return what `site.toml` says."""
    return tomllib.loads((HERE / "site.toml").read_text(encoding="utf-8"))


def contents(pages: list[str], *options: str) -> str:
    """Return a table of contents; ``Title <page>`` gives a page another title there."""
    entries = [re.sub(r"(.*<|^)(?=[^<]+$)", r"\1/", page, count=1) for page in pages]
    return "\n".join(["\n```{toctree}", *options, "", *entries, "```\n"])


def api_page(stage: dict[str, Any]) -> str:
    """Return the reStructuredText of one stage's Python calls."""
    lines = [stage["title"], "=" * len(stage["title"]), "", stage["intro"], ""]
    for module, names in stage["modules"].items():
        lines += [f"``{module}``", "-" * (len(module) + 4), ""]
        lines += [f".. automodule:: {module}", f"   :members: {', '.join(names)}", ""]
    return "\n".join(lines)


def lay_out(folder: Path) -> None:
    """Fill the folder that Sphinx reads; what has not changed keeps its time."""
    (folder / "api").mkdir(parents=True, exist_ok=True)
    for name in ("docs", "benchmarks/results"):
        shutil.copytree(REPOSITORY / name, folder / name, dirs_exist_ok=True)
    for name, page in (("README", FRONT), ("CHANGELOG", "CHANGELOG"), ("CONTRIBUTING",) * 2):
        shutil.copy2(REPOSITORY / f"{name}.md", folder / f"{page}.md")
    plan = site()
    for section in plan["section"]:
        listed = contents(section["pages"], ":maxdepth: 1", ":glob:")
        text = f"# {section['title']}\n\n{section['intro']}\n{listed}"
        (folder / f"{section['name']}.md").write_text(text, encoding="utf-8")
    for stage in plan["api"]:
        (folder / f"api/{stage['name']}.rst").write_text(api_page(stage), encoding="utf-8")


def suit(app: Sphinx, page: str, text: list[str]) -> None:
    """Change the links that only suit GitHub: to the README, to folders, to files beside the pages.

    The front page also gets the table of contents.
    """
    here = Path(page).parent

    def replace(match: re.Match[str]) -> str:
        path, anchor, part = match["target"].partition("#")
        there = os.path.normpath(here / path)
        if path and (REPOSITORY / there).is_dir():
            return match["before"].strip("[]")  # nothing to show
        if there == "README.md":
            return f"{match['before']}({os.path.relpath(f'{FRONT}.md', here)}{anchor}{part})"
        if (REPOSITORY / there).is_file() and not (app.srcdir / there).exists():
            (app.srcdir / there).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(REPOSITORY / there, app.srcdir / there)
        if there.endswith(".md") and there.removesuffix(".md") not in app.env.found_docs:
            return f"{match['before']}(path:{match['target']})"  # to be downloaded
        return match[0]

    parts = FENCE.split(text[0])
    parts[::2] = [LINK.sub(replace, part) for part in parts[::2]]
    text[0] = "".join(parts)
    if page == FRONT:
        text[0] += contents([section["name"] for section in site()["section"]], ":hidden:")
