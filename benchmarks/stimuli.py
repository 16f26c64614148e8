"""Speed of making clips: `script/bench stimuli --json benchmarks/results/stimuli.json`.

One scene, one size: frames per second of a whole build, hashed, by method; and two processes
against one, each with one rendering thread. These take turns, a round after the other, and the
median of the rounds' ratios is reported with the least and the greatest: other work on the machine
then meets both alike. Two processes need two idle cores.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.shared.output import file_to_write, write_record

if TYPE_CHECKING:
    from protocols.recipes.warped_clips import ClipName
    from stimuli.batch.build_plan import BuildPlan
    from stimuli.batch.clip import Survey
    from stimuli.batch.jobs import SceneContext
    from stimuli.rendering.scenery import Scenery


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print a table, and write it with the renderer's name where asked."""
    parser = argparse.ArgumentParser(prog="script/bench stimuli", description=__doc__)
    parser.add_argument("--scene", default="colonnade")
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--methods", nargs="+", default=["reference", "push-pull", "metameric"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=file_to_write, help="file to write the numbers to")
    parser.add_argument("--share", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.share:
        _share(options)
        return 0
    renderer = _renderer()
    print(f"{renderer}; `{options.scene}`, {options.width} px wide, {options.frames} frames")
    speeds = {method: _build_fps(options, method) for method in options.methods}
    for method, fps in speeds.items():
        print(f"{method:<12} {fps:5.1f} fps")
    ratios = _scaling(options)
    median, least, greatest = statistics.median(ratios), min(ratios), max(ratios)
    print(f"two processes: {median:.2f} ({least:.2f} to {greatest:.2f}) times one")
    if options.json is not None:
        from protocols.revision import code_revision

        record = {
            "cores": os.cpu_count(), "platform": platform.platform(), "revision": code_revision(),
            "load_average": os.getloadavg()[0], "renderer": renderer, "scene": options.scene,
            "width_px": options.width, "frames": options.frames, "rounds": options.rounds,
            "speeds": [{"method": name, "build_fps": fps} for name, fps in speeds.items()],
            "two_processes_over_one": {"median": median, "least": least, "greatest": greatest},
        }  # fmt: skip
        write_record(options.json, record)
    return 0


def _build_fps(options: argparse.Namespace, method: str) -> float:
    from stimuli.batch.clip import make_frames

    bench, scenery, orders, clip, survey = _ready(options, method, options.frames)
    seconds = []
    try:
        for _ in range(options.rounds + 1):  # the first one warms up
            with tempfile.TemporaryDirectory() as folder:
                started = time.perf_counter()
                make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "clip")
                seconds.append(time.perf_counter() - started)
    finally:
        bench.release()
    return float(options.frames / statistics.median(seconds[1:]))


def _share(options: argparse.Namespace) -> None:
    """One of two processes: get ready, and make a clip at every word, until there is none."""
    from stimuli.batch.clip import make_frames

    bench, scenery, orders, clip, survey = _ready(options, options.methods[-1], options.frames)
    with tempfile.TemporaryDirectory() as folder:
        make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / "warm")
        print("ready", flush=True)
        for number, _ in enumerate(sys.stdin):
            make_frames(bench.ctx, scenery, orders, clip, survey, Path(folder) / str(number))
            print("done", flush=True)
    bench.release()


def _scaling(options: argparse.Namespace) -> list[float]:
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
    return rounds


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


def _again(options: argparse.Namespace) -> list[str]:
    return ["--scene", options.scene, "--width", str(options.width), "--frames",
            str(options.frames), "--methods", *options.methods]  # fmt: skip


def _ready(
    options: argparse.Namespace, method: str, frames: int
) -> tuple[SceneContext, Scenery, BuildPlan, ClipName, Survey]:
    """Open the scene at a fixed extent and survey it without writing masks."""
    from protocols.load import load_display, load_protocol
    from protocols.recipes.warped_clips import ClipName
    from stimuli.batch.build_plan import BuildPlan
    from stimuli.batch.clip import Survey
    from stimuli.batch.jobs import SceneContext

    study = load_protocol(Path("demo"))
    scene = study.warped.scenes[0].model_copy(update={"name": "scene", "builtin": options.scene})
    clips = study.warped.clips.model_copy(
        update={"fps": 24.0, "duration_s": frames / 24, "render_width_px": options.width,
                "rescale": "box"}
    )  # fmt: skip
    size = study.warped.sizes[0].model_copy(update={"hole_share": None, "extent_m": 0.1})
    methods = tuple(
        study.warped.methods[0].model_copy(update={"name": name}) for name in options.methods
    )
    recipe = study.warped.model_copy(
        update={"scenes": (scene,), "clips": clips, "sizes": (size,), "methods": methods}
    )
    study = study.model_copy(update={"stimuli": recipe})

    class AsRendered(BuildPlan):
        """Shown as rendered: nothing is rescaled."""

        @property
        def shown_px(self) -> tuple[int, int]:
            return options.width, options.width * 3 // 4

    orders = AsRendered(study, load_display("fhd27-60hz"), Path.cwd())
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
