"""The loop of a picture that follows the gaze: wait, poll, draw, swap, stamp.

It waits as long as the frame's known cost still fits before the flip, so that gaze is as young as
this machine allows. It makes no OpenGL object, and keeps nothing that grows: ages of gaze at flips
are counted in bins.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from protocols.latency import EyeState, LatencySummary
from protocols.recipes.base import Change
from study_app.gaze.saccades import Saccade, SaccadeWatch
from study_app.gaze.source import GazeSample
from study_app.live.renderer import Follower, GazePlace, GazeState, LiveView, on_grid

if TYPE_CHECKING:
    import moderngl


SILENT_S = 0.1
"""A tracker that sends nothing for so long has lost the eye, as in sessions."""
AHEAD_S = 0.001
"""Longest time by which a sample may be stamped after its arrival: two clocks agree no better."""
_BIN_S, _BINS = 1e-4, 20_000


class Latency:
    """Counts ages in bins of 0.1 ms, so that nothing grows with the number of frames."""

    def __init__(self) -> None:
        self._bins = array("Q", bytes(8 * _BINS))
        self._most_s = -math.inf
        self._counts: dict[EyeState, int] = dict.fromkeys(
            ("found", "lost", "silent", "ahead", "none"), 0
        )

    def add(self, eye: EyeState, age_s: float) -> None:
        """Count a frame, whose gaze was so old at its flip."""
        self._counts[eye] += 1
        if eye == "found":
            self._bins[min(max(0, round(age_s / _BIN_S)), _BINS - 1)] += 1
            self._most_s = max(self._most_s, age_s)

    def summary(self) -> LatencySummary:
        """Return the counts."""
        counts, found = self._counts, self._counts["found"]
        return LatencySummary(
            frames=found,
            median_ms=self._quantile_ms(0.5) if found else None,
            p95_ms=self._quantile_ms(0.95) if found else None,
            max_ms=round(1e3 * self._most_s, 3) if found else None,
            lost=counts["lost"] + counts["none"],
            silent=counts["silent"],
            ahead=counts["ahead"],
        )

    def _quantile_ms(self, share: float) -> float:
        due, seen = max(1, math.ceil(share * self._counts["found"])), 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= due:
                return min(round(1e3 * _BIN_S * place, 3), round(1e3 * self._most_s, 3))
        raise AssertionError("fewer ages were counted than frames")


SPARE_SHARE = 0.15
"""Share of a refresh between a drawn frame and its flip: stamps come a little after the line."""
_FORGET = 0.95  # of the dearest frame's cost, from frame to frame
_LINE_SLACK = 1e-6


class Screen(Protocol):
    """Screen that frames go to: a window, or one that exists in numbers alone."""

    @property
    def refresh_hz(self) -> float:
        """Nominal."""

    def now(self) -> float:
        """Return the clock that samples and flips are stamped by, in seconds."""

    def wait_until(self, t_s: float) -> None:
        """Take what events come until then."""

    def paint(self, picture: moderngl.Texture, gaze_state: GazeState) -> None:
        """Put a picture, and what lies over it, into the next frame; return once it is drawn."""

    def flip(self) -> float:
        """Show the next frame, and return when that was."""


class GazeSamples(Protocol):
    """Source of gaze samples."""

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples since the last call, oldest first. Never waits."""


class DrawnFlip(NamedTuple):
    """One frame that was shown, with all that decided it."""

    number: int
    t_s: float
    """Time at which it was flipped."""
    poll_s: float
    """Time at which gaze was asked for."""
    drawn_s: float
    """Time at which it was drawn."""
    refreshes: int
    """Since the flip before; 0 for the first one, and after a pause."""
    view: LiveView
    gaze_state: GazeState
    eye: EyeState
    sample_s: float
    """Stamp of the sample whose gaze is shown, not a number before the first one."""
    follows: bool = True
    """True if it took the newest gaze, false if it held one until a saccade."""
    saccades: tuple[Saccade, ...] = ()
    """Saccades that ended since the flip before."""
    suppressed: bool | None = None
    """True if the eye saw little at the flip, as far as gaze had come; None: nobody watched."""

    @property
    def age_s(self) -> float:
        """Sample to flip."""
        return self.t_s - self.sample_s


class LiveLoop:
    """Shows one renderer's pictures on a screen, each to the newest gaze.

    Parameters
    ----------
    screen : Screen
    gaze : GazeSamples
        In pixels of the screen.
    corner_px : (x, y)
        Of the picture on the screen, upper left.
    polled : bool
        Each poll makes a sample, so that the source is never silent (the mouse).
    cost_s : float
        Of a frame, as far as it is known beforehand.
    watch : SaccadeWatch, optional
        Finds saccades in the samples, some of which it may have had.
    change : Change
        During saccades alone: the gaze of the first frame is held until a flip is due where the
        eye sees little. It needs a watch.

    Attributes
    ----------
    change : Change
        May be set between two frames.
    """

    def __init__(
        self,
        screen: Screen,
        gaze: GazeSamples,
        corner_px: GazePlace,
        *,
        polled: bool,
        cost_s: float = 0.0,
        watch: SaccadeWatch | None = None,
        change: Change = "always",
    ) -> None:
        self._screen, self._gaze, self.corner_px, self._polled = screen, gaze, corner_px, polled
        self._watch, self.change = watch, change
        self.latency = Latency()
        self.missed = 0
        """Refreshes without a frame of their own."""
        self.number = 0
        """Number of the next frame."""
        self._newest: GazeSample | None = None
        self._seen: GazeSample | None = None  # the one whose gaze is shown
        self._held: GazeSample | None = None
        self._begins = True
        self._cost_s = cost_s  # of a frame, until it is drawn
        self._flip_s = self._poll_s = math.nan

    def step(
        self, renderer: Follower, view: LiveView | Callable[[], LiveView], seed: int
    ) -> tuple[DrawnFlip, moderngl.Texture]:
        """Show one frame; return it with its picture, which the next step draws over.

        A view that is called for is as young as gaze.
        """
        screen, hz = self._screen, self._screen.refresh_hz
        self._wait()
        begin_s = screen.now()
        view = view() if callable(view) else view
        renderer.hold(view)
        poll_s = screen.now()
        elapsed = 0 if self.number == 0 else max(1, round((poll_s - self._poll_s) * hz))
        ended = self._take(self._gaze.poll())
        free = self.change == "always" or self._begins
        free = free or bool(self._suppressed(begin_s + self._need_s))
        eye_px = self._eye_px() if free else (math.nan, math.nan)
        gaze_px, field_px = renderer.follow(eye_px, elapsed / hz)
        gaze_state = GazeState(gaze_px, field_px, seed)
        picture = renderer.draw(gaze_state)
        screen.paint(picture, gaze_state)
        drawn_s = screen.now()
        self._cost_s = max(drawn_s - begin_s, _FORGET * self._cost_s)
        t_s = screen.flip()
        began = math.isnan(self._flip_s)
        refreshes = 0 if began else max(0, round((t_s - self._flip_s) * hz))
        sample_s = math.nan if self._seen is None else self._seen.t_s
        flip = DrawnFlip(
            self.number, t_s, poll_s, drawn_s, refreshes, view, gaze_state, self._eye(poll_s),
            sample_s, free, ended, self._suppressed(t_s),
        )  # fmt: skip
        if free:
            self.latency.add(flip.eye, flip.age_s)
        self.missed += max(0, refreshes - 1)
        self.number, self._flip_s, self._poll_s, self._begins = self.number + 1, t_s, poll_s, False
        return flip, picture

    def pause(self) -> None:
        """Forget the last flip: what comes between was asked for, and is no missed refresh."""
        self._flip_s = math.nan

    def begin(self, flip_s: float, seen: GazeSample | None) -> None:
        """Have the next frame begin a picture: it shows the gaze of its moment.

        Parameters
        ----------
        flip_s : float
            The last flip of what was shown before, on this screen.
        seen : GazeSample, optional
            The last one that saw the eye: it is held where the next frame's eye is lost.
        """
        self._flip_s, self._held, self._begins = flip_s, seen, True

    def _wait(self) -> None:
        """Wait until the frame, begun then, is drawn just before a refresh."""
        if math.isnan(self._flip_s):
            return
        period_s = 1 / self._screen.refresh_hz
        need_s = self._need_s
        since_s = self._screen.now() + need_s - self._flip_s
        refreshes = max(1, math.ceil(since_s / period_s - _LINE_SLACK))
        self._screen.wait_until(self._flip_s + refreshes * period_s - need_s)

    @property
    def _need_s(self) -> float:
        """Time from the begin of a frame to its flip, s."""
        return self._cost_s + SPARE_SHARE / self._screen.refresh_hz

    def _take(self, samples: Sequence[GazeSample]) -> tuple[Saccade, ...]:
        if samples:
            self._newest = samples[-1]
        return () if self._watch is None else tuple(self._watch.take(samples))

    def _suppressed(self, flip_s: float) -> bool | None:
        if self._watch is None:
            return None
        last = self._watch.last
        return last is not None and bool(last.suppresses(flip_s))  # a plug-in's may be numpy's

    def _eye_px(self) -> GazePlace:
        """Place of the eye in the picture, on the grid of gazes; not a number while it is lost."""
        newest, held, self._held = self._newest, self._held, None
        if newest is None or not newest.valid:
            newest = held
        if newest is None:
            return math.nan, math.nan
        self._seen = newest
        return on_grid((newest.x_px - self.corner_px[0], newest.y_px - self.corner_px[1]))

    def _eye(self, poll_s: float) -> EyeState:
        newest = self._newest
        if newest is None or (self._seen is None and not newest.valid):
            return "none"
        if not self._polled and poll_s - newest.t_s > SILENT_S:
            return "silent"
        if not newest.valid:
            return "lost"
        return "ahead" if newest.t_s > poll_s + AHEAD_S else "found"


GAZE_HZ = 1000.0
WARM_UP_FRAMES, FRAMES = 10, 240
_EDGE_PX = 16


class SyntheticGaze:
    """Gaze in the middle of a square, sampled at `GAZE_HZ` without any delay."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._last = math.floor(now() * GAZE_HZ)

    def poll(self) -> list[GazeSample]:
        """Return the newest sample, if there is a new one."""
        number = math.floor(self._now() * GAZE_HZ)
        if number == self._last:
            return []
        self._last = number
        stamp_s = number / GAZE_HZ
        return [GazeSample(stamp_s, stamp_s, _EDGE_PX / 2, _EDGE_PX / 2)]


class GreySquare:
    """A renderer of nothing but grey."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._texture = ctx.texture((_EDGE_PX, _EDGE_PX), 4, b"\x80" * (4 * _EDGE_PX**2))

    def hold(self, view: LiveView) -> None:
        """Analyse nothing."""

    def follow(self, eye_px: GazePlace, elapsed_s: float) -> tuple[GazePlace, GazePlace]:  # noqa: ARG002
        """Return the eye's own place."""
        return eye_px, eye_px

    def draw(self, gaze_state: GazeState) -> moderngl.Texture:  # noqa: ARG002
        """Return the square."""
        return self._texture

    def release(self) -> None:
        """Free the square."""
        self._texture.release()


def measure_latency(screen: Screen, square: Follower, frames: int = FRAMES) -> LatencySummary:
    """Show frames to the synthetic gaze, and return how old it was at their flips.

    What is drawn costs next to nothing, so this is what loop, window and display take: a method's
    own time comes on top, and the tracker's and the panel's delays are in no number of ours.
    """
    loop = LiveLoop(screen, SyntheticGaze(screen.now), (0, 0), polled=False)
    latency = Latency()
    for number in range(WARM_UP_FRAMES + frames):
        flip, _ = loop.step(square, LiveView(), 0)
        if number >= WARM_UP_FRAMES:
            latency.add(flip.eye, flip.age_s)
    return latency.summary()
