"""Pictures that follow the gaze, without a window: `script/bench live`.

The loop runs on an off-screen context with a timer at the display's rate, and gaze at 250 Hz. A
displacement follows jumps alone: methods with one have a row for a gaze that rests, and one for a
gaze that always jumps. Missing is the copy into the window.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
import tracemalloc
from dataclasses import asdict, dataclass

import moderngl
import numpy as np
from skimage import data

from benchmarks.shared.output import file_to_write, load_average, write_record
from pipeline.foveation.conditions import LIVE
from pipeline.foveation.geometry import Flat
from pipeline.gl.context import describe, lent_context
from pipeline.named_classes import Choice
from protocols.revision import code_revision
from study_app.cli.pictures.live_renderer import FoveatingRenderer, LiveSource
from study_app.gaze.source import GazeSample
from study_app.live.loop import LiveLoop
from study_app.live.renderer import GazeState, LiveView

SIZES = (256, 512, 1024, 2048)
GAZE_HZ = 250.0
JUMP_S = 0.04
DISPLACED = ("warped-metamer", "eidolon")
WARM_UP = 5


class Timer:
    """A screen that nobody sees."""

    def __init__(self, ctx: moderngl.Context, refresh_hz: float) -> None:
        self._ctx, self.refresh_hz = ctx, refresh_hz
        self._start_s = time.monotonic()

    def now(self) -> float:
        return time.monotonic()

    def wait_until(self, t_s: float) -> None:
        time.sleep(max(0.0, t_s - time.monotonic()))

    def paint(self, picture: moderngl.Texture, gaze_state: GazeState) -> None:  # noqa: ARG002
        self._ctx.finish()

    def flip(self) -> float:
        since = (time.monotonic() - self._start_s) * self.refresh_hz
        self.wait_until(self._start_s + (int(since) + 1) / self.refresh_hz)
        return time.monotonic()


class MadeUpGaze:
    """Gaze that trembles within a fixation, or jumps on and on, so that displacements follow."""

    def __init__(self, edge: int, *, jumps: bool) -> None:
        self._edge, self._jumps, self._next_s = edge, jumps, time.monotonic()
        self._places = np.random.default_rng(3).uniform(0.1, 0.9, (256, 2)) * edge

    def poll(self) -> list[GazeSample]:
        samples = []
        while self._next_s <= time.monotonic():
            number, since_s = divmod(self._next_s, JUMP_S)
            start, end = (self._places[(int(number) + k) % 256] for k in (0, 1))
            x, y = start + (end - start) * since_s / JUMP_S
            if not self._jumps:
                x, y = self._edge * (0.5 + 0.005 * np.sin(self._next_s * np.array((20.0, 13.0))))
            samples.append(GazeSample(self._next_s, self._next_s, float(x), float(y)))
            self._next_s += 1 / GAZE_HZ
        return samples


@dataclass(frozen=True)
class LiveTiming:
    """One method at one size."""

    method: str
    edge_px: int
    field: str
    """`rests` where displacements stay, `moves` where each frame makes them anew."""
    cpu_ms: float
    """CPU time of the whole process, a frame."""
    frames_per_s: float
    median_ms: float | None
    p95_ms: float | None
    max_ms: float | None
    transient_bytes: int
    """That Python takes and gives back during a frame, at most."""
    kept_bytes: int
    """That Python keeps of a frame, on average."""
    held_mib: float


def time_live(
    ctx: moderngl.Context, method: str, edge: int, field: str, seconds: float, hz: float
) -> LiveTiming:
    """Show an astronaut for some seconds."""
    picture = np.resize(data.astronaut(), (edge, edge, 3))
    frame = np.pad(picture, ((0, 0), (0, 0), (0, 1)), constant_values=255)
    source = LiveSource([frame], "0" * 64, panorama=False, notes=())
    renderer = FoveatingRenderer(ctx, source, Flat(width_deg=40).of(edge, edge), Choice(method))
    renderer.prepare(1)
    jumps = field == "moves"
    loop = LiveLoop(Timer(ctx, hz), MadeUpGaze(edge, jumps=jumps), (0, 0), polled=False)
    for _ in range(WARM_UP):
        loop.step(renderer, LiveView(), 1)
    loop = LiveLoop(Timer(ctx, hz), MadeUpGaze(edge, jumps=jumps), (0, 0), polled=False)
    began, cpu = time.monotonic(), time.process_time()
    while time.monotonic() - began < seconds:
        loop.step(renderer, LiveView(), 1)
    spent, cpu = time.monotonic() - began, time.process_time() - cpu
    frames, latency = loop.number, loop.latency.summary()
    transient, kept = _memory(loop, renderer)
    held = renderer.held_bytes
    renderer.release()
    return LiveTiming(
        method, edge, field, 1e3 * cpu / frames, frames / spent, latency.median_ms,
        latency.p95_ms, latency.max_ms, transient, kept, held / 2**20,
    )  # fmt: skip


def _memory(loop: LiveLoop, renderer: FoveatingRenderer) -> tuple[int, int]:
    frames = 20
    tracemalloc.start()
    loop.step(renderer, LiveView(), 1)
    first, most = tracemalloc.get_traced_memory()[0], 0
    for _ in range(frames):
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        loop.step(renderer, LiveView(), 1)
        most = max(most, tracemalloc.get_traced_memory()[1] - before)
    kept = (tracemalloc.get_traced_memory()[0] - first) // frames
    tracemalloc.stop()
    return most, kept


def main(argv: list[str]) -> int:
    """Print a table; with ``--json FILE`` also write it."""
    parser = argparse.ArgumentParser(prog="benchmarks.live", description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="edges in pixels")
    parser.add_argument("--methods", nargs="+", default=LIVE, choices=LIVE)
    parser.add_argument("--seconds", type=float, default=5.0, help="for each")
    parser.add_argument("--hz", type=float, default=60.0, help="refresh rate")
    parser.add_argument("--json", type=file_to_write, help="file to write the numbers to")
    asked = parser.parse_args(argv)
    with lent_context() as ctx:
        drawn_by = str(describe(ctx))
        print(f"{drawn_by}, {platform.platform()}, load {load_average():.1f}, {code_revision()}")
        print("method          edge px  field  CPU ms  frames/s  latency ms: median    95 %     max"
              "  transient B  kept B  held MiB")  # fmt: skip
        found = []
        rows = [
            (method, edge, field)
            for method in asked.methods
            for edge in asked.sizes
            for field in (("rests", "moves") if method in DISPLACED else ("rests",))
        ]
        for method, edge, field in rows:
            one = time_live(ctx, method, edge, field, asked.seconds, asked.hz)
            found.append(asdict(one))
            ages = (one.median_ms, one.p95_ms, one.max_ms)
            shown = (f"{age:8.1f}" if age is not None else "       -" for age in ages)
            print(
                f"{method:<15} {edge:7d}  {field} {one.cpu_ms:7.1f} {one.frames_per_s:9.1f}"
                f"            {' '.join(shown)}  {one.transient_bytes:11d}"
                f" {one.kept_bytes:7d} {one.held_mib:9.1f}"
            )
    if asked.json:
        record = {"renderer": drawn_by, "load": load_average(), "revision": code_revision()}
        write_record(asked.json, json.loads(json.dumps({**record, "live": found})))
    return 0
