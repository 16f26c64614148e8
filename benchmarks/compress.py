"""Compressed pictures at equal size: `script/bench compress --help`.

Every picture in files of several sizes: by a plain codec, foveated (colour in polar cells alone),
and with statistics of what the cells lost. Measured are the statistics distance, PSNR within 2
degrees of the gaze, and FovVideoVDP, foveated, where the extra `metrics` is installed. The gaze
rests on the middle. Also the sheet of one picture, and curves of all.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.foveate_quality import cut, jod_of
from benchmarks.shared.machine import conditions
from benchmarks.shared.output import PagePart, file_to_write, write_record
from pipeline.compression.codec import DEFAULT_ANGLES, CompressionSettings, compress
from pipeline.compression.gpu import DecompressPass
from pipeline.foveation.geometry import Flat
from pipeline.foveation.gpu import MetamerPass
from pipeline.foveation.pooling import MetamerSettings
from pipeline.gl.context import create_context, release_context
from pipeline.gl.texture import create_texture, texture_from
from pipeline.image_file import from_integers, read_pixels, three_channels
from stimuli import pictures as sheets
from stimuli.compressed.rivals import InfeasibleRival, measured, rivals, sheet_of
from stimuli.foveated.builtin_pictures import builtin_picture

SIZES_KB = (15, 25, 41, 70, 120)
CODECS = ("jpeg", "avif")
KINDS = ("plain", "foveated", "metameric")
BUILT_IN = ("garden", "castle", "colonnade", "thicket", "notices")
EDGE_PX = 1024
WIDTH_DEG = 40.0
SHEET_PX = 1400
PART = PagePart("compression table")

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Result:
    """One picture in one file."""

    picture: str
    codec: str
    kind: str
    asked_kb: float
    size_kb: float
    quality: int
    distance: float
    fovea_psnr_db: float
    jod: float | None


def main(argv: list[str]) -> int:
    """Make all files, print means, write JSON, a sheet and a plot."""
    parser = argparse.ArgumentParser(prog="script/bench compress", description=__doc__)
    parser.add_argument("--pictures", type=Path, help="folder; by default our own scenes")
    parser.add_argument("--edge", type=int, default=EDGE_PX, help="pixels of the square pictures")
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES_KB, metavar="KB")
    parser.add_argument("--codecs", nargs="+", default=CODECS)
    parser.add_argument("--angles", type=int, default=DEFAULT_ANGLES)
    parser.add_argument("--json", type=file_to_write)
    parser.add_argument("--sheet", type=file_to_write, help="of the first picture at --sheet-kb")
    parser.add_argument("--sheet-kb", type=float, default=41)
    parser.add_argument("--plot", type=file_to_write)
    parser.add_argument("--docs", type=PART.page, help="page whose table is replaced")
    parser.add_argument("--time", action="store_true", help="time decoding beside a metamer, too")
    parser.add_argument("--of", type=Path, help="show what an earlier --json holds, and stop")
    arguments = parser.parse_args(argv)
    if arguments.of is not None:
        held = json.loads(arguments.of.read_text(encoding="utf-8"))["results"]
        _show([Result(**one) for one in held], arguments)
        return 0
    found: list[Result] = []
    for number, (name, picture) in enumerate(_pictures(arguments.pictures, arguments.edge)):
        found += list(_results(name, picture, arguments))
        if arguments.json is not None:  # after each picture: it takes minutes
            _write(found, None, arguments)
        if number == 0 and arguments.sheet is not None:
            sheets.save_picture(arguments.sheet, _sheet(picture, arguments))
    console = Console()
    _show(found, arguments)
    times = _times(arguments.edge, arguments.angles) if arguments.time else None
    if times is not None:
        console.print(
            f"decoding on the GPU {times['decode_ms']:.1f} ms, a metamer {times['metamer_ms']:.1f}"
            f" ms: ratio {times['ratio']:.2f}"
        )
    if arguments.json is not None:
        _write(found, times, arguments)
    return 0


def _show(found: list[Result], arguments: argparse.Namespace) -> None:
    """Print tables, and draw curves if asked to."""
    for size_kb in arguments.sizes:
        Console().print(_table(found, size_kb))
    if arguments.plot is not None:
        _plot(found, arguments.plot)
    if arguments.docs is not None:
        PART.replace(arguments.docs, markdown(found, arguments.sizes))


def markdown(found: list[Result], sizes_kb: Sequence[float]) -> str:
    """Means over pictures: of one size in columns, of several sizes in cells.

    A dash: not every picture has a file so small.
    """
    pictures = len({one.picture for one in found})

    def means(codec: str, kind: str, size_kb: float) -> list[str]:
        same = [
            one for one in found if (one.codec, one.kind, one.asked_kb) == (codec, kind, size_kb)
        ]
        if len(same) < pictures:
            return ["-"] * 4
        jods = [one.jod for one in same if one.jod is not None]
        return [
            f"{np.mean([one.size_kb for one in same]):.1f}",
            f"{np.mean([one.distance for one in same]):.3f}".removeprefix("0"),
            f"{np.mean([one.fovea_psnr_db for one in same]):.1f}",
            f"{np.mean(jods):.2f}" if len(jods) == pictures else "-",
        ]

    single = len(sizes_kb) == 1
    heads = (
        ("kB", "statistics distance", "fovea, dB", "FovVideoVDP, JOD")
        if single
        else [f"{size:g} kB" for size in sizes_kb]
    )
    lines = [f"| file | {' | '.join(heads)} |", f"| --- |{' ---: |' * len(heads)}"]
    for codec in dict.fromkeys(one.codec for one in found):
        for kind in KINDS:
            cells = [means(codec, kind, size) for size in sizes_kb]
            shown = (
                cells[0]
                if single
                else ["-" if "-" in cell[:3] else ", ".join(cell[1:]) for cell in cells]
            )
            lines.append(f"| {kind} {codec.upper()} | {' | '.join(shown)} |")
    return "\n".join(lines)


def _write(
    found: list[Result], times: dict[str, float] | None, arguments: argparse.Namespace
) -> None:
    record = {
        "machine": conditions("pillow", "numpy", "moderngl"),
        "angles": arguments.angles,
        "edge_px": arguments.edge,
        "times": times,
        "results": [asdict(one) for one in found],
    }
    write_record(arguments.json, record)


def _pictures(folder: Path | None, edge: int) -> Iterator[tuple[str, Picture]]:
    if folder is None:
        ctx = create_context()
        for name in BUILT_IN:
            yield name, builtin_picture(name, Flat(WIDTH_DEG).of(edge, edge), ctx)
        release_context(ctx)
        return
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() in (".png", ".jpg", ".jpeg"):
            yield file.stem, cut(from_integers(three_channels(file, read_pixels(file))), edge)


def _results(name: str, picture: Picture, arguments: argparse.Namespace) -> Iterator[Result]:
    height, width = picture.shape[:2]
    geometry, gaze_px = Flat(WIDTH_DEG).of(width, height), (width / 2, height / 2)
    for codec in arguments.codecs:
        settings = CompressionSettings(codec=codec, angles=arguments.angles)
        for size_kb in arguments.sizes:
            for kind in KINDS:
                size_bytes = round(1000 * size_kb)
                (one,) = rivals(picture, gaze_px, size_bytes, settings, kinds=(kind,))
                if isinstance(one, InfeasibleRival):
                    print(f"{name}: no {one.name} of {size_kb:g} kB: {one.why}")
                    continue
                said = measured(one, picture, geometry, gaze_px)
                jod = jod_of(one.shown, picture, WIDTH_DEG)
                yield Result(
                    name, codec, one.kind, size_kb, one.size_bytes / 1000, one.quality,
                    said.distance, said.fovea_psnr_db, jod,
                )  # fmt: skip


def _sheet(picture: Picture, arguments: argparse.Namespace) -> sheets.Picture:
    height, width = picture.shape[:2]
    geometry, gaze_px = Flat(WIDTH_DEG).of(width, height), (width / 2, height / 2)
    settings = CompressionSettings(codec=arguments.codecs[0], angles=arguments.angles)
    beside = rivals(picture, gaze_px, round(1000 * arguments.sheet_kb), settings)
    sheet = sheet_of(picture, beside, lambda one: measured(one, picture, geometry, gaze_px))
    shrunk = tuple(round(SHEET_PX / max(sheet.shape) * edge) for edge in sheet.shape[:2])
    return sheets.fitted(sheet, (shrunk[0], shrunk[1]))


def _table(found: list[Result], size_kb: float) -> Table:
    """Means over pictures at one size; beside them the worst ratio to the foveated distance."""
    table = Table("file", "kB", "distance", "fovea, dB", "JOD", title=f"at most {size_kb:g} kB")
    of: dict[tuple[str, str], list[Result]] = defaultdict(list)
    for one in found:
        if one.asked_kb == size_kb:
            of[one.kind, one.codec].append(one)
    for (kind, codec), all_of_them in of.items():
        jods = [one.jod for one in all_of_them if one.jod is not None]
        table.add_row(
            f"{kind} {codec.upper()}",
            f"{np.mean([one.size_kb for one in all_of_them]):.1f}",
            f"{np.mean([one.distance for one in all_of_them]):.3f}",
            f"{np.mean([one.fovea_psnr_db for one in all_of_them]):.1f}",
            f"{np.mean(jods):.2f}" if jods else "-",
        )
    return table


def _times(edge: int, angles: int, repeats: int = 12) -> dict[str, float]:
    """Milliseconds of decoding (without the codec's own work) and of a metamer, by turns."""
    picture = builtin_picture("notices", Flat(WIDTH_DEG).of(edge, edge), None)
    gaze_px = (edge / 2, edge / 2)
    made = compress([picture], gaze_px, CompressionSettings(angles=angles))
    ctx = create_context()
    decode = DecompressPass(ctx, made)
    metamer = MetamerPass(ctx, Flat(WIDTH_DEG).of(edge, edge), MetamerSettings())
    decode.load(made)
    rgba = np.pad(picture, ((0, 0), (0, 0), (0, 1)), constant_values=1)
    source, target = (
        texture_from(ctx, rgba, "rgba32f"),
        create_texture(ctx, (edge, edge), "rgba32f"),
    )
    taken: dict[str, list[float]] = {"decode_ms": [], "metamer_ms": []}
    for _ in range(repeats):
        for name in taken:
            start = time.perf_counter()
            if name == "decode_ms":
                decode(target)
            else:
                metamer(source, target, gaze_px)
            ctx.finish()
            taken[name].append(1000 * (time.perf_counter() - start))
    for held in (decode, metamer, source, target):
        held.release()
    release_context(ctx)
    found = {name: float(np.median(times[2:])) for name, times in taken.items()}
    return found | {"ratio": found["decode_ms"] / found["metamer_ms"]}


def _plot(found: list[Result], path: Path) -> None:
    """Curves over size, means over pictures, where every picture has a file so small."""
    import matplotlib.pyplot as plt

    shown = {"distance": "statistics distance", "fovea_psnr_db": "PSNR within 2 degrees, dB"}
    if all(one.jod is not None for one in found):
        shown["jod"] = "FovVideoVDP, JOD"
    figure, axes = plt.subplots(1, len(shown), figsize=(4.2 * len(shown), 3.4))
    colours = dict(zip(KINDS, ("#0072B2", "#D55E00", "#009E73"), strict=True))
    count = len({one.picture for one in found})
    for codec, line in zip(CODECS, ("--", "-"), strict=True):
        for kind in KINDS:
            same = [one for one in found if (one.codec, one.kind) == (codec, kind)]
            sizes = [
                size
                for size in sorted({one.asked_kb for one in same})
                if sum(one.asked_kb == size for one in same) == count
            ]
            for axis, value in zip(axes, shown, strict=True):
                means = [
                    np.mean([getattr(one, value) for one in same if one.asked_kb == size])
                    for size in sizes
                ]
                label = f"{kind} {codec.upper()}"
                axis.plot(sizes, means, line, marker="o", ms=3, color=colours[kind], label=label)
    for axis, words in zip(axes, shown.values(), strict=True):
        axis.set(xlabel="file, kB at most", ylabel=words, xscale="log")
        axis.set_xticks(sorted({one.asked_kb for one in found}))
        axis.get_xaxis().set_major_formatter("{x:g}")
        axis.minorticks_off()
        axis.spines[["top", "right"]].set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.set_layout_engine("constrained")
    figure.savefig(path)
    plt.close(figure)
