"""The journal of one sitting: JSON lines, one event each, append-only, the only truth.

Every event says its number `n` (0, 1, 2, ... without gaps), when it happened on the session's
monotonic clock (`t_s`, seconds since the program opened the journal; it starts again at 0 when a
session is resumed) and when on the wall clock (`at`, UTC).

The analysis needs nothing else: `Attempt` repeats the condition of its trial. Lines of format 1
are read as what they say in format 2 (`protocols.format1`).
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field, StringConstraints, TypeAdapter, model_validator

from protocols.hashing import canonical_json
from protocols.units import (
    Count,
    Hertz,
    LanguageCode,
    Model,
    Name,
    ParticipantCode,
    Positive,
    Scalar,
    Seed,
    Sha256,
    Share,
    Stamp,
    Text,
    storable,
)

UtcTime = Annotated[
    str,
    StringConstraints(pattern=r"^[0-9]{4}(-[0-9]{2}){2}T[0-9]{2}(:[0-9]{2}){2}(\.[0-9]{1,6})?Z$"),
]
TrialId = Annotated[str, StringConstraints(pattern=r"^(practice|main|catch)-[0-9]{4,}$")]
Role = Literal["practice", "main", "catch"]
"""Practice is never analysed; catch trials have a plain answer, and judge the participant."""
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
    chain: Sha256 | None = None
    """Checksum over this line and all before it: SHA-256 of the checksum of the line before,
    then this line with null here, without its line feed. Null: written before there were any."""


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
    format: Literal[1, 2] = 2
    study: Name
    task: Name = "two-interval"
    """Kind of the task; format 1 knew one."""
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
    accuracy_deg: Annotated[float, Field(ge=0), AfterValidator(storable)]
    """Mean angle between target and gaze."""
    precision_deg: Annotated[float, Field(ge=0), AfterValidator(storable)]
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
    duration_s: Annotated[float, Field(ge=0), AfterValidator(storable)]


class Pause(Event):
    """The session rested because the participant asked, written when it goes on."""

    kind: Literal["pause"] = "pause"
    duration_s: Annotated[float, Field(ge=0), AfterValidator(storable)]


class Phase(Model):
    """One phase of an attempt as it was shown."""

    phase: Name
    """Its name in the task."""
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
    stimuli: tuple[Count, ...] = ()
    """Which of the attempt's stimuli it showed."""


class ShownStimulus(Model):
    """One stimulus of an attempt."""

    name: str
    """Its name in the manifest, which is its folder."""
    sha256: Sha256
    """`Clip.sha256` of the manifest: the hash of its frames' hashes."""
    frames_shown: Count
    """Different frames that reached the display."""
    frames_planned: Count


class GazeQuality(Model):
    """How well gaze was held while it was watched."""

    samples: Count
    lost_share: Share
    """Share of the watched time without gaze data, blinks included."""
    blinks: Count
    """Losses short enough to be pardoned."""
    violations: Count
    """Times that gaze was outside for long enough; at most 1 in mode `enforce`."""
    mean_deg: Annotated[float, Field(ge=0), AfterValidator(storable)] | None
    """Mean angle between gaze and dot; null without data."""
    max_deg: Annotated[float, Field(ge=0), AfterValidator(storable)] | None


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
    role: Role
    attempt: Positive
    """1 for the first attempt at this trial."""
    position: Count
    """Number of this attempt in the sitting, from 0."""
    block: Count
    """0 is practice."""
    repeat: Count
    """Which repeat of its condition, from 0."""
    condition: dict[str, Scalar]
    """What was shown, column by column, as the task defines it."""
    track: str | None
    """The adaptive track that chose the condition; null: it was planned."""
    stimuli: tuple[ShownStimulus, ...]
    """In the order in which the task counts them."""
    answers: tuple[Name, ...]
    """The answer that each response key stands for, from left to right."""
    expected: Name | None
    """The right answer; null where there is none."""
    outcome: Outcome
    void_reason: VoidReason | None
    answer: Name | None
    """The answer given."""
    correct: bool | None
    """Whether it was right; null without an answer, or where none is right."""
    key: str | None
    rt_s: Annotated[float, Field(ge=0), AfterValidator(storable)] | None
    """From the onset of the answer phase to the stamp of the key press."""
    phases: tuple[Phase, ...]
    """The phases that were shown, in order."""
    dropped: Count
    """Missed refreshes from the first watched phase to the answer phase."""
    warned: bool
    """Mode `warn`: the participant was told that gaze had left the dot."""
    gaze: GazeQuality | None
    gaze_file: SideFile | None
    """Samples: CSV with t_s, raw_t, x_px, y_px (empty = lost)."""
    flips_file: SideFile | None
    """Every flip: CSV with flip (its number, as in the frame strip), t_s, interval_s, refreshes,
    kind, late_s, evidence, phase, clip_frame, frame_sha256; of several stimuli at once, the last
    two hold one entry each, with a space between."""

    @property
    def stimulus_names(self) -> tuple[str, ...]:
        """Names of what was shown, in order."""
        return tuple(stimulus.name for stimulus in self.stimuli)

    @model_validator(mode="after")
    def _outcome_is_whole(self) -> Attempt:
        completed = self.outcome == "completed"
        answer = (self.answer, self.rt_s)
        if completed == (self.void_reason is not None):
            raise ValueError("void_reason must be given for void attempts and only for them")
        if completed and None in answer:
            raise ValueError("a completed attempt must have answer and rt_s")
        if not completed and answer != (None, None):
            raise ValueError("a void attempt must have no answer or rt_s")
        for name, value in (("answer", self.answer), ("expected", self.expected)):
            if value is not None and value not in self.answers:
                raise ValueError(
                    f"{name} must be one of the answers ({', '.join(self.answers)}) (got {value!r})"
                )
        judged = self.answer is not None and self.expected is not None
        if self.correct != ((self.answer == self.expected) if judged else None):
            raise ValueError("correct must say whether answer is the expected one")
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
    "ShownStimulus",
    "SideFile",
    "Withdrawal",
    "event_line",
]


def event_line(event: AnyEvent) -> bytes:
    """Return the journal line of an event, with its line feed."""
    return canonical_json(event) + b"\n"
