"""`metamerlab session verify --render`: what draws frames that followed the gaze again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.gl.context import describe, lent_context
from pipeline.pictures.colour_file import read_any
from protocols.errors import StudyError
from protocols.load import load_study
from protocols.manifest import check_manifest, read_manifest
from study_app.cli.pictures.live_renderer import FoveatingStudio
from study_app.cli.terminal import say
from study_app.clips import check_files, read_frame
from study_app.desktop.strip import BLOCK_PX, BLOCKS, read_both_strips
from study_app.live.redraw import TrialDrawer

_PICTURES_HELD = 4


@contextmanager
def open_drawer(protocol: Path, display: str | None, stimuli: Path) -> Iterator[TrialDrawer]:
    """Draw a study's live frames again, off screen.

    Raises
    ------
    StudyError, GLUnavailableError
        If nothing of the study follows the gaze, its stimuli are not there, or nothing draws here.
    """
    study, screen = load_study(protocol, display, recorded=True)
    if not study.stimuli.follows_gaze:
        raise StudyError(
            f"--render: the stimuli of {study.study.name!r} must follow the gaze (they were hashed"
            " beforehand, and shown as they are); leave --render out"
        )
    manifest = read_manifest(stimuli)
    check_manifest(study, manifest)
    check_files(stimuli, manifest)

    @lru_cache(maxsize=_PICTURES_HELD)
    def pixels_of(name: str) -> NDArray[np.uint8]:
        return read_frame(stimuli, manifest.clip(name), 0)

    with lent_context() as ctx:
        here = describe(ctx)
        say(f"drawn again by {here}")
        drawer = TrialDrawer(
            ctx, study, screen, manifest, pixels_of, FoveatingStudio(ctx), (here.name, here.version)
        )
        try:
            yield drawer
        finally:
            drawer.release()


def read_captures(folder: Path) -> dict[int, tuple[Path, NDArray[np.uint8]]]:
    """Read captures of the whole screen with its frame strips, by the strips' number.

    Raises
    ------
    StudyError, InputError
        If there is none, or one is no picture of 8 bits or shows no whole strip.
    """
    found: dict[int, tuple[Path, NDArray[np.uint8]]] = {}
    for path in sorted(folder.glob("*.png")):
        stored = read_any(path).stored
        whole = stored.dtype == np.uint8 and stored.shape[1] >= BLOCKS * BLOCK_PX
        screen = np.asarray(stored[..., :3], np.uint8) if whole else None
        number = read_both_strips(screen[..., 1]) if screen is not None else None
        if screen is None or number is None:
            raise StudyError(
                f"{path}: must show the whole screen with both frame strips of one flip (it does"
                " not); run the session with --strip, capture it pixel by pixel in 8 bits, and"
                " leave torn captures out"
            )
        found[number] = path, screen
    if not found:
        raise StudyError(f"{folder}: must hold captures of the screen (found no .png in it)")
    return found
