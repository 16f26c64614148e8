"""Time and memory of foveated pictures against a copy and a blur: `script/bench foveate --help`.

Conditions take turns, so that what else the machine does meets all alike; ratios are turn by turn.
What the CPU does, a software renderer's work as well, is counted in CPU time, over all cores: what
other programs take is no time of its.
"Held" is what a new gaze at the same picture takes, beside the blur that is held alike; "new seed"
is the noise that a seed's first frame waits for.
Analysis and synthesis are told apart by the passes' own times (Beyond Blur's Fig. 8).
odak's `gen_metamer` and radial blur run beside them on the CPU, where odak is installed.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.util
import itertools
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from operator import truediv
from typing import Any, Self

import moderngl
import numpy as np

from benchmarks.shared import foveate_report as report
from benchmarks.shared.clock import timed_runs
from benchmarks.shared.dispatches import Copy, dispatches_of
from benchmarks.shared.foveate_report import Line
from benchmarks.shared.frame_cost import time_passes
from benchmarks.shared.output import (
    PagePart,
    busy_words,
    conditions,
    file_to_write,
    load_average,
    write_record,
)
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Flat
from pipeline.foveation.gpu import FoveationPass
from pipeline.gl.context import (
    GraphicsDriver,
    create_context,
    describe,
    release_context,
)
from pipeline.gl.texture import create_texture, texture_from

PART = PagePart("foveation times")
EDGES = (512, 1024, 2048, 4096)
CONDITIONS = (
    "blur", "metamer", "eidolon", "warped-metamer", "noise-enhanced", "contrast-enhanced",
)  # fmt: skip
LARGEST_TWIN_EDGE = 1024  # beyond it the numpy twin of what the GPU does is not timed
LARGEST_SLOW_EDGE = 4096  # beyond it what only numpy makes takes many minutes
LARGEST_ODAK_EDGE = 1024
HELD = ", held"  # of a picture that was analysed before
NEW_SEED = ", new seed"  # what it makes, before the first frame
SEEDED = ("metamer", "eidolon")
PULL = "pull.comp.glsl"  # the shader of the analysis
SHARED_RUNS = 3  # of which the least time of each dispatch counts


def picture(edge_px: int) -> np.ndarray:
    """A random picture with some structure, (H, W, 3) in [0, 1]."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:edge_px, :edge_px] / edge_px
    waves = 0.5 + 0.25 * np.sin(40 * x * y) + 0.1 * rng.standard_normal((edge_px, edge_px))
    return np.repeat(waves.clip(0, 1)[..., None], 3, axis=2).astype(np.float32)


@dataclass(frozen=True)
class Turns:
    """Milliseconds of each work, turn by turn, by the wall clock and of the CPU."""

    wall: dict[str, list[float]]
    cpu: dict[str, list[float]]
    software: bool

    @classmethod
    def of(
        cls, ctx: moderngl.Context, works: Mapping[str, Callable[[], None]], repeats: int
    ) -> Self:
        """Do all works in turn, once to warm up and then so often."""
        found = cls({name: [] for name in works}, {name: [] for name in works},
                    describe(ctx).software)  # fmt: skip
        for work in works.values():
            timed_runs(ctx, work, repeats=1, warm_up=1)
        for _ in range(repeats):
            for name, work in works.items():
                cpu_s = time.process_time()
                found.wall[name].append(timed_runs(ctx, work, repeats=1, warm_up=0).median_ms)
                found.cpu[name].append(1e3 * (time.process_time() - cpu_s))
        return found

    def line(self, edge_px: int, name: str) -> Line:
        """Return the times of a work, and their ratios to the blur and the copy that are there."""
        compared = self.cpu if self.software else self.wall
        # Turn by turn: then a ratio holds while the machine's speed drifts.
        blurs, copies = (
            statistics.median(map(truediv, compared[name], compared[other]))
            if other in compared
            else None
            for other in ("blur" + HELD if name.endswith(HELD) else "blur", "copy")
        )
        cpu_ms = statistics.median(self.cpu[name]) if self.software else None
        times = self.wall[name]
        return Line(
            edge_px, name, "gpu", statistics.median(times), min(times), cpu_ms, blurs, copies
        )


def time_gpu(
    ctx: moderngl.Context,
    edge_px: int,
    width_deg: float,
    repeats: int,
    conditions: Sequence[str] = CONDITIONS,
) -> list[Line]:
    """Time a copy and what the GPU makes, of one size, in turn; a blur is always among it."""
    shown = picture(edge_px)
    size = (edge_px, edge_px)
    source = texture_from(ctx, np.dstack([shown, shown[..., :1]]), "rgba32f")
    target = create_texture(ctx, size, "rgba32f")
    copy = Copy(ctx, "rgba32f")

    made: dict[str, FoveationPass] = {}
    foveators = []
    for name in dict.fromkeys(("blur", *conditions)):
        foveator = Foveator(size, viewing=Flat(width_deg), method=name, ctx=ctx)
        if foveator.passes is not None:
            made[name] = foveator.passes
            foveators.append(foveator)
    middle = (edge_px / 2, edge_px / 2)
    works: dict[str, Callable[[], None]] = {"copy": lambda: copy((source, target))}
    for name, passes in made.items():
        works[name] = lambda passes=passes: passes(source, target, middle)  # type: ignore[misc]
    beside = itertools.count()
    for name, passes in made.items():
        # Analysed once. The gaze moves and the field of displacements rests, as with a live eye.
        works[name + HELD] = lambda passes=passes: passes.show(  # type: ignore[misc]
            target, (middle[0] + next(beside) % 8, middle[1]), field_gaze_px=middle
        )
    turns = Turns.of(ctx, works, repeats)
    line = partial(turns.line, edge_px)
    lines = [replace(line("copy"), passes=1, held_bytes=0)]
    for name, passes in made.items():
        found_line = line(name)
        share = analysis_share(ctx, works[name], min(repeats, SHARED_RUNS))
        lines.append(
            replace(
                found_line,
                analysis_ms=share * found_line.counted_ms,
                synthesis_ms=(1 - share) * found_line.counted_ms,
                passes=len(dispatches_of(works[name])),
                held_bytes=passes.held_bytes,
                analysis_bytes=sum(chain.held_bytes for chain in passes.chains),
            )
        )
    lines += [
        replace(
            line(name + HELD),
            passes=len(dispatches_of(works[name + HELD])),
            held_bytes=passes.held_bytes,
        )
        for name, passes in made.items()
    ]
    lines += [new_seed(ctx, edge_px, name, made[name], repeats) for name in SEEDED if name in made]
    for foveator in foveators:
        foveator.release()
    for thing in (source, target, copy):
        thing.release()
    return lines


def new_seed(
    ctx: moderngl.Context, edge_px: int, name: str, passes: FoveationPass, repeats: int
) -> Line:
    """Time what a new seed makes: noise, or the noise of a field."""
    seeds = itertools.count(1)

    def work() -> None:
        passes.set_seed(next(seeds))

    line = Turns.of(ctx, {name + NEW_SEED: work}, repeats).line(edge_px, name + NEW_SEED)
    return replace(line, passes=len(dispatches_of(work)), held_bytes=passes.held_bytes)


def analysis_share(ctx: moderngl.Context, work: Callable[[], None], repeats: int) -> float:
    """Share of a call's time that its pulls take, by the least time of each dispatch."""
    passes = time_passes(ctx, work, repeats)
    pulls = sum(item.least_ms for item in passes if item.shader.endswith(PULL))
    return pulls / sum(item.least_ms for item in passes)


def time_numpy(edge_px: int, width_deg: float, names: list[str]) -> list[Line]:
    """Time what numpy makes."""
    shown = picture(edge_px)
    lines = []
    for name in names:
        foveator = Foveator((edge_px, edge_px), viewing=Flat(width_deg), method=name)
        lines.append(
            on_cpu(edge_px, name, "numpy", partial(foveator, shown, (edge_px / 2, edge_px / 2)))
        )
    return lines


def time_odak(edge_px: int) -> list[Line]:
    """Time odak's metamer and blur on the CPU; nothing where it is not installed."""
    odak = perception()
    if odak is None:
        return []
    import torch

    image = torch.from_numpy(picture(edge_px).transpose(2, 0, 1)[None].copy())
    loss = odak.MetamerMSELoss(n_pyramid_levels=5)
    blur = odak.RadiallyVaryingBlur()
    works = {
        "gen_metamer": lambda: loss.gen_metamer(image, gaze=[0.5, 0.5]),
        "RadiallyVaryingBlur": lambda: blur.blur(image, centre=(0.5, 0.5)),
    }
    lines = []
    for name, work in works.items():
        lines.append(on_cpu(edge_px, name, "odak", work))
    return lines


def on_cpu(edge_px: int, name: str, where: str, work: Callable[[], object]) -> Line:
    """Time what the CPU does: twice after a warm-up, or once where it takes long."""
    times, cpu_times = [], []
    for _ in range(3 if edge_px <= LARGEST_TWIN_EDGE // 2 else 1):
        start_s, cpu_s = time.perf_counter(), time.process_time()
        work()
        times.append(1e3 * (time.perf_counter() - start_s))
        cpu_times.append(1e3 * (time.process_time() - cpu_s))
    return Line(edge_px, name, where, statistics.median(times), min(times), min(cpu_times))


def main(argv: list[str]) -> int:
    """Time every condition at each size; print tables, and write JSON, a page and a plot."""
    parser = argparse.ArgumentParser(prog="script/bench foveate", description=__doc__)
    parser.add_argument("--size", type=int, nargs="+", default=list(EDGES), metavar="EDGE")
    parser.add_argument("--width-deg", type=float, default=40.0, help="of the picture (40)")
    parser.add_argument("--repeats", type=int, default=9, help="turns of each (default 9)")
    parser.add_argument(
        "--condition", nargs="+", choices=CONDITIONS, default=list(CONDITIONS), help="of these"
    )
    parser.add_argument("--gpu-only", action="store_true", help="leave out numpy and odak")
    parser.add_argument(
        "--json", type=file_to_write, help="write the numbers and the machine there"
    )
    parser.add_argument("--docs", type=PART.page, help="page whose tables are replaced")
    parser.add_argument("--plot", type=file_to_write, help="draw time and memory (.svg, .png)")
    arguments = parser.parse_args(argv)
    known = conditions("numpy", "moderngl", "torch", "odak")
    ctx = create_context()
    device = describe(ctx)
    print(f"renderer: {device}; load {known['load_average_before']}")
    lines: list[Line] = []
    for edge_px in sorted(arguments.size):
        found = time_gpu(ctx, edge_px, arguments.width_deg, arguments.repeats, arguments.condition)
        if not arguments.gpu_only:
            there = {line.condition for line in found}
            names = [
                name
                for name in arguments.condition
                if edge_px <= LARGEST_TWIN_EDGE
                or (name not in there and edge_px <= LARGEST_SLOW_EDGE)
            ]
            found += time_numpy(edge_px, arguments.width_deg, names)
            found += time_odak(edge_px) if edge_px <= LARGEST_ODAK_EDGE else []
        lines += found
        print(f"{edge_px} px done")
        # After each size: what was measured stays, whatever becomes of the next one.
        _write(arguments, lines, known, device)
    release_context(ctx)
    print(report.markdown(lines, device.name, busy_words(known)))
    return 0


def _write(
    arguments: argparse.Namespace,
    lines: list[Line],
    known: dict[str, object],
    device: GraphicsDriver,
) -> None:
    """Write what is asked for."""
    record = known | {
        "load_average_after": load_average(),
        "renderer": asdict(device),
        "width_deg": arguments.width_deg,
        "repeats": arguments.repeats,
        "lines": [asdict(line) for line in lines],
    }
    if arguments.json:
        write_record(arguments.json, record)
    if arguments.docs:
        PART.replace(arguments.docs, report.markdown(lines, device.name, busy_words(known)))
    if arguments.plot:
        report.plot(lines, device.name, arguments.plot)


def perception() -> Any | None:
    """Return ``odak.learn.perception``, or None where odak is not installed.

    torch gets one thread: more of them wait for each other by counting, and on a busy machine that
    alone was five times the CPU time. odak writes a log beside whoever imports it: into a folder
    that goes, here.
    """
    if importlib.util.find_spec("odak") is None:
        return None
    importlib.import_module("torch").set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        return importlib.import_module("odak.learn.perception")
