"""Speed of making clips: `script/bench stimuli --write --docs benchmarks/results/stimuli.md`.

One scene, one size: frames per second of the pipeline alone (warp and fill), of PNG encoding
alone, and of a whole build; the build's wall time over the larger of the two (wanted: at most
1.3); two processes against one, each with one rendering thread (wanted: at least 1.7); peak
memory for n and for 2n frames (wanted: the same).

Whatever is compared is measured in turns, a round after the other, and the median of the
rounds' ratios is reported with the least and the greatest: other work on the machine then
meets both alike. Two processes need two idle cores.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.shared.output import PagePart
from benchmarks.shared.stimuli_report import Findings, Ratio, Speed

if TYPE_CHECKING:
    from protocols.recipes.warped_clips import ClipName
    from stimuli.build_plan import BuildPlan
    from stimuli.clip import Survey
    from stimuli.rendering.scenery import Scenery
    from stimuli.worker import SceneContext

PART = PagePart("stimuli table")
RESULTS = Path(__file__).parent / "results" / "stimuli.json"


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print a table, and write it with the renderer's name where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="colonnade")
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--methods", nargs="+", default=["reference", "push-pull", "metameric"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--write", action="store_true", help=f"write {RESULTS.name}")
    parser.add_argument("--docs", type=PART.page, help="document whose table is replaced")
    parser.add_argument("--memory-of", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--share", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.memory_of:
        print(_one_clip(options, options.methods[-1], options.memory_of))
        return 0
    if options.share:
        _share(options)
        return 0
    found = Findings(
        renderer=_renderer(),
        scene=options.scene,
        width_px=options.width,
        frames=options.frames,
        rounds=options.rounds,
        speeds=[_speed(options, method) for method in options.methods],
        two_processes_over_one=_scaling(options),
        peak_mib={
            frames: _memory(options, frames) for frames in (options.frames, 2 * options.frames)
        },
    )
    print(found.text())
    if options.write:
        RESULTS.write_text(json.dumps(found.content(), indent=1) + "\n", encoding="utf-8")
    if options.docs is not None:
        PART.replace(options.docs, found.markdown())
    return 0


def _speed(options: argparse.Namespace, method: str) -> Speed:
    from concurrent.futures import ThreadPoolExecutor

    from stimuli.clip import ENCODERS, _frames, make_frames
    from stimuli.media.png import encode_frame

    bench, scenery, orders, clip, survey = _ready(options, method, options.frames)
    wanted = list(range(options.frames))
    seconds: list[tuple[float, float, float]] = []
    try:
        list(_frames(bench.ctx, scenery, orders, clip, survey, wanted[:2]))  # warm
        for _ in range(options.rounds):
            started = time.perf_counter()
            colours = [
                colour for _, colour in _frames(bench.ctx, scenery, orders, clip, survey, wanted)
            ]
            piped = time.perf_counter()
            with ThreadPoolExecutor(ENCODERS) as pool:
                list(pool.map(lambda colour: encode_frame(colour, 8), colours))
            encoded = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "clip")
                built = time.perf_counter()
            seconds.append((piped - started, encoded - piped, built - encoded))
    finally:
        bench.release()
    fps = [options.frames / statistics.median(column) for column in zip(*seconds, strict=True)]
    overhead = Ratio.of([build_s / max(pipe_s, png_s) for pipe_s, png_s, build_s in seconds])
    return Speed(method, fps[0], fps[1], fps[2], overhead)


def _one_clip(options: argparse.Namespace, method: str, frames: int) -> float:
    """Return the most memory, in MiB, that a clip of `frames` held, not counting its start."""
    from stimuli.clip import make_frames

    bench, scenery, orders, clip, survey = _ready(options, method, frames)
    with tempfile.TemporaryDirectory() as folder:
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "clip")
        status = Path("/proc/self/status").read_text()
    bench.release()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def _share(options: argparse.Namespace) -> None:
    """One of two processes: get ready, and make a clip at every word, until there is none."""
    from stimuli.clip import make_frames

    bench, scenery, orders, clip, survey = _ready(options, options.methods[-1], options.frames)
    with tempfile.TemporaryDirectory() as folder:
        make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "warm")
        print("ready", flush=True)
        for number, _ in enumerate(sys.stdin):
            make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / str(number))
            print("done", flush=True)
    bench.release()


def _scaling(options: argparse.Namespace) -> Ratio:
    """Two processes against one, in turns: each alone, then both at once."""
    environment = os.environ | {"LP_NUM_THREADS": "1"}
    both = [
        subprocess.Popen(
            [sys.executable, "-m", "benchmarks", "stimuli", *_again(options), "--share"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
        )
        for _ in range(2)
    ]  # fmt: skip
    for process in both:
        _await(process, "ready")
    rounds = []
    for _ in range(options.rounds):
        first, second, together = (_together(part) for part in (both[:1], both[1:], both))
        rounds.append((first + second) / together)
    for process in both:
        process.communicate()
    return Ratio.of(rounds)


def _together(processes: Sequence[subprocess.Popen[str]]) -> float:
    """Seconds until each of `processes` has made a clip, begun at once."""
    began = time.perf_counter()
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    for process in processes:
        _await(process, "done")
    return time.perf_counter() - began


def _await(process: subprocess.Popen[str], word: str) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if line.strip() == word:
            return
    raise RuntimeError(f"a process of the benchmark ended with status {process.wait()}")


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


def _ready(
    options: argparse.Namespace, method: str, frames: int
) -> tuple[SceneContext, Scenery, BuildPlan, ClipName, Survey]:
    """Open the scene at a fixed extent and survey it without writing masks."""
    from protocols.load import load_display, load_protocol
    from protocols.recipes.warped_clips import ClipName
    from stimuli.build_plan import BuildPlan
    from stimuli.clip import Survey
    from stimuli.worker import SceneContext

    protocol = load_protocol(Path("demo"))
    scene = protocol.warped.scenes[0].model_copy(update={"name": "scene", "builtin": options.scene})
    clips = protocol.warped.clips.model_copy(
        update={"fps": 24.0, "duration_s": frames / 24, "render_width_px": options.width,
                "rescale": "box"}
    )  # fmt: skip
    size = protocol.warped.sizes[0].model_copy(update={"hole_share": None, "extent_m": 0.1})
    methods = tuple(
        protocol.warped.methods[0].model_copy(update={"name": name}) for name in options.methods
    )
    recipe = protocol.warped.model_copy(
        update={"scenes": (scene,), "clips": clips, "sizes": (size,), "methods": methods}
    )
    protocol = protocol.model_copy(update={"stimuli": recipe})

    class AsRendered(BuildPlan):
        """Shown as rendered: nothing is rescaled."""

        @property
        def shown_px(self) -> tuple[int, int]:
            return options.width, options.width * 3 // 4

    orders = AsRendered(protocol, load_display("fhd27-60hz"), Path.cwd())
    clip = ClipName("scene", size.name, method)
    bench = SceneContext()
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
