"""Time of a fill, pass by pass: `script/bench passes --help`.

`benchmarks.shared.frame_cost` says how passes are timed. Their sum is less than a fill takes, which
also waits for the host.
"""

from __future__ import annotations

import argparse

from rich.console import Console
from rich.table import Table

from benchmarks.fill import MASKS, ON_GPU, TimedFrame
from benchmarks.shared.frame_cost import FrameCost, frame_cost
from pipeline.gl.context import create_context, describe, release_context


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
    bench = TimedFrame(ctx, arguments.size, arguments.mask)
    for method in arguments.method:
        work, _, release = bench.work(method)
        show(method, frame_cost(ctx, work, repeats=arguments.repeats), console)
        release()
    bench.release()
    release_context(ctx)
    return 0


def show(method: str, cost: FrameCost, console: Console) -> None:
    """Print one method's passes."""
    title = f"{method}: {cost.gpu_ms:.2f} ms in passes, {cost.frame_ms:.2f} ms a call (median)"
    host = f"host {cost.host_ms:.2f} ms, {cost.python_calls} Python calls"
    table = Table(title=title, caption=host)
    table.add_column("shader")
    for name in ("dispatches", "ms", "share"):
        table.add_column(name, justify="right")
    for item in cost.passes:
        share = f"{100 * item.least_ms / cost.gpu_ms:.0f} %"
        table.add_row(item.shader, str(item.dispatches), f"{item.least_ms:.2f}", share)
    console.print(table)
