"""`metamerlab stimuli`: build, check and look at a study's clips."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from protocols.errors import StudyError
from study_app.cli.errors import user_errors
from study_app.cli.options import DisplayOption, ProtocolArgument
from study_app.cli.progress import progress_bar
from study_app.cli.score_command import score

if TYPE_CHECKING:
    from stimuli.orders import Orders

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="""Build and check a study's clips.

    Examples:

        metamerlab stimuli build demo --out clips --dry-run

        metamerlab stimuli build demo --out clips

        metamerlab stimuli check clips

        metamerlab stimuli score clips --out scores

        metamerlab stimuli look place.glb --out views.png
    """,
)

GIB = 2**30

FolderArgument = Annotated[Path, typer.Argument(help="Folder of built clips.")]


@app.command()
def build(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="Folder for the clips; made if it is missing.")],
    display: DisplayOption = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help=r"Processes on this machine. \[default: one per core]",
                     show_default=False),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Use the workers of this Dask cluster instead."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say clips, frames, disk and time; build nothing.")
    ] = False,
) -> None:  # fmt: skip
    """Build every clip of a study: scene x size x method, hashed, manifest last.

    Killed at any point, the same command goes on where it was. A changed method
    or scene makes only its own clips again.

    Examples:

        metamerlab stimuli build demo --out clips --dry-run

        metamerlab stimuli build my-study.toml --out clips --workers 4

        metamerlab stimuli build my-study.toml --out /shared/clips --scheduler tcp://host:8786
    """
    with user_errors():
        orders = _orders(protocol, display)
        if scheduler is not None and workers is not None:
            raise StudyError(
                "--workers and --scheduler exclude each other: the cluster has its own"
            )
        if dry_run:
            _print_estimate(orders, out, workers)
            return
        _build(orders, out, workers, scheduler)


@app.command()
def check(folder: FolderArgument) -> None:
    """Hash every file again and name each that is missing, changed or extra.

    Ends with status 1 if there is any, and 2 if the folder holds no finished batch.

    Example: metamerlab stimuli check clips
    """
    from stimuli.check import check_batch

    with user_errors():
        with progress_bar() as progress:
            task = progress.add_task("hashing", total=None)
            verdict = check_batch(
                folder, lambda done, total: progress.update(task, completed=done, total=total)
            )
        for kind in ("missing", "changed", "extra"):
            for name in getattr(verdict, kind):
                print(f"{kind}: {folder / name}")
        if not verdict.in_order:
            counts = ", ".join(
                f"{len(getattr(verdict, kind))} {kind}" for kind in ("missing", "changed", "extra")
            )
            print(f"{folder}: not in order ({counts}); run 'metamerlab stimuli build' again")
            raise typer.Exit(1)
        clips = len(verdict.manifest.clips)
        print(
            f"{folder}: in order. {clips} clips, {verdict.frames} frames, manifest"
            f" {verdict.manifest.sha256[:12]}."
        )


@app.command()
def probe(
    folder: FolderArgument,
    clips: Annotated[
        list[str] | None,
        typer.Argument(help="Clips, such as garden__small__metameric; left out: all."),
    ] = None,
) -> None:
    """Look for faults over time: flicker inside holes, repeated frames, black frames.

    Flicker is how much the holes' pixels change from frame to frame beyond what the
    reference's change: 1 is as restless as the truth. Ends with status 1 on repeated
    or black frames.

    Example: metamerlab stimuli probe clips garden__small__metameric
    """
    from stimuli.probe import probe_batch

    with user_errors():
        with progress_bar() as progress:
            task = progress.add_task("reading frames", total=None)
            findings = probe_batch(
                folder,
                clips,
                lambda done, total: progress.update(task, completed=done, total=total),
            )
        table = Table(box=None)
        table.add_column("clip", overflow="fold")
        for column in ("change in holes", "of the reference's", "repeated", "black"):
            table.add_column(column, justify="right")
        for found in findings:
            table.add_row(
                found.name,
                "-" if found.flicker is None else f"{255 * found.flicker:.2f}/255",
                "-"
                if found.flicker_ratio is None
                else f"{found.flicker_ratio:.2f}" + (" flickers" if found.flickers else ""),
                _frames(found.repeated),
                _frames(found.black),
            )
        Console(highlight=False).print(table)
        if any(found.repeated or found.black for found in findings):
            raise typer.Exit(1)


@app.command()
def look(
    scene: Annotated[
        str, typer.Argument(help="A .glb, .gltf or .obj file, or a built-in scene's name.")
    ],
    out: Annotated[Path, typer.Option(help="Contact sheet to write, .png.")] = Path("views.png"),
    scale: Annotated[float, typer.Option(help="Metres per unit of the file.")] = 1.0,
    views: Annotated[int, typer.Option(min=1, max=64, help="How many views to draw.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Of a built-in scene.")] = 0,
    view: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LINE",
            help="Draw this view only: the protocol's line, 'view = {...}'. May be repeated.",
        ),
    ] = None,
) -> None:
    """Draw candidate views of a 3D scene, to choose a camera from.

    Every view comes with the line to copy into the protocol.

    Examples:

        metamerlab stimuli look place.glb --out views.png

        metamerlab stimuli look place.glb --out views.png \\
            --view "view = { position_m = [0, 1.6, 4], look_at_m = [0, 1, -2] }"
    """
    from pipeline.gl.context import create_context, release_context
    from protocols.load import parse_view
    from stimuli.look import look_around

    with user_errors():
        if out.suffix.lower() != ".png":
            raise StudyError(f"{out}: must end in .png")
        chosen = [parse_view(line) for line in view or ()]
        ctx = create_context()
        try:
            with Console(stderr=True).status("drawing views ..."):
                lines = look_around(
                    ctx, scene, out, scale=scale, count=views, seed=seed, chosen=chosen
                )
        finally:
            release_context(ctx)
        print("\n".join(lines))
        print(f"wrote {out}")


app.command()(score)


def _frames(indices: list[int]) -> str:
    if not indices:
        return "none"
    shown = ", ".join(map(str, indices[:4]))
    return shown + (f", ... ({len(indices)})" if len(indices) > 4 else "")


def _orders(protocol: Path, display: str | None) -> Orders:
    from importlib import import_module

    from protocols.feasibility import check_feasible
    from protocols.load import load_display, load_protocol
    from protocols.registries import check_methods, check_scenes
    from stimuli.orders import Orders

    study = load_protocol(protocol)
    screen = load_display(display or study.display.display, beside=protocol)
    methods = import_module("pipeline.methods.registry")
    scenes = import_module("stimuli.scenes.registry")
    problems = check_methods(study, methods.method_names(), methods.method_parameters)
    problems += check_scenes(study, scenes.scene_names())
    problems += check_feasible(study, screen)
    if problems:
        raise StudyError("\n".join(f"{protocol}: {problem}" for problem in problems))
    return Orders(study, screen, protocol.absolute().parent)


def _print_estimate(orders: Orders, out: Path, workers: int | None) -> None:
    from stimuli.estimate import estimate
    from stimuli.executors import cores

    count = workers or cores()
    with Console(stderr=True).status("making one frame by every method ..."):
        found = estimate(orders, out, count)
    table = Table(show_header=False, box=None)
    for name, value in (
        ("clips", str(found.clips)),
        ("frames", f"{found.frames}, {found.size_px[0]} x {found.size_px[1]} px"),
        ("disk", f"{found.disk_bytes / GIB:.2f} GiB ({found.free_bytes / GIB:.0f} GiB free)"),
        ("time", f"about {_duration(found.time_s)} with {count} workers"),
        ("renderer", found.renderer),
    ):
        table.add_row(name, value)
    Console(highlight=False).print(table)
    if found.disk_bytes > found.free_bytes:
        raise StudyError(
            f"{out}: the clips need about {found.disk_bytes / GIB:.2f} GiB (free are"
            f" {found.free_bytes / GIB:.2f} GiB); choose a larger disk"
        )


def _build(orders: Orders, out: Path, workers: int | None, scheduler: str | None) -> None:
    from stimuli.build import build as build_batch
    from stimuli.executors import cores, dask_cluster, local_processes

    console = Console(highlight=False, soft_wrap=True, markup=False)
    with ExitStack() as stack:
        if scheduler is not None:
            executor, parallel = stack.enter_context(dask_cluster(scheduler))
        else:
            parallel = workers or min(cores(), len(orders.clip_names))
            executor = stack.enter_context(local_processes(parallel))
        progress = stack.enter_context(progress_bar())
        task = progress.add_task("starting", total=None)

        def report(done: int, total: int, what: str) -> None:
            progress.update(task, completed=done, total=total, description=what)

        outcome = build_batch(orders, out.absolute(), executor, parallel=parallel, report=report)
    table = Table("scene, size", box=None)
    for column in ("extent", "holes", "least", "most", "margin"):
        table.add_column(column, justify="right")
    shown = set()
    for clip in outcome.manifest.clips:
        if (clip.scene, clip.size) in shown:
            continue
        shown.add((clip.scene, clip.size))
        least, most = (
            float(str(clip.parameters[f"hole_share_{end}"])) for end in ("least", "most")
        )
        table.add_row(
            f"{clip.scene}, {clip.size}",
            f"{float(str(clip.parameters['extent_m'])):.4g} m",
            f"{100 * clip.hole_share:.2f} %",
            f"{100 * least:.2f} %",
            f"{100 * most:.2f} %",
            f"{clip.parameters['margin_px']} px",
        )
    console.print(table)
    console.print(
        f"{out}: {len(outcome.built)} clips built, {len(outcome.kept)} kept; manifest"
        f" {outcome.manifest.sha256[:12]}. Look at {out / 'contact-sheet.html'}"
    )


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
