"""Calls for programs, one for a command each: `metamerlab` offers them.

Each takes a study's file or the name of a shipped study, and folders; each raises what the command
says in one message: `StudyError`, `InputError`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from analysis import SEED
from protocols.errors import StudyError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.power_curves import Power
    from analysis.report.write_report import ReportPaths
    from protocols.manifest import Manifest
    from stimuli.score.measure_clips import ScoreResults
    from study_app.conduct import RunOutcome

TABLES = (".csv", ".tsv", ".xlsx", ".ods")


def build(
    study: str | Path, out: str | Path, *, display: str | None = None, workers: int | None = None
) -> Manifest:
    """Build every clip or still of a study in `out`; what is there already is kept.

    Parameters
    ----------
    study : str or Path
        Its file, or the name of a shipped study.
    display : str, optional
        Another display than the study's: a shipped name or a file.
    workers : int, optional
        Processes at work; by default one per core. A program that asks for several must start
        under ``if __name__ == "__main__":``.

    Raises
    ------
    StudyError, InputError
        As `metamerlab stimuli build` says.
    """
    from protocols.load import load_study
    from stimuli.recipes.base import BuildMachine
    from study_app.cli.build_command import require_buildable

    loaded, screen = load_study(Path(study), display)
    builder, _ = require_buildable(Path(study), loaded, screen)
    machine = BuildMachine(workers, None, {})
    return builder.build(Path(out).absolute(), machine, lambda *_: None).manifest


def simulate(
    study: str | Path,
    sessions: str | Path,
    participants: int,
    *,
    clips: str | Path | None = None,
    display: str | None = None,
    seed: int = 0,
) -> dict[str, RunOutcome]:
    """Run artificial observers through the real session; complete sessions are kept.

    Parameters
    ----------
    sessions : str or Path
        Folder of sessions, marked as simulated: ``sessions/STUDY/S001/journal.jsonl`` and so on.
    clips : str or Path, optional
        Folder of built clips; by default clips without pixels.

    Returns
    -------
    dict
        Outcome by participant, of those whose session was not complete before.

    Raises
    ------
    StudyError
        If the display cannot show the study, or a folder holds something else.
    """
    from protocols.load import load_study
    from protocols.manifest import read_manifest
    from study_app.simulate import SimulatedStudy, simulate_study

    if participants < 1:
        raise StudyError(f"participants must be at least 1 (got {participants})")
    loaded, screen = load_study(Path(study), display)
    shown = None if clips is None else read_manifest(Path(clips))
    simulation = SimulatedStudy(loaded, screen, seed=seed, manifest=shown)
    return simulate_study(simulation, Path(sessions), participants)


def score(
    test: str | Path,
    reference: str | Path | None = None,
    *,
    mask: str | Path | None = None,
    metrics: Sequence[str] | None = None,
    display: str = "standard_fhd",
    workers: int | None = None,
) -> ScoreResults:
    """Measure clips against their reference by many metrics, in holes and over the frame.

    Parameters
    ----------
    test, reference : str or Path
        Two pictures or folders of frames; or one folder of built clips.
    mask : str or Path, optional
        For two: where the holes are, white; a picture or a folder.
    metrics : sequence of str, optional
        By default all that this machine can compute.

    Raises
    ------
    StudyError, InputError
        As `metamerlab stimuli score` says.
    """
    from stimuli.batch.executors import cores
    from stimuli.score.measure_clips import score as measured
    from study_app.cli.score_command import ScoreOptions, subjects_of

    options = ScoreOptions(
        second=None if reference is None else Path(reference),
        mask=None if mask is None else Path(mask),
        metrics=None if metrics is None else ",".join(metrics),
        display=display,
    )
    subjects, settings = subjects_of(options, Path(test), None)
    return measured(subjects, settings, workers=workers or cores())


def report(
    sessions: str | Path,
    out: str | Path,
    *,
    study: str | Path | None = None,
    settings: Mapping[str, str] | None = None,
    replace: bool = False,
) -> ReportPaths:
    """Analyse a study's sessions, or a table of decisions, and write the report into `out`.

    Parameters
    ----------
    study : str or Path, optional
        Whose sessions these are; a table goes without.
    settings : mapping, optional
        Of the analysis of a table, in place of what is noted beside it.
    replace : bool
        Whether an earlier report in `out` is replaced.

    Raises
    ------
    StudyError
        As `metamerlab analysis report` says.
    """
    from analysis.report.report_source import TableSettings
    from analysis.report.write_report import report_decisions, report_sessions
    from protocols.load import load_protocol

    read, folder = Path(sessions), Path(out)
    loaded = None if study is None else load_protocol(Path(study), recorded=True)
    if read.suffix.lower() in TABLES and not read.is_dir():
        table = TableSettings(loaded, None, (), dict(settings or {}))
        return report_decisions(read, folder, table=table, replace=replace)
    if loaded is None or settings:
        raise StudyError(f"{read}: sessions need study=, and no settings=: those are a table's")
    return report_sessions(read, loaded, folder, replace=replace)


def power(
    study: str | Path,
    assumed: Mapping[str, float] | None = None,
    *,
    participants: Sequence[int] | None = None,
    studies: int | None = None,
    seed: int = SEED,
) -> Power:
    """Simulate a study's own design and planned test for growing numbers of participants.

    Parameters
    ----------
    assumed : mapping, optional
        What is taken for true, such as ``{"rate": 0.65}``; the rest keep their own values.
        `metamerlab analysis power` prints them.
    studies : int, optional
        How many to simulate; by default as many as take seconds.

    Raises
    ------
    StudyError, ValueError
        If the study or an assumption breaks a rule.
    """
    import numpy as np

    from analysis.power import power as simulated_power
    from analysis.tasks import analysis_of
    from protocols.load import load_protocol

    loaded = load_protocol(Path(study))
    simulation = analysis_of(loaded.analysis.kind).simulation(loaded)
    return simulated_power(
        simulation,
        assumed or {},
        rng=np.random.default_rng(seed),
        participants=participants,
        studies=studies,
    )
