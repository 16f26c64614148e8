"""Time of foveated pictures against a copy and a blur: `script/bench foveate --help`.

Conditions take turns, so that what else the machine does meets all alike; ratios are of one run.
odak's `gen_metamer` and radial blur run beside them on the CPU, where odak is installed.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import moderngl
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.output import file_to_write
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Flat
from pipeline.gl.context import create_context, describe, release_context
from pipeline.gl.texture import create_texture, texture_from
from pipeline.gl.timer import measure

EDGES = (512, 1024, 2048, 4096)
ON_GPU = ("blur", "metamer", "eidolon", "warped-metamer")
IN_NUMPY = ("noise-enhanced", "contrast-enhanced")
LARGEST_NUMPY_EDGE = 1024  # beyond it numpy takes minutes
TILE = 8

_COPY = """\
#version 430
layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba32f, binding = 0) uniform readonly image2D source;
layout(rgba32f, binding = 1) uniform writeonly image2D target;
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(target)))) return;
    imageStore(target, pixel, imageLoad(source, pixel));
}
"""


@dataclass(frozen=True)
class Line:
    """One condition at one size."""

    edge_px: int
    condition: str
    where: str  # gpu, numpy, or the package
    median_ms: float
    least_ms: float
    over_blur: float | None  # of medians, of one run
    over_copy: float | None
    passes: int | None
    bytes_per_pixel: float | None  # held beyond source and target


def picture(edge_px: int) -> np.ndarray:
    """A random picture with some structure, (H, W, 3) in [0, 1]."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:edge_px, :edge_px] / edge_px
    waves = 0.5 + 0.25 * np.sin(40 * x * y) + 0.1 * rng.standard_normal((edge_px, edge_px))
    return np.repeat(waves.clip(0, 1)[..., None], 3, axis=2).astype(np.float32)


def time_gpu(ctx: moderngl.Context, edge_px: int, width_deg: float, repeats: int) -> list[Line]:
    """Time a copy and what the GPU makes, of one size, in turn."""
    shown = picture(edge_px)
    size = (edge_px, edge_px)
    source = texture_from(ctx, np.dstack([shown, shown[..., :1]]), "rgba32f")
    target = create_texture(ctx, size, "rgba32f")
    shader = ctx.compute_shader(_COPY)

    def copy() -> None:
        source.bind_to_image(0)
        target.bind_to_image(1)
        shader.run(-(-edge_px // TILE), -(-edge_px // TILE))
        ctx.memory_barrier()

    made = {name: Foveator(size, viewing=Flat(width_deg), method=name, ctx=ctx) for name in ON_GPU}
    middle = (edge_px / 2, edge_px / 2)
    works: dict[str, Callable[[], None]] = {"copy": copy}
    for name, foveator in made.items():
        passes = foveator.passes
        assert passes is not None
        works[name] = lambda passes=passes: passes(source, target, middle)  # type: ignore[misc]
    times: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(repeats + 1):
        for name, work in works.items():
            found = measure(ctx, work, repeats=1, warm_up=2 if turn == 0 else 0).median_ms
            if turn:
                times[name].append(found)
    median = {name: statistics.median(values) for name, values in times.items()}
    lines = []
    for name, values in times.items():
        passes = made[name].passes if name in made else None
        lines.append(
            Line(
                edge_px,
                name,
                "gpu",
                median[name],
                min(values),
                median[name] / median["blur"],
                median[name] / median["copy"],
                passes.dispatches if passes else 1,
                passes.held_bytes / edge_px**2 if passes else 0.0,
            )
        )
    for foveator in made.values():
        foveator.release()
    for thing in (source, target, shader):
        thing.release()
    return lines


def time_cpu(edge_px: int, width_deg: float) -> list[Line]:
    """Time what numpy makes, once after a warm-up."""
    shown = picture(edge_px)
    lines = []
    for name in (*ON_GPU, *IN_NUMPY):
        foveator = Foveator((edge_px, edge_px), viewing=Flat(width_deg), method=name)
        times = []
        for _ in range(2):
            start_s = time.perf_counter()
            foveator(shown, (edge_px / 2, edge_px / 2))
            times.append(1e3 * (time.perf_counter() - start_s))
        lines.append(Line(edge_px, name, "numpy", times[-1], min(times), None, None, None, None))
    return lines


def time_odak(edge_px: int) -> list[Line]:
    """Time odak's metamer and blur on the CPU; nothing where it is not installed."""
    if importlib.util.find_spec("odak") is None:
        return []
    import torch
    from odak.learn.perception import MetamerMSELoss, RadiallyVaryingBlur

    image = torch.from_numpy(picture(edge_px).transpose(2, 0, 1)[None].copy())
    loss = MetamerMSELoss(n_pyramid_levels=5)
    blur = RadiallyVaryingBlur()
    works = {
        "gen_metamer": lambda: loss.gen_metamer(image, gaze=[0.5, 0.5]),
        "RadiallyVaryingBlur": lambda: blur.blur(image, centre=(0.5, 0.5)),
    }
    lines = []
    for name, work in works.items():
        times = []
        for _ in range(3):
            start_s = time.perf_counter()
            work()
            times.append(1e3 * (time.perf_counter() - start_s))
        lines.append(
            Line(
                edge_px, name, "odak", statistics.median(times), min(times), None, None, None, None
            )
        )
    return lines


def show(lines: list[Line], console: Console) -> None:
    """Print a table."""
    table = Table()
    for name in ("edge px", "condition", "by", "median ms", "least ms", "x blur", "x copy"):
        table.add_column(name, justify="left" if name in ("condition", "by") else "right")
    table.add_column("passes", justify="right")
    table.add_column("B/px", justify="right")

    def number(value: float | None, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}"

    for line in lines:
        table.add_row(
            str(line.edge_px),
            line.condition,
            line.where,
            number(line.median_ms, 2),
            number(line.least_ms, 2),
            number(line.over_blur, 2),
            number(line.over_copy, 1),
            number(line.passes, 0),
            number(line.bytes_per_pixel, 1),
        )
    console.print(table)


def main(argv: list[str]) -> int:
    """Time every condition at each size, and print or store a table."""
    parser = argparse.ArgumentParser(prog="script/bench foveate", description=__doc__)
    parser.add_argument("--size", type=int, nargs="+", default=list(EDGES), metavar="EDGE")
    parser.add_argument("--width-deg", type=float, default=40.0, help="of the picture (40)")
    parser.add_argument("--repeats", type=int, default=9, help="turns of each (default 9)")
    parser.add_argument("--gpu-only", action="store_true", help="leave out numpy and odak")
    parser.add_argument("--out", type=file_to_write, help="JSON file to write")
    arguments = parser.parse_args(argv)
    console = Console()
    ctx = create_context()
    renderer = str(describe(ctx))
    console.print(f"renderer: {renderer}")
    lines: list[Line] = []
    for edge_px in arguments.size:
        lines += time_gpu(ctx, edge_px, arguments.width_deg, arguments.repeats)
        if not arguments.gpu_only and edge_px <= LARGEST_NUMPY_EDGE:
            lines += time_cpu(edge_px, arguments.width_deg) + time_odak(edge_px)
    release_context(ctx)
    show(lines, console)
    if arguments.out:
        record = {"renderer": renderer, "width_deg": arguments.width_deg}
        found = record | {"lines": [asdict(line) for line in lines]}
        Path(arguments.out).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0
