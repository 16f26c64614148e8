"""`metamerlab stimuli build`: every clip of a study, or what they would cost."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from protocols.errors import StudyError
from study_app.cli.options import DisplayOption, ProtocolArgument
from study_app.cli.progress import going_on, progress_line
from study_app.cli.terminal import PlainConsole, say_notes, table_of

if TYPE_CHECKING:
    from protocols.display import Display
    from protocols.manifest import Manifest
    from protocols.study_file.schema import StudyProtocol
    from stimuli.recipes.base import Builder, BuildMachine


GIB = 2**30


@dataclass(frozen=True)
class MachineOptions:
    """Machines that build."""

    workers: Annotated[int | None, typer.Option(min=1)] = None
    r"""Processes on this machine. \[default: one per core]"""
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS")] = None
    """Use the workers of this Dask cluster instead: tcp://HOST:PORT, or tls://HOST:PORT with
    certificates."""
    tls_ca_file: Path | None = None
    """Certificates that --scheduler must be signed by, PEM."""
    tls_cert: Path | None = None
    """Certificate that we show to --scheduler, PEM."""
    tls_key: Path | None = None
    """Its private key, PEM."""

    def certificates(self) -> dict[str, str]:
        """Return the files that are given, under the names that `dask_cluster` takes.

        Raises
        ------
        StudyError
            If one is no file, or comes without a cluster.
        """
        found = {}
        for name in ("tls_ca_file", "tls_cert", "tls_key"):
            path = getattr(self, name)
            if path is None:
                continue
            option = f"--{name.replace('_', '-')}"
            if self.scheduler is None:
                raise StudyError(f"{option}: must come with --scheduler tls://HOST:PORT")
            if not path.is_file():
                raise StudyError(f"{option}: must be a file, PEM (got {path})")
            key = name if name == "tls_ca_file" else name.replace("tls_", "tls_client_")
            found[key] = str(path)
        return found


def build(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="Folder for the clips; made if it is missing.")],
    display: DisplayOption = None,
    *,
    machines: MachineOptions,
    dry_run: Annotated[
        bool, typer.Option(help="Print clips, frames, disk and time; build nothing.")
    ] = False,
) -> None:  # fmt: skip
    """Build every clip or still of a study, hashed, manifest last.

    Clips are rendered from scenes, or taken from your pictures and videos, as the study's
    'stimuli.kind' says. After an interruption the same command continues. A changed
    method, scene or file makes only its own clips again.

    Examples:

        metamerlab stimuli build demo --out clips --dry-run

        metamerlab stimuli build my-study.toml --out clips --workers 4

        metamerlab stimuli build my-study.toml --out /shared/clips --scheduler tcp://host:8786

    A Dask scheduler listens on every network interface unless 'dask scheduler --host ADDRESS'
    says otherwise, and runs what anyone sends who reaches it, or has a certificate of its TLS.
    Start one only in a network that you trust.
    """
    from protocols.load import load_study
    from stimuli.recipes.base import BuildMachine

    study, screen = load_study(protocol, display)
    builder, _ = require_buildable(protocol, study, screen)
    say_notes(builder.notes())
    if machines.scheduler is not None and machines.workers is not None:
        raise StudyError("--workers and --scheduler exclude each other: the cluster has its own")
    tls = machines.certificates()
    if dry_run:
        _print_estimate(builder, out, machines.workers)
        return
    _build(builder, out, BuildMachine(machines.workers, machines.scheduler, tls))


def _print_estimate(builder: Builder, out: Path, workers: int | None) -> None:
    from stimuli.batch.executors import cores

    count = workers or cores()
    with PlainConsole(stderr=True).status("trying the first ..."):
        found = builder.estimate(out, count)
    rows = (
        ("clips", str(found.clips)),
        ("frames", f"{found.frames}, {found.size_px[0]} x {found.size_px[1]} px"),
        ("disk", f"{found.disk_bytes / GIB:.2f} GiB ({found.free_bytes / GIB:.0f} GiB free)"),
        ("time", f"about {_duration(found.time_s)} with {count} workers"),
        ("renderer", found.renderer),
        *((("measured", found.measured),) if found.measured else ()),
    )
    PlainConsole().print(table_of((), rows, box=None))
    if found.disk_bytes > found.free_bytes:
        raise StudyError(
            f"{out}: the clips need about {found.disk_bytes / GIB:.2f} GiB (free are"
            f" {found.free_bytes / GIB:.2f} GiB); choose a larger disk"
        )


def _build(builder: Builder, out: Path, where: BuildMachine) -> None:
    from pipeline.gl.context import NUMPY_INSTEAD
    from stimuli.worker import NUMPY

    console = PlainConsole(soft_wrap=True)
    with going_on(), progress_line("starting") as report:
        outcome = builder.build(out.absolute(), where, report)
    heads, rows = builder.summary(outcome)
    console.print(table_of(heads, rows, right=1 if len(heads) > 2 else None, box=None))
    if outcome.manifest.renderer.renderer == NUMPY.renderer:
        console.print(f"note: {NUMPY_INSTEAD}")
    what = "clips" if builder.protocol.stimuli.clip_s is not None else "stills"
    console.print(
        f"{out}: {len(outcome.built)} {what} built, {len(outcome.kept)} kept; manifest"
        f" {outcome.manifest.sha256[:12]}. Look at {out / 'contact-sheet.html'}"
    )


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def require_buildable(
    path: Path,
    study: StudyProtocol,
    display: Display,
    manifest: Manifest | None = None,
) -> tuple[Builder, dict[str, str]]:
    """Check the recipe's names, the display, and clips where they are given.

    Returns
    -------
    Builder, dict
        Of the study's stimuli; and why no font here writes a language, of each that none writes.

    Raises
    ------
    StudyError
        With a line for every mistake; `path` says where.
    """
    from protocols.study_file.plausible import display_notes
    from stimuli.recipes import builder_of
    from study_app.shown_texts import shortcomings

    builder = builder_of(study, display, path.absolute().parent)
    found = shortcomings(study, display, manifest)
    unfit = found.problems
    if unfit:  # measures in other units are a likely cause
        unfit = [*display_notes(display), *unfit]
    problems = [*builder.problems(), *unfit]
    if problems:
        raise StudyError("\n".join(f"{path}: {problem}" for problem in problems))
    return builder, found.unwritten
