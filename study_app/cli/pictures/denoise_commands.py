"""`metamerlab denoise`: noisy renders to metamers, by networks that predict statistics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from protocols.disk.result_folder import check_folder
from study_app.cli.option_groups import CommandGroup
from study_app.cli.pictures.one_picture_options import (
    FILE_ENDINGS,
    LOOK,
    NumpyOption,
    PictureViewing,
    SeedOption,
    check_file,
    renderer,
)
from study_app.cli.progress import ProgressLines
from study_app.cli.terminal import PlainConsole

app = CommandGroup(
    help="""Turn noisy path-traced pictures into metamers for a gaze.

    A network predicts the statistics of the clean picture, and noise with these statistics is
    added. Another network predicts the picture itself, for comparison. Both come with metamerlab
    and need the extra onnx. Noisy pictures come from any path tracer.

    Example:

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
        str, typer.Option(help="moments, rgb, or an .onnx file that train of version 0.3 made.")
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

    The picture should have most samples where the eye looks and one in the periphery. How many, and
    what our networks can and cannot do: docs/denoising.md.

    Examples:

        metamerlab denoise run noisy.png --gaze 128,128 --out metamer.png --compare sheet.png

        metamerlab denoise run noisy.png --gaze 128,128 --network rgb --out plain.png

        metamerlab denoise run frames/ --gaze 0deg,0deg --out denoised/
    """
    from stimuli.denoise.denoise_files import denoise_file

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
