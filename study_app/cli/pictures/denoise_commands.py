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
    GazeOption,
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
    and need the extra onnx. Rendering noisy pictures needs the extra denoise.

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

    The picture should have most samples where the eye looks and one in the periphery, as render
    makes it. What our networks can and cannot do: docs/denoising.md.

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
    from stimuli.denoise.denoise_files import render_scene
    from stimuli.denoise.path_traced import Rendering

    check_file(out, FILE_ENDINGS)
    if clean is not None:
        check_file(clean, FILE_ENDINGS)
    rendering = Rendering(size_px, clean_samples if clean is not None else 1)
    with ProgressLines(PlainConsole(soft_wrap=True)) as teller:
        render_scene(
            scene, out, gaze=gaze, view=view, clean=clean, rendering=rendering,
            reporter=teller.reporter,
        )  # fmt: skip
