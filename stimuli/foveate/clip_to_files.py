"""The frames of a clip, shown to a gaze, into files; noise on the screen or carried along."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.steady_gaze import SteadyGaze, carried
from pipeline.frame import check_seed
from pipeline.named_classes import Choice
from pipeline.pictures.colour_file import PictureReading, check_drawable
from pipeline.pictures.depth_and_flow import read_flow
from pipeline.pictures.numpy_file import FLOW_FILES
from protocols.errors import count_of
from stimuli.foveate.condition_sheet import check_choices
from stimuli.foveate.foveate_files import METAMER
from stimuli.media.frames_folder import SILENT, Reporter
from stimuli.media.gaze_and_display import AS_ASSUMED, StatedViewing, gaze_words, read_gaze
from stimuli.media.picture_files import PictureFiles, save_pictures
from stimuli.media.video import check_video, write_video

Track = Callable[[int, tuple[int, int]], NDArray[np.float64]]
"""From how many frames there are, and their (height, width), to the gaze of each: (frames, 2) in
their pixels, not a number where the eye was lost."""


@dataclass(frozen=True)
class ClipSettings:
    """Flow, gaze and frame rate of a clip, and the files that it is written to.

    Parameters
    ----------
    flow : Path, optional
        A folder with a file of flow, such as ``NAME.flo``, for every frame but the first: for each
        pixel of *that* frame, where it is less where it was a frame ago. Noise and displacements
        then go with the surfaces. Without it they lie on the screen.
    track : Track, optional
        A gaze per frame, in place of the one for all. It holds while the eye is lost, and
        displacements follow it as `SteadyGaze` lets them.
    video : Path, optional
        Write the frames as a video too; see `write_video`.
    fps : float
        Frames a second.
    reading : PictureReading
        What is said about the files.
    """

    flow: Path | None = None
    track: Track | None = None
    video: Path | None = None
    fps: float = 30.0
    reading: PictureReading = field(default_factory=PictureReading)


def foveate_clip(
    frames: Path,
    out: Path,
    *,
    asked: ClipSettings = ClipSettings(),
    viewing: StatedViewing = AS_ASSUMED,
    choice: Choice = METAMER,
    seed: int = 0,
    ctx: moderngl.Context | None = None,
    reporter: Reporter = SILENT,
) -> list[Path]:
    """Show every frame of a folder to a gaze, and write them under their names as PNG.

    Parameters
    ----------
    frames : Path
        A folder of pictures of one size, in the order of their names.
    out : Path
        Another folder, empty or new.
    asked : ClipSettings
        What is known of the clip besides.
    choice : Choice
        The condition.

    Other parameters are those of `foveate_file`.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    InputError, StudyError, OSError
        Where a frame or its flow is not what it must be; nothing is written then.
    """
    tell, reading, track = reporter.say, asked.reading, asked.track
    check_choices([choice])
    check_seed(seed)
    files = PictureFiles(frames, "foveate" if ctx is not None else "foveate by numpy", reading)
    paths, names = files.paths, files.names
    motions = _motions(frames, out, paths, asked.flow)
    check_drawable(paths[0], ctx)
    size = files.size
    looking = viewing.of(size)
    if track is not None:
        eyes = track(len(paths), size)
        lost = int((~np.isfinite(eyes).all(axis=1)).sum())
        gaze_said = f"a gaze per frame, held in {lost} in which the eye was lost"
        if lost and not np.isfinite(eyes[0]).all():
            gaze_said += "; in the middle until it was found"
    else:
        gaze_px = read_gaze(viewing.gaze, looking.geometry)
        eyes = np.tile(gaze_px, (len(paths), 1))
        gaze_said = gaze_words(gaze_px, looking.geometry)
    tell(f"{count_of(len(paths), 'frame')}, {size[1]} x {size[0]} px")
    tell(looking.words)
    tell(gaze_said)
    reporter.note((*files.first.notes, *looking.notes))
    tell("noise is carried along the flow" if asked.flow else "noise lies on the screen")
    if asked.video is not None:
        check_video(asked.video, size[1], size[0])
    foveator = Foveator(
        size, viewing=looking.viewing, method=choice.name, ctx=ctx, **choice.parameters
    )
    try:
        shown = _shown(foveator, files, motions, eyes, asked.fps, seed)
        written = save_pictures(out, names, shown, reporter)
    finally:
        foveator.release()
    tell(f"wrote {count_of(len(written), 'frame')} to {out} ({choice.label})")
    if asked.video is not None:
        write_video(asked.video, written, asked.fps)
        tell(f"wrote {asked.video}")
    return written


def _shown(
    foveator: Foveator,
    files: PictureFiles,
    motions: list[Path | None],
    eyes: NDArray[np.float64],
    fps: float,
    seed: int,
) -> Iterator[tuple[NDArray[np.float32], int]]:
    """Show each frame to its gaze; yield it with the bits that it needs."""
    shift: NDArray[np.float64] | None = None
    state = SteadyGaze(foveator.geometry, (eyes[0, 0], eyes[0, 1]))
    for index, (opened, motion) in enumerate(zip(files, motions, strict=True)):
        if motion is not None:
            shift = carried(shift, _read_flow(motion, files.size))
        if index > 0:
            state = state.after((eyes[index, 0], eyes[index, 1]), 1 / fps)
        foveator.hold(opened.stored)
        shown = foveator.show(
            state.eye_px, seed=seed, frame=index, noise_shift_px=shift,
            field_gaze_px=state.field_px,
        )  # fmt: skip
        yield shown, opened.bits


def _motions(frames: Path, out: Path, paths: list[Path], flow: Path | None) -> list[Path | None]:
    """Check the folders, and find each frame's flow."""
    if out.exists() and out.samefile(frames):
        raise InputError(f"{out}: holds the frames themselves; write to another folder")
    if flow is None:
        return [None] * len(paths)
    motions = []
    for path in paths[1:]:
        places = [flow / f"{path.stem}{ending}" for ending in FLOW_FILES]
        motions.append(next((one for one in places if one.is_file() and one != path), places[0]))
    missing = [path.name for path in motions if not path.is_file()]
    if missing:
        raise InputError(
            f"{flow}: must hold the flow of every frame but the first"
            f" ({len(missing)} of {len(motions)} missing, the first is {missing[0]})"
        )
    return [None, *motions]


def _read_flow(path: Path, size: tuple[int, int]) -> NDArray[np.float32]:
    flow, _ = read_flow(path)  # where it is unknown noise stays on the screen
    if flow.shape[:2] != size:
        raise InputError(
            f"{path}: must be {size[1]} x {size[0]} px as the frames"
            f" (is {flow.shape[1]} x {flow.shape[0]})"
        )
    return flow
