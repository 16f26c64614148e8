"""How fast clips are made: `python -m benchmarks stimuli`.

One scene, one size: frames per second of the pipeline alone (warp and fill), of PNG encoding
alone, and of a whole build; the build's wall time over the larger of the two; two processes
against one, each with one rendering thread; peak memory for n and for 2n frames.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

REPEATS = 3
RESULTS = Path(__file__).parent / "results" / "stimuli.json"


@dataclass(frozen=True)
class Speed:
    """One method's frames per second."""

    method: str
    pipeline_fps: float
    encode_fps: float
    build_fps: float

    @property
    def overhead(self) -> float:
        """Wall time over the larger of pipeline and encoding time; 1 is perfect overlap."""
        return min(self.pipeline_fps, self.encode_fps) / self.build_fps


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print a table, and write it with the renderer's name where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="colonnade")
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--methods", nargs="+", default=["reference", "push-pull", "metameric"])
    parser.add_argument("--write", action="store_true", help=f"write {RESULTS.name}")
    parser.add_argument("--memory-of", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--share-of", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.memory_of:
        _one_clip(options, options.methods[-1], options.memory_of)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        return 0
    if options.share_of:
        _share(options, *options.share_of)
        return 0
    speeds = [_speed(options, method) for method in options.methods]
    renderer = _renderer()
    print(f"{renderer}; {options.scene}, {options.width} x {options.width * 3 // 4} px")
    print(f"{'method':<12} {'pipeline':>9} {'PNG':>9} {'build':>9}  build / larger of both")
    for speed in speeds:
        print(
            f"{speed.method:<12} {speed.pipeline_fps:>5.1f} fps {speed.encode_fps:>5.1f} fps"
            f" {speed.build_fps:>5.1f} fps  {speed.overhead:.2f}"
        )
    # The best of several: other work on the machine takes cores from two before it does from one.
    one, two = (min(_wall(options, count) for _ in range(REPEATS)) for count in (1, 2))
    print(f"two processes, one rendering thread each: {2 * one / two:.2f} x one process")
    memory = [_memory(options, frames) for frames in (options.frames, 2 * options.frames)]
    print(f"peak memory: {memory[0]:.0f} MiB for {options.frames} frames, {memory[1]:.0f} MiB for"
          f" {2 * options.frames}")  # fmt: skip
    if options.write:
        from protocols.revision import code_revision

        content = {
            "renderer": renderer,
            "cores": os.cpu_count(),
            "platform": platform.platform(),
            "revision": code_revision(),
            "scene": options.scene,
            "width_px": options.width,
            "frames": options.frames,
            "speeds": [asdict(speed) | {"overhead": speed.overhead} for speed in speeds],
            "two_processes_over_one": 2 * one / two,
            "peak_mib": {str(options.frames): memory[0], str(2 * options.frames): memory[1]},
        }
        RESULTS.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def _speed(options: argparse.Namespace, method: str) -> Speed:
    from concurrent.futures import ThreadPoolExecutor

    from stimuli.clip import ENCODERS, _frames, make_frames
    from stimuli.png import encode_frame

    bench, scenery, orders, clip, survey = _ready(options, method, options.frames)
    wanted = list(range(options.frames))
    try:
        warm = list(_frames(bench.ctx, scenery, orders, clip, survey, wanted[:2]))
        started = time.perf_counter()
        colours = [
            colour for _, colour in _frames(bench.ctx, scenery, orders, clip, survey, wanted)
        ]
        pipeline_s = time.perf_counter() - started
        started = time.perf_counter()
        with ThreadPoolExecutor(ENCODERS) as pool:
            list(pool.map(lambda colour: encode_frame(colour, 8), colours))
        encode_s = time.perf_counter() - started
        with tempfile.TemporaryDirectory() as folder:
            started = time.perf_counter()
            make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "clip")
            build_s = time.perf_counter() - started
        del warm
    finally:
        bench.release()
    return Speed(
        method, options.frames / pipeline_s, options.frames / encode_s, options.frames / build_s
    )


def _one_clip(options: argparse.Namespace, method: str, frames: int) -> None:
    from stimuli.clip import make_frames

    bench, scenery, orders, clip, survey = _ready(options, method, frames)
    with tempfile.TemporaryDirectory() as folder:
        make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "clip")
    bench.release()


def _share(options: argparse.Namespace, index: int, processes: int) -> None:
    """One of several processes: get ready, wait for the word, make a clip, say how long."""
    from stimuli.clip import make_frames

    del index, processes
    bench, scenery, orders, clip, survey = _ready(options, options.methods[-1], options.frames)
    with tempfile.TemporaryDirectory() as folder:
        make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "warm")
        print("ready", flush=True)
        sys.stdin.readline()
        make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "clip")
        print("done", flush=True)
    bench.release()


def _wall(options: argparse.Namespace, processes: int) -> float:
    """Wall time until `processes` processes have made a clip each, without their start."""
    environment = os.environ | {"LP_NUM_THREADS": "1"}
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "benchmarks", "stimuli", *_again(options), "--share-of",
             str(index), str(processes)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
        )
        for index in range(processes)
    ]  # fmt: skip
    for process in started:
        assert process.stdout is not None
        while process.stdout.readline().strip() != "ready":
            pass
    began = time.perf_counter()
    for process in started:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    for process in started:
        assert process.stdout is not None
        while process.stdout.readline().strip() != "done":
            pass
    wall_s = time.perf_counter() - began
    for process in started:
        process.communicate()
    return wall_s


def _memory(options: argparse.Namespace, frames: int) -> float:
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks", "stimuli", *_again(options), "--memory-of",
         str(frames)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    return float(result.stdout.split()[-1])


def _again(options: argparse.Namespace) -> list[str]:
    return ["--scene", options.scene, "--width", str(options.width), "--frames",
            str(options.frames), "--methods", *options.methods]  # fmt: skip


def _ready(options: argparse.Namespace, method: str, frames: int):  # type: ignore[no-untyped-def]
    """Open the scene at a fixed extent and survey it without writing masks."""
    from protocols.load import load_display, load_protocol
    from protocols.schema import ClipName
    from stimuli.clip import Survey
    from stimuli.orders import Orders
    from stimuli.worker import Bench

    protocol = load_protocol(Path("demo"))
    scene = protocol.scenes[0].model_copy(update={"name": "scene", "builtin": options.scene})
    clips = protocol.clips.model_copy(
        update={"fps": 24.0, "duration_s": frames / 24, "render_width_px": options.width,
                "rescale": "box"}
    )  # fmt: skip
    size = protocol.sizes[0].model_copy(update={"hole_share": None, "extent_m": 0.1})
    methods = tuple(
        protocol.methods[0].model_copy(update={"name": name}) for name in options.methods
    )
    protocol = protocol.model_copy(
        update={"scenes": (scene,), "clips": clips, "sizes": (size,), "methods": methods}
    )

    class AsRendered(Orders):
        """Shown as rendered: nothing is rescaled."""

        @property
        def shown_px(self) -> tuple[int, int]:
            return options.width, options.width * 3 // 4

    orders = AsRendered(protocol, load_display("fhd27-60hz"), Path.cwd())
    clip = ClipName("scene", size.name, method)
    bench = Bench()
    scenery = bench.scenery(orders, clip)
    survey = Survey("", 0.1, options.width // 6, 0.0, 0.0, 0.0, ())
    return bench, scenery, orders, clip, survey


def _renderer() -> str:
    from pipeline.gl.context import create_context, describe, release_context

    ctx = create_context()
    try:
        return str(describe(ctx))
    finally:
        release_context(ctx)


if __name__ == "__main__":
    sys.exit(main())
