"""Lay the pages of the site out for Sphinx: README and docs/ as they are, and pages made of lists.

Pages stay plain Markdown that reads well beside the code. What only the site needs, tables of
contents and the list of Python calls, is made here from `site.toml`.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path, PurePosixPath
from typing import Any

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
FRONT = "index"  # the README's name on the site
SPLIT = "docs/figures/"  # each heading of these pages becomes a page of its own

LINK = re.compile(r"(?P<before>!?\[(?:[^\[\]]|\[[^\]]*\])*\])\((?P<target>[^)\s]+)\)")
FENCE = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)


def site() -> dict[str, Any]:
    """Return what `site.toml` says."""
    return tomllib.loads((HERE / "site.toml").read_text(encoding="utf-8"))


def sources() -> dict[str, Path]:
    """Return the pages that are files, by name on the site, without `.md`."""
    found = {FRONT: REPOSITORY / "README.md"}
    found |= {name: REPOSITORY / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING")}
    tables = (REPOSITORY / "benchmarks/results").glob("*.md")
    for path in sorted([*(REPOSITORY / "docs").rglob("*.md"), *tables]):
        found[path.relative_to(REPOSITORY).with_suffix("").as_posix()] = path
    return found


def listed(patterns: list[str], names: list[str]) -> list[str]:
    """Return the pages of a section; a pattern that ends in ``*`` stands for all below it."""
    found = []
    for pattern in patterns:
        stem = pattern.removesuffix("*")
        found += [n for n in names if n.startswith(stem)] if stem != pattern else [pattern]
    return found


def contents(pages: list[str], *options: str) -> str:
    """Return a table of contents; ``Title <page>`` gives a page another title there."""
    entries = [re.sub(r"(.*<|^)(?=[^<]+$)", r"\1/", page, count=1) for page in pages]
    lines = [*options, "", *entries]
    return "\n```{toctree}\n" + "\n".join(lines) + "\n```\n"


def resolved(target: str, page: str) -> str | None:
    """Return the path below the repository that a page's link leads to, or None."""
    if re.match(r"[a-z]+:|#", target):
        return None
    path = REPOSITORY / PurePosixPath(f"{page}.md").parent / target.partition("#")[0]
    path = path.resolve()
    return path.relative_to(REPOSITORY).as_posix() if path.is_relative_to(REPOSITORY) else None


def relinked(text: str, page: str) -> tuple[str, set[str]]:
    """Return a page whose links suit the site, and the files beside the pages that it links."""
    files: set[str] = set()
    pages = {f"{name}.md" for name in sources()}

    def replace(match: re.Match[str]) -> str:
        target = match["target"]
        path = resolved(target, page)
        if path == "README.md":
            return f"{match['before']}({target.replace('README.md', FRONT + '.md')})"
        if path and (REPOSITORY / path).is_dir():
            return match["before"].strip("[]")  # a folder: nothing to show
        if path and path not in pages:
            files.add(path)
            if path.endswith(".md"):  # no page of the site: to be downloaded
                return f"{match['before']}(path:{target})"
        return match[0]

    parts = FENCE.split(text)
    parts[::2] = [LINK.sub(replace, part) for part in parts[::2]]
    return "".join(parts), files


def split(text: str, page: str) -> dict[str, str]:
    """Return a page and one for each of its second-level headings, which it lists."""
    head, *parts = re.split(r"^## ", text, flags=re.MULTILINE)
    pages = {}
    for part in parts:
        title, _, body = part.partition("\n")
        slug = re.sub(r"[^a-z0-9]+", "-", title.partition(":")[0].lower()).strip("-")
        pages[f"{page}-{slug}"] = f"# {title}\n{body}"
    return {page: head + contents(list(pages), ":maxdepth: 1"), **pages}


def api_page(stage: dict[str, Any]) -> str:
    """Return the reStructuredText of one stage's Python calls."""
    lines = [stage["title"], "=" * len(stage["title"]), "", stage["intro"], ""]
    for module, names in stage["modules"].items():
        lines += [f"``{module}``", "-" * (len(module) + 4), ""]
        lines += [f".. automodule:: {module}", f"   :members: {', '.join(names)}", ""]
    return "\n".join(lines)


def all_pages() -> dict[str, bytes]:
    """Return every file that Sphinx reads, by its path."""
    made: dict[str, bytes] = {}
    plan = site()
    files: set[str] = set()
    names = list(sources())
    for name, path in sources().items():
        text, more = relinked(path.read_text(encoding="utf-8"), name)
        files |= more
        if name == FRONT:
            text += contents([section["name"] for section in plan["section"]], ":hidden:")
        pages = split(text, name) if name.startswith(SPLIT) else {name: text}
        made |= {f"{page}.md": body.encode() for page, body in pages.items()}
    for section in plan["section"]:
        body = f"# {section['title']}\n\n{section['intro']}\n"
        body += contents(listed(section["pages"], names), ":maxdepth: 1")
        made[f"{section['name']}.md"] = body.encode()
    for stage in plan["api"]:
        made[f"api/{stage['name']}.rst"] = api_page(stage).encode()
    return made | {path: (REPOSITORY / path).read_bytes() for path in files}


def lay_out(folder: Path) -> None:
    """Write all pages into a folder; touch nothing that is as it was, delete what is gone."""
    wanted = all_pages()
    for path, data in wanted.items():
        there = folder / path
        there.parent.mkdir(parents=True, exist_ok=True)
        if not there.is_file() or there.read_bytes() != data:
            there.write_bytes(data)
    for there in folder.rglob("*"):
        if there.is_file() and there.relative_to(folder).as_posix() not in wanted:
            there.unlink()
