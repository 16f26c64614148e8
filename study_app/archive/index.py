"""Index of an archive: the study, and every file with its length and hash."""

from __future__ import annotations

import json
from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from protocols.disk.hashing import Json, canonical_json, sha256_bytes
from protocols.units import Model, Name, Sha256

INDEX_NAME = "archive.json"
"""Written last, at the root of the archive."""
STUDY, SESSIONS, CLIPS = "study", "sessions", "clips"
"""Folders of an archive."""


def plain(name: str) -> str:
    """Return the name of a file inside an archive.

    Raises
    ------
    ValueError
        If it leads out of the archive's own folder, or means something else on another system.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or str(path) != name:
        raise ValueError("a file must lie inside the archive's own folder")
    if any(c in name for c in "\0\\:") or any(not part.strip(". ") for part in path.parts):
        raise ValueError("a name must be plain")
    return name


class ArchivedFile(Model):
    """One file."""

    path: Annotated[str, AfterValidator(plain)]
    """From the root of the archive, with slashes."""
    bytes: Annotated[int, Field(ge=0)]
    sha256: Sha256


class Index(Model):
    """Everything that an archive holds, but this list."""

    format: Literal[1]
    study: Name
    protocol: Annotated[str, AfterValidator(plain)]
    """Path of the study's file in the archive."""
    protocol_sha256: Sha256
    revision: str
    """Of the program that wrote the archive."""
    secret: bool
    """True if the study's secret is in it."""
    clips: bool
    """True if the frames are in it, and not their manifest alone."""
    files: tuple[ArchivedFile, ...]

    def to_bytes(self) -> bytes:
        """Return the file `archive.json`."""
        plain: Json = json.loads(canonical_json(self))
        return json.dumps(plain, indent=1, sort_keys=True, ensure_ascii=False).encode() + b"\n"

    @property
    def sha256(self) -> str:
        """Hash of the file `archive.json`: noted elsewhere, it vouches for the whole archive."""
        return sha256_bytes(self.to_bytes())
