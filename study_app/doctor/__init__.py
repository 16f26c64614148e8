"""Checks of the machine: one finding per question, PASS, WARN or FAIL, with the cure.

The checks judge facts; what a driver must be asked for is asked in a process
of its own (`probes`), so that a driver that crashes is a finding too.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass


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
FOR_SESSIONS = frozenset({Job.SESSIONS})
FOR_STIMULI = frozenset({Job.STIMULI})
FOR_BOTH = FOR_SESSIONS | FOR_STIMULI


@dataclass(frozen=True)
class Finding:
    """The answer to one question, and what to do about it."""

    check: str
    status: Status
    found: str
    cure: str = ""
    jobs: frozenset[Job] = EVERY_JOB


def worst(findings: Iterable[Finding]) -> Status:
    """Return the worst status of `findings`, PASS for none."""
    order = list(Status)
    return max((finding.status for finding in findings), key=order.index, default=Status.PASS)
