"""`metamerlab foveate`: a picture or a clip, as a metamer or a rival shows it to a gaze."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from protocols.disk.result_folder import check_result
from protocols.errors import StudyError
from protocols.load import load_display
from study_app.cli.pictures.one_picture_options import (
    FILE_ENDINGS,
    LOOK,
    FovOption,
    NumpyOption,
    SettingsOption,
    ShownOption,
    check_outputs,
    choose_methods,
    gaze_option,
    list_option,
    method_option,
    print_methods,
    renderer,
)
from study_app.cli.progress import ProgressLines
from study_app.cli.terminal import PlainConsole

if TYPE_CHECKING:
    from pipeline.named_classes import Choice
    from pipeline.pictures.colour_file import PictureReading
    from stimuli.foveate.clip_to_files import Track
    from stimuli.foveate.foveate_files import Outputs


DEFAULT_METHOD = "metamer"
DEFAULT_FPS = 30.0


def _print_methods(console: Console) -> None:
    from pipeline.foveation.conditions import CONDITIONS, condition_parameters
    from pipeline.foveation.pooling import LAWS, PRESETS

    print_methods(console, CONDITIONS, condition_parameters)
    laws = Table("law", "how wide the eye pools", "parameter (default)", box=None)
    for name, (law, constant) in PRESETS.items():
        laws.add_row(name, f"law {law}, {LAWS[law][0]} {constant:g}", "-")
    for name, (parameter, default, what) in LAWS.items():
        laws.add_row(name, what, f"{parameter} ({default:g})")
    console.print()
    console.print(laws)
    console.print(
        "Without law, scaling, alpha and rate: law v1; the enhanced blurs have rate 1.40.",
        soft_wrap=True,
    )


@dataclass(frozen=True)
class ViewingOptions:
    """Place that the eye looks at, and its distance."""

    gaze: Annotated[
        str | None,
        gaze_option(
            "the middle",
            " For frames also a gaze for each: replay:FILE, a recording (.asc, .csv), or FILE.csv"
            " with columns x_px and y_px and a line per frame.",
        ),
    ] = None
    display: ShownOption = None
    fov: FovOption = None
    panorama: bool = False
    """An equirectangular panorama, 2:1."""


@dataclass(frozen=True)
class ConditionOptions:
    """Conditions, their parameters, and the seed."""

    methods: Annotated[list[str] | None, method_option("Condition", DEFAULT_METHOD)] = None
    settings: SettingsOption = None
    seed: Annotated[int, typer.Option(min=0)] = 0
    """Seed of noise and displacement."""
    _list: Annotated[
        bool, list_option("the conditions, their parameters and the pooling laws", _print_methods)
    ] = False


@dataclass(frozen=True)
class ClipOptions:
    """Options of frames alone."""

    flow: Annotated[Path | None, typer.Option(metavar="FOLDER")] = None
    """For frames: NAME.flo, .pfm, .npy, .npz or .png for each but the first, how far its pixels
    have moved since the frame before. Noise then moves along; otherwise it is fixed to the
    screen."""
    video: Annotated[Path | None, typer.Option(metavar="FILE")] = None
    """For frames: write them as a video too, .mp4, .webm, or lossless .avi."""
    fps: Annotated[float | None, typer.Option(min=1, max=1000)] = None
    r"""Frames a second, for --video and --gaze replay:FILE. \[default: the input video's, or 30]"""


def grey_value(text: str) -> float:
    """Read a grey: white, black, or a number from 0 to 1.

    Raises
    ------
    StudyError
        If it is none.
    """
    with suppress(ValueError):
        if 0 <= (grey := float({"black": "0", "white": "1"}.get(text, text))) <= 1:
            return grey
    raise StudyError(f"--background must be white, black, or a grey from 0 to 1 (got {text!r})")


@dataclass(frozen=True)
class LightOptions:
    """Statements on the file."""

    panel: ClassVar = "The file"

    stops: Annotated[
        float | None,
        typer.Option(show_default="0; for a panorama of light, by which 99 % of it can be shown"),
    ] = None
    """Make light brighter (or darker, below 0) by this many stops."""
    clip: bool = False
    """Clip light that a display cannot show, instead of refusing it."""
    encoded: bool = False
    """A file of floats holds display-referred colour, not scene-linear light."""
    background: Annotated[str, typer.Option(metavar="GREY")] = "0.5"
    """Grey behind transparent pixels: white, black, or a number from 0 to 1."""

    def reading(self, panorama: bool) -> PictureReading:
        """Return it as work on files takes it."""
        from pipeline.pictures.colour_file import PictureReading

        exposed = panorama and self.stops is None and not self.clip
        grey = grey_value(self.background)
        return PictureReading(grey, self.clip, self.stops or 0.0, self.encoded, exposed)


@dataclass(frozen=True)
class FoveationFigureOptions:
    """Pictures and scores that are made to be looked at."""

    panel: ClassVar = LOOK

    compare: Path | None = None
    """One labelled sheet: the picture with its pools drawn in, and all conditions (or those of
    --methods)."""
    steps: Path | None = None
    """Folder for pictures of every step: pools, level of detail, base, noise, displacement;
    sheet.png shows them all."""
    score: Path | None = None
    """Folder for scores: statistics, bands by eccentricity, FovVideoVDP and ColorVideoVDP (where
    installed), each beside what it is blind to; one page."""
    animate: Path | None = None
    """Animation (.webp, or .png for APNG) in which the gaze moves."""
    flip: Path | None = None
    """Animation that alternates between this seed and the next one."""
    page: Path | None = None
    """A page (.html, one file) on which the metamer follows the mouse or a finger, by WebGL2."""
    size_px: Annotated[int | None, typer.Option(min=64, max=4096)] = None
    r"""Longer edge of animations and page. \[default: 480, --flip 960, --page 512]"""


def foveate(
    picture: Annotated[
        Path,
        typer.Argument(
            help="A picture: PNG, JPEG, TIFF, OpenEXR, Radiance, ...; or a folder of frames;"
            " or a video."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Argument(
            help="The picture to write, .png or .exr; replaced if there. For frames: a folder."
            r" \[default: foveated.png, or foveated/; none where anything else is asked for]"
        ),
    ] = None,
    *,
    seen: ViewingOptions,
    condition: ConditionOptions,
    numpy_only: NumpyOption = False,
    clip: ClipOptions,
    file: LightOptions,
    looks: FoveationFigureOptions,
) -> None:
    """Make a metamer of a picture for one gaze, or a condition that it is compared with.

    In the fovea, one degree around the gaze by default, nothing changes. energy-metamer takes
    minutes; after an interruption the same command continues.

    Examples:

        metamerlab foveate photo.jpg out.png

        metamerlab foveate photo.jpg out.png --gaze 5deg,-3deg --display fhd27-60hz

        metamerlab foveate photo.jpg out.png -m warped-metamer --steps steps/

        metamerlab foveate photo.jpg --compare sheet.png --animate gaze.webp

        metamerlab foveate photo.jpg --page out.html

        metamerlab foveate photo.jpg --score scores/

        metamerlab foveate around.exr out.png --panorama --clip

        metamerlab foveate frames/ shown/ --flow flow/

        metamerlab foveate clip.mp4 shown/ --video shown.mp4

        metamerlab foveate clip.mp4 shown/ --gaze replay:eye.asc --display fhd27-60hz
    """
    from pipeline.video_file import is_video
    from stimuli.foveate.clip_to_files import ClipSettings, foveate_clip
    from stimuli.foveate.foveate_files import Outputs, foveate_file
    from stimuli.media.gaze_and_display import StatedViewing

    sheet = looks.compare is not None or looks.score is not None
    choices = _choices(condition.methods, condition.settings, sheet)
    alone = not any(isinstance(one, Path) for one in vars(looks).values())
    outputs = Outputs(out or (Path("foveated.png") if alone else None), **vars(looks))
    moving = picture.is_dir() or is_video(picture)
    each = seen.gaze if is_of_frames(seen.gaze) else None
    if moving:
        _check_clip(picture, out, outputs, clip.video)
    else:
        _check(picture, outputs, clip, each)
    console = PlainConsole(soft_wrap=True)
    with renderer(console, numpy_only) as ctx, ProgressLines(console) as teller:
        reading = file.reading(seen.panorama)
        viewing = StatedViewing(None if each else seen.gaze, seen.display, seen.fov, seen.panorama)
        if not moving:
            foveate_file(
                picture, outputs, viewing=viewing, choices=choices, seed=condition.seed,
                reading=reading, ctx=ctx, reporter=teller.reporter,
            )  # fmt: skip
            return
        with frames_of(picture, clip.fps, teller.say) as (frames, rate):
            track = track_of(each, seen.display, rate, teller.say) if each else None
            foveate_clip(
                frames, out or Path("foveated"), viewing=viewing, choice=choices[0],
                asked=ClipSettings(clip.flow, track, clip.video, rate, reading),
                seed=condition.seed, ctx=ctx, reporter=teller.reporter,
            )  # fmt: skip


@contextmanager
def frames_of(
    picture: Path, fps: float | None, say: Callable[[str], None]
) -> Iterator[tuple[Path, float]]:
    """Give a folder of frames, and their rate: of a video for as long as the block lasts."""
    from pipeline.video_file import is_video
    from stimuli.media.video import unpacked_video

    if not is_video(picture):
        yield picture, fps or DEFAULT_FPS
        return
    with unpacked_video(picture) as unpacked:
        for note in unpacked.notes:
            say(f"note: {note}")
        yield unpacked.folder, fps or unpacked.fps


def _check_clip(picture: Path, out: Path | None, outputs: Outputs, video: Path | None) -> None:
    """Refuse what is made of one picture alone."""
    from stimuli.media.video import CODECS

    if video is not None:
        check_outputs({"--video": (video, tuple(CODECS))}, [], [picture])
    looks = ("compare", "steps", "score", "animate", "flip", "page")
    given = [f"--{name}" for name in looks if getattr(outputs, name) is not None]
    if given:
        raise StudyError(f"{given[0]} takes one picture, not a folder; give it a frame")
    if out is not None and out.suffix.lower() in FILE_ENDINGS:
        raise StudyError(f"OUT must be a folder, as PICTURE is a folder of frames (got {out})")


def _check(picture: Path, outputs: Outputs, clip: ClipOptions, each: str | None) -> None:
    """Refuse what is for frames, and before the work what could not be written after it."""
    from stimuli.media.moving import ENDINGS

    given = {"--video": clip.video, "--fps": clip.fps, f"--gaze {each}": each}
    if wrong := [name for name, value in given.items() if value is not None]:
        raise StudyError(f"{wrong[0]} is for a folder of frames or a video (PICTURE is neither)")
    if clip.flow is not None:
        raise StudyError("--flow is for a folder of frames (PICTURE is no folder)")

    check_outputs(
        {
            "OUT": (outputs.out, FILE_ENDINGS),
            "--compare": (outputs.compare, (".png",)),
            "--animate": (outputs.animate, ENDINGS),
            "--flip": (outputs.flip, ENDINGS),
            "--page": (outputs.page, (".html",)),
        },
        [outputs.steps, outputs.score],
        [picture],
    )
    if outputs.steps is not None:
        check_result(outputs.steps, replace=True)
    if outputs.score is not None:
        from stimuli.score.write_scores import check_out

        check_out(outputs.score)


def _choices(methods: list[str] | None, settings: list[str] | None, sheet: bool) -> list[Choice]:
    from pipeline.foveation.conditions import condition_parameters
    from pipeline.named_classes import Choice
    from stimuli.foveate.condition_sheet import usual_choices

    every = [choice.name for choice in usual_choices()]
    chosen = choose_methods(
        methods, settings, every=every, default=DEFAULT_METHOD, known=condition_parameters,
        sheet=sheet, sheets="--compare FILE or --score FOLDER",
    )  # fmt: skip
    return [Choice(name, parameters) for name, parameters in chosen]


_REPLAY = "replay:"


def is_of_frames(gaze: str | None) -> bool:
    """True if it names a gaze per frame."""
    return gaze is not None and (gaze.startswith(_REPLAY) or Path(gaze).suffix.lower() == ".csv")


def track_of(gaze: str, display: str | None, fps: float, say: Callable[[str], None]) -> Track:
    """Read ``replay:FILE`` or ``FILE.csv``.

    A frame has the last sample at its time, on the grid of gazes of a live picture. A recording is
    of the screen, in whose middle frames stand: that of `display`, or one as large as the frames.

    Raises
    ------
    StudyError
        If there is no such recording or table; and by the track, if it does not fit the frames.
    """
    if gaze.startswith(_REPLAY):
        from study_app.gaze.open_source import SAME_TIME_S, recorded
        from study_app.live.renderer import on_grid

        recording = recorded(gaze.removeprefix(_REPLAY))

        def replay(frames: int, size: tuple[int, int]) -> NDArray[np.float64]:
            height, width = size
            screen = load_display(display) if display is not None else None
            across, down = (screen.width_px, screen.height_px) if screen else (width, height)
            here = recording.on_screen(across, down)
            for note in here.notes:
                say(f"note: {note}")
            times_s = np.arange(frames) / fps
            if times_s[-1] > here.t_s[-1] + 1 / here.rate_hz:
                say(
                    f"note: {here.path.name} ends after {here.t_s[-1]:.3g} s, the frames after"
                    f" {times_s[-1]:.3g} s, at {fps:g} a second: its last gaze is held"
                )
            last = np.searchsorted(here.t_s, times_s + SAME_TIME_S, side="right") - 1
            corner = (across - width) // 2, (down - height) // 2
            places = zip(here.x_px[last] - corner[0], here.y_px[last] - corner[1], strict=True)
            return np.array([on_grid(place) for place in places])

        return replay
    from stimuli.score.viewing_conditions import read_viewer_gaze

    points = np.array(read_viewer_gaze(gaze, may_be_lost=True).points_px)

    def table(frames: int, size: tuple[int, int]) -> NDArray[np.float64]:  # noqa: ARG001
        if len(points) != frames:
            raise StudyError(
                f"{gaze}: must hold one line per frame ({frames} frames, got {len(points)} lines);"
                f" samples with times are read by --gaze {_REPLAY}{gaze}"
            )
        return points

    return table
