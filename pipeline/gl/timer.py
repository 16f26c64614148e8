"""Time that the GPU worked, by its own clock where it has one."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import moderngl

from pipeline.errors import InputError

# Mesa's software renderer answers a compute time query with a nanosecond.
COUNTED_FROM_MS = 1e-3


@dataclass(frozen=True)
class Timing:
    """Milliseconds of repeated runs of one piece of GPU work."""

    gpu_ms: tuple[float, ...]  # the driver's time query; next to zero where it does not count
    wall_ms: tuple[float, ...]  # from an idle GPU to an idle GPU

    @property
    def median_ms(self) -> float:
        """Median by the GPU's clock on hardware; by the wall clock where that reads nothing."""
        gpu = statistics.median(self.gpu_ms)
        return gpu if gpu > COUNTED_FROM_MS else statistics.median(self.wall_ms)


def measure(
    ctx: moderngl.Context, work: Callable[[], None], *, repeats: int = 20, warm_up: int = 3
) -> Timing:
    """Run `work` repeatedly and time each run from idle to idle.

    Parameters
    ----------
    work : callable
        Issues the GPU work; must not hold a time query of its own.
    repeats : int
        How many runs are timed, at least 1.
    warm_up : int
        How many untimed runs come first, at least 0.

    Raises
    ------
    InputError
        If `repeats` or `warm_up` is too small.

    Notes
    -----
    Leaves one query object in the context: moderngl has no call that frees it.
    """
    if repeats < 1 or warm_up < 0:
        raise InputError(
            f"repeats must be at least 1 and warm_up at least 0 (got {repeats} and {warm_up})"
        )
    for _ in range(warm_up):
        work()
    ctx.finish()
    query = ctx.query(time=True)
    gpu_ms: list[float] = []
    wall_ms: list[float] = []
    for _ in range(repeats):
        start_s = time.perf_counter()
        with query:
            work()
        ctx.finish()
        wall_ms.append(1e3 * (time.perf_counter() - start_s))
        gpu_ms.append(query.elapsed / 1e6)
    return Timing(tuple(gpu_ms), tuple(wall_ms))
