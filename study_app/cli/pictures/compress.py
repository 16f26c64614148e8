"""`metamerlab compress` and `decompress`: pictures as colour and statistics for one gaze."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from protocols.disk.result_folder import check_folder, check_result
from study_app.cli.pictures.one_picture_options import (
    FILE_ENDINGS,
    LOOK,
    GazeOption,
    NumpyOption,
    PictureViewing,
    SeedOption,
    check_file,
    check_outputs,
    renderer,
)
from study_app.cli.progress import ProgressLines
from study_app.cli.terminal import PlainConsole

if TYPE_CHECKING:
    from pipeline.compression.codec import CompressionSettings


@dataclass(frozen=True)
class CodingOptions:
    """Size of a compressed file, and what it holds."""

    size_kb: Annotated[float | None, typer.Option(min=0.1)] = None
    """The largest file, in 1000 bytes: the best quality that fits is looked for."""
    quality: Annotated[int | None, typer.Option(min=1, max=95)] = None
    r"""Quality of the colours. \[default: 75]"""
    codec: str = "jpeg"
    """jpeg, avif or webp, for colour and maps."""
    angles: Annotated[
        int | None, typer.Option(show_default="512; with --size-kb what fits at quality 50")
    ] = None
    """Cells around the gaze. Fewer make a smaller file; the picture is sharp up to angles / 6.3
    pixels from the gaze."""
    statistics: Annotated[bool, typer.Option("--statistics/--no-statistics")] = True
    """Keep statistics of the periphery, or its blurred colour alone."""
    hold: Annotated[int | None, typer.Option(min=1, max=65535, show_default="12")] = None
    """Number of frames of a clip that share statistics."""

    def settings(self) -> CompressionSettings:
        """Return them as the codec takes them.

        Raises
        ------
        InputError
            If both a size and a quality are given.
        """
        from pipeline.compression.codec import DEFAULT_QUALITY, CompressionSettings
        from pipeline.errors import InputError

        if self.size_kb is not None and self.quality is not None:
            raise InputError("give --size-kb or --quality, not both: a size sets the quality")
        return CompressionSettings(
            self.codec,
            self.angles,
            DEFAULT_QUALITY if self.quality is None else self.quality,
            None if self.size_kb is None else round(1000 * self.size_kb),
            self.statistics,
            CompressionSettings.hold if self.hold is None else self.hold,
        )


@dataclass(frozen=True)
class CompressionFigureOptions:
    """Pictures that are made to be looked at."""

    panel: ClassVar = LOOK

    compare: Path | None = None
    """One labelled sheet (.png): the picture beside plain, foveated and metameric files of this
    size."""
    steps: Path | None = None
    """Folder for pictures of what the file holds: cells, maps, their density; sheet.png shows them
    all."""


def compress(
    picture: Annotated[Path, typer.Argument(help="A picture, a folder of frames, or a video.")],
    out: Annotated[
        Path, typer.Option(help="The file to write, .metamer; replaced if there.")
    ] = Path("picture.metamer"),
    gaze: GazeOption = None,
    *,
    coding: CodingOptions,
    seen: PictureViewing,
    looks: CompressionFigureOptions,
) -> None:
    """Compress a picture for one gaze.

    Colour is stored in cells that grow with the eccentricity, and statistics of what they lose.
    At equal size a plain codec keeps the whole picture better; this format is better near the
    gaze. See docs/compression.md.

    Examples:

        metamerlab compress photo.jpg --size-kb 41 --gaze 512,384 --out photo.metamer

        metamerlab compress photo.jpg --codec avif --compare sheet.png

        metamerlab compress frames/ --hold 24 --out clip.metamer

        metamerlab compress walk.mp4 --out walk.metamer
    """
    from pipeline.errors import InputError
    from pipeline.video_file import is_video
    from stimuli.compress.compress_files import ENDING, compress_file

    settings = coding.settings()
    if coding.hold is not None and not (picture.is_dir() or is_video(picture)):
        raise InputError("--hold is for frames and videos; leave it out for one picture")
    check_outputs(
        {"--out": (out, (ENDING,)), "--compare": (looks.compare, (".png",))},
        [looks.steps],
        [picture],
    )
    if looks.steps is not None:
        check_result(looks.steps, replace=True)
    with ProgressLines(PlainConsole(soft_wrap=True)) as teller:
        compress_file(
            picture, out, viewing=seen.stated(gaze), settings=settings,
            compare=looks.compare, steps=looks.steps, reporter=teller.reporter,
        )  # fmt: skip


def decompress(
    file: Annotated[Path, typer.Argument(help="A .metamer file.")],
    out: Annotated[
        Path,
        typer.Option(help="The picture to write, .png or .exr; for a clip a folder of frames."),
    ] = Path("picture.png"),
    seed: SeedOption = 0,
    statistics: Annotated[
        bool,
        typer.Option(
            "--statistics/--no-statistics",
            help="Add noise with the statistics, or show the colour alone.",
        ),
    ] = True,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="For a clip: write its frames as a video too, .mp4, .webm, or lossless .avi.",
        ),
    ] = None,
    fps: Annotated[float, typer.Option(min=1, max=1000, help="Frame rate of --video.")] = 30.0,
    numpy_only: NumpyOption = False,
) -> None:
    """Make a picture that has the colour and the statistics of a compressed file.

    Examples:

        metamerlab decompress photo.metamer --out photo.png

        metamerlab decompress clip.metamer --out frames/ --video clip.mp4 --fps 60
    """
    from stimuli.compress.compress_files import decompress_file
    from stimuli.media.video import CODECS

    if video is not None:
        check_file(video, tuple(CODECS))
    if out.suffix.lower() in FILE_ENDINGS:
        check_file(out, FILE_ENDINGS)
    else:
        check_folder(out)
    console = PlainConsole(soft_wrap=True)
    with renderer(console, numpy_only) as ctx, ProgressLines(console) as teller:
        decompress_file(
            file, out, seed=seed, statistics=statistics, video=video, fps=fps, ctx=ctx,
            reporter=teller.reporter,
        )  # fmt: skip
