"""Builder of a stimulus recipe, as `metamerlab stimuli build` calls it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from protocols.display import Display
from protocols.errors import Problem
from protocols.study_file.schema import StudyProtocol
from stimuli.batch.batch_folder import BuildOutcome, Report
from stimuli.batch.estimate import BuildEstimate

__all__ = ["BuildEstimate", "BuildMachine", "BuildOutcome", "Builder", "Report"]


@dataclass(frozen=True)
class BuildMachine:
    """Machine that does the work."""

    workers: int | None = None
    """Processes or threads here; None: one per core."""
    scheduler: str | None = None
    """Address of a Dask cluster in their place."""
    tls: Mapping[str, str] = field(default_factory=dict)
    """Its certificates, as `stimuli.batch.executors.dask_cluster` takes them."""


class Builder:
    """Makes the stimuli of one recipe.

    Parameters
    ----------
    protocol : StudyProtocol
        A study whose `stimuli.kind` is the builder's.
    display : Display
        The study's, or the one that the clips are wanted for.
    folder : Path
        What file names in the protocol are relative to.
    """

    def __init__(self, study: StudyProtocol, display: Display, folder: Path) -> None:
        self.protocol, self.display, self.folder = study, display, folder

    def problems(self) -> list[Problem]:
        """Return the wishes of the recipe that this installation cannot meet."""
        return []

    def lacking(self) -> list[Problem]:
        """Return the needs of a build that this installation lacks, though they could be had.

        No mistake of the study: where sessions run, built stimuli are enough.
        """
        return []

    def notes(self) -> list[Problem]:
        """Return notes on possible mistakes, which may be meant."""
        return []

    def estimate(self, out: Path, workers: int) -> BuildEstimate:
        """Return the cost of a build.

        Raises
        ------
        StudyError, InputError, OSError
            As a build raises them.
        """
        raise NotImplementedError

    def build(self, out: Path, where: BuildMachine, report: Report) -> BuildOutcome[Any]:
        """Build what is missing in `out`; write the manifest last.

        Raises
        ------
        StudyError, InputError, OSError
            With one line for each mistake. What was finished stays for the next run, and there is
            no manifest.
        """
        raise NotImplementedError

    def summary(self, outcome: BuildOutcome[Any]) -> tuple[Sequence[str], list[Sequence[str]]]:
        """Return a table of what was made: its header, its rows; empty where there is nothing."""
        raise NotImplementedError
