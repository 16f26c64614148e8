"""The commands of `metamerlab session` about what was recorded: following, proving, deleting it."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.live import Live
from rich.table import Table

from protocols.errors import StudyError, count_of
from protocols.gone import gone
from protocols.journal import SessionEnd
from protocols.journal_file import JOURNAL_NAME, find_journals, read_journal
from protocols.study_file.schema import StudyProtocol
from study_app.cli.options import (
    SESSIONS_PROTOCOL_HELP,
    DisplayOption,
    SessionArgument,
    SessionsOption,
    recorded_protocol,
)
from study_app.cli.terminal import PlainConsole, say, table_of
from study_app.operator_view import rows
from study_app.recorder import utc_now
from study_app.session_folders import SessionFolder, find_participant
from study_app.session_folders import withdraw as withdraw_participant
from study_app.verification import OTHER_STUDY
from study_app.verification import verify as verify_session

if TYPE_CHECKING:  # what draws is imported when a command does
    from study_app.live.redraw import RedrawResult, Screens, TrialDrawer


def withdraw(
    participant: Annotated[str, typer.Argument(help="The participant's code.")],
    out: SessionsOption = Path("sessions"),
    study: Annotated[
        str | None, typer.Option(help="Needed if the code took part in several studies.")
    ] = None,
    yes: Annotated[bool, typer.Option(help="Do not ask.")] = False,
) -> None:
    """Delete a participant's data for good. One line without data remains, the slot is free.

    Example: metamerlab session withdraw P01 --out sessions
    """
    folder = find_participant(out, participant, study).folder
    if not yes and not typer.confirm(f"Delete everything recorded in {folder}?"):
        raise StudyError(f"{folder}: nothing was deleted")
    count = withdraw_participant(out, participant, utc_now, study)
    gone = count_of(count, "file")
    say(f"{folder}: {gone} deleted; one line stays that says so, and the slot is free")


def watch(
    session: SessionArgument,
    once: Annotated[bool, typer.Option(help="Print once, and stop.")] = False,
) -> None:
    """Follow a running session from another terminal: trials, missed refreshes, gaze quality.

    It only reads the journal, so it cannot disturb the session.

    Example: metamerlab session watch sessions/demo/P01
    """
    path = session / JOURNAL_NAME
    if not path.is_file():
        raise StudyError(f"{session}: must be the folder of one session (found no journal)")
    if once:
        print_rows(rows(read_journal(path, lenient=True).events))
        return
    try:
        with Live(_table(path), refresh_per_second=2) as live:
            while not _over(path):
                time.sleep(0.5)
                live.update(_table(path))
    except KeyboardInterrupt:
        return


@dataclass(frozen=True)
class RedrawOptions:
    """Frames that followed the gaze, to be drawn again."""

    render: bool = False
    """Draw frames that followed the gaze again, and compare them with what was kept. Needs
    --protocol and --stimuli."""
    stimuli: Path | None = None
    """With --render: folder of the study's built stimuli."""
    display: DisplayOption = None
    captured: Path | None = None
    """With --render: folder of captures of the whole screen (.png), of the last run of a session
    with --strip."""


def verify(
    sessions: Annotated[
        Path,
        typer.Argument(help="Folder of one session, of a study's, or of all sessions."),
    ],
    protocol: Annotated[
        Path | None,
        typer.Option(help=SESSIONS_PROTOCOL_HELP + " Compares every trial with the plan."),
    ] = None,
    *,
    again: RedrawOptions,
) -> None:
    """Verify that all records are as they were written: journals, gaze, flips, display reports.

    Compares every line of a journal with its checksum, and every file with its hash in the
    journal. With a protocol, also compares trials, conditions, answers, times and order with the
    plan. Changes nothing. Ends with status 2 if anything differs.

    Examples:

        metamerlab session verify sessions --protocol demo

        metamerlab session verify sessions --protocol live-detection --render --stimuli clips
    """
    if not again.render and again != RedrawOptions():
        raise StudyError("--stimuli, --display and --captured are for --render; add it")
    if sessions.is_file():
        removed = gone("session archive")
        raise StudyError(
            f"{sessions}: must be a folder (it is a file); 'session archive' {removed}"
        )
    study = recorded_protocol(protocol) if protocol else None
    paths = find_journals(sessions)
    if not paths:
        raise StudyError(
            f"{sessions}: must hold at least one session (found no {JOURNAL_NAME} in it)"
        )
    with ExitStack() as open_now:
        drawer, screens = _drawer(again, protocol, open_now)
        if screens and len(paths) > 1:
            raise StudyError("--captured: is of one session; name its folder")
        done = [_verified(path, study, drawer, screens) for path in paths]
    wrong = sum(bool(problems) for problems, _ in done)
    redrawn = [one for _, one in done if one is not None]
    kept = any(one.drawn or one.captures for one in redrawn)
    if again.render and not wrong and not kept and any(one.flips for one in redrawn):
        raise StudyError(
            f"{sessions}: must hold frames to draw again (none was kept: nothing followed the"
            " gaze in a window)"
        )
    if wrong:
        cure = "must be restored from a copy; nothing was changed"
        if all(one.startswith(OTHER_STUDY) for problems, _ in done for one in problems):
            cure = "began with another --protocol; give the file as it was, or leave it out"
        raise StudyError(f"{sessions}: {wrong} of {count_of(len(paths), 'session')} {cure}")


def _drawer(
    asked: RedrawOptions, protocol: Path | None, open_now: ExitStack
) -> tuple[TrialDrawer | None, Screens]:
    """Open what draws frames again, and read the captures, where that is asked for."""
    if not asked.render:
        return None, {}
    from study_app.cli.sessions.drawn_again import open_drawer, read_captures

    if protocol is None or asked.stimuli is None:
        raise StudyError("--render: needs the study and its stimuli; give --protocol and --stimuli")
    drawer = open_now.enter_context(open_drawer(protocol, asked.display, asked.stimuli))
    return drawer, read_captures(asked.captured) if asked.captured is not None else {}


def _verified(
    path: Path, study: StudyProtocol | None, drawer: TrialDrawer | None, screens: Screens
) -> tuple[tuple[str, ...], RedrawResult | None]:
    """Verify a session and say what was found; return what is wrong, and what was drawn."""
    session = SessionFolder(path.absolute().parent, read_journal(path, lenient=True))
    found = verify_session(session, study)
    again = None
    if drawer is not None and not found.problems:
        again = drawer.redraw(session, screens)
        found = replace(found, problems=again.problems)
    lines = len(session.journal.events) + len(session.journal.damaged)
    verdict = "NOT as it was recorded" if found.problems else "whole"
    say(
        f"{session.study}/{session.participant}: {verdict} ({session.state}, {lines} lines,"
        f" {found.files} files)"
    )
    if again is not None:
        say(
            f"  {again.flips} live frames, {again.drawn} drawn again: {again.equal} bit-equal;"
            f" {len(again.captures)} of {count_of(len(screens), 'capture')} compared"
        )
    for problem in found.problems:
        say(f"  {problem}")
    for note in found.notes:
        say(f"  note: {note}")
    return found.problems, again


def print_rows(entries: Iterable[tuple[str, str]]) -> None:
    """Print names and values as a table."""
    PlainConsole().print(table_of((), entries))


def _table(path: Path) -> Table:
    return table_of((), rows(read_journal(path, lenient=True).events))


def _over(path: Path) -> bool:
    events = read_journal(path, lenient=True).events
    return bool(events) and isinstance(events[-1], SessionEnd)
