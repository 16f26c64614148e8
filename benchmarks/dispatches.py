"""What is dispatched to the GPU: every call of a compute shader, watched from outside."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import moderngl

from pipeline.gl.timer import measure

Dispatch = Callable[[], None]


@contextlib.contextmanager
def _replaced(step: Callable[[str, Dispatch], None]) -> Iterator[None]:
    """Give each dispatch inside to `step`, with its shader's name, which makes it."""
    originals = {name: getattr(moderngl.ComputeShader, name) for name in ("run", "run_indirect")}

    def watched(original: Callable[..., None]) -> Callable[..., None]:
        def dispatch(self: moderngl.ComputeShader, *args: object, **kwargs: object) -> None:
            step(str(self.extra), lambda: original(self, *args, **kwargs))

        return dispatch

    for name, original in originals.items():
        setattr(moderngl.ComputeShader, name, watched(original))
    try:
        yield
    finally:
        for name, original in originals.items():
            setattr(moderngl.ComputeShader, name, original)


@contextlib.contextmanager
def timed_dispatches(ctx: moderngl.Context) -> Iterator[list[tuple[str, float]]]:
    """Time what is dispatched inside: shader and milliseconds, in order."""
    found: list[tuple[str, float]] = []

    def timed(shader: str, dispatch: Dispatch) -> None:
        found.append((shader, measure(ctx, dispatch, repeats=1, warm_up=0).median_ms))

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
