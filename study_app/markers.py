"""Markers for recordings elsewhere (EEG, a tracker's own): what happened on the screen, and when.

Every marker is stamped with the flip it belongs to, on LSL's clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from study_app.gaze.lsl import load_pylsl


class LslMarkers:
    """An LSL stream of type `Markers`: ``main-0003 attempt 1 first`` at the flip's stamp.

    Parameters
    ----------
    participant : str
        Part of the stream's identity.
    clock : callable
        The session's clock, which the stamps of flips are on.
    """

    def __init__(self, participant: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._pylsl = pylsl = load_pylsl()
        info = pylsl.StreamInfo(
            "metamerlab", "Markers", 1, pylsl.IRREGULAR_RATE, "string", f"metamerlab {participant}"
        )
        self._outlet = pylsl.StreamOutlet(info)
        self._to_lsl_s = float(pylsl.local_clock()) - clock()

    def __call__(self, text: str, t_s: float) -> None:
        """Send one marker; never waits."""
        self._outlet.push_sample([text], t_s + self._to_lsl_s)
