"""Where the time of a fill goes, pass by pass: `script/bench passes --help`.

Every dispatch is timed by itself, from an idle GPU to an idle GPU, and of all runs of a
dispatch the least counts: what other programs take is no time of its. Their sum is less than
a fill takes, which also waits for the host.
"""

from __future__ import annotations

import argparse
import statistics
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from benchmarks.dispatches import timed_dispatches
from benchmarks.fill import MASKS, ON_GPU, Bench
from pipeline.gl.context import create_context, describe, release_context
from pipeline.gl.timer import measure


@dataclass(frozen=True)
class Pass:
    """All dispatches of one shader in a call."""

    shader: str
    dispatches: int
    least_ms: float


def time_passes(bench: Bench, method: str, repeats: int) -> tuple[list[Pass], float]:
    """Time a method's passes, in the order of their first dispatch, and whole calls (median)."""
    work, _, release = bench.work(method)
    calls: list[list[tuple[str, float]]] = []
    whole_ms: list[float] = []
    for turn in range(repeats + 1):
        with timed_dispatches(bench.ctx) as found:
            work()
        whole = measure(bench.ctx, work, repeats=1, warm_up=0).median_ms
        if turn:  # the first is a warm-up
            calls.append(found)
            whole_ms.append(whole)
    release()
    shaders = [shader for shader, _ in calls[0]]
    times = [[ms for _, ms in call] for call in calls]
    least = [min(runs) for runs in zip(*times, strict=True)]
    passes = []
    for name in dict.fromkeys(shaders):
        own = [ms for shader, ms in zip(shaders, least, strict=True) if shader == name]
        passes.append(Pass(name, len(own), sum(own)))
    return passes, statistics.median(whole_ms)


def main(argv: list[str]) -> int:
    """Time the passes of each method and print a table of them."""
    parser = argparse.ArgumentParser(prog="script/bench passes", description=__doc__)
    parser.add_argument("--size", type=int, default=1024, metavar="EDGE")
    parser.add_argument("--mask", choices=list(MASKS), default="thin")
    parser.add_argument("--method", nargs="+", choices=ON_GPU, default=["metameric", "push-pull"])
    parser.add_argument("--repeats", type=int, default=40, help="calls of each (default 40)")
    arguments = parser.parse_args(argv)
    console = Console()
    ctx = create_context()
    console.print(f"renderer: {describe(ctx)}")
    bench = Bench(ctx, arguments.size, arguments.mask)
    for method in arguments.method:
        show(method, *time_passes(bench, method, arguments.repeats), console)
    bench.release()
    release_context(ctx)
    return 0


def show(method: str, passes: list[Pass], whole_ms: float, console: Console) -> None:
    """Print one method's passes."""
    total = sum(item.least_ms for item in passes)
    table = Table(title=f"{method}: {total:.2f} ms in passes, {whole_ms:.2f} ms a call (median)")
    table.add_column("shader")
    for name in ("dispatches", "ms", "share"):
        table.add_column(name, justify="right")
    for item in passes:
        share = f"{100 * item.least_ms / total:.0f} %"
        table.add_row(item.shader, str(item.dispatches), f"{item.least_ms:.2f}", share)
    console.print(table)
