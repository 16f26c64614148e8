"""`metamerlab doctor`: is this machine fit for the job?"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from protocols.load import load_display
from protocols.outside import visible
from protocols.revision import code_revision, package_version
from study_app.cli.terminal import PlainConsole, say
from study_app.doctor import EVERY_JOB, Finding, Job, Status, examine, worst
from study_app.doctor.tracker import check_tracker

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
    Ends with status 1 if anything FAILs; changes nothing on the machine.

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
    if worst(findings) is Status.FAIL:
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
