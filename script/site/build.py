"""Build the site of the documentation into out/site; see script/docs."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from sphinx.cmd.build import main as sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import pictures  # noqa: E402
from pages import REPOSITORY, lay_out  # noqa: E402


def build(out: Path) -> bool:
    """Build the site into `out`; return whether every page and link is whole."""
    pages, trees = out.with_name(f"{out.name}-pages"), out.with_name(f"{out.name}-trees")
    for folder in (out, pages, trees):  # a second build is silent about pages that did not change
        shutil.rmtree(folder, ignore_errors=True)
    lay_out(pages)
    words = ["-b", "html", "-W", "--keep-going", "-q", "-c", HERE, "-d", trees, pages, out]
    return sphinx([str(word) for word in words]) == 0


def main() -> None:
    parser = argparse.ArgumentParser(prog="script/docs", description=__doc__)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/site")
    parser.add_argument(
        "--pictures",
        nargs="*",
        metavar="PAGE",
        help="make the pictures of these pages again, or all",
    )
    given = parser.parse_args()
    if given.pictures is not None:
        pictures.make(given.pictures)
        return
    if not build(given.out.resolve()):
        sys.exit("the site is not whole: see above")
    print(f"{given.out / 'index.html'}")


if __name__ == "__main__":
    main()
