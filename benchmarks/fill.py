"""Time, memory and passes of every fill: `script/bench fill --help`.

Every method is timed in turn with classic push-pull on the same frame (A B A B ...), so
that a ratio holds when the machine's speed drifts; a time is that ratio times the median of
all runs of push-pull on that frame, so that times compare as well. Methods of ours work on
frames that lie on the GPU, as in a batch; OpenCV's and OpenImageIO's on arrays, their
conversions included.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.shared.clock import timed_runs
from benchmarks.shared.dispatches import Copy, dispatches_of
from benchmarks.shared.output import PagePart, conditions, file_to_write, write_record
from pipeline.frame import SourceFrame, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.context import create_context, describe, release_context
from pipeline.gl.texture import create_texture, texture_from
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.methods.registry import create_method
from pipeline.pushpull.gpu import PushPullPass, WeightedPullPushPass
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.settings import MetamericSettings
from pipeline.transport.gpu import TransportPass
from pipeline.transport.reference import TransportSettings
from pipeline.warp.gpu import WarpPass

PART = PagePart("fill table")
Z_NEAR_M = 2.0
SEED = 1
METAMERIC = {
    "metameric": MetamericSettings(),
    "metameric 3 levels": MetamericSettings(levels=3),
    "metameric 5 levels": MetamericSettings(levels=5),
}
ON_GPU = (*METAMERIC, "coherence-transport", "push-pull-depth")
ON_GPU += ("push-pull", "weighted-pull-push", "warp", "copy")
ON_CPU = ("telea", "navier-stokes", "oiio-push-pull", "background-extension")
MASKS = {  # name: (share of the frame, hole width px at 1024, what)
    "thin": (0.05, 8, "5 % of the pixels, strips of 8 px at 1024"),
    "wide": (0.15, 80, "15 % of the pixels, strips of 80 px at 1024"),
}


@dataclass(frozen=True)
class Timing:
    """One method on one frame."""

    method: str
    edge_px: int
    mask: str
    median_ms: float  # its ratio times the frame's median of push-pull
    to_push_pull: float  # median of the ratios, pair by pair
    to_copy: float
    passes: int | None  # draws and dispatches
    bytes_per_pixel: float | None  # held on the GPU beyond input and output


def masked_frame(edge_px: int, mask: str) -> WarpedFrame:
    """A textured ground at 10 m behind wavy strips at 3 m, a hole at each strip's right."""
    share, width_1024, _ = MASKS[mask]
    width = max(2.0, width_1024 * edge_px / 1024)
    y, x = np.mgrid[:edge_px, :edge_px]
    phase = (x + 0.03 * edge_px * np.sin(y * 10.0 / edge_px)) % (width / share)
    hole = phase < width
    front = phase > 0.8 * width / share
    rng = np.random.default_rng(0)
    colour = rng.random((edge_px, edge_px, 3), np.float32)
    depth_m = np.where(front, 3.0, 10.0).astype(np.float32)
    flow_px = np.zeros((edge_px, edge_px, 2), np.float32)
    flow_px[..., 0] = np.where(front, -1.3 * width, -0.3 * width)
    return WarpedFrame(colour, depth_m, hole, flow_px)


def discs_over_ground(edge_px: int) -> tuple[SourceFrame, np.ndarray]:
    """Twelve discs over a receding ground, and the motion under a step to the side."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:edge_px, :edge_px] + 0.5
    depth_m = 6 - 3 * y / edge_px
    for centre_x, centre_y, size in rng.random((12, 3)) * (edge_px, edge_px, 0.1 * edge_px):
        depth_m[(x - centre_x) ** 2 + (y - centre_y) ** 2 < size**2] = 1.5 + rng.random()
    flow_px = 0.04 * edge_px / depth_m[..., None] * (1, 0.3)
    colour = rng.random((edge_px, edge_px, 3), np.float32)
    return SourceFrame(colour, depth_m.astype(np.float32)), flow_px.astype(np.float32)


class TimedFrame:
    """One frame on the GPU and the methods to run on it."""

    def __init__(self, ctx: moderngl.Context, edge_px: int, mask: str) -> None:
        self.ctx = ctx
        self.edge_px = edge_px
        self.mask = mask
        self.frame = masked_frame(edge_px, mask)
        self.size = (edge_px, edge_px)
        self.textures = FrameTextures.of(ctx, self.frame)
        self.filled = create_texture(ctx, self.size, "rgba32f")
        self.push_pull = PushPullPass(ctx, self.size)
        self.copier = Copy(ctx, "rgba32f")
        self._push_pull_ms: list[float] = []

    def run_push_pull(self) -> None:
        self.push_pull(self.textures.colour, self.filled)

    def run_copy(self) -> None:
        self.copier((self.textures.colour, self.filled))

    def time_all(self, methods: Iterable[str], repeats: int) -> list[Timing]:
        """Time methods one after another, and put all on one clock."""
        timings = [self._time(method, repeats) for method in methods]
        push_pull_ms = statistics.median(self._push_pull_ms)
        return [replace(t, median_ms=round(t.to_push_pull * push_pull_ms, 3)) for t in timings]

    def _time(self, method: str, repeats: int) -> Timing:
        work, held, done = self.work(method)
        passes = len(dispatches_of(work)) or None
        ratios, copies = [], []
        for turn in range(repeats + 1):
            mine = self._once(work)
            rival = self._once(self.run_push_pull)
            copy = self._once(self.run_copy)
            if turn:  # the first is a warm-up
                self._push_pull_ms.append(rival)
                ratios.append(mine / rival)
                copies.append(mine / copy)
        done()
        return Timing(
            method=method,
            edge_px=self.edge_px,
            mask=self.mask,
            median_ms=float("nan"),  # until the frame's other methods have run
            to_push_pull=round(statistics.median(ratios), 3),
            to_copy=round(statistics.median(copies), 3),
            passes=passes,
            bytes_per_pixel=None if held is None else round(held / self.edge_px**2, 2),
        )

    def _once(self, work: Callable[[], None]) -> float:
        return timed_runs(self.ctx, work, repeats=1, warm_up=0).median_ms

    def work(self, method: str) -> tuple[Callable[[], None], int | None, Callable[[], None]]:
        """Work to time, the bytes it holds, and how to free it."""
        if method in METAMERIC:
            metameric = MetamericPass(self.ctx, self.size, METAMERIC[method])

            def fill() -> None:
                metameric(self.textures, z_near_m=Z_NEAR_M, seed=SEED)

            return fill, metameric.held_bytes, metameric.release
        if method == "coherence-transport":
            transport = TransportPass(self.ctx, self.size, TransportSettings())
            return (
                lambda: transport(self.textures, z_near_m=Z_NEAR_M),
                transport.held_bytes,
                transport.release,
            )
        if method == "push-pull-depth":
            guided = GuidedBasePass(self.ctx, self.size, gamma=MetamericSettings.gamma)
            return (
                lambda: guided(self.textures.colour, self.textures.depth_m, Z_NEAR_M),
                guided.held_bytes,
                guided.release,
            )
        if method == "push-pull":
            return self.run_push_pull, self.push_pull.held_bytes, _nothing
        if method == "copy":
            return self.run_copy, 0, _nothing
        if method == "weighted-pull-push":
            weighted = WeightedPullPushPass(self.ctx, self.size)
            return (
                lambda: weighted(self.textures.colour, self.filled),
                weighted.held_bytes,
                weighted.release,
            )
        if method == "warp":
            return self._warp()
        return self._on_cpu(method)

    def _warp(self) -> tuple[Callable[[], None], int, Callable[[], None]]:
        source, flow_px = discs_over_ground(self.edge_px)
        textures = (
            texture_from(self.ctx, np.dstack([source.colour, source.depth_m]), "rgba32f"),
            texture_from(self.ctx, source.depth_m, "r32f"),
            texture_from(self.ctx, flow_px, "rg32f"),
        )
        warp = WarpPass(self.ctx, self.size)
        warped = FrameTextures.create(self.ctx, self.size)

        def release() -> None:
            for item in (*textures, warp, warped):
                item.release()

        return lambda: warp(*textures, warped), warp.held_bytes, release

    def _on_cpu(self, method: str) -> tuple[Callable[[], None], None, Callable[[], None]]:
        if method in ("telea", "navier-stokes"):
            flags = cv2.INPAINT_TELEA if method == "telea" else cv2.INPAINT_NS
            bytes_ = (self.frame.colour * 255).astype(np.uint8)
            mask = self.frame.hole.astype(np.uint8)
            return lambda: _discard(cv2.inpaint(bytes_, mask, 3, flags)), None, _nothing
        filler = create_method(method, self.ctx)
        return lambda: _discard(filler.fill(self.frame, SEED)), None, filler.release

    def release(self) -> None:
        for item in (self.textures, self.filled, self.push_pull):
            item.release()
        self.copier.release()


def _nothing() -> None:
    pass


def _discard(_result: NDArray[Any]) -> None:
    pass


def show(timings: list[Timing], console: Console) -> None:
    """Print one table per mask and size."""
    groups = dict.fromkeys((t.mask, t.edge_px) for t in timings)
    for mask, edge_px in groups:
        table = Table(title=f"{edge_px} x {edge_px} px, mask {mask}: {MASKS[mask][2]}")
        table.add_column("method")
        for name in ("ms", "to push-pull", "to a copy", "passes", "B/px held"):
            table.add_column(name, justify="right")
        for t in timings:
            if (t.mask, t.edge_px) == (mask, edge_px):
                table.add_row(
                    t.method,
                    f"{t.median_ms:.2f}",
                    f"{t.to_push_pull:.2f}",
                    f"{t.to_copy:.2f}",
                    "" if t.passes is None else str(t.passes),
                    "" if t.bytes_per_pixel is None else f"{t.bytes_per_pixel:.1f}",
                )
        console.print(table)


def markdown(timings: list[Timing]) -> str:
    """Tabulate the ratios to push-pull: a row per method, a column per mask and size."""
    columns = list(dict.fromkeys((t.mask, t.edge_px) for t in timings))
    found = {(t.method, t.mask, t.edge_px): t for t in timings}
    head = [f"{mask}, {edge}²" for mask, edge in columns]
    lines = [
        "| method, time to push-pull's | " + " | ".join(head) + " | passes at 1024² | B/px held |",
        "| --- |" + " ---: |" * (len(columns) + 2),
    ]
    for method in dict.fromkeys(t.method for t in timings):
        cells = [found.get((method, *column)) for column in columns]
        ratios = ["" if t is None else f"{t.to_push_pull:.2f}" for t in cells]
        at_1024 = next((t for t in cells if t is not None and t.edge_px == 1024), None)
        passes = str(at_1024.passes) if at_1024 and at_1024.passes else ""
        held = f"{at_1024.bytes_per_pixel:.0f}" if at_1024 and at_1024.bytes_per_pixel else ""
        lines.append(f"| {method} | " + " | ".join([*ratios, passes, held]) + " |")
    return "\n".join(lines)


def plot(timings: list[Timing], target: Path) -> None:
    """Draw time against pixels, a line per method, on the thin mask."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.5), layout="constrained")
    colours = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#555555"]
    markers = "osD^vPX"
    methods = ("metameric", "push-pull", "push-pull-depth", "warp", "telea", "coherence-transport")
    for method, colour, marker in zip((*methods, "copy"), colours, markers, strict=True):
        rows = [t for t in timings if t.method == method and t.mask == "thin"]
        if rows:
            axes.plot(
                [t.edge_px**2 / 1e6 for t in rows],
                [t.median_ms for t in rows],
                color=colour,
                marker=marker,
                label=method,
            )
    axes.set(xscale="log", yscale="log", xlabel="pixels of a frame", ylabel="ms per frame")
    edges = sorted({t.edge_px for t in timings})
    axes.set_xticks([e**2 / 1e6 for e in edges], [f"{e} x {e}" for e in edges], minor=False)
    axes.set_xticks([], minor=True)
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend(frameon=False, ncols=2)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target)
    pyplot.close(figure)


def main(argv: list[str]) -> int:
    """Time the methods, print tables, and write JSON and a plot if asked."""
    parser = argparse.ArgumentParser(prog="script/bench fill", description=__doc__)
    parser.add_argument("--size", type=int, nargs="+", default=[512, 1024, 2048], metavar="EDGE")
    parser.add_argument("--method", nargs="+", choices=ON_GPU + ON_CPU, default=ON_GPU + ON_CPU)
    parser.add_argument("--mask", nargs="+", choices=list(MASKS), default=list(MASKS))
    parser.add_argument("--repeats", type=int, default=9, help="timed runs of each (default 9)")
    parser.add_argument(
        "--json", type=file_to_write, help="write the numbers, device and versions there"
    )
    parser.add_argument("--docs", type=PART.page, help="document whose table is replaced")
    parser.add_argument(
        "--plot", type=file_to_write, help="draw time against pixels there (.svg, .png)"
    )
    arguments = parser.parse_args(argv)
    console = Console()
    ctx = create_context()
    renderer = describe(ctx)
    console.print(f"renderer: {renderer}")
    timings: list[Timing] = []
    for mask in arguments.mask:
        for edge_px in sorted(arguments.size):
            bench = TimedFrame(ctx, edge_px, mask)
            what = f"{edge_px} px, {mask}"
            methods = track(arguments.method, what, console=console, transient=True)
            timings += bench.time_all(methods, arguments.repeats)
            bench.release()
    show(timings, console)
    if arguments.json is not None:
        record = {
            **conditions("numpy", "opencv-python-headless"),
            "renderer": asdict(renderer),
            "repeats": arguments.repeats,
            "masks": {name: what for name, (_, _, what) in MASKS.items()},
            "timings": [asdict(t) for t in timings],
        }
        write_record(arguments.json, record)
        console.print(f"wrote {arguments.json}")
    if arguments.docs is not None:
        PART.replace(arguments.docs, markdown(timings))
    if arguments.plot is not None:
        plot(timings, arguments.plot)
        console.print(f"wrote {arguments.plot}")
    release_context(ctx)
    return 0
