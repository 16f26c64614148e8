"""Reads the journals of one study: what tables, reports and exports are made from."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from protocols.errors import StudyError
from protocols.journal import SessionStart
from protocols.journal_file import Journal, find_journals, read_journal
from protocols.schema import StudyProtocol

Progress = Callable[[str, int, int], None]
"""Told what is done, how much of it, and of how much; 0 where no end is known."""

COPIED_ATTEMPTS = 3
"""Fewer attempts than these may well look alike."""


@dataclass(frozen=True)
class Reading:
    """One sitting's journal, read past damage."""

    name: str
    """Its folder, relative to the folder that was searched."""
    journal: Journal
    start: SessionStart


@dataclass(frozen=True)
class StudyReadings:
    """Every readable sitting of a study whose participant did not withdraw."""

    readings: tuple[Reading, ...]
    notes: tuple[str, ...]
    """What was left out, and why."""

    @property
    def simulated(self) -> bool:
        """Whether artificial observers answered."""
        return self.readings[0].start.simulated


def read_study(
    folder: Path, protocol: StudyProtocol, *, progress: Progress | None = None
) -> StudyReadings:
    """Read every journal below `folder`.

    Raises
    ------
    StudyError
        If there is no journal, journals belong to another protocol or to several, one
        participant appears twice, or simulated and recorded sittings are mixed.
    """
    paths = find_journals(folder)
    if not paths:
        raise StudyError(
            f"{folder}: must hold at least one sitting (no journal.jsonl was found);"
            " name the folder that sessions were recorded into"
        )
    readings: list[Reading] = []
    notes: list[str] = []
    for number, path in enumerate(paths):
        if progress:
            progress("reading journals", number, len(paths))
        name = path.parent.relative_to(folder).as_posix()
        name = folder.resolve().name if name == "." else name
        journal = read_journal(path, lenient=True)
        if journal.withdrawn:
            notes.append(f"{name}: the participant withdrew; nothing of theirs is used")
            continue
        starts = [event for event in journal.events if isinstance(event, SessionStart)]
        if not starts:
            notes.append(f"{name}: left out, its first line (the header) cannot be read")
            continue
        readings.append(Reading(name, journal, starts[0]))
    if progress:
        progress("reading journals", len(paths), len(paths))
    if not readings:
        raise StudyError(
            f"{folder}: must hold at least one readable sitting"
            f" (of {len(paths)} journals none can be used): " + "; ".join(notes)
        )
    _check_one_study(folder, readings, protocol)
    notes += _note_manifests(readings)
    return StudyReadings(tuple(readings), tuple(notes))


def _check_one_study(folder: Path, readings: Sequence[Reading], protocol: StudyProtocol) -> None:
    hashes: dict[str, list[str]] = {}
    for reading in readings:
        hashes.setdefault(reading.start.protocol_sha256, []).append(reading.name)
    if len(hashes) > 1:
        listed = "; ".join(
            f"{digest[:12]}… in {names[0]}" + (f" and {len(names) - 1} more" * (len(names) > 1))
            for digest, names in sorted(hashes.items())
        )
        raise StudyError(
            f"{folder}: all sittings must follow one protocol (found {len(hashes)}: {listed});"
            " analyse each study on its own"
        )
    (digest,) = hashes
    if digest != protocol.sha256:
        raise StudyError(
            f"{folder}: sittings must follow the protocol given ({protocol.study.name},"
            f" {protocol.sha256[:12]}…) (got {digest[:12]}…); give the protocol file as it was"
            " when the sessions were recorded"
        )
    kinds = {reading.start.simulated for reading in readings}
    if len(kinds) > 1:
        simulated = [reading.name for reading in readings if reading.start.simulated]
        raise StudyError(
            f"{folder}: simulated and recorded sittings must not be mixed"
            f" (simulated: {', '.join(simulated[:5])}); keep them in separate folders"
        )
    people: dict[str, str] = {}
    for reading in readings:
        # Last: two studies or a simulation may well share a participant's code.
        code = reading.start.participant
        if code in people:
            raise StudyError(
                f"{folder}: every participant must have one sitting (got {code!r} in"
                f" {people[code]} and {reading.name}); move the copy out of this folder"
            )
        people[code] = reading.name
    _check_no_copy(folder, readings)


def _check_no_copy(folder: Path, readings: Sequence[Reading]) -> None:
    """Refuse one sitting under two codes: no two people answer at the same microseconds."""
    seen: dict[tuple[object, ...], str] = {}
    for reading in readings:
        told = tuple(
            (attempt.at, attempt.trial, *attempt.condition.values(), attempt.answer, attempt.rt_s)
            for attempt in reading.journal.attempts
        )
        if len(told) >= COPIED_ATTEMPTS and told in seen:
            raise StudyError(
                f"{folder}: every sitting must be of its own (all {len(told)} attempts of"
                f" {reading.name} are those of {seen[told]}, under another code); move the copy out"
                " of this folder"
            )
        seen[told] = reading.name


def _note_manifests(readings: Sequence[Reading]) -> list[str]:
    """Say where sittings were shown different stimuli."""
    made: dict[str, list[str]] = {}
    for reading in readings:
        made.setdefault(reading.start.manifest_sha256, []).append(reading.name)
    if len(made) < 2:
        return []
    listed = "; ".join(
        f"{digest[:12]}… in {names[0]}" + (f" and {len(names) - 1} more" * (len(names) > 1))
        for digest, names in sorted(made.items())
    )
    return [
        f"sittings were shown stimuli of {len(made)} different manifests ({listed}): make sure that"
        " they may be taken together"
    ]
