"""Source of a report: sessions, or a table of decisions.

Notes say how sessions were recorded, as far as it bears on what their numbers can say.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pandas as pd

from analysis.parts import AnalysisPlan
from analysis.plans.table_sections import PreferenceTableSection
from analysis.tables.table import BY_IMPORT, Table
from analysis.tasks import analysis_of
from analysis.tasks.base import AnyAnalysis
from analysis.tasks.note import note_path, options_from, read_note
from analysis.tidy import TidyTables, read_sessions
from protocols.disk.hashing import Json, sha256_file
from protocols.errors import StudyError, count_of
from protocols.latency import LatencySummary
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Analysis

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ReportSource:
    """Source of an analysis: sessions, or a table of decisions."""

    analysis: AnyAnalysis
    decisions: pd.DataFrame
    tidy: TidyTables | None
    study: StudyProtocol | None
    plan: AnalysisPlan
    simulated: bool
    provenance: dict[str, Json]
    warnings: tuple[str, ...]
    only: tuple[str, ...] = ()
    """Parts of the report; none: all."""
    read: tuple[str, ...] = ()
    """Those of the warnings that say how a table was read."""


def from_sessions(folder: Path, study: StudyProtocol, progress: Progress | None) -> ReportSource:
    """Read every session below `folder`.

    Raises
    ------
    StudyError
        As `analysis.tidy.read_sessions`; also if exclusions leave no decision.
    """
    tidy = read_sessions(folder, study, progress=progress)
    decisions = tidy.analysed
    if decisions.empty:
        lost = "; ".join(
            f"{step.step}: {count_of(step.sittings_out, 'session')},"
            f" {count_of(step.decisions_out, 'decision')} out"
            for step in tidy.flow[1:]
            if step.sittings_out or step.decisions_out
        )
        raise StudyError(
            f"{folder}: at least one decision must remain after exclusions"
            f" (none of {tidy.flow[0].decisions_left} does: {lost or 'no main trial was decided'})"
        )
    sessions = tidy.sessions
    provenance: dict[str, Json] = {
        "protocol": study.study.name,
        "protocol_version": study.study.version,
        "protocol_sha256": study.sha256,
        "stimuli_sha256": study.stimuli_sha256,
        "manifest_sha256": sorted(set(sessions["manifest_sha256"])),
        "recorded_with": sorted(set(sessions["revision"])),
        "timing_evidence": sorted(set(sessions["timing_evidence"])),
        "journals_sha256": {
            str(name): str(digest)
            for name, digest in zip(sessions["session"], sessions["journal_sha256"], strict=True)
        },
    }
    if tidy.live:
        provenance["sample_to_flip"] = LatencySummary.of(tidy.live).model_dump(mode="json")
    analysis = analysis_of(study.analysis.kind)
    return ReportSource(
        analysis,
        decisions,
        tidy,
        study,
        analysis.plan(study),
        tidy.simulated,
        provenance,
        (*recording_notes(sessions), *tidy.warnings),
    )


@dataclass(frozen=True)
class TableSettings:
    """Settings of a report on a table of decisions.

    Parameters
    ----------
    study : StudyProtocol, optional
        Task, conditions and rules; its exclusions are not applied, because a plain table does not
        hold what they need. Without one, the task is the one that `analysis import` noted beside
        the table; a table without that note must hold preferences.
    title : str, optional
        At the top of the page; left out: the protocol's, or the table's name.
    where : sequence of str
        Conditions that rows must fulfil, as `analysis.tables.table.Table` takes them.
    told : mapping
        Keys of the analysis, in place of those noted.
    """

    study: StudyProtocol | None = None
    title: str | None = None
    where: Sequence[str] = ()
    told: Mapping[str, str] = field(default_factory=dict)


def from_table(path: Path, given: TableSettings = TableSettings()) -> ReportSource:
    """Read a table of decisions.

    Raises
    ------
    StudyError
        If the table cannot be read, holds no decision, or does not fit the protocol; if nothing
        says which task it is of.
    """
    study = given.study
    if study is not None and given.told:
        raise StudyError("--set must be left out with --protocol, which says how to analyse")
    notes: list[str] = []
    noted = read_note(path, notes)
    table = Table(path, where=given.where, command=BY_IMPORT)
    if study is not None:
        analysis = analysis_of(study.analysis.kind)
        plan = analysis.plan(study)
        decisions = _main(path, analysis.read(table, analysis.section_of_table(plan)))
        analysis.check_table(path, decisions, plan)
        notes.append("the protocol's exclusion rules were not applied to this table")
    else:
        noted = noted or _guessed(table)
        analysis = analysis_of(noted.kind)
        section = options_from(noted.kind, given.told, noted)
        decisions = _main(path, analysis.read(table, section))
        plan = analysis.plan_of_table(decisions, path.stem, section)
    if given.title is not None:
        plan = plan.but(title=given.title)
    return _of_table(analysis, table, decisions, plan, notes, study)


def from_question(
    analysis: AnyAnalysis, table: Table, section: Analysis, only: Collection[str] = ()
) -> ReportSource:
    """Read a table for one question: a kind of analysis, and the section that a command tells.

    `only` are the parts that answer it; none: all.

    Raises
    ------
    StudyError
        If the table lacks a column, or holds what cannot be.
    """
    decisions = analysis.read(table, section)
    plan = analysis.plan_of_table(decisions, table.path.stem, section)
    notes = analysis.table_notes(decisions, plan)
    return replace(_of_table(analysis, table, decisions, plan, notes), only=tuple(only))


def _of_table(
    analysis: AnyAnalysis,
    table: Table,
    decisions: pd.DataFrame,
    plan: AnalysisPlan,
    notes: Sequence[str],
    study: StudyProtocol | None = None,
) -> ReportSource:
    digest = sha256_file(table.path) if table.path.is_file() else None  # a folder has none
    simulated = "simulated" in decisions and bool(decisions["simulated"].fillna(0).max())
    provenance: dict[str, Json] = {
        "table_sha256": digest,
        "protocol_sha256": plan.protocol_sha256,
    }
    read = ("imported table: no record of timing, gaze or exclusions can be checked", *table.notes)
    return ReportSource(
        analysis, decisions, None, study, plan, simulated, provenance, (*read, *notes), read=read
    )


def _main(path: Path, decisions: pd.DataFrame) -> pd.DataFrame:
    """Return the main decisions that are included."""
    kept = decisions[(decisions["included"] == 1) & (decisions["kind"] == "main")]
    if kept.empty:
        raise StudyError(f"{path}: must hold at least one main decision that is included")
    return kept.reset_index(drop=True)


def _guessed(table: Table) -> Analysis:
    """Take a table for one of preferences unless its columns speak of right answers."""
    path, columns = table.path, set(table.rows.columns)
    if not {"first", "second"} & columns and {"correct", "answer"} & columns:
        raise StudyError(
            f"{path}: must come with a protocol (--protocol), or from 'metamerlab analysis import"
            " --task TASK', which notes the task beside the table"
            f" (there is no {note_path(path).name} here, and the columns fit several tasks)"
        )
    return PreferenceTableSection()


_NAMED = 5
_TIMING = {
    "software timer": "a timer stood in for the display's refresh, as in rehearsals: nothing"
    " vouches for how long anything was shown",
    "unverified": "the driver did not vouch for the flips: frames may have been shown later or"
    " shorter than the journal says",
}


def recording_notes(sessions: pd.DataFrame) -> tuple[str, ...]:
    """Return the weaknesses of how sessions were recorded, a sentence each.

    Parameters
    ----------
    sessions : DataFrame
        A row per session, with ``session``, ``simulated``, ``timing_evidence`` and ``dropped``,
        as `analysis.tidy` makes it.
    """
    notes = []
    if (sessions["simulated"] == 1).any():
        count = int((sessions["simulated"] == 1).sum())
        who = "All" if count == len(sessions) else f"{count} of {len(sessions)}"
        notes.append(
            f"{who} sessions are simulated: they show what the analysis does, not what people do"
        )
    for evidence, said in _TIMING.items():
        names = sessions.loc[sessions["timing_evidence"] == evidence, "session"]
        if len(names):
            notes.append(f"In {_sessions(list(names))} {said}")
    late = sessions[sessions["dropped"] > 0]
    if len(late):
        notes.append(
            f"In {_sessions(list(late['session']))} refreshes were missed in trials that count"
            f" ({int(late['dropped'].sum())} in all, at most {int(late['dropped'].max())} in one"
            " session): clips skipped a frame there"
        )
    return tuple(notes)


def recording_sentence(sessions: pd.DataFrame) -> str:
    """Return the sentences of methods on how stimuli were shown and gaze was watched.

    `sessions` is as `analysis.tidy` makes it; those that exclusions left out are not told of.
    """
    kept = sessions[sessions["excluded"] == ""]
    if kept.empty:
        return ""
    rates = sorted({round(float(rate)) for rate in kept["refresh_hz"].dropna()})  # as measured
    at = f" at {', '.join(map(str, rates))} Hz" * bool(rates)
    stamps = ", ".join(sorted(kept["timing_evidence"].unique()))
    attempts = count_of(int(kept["attempts"].sum()), "attempt")
    void, missed = int(kept["void"].sum()), int(kept["dropped"].sum())
    told = [
        f"Stimuli were shown{at} (time stamps: {stamps}). Of {attempts} at main trials {void} were"
        f" void. Refreshes missed in trials that count: {missed}."
    ]
    watched = kept[kept["gaze_mean_deg"].notna()]
    if len(watched):
        left, away = int(watched["gaze_violations"].sum()), float(watched["gaze_mean_deg"].mean())
        lost = float(watched["gaze_lost_share"].mean())
        such = " (such attempts are void)" * (set(watched["gaze_mode"]) == {"enforce"})
        told.append(
            f"Gaze was watched in {count_of(len(watched), 'session')}: it left the place that was"
            f" asked for {left} times{such}, lay {away:.2f} deg from it on average, and was lost"
            f" for {100.0 * lost:.1f} % of the time."
        )
    return " ".join(told)


def _sessions(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
    return f"{len(names)} session{'s' * (len(names) != 1)} ({shown})"
