"""Layout of a batch's folder, and how things get to their place.

While a build runs, unfinished work lies in ``.build``, named by its hash:

- ``.build/surveys/HASH/``: hole masks, and ``survey.json`` when they are complete
- ``.build/clips/HASH/``: frames of a clip
- ``.build/records/NAME.json``: the manifest's entry of a clip that is complete
- ``.build/names.json``: what builds made here or were about to: folders, hashes, OpenEXR beside

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
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeAlias, TypeVar

from protocols.disk.hashing import sha256_file
from protocols.disk.locks import written
from protocols.disk.result_folder import files_below, remove_own
from protocols.disk.whole_file import PART, move, remove, sync_folder, write_whole
from protocols.errors import StudyError
from protocols.manifest import MANIFEST_NAME, Clip, Manifest, read_manifest
from protocols.recipes.warped_clips import ClipName
from stimuli.batch.contact import SHEET_NAME
from stimuli.media.video import PREVIEW_FOLDER

BUILD_FOLDER = ".build"
HOLES_FOLDER = "holes"
NAMES = "names.json"
SURVEY_NAME = "survey.json"

Report: TypeAlias = Callable[[int, int, str], None]
"""Called with frames done, frames in all, and what is going on."""

N = TypeVar("N")


@dataclass
class BuildOutcome(Generic[N]):
    """Result of a build: the names of the clips it made and kept."""

    manifest: Manifest
    built: list[N] = field(default_factory=list)
    kept: list[N] = field(default_factory=list)


def survey_name(clip: ClipName) -> str:
    """Return the folder of a scene's hole masks at a size, ``scene__size``."""
    return f"{clip.scene}__{clip.size}"


def claim(out: Path, names: Iterable[str], keys: Iterable[str], *, exr: bool = False) -> None:
    """Note what a build is about to make, before it makes any of it.

    What earlier builds made stays noted: a folder that is noted nowhere is a user's.

    Parameters
    ----------
    names : iterable of str
        Folders of clips.
    keys : iterable of str
        Hashes that unfinished work is named by.
    exr : bool
        Whether these clips have OpenEXR files beside their frames.
    """
    own, noted = _Own(out), _noted(out)
    noted["names"] = own.clips | set(names)
    noted["keys"] |= set(keys)
    noted["exr"] = own.exr | (set(names) if exr else set())
    (out / BUILD_FOLDER).mkdir(exist_ok=True)
    content = {kind: sorted(values) for kind, values in noted.items()}
    write_whole(out / BUILD_FOLDER / NAMES, json.dumps(content).encode())


def check_batch_folder(out: Path, wanted: Iterable[str] = ()) -> None:
    """Refuse a folder with anything in it that no build recorded as its own: it could be lost.

    What a killed build was writing here is removed.

    Parameters
    ----------
    wanted : iterable of str
        Clips that are built now: where one is damaged it is made again. Frames of any other clip
        must be as they were recorded.

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
                f"{out}: must be an empty folder or one that a build made (its {MANIFEST_NAME}"
                f" cannot be read); choose another --out\n{error}"
            ) from None
    own, found = _Own(out, wanted), list(files_below(out))
    for path in found:
        relative = path.relative_to(out)
        if path.is_symlink() or not own.has(relative):
            raise StudyError(
                f"{out}: must be an empty folder or one that a build made (it holds"
                f" {relative}{', a symbolic link' if path.is_symlink() else ''}, which no build"
                " recorded as its own); choose another --out, or move that away"
            )
    for path in found:
        if path.parent == out and written(path.name):
            remove(path)  # a build was killed while it wrote this file


def remove_strangers(out: Path, clips: Sequence[str]) -> None:
    """Remove clips of an older protocol that `clips` does not have."""
    for name in sorted(_Own(out).clips - set(clips)):
        _remove_own(out, out / name)


def remove_surveys(out: Path, surveys: Sequence[str]) -> None:
    """Remove hole masks of an older protocol that `surveys` does not have."""
    for name in sorted(_Own(out).surveys - set(surveys)):
        _remove_own(out, out / HOLES_FOLDER / name)


def remove_previews(out: Path, wanted: Iterable[str]) -> None:
    """Remove previews that builds made, but for those with a name in `wanted`."""
    own, kept = _Own(out), {out / PREVIEW_FOLDER / name for name in wanted}
    remove_own(
        out / PREVIEW_FOLDER, lambda path: path not in kept and own.has(path.relative_to(out))
    )


def remove_unfinished(out: Path, work: Path | None = None) -> None:
    """Remove what builds left in ``.build``, or in one folder there."""
    _remove_own(out, work or out / BUILD_FOLDER)


class _Own:
    """Files in a folder that builds recorded as their own, each by its name.

    Of clips that only the manifest names, and that are not `wanted`, frames, masks and previews
    must be those that were recorded: a manifest can be edited. Of a wanted clip of several frames
    one must be.
    """

    def __init__(self, out: Path, wanted: Iterable[str] = ()) -> None:
        self._out, self._recorded = out, _recorded(out)
        noted = _noted(out)
        self._by_name = noted["names"] | set(wanted)
        self.clips = noted["names"] | set(self._recorded)
        self.surveys = _surveys(self.clips)
        self.exr = noted["exr"] | {
            name for name, clip in self._recorded.items() if clip.parameters.get("exr")
        }
        self._keys = "|".join(noted["keys"]) if noted["keys"] else "[0-9a-f]{64}"
        self._partly: dict[str, bool] = {}
        self._ours = (out / MANIFEST_NAME).exists() or (out / BUILD_FOLDER).is_dir()

    def has(self, path: Path) -> bool:
        """Return True if a build writes such a file, or leaves such an empty folder.

        Parameters
        ----------
        path : Path
            Relative to the folder of clips.
        """
        if not self._ours:
            return False
        unfinished = written(path.name)
        first, *rest = path.parts if unfinished is None else path.with_name(unfinished[0]).parts
        if not rest and unfinished:
            return first in {MANIFEST_NAME, SHEET_NAME}
        if not rest:
            return first in {
                MANIFEST_NAME, MANIFEST_NAME + PART, SHEET_NAME, BUILD_FOLDER, HOLES_FOLDER,
                PREVIEW_FOLDER, *self.clips,
            }  # fmt: skip
        below = "/".join(rest)
        if first == BUILD_FOLDER:
            return bool(re.fullmatch(_UNFINISHED.format(keys=self._keys), below))
        if first == HOLES_FOLDER:
            return rest[0] in self.surveys and self._has_mask(path, "/".join(rest[1:]))
        if first == PREVIEW_FOLDER:
            found = _PREVIEW.fullmatch(below)
            return found is not None and self._has_preview(found["name"], found["sha256"])
        return first in self.clips and self._has_frame(path, first, below)

    def _has_frame(self, path: Path, clip: str, name: str) -> bool:
        found = _FRAME.fullmatch(name)
        if found is None or not name:
            return not name
        recorded, index = self._recorded.get(clip), int(found["index"])
        if recorded is not None and index >= len(recorded.frames_sha256):
            return False
        if found["ending"] == "exr":
            return clip in self.exr
        if recorded is None or (clip in self._by_name and self._is_partly(recorded)):
            return True
        return self._is(path, recorded.frames_sha256[index])

    def _is_partly(self, clip: Clip) -> bool:
        """Return True if a frame of a clip is as recorded; of a single one nobody can tell."""
        if clip.name not in self._partly:
            frames = enumerate(clip.frames_sha256)
            self._partly[clip.name] = len(clip.frames_sha256) == 1 or any(
                self._is(Path(clip.frame_path(index)), sha256) for index, sha256 in frames
            )
        return self._partly[clip.name]

    def _has_mask(self, path: Path, name: str) -> bool:
        found, survey = _MASK.fullmatch(name), path.parent.name
        if found is None or not name:
            return not name
        if found["index"] is not None:
            most = [
                len(clip.frames_sha256)
                for clip in self._recorded.values()
                if survey in _surveys([clip.name])
            ]
            if int(found["index"]) >= max(most, default=math.inf):
                return False
        if survey in _surveys(self._by_name):
            return True
        try:
            masks = json.loads((self._out / path).with_name(SURVEY_NAME).read_bytes())
            hashes = [*masks["masks_sha256"]]
            return found["index"] is None or self._is(path, hashes[int(found["index"])])
        except (OSError, ValueError, LookupError, TypeError, RecursionError):
            return False

    def _has_preview(self, clip: str, sha256: str) -> bool:
        recorded = self._recorded.get(clip)
        return clip in self._by_name or (
            recorded is not None and recorded.sha256.startswith(sha256)
        )

    def _is(self, path: Path, sha256: str) -> bool:
        try:
            return sha256_file(self._out / path) == sha256
        except OSError:
            return False


_WARPED = 2
"""Double underscores in the name of a warped clip: scene, size, method."""
_FRAME = re.compile(r"((?P<index>[0-9]{6})\.(?P<ending>png|exr))?")
_MASK = re.compile(rf"((?P<index>[0-9]{{6}})\.png|{re.escape(SURVEY_NAME)})?")
_PREVIEW = re.compile(r"(?P<name>[^/]+)\.(?P<sha256>[0-9a-f]{12})\.webm")
_UNFINISHED = (
    r"(surveys|clips)(/({keys})(/([0-9]{{6}}\.(png|exr)|survey\.json)?)?)?"
    r"|clips/({keys})/[^/.]+(/([0-9]{{6}}\.png)?|\.npz)?"
    r"|records(/[^/]+\.json)?|names\.json"
)


def _surveys(clips: Iterable[str]) -> set[str]:
    return {name.rpartition("__")[0] for name in clips if name.count("__") == _WARPED}


def _remove_own(out: Path, folder: Path) -> None:
    """Remove what builds wrote into a folder; it stays where there is more in it."""
    own = _Own(out)
    remove_own(folder, lambda path: own.has(path.relative_to(out)))


def _noted(out: Path) -> dict[str, set[str]]:
    """Return the folders that builds made here or were about to, as their notes say.

    A folder may come from anywhere, and what is noted is deleted: no note leads out of it. Notes of
    versions before this one are a list of names.
    """
    found: dict[str, set[str]] = {"names": set(), "keys": set(), "exr": set()}
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        raw = json.loads((out / BUILD_FOLDER / NAMES).read_bytes())
        for kind, values in (raw if isinstance(raw, dict) else {"names": raw}).items():
            found[kind] |= {name for name in map(str, values) if _is_plain(name)}
    return found


def _is_plain(name: str) -> bool:
    return name == Path(name).name and bool(name.strip("."))


def _recorded(out: Path) -> dict[str, Clip]:
    """Return the clips of the manifest."""
    with suppress(StudyError):
        return {clip.name: clip for clip in read_manifest(out).clips}
    return {}


_OCCUPIED = {errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR} | (
    {errno.EACCES} if os.name == "nt" else set()
)


def move_over(source: Path, target: Path, out: Path | None = None) -> None:
    """Move a complete folder to its place; what builds wrote there goes first.

    So do files in `source` that a build was killed while it wrote.

    Parameters
    ----------
    out : Path, optional
        The folder of clips; left out: that of `target`.

    Raises
    ------
    StudyError
        If there is anything else at that place.
    """
    for entry in list(source.iterdir()):
        file, _ = written(entry.name) or (entry.name, 0)
        if file != entry.name and (_FRAME.fullmatch(file) or _MASK.fullmatch(file)):
            remove(entry)
    target.parent.mkdir(parents=True, exist_ok=True)
    _remove_own(out or target.parent, target)
    sync_folder(source)
    try:
        with suppress(OSError):
            target.rmdir()  # Windows moves no folder over another, empty or not
        move(source, target)
    except OSError as error:
        if error.errno not in _OCCUPIED:
            raise
        raise StudyError(
            f"{target}: must hold frames alone (something else is there, which no build made);"
            " move it away"
        ) from None
    sync_folder(target.parent)
