"""Run the commands of a page in their order, and make its pictures from what they write."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
MADE = DOCS / "images/made"
LARGEST_BYTES = 200_000
LARGEST_PAGE_BYTES = 1_200_000
WIDTH_PX = 1000


def pages() -> list[Path]:
    """Return the pages whose commands make pictures, the tutorials first."""
    return [*sorted(DOCS.glob("tutorials/*.md")), DOCS / "gallery.md"]


def script_of(page: Path) -> str:
    """Return the commands of a page: its ``bash`` blocks, one after the other."""
    text = page.read_text(encoding="utf-8")
    return "".join(re.findall(r"^```bash\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL))


def pictures_of(page: Path) -> list[Path]:
    """Return the pictures that a page shows and its commands make."""
    text = page.read_text(encoding="utf-8")
    return [MADE / name for name in re.findall(r"\]\([./]*images/made/([\w.-]+)\)", text)]


def run(
    page: Path, folder: Path, programs: Path = Path(sys.executable).parent
) -> subprocess.CompletedProcess[str]:
    """Run a page's commands in a folder that has our docs; stop at the first failure.

    `programs` is where `metamerlab` is.
    """
    (folder / "docs").symlink_to(DOCS)
    path = f"{programs}{os.pathsep}{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-c", f"set -euo pipefail\n{script_of(page)}"],
        cwd=folder,
        env=os.environ | {"PATH": path, "COLUMNS": "100"},
        capture_output=True,
        text=True,
    )


def written(picture: Path, folder: Path) -> Path:
    """Return the file that became a picture: `out/report/jod.png` becomes `report-jod.webp`."""
    found = [
        path
        for path in sorted((folder / "out").rglob("*"))
        if path.suffix in ({".html"} if picture.suffix == ".html" else {".png", ".jpg", ".webp"})
        and "-".join(path.relative_to(folder / "out").with_suffix("").parts) == picture.stem
    ]
    if len(found) != 1:
        sys.exit(f"{picture.name}: the page's commands must write it once (got {found or 'none'})")
    return found[0]


def convert(source: Path, picture: Path) -> None:
    """Write a small WebP; a moving picture, and a page that draws, is taken as it is."""
    if picture.suffix == ".html":
        picture.write_bytes(source.read_bytes())
        return
    with Image.open(source) as image:
        if getattr(image, "n_frames", 1) > 1:
            picture.write_bytes(source.read_bytes())
        else:
            small = image.convert("RGB")
            small.thumbnail((WIDTH_PX, 4 * WIDTH_PX), Image.Resampling.LANCZOS)
            for quality in (75, 60, 45):
                small.save(picture, quality=quality, method=6)
                if picture.stat().st_size <= LARGEST_BYTES:
                    break
    if picture.stat().st_size > LARGEST_BYTES:
        sys.exit(f"{picture.name}: must be at most {LARGEST_BYTES} bytes")


def make(names: list[str]) -> None:
    """Make the pictures of the named pages again; without names of all."""
    MADE.mkdir(parents=True, exist_ok=True)
    for page in pages():
        if not (script_of(page) and pictures_of(page)) or (names and page.stem not in names):
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            done = run(page, folder)
            if done.returncode:
                sys.exit(f"{page.name}: {done.stdout}{done.stderr}")
            for picture in pictures_of(page):
                convert(written(picture, folder), picture)
                print(picture.relative_to(REPOSITORY))
