"""Journals to tidy tables.

One row per attempt, one per decision, one per session; `analysis.data_dictionary` has every
column.
Damaged journals are read past the damage, and the tables say so.
"""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from analysis.data_dictionary import (
    SESSION_COLUMNS,
    attempt_columns,
    decision_columns,
    dictionary,
    frame,
    tables_of,
)
from analysis.exclusions import FlowStep, apply_exclusions
from analysis.journals import Progress, StudyReadings, read_study
from analysis.participants import ParticipantFlow, demographics, participant_flow
from analysis.tables.table_files import write_table
from protocols.disk.hashing import sha256_file
from protocols.journal import (
    Answer,
    Attempt,
    Calibration,
    Consent,
    SessionEnd,
    SessionResume,
    SessionStart,
)
from protocols.journal_file import Journal
from protocols.latency import LiveFrames
from protocols.study_file.schema import StudyProtocol


@dataclass(frozen=True)
class TidyTables:
    """The tables of a study.

    Attributes
    ----------
    sessions, attempts, decisions, answers : DataFrame
        One row per session, attempt, decision, and answer to a closing question.
    flow : tuple of FlowStep
        From all sessions to the decisions analysed.
    participants : ParticipantFlow
        How many began, consented, completed and are analysed, and why the others are not.
    demographics : DataFrame
        Answers to closing questions with choices, counted.
    simulated : bool
        Artificial observers answered: every output must say so.
    warnings : tuple of str
        Damage, missing trials, withdrawn participants.
    live : tuple of LiveFrames
        Of each attempt whose frames followed the gaze: how old it was.
    """

    sessions: pd.DataFrame
    attempts: pd.DataFrame
    decisions: pd.DataFrame
    answers: pd.DataFrame
    flow: tuple[FlowStep, ...]
    participants: ParticipantFlow
    demographics: pd.DataFrame
    simulated: bool
    warnings: tuple[str, ...]
    live: tuple[LiveFrames, ...] = ()

    @property
    def analysed(self) -> pd.DataFrame:
        """The decisions that the rules keep."""
        return self.decisions[self.decisions["included"] == 1].reset_index(drop=True)


def read_sessions(
    folder: str | Path, study: StudyProtocol, *, progress: Progress | None = None
) -> TidyTables:
    """Read every journal below `folder` and apply the protocol's exclusion rules.

    Raises
    ------
    StudyError
        As `analysis.journals.read_study` says.
    """
    return tidy_tables(read_study(Path(folder), study, progress=progress), study)


def tidy_tables(recorded: StudyReadings, study: StudyProtocol) -> TidyTables:
    """Return the tables of journals that were read, with the exclusion rules applied."""
    notes = list(recorded.notes)
    sessions, attempts, decisions, answers = [], [], [], []
    for reading in recorded.readings:
        session, tries, decided, said, found = _one_session(
            reading.name, reading.journal, reading.start, study
        )
        sessions.append(session | {"wrong_files": len(reading.files.wrong)})
        attempts += tries
        decisions += decided
        answers += said
        notes += found
    marked, chosen, flow = apply_exclusions(
        frame(sessions, SESSION_COLUMNS),
        frame(decisions, decision_columns(study)),
        study.analysis.exclusions,
    )
    closing = pd.DataFrame(answers, columns=["session", "participant", "question", "text"])
    return TidyTables(
        sessions=marked,
        attempts=frame(attempts, attempt_columns(study)),
        decisions=chosen,
        answers=closing,
        flow=flow,
        participants=participant_flow(recorded, study, marked, chosen),
        demographics=demographics(closing, study, chosen),
        simulated=recorded.simulated,
        warnings=tuple(notes),
        live=tuple(
            attempt.live
            for reading in recorded.readings
            for attempt in reading.journal.attempts
            if attempt.live is not None
        ),
    )


def write_tables(tidy: TidyTables, study: StudyProtocol, folder: Path) -> None:
    """Write the tables and their data dictionary as CSV into `folder`."""
    tables = {
        "sessions.csv": tidy.sessions,
        "attempts.csv": tidy.attempts,
        "decisions.csv": tidy.decisions,
        "answers.csv": tidy.answers,
        "flow.csv": pd.DataFrame([vars(step) for step in tidy.flow]),
        "participants.csv": pd.DataFrame(
            tidy.participants.steps, columns=["step", "reason", "participants"]
        ),
        "demographics.csv": tidy.demographics,
        "dictionary.csv": dictionary(tables_of(study)),
    }
    for name, table in tables.items():
        write_table(table, folder / name)


def pwcmp_table(decisions: pd.DataFrame) -> pd.DataFrame:
    """Return decisions in the columns that the program pwcmp reads.

    Each scene x size is a scene there: only clips of one size were compared. The last two columns
    are ours, and keep them apart: inference over scenes must not count one scene twice. Where it is
    left out which method was first, A is the one that is first in the alphabet.
    """
    if "first" not in decisions:
        picked = decisions[["chosen", "rejected"]]
        decisions = decisions.assign(first=picked.min(axis=1), second=picked.max(axis=1))
    return pd.DataFrame(
        {
            "observer": decisions["participant"],
            "session": decisions["session"],
            "scene": decisions["scene"] + "__" + decisions["size"],
            "condition_A": decisions["first"],
            "condition_B": decisions["second"],
            "is_A_selected": (decisions["chosen"] == decisions["first"]).astype(int),
            "scene_name": decisions["scene"],
            "size": decisions["size"],
        }
    )


def _one_session(
    name: str, journal: Journal, start: SessionStart, study: StudyProtocol
) -> tuple[
    dict[str, object],
    list[dict[str, object]],
    list[dict[str, object]],
    list[dict[str, object]],
    list[str],
]:
    """Return the session's row, its attempts, decisions, answers, and what is odd about it."""
    about: dict[str, object] = {
        "session": name,
        "participant": start.participant,
        "simulated": int(start.simulated),
        "remote": int(start.remote is not None),
    }
    notes = [f"{name}: line {bad.line} is damaged: {bad.reason}" for bad in journal.damaged]
    if journal.torn:
        notes.append(f"{name}: the last line is unfinished (the program was stopped while writing)")
    attempts = [about | _attempt_row(attempt, study) for attempt in journal.attempts]
    decided: dict[str, Attempt] = {}
    tries: dict[str, int] = {}
    for attempt in journal.attempts:
        tries[attempt.trial] = tries.get(attempt.trial, 0) + 1
        if attempt.outcome != "completed":
            continue
        if attempt.trial in decided:
            notes.append(f"{name}: {attempt.trial} was decided twice; the first answer counts")
            continue
        decided[attempt.trial] = attempt
    decisions, order = [], 0
    for trial, attempt in decided.items():
        main = attempt.role == "main"
        order += main
        row = about | _common(attempt, study) | {"included": 1, "exclusion": ""}
        decisions.append(row | {"order": order if main else None, "attempts": tries[trial]})
    answers: list[dict[str, object]] = [
        {
            "session": name,
            "participant": start.participant,
            "question": event.question,
            "text": event.text,
        }
        for event in journal.events
        if isinstance(event, Answer)
    ]
    done = sum(row["kind"] == "main" for row in decisions)
    if done < start.trials:
        notes.append(f"{name}: {start.trials - done} of {start.trials} main trials are missing")
    session = about | _session_row(journal, start, attempts, decisions)
    return session, attempts, decisions, answers, notes


def _session_row(
    journal: Journal,
    start: SessionStart,
    attempts: list[dict[str, object]],
    decisions: list[dict[str, object]],
) -> dict[str, object]:
    main = pd.DataFrame([row for row in attempts if row["kind"] == "main"])
    kept = [row for row in decisions if row["kind"] == "main"]
    caught = [row["correct"] for row in decisions if row["kind"] == "catch"]
    ends = [event for event in journal.events if isinstance(event, SessionEnd)]
    refused = any(isinstance(event, Consent) and not event.agreed for event in journal.events)
    checks = [event for event in journal.events if isinstance(event, Calibration)]
    decided = [attempt for attempt in journal.attempts if attempt.decides]
    turns = [one.head_turn_deg for one in decided if one.head_turn_deg is not None]

    def column(key: str, how: str) -> object:
        if main.empty or main[key].isna().all():
            return None
        return float(pd.to_numeric(main[key]).agg(how))

    status = "unfinished"
    if refused:
        status = "consent-refused"
    elif ends:
        status = ends[-1].reason
    return {
        "slot": start.slot,
        "status": status,
        "planned": start.trials,
        "decided": len(kept),
        "attempts": len(main),
        "void": int((main["outcome"] == "void").sum()) if not main.empty else 0,
        "catch_correct": sum(map(int, map(str, caught))) / len(caught) if caught else None,
        "dropped": sum(int(str(row["dropped"])) for row in kept),
        "gaze_lost_share": column("gaze_lost_share", "mean"),
        "gaze_violations": column("gaze_violations", "sum"),
        "gaze_mean_deg": column("gaze_mean_deg", "mean"),
        "accuracy_deg": max((check.accuracy_deg for check in checks), default=None),
        "resumed": sum(isinstance(event, SessionResume) for event in journal.events),
        "damaged_lines": len(journal.damaged),
        "unchecked_lines": journal.unchecked,
        "torn": int(bool(journal.torn)),
        "refresh_hz": start.refresh_hz,
        "refresh_changes": "; ".join(journal.rate_changes),
        "time_off_s": journal.time_off_s,
        "headset": start.headset.profile if start.headset else "",
        "head_turn_deg": max(turns, default=None),
        "gaze_mode": start.gaze_mode,
        "timing_evidence": start.timing_evidence,
        "protocol_sha256": start.protocol_sha256,
        "stimuli_sha256": start.stimuli_sha256,
        "manifest_sha256": start.manifest_sha256,
        "plan_sha256": start.plan_sha256,
        "journal_sha256": sha256_file(journal.path),
        "revision": start.revision,
        "excluded": "",
    }


def _common(attempt: Attempt, study: StudyProtocol) -> dict[str, object]:
    place = None if attempt.answer is None else attempt.answers.index(attempt.answer)
    return study.task.whole_row(attempt) | {
        "trial": attempt.trial,
        "kind": attempt.role,
        "block": attempt.block,
        "repeat": attempt.repeat,
        "key_place": place,
        "rt_s": attempt.rt_s,
        "dropped": attempt.dropped,
        "gaze_lost_share": attempt.gaze.lost_share if attempt.gaze else None,
    }


def _attempt_row(attempt: Attempt, study: StudyProtocol) -> dict[str, object]:
    gaze = attempt.gaze
    return _common(attempt, study) | {
        "attempt": attempt.attempt,
        "position": attempt.position,
        "outcome": attempt.outcome,
        "void_reason": attempt.void_reason,
        "at": attempt.at,
        "warned": int(attempt.warned),
        "frames_shown": sum(stimulus.frames_shown for stimulus in attempt.stimuli),
        "frames_planned": sum(stimulus.frames_planned for stimulus in attempt.stimuli),
        "gaze_samples": gaze.samples if gaze else None,
        "gaze_blinks": gaze.blinks if gaze else None,
        "gaze_violations": gaze.violations if gaze else None,
        "gaze_mean_deg": gaze.mean_deg if gaze else None,
        "gaze_max_deg": gaze.max_deg if gaze else None,
    }
