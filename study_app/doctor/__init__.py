"""Is this machine fit? One finding per question: PASS, WARN or FAIL, with the cure.

The checks judge facts; what a driver must be asked for is asked in a process
of its own (`probes`), so that a driver that crashes is a finding too.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Set
from pathlib import Path

import psutil

import metamerlab
from study_app.doctor.findings import EVERY_JOB, Finding, Job, Needs, Status, worst
from study_app.doctor.graphics import check_display, check_egl, check_gl
from study_app.doctor.probes import Answer, ask
from study_app.doctor.software import (
    check_extras,
    check_fonts,
    check_names,
    check_packages,
    check_python,
    check_text_shaping,
    requirements,
    tested_versions,
)
from study_app.doctor.storage import check_disk, check_memory

__all__ = ["EVERY_JOB", "Finding", "Job", "Needs", "Status", "examine", "worst"]


def examine(
    folder: Path,
    *,
    jobs: Set[Job] = EVERY_JOB,
    needs: Needs | None = None,
    probe: Callable[[str], Answer] = ask,
) -> list[Finding]:
    """Ask every question of this machine that bears on `jobs`.

    Parameters
    ----------
    folder : Path
        Where recordings and stimuli will be written; its disk is tested with a
        file of 32 MiB that is removed again.
    jobs : set of Job
        What the machine is for; no window is opened unless sessions are among it.
    needs : Needs, optional
        What the study asks for.
    probe : callable
        Answers ``"gl"``, ``"egl"`` and ``"display"``; the default asks the drivers.
    """
    needs = needs or Needs()
    findings = [
        check_python(),
        check_packages(requirements(), tested_versions()),
        check_extras(requirements()),
        check_names(metamerlab.PACKAGES),
        check_gl(probe("gl"), needs),
        *((check_egl(probe("egl")),) if sys.platform == "linux" else ()),
        *(check_display(probe("display"), os.environ) if Job.SESSIONS in jobs else ()),
        check_text_shaping(),
        check_fonts(),
        *check_disk(folder, needs),
        check_memory(psutil.virtual_memory().available / 1e9, needs),
    ]
    return [finding for finding in findings if finding.jobs & jobs]
