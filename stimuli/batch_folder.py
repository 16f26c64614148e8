"""What lies where in a batch's folder, and how things get to their place.

While a build runs, unfinished work lies in ``.build``, named by its hash:

- ``.build/surveys/HASH/``: hole masks, and ``survey.json`` when they are complete
- ``.build/clips/HASH/``: frames of a clip
- ``.build/records/NAME.json``: the manifest's entry of a clip that is complete

A clip's folder is moved to its name when it is complete, the manifest is written when all
are, and ``.build`` is removed after that. So whatever is found after a kill is either whole
or in ``.build``, and the same command goes on from there.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from protocols.errors import StudyError
from protocols.manifest import MANIFEST_NAME
from protocols.recipes.warped_clips import ClipName
from stimuli.contact import SHEET_NAME
from stimuli.preview import PREVIEW_FOLDER
from stimuli.whole_file import PART

BUILD_FOLDER = ".build"
HOLES_FOLDER = "holes"


def survey_name(clip: ClipName) -> str:
    """Return the folder of a scene's hole masks at a size, ``scene__size``."""
    return f"{clip.scene}__{clip.size}"


def check_folder(out: Path) -> None:
    """Refuse a folder with things that no build made: they would be deleted.

    What a killed build was writing here is removed.

    Raises
    ------
    StudyError
        If there is such a thing.
    """
    known = {BUILD_FOLDER, MANIFEST_NAME, MANIFEST_NAME + ".part", HOLES_FOLDER,
             PREVIEW_FOLDER, SHEET_NAME}  # fmt: skip
    ours = (out / MANIFEST_NAME).exists() or (out / BUILD_FOLDER).exists()
    for entry in sorted(out.iterdir()):
        if ours and entry.name.startswith(".") and entry.name.endswith(PART):
            entry.unlink()  # a build was killed while it wrote this file
            continue
        if entry.name in known or (ours and entry.is_dir() and entry.name.count("__") == 2):
            continue
        raise StudyError(
            f"{out}: must be an empty folder or one that a build made (it holds"
            f" {entry.name}); choose another --out, or move that file away"
        )


def remove_strangers(out: Path, clips: Sequence[ClipName]) -> None:
    """Remove clips and masks of an older protocol that `clips` does not have."""
    wanted = {str(name) for name in clips}
    for entry in out.iterdir():
        if entry.is_dir() and entry.name.count("__") == 2 and entry.name not in wanted:
            shutil.rmtree(entry)
    surveys = {survey_name(name) for name in clips}
    for entry in (out / HOLES_FOLDER).iterdir():
        if entry.name not in surveys:
            shutil.rmtree(entry)


def move_over(source: Path, target: Path) -> None:
    """Move a complete folder to its place; what was there goes first.

    So do files in `source` that a build was killed while it wrote.
    """
    for unfinished in source.glob(f".*{PART}"):
        unfinished.unlink()
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.exists():
        shutil.rmtree(target)
    sync(source)
    source.replace(target)
    sync(target.parent)


def sync(folder: Path) -> None:
    """Have the disk know of what was put into `folder`."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
