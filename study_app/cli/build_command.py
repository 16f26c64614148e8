"""`metamerlab stimuli build`: every clip of a study, or what they would cost."""

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

if TYPE_CHECKING:
    from stimuli.orders import Orders

GIB = 2**30


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


def _orders(protocol: Path, display: str | None) -> Orders:
    from protocols.load import load_study
    from stimuli.orders import Orders
    from study_app.cli.checked_study import require_buildable

    study, screen = load_study(protocol, display)
    require_buildable(protocol, study, screen)
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

        try:
            outcome = build_batch(
                orders, out.absolute(), executor, parallel=parallel, report=report
            )
        except BaseException:
            progress.remove_task(task)  # a bar over what went wrong says nothing
            raise
    table = Table("scene, size", box=None)
    for column in ("extent", "holes", "least", "most", "margin"):
        table.add_column(column, justify="right")
    shown = set()
    for clip in outcome.manifest.clips:
        if (clip.column("scene"), clip.column("size")) in shown:
            continue
        shown.add((clip.column("scene"), clip.column("size")))
        least, most = (
            float(str(clip.parameters[f"hole_share_{end}"])) for end in ("least", "most")
        )
        table.add_row(
            f"{clip.column('scene')}, {clip.column('size')}",
            f"{float(str(clip.parameters['extent_m'])):.4g} m",
            f"{100 * (clip.hole_share or 0):.2f} %",
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
