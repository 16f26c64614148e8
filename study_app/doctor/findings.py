"""Findings of checks, the jobs that they are for, and what a study asks of a machine."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any


class Status(enum.StrEnum):
    """Status of a finding: how it bears on the work; ordered from good to bad."""

    PASS = "PASS"
    WARN = "WARN"
    FAIL = "FAIL"


class Job(enum.StrEnum):
    """Job of a machine in a lab; few machines do all three."""

    STIMULI = "stimuli"
    SESSIONS = "sessions"
    ANALYSIS = "analysis"


EVERY_JOB = frozenset(Job)


@dataclass(frozen=True)
class Finding:
    """The answer to one question, and what to do about it."""

    check: str
    status: Status
    found: str
    cure: str = ""
    jobs: frozenset[Job] = EVERY_JOB
    details: Mapping[str, Any] = field(default_factory=dict)  # JSON, for `--json`


@dataclass(frozen=True)
class Needs:
    """Needs of a study on a machine; the defaults suit 3 s clips of 1080 x 1080 px.

    A clip of 3 s at 60 Hz takes 0.84 GB on the graphics card's side, and a trial
    holds the two it compares.
    """

    free_memory_warn_gb: float = 4.0
    free_memory_fail_gb: float = 1.0
    free_disk_warn_gb: float = 10.0
    free_disk_fail_gb: float = 1.0
    write_warn_mb_s: float = 30.0
    append_warn_s: float = 0.1  # between two trials nobody notices less
    texture_px: int = 4096
    texture_layers: int = 512


FOR_SESSIONS = frozenset({Job.SESSIONS})
FOR_STIMULI = frozenset({Job.STIMULI})
FOR_BOTH = FOR_SESSIONS | FOR_STIMULI


def worst(findings: Iterable[Finding]) -> Status:
    """Return the worst status of `findings`, PASS for none."""
    order = list(Status)
    return max((finding.status for finding in findings), key=order.index, default=Status.PASS)
