"""Cost of a frame: of the GPU, pass by pass, and of its host."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import moderngl

from benchmarks.shared.clock import Clock, timed_runs
from benchmarks.shared.dispatches import nothing_dispatched, timed_dispatches
from pipeline.gl.context import describe

Work = Callable[[], object]
CLOCK_UP_S = 0.2  # graphics cards rest at a sixth of their clock, and take this long to rise
MOST_S = 2.0  # of repeats of one frame; one runs in any case
HOST_RUNS = 9
TRIES = 3  # of a frame whose clock changed meanwhile


@dataclass(frozen=True)
class Pass:
    """All dispatches of one shader in a call."""

    shader: str
    dispatches: int
    least_ms: float


@dataclass(frozen=True)
class FrameCost:
    """Cost of one frame.

    Attributes
    ----------
    passes : tuple of Pass
        In the order of their first dispatch; each is timed by itself, from an idle GPU to an idle
        GPU, by the GPU's own clock where it has one. Of all runs of a dispatch the least counts:
        what other programs take is no time of its.
    frame_ms : float
        From an idle GPU to an idle GPU, median by the wall clock.
    host_ms : float
        Until the host has issued all of it, median. A software renderer computes inside the call:
        there the dispatches are left out.
    python_calls : int
        Functions that Python calls for it, its own and those of libraries.
    probes_ms : tuple of float
        Of the card's clock, before and after; see `Clock`.
    """

    passes: tuple[Pass, ...]
    frame_ms: float
    host_ms: float
    python_calls: int
    probes_ms: tuple[float, ...]

    def with_least(self, other: FrameCost) -> FrameCost:
        """Return the least of two measurements of one frame."""
        passes = [
            replace(one, least_ms=min(one.least_ms, again.least_ms))
            for one, again in zip(self.passes, other.passes, strict=True)
        ]
        return FrameCost(
            tuple(passes),
            min(self.frame_ms, other.frame_ms),
            min(self.host_ms, other.host_ms),
            self.python_calls,
            (*self.probes_ms, *other.probes_ms),
        )

    @property
    def gpu_ms(self) -> float:
        """Sum of the passes."""
        return sum(item.least_ms for item in self.passes)

    @property
    def dispatches(self) -> int:
        """Draws and dispatches."""
        return sum(item.dispatches for item in self.passes)


def frame_cost(ctx: moderngl.Context, work: Work, *, repeats: int, clock: Clock) -> FrameCost:
    """Measure one frame's work after a warm-up: `repeats` times, fewer where one takes long.

    Where the card's clock changed meanwhile it is measured again, a few times at most.
    """
    for _ in range(TRIES):
        runs = max(1, min(repeats, int(MOST_S / clock.rise(work, CLOCK_UP_S))))
        before_ms = clock.probe_ms()
        passes = time_passes(ctx, work, runs, clock.burst)
        frame_ms = statistics.median(timed_runs(ctx, work, repeats=runs, warm_up=0).wall_ms)  # type: ignore[arg-type]
        probes_ms = before_ms, clock.probe_ms()
        if clock.same(*probes_ms):
            break
    return FrameCost(passes, frame_ms, _host_ms(ctx, work), python_calls(ctx, work), probes_ms)


def time_passes(
    ctx: moderngl.Context, work: Work, repeats: int, burst: Callable[[], None] | None = None
) -> tuple[Pass, ...]:
    """Time what a call dispatches, shader by shader; `burst` keeps the card at work between."""
    calls: list[list[tuple[str, float]]] = []
    for _ in range(repeats):
        with timed_dispatches(ctx, burst) as found:
            work()
        calls.append(found)
    shaders = [shader for shader, _ in calls[0]]
    least = [min(ms for _, ms in runs) for runs in zip(*calls, strict=True)]
    passes = []
    for name in dict.fromkeys(shaders):
        own = [ms for shader, ms in zip(shaders, least, strict=True) if shader == name]
        passes.append(Pass(name, len(own), sum(own)))
    return tuple(passes)


def _host_ms(ctx: moderngl.Context, work: Work) -> float:
    if describe(ctx).software:
        with nothing_dispatched():
            return statistics.median(_until_return_ms(ctx, work) for _ in range(HOST_RUNS))
    return statistics.median(_until_return_ms(ctx, work) for _ in range(HOST_RUNS))


def _until_return_ms(ctx: moderngl.Context, work: Work) -> float:
    ctx.finish()
    start_s = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - start_s)


def python_calls(ctx: moderngl.Context, work: Work) -> int:
    """Count the functions that Python calls, its own and those of libraries."""
    count = -1  # the call that ends the counting is ours

    def counted(_frame: object, event: str, _argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(counted)
    try:
        work()
    finally:
        sys.setprofile(before)
    ctx.finish()
    return count
