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

import errno
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
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


def claim(out: Path, names: Iterable[str]) -> None:
    """Note which folders a build is about to make, before it makes any.

    What earlier builds made stays noted: a folder that is noted nowhere is a user's.
    """
    noted = sorted(_noted(out) | set(_recorded(out)) | set(names))
    (out / BUILD_FOLDER).mkdir(exist_ok=True)
    write_whole(out / BUILD_FOLDER / NAMES, json.dumps(noted).encode())


def check_folder(out: Path) -> None:
    """Refuse a folder with anything in it that no build recorded as its own: it could be lost.

    What a killed build was writing here is removed.

    Raises
    ------
    StudyError
        If there is such a thing, a symbolic link, or a manifest that cannot be read.
    """
    if (out / MANIFEST_NAME).exists():
        try:
            read_manifest(out)
        except StudyError as error:
            raise StudyError(
                f"{out}: must be an empty folder or one that a build made (its {MANIFEST_NAME} is"
                f" none that a build wrote, or was changed); choose another --out\n{error}"
            ) from None
    own, found = _Own(out), list(_leaves(out))
    for path in found:
        relative = path.relative_to(out)
        if path.is_symlink() or not own.has(relative):
            raise StudyError(
                f"{out}: must be an empty folder or one that a build made (it holds"
                f" {relative}{', a symbolic link' if path.is_symlink() else ''}, which no build"
                " recorded as its own); choose another --out, or move that away"
            )
    for path in found:
        if path.name.startswith(".") and path.name.endswith(PART) and path.parent == out:
            path.unlink()  # a build was killed while it wrote this file


def remove_strangers(out: Path, clips: Sequence[str]) -> None:
    """Remove clips of an older protocol that `clips` does not have."""
    own = _Own(out)
    for name in sorted(own.clips - set(clips)):
        _remove_own(out, Path(name), own)


def remove_surveys(out: Path, surveys: Sequence[str]) -> None:
    """Remove hole masks of an older protocol that `surveys` does not have."""
    own = _Own(out)
    for name in sorted(own.surveys - set(surveys)):
        _remove_own(out, Path(HOLES_FOLDER) / name, own)


def remove_previews(out: Path, wanted: Iterable[str]) -> None:
    """Remove previews that builds made, but for those with a name in `wanted`."""
    folder, own, kept = out / PREVIEW_FOLDER, _Own(out), set(wanted)
    if not folder.is_dir():
        return
    for entry in list(folder.iterdir()):
        if entry.name not in kept and own.has(entry.relative_to(out)) and not entry.is_dir():
            entry.unlink()
    with suppress(OSError):  # not empty
        folder.rmdir()


class _Own:
    """What builds recorded of a folder as their own: each file that they write, by its name."""

    def __init__(self, out: Path) -> None:
        self._frames = _recorded(out)
        self.clips = _noted(out) | set(self._frames)
        self.surveys = {
            name.rpartition("__")[0] for name in self.clips if name.count("__") == _WARPED
        }
        self._ours = (out / MANIFEST_NAME).exists() or (out / BUILD_FOLDER).is_dir()

    def has(self, path: Path) -> bool:
        """Return whether a build writes such a file, or leaves such an empty folder.

        Parameters
        ----------
        path : Path
            Relative to the folder of clips.
        """
        if not self._ours:
            return False
        first, *rest = path.parts
        number = path.name[:6]
        if rest and number.isdecimal() and int(number) >= self._frames_of(path.parent.name):
            return False
        if not rest:
            return first in {
                MANIFEST_NAME, MANIFEST_NAME + PART, SHEET_NAME, BUILD_FOLDER, HOLES_FOLDER,
                PREVIEW_FOLDER, *self.clips,
            } or bool(_WRITING.fullmatch(first))  # fmt: skip
        if first == BUILD_FOLDER:
            return bool(_UNFINISHED.fullmatch("/".join(rest)))
        if first == HOLES_FOLDER:
            return rest[0] in self.surveys and bool(_MASK.fullmatch("/".join(rest[1:])))
        if first == PREVIEW_FOLDER:
            found = _PREVIEW.fullmatch("/".join(rest))
            return found is not None and found["name"] in self.clips
        return first in self.clips and bool(_FRAME.fullmatch("/".join(rest)))

    def _frames_of(self, folder: str) -> float:
        """Return how many frames a clip or a survey has; infinite where no manifest says so."""
        found = [
            frames
            for name, frames in self._frames.items()
            if folder in (name, name.rpartition("__")[0])
        ]
        return max(found, default=math.inf)


_WARPED = 2
"""Double underscores in the name of a warped clip: scene, size, method."""
_PARTIAL = r"\.[^/]+\.[0-9]+" + re.escape(PART)
_WRITING = re.compile(_PARTIAL)
_FRAME = re.compile(rf"([0-9]{{6}}\.(png|exr))?|{_PARTIAL}")
_MASK = re.compile(rf"([0-9]{{6}}\.png|survey\.json)?|{_PARTIAL}")
_PREVIEW = re.compile(r"\.?(?P<name>[^/]+)\.[0-9a-f]{12}(\.[0-9]+\.part)?\.webm")
_UNFINISHED = re.compile(
    r"(surveys|clips|records)(/[0-9a-f]{64}(/.*)?)?|records/[^/]+|[0-9a-f]{64}\.npz[^/]*"
    rf"|{re.escape(NAMES)}|{_PARTIAL}"
)


def _leaves(folder: Path) -> Iterator[Path]:
    """Yield every file, link and empty folder below a folder; links are not followed."""
    for entry in sorted(folder.iterdir()):
        if entry.is_dir() and not entry.is_symlink():
            below = list(_leaves(entry))
            yield from below or [entry]
        else:
            yield entry


def _remove_own(out: Path, folder: Path, own: _Own) -> None:
    """Remove what builds wrote into a folder; it stays where there is more in it."""
    target = out / folder
    if not target.is_dir() or target.is_symlink():
        return
    for entry in list(target.iterdir()):
        if own.has(entry.relative_to(out)) and not entry.is_dir():
            entry.unlink()
    with suppress(OSError):  # not empty: somebody put something there meanwhile
        target.rmdir()


def _noted(out: Path) -> set[str]:
    """Return the folders that builds made here or were about to, as their notes say.

    A folder may come from anywhere, and what is noted is deleted: no note leads out of it.
    """
    with suppress(OSError, ValueError, TypeError, RecursionError):
        noted = map(str, json.loads((out / BUILD_FOLDER / NAMES).read_bytes()))
        return {name for name in noted if name == Path(name).name and name.strip(".")}
    return set()


def _recorded(out: Path) -> dict[str, int]:
    """Return the clips of the manifest and how many frames they have."""
    with suppress(StudyError):
        return {clip.name: len(clip.frames_sha256) for clip in read_manifest(out).clips}
    return {}


def move_over(source: Path, target: Path) -> None:
    """Move a complete folder to its place; frames or masks that builds wrote there go first.

    So do files in `source` that a build was killed while it wrote.

    Raises
    ------
    StudyError
        If there is anything else at that place.
    """
    for unfinished in source.glob(f".*{PART}"):
        unfinished.unlink()
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.is_dir() and not target.is_symlink():
        for entry in list(target.iterdir()):
            if _FRAME.fullmatch(entry.name) or _MASK.fullmatch(entry.name):
                entry.unlink()
    sync(source)
    try:
        source.replace(target)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise
        raise StudyError(
            f"{target}: must hold frames alone (something else is there, which no build made);"
            " move it away"
        ) from None
    sync(target.parent)


def sync(folder: Path) -> None:
    """Have the disk know of what was put into `folder`."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
