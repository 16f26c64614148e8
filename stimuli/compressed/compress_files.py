"""Pictures and clips to compressed files and back: `metamerlab compress` and `decompress`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.compression import compressed_file, image_codecs
from pipeline.compression.codec import CompressionSettings, compress, decompress
from pipeline.compression.compressed_file import CompressedPicture, read_compressed
from pipeline.compression.gpu import DecompressPass
from pipeline.errors import InputError
from pipeline.foveation.noise_plane import check_seed
from pipeline.picture_limits import check_need
from pipeline.video_file import is_video
from protocols.disk.whole_file import write_whole
from stimuli import pictures
from stimuli.compressed.compression_steps import write_steps
from stimuli.compressed.rivals import InfeasibleRival, measured, rivals, sheet_of
from stimuli.exr import save_colour
from stimuli.foveated.any_picture import read_any
from stimuli.foveated.gaze_and_display import AS_ASSUMED, StatedViewing, gaze_words, read_gaze
from stimuli.media.frames_folder import frames_folder, frames_in
from stimuli.media.video import check_video, folder_of_frames, write_video
from stimuli.reporter import SILENT, Reporter

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
        A folder for pictures of the first frame's parts; see `write_steps`.

    Raises
    ------
    InputError, StudyError, OSError
        Before anything is written.
    """
    tell, settings = reporter.say, settings or CompressionSettings()
    if compare is not None and (source.is_dir() or is_video(source)):
        raise InputError("--compare takes one picture, not frames or a video; give it a frame")
    with folder_of_frames(source, tell) as folder:
        frames = _frames(folder, tell)
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
        picture, geometry = frames[0], looking.geometry
        reporter.progress("comparing", 0, 0)
        beside = rivals(
            picture, gaze_px, len(data), replace(settings, angles=found.grid.rows_per_turn)
        )
        sheet = sheet_of(picture, beside, lambda one: measured(one, picture, geometry, gaze_px))
        pictures.save_picture(compare, sheet)
        for missed in (one for one in beside if isinstance(one, InfeasibleRival)):
            tell(f"note: --compare has no {missed.name}: {missed.why}")
        tell(f"wrote {compare}")
    if steps is not None:
        tell(f"wrote {write_steps(steps, frames[0], found)[-1]}")
    write_whole(out, data)
    ratio = whole / len(data)
    tell(
        f"wrote {out}: {len(data) / 1000:.1f} kB, 1:{ratio:.{0 if ratio >= 1 else 2}f}"
        f" ({settings.codec} quality {found.quality}, {found.grid.rows_per_turn} angles)"
    )
    return found


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
    names = [out.name] if count == 1 else [f"{index:06}.png" for index in range(count)]
    if count > 1 and out.suffix.lower() in (".png", ".exr"):
        raise InputError(f"{source}: holds a clip of {count} frames: OUT must be a folder")
    if count == 1 and video is not None:
        raise InputError(f"{source}: holds one picture: --video is for clips")
    if video is not None:
        check_video(video, *held.grid.size)
    if count == 1 and out.suffix.lower() not in (".png", ".exr"):
        raise InputError(f"{out}: must end in .png or .exr")
    out.parent.mkdir(parents=True, exist_ok=True)
    shower = DecompressPass(ctx, held) if ctx is not None else None
    try:
        with frames_folder(out) if count > 1 else nullcontext(out.parent) as folder:
            for index, name in enumerate(names):
                if shower is not None:
                    shown = shower.apply(held, seed=seed, frame=index)
                else:
                    shown = decompress(held, seed=seed, frame=index)
                save_colour(folder / name, shown)
                if count > 1:
                    reporter.progress("frames", index + 1, count)
    finally:
        if shower is not None:
            shower.release()
    written = [(out if count > 1 else out.parent) / name for name in names]
    width, height = held.grid.size
    kind = f"{held.levels} levels of statistics" if held.levels else "no statistics"
    tell(f"wrote {out}: {count} x {width} x {height} px, {kind}, seed {seed}")
    if video is not None:
        write_video(video, written, fps)
        tell(f"wrote {video}")
    return written


def _frames(source: Path, tell: Callable[[str], None]) -> list[NDArray[np.float32]]:
    paths = frames_in(source) if source.is_dir() else [source]
    frames: list[NDArray[np.float32]] = []
    packed = 0
    for path in paths:
        opened = read_any(path, command="compress")
        packed += path.stat().st_size
        height, width = opened.size
        check_need(source, "compress", width, height, packed, frames=len(frames) + 1)
        if frames and opened.size != frames[0].shape[:2]:
            raise InputError(
                f"{path}: must be as large as the first frame (is {width} x {height} px)"
            )
        if not frames:
            for note in opened.notes:
                tell(f"note: {note}")
        frames.append(opened.colour)
    return frames
