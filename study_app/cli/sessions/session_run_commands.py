"""The commands of `metamerlab session` that need a display or a participant's data."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from protocols.disk.locks import kept_for_session
from protocols.errors import StudyError, count_of
from protocols.journal import AnyEvent, Attempt
from protocols.journal_file import JOURNAL_NAME, read_journal
from protocols.latency import LatencySummary
from protocols.load import load_display, load_study
from protocols.manifest import read_manifest
from protocols.study_file.schema import StudyProtocol
from study_app.cli.error_messages import EXIT_USER_ERROR
from study_app.cli.options import DisplayOption, ProtocolArgument, SessionsOption
from study_app.cli.sessions import web_commands
from study_app.cli.sessions.record_commands import (
    print_rows,
    verify,
    watch,
    withdraw,
)
from study_app.cli.terminal import PlainConsole, say
from study_app.desktop.strip import FlipMarks
from study_app.operator_view import attempt_line
from study_app.session_folders import SessionFolder, require_decisions, require_no_batch

if TYPE_CHECKING:  # what opens a window is imported when a command runs
    from study_app.conduct import RunOutcome
    from study_app.desktop.display_check import DisplayCheck
    from study_app.desktop.window import Window
    from study_app.gaze.source import CalibrationResult
    from study_app.gaze.validation import PointQuality
    from study_app.session_setup import SessionListener

PacingOption = Annotated[
    bool,
    typer.Option(
        "--software-pacing",
        help="Use a timer instead of the display's vertical synchronisation, for rehearsals "
        "and machines without a display. Recorded in the header.",
    ),
]


@dataclass(frozen=True)
class SessionArguments:
    """Options of a session, begun or resumed."""

    protocol: ProtocolArgument
    stimuli: Path
    """Folder of the study's built clips."""
    participant: str
    """Pseudonymous code, used once: letters, digits, dashes. Never a name."""
    out: SessionsOption = Path("sessions")
    display: DisplayOption = None
    gaze: str | None = None
    """Gaze source: eyelink, lsl:NAME, or mouse; with --simulate also replay:FILE. Needed if the
    protocol watches gaze. docs/trackers.md says what may follow each."""
    strip: bool = False
    """Number and CRC of every flip at the edges, for a camera."""
    photodiode: bool = False
    """A patch at the lower right, white at every other frame."""
    markers: bool = False
    """Send the onset of every phase as LSL markers, which the whole network can read."""
    markers_code: bool = False
    """As --markers, with the participant's code in the stream's source id."""
    software_pacing: PacingOption = False
    skip_validation: bool = False
    """Start blocks without validating gaze. Recorded in the journal."""
    simulate: bool = False
    """An artificial observer answers in the real window."""
    seed: Annotated[int, typer.Option(min=0)] = 0
    """Seed of the artificial observer."""


def run(
    language: Annotated[
        str | None,
        typer.Option(
            help="Language of the texts, such as en. Default: the protocol's default_language."
        ),
    ] = None,
    *,
    session: SessionArguments,
) -> None:
    """Run a session: display check, consent, instructions, practice, blocks, questions, thanks.

    The window covers the display's monitor. The quit key (escape in the shipped studies) asks
    once. Completed trials are saved, and 'session resume' continues. Follow from another
    terminal with 'session watch'. Ends with status 2 if no trial was completed.

    Example: metamerlab session run demo --stimuli clips --participant P01 --gaze lsl
    """
    _run(session, language)


def resume(session: SessionArguments) -> None:
    """Resume a session that was quit or killed: same trials, same order, nothing twice.

    Example: metamerlab session resume demo --stimuli clips --participant P01 --gaze lsl
    """
    _run(session, resuming=True)


def _run(session: SessionArguments, language: str | None = None, *, resuming: bool = False) -> None:
    from study_app.cli.pictures.live_renderer import FoveatingStudio
    from study_app.gaze.open_source import check_choice
    from study_app.run import run_session
    from study_app.session_setup import SessionSetup

    study, screen = load_study(session.protocol, session.display, recorded=resuming)
    _say_gaze(study, session.gaze)
    with kept_for_session(session.stimuli):
        check_choice(study.gaze, session.gaze, simulate=session.simulate)
        setup = SessionSetup(
            study=study,
            display=screen,
            manifest=read_manifest(session.stimuli),
            root=session.out,
            participant=session.participant,
            language=language,
            stimuli=session.stimuli,
            gaze=session.gaze,
            pacing="software" if session.software_pacing else "vsync",
            marks=FlipMarks(session.strip, session.photodiode),
            markers=session.markers,
            markers_code=session.markers_code,
            validate=not session.skip_validation,
            simulated=session.simulate,
            seed=session.seed,
            studio=FoveatingStudio,
        )
        outcome = run_session(setup, _listener(), resuming=resuming)
    _tell(outcome, setup.folder)


def check_display_(
    display: Annotated[str, typer.Argument(help="Display: a name or a .toml file.")],
    out: SessionsOption = Path("sessions"),
    flips: Annotated[int, typer.Option(min=60, help="Flips to measure.")] = 1200,
    software_pacing: PacingOption = False,
) -> None:
    """Measure a display: rate, intervals, missed refreshes, evidence, latency of the program.

    Latency is that of a synthetic gaze to the flip of its frame. Writes a report into the folder
    of sessions. Ends with status 2 if most flips missed a refresh.
    A session measures again before it begins.

    Example: metamerlab session check-display my-display.toml
    """
    from study_app.desktop.display_check import (
        check_display,
        display_findings,
        shortfall,
        write_display_report,
    )
    from study_app.desktop.window import Window
    from study_app.recorder import utc_now

    require_no_batch(out)
    described = load_display(display)
    with Window(described, pacing="software" if software_pacing else "vsync") as window:
        # No progress bar: its thread would disturb what is measured.
        say(f"measuring {flips} flips ({flips / described.refresh_hz:.0f} s) ...")
        check = check_display(window, utc_now, flips)
        check = check.model_copy(update={"gaze_to_flip": _own_latency(window)})
        report = write_display_report(out, check)
    print_rows(display_findings(check, described))
    say(f"report: {out / report.file}")
    if late := shortfall(check):
        raise StudyError(late)


def _own_latency(window: Window) -> LatencySummary:
    from study_app.live.loop import GreySquare, measure_latency
    from study_app.live.screen import WindowScreen

    screen, square = WindowScreen(window, (0, 0), (0.0, 0.0), 1.0), GreySquare(window.ctx)
    try:
        return measure_latency(screen, square)
    finally:
        square.release()
        screen.release()


def register(app: typer.Typer) -> None:
    """Add these commands to the group `session`."""
    app.command()(run)
    app.command()(resume)
    app.command("check-display")(check_display_)
    app.command()(watch)
    app.command()(verify)
    app.command()(withdraw)
    app.command("export-web")(web_commands.export_web)
    app.command("import-web")(web_commands.import_web)


def _listener() -> SessionListener:
    from study_app.desktop.display_check import shortfall
    from study_app.gaze.validation import smallest_window_deg
    from study_app.session_setup import SessionListener

    console = PlainConsole()

    def on_check(check: DisplayCheck) -> None:
        console.print(f"display: {check.measured_hz:.3f} Hz, {check.evidence}")
        if check.evidence == "unverified":
            console.print("note: the intervals do not fit the display; see the report")
        if late := shortfall(check):
            console.print(f"note: {late}")

    def on_validation(points: list[PointQuality], result: CalibrationResult) -> None:
        for point in points:
            console.print(
                f"  ({point.x_px:5.0f}, {point.y_px:5.0f}) px  accuracy"
                f" {point.accuracy_deg:.2f}  precision {point.precision_deg:.2f} deg"
            )
        console.print(
            f"gaze: accuracy {result.accuracy_deg:.2f} deg, precision {result.precision_deg:.2f}"
            f" deg; the window must be at least {smallest_window_deg(result):.2f} deg"
        )

    def on_attempt(attempt: Attempt, events: Sequence[AnyEvent]) -> None:
        console.print(attempt_line(attempt, events))

    return SessionListener(on_check, on_validation, on_attempt, lambda text: say(f"note: {text}"))


def _say_gaze(study: StudyProtocol, gaze: str | None) -> None:
    """Say of a session that no eye is watched in it."""
    if study.gaze.mode == "none":
        say("note: gaze is not controlled (gaze.mode = 'none' in the study)")
    elif (gaze or "").partition(":")[0] == "mouse":
        say("note: the mouse stands in for an eye; for rehearsals, not for data")


def _tell(outcome: RunOutcome, folder: Path) -> None:
    if outcome.reason == "completed" and not outcome.main_done:
        require_decisions(
            [SessionFolder(folder, read_journal(folder / JOURNAL_NAME, lenient=True))]
        )
    planned = count_of(outcome.main_planned, "decision")
    say(f"{folder}: {outcome.reason}, {outcome.main_done} of {planned}")
    if outcome.given_up:
        say(f"note: given up after too many void attempts: {', '.join(outcome.given_up)}")
    if outcome.reason == "tracker-lost":
        say(
            "error: the gaze source must keep sending (it fell silent); everything up to here is"
            " saved. Start it again, then run 'metamerlab session resume'",
            file=sys.stderr,
        )
        raise typer.Exit(EXIT_USER_ERROR)
