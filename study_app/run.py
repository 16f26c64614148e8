"""Runs a session before a real display: window, display check, gaze, conductor, and the end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace

from pipeline.gl.context import describe
from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.journal_file import JOURNAL_NAME, read_journal
from protocols.make_script import example_scripts
from protocols.manifest import check_manifest
from protocols.plan import Plan, PlannedTrial
from protocols.study_file.schema import StudyProtocol
from study_app.clips import check_files
from study_app.conduct import RunOutcome, conduct
from study_app.desktop.display_check import (
    REHEARSAL_FLIPS,
    SESSION_FLIPS,
    check_display,
    shortfall,
    write_display_report,
)
from study_app.desktop.window import Window
from study_app.gaze.gaze_check import GazeCheck, Targets
from study_app.gaze.lsl import LslMarkers
from study_app.gaze.open_source import open_gaze
from study_app.gaze.simulated import HUMAN, SimulatedGaze
from study_app.gaze.source import GazeSource, TrackerContext
from study_app.live.in_trials import too_dear
from study_app.observers import rng_of
from study_app.opening import begin, resume
from study_app.presenter import Presenter
from study_app.recorder import Recorder
from study_app.session_folders import require_unused
from study_app.session_setup import SessionListener, SessionSetup
from study_app.shown_texts import require_showable

if sys.platform == "win32":
    _TERMINAL_CLOSED = signal.SIGBREAK
else:
    _TERMINAL_CLOSED = signal.SIGHUP


def run_session(
    setup: SessionSetup, listener: SessionListener | None = None, *, resuming: bool = False
) -> RunOutcome:
    """Run a participant's session to its end, or until it is stopped.

    Parameters
    ----------
    setup : SessionSetup
        Whose clips are kept from builds meanwhile (`kept_for_session`).
    resuming : bool
        Go on with a session that stopped: same plan, same order.

    Raises
    ------
    StudyError
        As `begin`, or `resume`, `Window`, `check_display`, `ClipStore` and `conduct` say.
    """
    setup, listener = _fit_to_open(setup, resuming=resuming), listener or SessionListener()
    if setup.markers or setup.markers_code:  # early, so that recorders find it before a trial
        code = setup.participant if setup.markers_code else ""
        listener = replace(listener, on_mark=LslMarkers(code))
    with ExitStack() as stack:
        opened = _OpenSession(setup, listener, stack)
        recorder, plan = opened.begin(resuming=resuming)
        gaze_check = opened.gaze_check(recorder)
        with recorder, _signals_quit(opened.window, setup.study):
            return conduct(
                opened.setup, plan, recorder, opened.presenter, opened.gaze, listener, gaze_check
            )


def _fit_to_open(setup: SessionSetup, *, resuming: bool) -> SessionSetup:
    """Return a setup in its language, of which no part can be refused without a window."""
    study, display, manifest = setup.study, setup.display, setup.manifest
    check_manifest(study, manifest)
    folder = setup.folder
    if resuming:
        journal = read_journal(folder / JOURNAL_NAME, lenient=True)
        setup = replace(setup, language=journal.start.language)
    else:
        require_unused(folder)
    _ = setup.texts  # refused in a language that is missing
    require_showable(study, display, manifest, setup.spoken)
    check_files(setup.stimuli, manifest)
    setup.marks.check(example_scripts(study, display)[0])
    if (setup.gaze or "").startswith("replay") and not setup.simulated:
        raise StudyError("--gaze: a recording is no participant: replay needs --simulate")
    return setup


class _OpenSession:
    """Window, presenter and gaze source of a session: open until `stack` is closed.

    Attributes
    ----------
    setup : SessionSetup
        As it was given, with what was measured of the display.
    """

    def __init__(self, setup: SessionSetup, listener: SessionListener, stack: ExitStack) -> None:
        study = setup.study
        window = stack.enter_context(Window(setup.display, pacing=setup.pacing))
        flips = SESSION_FLIPS if setup.pacing == "vsync" else REHEARSAL_FLIPS
        check = check_display(window, setup.wall_clock, flips)
        late = shortfall(check)
        if late and check.intervals.missed > study.trial.dropped_frames_max:
            raise StudyError(late)
        listener.on_check(check)
        self.window, self._listener, self._targets = window, listener, Targets()
        self.gaze = _gaze(setup, window, check.measured_hz, self._targets)
        if self.gaze is not None:
            stack.callback(self.gaze.close)
        self.presenter = stack.enter_context(
            Presenter(window, setup, check.measured_hz, _restart(setup, self.gaze))
        )
        self._targets.show = self.presenter.look_at
        drawn_by = describe(window.ctx)
        follows = study.stimuli.follows_gaze
        self._notes = [require_live(self.presenter, setup, drawn_by.name)] if follows else []
        if over := window.lies_under():
            self._notes.append(
                f"over the window before the session began, and not held against it: {over}"
            )
        if window.unnoticed:
            self._notes.append(window.unnoticed)
        self.setup = replace(
            setup,
            display_report=write_display_report(setup.root, check),
            timing_evidence=check.evidence,
            drawn_by={"renderer": drawn_by.name, "opengl": drawn_by.version},
        )

    def begin(self, *, resuming: bool) -> tuple[Recorder, Plan]:
        """Begin the journal, or go on with it, and note what was found while opening."""
        opens = resume if resuming else begin
        recorder, plan = opens(self.setup, self.presenter, self.gaze)
        for note in (*self._notes, *(() if self.gaze is None else self.gaze.info().notes)):
            self._listener.on_note(note)
            recorder.note(note)
        return recorder, plan

    def gaze_check(self, recorder: Recorder) -> GazeCheck | None:
        """Return the validation of the gaze source; None, and a note, where there is none."""
        if self.gaze is None:
            return None
        if not self.setup.validate:
            recorder.note("gaze was not validated")
            return None
        return GazeCheck(
            self.gaze, self.setup, self.presenter, recorder, self._targets, self._listener
        )


def require_live(presenter: Presenter, setup: SessionSetup, renderer: str) -> str:
    """Refuse live pictures where a refresh is too short for them, but in rehearsals.

    Returns
    -------
    str
        What was measured.
    """
    taken_s, method = presenter.dearest_live_s()
    error = too_dear(setup.display, taken_s, method, renderer)
    if error is not None and setup.pacing == "vsync":
        raise error
    said = f"live frames: the dearest, of {method}, took {1000 * taken_s:.1f} ms"
    return said if error is None else f"{said}: too long for a refresh, but this is a rehearsal"


def _gaze(
    setup: SessionSetup, window: Window, refresh_hz: float, targets: Targets
) -> GazeSource | None:
    study, display = setup.study, setup.display
    if study.gaze.mode == "none":
        return None
    if setup.gaze is None:
        dot = (study.trial.fixation_x_deg, study.trial.fixation_y_deg)
        return SimulatedGaze(window.now, Viewing.of(display), dot, behaviour=HUMAN)
    if setup.gaze.startswith("mouse"):
        window.show_cursor(True, stays=True)
    return open_gaze(
        setup.gaze,
        TrackerContext(
            display,
            window.now,
            window.cursor_px,
            refresh_hz,
            targets,
            store=study.privacy.store_gaze,
        ),
    )


def _restart(setup: SessionSetup, gaze: GazeSource | None) -> Callable[[PlannedTrial, int], None]:
    """Return the action before each attempt: an artificial eye begins anew."""

    def restart(trial: PlannedTrial, attempt: int) -> None:
        if isinstance(gaze, SimulatedGaze):
            rng = rng_of(setup.seed, "attempt", setup.participant, trial.id, attempt)
            gaze.restart(int(rng.integers(2**63)))

    return restart


@contextmanager
def _signals_quit(window: Window, study: StudyProtocol) -> Iterator[None]:
    """Let Ctrl-C in the terminal, or a polite kill, press the quit key; a second one stops hard."""
    asked: list[int] = []

    def on_signal(number: int, _frame: object) -> None:
        asked.append(number)
        if len(asked) > 1:
            raise KeyboardInterrupt
        window.press(study.response.quit_keys[0])
        with suppress(OSError, ValueError):  # the terminal may be gone
            print(
                "asked the participant's window to quit; press again to stop at once",
                file=sys.stderr,
            )

    with ExitStack() as before:
        with suppress(ValueError):  # not the main thread: signals are someone else's
            for number in (signal.SIGINT, signal.SIGTERM, _TERMINAL_CLOSED):
                before.callback(signal.signal, number, signal.signal(number, on_signal))
        yield
