"""A seeded eye and tracker: fixation jitter, drift, saccades, blinks, loss, tracker death.

Every sample is a function of (seed, sample number), so that the gaze of an attempt is the same
however often it is polled, and the same again after a crash.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from protocols.display import Viewing
from study_app.gaze.source import CalibrationResult, GazeSample, GazeSource, SourceInfo

_CHUNK = 256  # samples drawn at once
_HORIZON_S = 120.0  # events are drawn this far ahead: no attempt is longer
_DRAG_S = (0.012, 0.03)  # how long before and after a blink the lid drags


@dataclass(frozen=True)
class GazeEvent:
    """Event of eye or tracker, seconds after `SimulatedGaze.restart`."""

    kind: Literal["away", "blink", "loss", "death"]
    """`away`: gaze rests elsewhere; `blink`: lost, with the lid's drag just before and after;
    `loss`: lost; `death`: no samples any more."""
    at_s: float
    duration_s: float = math.inf
    offset_deg: tuple[float, float] = (6.0, 0.0)
    """`away`: from the dot."""


@dataclass(frozen=True)
class GazeBehaviour:
    """Behaviour of a simulated eye: how it fixates, and how often something happens."""

    jitter_deg: float = 0.05
    """Standard deviation of each sample, per axis."""
    drift_deg: float = 0.2
    """Amplitude of slow drift, per axis."""
    away_per_s: float = 0.0
    away_duration_s: tuple[float, float] = (0.1, 0.6)
    blink_per_s: float = 0.0
    blink_duration_s: tuple[float, float] = (0.05, 0.14)
    loss_per_s: float = 0.0
    loss_duration_s: tuple[float, float] = (0.2, 0.5)


STEADY = GazeBehaviour()
HUMAN = GazeBehaviour(away_per_s=0.01, blink_per_s=0.2, loss_per_s=0.002)
"""About one attempt in fifteen is void: some glances away, some long blinks."""


class SimulatedGaze(GazeSource):
    """An eye that looks at the dot, on the session's clock.

    Parameters
    ----------
    clock : callable
        The session's monotonic clock, in seconds.
    viewing : Viewing
        Geometry of the display.
    dot_deg : tuple of float
        Where the eye means to look: azimuth, elevation.
    rate_hz : float
        Sampling rate.
    behaviour : GazeBehaviour
        Used by `restart` to draw events.
    """

    def __init__(
        self,
        clock: Callable[[], float],
        viewing: Viewing,
        dot_deg: tuple[float, float],
        *,
        rate_hz: float = 250.0,
        behaviour: GazeBehaviour = STEADY,
    ) -> None:
        self._clock, self._viewing, self._dot = clock, viewing, dot_deg
        self._home = dot_deg
        self._rate_hz, self._behaviour = rate_hz, behaviour
        self._events: tuple[GazeEvent, ...] = ()
        self._chunk: tuple[int, list[GazeSample]] | None = None
        self.restart(0)

    def restart(self, seed: int, events: Sequence[GazeEvent] | None = None) -> None:
        """Begin a new stretch of gaze now; `events` replaces what the behaviour would draw."""
        rng = np.random.default_rng(seed)
        self._seed, self._start_s, self._next = seed, self._clock(), 0
        self._chunk = None
        self._waves = rng.uniform(0, 2 * math.pi, (2, 3)), rng.uniform(0.1, 0.6, (2, 3))
        self._events = tuple(self._drawn_events(rng) if events is None else events)
        deaths = [event.at_s for event in self._events if event.kind == "death"]
        self._dead = math.ceil(min(deaths) * self._rate_hz - 1e-9) if deaths else sys.maxsize

    def look_at(self, place_deg: tuple[float, float] | None) -> None:
        """Look somewhere else from now on; None: at the dot again."""
        self._dot = self._home if place_deg is None else place_deg
        self._chunk = None

    def info(self) -> SourceInfo:
        """Say that no person sits there."""
        return SourceInfo("simulated", "seeded eye and tracker", self._rate_hz)

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples whose time has come."""
        until = math.floor((self._clock() - self._start_s) * self._rate_hz + 1e-9) + 1
        start, self._next = self._next, max(until, self._next)
        end, found = min(self._next, self._dead), list[GazeSample]()
        while start < end:
            index, offset = divmod(start, _CHUNK)
            samples = self._samples_of(index)[offset : offset + end - start]
            found = found + samples if found else samples
            start = (index + 1) * _CHUNK
        return found

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """Return the accuracy and precision of this eye's jitter."""
        behaviour = self._behaviour
        accuracy = math.hypot(behaviour.drift_deg, behaviour.drift_deg) / 2
        return CalibrationResult(accuracy, 2 * behaviour.jitter_deg, len(points_px))

    def _samples_of(self, index: int) -> list[GazeSample]:
        """Return a chunk's samples; they are kept until the next one is asked for."""
        if self._chunk is None or self._chunk[0] != index:
            number = index * _CHUNK + np.arange(_CHUNK, dtype=np.float64)
            columns = (self._start_s + number / self._rate_hz, number, *self._chunk_px(index).T)
            rows = zip(*(column.tolist() for column in columns), strict=True)
            # As ``GazeSample._make`` does, without counting the columns of every row.
            self._chunk = index, list(map(tuple.__new__, repeat(GazeSample), rows))
        return self._chunk[1]

    def _chunk_px(self, index: int) -> NDArray[np.float64]:
        """Return the gaze of `_CHUNK` samples in pixels: jitter, drift and what happens."""
        after_s = (index * _CHUNK + np.arange(_CHUNK)) / self._rate_hz
        rng = np.random.default_rng((self._seed, index))
        gaze_deg = rng.normal(0.0, self._behaviour.jitter_deg, (_CHUNK, 2)) + self._dot
        phases, rates_hz = self._waves
        waves = np.sin(2 * math.pi * (after_s[:, None, None] * rates_hz) + phases)
        gaze_deg += self._behaviour.drift_deg / 3 * waves.sum(axis=2)
        for event in self._events:
            since_s = after_s - event.at_s
            if since_s[-1] < -_DRAG_S[0] or since_s[0] >= event.duration_s + _DRAG_S[1]:
                continue
            inside = (since_s >= 0.0) & (since_s < event.duration_s)
            if event.kind == "away":
                gaze_deg[inside] += event.offset_deg
            elif event.kind == "blink":  # the lid drags the pupil's estimate down
                dragged = (since_s >= -_DRAG_S[0]) & (since_s < event.duration_s + _DRAG_S[1])
                gaze_deg[dragged, 1] += 4.0
                gaze_deg[inside] = math.nan
            elif event.kind == "loss":
                gaze_deg[inside] = math.nan
        view = self._viewing
        middle_px = view.width_px / 2, view.height_px / 2
        offset_mm = view.distance_mm * np.tan(np.radians(gaze_deg))
        return middle_px + offset_mm / (view.pitch_x_mm, view.pitch_y_mm)

    def _drawn_events(self, rng: np.random.Generator) -> list[GazeEvent]:
        behaviour = self._behaviour
        kinds: tuple[tuple[Literal["away", "blink", "loss"], float, tuple[float, float]], ...] = (
            ("away", behaviour.away_per_s, behaviour.away_duration_s),
            ("blink", behaviour.blink_per_s, behaviour.blink_duration_s),
            ("loss", behaviour.loss_per_s, behaviour.loss_duration_s),
        )
        events = []
        for kind, per_s, durations_s in kinds:
            at_s = 0.0
            while per_s > 0 and (at_s := at_s + float(rng.exponential(1 / per_s))) < _HORIZON_S:
                angle = float(rng.uniform(0, 2 * math.pi))
                reach = float(rng.uniform(3.0, 8.0))
                events.append(
                    GazeEvent(
                        kind,
                        at_s,
                        float(rng.uniform(*durations_s)),
                        (reach * math.cos(angle), reach * math.sin(angle)),
                    )
                )
        return events
