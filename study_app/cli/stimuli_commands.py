"""`metamerlab stimuli`: build, check and look at a study's clips."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from protocols.errors import StudyError, count_of
from study_app.cli.build_command import build
from study_app.cli.option_groups import CommandGroup
from study_app.cli.options import DisplayOption, ProtocolArgument, one_of
from study_app.cli.progress import progress_line
from study_app.cli.score_command import score
from study_app.cli.terminal import PlainConsole, say, say_notes, table_of

app = CommandGroup(
    help="""Build and check a study's clips.

    Examples:

        metamerlab stimuli build demo --out clips --dry-run

        metamerlab stimuli build demo --out clips

        metamerlab stimuli check clips

        metamerlab stimuli score clips --out scores

        metamerlab stimuli look place.glb --out views.png

        metamerlab stimuli panorama street --out street-360.png

        metamerlab stimuli export-holes my-study.toml --out holes
    """,
)


app.command()(build)


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(help="Folder of built clips.")],
    clips: Annotated[
        list[str] | None,
        typer.Argument(
            help="With --flicker: clips, such as garden__small__metameric; left out: all."
        ),
    ] = None,
    *,
    flicker: Annotated[
        bool,
        typer.Option(
            help="Look for faults over time instead: flicker inside holes, repeated and black"
            " frames."
        ),
    ] = False,
) -> None:
    """Hash every file again, and name those that are missing, changed or extra.

    Ends with status 1 if there is any, and 2 if the folder holds no finished batch.

    Flicker is how much pixels in holes change from frame to frame, over how much those of the
    reference change: 1 is as much as the truth. --flicker ends with status 1 on repeated or black
    frames.

    Examples:

        metamerlab stimuli check clips

        metamerlab stimuli check clips garden__small__metameric --flicker
    """
    from stimuli.batch.check import check_batch

    if flicker:
        _probe(folder, clips)
        return
    if clips:
        raise StudyError("CLIPS: are for --flicker, as all files are hashed; add it")
    with progress_line("hashing") as report:
        verdict = check_batch(folder, lambda done, total: report(done, total, "hashing"))
    for kind in ("missing", "changed", "extra"):
        for name in getattr(verdict, kind):
            say(f"{kind}: {folder / name}")
    if not verdict.in_order:
        counts = ", ".join(
            f"{len(getattr(verdict, kind))} {kind}" for kind in ("missing", "changed", "extra")
        )
        say(f"{folder}: not in order ({counts}); run 'metamerlab stimuli build' again")
        raise typer.Exit(1)
    count = len(verdict.manifest.clips)
    say(
        f"{folder}: in order. {count} clips, {verdict.frames} frames, manifest"
        f" {verdict.manifest.sha256[:12]}."
    )


def _probe(folder: Path, clips: list[str] | None) -> None:
    from stimuli.batch.check import probe_batch

    with progress_line("reading frames") as report:
        findings = probe_batch(
            folder, clips, lambda done, total: report(done, total, "reading frames")
        )
    heads = ("clip", "change in holes", "of the reference's", "repeated", "black")
    rows = [
        (
            found.name,
            "-" if found.flicker is None else f"{255 * found.flicker:.2f}/255",
            "-"
            if found.flicker_ratio is None
            else f"{found.flicker_ratio:.2f}" + (" flickers" if found.flickers else ""),
            _frames(found.repeated),
            _frames(found.black),
        )
        for found in findings
    ]
    PlainConsole().print(table_of(heads, rows, right=1, box=None))
    if any(found.repeated or found.black for found in findings):
        raise typer.Exit(1)


@dataclass(frozen=True)
class LightingOptions:
    """The light of a file's scene."""

    lighting: Annotated[str | None, typer.Option(metavar="unlit|sun")] = None
    """Lighting of a file, as the protocol's key. Left out: sun for plain colours alone."""
    sun_direction: Annotated[tuple[float, float, float] | None, typer.Option(metavar="X Y Z")] = (
        None
    )
    """Direction from the scene towards the sun, y up, as the protocol's key."""


@app.command()
def look(
    scene: Annotated[
        str,
        typer.Argument(
            help="A .glb or .gltf file, a built-in scene's name, or an .exr panorama with distance."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Contact sheet to write, .png.")] = Path("views.png"),
    scale: Annotated[float, typer.Option(help="Metres per unit of the file.")] = 1.0,
    views: Annotated[int, typer.Option(min=1, max=64, help="Number of views to draw.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Seed of a built-in scene.")] = 0,
    view: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LINE",
            help="Draw this view only: the protocol's line, 'view = {...}'. May be repeated.",
        ),
    ] = None,
    *,
    light: LightingOptions,
) -> None:
    """Draw candidate views of a 3D scene, to choose a camera from.

    Every view comes with the line to copy into the protocol, as does a light that you ask for.

    Examples:

        metamerlab stimuli look place.glb --out views.png

        metamerlab stimuli look place.glb --out views.png \\
            --view "view = { position_m = [0, 1.6, 4], look_at_m = [0, 1, -2] }"

        metamerlab stimuli look place.glb --out views.png --sun-direction -1 1 0.5
    """
    from pipeline.gl.context import lent_context
    from protocols.load import parse_view
    from stimuli.rendering.scene_views import LIGHTINGS, ScenePreview, look_around, look_out

    kind = None if light.lighting is None else one_of("--lighting", light.lighting, LIGHTINGS)
    if out.suffix.lower() != ".png":
        raise StudyError(f"{out}: must end in .png")
    if Path(scene).suffix.lower() == ".exr":
        if view or kind or light.sun_direction:
            raise StudyError(f"{scene}: a panorama has one place and its own light; give --views")
        say("\n".join(look_out(Path(scene), out, views)))
        say(f"wrote {out}")
        return
    chosen = [parse_view(line) for line in view or ()]
    preview = ScenePreview(scene, scale, seed, chosen, kind, light.sun_direction)
    notes: list[str] = []
    with lent_context() as ctx, progress_line("trying views") as report:
        lines = look_around(
            ctx, preview, out, views, note=notes.append,
            report=lambda done, total: report(done, total, "trying views"),
        )  # fmt: skip
    say_notes(notes)
    say("\n".join(lines))
    say(f"wrote {out}")


@app.command()
def panorama(
    scene: Annotated[str, typer.Argument(help="A built-in scene's name, or a .glb or .gltf file.")],
    out: Annotated[Path, typer.Option(help="Picture to write, .png; with --depth .exr.")],
    height_px: Annotated[
        int,
        typer.Option(
            help="Height, 16 to 4096, with --depth to 2048; the panorama is twice as wide."
        ),
    ] = 2048,
    depth: Annotated[
        bool,
        typer.Option(
            "--depth",
            help="Write the distance along each pixel's ray too, one sample a pixel, as 'warp"
            " --panorama' and scenes of kind around need it.",
        ),
    ] = False,
    scale: Annotated[float, typer.Option(help="Metres per unit of the file.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of a built-in scene.")] = 1,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="LINE",
            help="Place to stand, and direction of the middle: the line 'view = {...}' of 'look'.",
        ),
    ] = None,
) -> None:
    """Draw all that is around a place in a 3D scene, as an equirectangular panorama.

    A study of foveated images can show any direction of it (the key view of a picture). `street`
    is complete in all directions. The other built-in scenes end behind the eye.

    Examples:

        metamerlab stimuli panorama street --out street-360.png

        metamerlab stimuli panorama place.glb --out place-360.png --height-px 1024

        metamerlab stimuli panorama colonnade --depth --out colonnade-360.exr --height-px 1024
    """
    from pipeline.gl.context import lent_context
    from pipeline.pictures.drawing import of_colour, save_picture
    from pipeline.pictures.panorama_file import save_panorama
    from protocols.load import parse_view
    from stimuli.rendering.open_scene import viewpoint_of
    from stimuli.rendering.render import WorldRenderer
    from stimuli.rendering.render_panorama import panorama_of, surroundings_of
    from stimuli.rendering.scene_views import ScenePreview

    if out.suffix.lower() != (".exr" if depth else ".png"):
        raise StudyError(f"{out}: must end in {'.exr, with --depth' if depth else '.png'}")
    world = ScenePreview(scene, scale, seed).world()
    say_notes(world.notes)
    if view is not None:
        world = world.seen_from(viewpoint_of(parse_view(view), world))

    def told(done: int, total: int) -> None:
        report(done, total, "looking around")

    with lent_context() as ctx, progress_line("looking around") as report:
        if depth:
            renderer = WorldRenderer(ctx, world)
            frame = surroundings_of(renderer, height_px, report=told)
            renderer.release()
        else:
            colour = panorama_of(ctx, world, height_px, report=told)
    out.parent.mkdir(parents=True, exist_ok=True)
    if depth:
        save_panorama(out, frame)
    else:
        save_picture(out, of_colour(colour))
    say(f"wrote {out}: {2 * height_px} x {height_px} px")


app.command()(score)


@app.command("export-holes")
def export_holes(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="A new or empty folder.")],
    display: DisplayOption = None,
) -> None:
    """Write a study's warped frames with masks and depth, for another program to fill.

    A README in the folder says what to send back. What comes back enters the study as the
    method 'frames:FOLDER/{scene}/{size}', and frames of another scene are refused.

    Example: metamerlab stimuli export-holes my-study.toml --out holes
    """
    from protocols.load import load_study
    from stimuli.batch.build_plan import BuildPlan
    from stimuli.batch.export_holes import export_holes as write
    from stimuli.recipes.warped_checks import look_at_scenes

    study, screen = load_study(protocol, display)
    plan = BuildPlan(study, screen, protocol.absolute().parent)
    found = look_at_scenes(plan)
    if found.wrong:
        raise StudyError("\n".join(f"{protocol}: {problem}" for problem in found.wrong))
    say_notes(found.doubtful)
    with progress_line("starting") as report:
        frames = write(plan, out, report)
    made = count_of(frames, "frame")
    say(f"{out}: {made} with holes; {out / 'README.md'} says what to send back")


def _frames(indices: list[int]) -> str:
    if not indices:
        return "none"
    shown = ", ".join(map(str, indices[:4]))
    return shown + (f", ... ({len(indices)})" if len(indices) > 4 else "")
