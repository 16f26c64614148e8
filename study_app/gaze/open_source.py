"""Gaze sources by specification; and two that need no tracker: the mouse, and a recording.

To add a tracker, write its adapter (`study_app.gaze.source.GazeSource`) and one entry here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from protocols.errors import StudyError, did_you_mean
from protocols.gone import gone
from protocols.plugins import misfit, registered, taking
from protocols.study_file.session_schema import Gaze
from study_app.gaze.eyelink import EyelinkGaze
from study_app.gaze.lsl import LslGaze, LslSpec
from study_app.gaze.recording import Eye, Recording, load_recording
from study_app.gaze.source import (
    GazeSample,
    GazeSource,
    SourceInfo,
    TrackerContext,
)
from study_app.gaze.trusted import TrustedGaze

_METHODS = ("open", "info", "poll", "mark", "calibrate", "close")
"""Methods of every `GazeSource`."""


def recorded(rest: str) -> Recording:
    """Read the recording that ``replay:`` names: ``FILE``, ``FILE,eye=left|right``.

    ``FILE,unknown=NUMBER`` says which number stands for a lost eye, ``unknown=none`` that none is.

    Raises
    ------
    StudyError
        If there is none.
    """
    if not rest:
        raise StudyError("--gaze: replay needs a file: replay:FILE (.asc or .csv)")
    named, told, number = rest.partition(",unknown=")
    file, _, eye = named.partition(",eye=")
    eyes: dict[str, Eye | None] = {"": None, "left": "left", "right": "right"}
    if eye not in eyes:
        raise StudyError(f"--gaze: must read replay:FILE,eye=left|right (got {rest!r})")
    try:
        unknown = None if not told else () if number == "none" else (float(number),)
    except ValueError:
        raise StudyError(
            f"--gaze: unknown must be a number as the file stores it, or none (got {number!r})"
        ) from None
    return load_recording(Path(file), eyes[eye], unknown)


def _replay(rest: str, desk: TrackerContext) -> GazeSource:
    here = recorded(rest).on_screen(desk.display.width_px, desk.display.height_px)
    return ReplaySource(here, desk.clock)


ADAPTERS: dict[str, Callable[[str, TrackerContext], GazeSource]] = registered(
    "trackers",
    {
        "lsl": lambda rest, desk: LslGaze(LslSpec.parse(rest), desk.display, desk.clock),
        "mouse": lambda _, desk: MouseGaze(desk.cursor_px, desk.clock, desk.refresh_hz),
        "replay": _replay,
        "eyelink": EyelinkGaze,
    },
    "name a function of (text after the colon, TrackerContext)",
    taking(2),
)
"""By the word before the colon; entry points of ``metamerlab.trackers`` name such functions."""


def check_kind(specification: str) -> str:
    """Return the kind of source that a specification names.

    Raises
    ------
    StudyError
        If there is no such kind.
    """
    kind = specification.partition(":")[0]
    if kind not in ADAPTERS:
        if message := gone(f"--gaze {kind}"):
            raise StudyError(f"--gaze {kind} {message}")
        raise StudyError(
            f"--gaze: must be one of {', '.join(ADAPTERS)} (got {specification!r})"
            f"{did_you_mean(kind, ADAPTERS)}"
        )
    return kind


def check_choice(rules: Gaze, given: str | None, *, simulate: bool) -> None:
    """Refuse a gaze source that is not a study's to have, or the lack of one that it needs."""
    if given is not None:
        check_kind(given)
        if rules.mode == "none":
            raise StudyError(
                "--gaze: this protocol watches no gaze (gaze.mode = 'none'); leave it out, or set"
                " the mode to 'monitor'"
            )
    elif rules.mode != "none" and not simulate:
        raise StudyError(
            f"--gaze: this protocol needs a gaze source (gaze.mode = {rules.mode!r}, at least"
            f" {rules.rate_min_hz:g} Hz): {', '.join(sorted(ADAPTERS))}, such as lsl:NAME; mouse is"
            " for rehearsals. Without a tracker set gaze.mode = 'none'"
        )


def open_gaze(specification: str, desk: TrackerContext) -> TrustedGaze:
    """Open the source that ``lsl``, ``lsl:NAME``, ``mouse`` or ``replay:FILE`` names.

    Whatever it sends, its samples can be judged: see `study_app.gaze.trusted`.

    Raises
    ------
    StudyError
        If there is no such kind, or nothing to connect to.
    """
    kind, rest = check_kind(specification), specification.partition(":")[2]
    opened = ADAPTERS[kind](rest, desk)
    if not all(callable(getattr(opened, name, None)) for name in _METHODS):
        raise misfit("trackers", kind, f"return a source with {', '.join(_METHODS)}", opened)
    source = TrustedGaze(opened, desk.clock)
    source.open()
    return source


class MouseGaze(GazeSource):
    """One sample per poll, that is per refresh.

    Parameters
    ----------
    cursor_px : callable
        Returns the cursor, from the upper left corner of the screen.
    clock : callable
        The session's clock.
    rate_hz : float
        How often it is polled.
    """

    def __init__(
        self,
        cursor_px: Callable[[], tuple[float, float]],
        clock: Callable[[], float],
        rate_hz: float,
    ) -> None:
        self._cursor_px, self._clock, self._rate_hz = cursor_px, clock, rate_hz

    def info(self) -> SourceInfo:
        """Say that it is no eye."""
        return SourceInfo("mouse", "cursor in place of an eye", self._rate_hz, polled=True)

    def poll(self) -> Sequence[GazeSample]:
        """Return the place of the cursor now."""
        now_s = self._clock()
        return [GazeSample(now_s, now_s, *self._cursor_px())]


SAME_TIME_S = 1e-6
"""A sample whose time comes within this has come: sums of refreshes are no exact numbers."""


class ReplaySource(GazeSource):
    """Emits a recording's samples as their time comes, once.

    Parameters
    ----------
    recording : Recording
        From `load_recording`.
    clock : callable
        The session's monotonic clock, in seconds.
    """

    def __init__(self, recording: Recording, clock: Callable[[], float]) -> None:
        self._recording = recording
        self._clock = clock
        self._start_s = clock()
        self._next = 0
        self.marks: list[tuple[float, str]] = []

    def open(self) -> None:
        """Start the recording now."""
        self._start_s, self._next = self._clock(), 0

    def info(self) -> SourceInfo:
        """Name the file."""
        tape = self._recording
        return SourceInfo("replay", tape.path.name, tape.rate_hz, notes=tape.notes)

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples whose time has come."""
        tape = self._recording
        since_s = self._clock() - self._start_s + SAME_TIME_S
        until = int(np.searchsorted(tape.t_s, since_s, side="right"))
        start, self._next = self._next, max(until, self._next)
        return [
            GazeSample(
                self._start_s + float(tape.t_s[i]),
                float(tape.raw_t[i]),
                float(tape.x_px[i]),
                float(tape.y_px[i]),
            )
            for i in range(start, self._next)
        ]

    def mark(self, text: str) -> None:
        """Keep the marker."""
        self.marks.append((self._clock(), text))
