"""`metamerlab doctor`: is this machine fit for the job?"""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import load_display
from protocols.outside import visible
from protocols.revision import code_revision, package_version
from study_app.cli.terminal import PlainConsole, say
from study_app.doctor import EVERY_JOB, FOR_SESSIONS, Finding, Job, Status, worst
from study_app.doctor.machine import examine
from study_app.gaze.open_source import check_kind, open_gaze
from study_app.gaze.source import GazeSample, TrackerContext

LISTEN_S = 1.0
_FEWEST = 0.8
"""Share of the samples that should come, and of those that should see an eye."""


def check_tracker(specification: str, display: Display) -> Finding:
    """A gaze source, as ``--gaze`` names it, opened as a session opens it; it is not calibrated.

    Raises
    ------
    StudyError
        If there is no such kind.
    """
    check_kind(specification)
    middle_px = display.width_px / 2, display.height_px / 2
    desk = TrackerContext(
        display, time.monotonic, lambda: middle_px, display.refresh_hz, store=False
    )
    try:
        source = open_gaze(specification, desk)
    except StudyError as error:
        return Finding("tracker", Status.FAIL, str(error), "see docs/trackers.md", FOR_SESSIONS)
    try:
        samples, until_s = list[GazeSample](), time.monotonic() + LISTEN_S
        source.poll()  # what came while it was opened
        while time.monotonic() < until_s:
            time.sleep(1 / display.refresh_hz)
            samples += source.poll()
        info, told = source.info(), [*source.info().notes, *source.news()]
    finally:
        source.close()
    seen = sum(sample.valid for sample in samples) / max(1, len(samples))
    found = (
        f"{info.source} {info.description}: {len(samples)} samples in {LISTEN_S:g} s at"
        f" {info.rate_hz:.4g} Hz, {100 * seen:.0f} % of them with an eye"
    )
    if told:
        found += "; " + "; ".join(told)
    if len(samples) < _FEWEST * info.rate_hz * LISTEN_S or seen < _FEWEST:
        cure = "seat someone before it, and see its own program; a busy machine sends late"
        return Finding("tracker", Status.WARN, found, cure, FOR_SESSIONS)
    return Finding("tracker", Status.PASS, found, "", FOR_SESSIONS)


_STYLES = {Status.PASS: "#0072B2", Status.WARN: "bold #E69F00", Status.FAIL: "bold #D55E00"}


def doctor(
    folder: Annotated[
        Path,
        typer.Option(
            help="Folder for recordings or stimuli: its disk is tested.",
            exists=True,
            file_okay=False,
        ),
    ] = Path(),
    jobs: Annotated[
        list[Job] | None,
        typer.Option(
            "--for", help="Judge the machine for this job only; may be given more than once."
        ),
    ] = None,
    gaze: Annotated[
        str | None,
        typer.Option(
            help="Also open this gaze source, as 'session run --gaze' does, and listen for a"
            " second."
        ),
    ] = None,
    display: Annotated[
        str, typer.Option(help="Display that the gaze source is of: a name or a .toml file.")
    ] = "fhd27-60hz",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the findings as JSON, for a record or a script.")
    ] = False,
) -> None:
    """Check that this machine is fit for the job.

    One line per question: PASS, WARN or FAIL, with the cure.
    Ends with status 1 if a job that you name FAILs; without names, if every job does.

    Examples:

        metamerlab doctor

        metamerlab doctor --for sessions --folder recordings

        metamerlab doctor --for sessions --gaze eyelink

        metamerlab doctor --json > doctor.json
    """
    wanted = frozenset(jobs) if jobs else EVERY_JOB
    tracker = gaze and check_tracker(gaze, load_display(display))
    findings = [*examine(folder, jobs=wanted), *([tracker] if tracker else ())]
    if as_json:
        say(json.dumps(_as_json(findings, wanted), indent=2))
    else:
        _print(findings, wanted)
    fit = [worst(one for one in findings if job in one.jobs) is not Status.FAIL for job in wanted]
    if not (all(fit) if jobs or gaze else any(fit)):
        raise typer.Exit(1)


def _print(findings: list[Finding], wanted: frozenset[Job]) -> None:
    console = PlainConsole()
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(max_width=22)
    table.add_column(ratio=1)
    for finding in findings:
        style = _STYLES[finding.status]
        table.add_row(Text(finding.status, style), finding.check, finding.found)
        if finding.cure:
            table.add_row("", "", Text(f"→ {visible(finding.cure)}", "italic"))
    console.print(table)
    console.print()
    for job in Job:
        if job in wanted:
            console.print(_verdict(job, findings))


def _verdict(job: Job, findings: list[Finding]) -> Text:
    mine = [finding for finding in findings if job in finding.jobs]
    status = worst(mine)
    style = _STYLES[status]
    names = ", ".join(finding.check for finding in mine if finding.status is status)
    verdict = {
        Status.PASS: "fit",
        Status.WARN: f"fit, with a warning about: {names}",
        Status.FAIL: f"not fit because of: {names}",
    }[status]
    return Text.assemble((status, style), f"  for {job}: {visible(verdict)}")


def _as_json(findings: list[Finding], wanted: frozenset[Job]) -> dict[str, object]:
    return {
        "metamerlab": package_version(),
        "revision": code_revision(),
        "status": worst(findings),
        "jobs": {
            job: worst([finding for finding in findings if job in finding.jobs])
            for job in Job
            if job in wanted
        },
        "findings": [{**asdict(finding), "jobs": sorted(finding.jobs)} for finding in findings],
    }
