"""Manifest of a folder of clips: parameters and the SHA-256 of every frame.

A manifest is written last, so a folder with one is complete. It holds no time stamps: the same
inputs give the same bytes.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from protocols.disk.hashing import Json, canonical_json, sha256_bytes, sha256_json
from protocols.disk.whole_file import decode_utf8, read_bytes, write_whole
from protocols.errors import StudyError, refuse_format_1
from protocols.load import control_characters, study_error
from protocols.outside import parsed_json
from protocols.study_file.problems import problems_of
from protocols.study_file.schema import StudyProtocol
from protocols.units import (
    Hertz,
    Model,
    Name,
    Parameters,
    Pixels,
    Scalar,
    Seed,
    Sha256,
    Share,
    matching,
)

MANIFEST_NAME = "manifest.json"


class Renderer(Model):
    """Graphics card or software that drew the clips. Bytes repeat on the same renderer only."""

    vendor: str
    renderer: str
    version: str


class Clip(Model):
    """One stimulus: a folder of PNG frames. A still has one frame."""

    name: Annotated[
        str,
        matching(
            r"^[a-z0-9]+([-_]{1,2}[a-z0-9]+)*$",
            "lower-case words and numbers joined by one or two dashes or underscores, like"
            " 'garden__small__push-pull'",
        ),
    ]
    """Its name in plans and journals, and its folder. Warped clips: `scene__size__method`."""
    condition: dict[Name, Scalar]
    """Condition shown, column by column."""
    width_px: Pixels
    height_px: Pixels
    fps: Hertz
    bit_depth: Literal[8, 16]
    seed: Seed
    parameters: Parameters
    """Everything the clip was made with: camera path, extent, method parameters."""
    hole_share: Share | None = None
    """Measured mean share of hole pixels. Null if nothing was warped."""
    cache_key: Sha256
    """Hash of inputs, parameters and the method's source code. Equal keys mean equal frames."""
    frames_sha256: Annotated[tuple[Sha256, ...], Field(min_length=1)]
    """Hash of every PNG file, in order."""

    def column(self, name: str) -> str:
        """Return a value of the condition as text; empty where there is no such column."""
        return str(self.condition.get(name, ""))

    @property
    def sha256(self) -> str:
        """One hash for all frames."""
        return sha256_json(list(self.frames_sha256))

    def frame_path(self, index: int) -> str:
        """Return a frame's path inside the folder of clips."""
        return frame_path(self.name, index)


class Manifest(Model):
    """Every clip of a study, built for one display."""

    format: Literal[2]
    """Version of the file format."""
    study: Name
    stimuli_sha256: Sha256
    """Hash of the part of the study that determines the pixels."""
    display: Name
    revision: str
    """Version and git revision of metamerlab."""
    renderer: Renderer
    versions: dict[str, str]
    """Versions of Python and of packages that make pixels."""
    simulated: bool = False
    """True for a manifest without pixels, as simulated sessions use it."""
    clips: tuple[Clip, ...]

    @model_validator(mode="after")
    def _clips_differ(self) -> Manifest:
        for name, count in Counter(clip.name for clip in self.clips).items():
            if count > 1:
                raise ValueError(f"clips must differ in name (got {name} {count} times)")
        return self

    @cached_property
    def sha256(self) -> str:
        """Hash of the whole manifest: the hash of the file that `write_manifest` writes."""
        return sha256_bytes(_file_bytes(self))

    def clip(self, name: str) -> Clip:
        """Return one clip; `KeyError` if the manifest lacks it."""
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, Clip]:
        return {clip.name: clip for clip in self.clips}

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        """Return a copy without what this one keeps: its hash, its clips by name."""
        copy = super().model_copy(update=update, deep=deep)
        for kept in ("sha256", "_by_name"):
            copy.__dict__.pop(kept, None)
        return copy


def frame_path(clip: object, index: int) -> str:
    """Return a frame's path in the folder of clips: ``NAME/000000.png``."""
    return f"{clip}/{index:06d}.png"


def cache_key(inputs: Json) -> str:
    """Return the cache key of a clip, a SHA-256 in hexadecimal digits.

    Parameters
    ----------
    inputs : JSON value
        All that decides its pixels: hashes of the input files, every parameter, the seed, the
        size in pixels, and the hash of the method's sources. Not the git revision: an unrelated
        commit must not make clips stale.
    """
    return sha256_json({"clip_format": 1, "inputs": inputs})


def write_manifest(folder: Path, manifest: Manifest) -> Path:
    """Write ``manifest.json`` in one step: temporary name, flush to disk, move.

    Raises
    ------
    StudyError
        If the folder cannot be written.
    """
    target = folder / MANIFEST_NAME
    try:
        write_whole(target, _file_bytes(manifest))
    except OSError as error:
        raise StudyError(f"{target}: must be writable ({error.strerror})") from None
    return target


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a folder of clips.

    Raises
    ------
    StudyError
        If there is none (the batch is not finished), or it has mistakes: one line for each.
    """
    path = folder / MANIFEST_NAME
    if not path.exists():
        raise _without_manifest(folder)
    data = read_bytes(path, "the manifest")
    decode_utf8(data, path)  # it names the line of what is no UTF-8
    raw = parsed_json(path, data, "the manifest of a build", StudyError, "build again")
    if found := list(control_characters(raw)):
        raise study_error(path, found)
    if isinstance(raw, dict):
        refuse_format_1(path, raw, "show the clips there, or build them again into another folder")
    try:
        return Manifest.model_validate_json(json.dumps(raw))
    except ValidationError as error:
        raise study_error(path, problems_of(error, raw, Manifest)) from None


def _without_manifest(folder: Path) -> StudyError:
    """Message about a folder of clips that is none, with the cure for what is there."""
    found = f"there is no {MANIFEST_NAME}"
    if folder.is_dir():
        beside = sorted(folder.glob(f"*/{MANIFEST_NAME}"))
    else:
        beside = [path for path in [folder.parent / MANIFEST_NAME] if path.exists()]
        found = "this is a file" if folder.exists() else "there is no such folder"
    if len(beside) == 1 and folder.exists():
        cure = f"name {beside[0].parent}"
    elif folder.is_file():
        cure = "name the folder that 'metamerlab stimuli build' filled"
    else:
        cure = f"run 'metamerlab stimuli build STUDY --out {folder}' to the end"
    return StudyError(f"{folder}: must hold a finished batch of clips ({found}); {cure}")


def check_manifest(study: StudyProtocol, manifest: Manifest) -> None:
    """Refuse a manifest that was not built for `study`, or lacks clips.

    Raises
    ------
    StudyError
        Naming what differs and the cure.
    """
    if manifest.study != study.study.name:
        raise StudyError(
            f"the clips must belong to study {study.study.name!r} (got a manifest of"
            f" {manifest.study!r}); give the folder built from this protocol"
        )
    if manifest.stimuli_sha256 != study.stimuli_sha256:
        raise StudyError(
            "the clips must be built from this protocol's display and stimuli"
            f" (hash {study.stimuli_sha256[:12]}, got {manifest.stimuli_sha256[:12]});"
            " run 'metamerlab stimuli build' again"
        )
    present = {clip.name for clip in manifest.clips}
    missing = [name for name in study.shown() if name not in present]
    if missing:
        shown = ", ".join(missing[:3]) + (", ..." if len(missing) > 3 else "")
        raise StudyError(
            f"the manifest must list every clip of the study (missing {len(missing)}: {shown});"
            " run 'metamerlab stimuli build' again"
        )
    frames = study.stimuli.frames
    wrong = [clip for clip in manifest.clips if len(clip.frames_sha256) != frames]
    if wrong:
        raise StudyError(
            f"{wrong[0].name}: must have {frames} frames"
            f" (got {len(wrong[0].frames_sha256)}); run 'metamerlab stimuli build' again"
        )
    _check_stated(study, manifest)


def _check_stated(study: StudyProtocol, manifest: Manifest) -> None:
    """Refuse a manifest that says of a clip what its study does not."""
    pool = {stimulus.name: stimulus for stimulus in study.stimuli.pool()}
    for clip in manifest.clips:
        stimulus = pool.get(clip.name)
        if stimulus is None:
            continue
        stated = {"condition": dict(stimulus.condition), **study.stimuli.stated(stimulus)}
        for key, wanted in stated.items():
            known = clip.parameters.get(key, wanted)
            found = getattr(clip, key) if key in Clip.model_fields else known
            if found != wanted:
                raise StudyError(
                    f"{clip.name}: {key} must be {wanted}, as the study has it (the manifest says"
                    f" {found}); run 'metamerlab stimuli build' again"
                )


def _file_bytes(manifest: Manifest) -> bytes:
    """Return the file's content: canonical, but a line per entry, so that diffs are readable."""
    plain = json.loads(canonical_json(manifest))
    return (json.dumps(plain, sort_keys=True, indent=1, ensure_ascii=False) + "\n").encode()
