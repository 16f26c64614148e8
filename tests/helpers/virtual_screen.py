"""A screen without a monitor."""

import math

import moderngl

from study_app.live.renderer import GazeState
from study_app.virtual import VirtualClock


class VirtualScreen:
    """A screen without a monitor for `study_app.live`; a frame takes `cost_s` to draw."""

    def __init__(self, clock: VirtualClock, refresh_hz: float, cost_s: float = 0.0) -> None:
        self._clock, self.refresh_hz, self._cost_s = clock, refresh_hz, cost_s

    def now(self) -> float:
        """Return the virtual clock."""
        return self._clock()

    def wait_until(self, t_s: float) -> None:
        """Move the clock."""
        self._clock.move_to(t_s)

    def paint(self, picture: moderngl.Texture, gaze_state: GazeState) -> None:  # noqa: ARG002
        """Take as long as drawing does."""
        self._clock.move_to(self._clock() + self._cost_s)

    def flip(self) -> float:
        """Wait for the next refresh of the grid."""
        line = math.floor(self._clock() * self.refresh_hz + 1e-6) + 1
        self._clock.move_to(line / self.refresh_hz)
        return self._clock()
