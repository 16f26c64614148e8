"""Dispatches to the GPU: every call of a compute shader, and every draw, watched from outside."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import moderngl

from pipeline.gl.context import describe, measure

Dispatch = Callable[[], None]


@contextlib.contextmanager
def _replaced(step: Callable[[str, Dispatch], None]) -> Iterator[None]:
    """Give each dispatch and draw inside to `step`, with its shader's name, which makes it."""
    originals = {
        (kind, name): getattr(kind, name)
        for kind, name in (
            (moderngl.ComputeShader, "run"),
            (moderngl.ComputeShader, "run_indirect"),
            (moderngl.VertexArray, "render"),
        )
    }

    def watched(original: Callable[..., None]) -> Callable[..., None]:
        def dispatch(self: Any, *args: object, **kwargs: object) -> None:
            name = "draw" if isinstance(self, moderngl.VertexArray) else str(self.extra)
            step(name, lambda: original(self, *args, **kwargs))

        return dispatch

    for (kind, name), original in originals.items():
        setattr(kind, name, watched(original))
    try:
        yield
    finally:
        for (kind, name), original in originals.items():
            setattr(kind, name, original)


@contextlib.contextmanager
def timed_dispatches(ctx: moderngl.Context) -> Iterator[list[tuple[str, float]]]:
    """Time what is dispatched inside: shader and milliseconds, in order.

    By the wall clock on a software renderer, whose time query leaves out most of a draw.
    """
    found: list[tuple[str, float]] = []
    software = describe(ctx).software

    def timed(shader: str, dispatch: Dispatch) -> None:
        timing = measure(ctx, dispatch, repeats=1, warm_up=0)
        found.append((shader, timing.wall_ms[0] if software else timing.median_ms))

    with _replaced(timed):
        yield found


def dispatches_of(work: Callable[[], object]) -> list[str]:
    """Return the shaders that a call dispatches, in order."""
    found: list[str] = []

    def listed(shader: str, dispatch: Dispatch) -> None:
        found.append(shader)
        dispatch()

    with _replaced(listed):
        work()
    return found


@contextlib.contextmanager
def nothing_dispatched() -> Iterator[None]:
    """Leave out what is dispatched inside: what remains is the host's own work."""
    with _replaced(lambda _shader, _dispatch: None):
        yield
