"""The command of `metamerlab session` for copies of a whole study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from protocols.errors import StudyError, count_of
from study_app.archive.read_archive import INDEX_NAME, ArchiveFindings, check, check_folder, opened
from study_app.archive.write_archive import ArchiveOptions, write_archive
from study_app.cli.options import ProtocolArgument
from study_app.cli.progress import one_line
from study_app.cli.terminal import say


def archive(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="File to write. It appears only when complete.")],
    sessions: Annotated[Path, typer.Option(help="Folder of sessions.")] = Path("sessions"),
    stimuli: Annotated[
        Path | None, typer.Option(help="Folder of the built clips. Their manifest is included.")
    ] = None,
    with_clips: Annotated[bool, typer.Option(help="Include the frames.")] = False,
    *,
    with_secret: Annotated[bool, typer.Option(help="Include the study's secret.")] = False,
    as_it_is: Annotated[
        bool, typer.Option(help="Also archive what is not as it was recorded.")
    ] = False,
) -> None:
    """Write a verified copy of a study into one file: study, sessions, manifest, optional clips.

    The file is a zip archive, which any program unpacks. It holds the study's secret only with
    --with-secret. It is read back before it gets its name, and never replaces a file. The study is
    not changed.

    Examples:

        metamerlab session archive study.toml --stimuli clips --out backup.zip

        metamerlab session archive study.toml --with-secret --out backup.zip
    """
    if with_clips and stimuli is None:
        raise StudyError("--with-clips: needs the folder of clips; name it with --stimuli")
    wanted = ArchiveOptions(
        protocol,
        sessions,
        clips=stimuli,
        frames=with_clips,
        secret=with_secret,
        as_it_is=as_it_is,
    )
    with one_line() as progress:
        index, found = write_archive(wanted, out, progress)
    _tell(out, found)
    if not index.secret and found.notes:
        say("note: keep the study's secret elsewhere, or archive it with --with-secret")


def verify_archive(path: Path) -> None:
    """Prove an archive whole, as a file or as the folder it was unpacked into; say what was found.

    Raises
    ------
    StudyError
        If it is not.
    """
    if path.is_dir():
        found = check_folder(path)
    else:
        with opened(path) as file:
            found = check(path, file)
    _tell(path, found)
    if found.problems:
        raise StudyError(
            f"{path}: must be as it was archived ({len(found.problems)} differences); take another"
            " copy; nothing was changed"
        )


def is_archive(path: Path) -> bool:
    """Return True if a path is a file, or a folder that one was unpacked into."""
    return path.is_file() or (path / INDEX_NAME).is_file()


def register(app: typer.Typer) -> None:
    """Add this command to the group `session`."""
    app.command()(archive)


def _tell(path: Path, found: ArchiveFindings) -> None:
    index = found.index
    verdict = "NOT as it was recorded" if found.problems else "whole"
    holds = [count_of(found.sessions, "session"), count_of(len(index.files), "file")]
    holds.append("clips" if index.clips else "no clips")
    holds.append("the study's secret" if index.secret else "no secret")
    say(f"{path}: {verdict} ({index.study}: {', '.join(holds)})")
    for problem in found.problems:
        say(f"  {problem}")
    for note in found.notes:
        say(f"  note: {note}")
    say(f"list of files: SHA-256 {index.sha256}; note it elsewhere to detect any later change")
