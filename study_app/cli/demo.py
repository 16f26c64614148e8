"""`metamerlab demo`: the method at work on a real picture, with nothing to bring."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from study_app.cli.errors import user_errors

METHODS = ("push-pull", "push-pull-depth", "metameric")
SHEET = "before-and-after.png"


def demo(
    out: Annotated[Path, typer.Option(help="Folder to write to; made if it is missing.")] = Path(
        "out/demo"
    ),
    seed: Annotated[int, typer.Option(help="Of the noise; same seed, same pictures.", min=0)] = 0,
) -> None:
    """See the method at work on one picture.

    A photograph of a motorcycle with depth is warped to the other eye's view; the holes
    that open are filled by push-pull and metamerically, and shown beside the truth.

    Example:

        metamerlab demo --out out/demo
    """
    with user_errors():
        _run(out, seed)


def _run(out: Path, seed: int) -> None:
    from pipeline.gl.context import create_context, describe, release_context
    from stimuli import pictures
    from stimuli.exr import save_colour
    from stimuli.one_frame import Choice, comparison, warp_and_fill
    from stimuli.scenes.stereo import built_in_pair

    console = Console(highlight=False)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        step = progress.add_task("opening OpenGL", total=None)
        out.mkdir(parents=True, exist_ok=True)
        ctx = create_context()
        try:
            renderer = describe(ctx)
            progress.update(step, description="warping and filling the motorcycle pair")
            pair = built_in_pair("motorcycle")
            warped, fills = warp_and_fill(
                ctx,
                pair.warp_input(),
                [Choice(name) for name in METHODS],
                truth=pair.right,
                seed=seed,
            )
        finally:
            release_context(ctx)
        progress.update(step, description="writing pictures")
        for fill in fills:
            save_colour(out / f"{fill.choice.name}.png", fill.colour)
        pictures.save_picture(out / SHEET, comparison(warped, fills, pair.right))
    height, width = warped.size
    console.print(f"renderer: {renderer}")
    console.print(f"{width} x {height} px, holes {100 * warped.hole.mean():.1f} % of the frame")
    console.print(f"look at {out / SHEET}")
