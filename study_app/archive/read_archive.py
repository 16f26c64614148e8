"""Reads archives as if an enemy had made them: nothing is believed that the list does not say."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import stat
import sys
import zipfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath
from typing import IO, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field

from protocols.disk.hashing import Json, canonical_json, sha256_bytes, sha256_file
from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError
from protocols.journal_file import find_journals, read_journal
from protocols.limits import LIMITS_VARIABLE, check_within, limit
from protocols.load import SECRET_SUFFIX, load_protocol
from protocols.manifest import MANIFEST_NAME, read_manifest
from protocols.outside import check_zip, reading
from protocols.units import Model, Name, Sha256
from study_app.session_folders import SessionFolder
from study_app.verification import verify

INDEX_NAME = "archive.json"
"""Written last, at the root of the archive."""
STUDY, SESSIONS, CLIPS = "study", "sessions", "clips"
"""Folders of an archive."""


def plain_name(name: str) -> str:
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

    path: Annotated[str, AfterValidator(plain_name)]
    """From the root of the archive, with slashes."""
    bytes: Annotated[int, Field(ge=0)]
    sha256: Sha256


class Index(Model):
    """Everything that an archive holds, but this list."""

    format: Literal[1]
    study: Name
    protocol: Annotated[str, AfterValidator(plain_name)]
    """Path of the study's file in the archive."""
    protocol_sha256: Sha256
    revision: str
    """Revision of the program that wrote the archive."""
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


if sys.platform == "win32":  # Python 3.11 has no path that is one of all systems
    from pathlib import WindowsPath as _SystemPath
else:
    from pathlib import PosixPath as _SystemPath

_ENCRYPTED = b"age-encryption.org/v1\n"
"""First line of what age encrypted."""
_PIECE = 1 << 20
_LARGER = 4
"""An archive may unpack to so many times its own size, however large it is."""
_ENTRY = 500
"""Bytes of a file in the list of an archive: more than any has in the mean."""
_MARKS = 4
"""A brace and commas of a file in that list; what parses JSON allots some bytes for each."""
_PLAIN_FILES = {0, stat.S_IFREG}


@dataclass(frozen=True)
class ArchiveFindings:
    """Findings about an archive."""

    index: Index
    sessions: int
    problems: tuple[str, ...]
    """Differences from what was recorded; empty: none."""
    notes: tuple[str, ...]
    """Checks that could not be made."""


@contextmanager
def opened_archive(path: Path) -> Iterator[IO[bytes]]:
    """Yield the file of an archive.

    Raises
    ------
    StudyError
        If there is no such file, or it is encrypted.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise StudyError(f"{path}: an archive must be readable ({error.strerror})") from None
    with file:
        if file.read(len(_ENCRYPTED)) == _ENCRYPTED:
            out = path.with_suffix("") if path.suffix == ".age" else f"{path}.zip"
            raise StudyError(
                f"{path}: must be a plain archive (it is encrypted by age); decrypt it with 'age"
                f" --decrypt --output {out} {path}', with --identity FILE where it was encrypted to"
                f" a key, then verify {out}"
            )
        file.seek(0)
        yield file


def check_archive(path: Path, file: IO[bytes]) -> ArchiveFindings:
    """Prove an archive whole: each file against the list, each session as `session verify` does.

    Nothing is unpacked for that, and a killed program leaves nothing.

    Raises
    ------
    StudyError
        If it is no archive, or one that no program of ours wrote.
    """
    with _members(path, file) as (archive, index):
        problems = [
            f"{entry.path} was changed"
            for entry in index.files
            if _length_and_hash(path, archive, entry.path) != (entry.bytes, entry.sha256)
        ]
        wrong, notes, sessions = _of_study(_as_folder(path, archive), index)
        return ArchiveFindings(index, sessions, (*problems, *wrong), notes)


def check_unpacked(folder: Path) -> ArchiveFindings:
    """Prove whole what was unpacked by any program.

    Raises
    ------
    StudyError
        If its list cannot be read.
    """
    path = folder / INDEX_NAME
    index, problems = _index(path, read_bytes(path, "the archive's list")), []
    for entry in index.files:
        place = folder / entry.path
        if place.is_symlink() or not place.is_file():
            problems.append(f"{entry.path} is missing")
        elif (place.stat().st_size, sha256_file(place)) != (entry.bytes, entry.sha256):
            problems.append(f"{entry.path} was changed")
    listed = {entry.path for entry in index.files} | {INDEX_NAME}
    found = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir()}
    problems += [f"{name} is not of the archive" for name in sorted(found - listed)]
    wrong, notes, sessions = _of_study(folder, index)
    return ArchiveFindings(index, sessions, (*problems, *wrong), notes)


@contextmanager
def _members(path: Path, file: IO[bytes]) -> Iterator[tuple[zipfile.ZipFile, Index]]:
    """Yield an archive whose members are exactly those of its list, and none of them a trap."""
    with reading(path, "an archive of 'session archive'", StudyError):
        check_zip(path, file, StudyError)
        archive = zipfile.ZipFile(file)
    with archive:
        check_within("files", len(archive.infolist()), StudyError, path, "files", "hold")
        infos = {info.filename: info for info in archive.infolist()}
        size = os.fstat(file.fileno()).st_size
        most = max(limit("unpacked"), _LARGER * size)
        total = sum(info.file_size for info in archive.infolist())
        if total > most:
            raise StudyError(
                f"{path}: must unpack to at most {most:,} bytes (says {total:,}); if it is right,"
                f" raise the limit with {LIMITS_VARIABLE}=unpacked={total}"
            )
        for info in archive.infolist():
            if wrong := _trap(info, size):
                raise StudyError(f"{path}: {info.filename[:200]!r}: {wrong}; nothing was unpacked")
        if len(infos) != len(archive.infolist()):
            raise StudyError(f"{path}: must name each file once")
        if INDEX_NAME not in infos:
            raise StudyError(
                f"{path}: must be an archive of 'session archive' (it has no {INDEX_NAME})"
            )
        _check_length(path, infos[INDEX_NAME].file_size)
        with reading(path, "a whole archive", StudyError):
            listed = archive.read(INDEX_NAME)
        index = _index(path, listed)
        lacking = sorted({entry.path for entry in index.files} ^ (infos.keys() - {INDEX_NAME}))
        if lacking or len(index.files) != len(infos) - 1:
            raise StudyError(
                f"{path}: must hold the files of its list and no other (differs in"
                f" {len(lacking)}: {', '.join(lacking[:3])})"
            )
        folders = {str(above) for name in infos for above in PurePosixPath(name).parents}
        if both := sorted(folders & infos.keys()):
            raise StudyError(f"{path}: {both[0]}: a file must not be a folder as well")
        yield archive, index


def _trap(info: zipfile.ZipInfo, size: int) -> str | None:
    """Return the reason why a member is none that we write."""
    if info.orig_filename != info.filename:
        return "a name must be plain"
    try:
        plain_name(info.filename)
    except ValueError as error:
        return str(error)
    if stat.S_IFMT(info.external_attr >> 16) not in _PLAIN_FILES:
        return "must be a file, and no link"
    if not 0 <= info.header_offset < size:
        return "must lie within the archive"
    if info.flag_bits & 1 or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return "must be stored or deflated"
    return None


def _check_length(path: Path, size: int, entries: int = 0) -> None:
    """Refuse a list that is too long before it is parsed."""
    count = max(size // _ENTRY, entries)
    check_within("files", count, StudyError, path, f"files in its {INDEX_NAME}", "hold")


def _index(path: Path, data: bytes) -> Index:
    marks = sum(data.count(mark) for mark in (b"{", b"[", b","))
    _check_length(path, len(data), marks // _MARKS)
    with reading(path, f"an archive whose {INDEX_NAME} is as it was written", StudyError):
        index = Index.model_validate_json(data)
        if index.to_bytes() != data:
            raise ValueError("it was rewritten")
    return index


def _length_and_hash(path: Path, archive: zipfile.ZipFile, name: str) -> tuple[int, str]:
    digest, length = hashlib.sha256(), 0
    with reading(path, "a whole archive", StudyError), archive.open(name) as data:
        while piece := data.read(_PIECE):
            digest.update(piece)
            length += len(piece)
    return length, digest.hexdigest()


class _Member(_SystemPath):
    """A path into an archive: its files are read from there, and nothing else can be done."""

    archive: ClassVar[zipfile.ZipFile]
    archive_path: ClassVar[str]
    names: ClassVar[frozenset[str]]

    @property
    def _place(self) -> str:
        return PurePath(os.path.relpath(self, self.archive_path)).as_posix()

    def open(self, mode: str = "r", *_: Any, **text: Any) -> Any:
        if not self.is_file():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        data = self.archive.open(self._place)
        return data if "b" in mode else io.TextIOWrapper(data, **text)

    def read_bytes(self) -> bytes:
        with self.open("rb") as file:
            return bytes(file.read())

    def is_file(self, **_: object) -> bool:
        return self._place in self.names

    def is_dir(self, **_: object) -> bool:
        return any(name.startswith(f"{self._place}/") for name in self.names)

    def exists(self, **_: object) -> bool:
        return self.is_file() or self.is_dir()

    def rglob(self, pattern: str, **_: object) -> Generator[Any, None, None]:
        for name in self.names:
            if name.startswith(f"{self._place}/") and PurePosixPath(name).name == pattern:
                yield type(self)(self.archive_path) / name


def _as_folder(path: Path, archive: zipfile.ZipFile) -> Path:
    """Return an archive as the folder that it would be unpacked into."""

    class Member(_Member):
        pass

    Member.archive, Member.names = archive, frozenset(archive.namelist())
    Member.archive_path = str(path.absolute())
    return Member(Member.archive_path)


def _of_study(folder: Path, index: Index) -> tuple[list[str], tuple[str, ...], int]:
    """Return the faults of protocol, sessions and clips as they were unpacked."""
    problems, notes = [], []
    study = load_protocol(folder / index.protocol, recorded=True)
    notes += study.gone_notes
    if study.sha256 != index.protocol_sha256:
        problems.append(f"{index.protocol} says something else than it did")
    secret = (folder / index.protocol).with_suffix(SECRET_SUFFIX)
    compared = study if secret.exists() or not study.privacy.secret_sha256 else None
    if compared is None:
        notes.append("trials are not compared with the plan: the study's secret is not in it")
    paths = find_journals(folder / SESSIONS)
    for path in paths:
        session = SessionFolder(path.parent, read_journal(path, lenient=True))
        found = verify(session, compared)
        problems += [f"{session.participant}: {problem}" for problem in found.problems]
        notes += [f"{session.participant}: {note}" for note in found.notes]
    if (folder / CLIPS / MANIFEST_NAME).exists():
        frames = {
            f"{CLIPS}/{clip.frame_path(number)}": sha256
            for clip in read_manifest(folder / CLIPS).clips
            for number, sha256 in enumerate(clip.frames_sha256)
        }
        held = {entry.path: entry.sha256 for entry in index.files}
        for name, sha256 in frames.items() if index.clips else ():
            if held.get(name) != sha256:
                problems.append(f"{name} is not the frame that its manifest has")
    return problems, tuple(notes), len(paths)
