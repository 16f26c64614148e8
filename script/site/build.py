"""Build the site of the documentation into out/site; see script/docs."""

from __future__ import annotations

import argparse
import functools
import http.server
import shutil
import sys
import threading
import time
from pathlib import Path

from sphinx.cmd.build import main as sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import pictures  # noqa: E402
from pages import REPOSITORY, lay_out  # noqa: E402

WATCHED = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs", "script/site")


def build(out: Path, *, fresh: bool = True) -> bool:
    """Build the site into `out`; return whether every page and link is whole."""
    pages, trees = out.with_name(f"{out.name}-pages"), out.with_name(f"{out.name}-trees")
    if fresh:  # a second build is silent about pages that have not changed
        for folder in (out, pages, trees):
            shutil.rmtree(folder, ignore_errors=True)
    lay_out(pages)
    words = ["-b", "html", "-W", "--keep-going", "-q", "-c", HERE, "-d", trees, pages, out]
    return sphinx([str(word) for word in words]) == 0


def newest() -> float:
    """Return when a page was last changed."""
    paths = [REPOSITORY / name for name in WATCHED]
    files = [f for path in paths for f in (path.rglob("*") if path.is_dir() else [path])]
    return max(path.stat().st_mtime for path in files if path.is_file())


def serve(out: Path, port: int) -> None:
    """Show the site, and build again whatever changes, until interrupted."""
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(out))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    print(f"http://localhost:{port}  (Ctrl+C ends)")
    built = newest()
    try:
        while True:
            time.sleep(1)
            if (changed := newest()) > built:
                built = changed
                build(out, fresh=False)
    except KeyboardInterrupt:
        server.shutdown()


def main() -> None:
    parser = argparse.ArgumentParser(prog="script/docs", description=__doc__)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/site")
    parser.add_argument("--serve", action="store_true", help="show it, built again on changes")
    parser.add_argument("--port", type=int, default=8000)
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
    whole = build(given.out.resolve())
    if given.serve:
        serve(given.out.resolve(), given.port)
    elif not whole:
        sys.exit("the site is not whole: see above")
    else:
        print(f"{given.out / 'index.html'}")


if __name__ == "__main__":
    main()
