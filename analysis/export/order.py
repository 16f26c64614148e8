"""Takes the order of trials out of a public export, where it would tell participants' codes.

The order follows from the study's seed, the code and the slot. Codes are short, so whoever has the
study file tries them all until the order fits. A study with a secret cannot be tried so: there
the order stays. Of every other study a public export holds a session's main trials as a set:
sorted by what they showed, with times that begin anew at each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pandas as pd

from analysis.journals import Reading, StudyReadings
from analysis.tidy import Tidy
from protocols.errors import StudyError
from protocols.hashing import canonical_json
from protocols.journal import (
    AnyEvent,
    Attempt,
    Calibration,
    Consent,
    SessionEnd,
    SessionStart,
)
from protocols.schema import StudyProtocol

BETWEEN_S = 1.0
"""Between two attempts in an export without order."""
_ORDER_COLUMNS = ("position", "order", "block", "resumed")
_SIDE_COLUMNS = ("first_side", "chosen_side", "key_place")


@dataclass(frozen=True)
class Unordered:
    """Sessions without the order of their trials."""

    study: StudyReadings
    shifts: dict[str, dict[int, float]]
    """By the name of a session, then by the line of an attempt: what was added to its times."""
    trials: dict[tuple[str, str], str]
    """By participant and trial of the plan: the name that all share."""


def tells_codes(protocol: StudyProtocol) -> bool:
    """Return whether the order of trials follows from what is public and the code alone."""
    return protocol.privacy.secret_sha256 is None


def refuse_adaptive(protocol: StudyProtocol) -> None:
    """Refuse a study whose very choice of stimuli follows from the code.

    Raises
    ------
    StudyError
        With the cure.
    """
    if protocol.task.adaptation is not None:
        raise StudyError(
            "--public: a study that chooses its trials from the answers must have a secret"
            " (privacy.secret_sha256; this one has none): which stimuli came, in any order, tells"
            " the participants' codes. Studies begun with 'metamerlab new-study' have one; of this"
            " one publish tables of results"
        )


def without_order(study: StudyReadings) -> Unordered:
    """Return the sessions with main trials alone, in an order that all share.

    What is not whole is left out: which trials are missing tells what came first.
    """
    kept: list[Reading] = []
    notes = list(study.notes)
    shifts: dict[str, dict[int, float]] = {}
    numbers = _numbers([reading for reading in study.readings if _whole(reading)])
    for reading in study.readings:
        if not _whole(reading):
            notes.append(
                f"{reading.name}: left out of the public version, since which of its trials are"
                " missing tells their order"
            )
            continue
        events, shifts[reading.name] = _rearranged(reading, numbers)
        kept.append(replace(reading, journal=replace(reading.journal, events=events)))
    trials = {
        (reading.start.participant, attempt.trial): _name(numbers[_key(attempt)])
        for reading in study.readings
        if reading.name in shifts
        for attempt in reading.journal.attempts
        if attempt.role == "main"
    }
    return Unordered(StudyReadings(tuple(kept), tuple(notes)), shifts, trials)


def unordered_tables(tidy: Tidy, unordered: Unordered) -> Tidy:
    """Return the main trials of tables, named and sorted without their order."""
    return replace(
        tidy,
        sessions=tidy.sessions.drop(columns=[*_ORDER_COLUMNS], errors="ignore"),
        attempts=_unordered(tidy.attempts, unordered, ["attempt"]),
        decisions=_unordered(tidy.decisions, unordered, []),
    )


def _unordered(table: pd.DataFrame, unordered: Unordered, more: list[str]) -> pd.DataFrame:
    main = table[table["kind"] == "main"]
    names = [
        unordered.trials[str(participant), str(trial)]
        for participant, trial in zip(main["participant"], main["trial"], strict=True)
    ]
    return (
        main.assign(trial=names)
        .drop(columns=[*_ORDER_COLUMNS, *_SIDE_COLUMNS], errors="ignore")
        .sort_values(["participant", "trial", *more], kind="stable")
        .reset_index(drop=True)
    )


def _whole(reading: Reading) -> bool:
    """Whether every main trial was met: a session's set of them is then that of all others."""
    met = {attempt.trial for attempt in reading.journal.attempts if attempt.role == "main"}
    return len(met) == reading.start.trials


def _key(attempt: Attempt) -> tuple[bytes, int]:
    """What a main trial showed: the same for all participants."""
    return canonical_json(dict(attempt.condition)), attempt.repeat


def _numbers(readings: Sequence[Reading]) -> dict[tuple[bytes, int], int]:
    keys = {
        _key(attempt)
        for reading in readings
        for attempt in reading.journal.attempts
        if attempt.role == "main"
    }
    return {key: number for number, key in enumerate(sorted(keys))}


def _name(number: int) -> str:
    return f"main-{number:04d}"


def _rearranged(
    reading: Reading, numbers: dict[tuple[bytes, int], int]
) -> tuple[tuple[AnyEvent, ...], dict[int, float]]:
    shifts: dict[int, float] = {}
    events: list[AnyEvent] = [
        event.model_copy(update={"t_s": 0.0})
        for event in reading.journal.events
        if isinstance(event, SessionStart | Consent | Calibration)
    ]
    ends = [event for event in reading.journal.events if isinstance(event, SessionEnd)]
    main = [attempt for attempt in reading.journal.attempts if attempt.role == "main"]
    main.sort(key=lambda attempt: (numbers[_key(attempt)], attempt.attempt))
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
                    "trial": _name(numbers[_key(attempt)]),
                    "t_s": clock_s - BETWEEN_S,
                    "position": place,
                    "block": 1,
                    "phases": phases,
                }
            )
        )
    events += [event.model_copy(update={"t_s": clock_s}) for event in ends[-1:]]
    return tuple(events), shifts
