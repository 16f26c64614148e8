"""Deletes a participant's data; a stone stays in its place, and the slot becomes free."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from protocols.disk.locks import lock_name
from protocols.disk.whole_file import remove, write_whole
from protocols.errors import StudyError
from protocols.journal import SessionStart, Withdrawal
from protocols.journal_file import JOURNAL_NAME, first_link, sealed
from study_app.recorder import journal_held
from study_app.session_folders import SessionFolder, claimed, find_sessions


def find_participant(root: Path, code: str, study: str | None = None) -> SessionFolder:
    """Return the one session of a participant.

    Raises
    ------
    StudyError
        If there is none, or one in each of several studies and `study` is not given.
    """
    found = [session for session in find_sessions(root, study) if session.participant == code]
    if not found:
        raise StudyError(
            f"{root}: must hold a session of participant {code!r} (found none);"
            " 'metamerlab session list' names them"
        )
    if len(found) > 1:
        names = ", ".join(session.study for session in found)
        raise StudyError(f"participant {code!r} took part in {names}; say which with --study")
    return found[0]


def withdraw(root: Path, code: str, wall_clock: Callable[[], str], study: str | None = None) -> int:
    """Delete everything recorded of a participant but a stone: study, slot and time.

    Killed half-way, it is gone on with by calling it again.

    Returns
    -------
    int
        How many files were deleted.

    Raises
    ------
    StudyError
        If there is no such participant, the session is open in another program, the journal's
        first line is damaged (its slot is not known), or the disk refuses.
    """
    with claimed(root):
        session = find_participant(root, code, study)
        path = session.folder / JOURNAL_NAME
        files = sum(entry.is_file() for entry in session.folder.rglob("*"))
        if session.state == "withdrawn":
            if files == 1:
                raise StudyError(f"{session.folder}: participant {code!r} withdrew before")
            slot = None
        else:
            slot = _slot(session)
        try:
            with journal_held(path):
                if slot is not None:
                    _put_stone(session, slot, wall_clock())
                for entry in sorted(session.folder.iterdir()):
                    if entry.name in (JOURNAL_NAME, lock_name(JOURNAL_NAME)):
                        continue
                    if entry.is_dir() and not entry.is_symlink():
                        shutil.rmtree(entry)
                    else:
                        remove(entry)
        except OSError as error:
            raise StudyError(
                f"{session.folder}: the disk refused ({error.strerror}); withdraw again"
            ) from None
    return files - (slot is None)


def _slot(session: SessionFolder) -> int:
    first = session.journal.events[0] if session.journal.events else None
    if not isinstance(first, SessionStart):
        raise StudyError(
            f"{session.folder / JOURNAL_NAME}: the first line must be whole, it names the slot"
            " that becomes free; restore it from a copy, or delete the folder by hand"
        )
    return first.slot


def _put_stone(session: SessionFolder, slot: int, at: str) -> None:
    """Replace the journal in one step."""
    path = session.folder / JOURNAL_NAME
    stone = Withdrawal(n=0, t_s=0.0, at=at, study=session.study, slot=slot)
    write_whole(path, sealed(stone, first_link(b""))[1])
