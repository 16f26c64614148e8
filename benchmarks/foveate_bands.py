"""Bands, orientations, levels and kernels against quality and time: `script/bench foveate_bands`.

The table that Beyond Blur (section 4) leaves to others. Our metamer with 1 to 6 levels, on the GPU;
then metamers as printed from pyramids of other bands, orientations and kernels, in numpy
(`benchmarks.shared.pyramid_banks`); then the authors' library with 1 to 6 orientations, with its
own pools, where odak is installed. Quality is the mean over pictures of the statistics distance
(`stimuli.score.statistics`, built from our bands, so it leans to them), the extremes of the ratios
of band deviations, and FovVideoVDP, foveated, where the extra `metrics` is installed.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from benchmarks.foveate import gen_metamer, perception
from benchmarks.foveate import picture as any_picture
from benchmarks.foveate_quality import band_ratios, jod_of, pictures
from benchmarks.shared.foveate_report import milliseconds, number
from benchmarks.shared.output import (
    PagePart,
    busy_words,
    conditions,
    file_to_write,
    load_average,
    write_record,
)
from benchmarks.shared.pyramid_banks import (
    Bank,
    haar,
    laplacian,
    printed_metamer,
    small_kernels,
    steerable,
)
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import Pools, make_pooling
from pipeline.gl.context import create_context, describe, release_context
from pipeline.gl.texture import create_texture, texture_from
from stimuli.score.statistics import statistics_distance

PART = PagePart("foveation bands")
LEVELS = (1, 2, 3, 4, 5, 6)
ORIENTATIONS = (1, 2, 4, 6)
TIMED_EDGE_PX = 1024
OURS, PRINTED, LIBRARY = "ours", "as printed", "odak"

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Row:
    """One way to make metamers."""

    group: str
    name: str
    levels: int
    orientations: int
    bands: int  # of all levels
    kernels: str
    kept_per_px: float | None  # numbers, before they are pooled
    distance: float
    least_ratio: float
    greatest_ratio: float
    jod: float | None
    cpu_ms: float  # of this process at TIMED_EDGE_PX (`ours`) or of a picture
    analysis_share: float | None
    bytes_per_px: float | None


@dataclass(frozen=True)
class Presentation:
    """A picture and how it is looked at."""

    truth: Picture
    pools: Pools
    width_deg: float

    def judge(self, test: Picture) -> tuple[float, float, float, float | None]:
        """Distance, least and greatest ratio of a band, and JOD."""
        ratios = band_ratios(test, self.truth, self.pools)
        return (
            statistics_distance(test, self.truth),
            float(np.nanmin(ratios)),
            float(np.nanmax(ratios)),
            jod_of(test, self.truth, self.width_deg),
        )


def mean_row(
    found: list[tuple[float, float, float, float | None]],
) -> tuple[float, float, float, float | None]:
    """Means over pictures; of ratios the extremes."""
    distances, least, greatest, jods = zip(*found, strict=True)
    known = [jod for jod in jods if jod is not None]
    return (
        statistics.mean(distances),
        min(least),
        max(greatest),
        statistics.mean(known) if known else None,
    )


def ours(ctx: moderngl.Context, shown: list[Presentation], law: str, repeats: int) -> Iterator[Row]:
    """Our metamer by its number of levels, drawn by the GPU, or its software.

    What lies below the levels is pooled, so that all keep the same; last as by default, kept.
    """
    for levels, residual in (*((levels, "pooled") for levels in LEVELS), (5, "kept")):
        given: dict[str, Any] = {"law": law, "levels": levels, "residual": residual}
        found = []
        for one in shown:
            height, width = one.truth.shape[:2]
            foveator = Foveator(
                (height, width), viewing=Flat(one.width_deg), method="metamer", ctx=ctx, **given
            )
            found.append(one.judge(foveator(one.truth, one.pools.gaze_px, seed=1)))
            foveator.release()
        cpu_ms, held = timed(ctx, given, shown[0].width_deg, repeats)
        yield Row(
            OURS, f"residual {residual}", levels, 2, 3 * levels, "3x3, low-pass 4x4",
            small_kernels(levels).kept_per_px(), *mean_row(found), cpu_ms, None, held,
        )  # fmt: skip


def timed(
    ctx: moderngl.Context, given: dict[str, Any], width_deg: float, repeats: int
) -> tuple[float, float]:
    """CPU ms (on hardware: wall ms) of our metamer, and bytes held for each pixel."""
    size = (TIMED_EDGE_PX, TIMED_EDGE_PX)
    image = any_picture(TIMED_EDGE_PX)
    source = texture_from(ctx, np.dstack([image, image[..., :1]]), "rgba32f")
    target = create_texture(ctx, size, "rgba32f")
    foveator = Foveator(size, viewing=Flat(width_deg), method="metamer", ctx=ctx, **given)
    passes = foveator.passes
    assert passes is not None
    clock: Callable[[], float] = time.process_time if describe(ctx).software else time.perf_counter
    times = []
    for _ in range(repeats + 1):
        start_s = clock()
        passes(source, target, (TIMED_EDGE_PX / 2, TIMED_EDGE_PX / 2))
        ctx.finish()
        times.append(1e3 * (clock() - start_s))
    held = passes.held_bytes / TIMED_EDGE_PX**2
    for thing in (foveator, source, target):
        thing.release()
    return statistics.median(times[1:]), held


def banks() -> list[Bank]:
    """Banks to compare, as printed: kernels, bands, orientations."""
    return [
        small_kernels(5),
        small_kernels(5, high_everywhere=False),
        haar(5),
        laplacian(5),
        *(steerable(count, 5) for count in ORIENTATIONS),
        steerable(2, 3),
    ]


def printed(shown: list[Presentation]) -> Iterator[Row]:
    """Metamers as printed, by bank."""
    for bank in banks():
        found, analysis_ms, all_ms = [], [], []
        for one in shown:
            cpu_s = time.process_time()
            test, first_s, second_s = printed_metamer(one.truth, one.pools, bank, seed=1)
            all_ms.append(1e3 * (time.process_time() - cpu_s))
            analysis_ms.append(first_s / (first_s + second_s))
            found.append(one.judge(test))
        count = len(bank.split(np.zeros((64, 64))).bands)
        yield Row(
            PRINTED, bank.name, bank.levels, bank.orientations, count, bank.kernels,
            bank.kept_per_px(), *mean_row(found), statistics.mean(all_ms),
            statistics.mean(analysis_ms), None,
        )  # fmt: skip


def library(shown: list[Presentation]) -> Iterator[Row]:
    """The authors' library by orientations, with its own pools; nothing without odak."""
    if perception() is None:
        return
    for count in ORIENTATIONS:
        found, times = [], []
        for one in shown:
            cpu_s = time.process_time()
            try:
                test = gen_metamer(one.truth, orientations=count)
            except RuntimeError:  # its pyramid does not fit together: then there is no row
                break
            assert test is not None
            times.append(1e3 * (time.process_time() - cpu_s))
            found.append(one.judge(test))
        if len(found) < len(shown):
            continue
        yield Row(
            LIBRARY, f"gen_metamer, {count} orientations", 5, count, 1 + 5 * count,
            "9x9 and larger", None, *mean_row(found), min(times), None, None,
        )  # fmt: skip


def cells(row: Row) -> list[str]:
    """All columns but the name."""
    return [
        str(row.levels),
        str(row.orientations) if row.orientations else "none",
        str(row.bands),
        row.kernels,
        number(row.kept_per_px, 1),
        f"{row.distance:.3f}",
        f"{row.least_ratio:.2f} to {row.greatest_ratio:.2f}",
        number(row.jod, 2),
        milliseconds(row.cpu_ms),
        number(row.bytes_per_px, 1),
    ]


def markdown(rows: list[Row], device: str, names: list[str], law: str, edge_px: int) -> str:
    """Return the table; `device` says what drew, and how busy it was."""
    lines = [
        f"{len(names)} pictures ({', '.join(names)}), {edge_px} x {edge_px} px, 40 degrees wide, law `{law}`; {device}.",  # noqa: E501
        "",
        "| metamer | levels | orientations | bands | kernels | moments kept, per px | distance | bands' deviation over the picture's | JOD | CPU ms | B/px held |",  # noqa: E501
        "| --- | ---: | ---: | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    return "\n".join(
        [*lines, *(f"| {row.group}: {row.name} | {' | '.join(cells(row))} |" for row in rows)]
    )


# Okabe and Ito's colours, told apart by every kind of colour vision; markers as well.
MARKS = {OURS: ("#0072B2", "o"), PRINTED: ("#D55E00", "s"), LIBRARY: ("#009E73", "^")}


def plot(rows: list[Row], target: Path) -> None:
    """Draw distance against levels with time, and against what is kept of each pixel."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "metamerlab", "font.size": 9.0})
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.4), layout="constrained")
    colour, marker = MARKS[OURS]
    own = [row for row in rows if row.group == OURS and "pooled" in row.name]
    left.plot([row.levels for row in own], [row.distance for row in own], "-", color=colour,
              marker=marker)  # fmt: skip
    for row in own:
        left.annotate(f"{milliseconds(row.cpu_ms)} ms", (row.levels, row.distance), (0, 8),
                      textcoords="offset points", fontsize=7, ha="center")  # fmt: skip
    left.set(
        xlabel=f"levels (beside each: CPU time at {TIMED_EDGE_PX}²)",
        ylabel="statistics distance, lower is better", title="ours, residual pooled",
    )  # fmt: skip
    for row in rows:
        if row.group != PRINTED:
            continue
        colour, marker = MARKS[PRINTED]
        right.plot(row.kept_per_px, row.distance, marker, color=colour)
        label = row.name.replace("small kernels, ", "3x3 kernels,\n")
        if row.name.startswith("steerable"):
            label = f"Fourier, {row.orientations}"
        label += f", {row.levels} levels" if row.levels != 5 else ""
        below = row.name.endswith("finest level") or row.levels != 5
        right.annotate(label, (row.kept_per_px, row.distance), (7, -4 if below else 4),
                       textcoords="offset points", fontsize=7)  # fmt: skip
    five = next((row for row in rows if row.group == OURS and "kept" in row.name), None)
    if five is not None:
        right.plot(five.kept_per_px, five.distance, MARKS[OURS][1], color=MARKS[OURS][0])
        right.annotate("ours", (five.kept_per_px, five.distance), (7, -4),
                       textcoords="offset points", fontsize=7)  # fmt: skip
    right.set(
        xlabel="moments kept of each pixel", ylabel="statistics distance",
        title="as printed, by bands and kernels",
    )  # fmt: skip
    for axes in (left, right):
        axes.margins(x=0.12, y=0.15)
        axes.set_ylim(bottom=0)
        axes.grid(visible=True, alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(target, metadata={"Date": None} if target.suffix == ".svg" else None)
    pyplot.close(figure)


def main(argv: list[str]) -> int:
    """Judge every way; print a table, and write JSON, a page and a plot."""
    parser = argparse.ArgumentParser(prog="script/bench foveate_bands", description=__doc__)
    parser.add_argument("--pictures", type=Path, help="folder; default: what scikit-image ships")
    parser.add_argument("--only", nargs="+", help="names of pictures, without extension")
    parser.add_argument("--edge", type=int, default=512, help="cut to so many pixels (512)")
    parser.add_argument("--law", default="v1", help="preset of the pools (v1)")
    parser.add_argument("--repeats", type=int, default=5, help="timed calls of ours (5)")
    parser.add_argument(
        "--json", type=file_to_write, help="write the numbers and the machine there"
    )
    parser.add_argument("--docs", type=PART.page, help="page whose table is replaced")
    parser.add_argument("--plot", type=file_to_write, help="draw quality (.svg, .png)")
    arguments = parser.parse_args(argv)
    if arguments.edge % 64:
        parser.error("--edge must be a multiple of 64: every pyramid halves it evenly")
    chosen = {
        name: image
        for name, image in pictures(arguments.pictures, arguments.edge)
        if not arguments.only or name in arguments.only
    }
    chosen = {
        name: image
        for name, image in chosen.items()
        if image.shape[:2] == (arguments.edge, arguments.edge)
    }
    if not chosen:
        parser.error(f"no picture is {arguments.edge} px high and wide, or has that name")
    known = conditions("numpy", "moderngl", "torch", "odak", "pyfvvdp")
    ctx = create_context()
    device = describe(ctx)
    geometry = Flat(40.0).of(arguments.edge, arguments.edge)
    middle = (arguments.edge / 2, arguments.edge / 2)
    pools = Pools(geometry, middle, make_pooling(arguments.law))
    shown = [Presentation(image, pools, 40.0) for image in chosen.values()]
    rows: list[Row] = []
    for found in (
        ours(ctx, shown, arguments.law, arguments.repeats), printed(shown), library(shown)
    ):  # fmt: skip
        for row in found:
            rows.append(row)
            print(f"{row.group}: {row.name}, {row.levels} levels: {row.distance:.3f}")
    release_context(ctx)
    busy = busy_words(known)
    text = markdown(rows, f"{device.name}; {busy}", list(chosen), arguments.law, arguments.edge)
    print(text)
    if arguments.json:
        record = known | {
            "load_average_after": load_average(),
            "renderer": asdict(device),
            "pictures": list(chosen),
            "edge_px": arguments.edge,
            "timed_edge_px": TIMED_EDGE_PX,
            "width_deg": 40.0,
            "law": arguments.law,
            "rows": [asdict(row) for row in rows],
        }
        write_record(arguments.json, record)
    if arguments.docs:
        PART.replace(arguments.docs, text)
    if arguments.plot:
        plot(rows, arguments.plot)
    return 0
