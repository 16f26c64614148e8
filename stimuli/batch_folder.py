"""What lies where in a batch's folder, and how things get to their place.

While a build runs, unfinished work lies in ``.build``, named by its hash:

- ``.build/surveys/HASH/``: hole masks, and ``survey.json`` when they are complete
- ``.build/clips/HASH/``: frames of a clip
- ``.build/records/NAME.json``: the manifest's entry of a clip that is complete
- ``.build/names.json``: the folders that builds made here or were about to

A clip's folder is moved to its name when it is complete, the manifest is written when all
are, and ``.build`` is removed after that. So whatever is found after a kill is either whole
or in ``.build``, and the same command goes on from there.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeAlias, TypeVar

from protocols.errors import StudyError
from protocols.manifest import MANIFEST_NAME, Manifest, read_manifest
from protocols.recipes.warped_clips import ClipName
from stimuli.contact import SHEET_NAME
from stimuli.preview import PREVIEW_FOLDER
from stimuli.whole_file import PART, write_whole

BUILD_FOLDER = ".build"
HOLES_FOLDER = "holes"
NAMES = "names.json"

Report: TypeAlias = Callable[[int, int, str], None]
"""Called with frames done, frames in all, and what is going on."""

N = TypeVar("N")


@dataclass
class Outcome(Generic[N]):
    """What a build did, with the names of the clips."""

    manifest: Manifest
    built: list[N] = field(default_factory=list)
    kept: list[N] = field(default_factory=list)


def survey_name(clip: ClipName) -> str:
    """Return the folder of a scene's hole masks at a size, ``scene__size``."""
    return f"{clip.scene}__{clip.size}"


def is_clip_folder(name: str) -> bool:
    """Whether a folder is called as warped clips are."""
    return name.count("__") == 2


def claim(out: Path, names: Iterable[str]) -> None:
    """Note which folders a build is about to make, before it makes any.

    What earlier builds made stays noted: a folder that is noted nowhere is a user's.
    """
    noted = sorted(_claimed(out) | set(names))
    (out / BUILD_FOLDER).mkdir(exist_ok=True)
    write_whole(out / BUILD_FOLDER / NAMES, json.dumps(noted).encode())


def check_folder(out: Path, is_ours: Callable[[str], bool] = lambda _: False) -> None:
    """Refuse a folder with things that no build made: they would be deleted.

    What a killed build was writing here is removed.

    Parameters
    ----------
    is_ours : callable
        Says of a folder's name whether builds alone call folders so.

    Raises
    ------
    StudyError
        If there is such a thing.
    """
    known = {BUILD_FOLDER, MANIFEST_NAME, MANIFEST_NAME + ".part", HOLES_FOLDER,
             PREVIEW_FOLDER, SHEET_NAME}  # fmt: skip
    ours = (out / MANIFEST_NAME).exists() or (out / BUILD_FOLDER).exists()
    claimed = _claimed(out)
    for entry in sorted(out.iterdir()):
        if ours and entry.name.startswith(".") and entry.name.endswith(PART):
            entry.unlink()  # a build was killed while it wrote this file
            continue
        clip = ours and entry.is_dir() and (entry.name in claimed or is_ours(entry.name))
        if entry.name in known or clip:
            continue
        raise StudyError(
            f"{out}: must be an empty folder or one that a build made (it holds"
            f" {entry.name}); choose another --out, or move that file away"
        )


def remove_strangers(
    out: Path, clips: Sequence[str], is_ours: Callable[[str], bool] = lambda _: False
) -> None:
    """Remove clips of an older protocol that `clips` does not have."""
    claimed = _claimed(out)
    for entry in out.iterdir():
        known = entry.name in claimed or is_ours(entry.name)
        if entry.is_dir() and known and entry.name not in clips:
            shutil.rmtree(entry)


def remove_surveys(out: Path, surveys: Sequence[str]) -> None:
    """Remove hole masks of an older protocol that `surveys` does not have."""
    for entry in (out / HOLES_FOLDER).iterdir():
        if entry.name not in surveys:
            shutil.rmtree(entry)


def _claimed(out: Path) -> set[str]:
    """Return the folders that builds made here, as their notes and the manifest say."""
    names: set[str] = set()
    with suppress(OSError, ValueError):
        names |= set(map(str, json.loads((out / BUILD_FOLDER / NAMES).read_bytes())))
    with suppress(StudyError):
        names |= {clip.name for clip in read_manifest(out).clips}
    return names


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
