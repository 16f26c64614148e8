"""Reports without their figures, which take longest: for tests that look at numbers and texts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def undrawn() -> Iterator[None]:
    """Leave every figure out of the reports that are written meanwhile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analysis.report.build._draw", lambda *_, **__: [])
        yield


@contextmanager
def undrawn_scores() -> Iterator[None]:
    """Leave every figure out of the reports of scores that are written meanwhile."""
    nothing = {"bars": [], "bands": [], "time": [], "scale": []}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stimuli.score.report._draw", lambda *_: nothing)
        yield
