"""Takes the order of trials out of a public export, where it would tell who came when, or codes.

The order follows from the study's seed, the code, the slot and its place in the counterbalancing.
Codes are short and slots are few, so whoever has the study file tries them all until the order
fits. Where a secret seeds the order and draws the places, nothing can be tried so, and the order
stays. Of every other study a public export holds a session's main trials as a set: sorted by what
they showed, with times that begin anew at each, without what came first and which key was which.
Nor is it told which trial was the first of its condition: answers become faster in a session, so
what came first early and late would show.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import pandas as pd

from analysis.export.export_content import sorting_key
from analysis.journals import JournalReading, StudyReadings
from analysis.tidy import TidyTables
from protocols.disk.hashing import sha256_bytes
from protocols.errors import StudyError
from protocols.journal import (
    AnyEvent,
    Attempt,
    Calibration,
    Consent,
    SessionEnd,
    SessionStart,
)
from protocols.plan import arrival_shows
from protocols.study_file.schema import StudyProtocol
from protocols.units import Condition

BETWEEN_S = 1.0
"""Between two attempts in an export without order."""
_ORDER_COLUMNS = ("position", "order", "block", "repeat", "resumed")
_SIDE_COLUMNS = frozenset({"first_side", "chosen_side", "key_place"})
_SHOWN_COLUMNS = frozenset({"stimulus", "stimulus_sha256"})
_Arranged = tuple[frozenset[tuple[str, object]], tuple[str, ...]]


@dataclass(frozen=True)
class OrderlessSessions:
    """Sessions without the order of their trials."""

    recorded: StudyReadings
    shifts: dict[str, dict[int, float]]
    """By the name of a session, then by the line of an attempt: what was added to its times."""
    trials: dict[tuple[str, str], str]
    """By participant and trial of the plan: the name that all share."""


def tells_codes(study: StudyProtocol) -> bool:
    """Return True if the order of trials follows from what is public and the code alone."""
    return study.privacy.secret_sha256 is None


def telling_columns(study: StudyProtocol) -> frozenset[str]:
    """Return the columns that tell a participant's place where it follows from the slot.

    None where the place is drawn by a secret, or decides nothing. Names of stimuli, phase by phase,
    are among them if a condition can be shown in several ways.
    """
    if not tells_codes(study) and not arrival_shows(study):
        return frozenset()
    arranged = study.task.arranged_columns(study.pool)
    return _SIDE_COLUMNS | arranged | (_SHOWN_COLUMNS if arranged else frozenset())


def tells_order(study: StudyProtocol) -> bool:
    """Return True if the order of trials tells codes or slots.

    Where a rule chooses what is shown, the secret alone seeds the order.
    """
    adapts = study.task.adaptation is not None
    return tells_codes(study) or (bool(telling_columns(study)) and not adapts)


def refuse_adaptive(study: StudyProtocol) -> None:
    """Refuse a study whose very choice of stimuli follows from the code.

    Raises
    ------
    StudyError
        With the cure.
    """
    if study.task.adaptation is not None:
        raise StudyError(
            "--public: a study that chooses its trials from the answers must have a secret"
            " (privacy.secret_sha256; this one has none): which stimuli came, in any order, tells"
            " the participants' codes. Studies begun with 'metamerlab new-study' have one; of this"
            " one publish tables of results"
        )


def without_order(recorded: StudyReadings, study: StudyProtocol) -> OrderlessSessions:
    """Return the sessions with main trials alone, in an order that all share.

    What is not whole is left out: which trials are missing tells what came first.
    """
    kept: list[JournalReading] = []
    notes = list(recorded.notes)
    shifts: dict[str, dict[int, float]] = {}
    trials: dict[tuple[str, str], str] = {}
    conditions = {
        _arranged(arrangement.condition, arrangement.stimuli): number
        for number, cell in enumerate(study.task.cells(study.pool))
        for arrangement in cell.arrangements
    }
    for reading in recorded.readings:
        names = _names(reading, conditions)
        if len(names) != reading.start.trials:
            notes.append(
                f"{reading.name}: left out of the public version, since which of its trials are"
                " missing tells their order"
            )
            continue
        events, shifts[reading.name] = _rearranged(reading, names)
        kept.append(replace(reading, journal=replace(reading.journal, events=events)))
        trials |= {(reading.start.participant, trial): name for trial, name in names.items()}
    return OrderlessSessions(StudyReadings(tuple(kept), tuple(notes)), shifts, trials)


def unordered_tables(tidy: TidyTables, unordered: OrderlessSessions) -> TidyTables:
    """Return the main trials of tables, named and sorted without their order."""
    return replace(
        tidy,
        sessions=tidy.sessions.drop(columns=[*_ORDER_COLUMNS], errors="ignore"),
        attempts=_unordered(tidy.attempts, unordered, ["attempt"]),
        decisions=_unordered(tidy.decisions, unordered, []),
    )


def without_columns(tidy: TidyTables, names: frozenset[str]) -> TidyTables:
    """Return tables of attempts and decisions without these columns."""
    return replace(
        tidy,
        attempts=tidy.attempts.drop(columns=[*names], errors="ignore"),
        decisions=tidy.decisions.drop(columns=[*names], errors="ignore"),
    )


def _unordered(table: pd.DataFrame, unordered: OrderlessSessions, more: list[str]) -> pd.DataFrame:
    main = table[table["kind"] == "main"]
    names = [
        unordered.trials[str(participant), str(trial)]
        for participant, trial in zip(main["participant"], main["trial"], strict=True)
    ]
    return (
        main.assign(trial=names)
        .drop(columns=[*_ORDER_COLUMNS], errors="ignore")
        .sort_values(["participant", "trial", *more], kind="stable")
        .reset_index(drop=True)
    )


def _arranged(condition: Condition, stimuli: tuple[str, ...]) -> _Arranged:
    return frozenset(condition.items()), stimuli


def _main(reading: JournalReading) -> list[Attempt]:
    return [attempt for attempt in reading.journal.attempts if attempt.role == "main"]


def _names(reading: JournalReading, conditions: Mapping[_Arranged, int]) -> dict[str, str]:
    """Return the names of a session's main trials: numbers that all share, by their condition.

    Trials of one condition, and those of none that the study has, are numbered by chance.
    """
    chance = sorting_key(reading)
    met = {a.trial: _arranged(a.condition, a.stimulus_names) for a in _main(reading)}
    placed = sorted(
        (conditions.get(shown, len(conditions)), sha256_bytes(f"{chance} {trial}".encode()), trial)
        for trial, shown in met.items()
    )
    return {trial: f"main-{number:04d}" for number, (_, _, trial) in enumerate(placed)}


def _rearranged(
    reading: JournalReading, names: dict[str, str]
) -> tuple[tuple[AnyEvent, ...], dict[int, float]]:
    shifts: dict[int, float] = {}
    events: list[AnyEvent] = [
        event.model_copy(update={"t_s": 0.0})
        for event in reading.journal.events
        if isinstance(event, SessionStart | Consent | Calibration)
    ]
    ends = [event for event in reading.journal.events if isinstance(event, SessionEnd)]
    main = sorted(_main(reading), key=lambda attempt: (names[attempt.trial], attempt.attempt))
    clock_s = BETWEEN_S
    for place, attempt in enumerate(main):
        began_s = attempt.phases[0].onset_s if attempt.phases else attempt.t_s
        ended_s = attempt.phases[-1].offset_s if attempt.phases else attempt.t_s
        shift_s = round(clock_s - began_s, 6)
        shifts[attempt.n] = shift_s
        phases = tuple(
            phase.model_copy(
                update={
                    "onset_s": round(phase.onset_s + shift_s, 6),
                    "offset_s": round(phase.offset_s + shift_s, 6),
                }
            )
            for phase in attempt.phases
        )
        clock_s = round(clock_s + ended_s - began_s + BETWEEN_S, 6)
        events.append(
            attempt.model_copy(
                update={
                    "trial": names[attempt.trial],
                    "t_s": clock_s - BETWEEN_S,
                    "position": place,
                    "block": 1,
                    "phases": phases,
                }
            )
        )
    events += [event.model_copy(update={"t_s": clock_s}) for event in ends[-1:]]
    return tuple(events), shifts
