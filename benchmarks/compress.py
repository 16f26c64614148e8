"""Compressed pictures at equal size: `script/bench compress --help`.

Every picture in files of several sizes: by a plain codec, foveated (colour in polar cells alone),
and with statistics of what the cells lost. Measured are the statistics distance, PSNR within 2
degrees of the gaze, and FovVideoVDP, foveated, where the extra `metrics` is installed. The gaze
rests on the middle. Also the sheet of one picture, and curves of all.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.foveate_quality import jod_of, pictures
from benchmarks.shared.output import PagePart, conditions, file_to_write, write_record
from pipeline.compression.codec import DEFAULT_ANGLES, CompressionSettings
from pipeline.foveation.geometry import Flat
from pipeline.gl.context import create_context, release_context
from pipeline.pictures import drawing
from stimuli.compress.rivals import InfeasibleRival, measured, rival_sheet, rivals
from stimuli.scenes.builtin_pictures import builtin_picture

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
    arguments = parser.parse_args(argv)
    found: list[Result] = []
    for number, (name, picture) in enumerate(_pictures(arguments.pictures, arguments.edge)):
        found += list(_results(name, picture, arguments))
        if arguments.json is not None:  # after each picture: it takes minutes
            _write(found, arguments)
        if number == 0 and arguments.sheet is not None:
            drawing.save_picture(arguments.sheet, _sheet(picture, arguments))
    text = markdown(found, arguments.sizes)
    print(text)
    if arguments.plot is not None:
        _plot(found, arguments.plot)
    if arguments.docs is not None:
        PART.replace(arguments.docs, text)
    return 0


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


def _write(found: list[Result], arguments: argparse.Namespace) -> None:
    record = {
        "machine": conditions("pillow", "numpy", "moderngl"),
        "angles": arguments.angles,
        "edge_px": arguments.edge,
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
    yield from pictures(folder, edge)


def _results(name: str, picture: Picture, arguments: argparse.Namespace) -> Iterator[Result]:
    height, width = picture.shape[:2]
    geometry, gaze_px = Flat(WIDTH_DEG).of(width, height), (width / 2, height / 2)
    for codec in arguments.codecs:
        settings = CompressionSettings(codec=codec, angles=arguments.angles)
        for size_kb in arguments.sizes:
            for kind in KINDS:
                size_bytes = round(1000 * size_kb)
                asked = replace(settings, size_bytes=size_bytes)
                (one,) = rivals(picture, gaze_px, asked, kinds=(kind,))
                if isinstance(one, InfeasibleRival):
                    print(f"{name}: no {one.name} of {size_kb:g} kB: {one.why}")
                    continue
                said = measured(one, picture, geometry, gaze_px)
                jod = jod_of(one.shown, picture, WIDTH_DEG)
                yield Result(
                    name, codec, one.kind, size_kb, one.size_bytes / 1000, one.quality,
                    said.distance, said.fovea_psnr_db, jod,
                )  # fmt: skip


def _sheet(picture: Picture, arguments: argparse.Namespace) -> drawing.Picture:
    height, width = picture.shape[:2]
    geometry, gaze_px = Flat(WIDTH_DEG).of(width, height), (width / 2, height / 2)
    settings = CompressionSettings(codec=arguments.codecs[0], angles=arguments.angles)
    asked = replace(settings, size_bytes=round(1000 * arguments.sheet_kb))
    beside = rivals(picture, gaze_px, asked)
    sheet = rival_sheet(picture, beside, lambda one: measured(one, picture, geometry, gaze_px))
    shrunk = tuple(round(SHEET_PX / max(sheet.shape) * edge) for edge in sheet.shape[:2])
    return drawing.fitted(sheet, (shrunk[0], shrunk[1]))


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
