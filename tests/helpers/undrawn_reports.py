"""Reports with fewer figures, which take longest, or none: for tests that do not look at them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from analysis.report import build


@contextmanager
def undrawn() -> Iterator[None]:
    """Leave every figure out of the reports that are written meanwhile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "_draw", lambda *_, **__: [])
        yield


@contextmanager
def drawn_narrow() -> Iterator[None]:
    """Draw each figure for one column of text alone, where others look at the wide ones."""
    draw, widths = build._draw, {"narrow": build._WIDTHS["narrow"]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "_WIDTHS", widths)
        patch.setattr(
            build, "_draw", lambda *args, **how: [{"wide": "", **one} for one in draw(*args, **how)]
        )
        yield


@contextmanager
def undrawn_scores() -> Iterator[None]:
    """Leave every figure out of the reports of scores that are written meanwhile."""
    nothing = {"scenes": [], "bands": [], "time": [], "scale": []}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stimuli.score.report._draw", lambda *_: nothing)
        yield
