"""Clock of a graphics card, which rests at a fraction of its speed: a probe that tells it."""

from __future__ import annotations

import shutil
import statistics
import subprocess
import time
from collections.abc import Callable
from typing import NamedTuple

import moderngl

from pipeline.gl.context import describe
from pipeline.gl.shader import ShaderSource, compile_source
from pipeline.gl.texture import create_texture

SAME = 1.05
"""Largest ratio of two probes that one clock gives."""
STILL = 1.02
"""The same of probes in a row, after which a card has warmed up."""
PROBES = 3
MOST_UP_S = 2.0
NVIDIA = ("clocks.sm", "clocks.mem", "clocks.max.sm", "clocks.max.mem")
CHAIN = """#version 430
layout(local_size_x = 1) in;
layout(r32f) uniform writeonly image2D target;
void main() {
    float x = 1.0;
    for (int k = 0; k < 100000; ++k) x = fma(x, 0.999, 0.001);
    imageStore(target, ivec2(0), vec4(x));
}
"""


class RunTimes(NamedTuple):
    """Milliseconds of runs by the driver's time query and, from idle to idle, by the wall clock."""

    gpu_ms: tuple[float, ...]
    wall_ms: tuple[float, ...]

    @property
    def median_ms(self) -> float:
        """Median by the GPU's clock, or the wall's where Mesa answers with a nanosecond."""
        gpu = statistics.median(self.gpu_ms)
        return gpu if gpu > 1e-3 else statistics.median(self.wall_ms)


def timed_runs(
    ctx: moderngl.Context, work: Callable[[], None], *, repeats: int, warm_up: int
) -> RunTimes:
    """Run `work` untimed, then time each run; it must hold no time query of its own."""
    for _ in range(warm_up):
        work()
    ctx.finish()
    query = ctx.query(time=True)  # one a call: moderngl cannot free it
    gpu_ms, wall_ms = [], []
    for _ in range(repeats):
        start_s = time.perf_counter()
        with query:
            work()
        ctx.finish()
        wall_ms.append(1e3 * (time.perf_counter() - start_s))
        gpu_ms.append(query.elapsed / 1e6)
    return RunTimes(tuple(gpu_ms), tuple(wall_ms))


class Clock:
    """One work group with a chain of 100,000 multiply-adds, each of which waits for the last.

    Neither memory nor the number of cores counts: it takes as long as the clock of the card says.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        places = tuple(("benchmarks/shared/clock.py", k) for k in range(CHAIN.count("\n") + 1))
        self._program = compile_source(ctx, ShaderSource(CHAIN, places))
        self._target = create_texture(ctx, (1, 1), "r32f")
        self._software = describe(ctx).software

    def burst(self) -> None:
        """Keep the card at work, so that its clock does not fall; nothing records or counts it."""
        self._target.bind_to_image(0, read=False, write=True)
        self._program.run()

    def probe_ms(self) -> float:
        """Return how long the chain takes, the least of a few; by the wall on a processor."""
        timing = timed_runs(self._ctx, self.burst, repeats=PROBES, warm_up=1)
        return min(timing.wall_ms if self._software else timing.gpu_ms)

    def rise(self, work: Callable[[], object], least_s: float) -> float:
        """Work for `least_s`, and then until probes stand still; return the last frame's seconds.

        A processor's clock is not the card's: there nothing is waited for.
        """
        start_s = frame_s = time.perf_counter()
        taken_s = 0.0
        probes: list[float] = []
        while True:
            work()
            self._ctx.finish()
            taken_s, frame_s = time.perf_counter() - frame_s, time.perf_counter()
            if frame_s - start_s < least_s:
                continue
            probes = [*probes, self.probe_ms()][-PROBES:]
            still = len(probes) == PROBES and max(probes) <= STILL * min(probes)
            if still or self._software or frame_s - start_s > MOST_UP_S:
                return taken_s
            frame_s = time.perf_counter()

    def same(self, *probes_ms: float) -> bool:
        """Return True if these probes are of one clock; a processor's are not judged."""
        return self._software or max(probes_ms) <= SAME * min(probes_ms)

    def release(self) -> None:
        """Free program and target."""
        self._program.release()
        self._target.release()


def card_clocks_mhz() -> dict[str, float] | None:
    """Return the clocks that NVIDIA's own program names; None where there is none, or no number."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return None
    asked = [program, f"--query-gpu={','.join(NVIDIA)}", "--format=csv,noheader,nounits"]
    try:
        said = subprocess.run(asked, capture_output=True, text=True, timeout=10, check=True).stdout
        first = said.splitlines()[0].split(",")
        return dict(zip(NVIDIA, map(float, first), strict=True))
    except (OSError, subprocess.SubprocessError, ValueError, IndexError):
        return None
