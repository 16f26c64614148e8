"""The folder of all sessions: ``ROOT/STUDY/PARTICIPANT/journal.jsonl``.

Gives each new participant the next free counterbalancing slot, refuses a code that was used, and
deletes the data of who withdraws: a stone stays in their place, and the slot becomes free.
"""

from __future__ import annotations

import glob
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from protocols.disk.locks import lock, lock_name
from protocols.disk.whole_file import read_bytes, remove, write_whole
from protocols.errors import StudyError
from protocols.journal import SessionEnd, SessionStart, VoidReason, Withdrawal
from protocols.journal_file import (
    JOURNAL_NAME,
    Journal,
    first_link,
    header_of,
    read_journal,
    sealed,
)
from protocols.manifest import MANIFEST_NAME, read_manifest
from protocols.study_file.schema import StudyProtocol
from protocols.units import DEVICE, ParticipantCode, form_of
from study_app.recorder import journal_held


@dataclass(frozen=True)
class SessionFolder:
    """One participant's folder as it stands."""

    folder: Path
    journal: Journal

    @property
    def participant(self) -> str:
        """The participant's code."""
        return self.folder.name

    @property
    def study(self) -> str:
        """The study's name."""
        return self.folder.parent.name

    @property
    def state(self) -> str:
        """`completed`, `withdrawn`, `refused`, `stopped` (can be resumed), `damaged`, or
        `stillborn`: killed before its first line was whole."""
        if not self.journal.has_lines:
            return "stillborn"
        if self.journal.damaged:
            return "damaged"
        if self.journal.withdrawn:
            return "withdrawn"
        last = self.journal.events[-1]
        if isinstance(last, SessionEnd) and last.reason == "completed":
            return "completed"
        if isinstance(last, SessionEnd) and last.reason == "consent-refused":
            return "refused"
        return "stopped"

    @property
    def main_done(self) -> int:
        """Main trials decided."""
        return sum(attempt.decides for attempt in self.journal.attempts)


def find_sessions(root: Path, study: str | None = None) -> list[SessionFolder]:
    """Return every session below `root`, damaged ones included.

    Raises
    ------
    StudyError
        If `root` is no folder.
    """
    if not root.is_dir():
        raise StudyError(
            f"{root}: must be a folder of sessions (there is no such folder); check the path"
        )
    return [
        SessionFolder(path.parent, read_journal(path, lenient=True))
        for path in _journals(root, study)
    ]


def _journals(root: Path, study: str | None) -> list[Path]:
    return sorted(root.glob(f"{glob.escape(study) if study else '*'}/*/{JOURNAL_NAME}"))


def session_folder(root: Path, study: StudyProtocol, participant: str) -> Path:
    """Return the folder of a participant's journal.

    Raises
    ------
    StudyError
        If the code is not one, or does not match the protocol's pattern.
    """
    try:
        TypeAdapter(ParticipantCode).validate_python(participant)
    except ValidationError:
        raise StudyError(
            "participant: a code must be letters, digits, single dashes and underscores, at most"
            f" 32 (got {participant!r}); use a pseudonym, never a name"
        ) from None
    if not study.privacy.accepts(participant):
        raise StudyError(
            f"participant: a code must be {form_of(study.privacy.code_pattern)} (got"
            f" {participant!r}); the study's privacy.code_pattern says so"
        )
    return root / study.study.name / participant


def require_portable(folder: Path) -> None:
    """Refuse a session's folder that Windows or macOS could not hold beside the others.

    Raises
    ------
    StudyError
        If study or code is a name of a device on Windows, or another code differs by case alone.
    """
    for what, name in (("study.name", folder.parent.name), ("participant", folder.name)):
        if DEVICE.fullmatch(name):
            raise StudyError(
                f"{what}: must not be a name that Windows keeps for a device (got {name!r}), as a"
                " folder is called so; choose another"
            )
    others = folder.parent.iterdir() if folder.parent.is_dir() else ()
    same = [one.name for one in others if one.name.casefold() == folder.name.casefold()]
    if same and folder.name not in same:
        raise StudyError(
            f"participant: a code must differ by more than case from {same[0]!r}, which was used"
            f" (got {folder.name!r}): Windows and macOS have one folder for both; choose another"
        )


def require_unused(folder: Path) -> None:
    """Refuse a participant's folder that holds a session, or lies in a batch of clips.

    Raises
    ------
    StudyError
        If it does.
    """
    require_no_batch(folder)
    if folder.exists() and not is_stillborn(folder):
        raise StudyError(
            f"participant: a code is used once (got {folder.name!r}, which has"
            f" {folder}); choose another code, or continue with 'metamerlab session resume'"
        )


def require_no_batch(folder: Path) -> None:
    """Refuse a folder for sessions that is a batch of clips, or lies in one.

    Raises
    ------
    StudyError
        Naming the batch: it would be no batch any more, and its next build would be refused.
    """
    place = folder.resolve()
    for above in (place, *place.parents):
        if (above / MANIFEST_NAME).is_file() and _is_batch(above):
            raise StudyError(
                f"{folder}: must not lie in a batch of clips (this is one: {above}); name another"
                " folder for sessions"
            )


def _is_batch(folder: Path) -> bool:
    try:
        return bool(read_manifest(folder))
    except StudyError:  # another program's
        return False


def is_stillborn(folder: Path) -> bool:
    """Return True if a session was killed before its first line was whole.

    Nothing was recorded then, and the code is still free.
    """
    path = folder / JOURNAL_NAME
    if path.exists():
        return not read_journal(path, lenient=True).has_lines
    return folder.is_dir() and not any(folder.iterdir())


def next_slot(root: Path, study: str) -> int:
    """Return the smallest counterbalancing slot that no session of the study holds.

    The slots of participants who withdrew, or did not consent, are free again. Call it inside
    `claimed`, so that two programs cannot take the same one.

    A session whose first line is damaged holds a slot that is not known: most likely the first
    that seems free, so one is passed over for each.
    """
    taken, unknown = set(), 0
    for path in _journals(root, study):
        with suppress(StudyError):
            data = read_bytes(path, "the journal")
            start = header_of(data)
            if start is not None and b'"consent-refused"' not in data:
                taken.add(start.slot)  # the usual: hundreds of journals are not read to their ends
                continue
        session = SessionFolder(path.parent, read_journal(path, lenient=True))
        if session.state in {"withdrawn", "refused", "stillborn"}:
            continue
        first = session.journal.events[0] if session.journal.events else None
        if isinstance(first, SessionStart):
            taken.add(first.slot)
        else:
            unknown += 1
    free = (slot for slot in range(len(taken) + unknown + 1) if slot not in taken)
    return next(islice(free, unknown, None))


@contextmanager
def claimed(root: Path) -> Iterator[None]:
    """Hold the folder of sessions for the moment in which a slot is given away.

    Raises
    ------
    StudyError
        If the folder cannot be written.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(root / ".lock", os.O_CREAT | os.O_RDWR, 0o644)
    except OSError as error:
        raise StudyError(f"{root}: must be a writable folder ({error.strerror})") from None
    try:
        lock(descriptor, waits=True)
        yield
    finally:
        os.close(descriptor)


# Of every reason that can use up `max_attempts` (`study_app.session.NOT_THE_PARTICIPANTS` cannot).
_CURES: dict[VoidReason, str] = {
    "dropped-frames": "measure the display with 'metamerlab session check-display', close what else"
    " runs on this machine, or tolerate more in trial.dropped_frames_max",
    "too-late": "let the participant practise the keys, or give more time in response.timeout_s",
    "no-fixation": "calibrate the tracker again and read the validation, or give more time in"
    " trial.fixation_timeout_s",
    "gaze-break": "calibrate the tracker again and read the validation, or widen gaze.window_deg",
    "data-loss": "see that the tracker keeps the eye in view, or tolerate more in"
    " gaze.loss_max_share",
}
_NAMED = 5


def require_decisions(sessions: Iterable[SessionFolder]) -> None:
    """Refuse to call sessions a success that are complete and hold no decision.

    Raises
    ------
    StudyError
        With how often each reason made an attempt void, and the cure of the most frequent one.
    """
    empty = [each for each in sessions if each.state == "completed" and each.main_done == 0]
    if not empty:
        return
    voids = Counter(
        attempt.void_reason
        for session in empty
        for attempt in session.journal.attempts
        if attempt.void_reason and attempt.role == "main"
    )
    counts = ", ".join(f"{count} {reason}" for reason, count in voids.most_common())
    worst = max(_CURES, key=lambda reason: voids[reason])
    codes = ", ".join(session.participant for session in empty[:_NAMED])
    more = f" and {len(empty) - _NAMED} more" if len(empty) > _NAMED else ""
    raise StudyError(
        f"{empty[0].folder.parent}: a session must end with decisions (recorded: none of"
        f" {empty[0].journal.start.trials} by {codes}{more}; void attempts: {counts});"
        f" {_CURES[worst]}. Everything is kept as it was recorded, and the session is over: begin"
        " again with another participant code, or with another --out"
    )


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
