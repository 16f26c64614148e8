"""The program's own share of the latency, measured on a display with gaze that nobody made.

What is drawn costs next to nothing, so this is what loop, window and display take: a method's own
time comes on top, and the tracker's and the panel's delays are in no number of ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import moderngl

from protocols.latency import LatencySummary
from study_app.gaze.source import GazeSample
from study_app.live.loop import Latency, LiveLoop, Screen
from study_app.live.renderer import Follower, GazeState, LiveView, Place

GAZE_HZ = 1000.0
WARM_UP_FRAMES = 10
FRAMES = 240
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

    def follow(self, eye_px: Place, elapsed_s: float) -> tuple[Place, Place]:  # noqa: ARG002
        """Return the eye's own place."""
        return eye_px, eye_px

    def draw(self, gaze_state: GazeState) -> moderngl.Texture:  # noqa: ARG002
        """Return the square."""
        return self._texture

    def release(self) -> None:
        """Free the square."""
        self._texture.release()


def measure_latency(screen: Screen, square: Follower, frames: int = FRAMES) -> LatencySummary:
    """Show frames to the synthetic gaze, and return how old it was at their flips."""
    loop = LiveLoop(screen, SyntheticGaze(screen.now), (0, 0), polled=False)
    latency = Latency()
    for number in range(WARM_UP_FRAMES + frames):
        flip, _ = loop.step(square, LiveView(), 0)
        if number >= WARM_UP_FRAMES:
            latency.add(flip.eye, flip.age_s)
    return latency.summary()
