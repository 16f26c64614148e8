"""``--gaze`` of a clip: a place, a recording, or a table with a gaze per frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.load import load_display

if TYPE_CHECKING:
    from stimuli.foveated.clip_to_files import Track

_REPLAY = "replay:"


def is_of_frames(gaze: str | None) -> bool:
    """True if it names a gaze per frame."""
    return gaze is not None and (gaze.startswith(_REPLAY) or Path(gaze).suffix.lower() == ".csv")


def track_of(gaze: str, display: str | None, fps: float, say: Callable[[str], None]) -> Track:
    """Read ``replay:FILE`` or ``FILE.csv``.

    A frame has the last sample at its time, on the grid of gazes of a live picture. A recording is
    of the screen, in whose middle frames stand: that of `display`, or one as large as the frames.

    Raises
    ------
    StudyError
        If there is no such recording or table; and by the track, if it does not fit the frames.
    """
    if gaze.startswith(_REPLAY):
        from study_app.gaze.open_source import recorded
        from study_app.gaze.replay import SAME_TIME_S
        from study_app.live.renderer import on_grid

        recording = recorded(gaze.removeprefix(_REPLAY))

        def replay(frames: int, size: tuple[int, int]) -> NDArray[np.float64]:
            height, width = size
            screen = load_display(display) if display is not None else None
            across, down = (screen.width_px, screen.height_px) if screen else (width, height)
            here = recording.on_screen(across, down)
            for note in here.notes:
                say(f"note: {note}")
            times_s = np.arange(frames) / fps
            if times_s[-1] > here.t_s[-1] + 1 / here.rate_hz:
                say(
                    f"note: {here.path.name} ends after {here.t_s[-1]:.3g} s, the frames after"
                    f" {times_s[-1]:.3g} s, at {fps:g} a second: its last gaze is held"
                )
            last = np.searchsorted(here.t_s, times_s + SAME_TIME_S, side="right") - 1
            corner = (across - width) // 2, (down - height) // 2
            places = zip(here.x_px[last] - corner[0], here.y_px[last] - corner[1], strict=True)
            return np.array([on_grid(place) for place in places])

        return replay
    from stimuli.score.viewing_conditions import read_gaze

    points = np.array(read_gaze(gaze, may_be_lost=True).points_px)

    def table(frames: int, size: tuple[int, int]) -> NDArray[np.float64]:  # noqa: ARG001
        if len(points) != frames:
            raise StudyError(
                f"{gaze}: must hold one line per frame ({frames} frames, got {len(points)} lines);"
                f" samples with times are read by --gaze {_REPLAY}{gaze}"
            )
        return points

    return table
