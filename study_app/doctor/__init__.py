"""Is this machine fit? One finding per question: PASS, WARN or FAIL, with the cure.

The checks judge facts; what a driver must be asked for is asked in a process
of its own (`probes`), so that a driver that crashes is a finding too.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Set
from pathlib import Path

import psutil

from study_app.doctor.findings import EVERY_JOB, Finding, Job, Status, worst
from study_app.doctor.graphics import check_display, check_gl
from study_app.doctor.machine import (
    check_disk,
    check_memory,
    check_packages,
    check_texts,
    requirements,
    tested_versions,
)
from study_app.doctor.probes import Answer, ask

__all__ = ["EVERY_JOB", "Finding", "Job", "Status", "examine", "worst"]


def examine(
    folder: Path, *, jobs: Set[Job] = EVERY_JOB, probe: Callable[[str], Answer] = ask
) -> list[Finding]:
    """Ask every question of this machine that bears on `jobs`.

    Parameters
    ----------
    folder : Path
        Where recordings and stimuli will be written; its disk is tested with a
        file of 32 MiB that is removed again.
    jobs : set of Job
        What the machine is for; no window is opened unless sessions are among it.
    probe : callable
        Answers ``"gl"`` and ``"display"``; the default asks the drivers.
    """
    findings = [
        check_packages(requirements(), tested_versions()),
        check_gl(probe("gl")),
        *(check_display(probe("display"), os.environ) if Job.SESSIONS in jobs else ()),
        *check_texts(),
        *check_disk(folder),
        check_memory(psutil.virtual_memory().available / 1e9),
    ]
    return [finding for finding in findings if finding.jobs & jobs]
