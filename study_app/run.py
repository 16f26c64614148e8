"""Runs a session before a real display: window, display check, gaze, conductor, and the end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, TypeAlias

import moderngl

from pipeline.gl.context import describe
from protocols.disk.locks import kept_for_session
from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import AnyEvent, Attempt, Note
from protocols.journal_file import JOURNAL_NAME, read_journal
from protocols.manifest import check_manifest, read_manifest
from protocols.plan import PlannedTrial
from protocols.script import example_scripts
from protocols.study_file.schema import StudyProtocol
from protocols.viewing import Viewing
from study_app.clips import check_files
from study_app.conduct import RunOutcome, RunSettings, conduct
from study_app.desktop.display_check import (
    REHEARSAL_FLIPS,
    SESSION_FLIPS,
    DisplayCheck,
    check_display,
    shortfall,
    write_report,
)
from study_app.desktop.strip import FlipMarks
from study_app.desktop.window import Pacing, Window
from study_app.gaze.gaze_check import Targets, TrackerCalibration
from study_app.gaze.lsl import LslMarkers
from study_app.gaze.open_source import check_choice, open_gaze
from study_app.gaze.simulated import HUMAN, SimulatedGaze
from study_app.gaze.source import CalibrationResult, GazeSource, TrackerContext
from study_app.gaze.validation import PointQuality, summarise, unfit_gaze, validate
from study_app.live.in_trials import too_dear
from study_app.live.renderer import Studio
from study_app.observers import ArtificialObserver, default_model, rng_of
from study_app.opening import Setting, begin, resume, texts_of
from study_app.presenter import Presenter, PresenterSettings
from study_app.recorder import utc_now
from study_app.session_folders import require_unused, session_folder
from study_app.shown_texts import require_showable

RecordedEvents = list[AnyEvent]
if sys.platform == "win32":
    _TERMINAL_CLOSED = signal.SIGBREAK
else:
    _TERMINAL_CLOSED = signal.SIGHUP
Handler: TypeAlias = Callable[[int, FrameType | None], Any] | int | None


@dataclass(frozen=True)
class SessionOptions:
    """Everything `session run` and `session resume` are asked for."""

    protocol: StudyProtocol
    display: Display
    stimuli: Path
    root: Path
    participant: str
    language: str | None = None
    gaze: str | None = None
    """``lsl:NAME``, ``mouse``, ``replay:FILE``; None: no source."""
    pacing: Pacing = "vsync"
    extras: FlipMarks = field(default_factory=FlipMarks)
    markers: bool = False
    validate: bool = True
    """Validate the gaze source before each block; left out, the journal says so."""
    simulate: bool = False
    seed: int = 0
    studio: Callable[[moderngl.Context], Studio] | None = None
    """Makes what draws stimuli that follow the gaze."""


@dataclass(frozen=True)
class Listener:
    """Told how a session goes."""

    on_check: Callable[[DisplayCheck], None] = lambda _: None
    on_validation: Callable[[list[PointQuality], CalibrationResult], None] = lambda _p, _r: None
    on_attempt: Callable[[Attempt, RecordedEvents], None] = lambda _a, _e: None
    on_note: Callable[[str], None] = lambda _: None


def run_session(options: SessionOptions, listener: Listener | None = None) -> RunOutcome:
    """Begin a participant's session and run it to its end, or until it is stopped.

    Raises
    ------
    StudyError
        As `kept_for_session`, `begin`, `Window`, `check_display`, `ClipStore` and `conduct` say.
    """
    with kept_for_session(options.stimuli):
        return _run_session(options, listener or Listener(), resuming=False)


def resume_session(options: SessionOptions, listener: Listener | None = None) -> RunOutcome:
    """Go on with a session that stopped: same plan, same order.

    Raises
    ------
    StudyError
        As `run_session`, and as `resume` says.
    """
    with kept_for_session(options.stimuli):
        return _run_session(options, listener or Listener(), resuming=True)


def _run_session(options: SessionOptions, listener: Listener, *, resuming: bool) -> RunOutcome:
    protocol, display = options.protocol, options.display
    # All that can be refused without a window is refused before one covers the screen.
    check_choice(protocol.gaze, options.gaze, simulate=options.simulate)
    manifest = read_manifest(options.stimuli)
    check_manifest(protocol, manifest)
    language = _language(options, resuming=resuming)
    texts = texts_of(protocol, language)
    require_showable(protocol, display, manifest, language)
    check_files(options.stimuli, manifest)
    options.extras.check(example_scripts(protocol, display)[0])
    if (options.gaze or "").startswith("replay") and not options.simulate:
        raise StudyError("--gaze: a recording is no participant: replay needs --simulate")
    # Early, so that recorders find the stream before the first trial.
    mark = LslMarkers(options.participant) if options.markers else lambda _text, _t_s: None
    with ExitStack() as stack:
        window = stack.enter_context(Window(display, pacing=options.pacing))
        flips = SESSION_FLIPS if options.pacing == "vsync" else REHEARSAL_FLIPS
        check = check_display(window, utc_now, flips)
        late = shortfall(check)
        if late and check.intervals.missed > protocol.trial.dropped_frames_max:
            raise StudyError(late)
        listener.on_check(check)
        targets = Targets()
        gaze = _gaze(options, window, check.measured_hz, targets)
        if gaze is not None:
            stack.callback(gaze.close)
        follows = protocol.stimuli.follows_gaze
        studio = options.studio(window.ctx) if options.studio is not None and follows else None
        presenter = stack.enter_context(
            Presenter(
                window,
                protocol,
                texts,
                manifest,
                options.stimuli,
                PresenterSettings(
                    check.measured_hz,
                    options.extras,
                    _observer(options),
                    studio,
                    _restart(options, gaze),
                ),
            )
        )
        targets.show = presenter.look_at
        drawn_by = describe(window.ctx)
        notes = [require_live(presenter, options, drawn_by.name)] if follows else []
        if over := window.lies_under():
            notes.append(
                f"over the window before the session began, and not held against it: {over}"
            )
        if window.unnoticed:
            notes.append(window.unnoticed)
        setting = Setting(
            protocol=protocol,
            display=display,
            manifest=manifest,
            root=options.root,
            wall_clock=utc_now,
            simulated=options.simulate,
            display_report=write_report(options.root, check),
            timing_evidence=check.evidence,
            drawn_by={"renderer": drawn_by.name, "opengl": drawn_by.version},
        )
        if resuming:
            recorder, plan = resume(setting, options.participant, presenter, gaze)
        else:
            recorder, plan = begin(setting, options.participant, language, presenter, gaze)
        for note in (*notes, *(() if gaze is None else gaze.info().notes)):
            listener.on_note(note)
            recorder.append(Note(**recorder.stamps(), text=note))
        validated = None
        if gaze is not None and options.validate:
            calibrate = TrackerCalibration(
                gaze, targets, protocol.gaze, Viewing.of(display), recorder
            )
            validated = _validation(display, gaze, presenter, listener, calibrate)
        elif gaze is not None:
            recorder.append(Note(**recorder.stamps(), text="gaze was not validated"))
        with recorder, _signals_quit(window, protocol):
            return conduct(
                setting,
                plan,
                recorder,
                presenter,
                gaze,
                RunSettings(
                    lambda attempt: listener.on_attempt(attempt, recorder.events), mark, validated
                ),
            )


def require_live(presenter: Presenter, options: SessionOptions, renderer: str) -> str:
    """Refuse live pictures where a refresh is too short for them, but in rehearsals.

    Returns
    -------
    str
        What was measured.
    """
    taken_s, method = presenter.dearest_live_s()
    error = too_dear(options.display, taken_s, method, renderer)
    if error is not None and options.pacing == "vsync":
        raise error
    said = f"live frames: the dearest, of {method}, took {1000 * taken_s:.1f} ms"
    return said if error is None else f"{said}: too long for a refresh, but this is a rehearsal"


def _language(options: SessionOptions, *, resuming: bool) -> str:
    protocol = options.protocol
    folder = session_folder(options.root, protocol, options.participant)
    if not resuming:
        require_unused(folder)
        given = options.language
        return protocol.text.default_language if given is None else given
    return read_journal(folder / JOURNAL_NAME, lenient=True).start.language


def _observer(options: SessionOptions) -> ArtificialObserver | None:
    if not options.simulate:
        return None
    protocol = options.protocol
    return ArtificialObserver(
        default_model(protocol), protocol.response, options.seed, options.participant
    )


def _gaze(
    options: SessionOptions, window: Window, refresh_hz: float, targets: Targets
) -> GazeSource | None:
    protocol, display = options.protocol, options.display
    if protocol.gaze.mode == "none":
        return None
    if options.gaze is None:
        dot = (protocol.trial.fixation_x_deg, protocol.trial.fixation_y_deg)
        return SimulatedGaze(window.now, Viewing.of(display), dot, behaviour=HUMAN)
    if options.gaze.startswith("mouse"):
        window.show_cursor(True, stays=True)
    return open_gaze(
        options.gaze,
        TrackerContext(
            display,
            window.now,
            window.cursor_px,
            refresh_hz,
            targets,
            store=protocol.privacy.store_gaze,
        ),
    )


def _restart(
    options: SessionOptions, gaze: GazeSource | None
) -> Callable[[PlannedTrial, int], None]:
    """Return the action before each attempt: an artificial eye begins anew."""

    def restart(trial: PlannedTrial, attempt: int) -> None:
        if isinstance(gaze, SimulatedGaze):
            rng = rng_of(options.seed, "attempt", options.participant, trial.id, attempt)
            gaze.restart(int(rng.integers(2**63)))

    return restart


def _validation(
    display: Display,
    gaze: GazeSource,
    presenter: Presenter,
    listener: Listener,
    calibrated: TrackerCalibration,
) -> Callable[[], CalibrationResult | None]:
    viewing = Viewing.of(display)

    def on_target(target_px: tuple[float, float]) -> None:
        if isinstance(gaze, SimulatedGaze):
            gaze.look_at(viewing.to_deg(*target_px))

    def run() -> CalibrationResult | None:
        if not calibrated():
            return None
        points = validate(gaze, viewing, presenter.look_at, on_target)
        if isinstance(gaze, SimulatedGaze):
            gaze.look_at(None)
        if points is None:
            return None
        calibrated.fit = False  # an eye that is not seen needs a calibration too
        result = summarise(points)
        calibrated.fit = not unfit_gaze(calibrated.rules, result)
        listener.on_validation(points, result)
        return result

    return run


@contextmanager
def _signals_quit(window: Window, protocol: StudyProtocol) -> Iterator[None]:
    """Let Ctrl-C in the terminal, or a polite kill, press the quit key; a second one stops hard."""
    asked: list[int] = []
    before: Mapping[signal.Signals, Handler] = {}

    def on_signal(number: int, _frame: object) -> None:
        asked.append(number)
        if len(asked) > 1:
            raise KeyboardInterrupt
        window.press(protocol.response.quit_keys[0])
        with suppress(OSError, ValueError):  # the terminal may be gone
            print(
                "asked the participant's window to quit; press again to stop at once",
                file=sys.stderr,
            )

    with suppress(ValueError):  # not the main thread: signals are someone else's
        before = {
            number: signal.signal(number, on_signal)
            for number in (signal.SIGINT, signal.SIGTERM, _TERMINAL_CLOSED)
        }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
