"""Writes an archive: under a temporary name, read back, and only then there; never over a file."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from protocols.disk.hashing import sha256_bytes
from protocols.disk.locks import clear_files
from protocols.disk.whole_file import move, read_bytes, remove
from protocols.errors import StudyError
from protocols.journal import SessionResume, SessionStart
from protocols.load import SECRET_SUFFIX, load_protocol, shipped
from protocols.manifest import MANIFEST_NAME, check_manifest, read_manifest
from protocols.revision import code_revision, package_version
from protocols.study_file.schema import StudyProtocol
from study_app.archive.read_archive import (
    CLIPS,
    INDEX_NAME,
    SESSIONS,
    STUDY,
    ArchivedFile,
    ArchiveFindings,
    Index,
    check_archive,
)
from study_app.session_folders import find_sessions

Progress = Callable[[str, int, int], None]
_MOMENT = (1980, 1, 1, 0, 0, 0)  # equal studies, equal bytes
_PACKED_ALREADY = {".png", ".gz", ".webm"}


@dataclass(frozen=True)
class ArchiveOptions:
    """Content that an archive is to hold beside the study's file."""

    sessions: Path = Path("sessions")
    """Folder of sessions."""
    stimuli: Path | None = None
    """Folder of the built clips. Their manifest is included."""
    with_clips: bool = False
    """Include the frames."""
    with_secret: bool = False
    """Include the study's secret."""
    as_it_is: bool = False
    """Also archive what is not as it was recorded."""


def write_archive(
    source: Path,
    wanted: ArchiveOptions,
    out: Path,
    progress: Progress = lambda _what, _done, _all: None,
) -> tuple[Index, ArchiveFindings]:
    """Write a study into one file that did not exist before.

    Returns
    -------
    Index
        What it holds.
    Findings
        What reading it back found.

    Raises
    ------
    StudyError
        If `out` exists, something cannot be read or is a link, a session or a frame is not as it
        was recorded (unless `as_it_is`), or the disk refuses. Nothing is left behind then.
    """
    if out.exists() or out.is_symlink():
        raise StudyError(f"{out}: must not exist yet; an archive is never written over a file")
    path = source if source.exists() else shipped("studies").get(str(source), source)
    study = load_protocol(path, recorded=True)
    members = list(_members(wanted, path, study))
    with _appearing(out) as file:
        entries = _pack(file, members, progress)
        index = Index(
            format=1,
            study=study.study.name,
            protocol=f"{STUDY}/{path.name}",
            protocol_sha256=study.sha256,
            revision=f"{package_version()} {code_revision()}",
            secret=any(entry.path.endswith(SECRET_SUFFIX) for entry in entries),
            clips=wanted.with_clips,
            files=entries,
        )
        with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(zipfile.ZipInfo(INDEX_NAME, _MOMENT), index.to_bytes())
        file.seek(0)
        found = check_archive(out, file)
        if found.problems and not wanted.as_it_is:
            told = "; ".join(found.problems[:3]) + ("; ..." if found.problems[3:] else "")
            raise StudyError(
                f"{out}: what is archived must be as it was recorded ({told}); restore it from a"
                " copy, or archive it as it is with --as-it-is. Nothing was written"
            )
    return index, found


def _members(
    wanted: ArchiveOptions, path: Path, study: StudyProtocol
) -> Iterator[tuple[str, Path]]:
    """Yield each file's place in the archive, and the file."""
    yield f"{STUDY}/{path.name}", path
    secret = path.with_suffix(SECRET_SUFFIX)
    if study.privacy.secret_sha256 and secret.exists() and wanted.with_secret:
        yield f"{STUDY}/{secret.name}", secret
    for name in (study.display.display, getattr(study.stimuli, "table", None)):
        if name is None:
            continue
        place, known = PurePosixPath(name), shipped("displays")
        if name in known:
            yield f"{STUDY}/displays/{name}.toml", known[name]
        elif place.is_absolute() or ".." in place.parts:
            raise StudyError(
                f"{path}: {name} must lie in the study's folder to be archived with it; copy it"
                " there"
            )
        else:
            yield f"{STUDY}/{place}", path.parent / place
    yield from _sessions(wanted.sessions, study.study.name)
    if wanted.stimuli is not None:
        manifest = read_manifest(wanted.stimuli)
        check_manifest(study, manifest)
        yield f"{CLIPS}/{MANIFEST_NAME}", wanted.stimuli / MANIFEST_NAME
        for clip in manifest.clips if wanted.with_clips else ():
            for number in range(len(clip.frames_sha256)):
                frame = clip.frame_path(number)
                yield f"{CLIPS}/{frame}", wanted.stimuli / frame


def _sessions(root: Path, study: str) -> Iterator[tuple[str, Path]]:
    sessions = find_sessions(root, study)
    if not sessions:
        raise StudyError(f"{root}: must hold sessions of {study} (found none); name --sessions")
    reports = set()
    for session in sessions:
        for path in sorted(session.folder.rglob("*")):
            if path.is_symlink() or not path.is_dir():
                yield f"{SESSIONS}/{path.relative_to(root).as_posix()}", path
        for event in session.journal.events:
            if isinstance(event, SessionStart | SessionResume) and event.display_report:
                reports.add(event.display_report.file)
    for report in sorted(reports):
        place = PurePosixPath(report)
        if not place.is_absolute() and ".." not in place.parts and (root / place).is_file():
            yield f"{SESSIONS}/{place}", root / place


def _pack(
    file: IO[bytes], members: Sequence[tuple[str, Path]], progress: Progress
) -> tuple[ArchivedFile, ...]:
    entries = []
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for done, (name, path) in enumerate(sorted(members), start=1):
            if path.is_symlink():
                raise StudyError(f"{path}: must be a file of its own (it is a symbolic link)")
            data = read_bytes(path, "a file of the study", "unpacked")
            packing = zipfile.ZIP_STORED if path.suffix in _PACKED_ALREADY else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(name, _MOMENT), data, packing)
            entries.append(ArchivedFile(path=name, bytes=len(data), sha256=sha256_bytes(data)))
            progress("archiving", done, len(members))
    return tuple(entries)


@contextmanager
def _appearing(out: Path) -> Iterator[IO[bytes]]:
    """Yield a file beside `out` that takes its name once it is whole and on the disk."""
    clear_files(out)
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        with part.open("x+b") as file:
            part.chmod(0o600)  # it may hold a secret
            yield file
            file.flush()
            os.fsync(file.fileno())
        _name(part, out)
    except OSError as error:
        raise StudyError(f"{out}: the disk refused ({error.strerror}); choose another") from None
    finally:
        remove(part)


def _name(part: Path, out: Path) -> None:
    """Give a file its name, never in another's place."""
    try:
        os.link(part, out)
    except FileExistsError:
        raise StudyError(f"{out}: must not exist yet; another program wrote it") from None
    except OSError:  # no hard links on this disk
        if out.exists():
            raise StudyError(f"{out}: must not exist yet; another program wrote it") from None
        move(part, out)
