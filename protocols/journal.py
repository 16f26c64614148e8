"""The journal of one sitting: JSON lines, one event each, append-only, the only truth.

Every event says its number `n` (0, 1, 2, ... without gaps), when it happened on the session's
monotonic clock (`t_s`, seconds since the program opened the journal; it starts again at 0 when a
session is resumed) and when on the wall clock (`at`, UTC).

The analysis needs nothing else: `Attempt` repeats scene, size and methods of its trial.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints, TypeAdapter, model_validator

from protocols.hashing import canonical_json
from protocols.session_schema import SideName
from protocols.units import (
    Count,
    Hertz,
    LanguageCode,
    Model,
    Name,
    ParticipantCode,
    Positive,
    Seed,
    Sha256,
    Share,
    Stamp,
    Text,
)

UtcTime = Annotated[
    str,
    StringConstraints(pattern=r"^[0-9]{4}(-[0-9]{2}){2}T[0-9]{2}(:[0-9]{2}){2}(\.[0-9]{1,6})?Z$"),
]
TrialId = Annotated[str, StringConstraints(pattern=r"^(practice|main|catch)-[0-9]{4}$")]
Interval = Literal["first", "second"]
PhaseName = Literal["fixate", "first", "gap", "second", "respond"]
VoidReason = Literal[
    "gaze-break",  # gaze left the window while it was watched
    "data-loss",  # the tracker lost the eye for longer than a blink, or too much in all
    "no-fixation",  # gaze was never held on the dot within the time-out
    "too-late",  # no answer within the time-out
    "dropped-frames",  # more refreshes missed than the protocol tolerates
    "paused",  # the pause key
    "quit",  # the quit key
    "focus-lost",  # another window took the keyboard
]
Outcome = Literal["completed", "void"]


class Event(Model):
    """What every line says."""

    n: Count
    """Number of the line, from 0, without gaps."""
    t_s: Stamp
    """Session clock: monotonic, 0 when this run of the program opened the journal."""
    at: UtcTime
    """Wall clock, UTC."""


class DisplayReport(Model):
    """The measurement of the display that a session relies on."""

    file: str
    sha256: Sha256


class GazeInfo(Model):
    """The gaze source of a session."""

    source: Text
    """`lsl`, `mouse`, `replay`, `simulated`, or an adapter's name."""
    description: str = ""
    rate_hz: Hertz
    clock_offset_s: Stamp | None = None
    """Added to the tracker's own stamps to give the session's clock, as measured when it was
    opened; null where both are one clock."""


class SessionStart(Event):
    """First line: everything the sitting depends on."""

    kind: Literal["session-start"] = "session-start"
    format: Literal[1] = 1
    study: Name
    participant: ParticipantCode
    slot: Count
    """Counterbalancing slot."""
    language: LanguageCode
    seed: Seed
    simulated: bool
    """True: no person sat there. Everything derived from this journal must say so."""
    protocol_sha256: Sha256
    stimuli_sha256: Sha256
    manifest_sha256: Sha256
    plan_sha256: Sha256
    trials: Positive
    """Planned main trials, without practice and catch trials."""
    display: Name
    display_sha256: Sha256
    display_report: DisplayReport | None
    """Null where the display was not measured."""
    refresh_hz: Hertz
    gaze_mode: Literal["enforce", "warn", "monitor", "none"]
    gaze: GazeInfo | None
    revision: str
    """Version and git revision of metamerlab."""
    versions: dict[str, str]
    platform: str
    timing_evidence: str = ""
    """What vouches for the flip stamps: `glXGetSyncValuesOML`, `fence`, `unverified`,
    `software timer`, `virtual`."""


class SessionResume(Event):
    """The program was started again for the same sitting."""

    kind: Literal["session-resume"] = "session-resume"
    revision: str
    versions: dict[str, str]
    display_report: DisplayReport | None
    gaze: GazeInfo | None
    torn_file: str | None
    """Where an unfinished last line was put aside; null where there was none."""


class Consent(Event):
    """The participant agreed to the consent text."""

    kind: Literal["consent"] = "consent"
    agreed: bool
    language: LanguageCode
    text_sha256: Sha256


class Calibration(Event):
    """A validation of the gaze source before a block."""

    kind: Literal["calibration"] = "calibration"
    accuracy_deg: Annotated[float, Field(ge=0)]
    """Mean angle between target and gaze."""
    precision_deg: Annotated[float, Field(ge=0)]
    """Root mean square of sample-to-sample angles."""
    points: Count


class BlockStart(Event):
    """A block begins; block 0 is practice."""

    kind: Literal["block-start"] = "block-start"
    block: Count
    trials: Count


class BlockEnd(Event):
    """All trials of a block were decided or given up."""

    kind: Literal["block-end"] = "block-end"
    block: Count


class Break(Event):
    """A break between blocks, written when it ends."""

    kind: Literal["break"] = "break"
    after_block: Count
    duration_s: Annotated[float, Field(ge=0)]


class Pause(Event):
    """The session rested because the participant asked, written when it goes on."""

    kind: Literal["pause"] = "pause"
    duration_s: Annotated[float, Field(ge=0)]


class Phase(Model):
    """One phase of an attempt as it was shown."""

    phase: PhaseName
    onset_s: Stamp
    """Stamp of the flip that first showed it."""
    offset_s: Stamp
    """Stamp of the flip that replaced it."""
    refreshes: Count
    """Refreshes of the display between the two."""
    planned: Count | None
    """Planned refreshes; null where the participant decides."""
    dropped: Count
    """Refreshes at which nothing new could be shown."""


class ShownClip(Model):
    """One interval's clip."""

    method: Name
    clip: str
    """``scene__size__method``."""
    clip_sha256: Sha256
    """`Clip.sha256` of the manifest: the hash of its frames' hashes."""
    frames_shown: Count
    """Different clip frames that reached the display."""
    frames_planned: Count


class GazeQuality(Model):
    """How well gaze was held between the onset of interval 1 and the answer phase."""

    samples: Count
    lost_share: Share
    """Share of the watched time without gaze data, blinks included."""
    blinks: Count
    """Losses short enough to be pardoned."""
    violations: Count
    """Times that gaze was outside for long enough; at most 1 in mode `enforce`."""
    mean_deg: Annotated[float, Field(ge=0)] | None
    """Mean angle between gaze and dot; null without data."""
    max_deg: Annotated[float, Field(ge=0)] | None


class SideFile(Model):
    """A file beside the journal, finished before the line that names it."""

    file: str
    """Relative to the journal's folder."""
    sha256: Sha256


class Attempt(Event):
    """One attempt at a trial is over; written once per attempt, completed or void."""

    kind: Literal["attempt"] = "attempt"
    trial: TrialId
    """Which trial of the plan."""
    trial_kind: Literal["2afc"] = "2afc"
    attempt: Positive
    """1 for the first attempt at this trial."""
    position: Count
    """Number of this attempt in the sitting, from 0."""
    block: Count
    """0 is practice."""
    practice: bool
    catch: bool
    repeat: Count
    """Which repeat of its pairing x size x scene, from 0."""
    scene: Name
    size: Name
    first: Name
    """Method in interval 1."""
    second: Name
    """Method in interval 2."""
    expected: Name | None
    """Catch trials: the method an attentive participant picks."""
    first_side: SideName
    """Side of the key that stands for interval 1."""
    outcome: Outcome
    void_reason: VoidReason | None
    choice: Interval | None
    """The interval picked."""
    chosen: Name | None
    """The method picked."""
    chosen_side: SideName | None
    """The side whose key was pressed."""
    key: str | None
    rt_s: Annotated[float, Field(ge=0)] | None
    """From the onset of the answer phase to the stamp of the key press."""
    phases: tuple[Phase, ...]
    """The phases that were shown, in order."""
    clips: tuple[ShownClip, ShownClip]
    """The clips of interval 1 and 2."""
    dropped: Count
    """Missed refreshes from the onset of interval 1 to the answer phase."""
    warned: bool
    """Mode `warn`: the participant was told that gaze had left the dot."""
    gaze: GazeQuality | None
    gaze_file: SideFile | None
    """Samples: CSV with t_s, raw_t, x_px, y_px (empty = lost)."""
    flips_file: SideFile | None
    """Every flip: CSV with flip (its number, as in the frame strip), t_s, interval_s, refreshes,
    kind, late_s, evidence, phase, clip_frame, frame_sha256."""

    @model_validator(mode="after")
    def _outcome_is_whole(self) -> Attempt:
        completed = self.outcome == "completed"
        answer = (self.choice, self.chosen, self.chosen_side, self.rt_s)
        if completed == (self.void_reason is not None):
            raise ValueError("void_reason must be given for void attempts and only for them")
        if completed and None in answer:
            raise ValueError("a completed attempt must have choice, chosen, chosen_side and rt_s")
        if not completed and answer != (None, None, None, None):
            raise ValueError("a void attempt must have no choice, chosen, chosen_side or rt_s")
        if completed and self.chosen != getattr(self, str(self.choice)):
            raise ValueError(f"chosen must be the method of the {self.choice} interval")
        if completed and (self.choice == "first") != (self.chosen_side == self.first_side):
            raise ValueError("chosen_side must be the side of the chosen interval")
        return self


class Answer(Event):
    """One answer of the closing questions."""

    kind: Literal["answer"] = "answer"
    question: Name
    text: str
    """As typed or chosen: hostile until escaped."""


class Note(Event):
    """Something the operator or the program wants remembered."""

    kind: Literal["note"] = "note"
    text: Text


class Withdrawal(Event):
    """The participant withdrew: the only event that is left of a sitting."""

    kind: Literal["withdrawal"] = "withdrawal"
    study: Name
    slot: Count
    """The slot that became free."""


class SessionEnd(Event):
    """Last line of a run of the program; a session that was quit can be resumed after it."""

    kind: Literal["session-end"] = "session-end"
    reason: Literal["completed", "quit", "consent-refused", "disk-full", "tracker-lost", "error"]
    completed_trials: Count
    """Main trials decided so far."""
    message: str = ""


AnyEvent: TypeAlias = Annotated[
    SessionStart
    | SessionResume
    | Consent
    | Calibration
    | BlockStart
    | BlockEnd
    | Break
    | Pause
    | Attempt
    | Answer
    | Note
    | Withdrawal
    | SessionEnd,
    Field(discriminator="kind"),
]
EVENT: TypeAdapter[AnyEvent] = TypeAdapter(AnyEvent)

__all__ = [
    "EVENT",
    "Answer",
    "AnyEvent",
    "Attempt",
    "BlockEnd",
    "BlockStart",
    "Break",
    "Calibration",
    "Consent",
    "DisplayReport",
    "Event",
    "GazeInfo",
    "GazeQuality",
    "Note",
    "Pause",
    "Phase",
    "SessionEnd",
    "SessionResume",
    "SessionStart",
    "ShownClip",
    "SideFile",
    "Withdrawal",
    "event_line",
]


def event_line(event: AnyEvent) -> bytes:
    """Return the journal line of an event, with its line feed."""
    return canonical_json(event) + b"\n"
