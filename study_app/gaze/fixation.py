"""Rules of fixation, when gaze counts as held: window, violation, blink, loss, silence.

All rules come from the protocol's gaze section and work on samples stamped by one clock:

- *Inside*: the angle between the lines of sight to gaze and dot is at most `window_deg`.
- *Violation*: outside without interruption for `violation_s` and `violation_samples` samples.
- *Blink*: lost data for up to `blink_s` is pardoned, and so is gaze outside for
  `blink_margin_s` after it (the lid drags the pupil's estimate along).
- *Loss*: lost data for longer than that, no sample at all for longer than `silence_s`, or more
  than `loss_max_share` of the watched time lost in all (blinks included). Gaps between samples of a
  source that is sampled once per poll are none: the display was late, and no eye was lost.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from protocols.display import Viewing
from protocols.journal import GazeQuality
from protocols.study_file.session_schema import Gaze
from study_app.gaze.source import GazeSample
from study_app.trial import GazeVerdict

_EPSILON_S = 1e-9
"""Stamps are sums of floats; a rule's own length must not fail by rounding."""


class FixationMonitor:
    """Turns samples into a verdict per frame.

    Parameters
    ----------
    rules : Gaze
        The protocol's gaze section.
    viewing : Viewing
        Geometry of the display.
    dot_deg : tuple of float
        Azimuth and elevation of the fixation dot.
    rate_hz : float
        Nominal rate of the source; gaps of more than 1.5 intervals count as lost time.
    polled : bool
        As `SourceInfo.polled`: no gap does.
    """

    def __init__(
        self,
        rules: Gaze,
        viewing: Viewing,
        dot_deg: tuple[float, float],
        rate_hz: float,
        *,
        polled: bool = False,
    ) -> None:
        self._rules = rules
        self._angle_to_dot_deg = viewing.angle_to(*viewing.to_px(*dot_deg))
        self._interval_s = 1.0 / rate_hz
        self._gap_most_s = math.inf if polled else 1.5 * self._interval_s
        self._silence_most_s = math.inf if polled else rules.silence_s
        self._last_s = -math.inf  # stamp of the newest sample
        self._inside = False
        self._outside_since_s: float | None = None
        self._outside_samples = 0
        self._lost_since_s: float | None = None
        self._pardoned_until_s = -math.inf
        self._paused_s: float | None = None
        self._begin(0.0, math.inf)
        self._watching = False

    def _begin(self, now_s: float, planned_s: float) -> None:
        self._watching = True
        self._began_s, self._planned_s = now_s, planned_s
        self._violation = self._loss = self._counted = False
        self._outside_since_s, self._outside_samples = None, 0
        self._lost_s = 0.0
        self._samples = self._blinks = self._violations = 0
        self._angles = 0
        self._angle_sum_deg = self._angle_max_deg = 0.0

    def watch(self, now_s: float, planned_s: float) -> None:
        """Start to watch, or go on after `pause`; `planned_s` is how long to watch in all."""
        if self._paused_s is None:
            self._begin(now_s, planned_s)
            return
        self._began_s += now_s - self._paused_s
        self._watching, self._paused_s = True, None
        self._violation = self._loss = False
        self._lost_since_s = None
        self._end_outside()

    def pause(self, now_s: float) -> None:
        """Watch no longer, until `watch`: a question comes. What was counted stays."""
        self._watching, self._paused_s = False, now_s

    def rest(self) -> None:
        """Stop watching: the next `watch` begins anew."""
        self._watching, self._paused_s = False, None

    def feed(self, samples: Iterable[GazeSample]) -> None:
        """Take new samples, oldest first."""
        # One loop without calls where nothing happens: it runs for every sample between flips.
        rules, interval_s, angle_to_dot_deg = self._rules, self._interval_s, self._angle_to_dot_deg
        gap_most_s, silence_s = self._gap_most_s, self._silence_most_s
        window_deg = rules.window_deg
        if self._paused_s is not None:  # where gaze is now, and no more
            for t_s, _, x_px, y_px in samples:
                self._last_s = t_s
                self._inside = angle_to_dot_deg(x_px, y_px) <= window_deg
            return
        for t_s, _, x_px, y_px in samples:
            last_s = self._last_s
            if last_s > -math.inf:
                since_s = t_s - (last_s if last_s > self._began_s else self._began_s)
                if t_s - last_s > silence_s:
                    self._loss = True
                if since_s > gap_most_s:
                    self._lost_s += since_s - interval_s
            self._last_s = t_s
            self._samples += 1
            if x_px != x_px or y_px != y_px:  # not `sample.valid`, for thousands of samples
                self._take_lost(t_s)
                continue
            if self._lost_since_s is not None:
                self._end_loss(t_s, self._lost_since_s)
            angle_deg = angle_to_dot_deg(x_px, y_px)
            self._angles += 1
            self._angle_sum_deg += angle_deg
            if angle_deg > self._angle_max_deg:
                self._angle_max_deg = angle_deg
            self._inside = angle_deg <= window_deg
            if not (self._inside or t_s <= self._pardoned_until_s):
                self._take_outside(t_s)
            elif self._outside_samples:
                self._end_outside()

    def verdict(self, now_s: float) -> GazeVerdict:
        """Return the verdict on gaze at `now_s`."""
        silent = now_s - self._last_s > self._rules.silence_s
        if self._watching:
            if silent:
                self._loss = True
            if self._lost_s > self._rules.loss_max_share * self._planned_s:
                self._loss = True
            if self._violation:
                return GazeVerdict.VIOLATION
            if self._loss:
                return GazeVerdict.LOSS
        return GazeVerdict.HELD if self._inside and not silent else GazeVerdict.AWAY

    def silent_s(self, now_s: float) -> float:
        """Return for how long no sample has come; infinite where none ever did."""
        return now_s - self._last_s

    def quality(self, now_s: float) -> GazeQuality:
        """Summarise the time watched up to `now_s`."""
        lost_s, now_s = self._lost_s, now_s if self._paused_s is None else self._paused_s
        silent_s = now_s - max(self._last_s, self._began_s)
        if silent_s > self._gap_most_s:
            lost_s += silent_s - self._interval_s
        watched_s = max(now_s - self._began_s, 1e-9)
        return GazeQuality(
            samples=self._samples,
            lost_share=round(min(1.0, lost_s / watched_s), 4),
            blinks=self._blinks,
            violations=self._violations,
            mean_deg=round(self._angle_sum_deg / self._angles, 4) if self._angles else None,
            max_deg=round(self._angle_max_deg, 4) if self._angles else None,
        )

    def _take_outside(self, t_s: float) -> None:
        rules = self._rules
        if self._outside_since_s is None:
            self._outside_since_s = t_s
        self._outside_samples += 1
        if (
            self._outside_samples >= rules.violation_samples
            and t_s - self._outside_since_s >= rules.violation_s - _EPSILON_S
        ):
            self._violation = True
            self._violations += not self._counted
            self._counted = True

    def _end_outside(self) -> None:
        self._outside_since_s, self._outside_samples, self._counted = None, 0, False

    def _end_loss(self, t_s: float, lost_since_s: float) -> None:
        if t_s - lost_since_s <= self._rules.blink_s + _EPSILON_S:
            self._blinks += 1
        self._lost_since_s = None
        self._pardoned_until_s = t_s + self._rules.blink_margin_s

    def _take_lost(self, t_s: float) -> None:
        self._inside = False
        self._end_outside()
        self._lost_s += self._interval_s
        if self._lost_since_s is None:
            self._lost_since_s = t_s
        elif t_s - self._lost_since_s > self._rules.blink_s + _EPSILON_S:
            self._loss = True
