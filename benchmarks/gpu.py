"""Cost of a frame on the GPU and on its host: `script/bench gpu --help`.

Every pass by the GPU's own clock, the host's time and Python's calls, the ratio to a copy of the
frame, bytes held. `script/prove-gpu` runs this on graphics cards. Telea runs beside the fills, on
the CPU. Frames of fills and warp are those of `script/bench fill` with thin holes, the foveated
picture is that of `script/bench foveate`; the texture is a planet.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.fill import TimedFrame
from benchmarks.foveate import picture
from benchmarks.shared.clock import SAME, Clock, card_clocks_mhz
from benchmarks.shared.dispatches import Copy
from benchmarks.shared.frame_cost import FrameCost, Pass, Work, frame_cost
from benchmarks.shared.output import Record, conditions, file_to_write, write_record
from pipeline.errors import GLUnavailableError
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import MetamerSettings
from pipeline.gl.context import create_context, describe, release_context
from pipeline.gl.texture import create_texture, read_back, texture_from
from pipeline.textures.bake import bake
from protocols.revision import package_version
from stimuli.texture.draw_globes import TexturedRenderer
from stimuli.texture.scenes import SCENES, WIDTH_DEG, planet_map

NAMES = {
    "warp": ("warp",),
    "fill": (
        "push-pull", "push-pull-depth", "metameric",
        "coherence-transport", "telea",
    ),
    "foveate": ("blur", "metamer", "warped-metamer", "eidolon"),
    "textures": ("reference", "blur", "metamer"),
}  # fmt: skip
FORMATS = {"warp": ("rgba32f", "r32f", "rg32f")}  # of the frame that is copied; else the first
PLANET_PX = 512  # height of its map
WIDTH = 128  # of the table
LEAST_COPY_MS = 1e-4  # a clock that reads nothing makes no ratio


@dataclass(frozen=True)
class Row:
    """Cost of one method at one size; see `FrameCost`. What the CPU makes has a frame's time alone.

    Attributes
    ----------
    to_copy : float
        Its time on the GPU to that of a copy of the frame's textures; on the CPU, its whole time.
    held_bytes : int or None
        On the GPU, beyond input and output; None where nothing counts them.
    probes_ms, same_clock : tuple of float, bool
        Of the card's clock around each measurement (`Clock`), and whether they are of one.
    clocks_mhz : dict or None
        As NVIDIA's program names them, right afterwards.
    """

    bench: str
    name: str
    edge_px: int
    gpu_ms: float | None
    frame_ms: float
    host_ms: float | None
    python_calls: int | None
    to_copy: float
    held_bytes: int | None
    passes: tuple[Pass, ...]
    probes_ms: tuple[float, ...]
    same_clock: bool
    clocks_mhz: dict[str, float] | None


class Workload:
    """Works of one kind and size: `make` gives what to time, the bytes held, and how to free it."""

    def __init__(self, ctx: moderngl.Context, bench: str, edge_px: int) -> None:
        self._ctx, self._edge_px = ctx, edge_px
        self._own = ExitStack()
        self.make = {
            "fill": self._fill,
            "warp": self._fill,
            "foveate": self._foveate,
            "textures": self._texture,
        }[bench]
        self._bench: TimedFrame | None = None
        formats = FORMATS.get(bench, ("rgba32f",))
        self._pairs = tuple((self._empty(name), self._empty(name)) for name in formats)
        self._copier = self._kept(Copy(ctx, *formats))

    def __enter__(self) -> Workload:
        return self

    def __exit__(self, *_: object) -> None:
        self._own.close()

    def copy(self) -> None:
        """Copy what a frame has."""
        self._copier(*self._pairs)

    def _kept(self, item: Any) -> Any:
        self._own.callback(item.release)
        return item

    def _empty(self, name: str) -> moderngl.Texture:
        texture: moderngl.Texture = self._kept(
            create_texture(self._ctx, (self._edge_px, self._edge_px), name)
        )
        return texture

    def _fill(self, name: str) -> tuple[Work, int | None, Callable[[], None]]:
        if self._bench is None:
            self._bench = self._kept(TimedFrame(self._ctx, self._edge_px, "thin"))
        return self._bench.work(name)

    def _foveate(self, name: str) -> tuple[Work, int | None, Callable[[], None]]:
        size = (self._edge_px, self._edge_px)
        shown = picture(self._edge_px)
        source = texture_from(self._ctx, np.dstack([shown, shown[..., :1]]), "rgba32f")
        target = create_texture(self._ctx, size, "rgba32f")
        foveator = Foveator(size, viewing=Flat(WIDTH_DEG), method=name, ctx=self._ctx)
        passes = foveator.passes
        if passes is None:
            raise ValueError(f"{name} has no passes")
        middle = (self._edge_px / 2, self._edge_px / 2)

        def release() -> None:
            for item in (source, target, foveator):
                item.release()

        return lambda: passes(source, target, middle), passes.held_bytes, release

    def _texture(self, name: str) -> tuple[Work, int | None, Callable[[], None]]:
        baked = bake(planet_map(PLANET_PX), wraps=True)
        geometry = Flat(WIDTH_DEG).of(self._edge_px, self._edge_px)
        renderer = TexturedRenderer(self._ctx, baked, geometry, MetamerSettings())
        scene = SCENES["planet"]
        x, y = (self._edge_px * share for share in scene.gaze_share)
        condition: Any = name
        held_bytes = renderer.held_bytes
        return lambda: renderer.draw(scene, condition, (x, y)), held_bytes, renderer.release


def check_compute(ctx: moderngl.Context) -> None:
    """Copy a small picture by a compute shader.

    Raises
    ------
    GLUnavailableError
        If it does not arrive as it was.
    """
    wanted = np.random.default_rng(0).random((19, 23, 4), np.float32)
    source = texture_from(ctx, wanted, "rgba32f")
    target = create_texture(ctx, source.size, "rgba32f")
    try:
        copy = Copy(ctx, "rgba32f")
        copy((source, target))
        found = read_back(target)
    except Exception as error:  # moderngl and drivers raise what they like
        found, reason = None, str(error).strip().partition("\n")[0]
    else:
        copy.release()
        reason = "a picture copied by one came out changed"
    finally:
        source.release()
        target.release()
    if found is None or not np.array_equal(found, wanted):
        raise GLUnavailableError(
            f"compute shaders must work on {describe(ctx)} (found: {reason}); update the driver"
        )


def costs(ctx: moderngl.Context, bench: str, edge_px: int, repeats: int) -> Iterator[Row]:
    """Measure every method of a kind, the copy first; then all again from the last on.

    What is given twice is the least of both: what came before, and the heat, is no part of it.
    """
    clock = Clock(ctx)
    with Workload(ctx, bench, edge_px) as load:
        copy = frame_cost(ctx, load.copy, repeats=repeats, clock=clock)
        copy_ms = max(copy.gpu_ms, LEAST_COPY_MS)
        yield _row(bench, "copy", edge_px, copy, copy_ms, 0, clock)
        found: dict[str, FrameCost] = {}
        for name in (*NAMES[bench], *(NAMES[bench][::-1] if repeats > 1 else ())):
            work, held_bytes, release = load.make(name)
            cost = frame_cost(ctx, work, repeats=repeats, clock=clock)
            release()
            found[name] = found[name].with_least(cost) if name in found else cost
            yield _row(bench, name, edge_px, found[name], copy_ms, held_bytes, clock)
    clock.release()


def _row(
    bench: str,
    name: str,
    edge_px: int,
    cost: FrameCost,
    copy_ms: float,
    held_bytes: int | None,
    clock: Clock,
) -> Row:
    on_gpu = bool(cost.passes)
    return Row(
        bench,
        name,
        edge_px,
        gpu_ms=cost.gpu_ms if on_gpu else None,
        frame_ms=cost.frame_ms,
        host_ms=cost.host_ms if on_gpu else None,
        python_calls=cost.python_calls if on_gpu else None,
        to_copy=(cost.gpu_ms if on_gpu else cost.frame_ms) / copy_ms,
        held_bytes=held_bytes,
        passes=cost.passes,
        probes_ms=cost.probes_ms,
        same_clock=clock.same(*cost.probes_ms),
        clocks_mhz=card_clocks_mhz(),
    )


def table(rows: list[Record]) -> Table:
    """Tabulate rows, as `asdict` gives them.

    The clock is the share of the highest that any row had; ``!`` where it changed, or lay lower
    than others by more than a probe may differ.
    """
    shown = Table()
    for name in ("what", "edge px", "GPU ms", "frame ms", "host ms", "Python calls", "to a copy",
                 "passes", "MiB held", "clock"):  # fmt: skip
        shown.add_column(name, justify="left" if name == "what" else "right", no_wrap=True)
    probes_ms = [max(row.get("probes_ms", [0.0])) for row in rows]  # 0: none, as before 0.4
    highest_ms = min((min(row.get("probes_ms", [0.0])) for row in rows), default=0.0)
    for row, own_ms in zip(rows, probes_ms, strict=True):
        held = row["held_bytes"]
        odd = own_ms > 0 and not (row["same_clock"] and own_ms <= SAME * highest_ms)
        shown.add_row(
            f"{row['bench']}: {row['name']}",
            str(row["edge_px"]),
            "" if row["gpu_ms"] is None else f"{row['gpu_ms']:.3f}",
            f"{row['frame_ms']:.3f}",
            "" if row["host_ms"] is None else f"{row['host_ms']:.3f}",
            "" if row["python_calls"] is None else str(row["python_calls"]),
            f"{row['to_copy']:.2f}",
            str(sum(item["dispatches"] for item in row["passes"]) or ""),
            "" if held is None else f"{held / 2**20:.1f}",
            f"{100 * highest_ms / own_ms:.0f} %{'!' * odd}" if own_ms else "",
        )
    return shown


def main(argv: list[str]) -> int:
    """Measure, print a table, and write JSON after every row."""
    parser = argparse.ArgumentParser(prog="script/bench gpu", description=__doc__)
    parser.add_argument("--size", type=int, nargs="+", default=[1024], metavar="EDGE")
    parser.add_argument("--only", nargs="+", choices=list(NAMES), default=list(NAMES))
    parser.add_argument("--repeats", type=int, default=9, help="timed runs of each (default 9)")
    parser.add_argument("--json", type=file_to_write, help="write the numbers and the device there")
    parser.add_argument("--check", action="store_true", help="print the device as JSON, no more")
    parser.add_argument("--show", type=Path, metavar="JSON", help="print what was measured before")
    arguments = parser.parse_args(argv)
    console = Console(width=WIDTH)
    if arguments.show is not None:
        console.print(table(json.loads(arguments.show.read_text(encoding="utf-8"))["rows"]))
        return 0
    try:
        ctx = create_context()
        check_compute(ctx)
    except GLUnavailableError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    known = conditions("numpy", "moderngl", "opencv-python-headless")
    known |= {"version": package_version(), "renderer": asdict(describe(ctx))}
    if arguments.check:
        print(json.dumps(known))
        return 0
    console.print(f"renderer: {describe(ctx)}")
    names = ["copy", *(name for bench in arguments.only for name in NAMES[bench])]
    rows: dict[tuple[str, str, int], Record] = {}
    for edge_px in arguments.size:
        for bench in arguments.only:
            for row in costs(ctx, bench, edge_px, arguments.repeats):
                rows[row.bench, row.name, row.edge_px] = asdict(row)
                if arguments.json is not None:
                    found = list(rows.values())
                    write_record(arguments.json, known | {"names": names, "rows": found})
    console.print(table(list(rows.values())))
    release_context(ctx)
    return 0
