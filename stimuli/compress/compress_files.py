"""Pictures and clips to compressed files and back: `metamerlab compress` and `decompress`."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.compression import compressed_file, image_codecs
from pipeline.compression.codec import (
    CompressionSettings,
    compress,
    decoded_base,
    decoded_cells,
    decompress,
)
from pipeline.compression.compressed_file import CompressedPicture, atlas_shape, read_compressed
from pipeline.compression.gpu import DecompressPass
from pipeline.compression.grid import PolarGrid
from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry
from pipeline.frame import check_seed
from pipeline.pictures import drawing
from pipeline.pictures.drawing import Picture
from pipeline.pictures.size_limits import check_need
from pipeline.video_file import is_video
from protocols.disk.whole_file import write_whole
from stimuli.compress.rivals import InfeasibleRival, measured, rival_sheet, rivals
from stimuli.media.frames_folder import SILENT, Reporter, save_steps
from stimuli.media.gaze_and_display import AS_ASSUMED, StatedViewing, gaze_words, read_gaze
from stimuli.media.picture_files import PictureFiles, save_pictures
from stimuli.media.video import check_video, folder_of_frames, write_video

ENDING = ".metamer"


def compress_file(
    source: Path,
    out: Path,
    *,
    viewing: StatedViewing = AS_ASSUMED,
    settings: CompressionSettings | None = None,
    compare: Path | None = None,
    steps: Path | None = None,
    reporter: Reporter = SILENT,
) -> CompressedPicture:
    """Compress a picture, a folder of frames, or a video, for a gaze.

    Parameters
    ----------
    source : Path
        Any picture that `read_any` reads, a folder of such, in the order of their names, or a
        video.
    out : Path
        The file to write, `ENDING`; replaced if it is there.
    viewing : StatedViewing
        Display and angle matter where the gaze is given in degrees, and to `compare`.
    compare : Path, optional
        A sheet (.png) of the first picture beside plain and foveated files of the same size.
    steps : Path, optional
        A folder for pictures of the first frame's parts; see `write_compression_steps`.

    Raises
    ------
    InputError, StudyError, OSError
        Before anything is written.
    """
    tell, settings = reporter.say, settings or CompressionSettings()
    if compare is not None and (source.is_dir() or is_video(source)):
        raise InputError("--compare takes one picture, not frames or a video; give it a frame")
    with folder_of_frames(source, tell) as folder:
        frames = _frames(folder, reporter)
    height, width = frames[0].shape[:2]
    looking = viewing.of((height, width))
    gaze_px = read_gaze(viewing.gaze, looking.geometry)
    tell(f"{len(frames)} x {width} x {height} px" if len(frames) > 1 else f"{width} x {height} px")
    tell(looking.words)
    tell(gaze_words(gaze_px, looking.geometry))
    reporter.progress("compressing", 0, 0)
    found = compress(frames, gaze_px, settings)
    data = compressed_file.to_bytes(found)
    whole = 3 * width * height * len(frames)
    sharp_px = found.grid.rows_per_turn / (2 * np.pi)
    levels = f"{found.levels} levels of" if found.levels else "no"
    tell(f"sharp up to {sharp_px:.0f} px from the gaze; {levels} statistics of what lies beyond")
    if settings.size_bytes is not None and found.quality == image_codecs.BEST_QUALITY:
        more = "" if settings.angles is None else "; more --angles would use it"
        tell(f"note: the best quality takes less than was asked for{more}")
    if compare is not None:
        alike = replace(settings, size_bytes=len(data), angles=found.grid.rows_per_turn)
        _compare(compare, frames[0], looking.geometry, gaze_px, alike, reporter)
    if steps is not None:
        tell(f"wrote {write_compression_steps(steps, frames[0], found)[-1]}")
    write_whole(out, data)
    ratio = whole / len(data)
    tell(
        f"wrote {out}: {len(data) / 1000:.1f} kB, 1:{ratio:.{0 if ratio >= 1 else 2}f}"
        f" ({settings.codec} quality {found.quality}, {found.grid.rows_per_turn} angles)"
    )
    return found


def _compare(
    out: Path,
    picture: NDArray[np.float32],
    geometry: Geometry,
    gaze_px: tuple[float, float],
    alike: CompressionSettings,
    reporter: Reporter,
) -> None:
    """Write the sheet of a picture beside files of the same size."""
    reporter.progress("comparing", 0, 0)
    beside = rivals(picture, gaze_px, alike)
    sheet = rival_sheet(picture, beside, lambda one: measured(one, picture, geometry, gaze_px))
    drawing.save_picture(out, sheet)
    missed = (one for one in beside if isinstance(one, InfeasibleRival))
    reporter.note(f"--compare has no {one.name}: {one.why}" for one in missed)
    reporter.say(f"wrote {out}")


def decompress_file(
    source: Path,
    out: Path,
    *,
    seed: int = 0,
    statistics: bool = True,
    video: Path | None = None,
    fps: float = 30.0,
    ctx: moderngl.Context | None = None,
    reporter: Reporter = SILENT,
) -> list[Path]:
    """Make the picture of a compressed file, or the frames of a clip.

    Parameters
    ----------
    out : Path
        A picture, .png or .exr; for a clip a folder, which is made.
    statistics : bool
        Without them: what is left is the blurred colour alone.
    video : Path, optional
        Of a clip: write its frames as a video too, `fps` a second; see `write_video`.

    Raises
    ------
    InputError, OSError
        If the file is damaged; nothing is written then.
    """
    tell = reporter.say
    check_seed(seed)
    held = read_compressed(source)
    check_need(source, "decompress", *held.grid.size)
    if not statistics:
        held = replace(held, levels=0, statistics=())
    count = len(held.bases)
    if count > 1 and out.suffix.lower() in (".png", ".exr"):
        raise InputError(f"{source}: holds a clip of {count} frames: OUT must be a folder")
    if count == 1 and video is not None:
        raise InputError(f"{source}: holds one picture: --video is for clips")
    if video is not None:
        check_video(video, *held.grid.size)
    if count == 1 and out.suffix.lower() not in (".png", ".exr"):
        raise InputError(f"{out}: must end in .png or .exr")
    names = [f"{index:06}.png" for index in range(count)] if count > 1 else None
    shower = DecompressPass(ctx, held) if ctx is not None else None
    show = decompress if shower is None else shower.apply
    try:
        shown = ((show(held, seed=seed, frame=index), None) for index in range(count))
        written = save_pictures(out, names, shown, reporter)
    finally:
        if shower is not None:
            shower.release()
    width, height = held.grid.size
    kind = f"{held.levels} levels of statistics" if held.levels else "no statistics"
    tell(f"wrote {out}: {count} x {width} x {height} px, {kind}, seed {seed}")
    if video is not None:
        write_video(video, written, fps)
        tell(f"wrote {video}")
    return written


def _frames(source: Path, reporter: Reporter) -> list[NDArray[np.float32]]:
    files = PictureFiles(source, "compress")
    height, width = files.size
    frames: list[NDArray[np.float32]] = []
    packed = 0
    for path, opened in zip(files.paths, files, strict=True):
        packed += path.stat().st_size
        check_need(source, "compress", width, height, packed, frames=len(frames) + 1)
        if not frames:
            reporter.note(opened.notes)
        frames.append(opened.colour)
    return frames


_MAP_COLOURS = ("#67000d", "#b11218", "#e32f27", "#f6583e", "#fc8a6a")
_PICTURE_COLOUR = "#0072B2"


def write_compression_steps(
    folder: Path, picture: NDArray[np.float32], held: CompressedPicture
) -> list[Path]:
    """Write the first frame's parts as `save_steps` does, and return what it returns.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        What was compressed, encoded R'G'B' in [0, 1].
    """
    grids, base = held.map_grids(), held.bases[0]
    steps = [
        ("picture", "picture", drawing.of_colour(picture)),
        (
            "cells",
            "colour in polar cells: rows are angles, columns distances from the gaze",
            decoded_cells(base, held.grid, held.codec),
        ),
    ]
    if grids:
        atlas = image_codecs.decode(
            held.statistics[0].atlas, held.codec, atlas_shape(grids), "the maps in it"
        )
        label = "maps, level by level: rows are luma's deviation in 3 bands, slopes of Cb and Cr"
        steps.append(("maps", label, np.repeat(atlas[..., None], 3, axis=2)))
    steps += [
        ("density", "density, its integral, and cells", density_picture(held.grid, grids)),
        ("base", "colour alone", drawing.of_colour(decoded_base(base, held.grid, held.codec))),
        ("shown", "with noise, seed 0", drawing.of_colour(decompress(held, seed=0))),
    ]
    height = max(picture.shape[0], 240)
    size = (height, max(picture.shape[1], height))
    return save_steps(folder, steps, size, columns=3)


def density_picture(base: PolarGrid, maps: list[PolarGrid]) -> Picture:
    """Draw Fig. 10: columns per pixel, their share up to a distance, and each level's cells."""
    from stimuli.score.plots import arranged_figure, figure_style, png_bytes

    grids = [base, *maps]
    names = ["colour", *(f"map {level}" for level in range(len(maps)))]
    colours = [_PICTURE_COLOUR, *_MAP_COLOURS]
    radius_px = np.linspace(0, base.farthest_px, 600)
    with figure_style():
        figure = arranged_figure(7.6, 5.0)
        along, whole, counts = figure.subplot_mosaic([["a", "b"], ["c", "c"]]).values()
        for grid, name, colour in zip(grids, names, colours, strict=False):
            columns = np.maximum(grid.density.columns(radius_px), 0)
            along.plot(radius_px, grid.density.per_px(radius_px), color=colour, label=name)
            whole.plot(radius_px, columns / columns[-1], color=colour)
        along.axhline(1, color="black", linestyle=":", label="a plain file")
        whole.plot(radius_px, radius_px / radius_px[-1], ":", color="black")
        along.set(yscale="log", ylim=(0.005, 1.5), ylabel="columns per pixel")
        whole.set(ylabel="share of columns up to there")
        for axes in (along, whole):
            axes.set_xlabel("distance from the gaze, px")
        cells = [grid.shape[0] * grid.shape[1] for grid in grids]
        bars = counts.barh(names, cells, color=colours[: len(grids)])
        counts.bar_label(bars, [f" {count / sum(cells):.1%}" for count in cells])
        counts.invert_yaxis()
        counts.set(xlabel="cells")
        counts.margins(x=0.1)
        figure.legend(loc="outside upper center", ncols=4)
        with Image.open(io.BytesIO(png_bytes(figure))) as drawn:
            return np.asarray(drawn.convert("RGB"))
