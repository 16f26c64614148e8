"""`metamerlab texture`: textures as statistics, and scenes that read them so."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from study_app.cli.option_groups import CommandGroup
from study_app.cli.pictures.one_picture_options import (
    LOOK,
    PictureViewing,
    SeedOption,
    SettingsOption,
    check_file,
    gaze_option,
    read_parameters,
    renderer,
)
from study_app.cli.progress import ProgressLines
from study_app.cli.terminal import PlainConsole

app = CommandGroup(
    help="""Bake textures into statistics, and draw scenes with them.

    Examples:

        metamerlab texture bake wall.png --out wall.moments

        metamerlab texture show planet --out planet.png
    """,
)


@app.command()
def bake(
    texture: Annotated[Path, typer.Argument(help="A picture of 8 or 16 bits a channel.")],
    out: Annotated[
        Path, typer.Option(help="The file to write, .moments; replaced if there.")
    ] = Path("texture.moments"),
    wrap: Annotated[
        bool, typer.Option(help="The texture wraps: its right border continues at its left.")
    ] = False,
) -> None:
    """Bake a texture: its halvings, and the pooled moments of every level of its pyramid.

    Rows are processed a few at a time: 8192 x 8192 px take less than 1 GiB of memory.

    Examples:

        metamerlab texture bake wall.png --out wall.moments

        metamerlab texture bake mars.tif --wrap --out mars.moments
    """
    from pipeline.textures.baked_file import ENDING
    from stimuli.texture.texture_files import bake_file

    check_file(out, (ENDING,))
    with ProgressLines(PlainConsole(soft_wrap=True)) as teller:
        bake_file(texture, out, wraps=wrap, reporter=teller.reporter)


@dataclass(frozen=True)
class DrawingOptions:
    """Size of a drawn scene, and turn of its globes."""

    size_px: Annotated[int, typer.Option(min=64, max=8192)] = 768
    """Edge of the square pictures."""
    turn: Annotated[float, typer.Option(metavar="DEG")] = 0.0
    """Turn the globes by this angle."""
    animate: Annotated[Path | None, typer.Option(rich_help_panel=LOOK)] = None
    """Animation (.webp, or .png for APNG) of the turning globes."""


@app.command()
def show(
    scene: Annotated[str, typer.Argument(help="planet or spheres.")],
    out: Annotated[Path, typer.Option(help="The sheet to write, .png or .jpg.")] = Path(
        "texture.png"
    ),
    baked: Annotated[
        Path | None,
        typer.Option(help=r"A map of a globe, baked with --wrap. \[default: a built-in planet]"),
    ] = None,
    gaze: Annotated[str | None, gaze_option("where the scene says")] = None,
    *,
    seen: PictureViewing,
    settings: SettingsOption = None,
    seed: SeedOption = 0,
    drawing: DrawingOptions,
) -> None:
    """Draw a scene three times: as it is, with a foveated blur, and with noise for what it lost.

    --set takes parameters of the condition metamer: law, scaling, alpha, rate, fovea_deg, levels,
    noise. The command prints how many bytes of the texture foveation saves.

    Examples:

        metamerlab texture show planet --out planet.png

        metamerlab texture show spheres --set law=authors --gaze 0deg,0deg

        metamerlab texture show planet --baked mars.moments --animate turning.webp
    """
    from pipeline.errors import GLUnavailableError
    from stimuli.media.moving import ENDINGS
    from stimuli.texture.texture_files import SceneSettings, metamer_settings, show_scene

    check_file(out, (".png", ".jpg"))
    if drawing.animate is not None:
        check_file(drawing.animate, ENDINGS)
    asked = SceneSettings(baked, drawing.size_px, drawing.turn, drawing.animate)
    chosen = metamer_settings(read_parameters(settings or []))
    console = PlainConsole(soft_wrap=True)
    with renderer(console, False) as ctx, ProgressLines(console) as teller:
        if ctx is None:
            raise GLUnavailableError("scenes are drawn by OpenGL 4.3; 'metamerlab doctor' helps")
        show_scene(
            scene, out, ctx, asked=asked, viewing=seen.stated(gaze), settings=chosen,
            seed=seed, reporter=teller.reporter,
        )  # fmt: skip
