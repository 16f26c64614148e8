"""`metamerlab denoise`: noisy renders to metamers, by networks that predict statistics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from protocols.disk.result_folder import check_folder
from study_app.cli.option_groups import CommandGroup
from study_app.cli.pictures.one_picture_options import (
    FILE_ENDINGS,
    LOOK,
    GazeOption,
    NumpyOption,
    PictureViewing,
    SeedOption,
    check_file,
    renderer,
)
from study_app.cli.progress import ProgressLines, going_on
from study_app.cli.terminal import PlainConsole

app = CommandGroup(
    help="""Turn noisy path-traced pictures into metamers for a gaze.

    A network predicts the statistics of the clean picture, and noise with these statistics is
    added. Another network predicts the picture itself, for comparison. Both come with metamerlab
    and need the extra onnx. Rendering noisy pictures and training need the extra denoise.

    Examples:

        metamerlab denoise render castle --gaze 128,128 --out noisy.png

        metamerlab denoise run noisy.png --gaze 128,128 --out metamer.png
    """,
)


@app.command()
def run(
    picture: Annotated[
        Path, typer.Argument(help="A noisy picture, or a folder of frames.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option(help="The picture to write, .png or .exr; for frames a folder.")
    ] = Path("denoised.png"),
    gaze: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="The gaze that the picture was rendered for: pixels from the upper left corner"
            " (512,384), or degrees right of and below the middle (5deg,-3deg). Must be given.",
            show_default=False,
        ),
    ] = None,
    network: Annotated[
        str, typer.Option(help="moments, rgb, or an .onnx file that train made.")
    ] = "moments",
    *,
    seen: PictureViewing,
    seed: SeedOption = 0,
    numpy_only: NumpyOption = False,
    compare: Annotated[
        Path | None,
        typer.Option(
            help="One labelled sheet (.png): noisy, by the network for colour, by this one.",
            rich_help_panel=LOOK,
        ),
    ] = None,
) -> None:
    """Denoise: predict the moments of the clean picture, and make a metamer of them.

    The picture should have most samples where the eye looks and one in the periphery, as render
    makes it. What our networks can and cannot do: docs/denoising.md.

    Examples:

        metamerlab denoise run noisy.png --gaze 128,128 --out metamer.png --compare sheet.png

        metamerlab denoise run noisy.png --gaze 128,128 --network rgb --out plain.png

        metamerlab denoise run frames/ --gaze 0deg,0deg --out denoised/
    """
    from stimuli.denoised.denoise_files import denoise_file

    if out.suffix.lower() in FILE_ENDINGS:
        check_file(out, FILE_ENDINGS)
    else:
        check_folder(out)
    if compare is not None:
        check_file(compare, (".png",))
    console = PlainConsole(soft_wrap=True)
    with renderer(console, numpy_only) as ctx, ProgressLines(console) as teller:
        denoise_file(
            picture, out, viewing=seen.stated(gaze), network=network, seed=seed,
            compare=compare, ctx=ctx, reporter=teller.reporter,
        )  # fmt: skip


@app.command()
def render(
    scene: Annotated[str, typer.Argument(help="A built-in scene.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The noisy picture, .png or .exr.")] = Path("noisy.png"),
    gaze: GazeOption = None,
    view: Annotated[
        int, typer.Option(min=0, help="Index of the camera: 0 is the scene's own.")
    ] = 0,
    clean: Annotated[
        Path | None,
        typer.Option(help="Clean picture to write too, .png or .exr.", show_default=False),
    ] = None,
    clean_samples: Annotated[
        int, typer.Option(min=1, help="Samples per pixel of the clean picture.")
    ] = 128,
    size_px: Annotated[int, typer.Option(help="Edge, a multiple of 8.")] = 256,
) -> None:
    """Path-trace a built-in scene: 32 samples a pixel at the gaze, 1 in the periphery.

    Needs Mitsuba 3, of the extra denoise. The scene is seen 40 degrees wide.

    Examples:

        metamerlab denoise render castle --gaze 128,128 --out noisy.png

        metamerlab denoise render shed --view 3 --clean clean.png --clean-samples 256
    """
    from stimuli.denoised.denoise_files import render_scene
    from stimuli.denoised.training_pictures import Rendering

    check_file(out, FILE_ENDINGS)
    if clean is not None:
        check_file(clean, FILE_ENDINGS)
    rendering = Rendering(size_px, clean_samples if clean is not None else 1)
    with ProgressLines(PlainConsole(soft_wrap=True)) as teller:
        render_scene(
            scene, out, gaze=gaze, view=view, clean=clean, rendering=rendering,
            reporter=teller.reporter,
        )  # fmt: skip


@dataclass(frozen=True)
class TrainingOptions:
    """Pictures that networks are trained on, for how long, and files that are written."""

    scene: Annotated[list[str] | None, typer.Option(show_default=False)] = None
    r"""A built-in scene to train on; may be given more than once. \[default: colonnade, garden,
    shed]"""
    out: Path = Path("denoise.onnx")
    """The network for moments, .onnx; the one for colour goes to NAME-rgb."""
    work: Path = Path("denoise-work")
    """Folder for pictures and checkpoints; what it holds is used."""
    views: Annotated[int, typer.Option(min=1)] = 3
    """Cameras in each scene."""
    steps: Annotated[int, typer.Option(min=1)] = 1200
    """Training steps."""
    crop_px: int = 96
    """Edge of a crop, a multiple of 8."""
    size_px: int = 256
    """Edge of the pictures, a multiple of 8."""
    clean_samples: Annotated[int, typer.Option(min=1)] = 128
    """Samples per clean pixel."""
    seed: Annotated[int, typer.Option(min=0)] = 1
    """Seed of gazes, crops, weights."""
    estimate: bool = False
    """Print the time that it takes, then stop."""


@app.command()
def train(asked: TrainingOptions) -> None:
    """Render noisy and clean pictures, train two networks on them, and write both.

    The command first says how long it takes. After an interruption the same command continues. It
    needs torch, Mitsuba 3 and onnx, all in the extra denoise.

    Examples:

        metamerlab denoise train --estimate

        metamerlab denoise train --scene colonnade --scene street --steps 3000 --out mine.onnx

        metamerlab denoise run noisy.png --gaze 128,128 --network mine.onnx
    """
    from pipeline.errors import InputError
    from stimuli.denoised.train import Training
    from stimuli.denoised.train import train as train_networks
    from stimuli.denoised.training_pictures import Rendering

    check_file(asked.out, (".onnx",))
    check_folder(asked.work)
    if asked.out.stem.endswith("-rgb"):
        raise InputError(f"{asked.out}: must not end in -rgb, as the network for colour does")
    training = Training(
        tuple(asked.scene) if asked.scene else Training().scenes, asked.views, steps=asked.steps,
        crop_px=asked.crop_px, seed=asked.seed,
        rendering=Rendering(asked.size_px, asked.clean_samples),
    )  # fmt: skip
    with going_on(), ProgressLines(PlainConsole(soft_wrap=True)) as teller:
        train_networks(
            training, asked.out, asked.work, estimate_only=asked.estimate,
            reporter=teller.reporter,
        )  # fmt: skip
