"""Dispatches to the GPU, compute shaders and draws, watched from outside; and a bare copy."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import moderngl

from benchmarks.shared.clock import timed_runs
from pipeline.gl.compute import Launch, Shader
from pipeline.gl.context import describe
from pipeline.gl.shader import ShaderSource

Dispatch = Callable[[], None]


@contextlib.contextmanager
def _replaced(step: Callable[[str, Dispatch], None]) -> Iterator[None]:
    """Give each dispatch and draw inside to `step`, with its shader's name, which makes it."""
    originals = {
        (kind, name): getattr(kind, name)
        for kind, name in ((Launch, "__call__"), (moderngl.VertexArray, "render"))
    }

    def watched(original: Callable[..., None]) -> Callable[..., None]:
        def dispatch(self: Any, *args: object, **kwargs: object) -> None:
            name = str(self.program.extra) if isinstance(self, Launch) else "draw"
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
def timed_dispatches(
    ctx: moderngl.Context, burst: Dispatch | None = None
) -> Iterator[list[tuple[str, float]]]:
    """Time what is dispatched inside: shader and milliseconds, in order.

    By the wall clock on a software renderer, whose time query leaves out most of a draw. On a card
    `burst` runs before each: between two of them it would rest, and its clock would fall.
    """
    found: list[tuple[str, float]] = []
    software = describe(ctx).software

    def timed(shader: str, dispatch: Dispatch) -> None:
        if burst is not None and not software:
            burst()
        timing = timed_runs(ctx, dispatch, repeats=1, warm_up=0)
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


_HEAD = "#version 430\nlayout(local_size_x = 8, local_size_y = 8) in;\n"


class Copy:
    """Copies textures of one size, one dispatch for all."""

    def __init__(self, ctx: moderngl.Context, *formats: str) -> None:
        images, body = [], []
        for k, name in enumerate(formats):
            images.append(f"layout({name}) uniform readonly image2D source_{k};\n")
            images.append(f"layout({name}) uniform writeonly image2D target_{k};\n")
            body.append(f"    imageStore(target_{k}, pixel, imageLoad(source_{k}, pixel));\n")
        text = (
            f"{_HEAD}{''.join(images)}"
            "void main() {\n"
            "    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);\n"
            "    if (any(greaterThanEqual(pixel, imageSize(target_0)))) return;\n"
            f"{''.join(body)}}}\n"
        )
        places = (("benchmarks/shared/dispatches.py", k) for k in range(1, text.count("\n") + 1))
        self._shader = Shader.of(ctx, ShaderSource(text, tuple(places)))

    def __call__(self, *pairs: tuple[moderngl.Texture, moderngl.Texture]) -> None:
        """Copy the first of each pair into the second."""
        given = {f"source_{k}": source for k, (source, _) in enumerate(pairs)}
        given |= {f"target_{k}": target for k, (_, target) in enumerate(pairs)}
        self._shader.run_over(pairs[0][1].size, **given)

    def release(self) -> None:
        """Free the shader."""
        self._shader.release()
