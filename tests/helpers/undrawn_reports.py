"""Reports with fewer figures, which take longest, or none: for tests that do not look at them."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from analysis.report import write_report
from protocols.blocks import Figure


@contextmanager
def undrawn() -> Iterator[None]:
    """Leave every figure out of the reports that are written meanwhile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write_report, "_draw", lambda *_, **__: {})
        yield


@contextmanager
def drawn_wide() -> Iterator[None]:
    """Draw each figure for two columns of text alone, where others look at narrow ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write_report, "_WIDTHS", {"wide": write_report._WIDTHS["wide"]})
        yield


@contextmanager
def undrawn_scores() -> Iterator[None]:
    """Leave every figure out of the reports of scores that are written meanwhile."""
    nothing: dict[str, dict[str, Figure]] = {"scenes": {}, "bands": {}, "time": {}, "scale": {}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stimuli.score.report._draw", lambda *_: nothing)
        yield
