"""The journal of one session: JSON lines, one event each, append-only, the only truth.

Every event says its number `n` (0, 1, 2, ... without gaps), when it happened on the session's
monotonic clock (`t_s`, seconds since the program opened the journal; it starts again at 0 when a
session is resumed) and when on the wall clock (`at`, UTC).

The analysis needs nothing else: `Attempt` repeats the condition of its trial.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field, StringConstraints, TypeAdapter, model_validator

from protocols.disk.hashing import canonical_json
from protocols.latency import LiveFrames
from protocols.units import (
    Count,
    ExtendedModel,
    Hertz,
    LanguageCode,
    Magnitude,
    Model,
    Name,
    ParticipantCode,
    Pixels,
    Positive,
    Scalar,
    Seed,
    Sha256,
    Share,
    Stamp,
    Text,
    WebSeed,
    matching,
)

UtcTime = Annotated[
    str,
    matching(
        r"^[0-9]{4}(-[0-9]{2}){2}T[0-9]{2}(:[0-9]{2}){2}(\.[0-9]{1,6})?Z$",
        "a time of UTC, like '2026-05-01T09:30:00Z'",
    ),
]
TrialId = Annotated[
    str, matching(r"^(practice|main|catch)-[0-9]{4,}$", "a trial's name, like 'main-0001'")
]
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
    "focus-lost",  # another window took the keyboard or covered the screen
]
Outcome = Literal["completed", "void"]


class Event(Model):
    """Fields of every line."""

    n: Count
    """Line number, from 0, without gaps."""
    t_s: Stamp
    """Session clock: monotonic, 0 when this run opened the journal."""
    at: UtcTime
    """Wall-clock time, UTC."""
    chain: Sha256 | None = None
    """SHA-256 of the previous checksum followed by this line with null here, without its line feed.
    Null in journals of older versions."""


class SideFile(Model):
    """A file beside the journal, finished before the line that names it."""

    file: str
    """Path relative to the journal's folder."""
    sha256: Sha256


class DisplayReport(Model):
    """The measurement of the display."""

    file: str
    """Path of the report."""
    sha256: Sha256


class GazeInfo(Model):
    """The gaze source."""

    source: Text
    """`lsl`, `mouse`, `replay`, `simulated`, or the name of an adapter."""
    description: str = ""
    rate_hz: Hertz
    clock_offset_s: Stamp | None = None
    """Added to the tracker's stamps to give the session clock. Null if both use one clock."""


SlotFrom = Literal["link", "batch", "drawn"]
"""`link`: the address named it. `batch`: the study's server gave it. `drawn`: by chance."""


class BrowserWindow(Model):
    """A browser's window, and how large it shows stimuli."""

    window_px: tuple[Pixels, Pixels]
    """Device pixels of the canvas."""
    device_pixel_ratio: Annotated[float, Field(gt=0)]
    scale: Positive
    """Screen pixels per pixel of a stimulus, along an edge."""
    full_screen: bool


class HeadsetView(Model):
    """The view of one eye: its pixels, and the part of the world that it shows."""

    eye: Literal["left", "right", "none"]
    size_px: tuple[Pixels, Pixels]
    tangents: tuple[float, float, float, float]
    """Tangents of the angles from straight ahead to its left, right, lower and upper edge: left and
    down are below 0."""


class HeadsetDevice(Model):
    """A headset as its browser tells it."""

    profile: Text
    """Name of its controllers' kind, by the registry of WebXR; `unknown` where they tell none."""
    views: tuple[HeadsetView, ...]
    eye_distance_m: Annotated[float, Field(ge=0, le=0.2)]
    """Distance of the two views' places, to a millimetre."""


class Machine(BrowserWindow, ExtendedModel):
    """Machine as the gate found it: nothing that tells one person from another."""

    added_later: ClassVar[tuple[str, ...]] = ("headset",)

    browser: Text
    """Name and main version."""
    refresh_hz: Hertz
    """Measured, over at least 300 frames."""
    missed_share: Share
    """Share of the refreshes of that measurement."""
    color_gamut: Literal["srgb", "p3", "rec2020", "unknown"]
    touch: bool
    simulated: bool = False
    """True if no person took part: an artificial observer drove the page."""
    headset: HeadsetDevice | None = None
    """The headset. Left out where the study ran on a screen."""


class RemoteStart(ExtendedModel):
    """Export, slot and machine of a session in a participant's own browser."""

    added_later: ClassVar[tuple[str, ...]] = ("places_key",)

    study_file_sha256: Sha256
    """Hash of the export's `study.json`."""
    revision: Text
    """Revision of metamerlab, which made the export."""
    slot_from: SlotFrom
    machine: Machine
    identifier: Annotated[str, StringConstraints(max_length=200)] | None = None
    """Value of the link's parameter that the study names."""
    places_key: WebSeed | None = None
    """Key of the export, by which the slot's place in the counterbalancing is drawn. Null: places
    are not drawn, or by the seed, as in exports of older versions."""


class Remote(RemoteStart):
    """A session in a participant's own browser: what vouches for it.

    Files were hashed before they were decoded, and each refresh is stamped by the browser's
    animation frame. No photodiode saw the screen, and nothing watched gaze or distance.
    """

    deviations_s: dict[str, float]
    """Excess of times over those that the study states, by their places in the study file."""


class SessionStart(Event, ExtendedModel):
    """The first line: everything the session depends on."""

    added_later: ClassVar[tuple[str, ...]] = ("remote",)

    kind: Literal["session-start"] = "session-start"
    format: Literal[2] = 2
    study: Name
    task: Name = "two-interval"
    """Kind of the task."""
    participant: ParticipantCode
    slot: Count
    """Counterbalancing slot."""
    language: LanguageCode
    seed: Seed
    simulated: bool
    """True: no person took part. Everything made from this journal must say so."""
    protocol_sha256: Sha256
    stimuli_sha256: Sha256
    manifest_sha256: Sha256
    plan_sha256: Sha256
    trials: Positive
    """Planned main trials, without practice and catch trials."""
    display: Name
    display_sha256: Sha256
    display_report: DisplayReport | None
    """Null if the display was not measured."""
    refresh_hz: Hertz
    """Refresh rate of the display."""
    gaze_mode: Literal["enforce", "warn", "monitor", "none"]
    gaze: GazeInfo | None
    revision: str
    """Version and git revision of metamerlab."""
    versions: dict[str, str]
    """Versions of Python and packages; of a session in a window also `renderer` and `opengl`."""
    platform: str
    timing_evidence: str = ""
    """Verification of flip times: `glXGetSyncValuesOML`, `fence`, `unverified`, `software timer`,
    `virtual`, or in a browser `animation frame`."""
    remote: Remote | None = None
    """The session ran in the participant's own browser. Left out where it ran at a desk."""

    @property
    def headset(self) -> HeadsetDevice | None:
        """Headset that it ran in; None where it ran on a screen."""
        return self.remote.machine.headset if self.remote else None


class SessionResume(Event, ExtendedModel):
    """The program was started again for the same session."""

    added_later: ClassVar[tuple[str, ...]] = ("refresh_hz", "deviations_s")

    kind: Literal["session-resume"] = "session-resume"
    revision: str
    versions: dict[str, str]
    display_report: DisplayReport | None
    gaze: GazeInfo | None
    torn_file: str | None
    """File that an unfinished last line was moved to. Null if there was none."""
    refresh_hz: Hertz | None = None
    """Refresh rate from here on. Left out where it is as before."""
    deviations_s: dict[str, float] | None = None
    """Excess of times at that rate over those that the study states. Left out with the rate."""


class ConsentGiven(Event):
    """Consent, as desk and browser say it."""

    kind: Literal["consent"] = "consent"
    agreed: bool
    text_sha256: Sha256


class Consent(ConsentGiven):
    """The participant agreed to the consent text."""

    language: LanguageCode


class Calibration(Event, ExtendedModel):
    """A validation of the gaze source before a block: means over its targets."""

    kind: Literal["calibration"] = "calibration"
    accuracy_deg: Magnitude
    """Angle between target and the mean direction of gaze. In journals without `sd_deg`, the mean
    angle."""
    precision_deg: Magnitude
    """Root mean square of angles between consecutive samples (RMS-S2S)."""
    points: Count
    sd_deg: Magnitude | None = None
    """Standard deviation of gaze, of both axes together. Null in journals of older versions."""
    lost_share: Share | None = None
    """Share of the samples that did not see the eye. Null in journals of older versions."""

    added_later: ClassVar[tuple[str, ...]] = ("sd_deg", "lost_share")


class BlockBegun(Event):
    """Beginning of a block, as desk and browser say it."""

    kind: Literal["block-start"] = "block-start"
    block: Count


class BlockStart(BlockBegun):
    """A block begins. Block 0 is practice."""

    trials: Count


class BlockEnd(Event):
    """Every trial of the block was completed or given up."""

    kind: Literal["block-end"] = "block-end"
    block: Count


class Break(Event):
    """A break between blocks, written at its end."""

    kind: Literal["break"] = "break"
    after_block: Count
    duration_s: Magnitude


class Pause(Event):
    """A pause at the participant's request, written at its end."""

    kind: Literal["pause"] = "pause"
    duration_s: Magnitude


class PhaseRecord(Model):
    """One phase of an attempt, as shown."""

    phase: Name
    """Its name in the task."""
    onset_s: Stamp
    """Time of the flip that first showed it."""
    offset_s: Stamp
    """Time of the flip that replaced it."""
    refreshes: Count
    """Refreshes between the two."""
    planned: Count | None
    """Planned refreshes. Null if the participant decides."""
    dropped: Count
    """Refreshes at which nothing new could be shown."""
    stimuli: tuple[Count, ...] = ()
    """Numbers of the attempt's stimuli that it showed."""


class ShownStimulus(Model):
    """One stimulus of an attempt."""

    name: str
    """Its name and folder in the manifest."""
    sha256: Sha256
    """Hash of its frames' hashes (`Clip.sha256` of the manifest)."""
    frames_shown: Count
    """Different frames that reached the display."""
    frames_planned: Count


class GazeQuality(Model):
    """Quality of fixation while gaze was watched."""

    samples: Count
    lost_share: Share
    """Share of the watched time without data, blinks included."""
    blinks: Count
    """Losses short enough to be tolerated."""
    violations: Count
    """Times that gaze was outside long enough. At most 1 in mode `enforce`."""
    mean_deg: Magnitude | None
    """Mean angle between gaze and target. Null without data."""
    max_deg: Magnitude | None


class FurtherAnswer(Model):
    """An answer to a question after, or beside, the study's own."""

    question: Name
    """Its name in the task."""
    answer: Name
    """The answer given."""
    key: str | None
    rt_s: Magnitude
    """Time from the onset of the question to the key press, s."""


class AttemptOutcome(Event):
    """Place and outcome of an attempt, as desk and browser say them."""

    kind: Literal["attempt"] = "attempt"
    trial: TrialId
    """The trial of the plan."""
    attempt: Positive
    """1 for the first attempt at this trial."""
    position: Count
    """Number of this attempt in the session, from 0."""
    outcome: Outcome
    void_reason: VoidReason | None
    """Reason why a void attempt must be repeated."""
    answer: Name | None
    """The answer given to the study's question."""


class Attempt(AttemptOutcome, ExtendedModel):
    """One attempt at a trial, completed or void, written when it is over."""

    role: Role
    """Practice is never analysed. Catch trials test attention."""
    block: Count
    """0 is practice."""
    repeat: Count
    """Number of the repeat of its condition, from 0."""
    condition: dict[str, Scalar]
    """Condition shown, column by column."""
    track: str | None
    """The adaptive track that chose the condition. Null if it was planned."""
    stimuli: tuple[ShownStimulus, ...]
    """Stimuli in the order that the task defines."""
    answers: tuple[Name, ...]
    """The answer that each response key gives, from left to right."""
    expected: Name | None
    """The right answer. Null if there is none."""
    correct: bool | None
    """True if the answer was right. Null without an answer or a right answer."""
    key: str | None
    rt_s: Magnitude | None
    """Time from the onset of the question to the key press, s."""
    phases: tuple[PhaseRecord, ...]
    """The phases that were shown, in order."""
    dropped: Count
    """Missed refreshes from the first watched phase to the answer phase."""
    warned: bool
    """True in mode `warn` if the participant was told that gaze had left the target."""
    gaze: GazeQuality | None
    gaze_file: SideFile | None
    """Samples: CSV with t_s, raw_t, x_px, y_px (empty: lost)."""
    flips_file: SideFile | None
    """Every flip: CSV with flip (number), t_s, interval_s, refreshes, kind, late_s, evidence,
    phase, clip_frame, frame_sha256. For several stimuli at once the last two hold one entry each,
    separated by a space. Of trials with stimuli that follow the gaze also gaze_x_px, gaze_y_px,
    field_x_px, field_y_px (pixels of the stimulus), age_s (sample to flip), eye, seed,
    drawn_sha256 (of the picture's hash, place, method and parameters), of the last frame of each
    stimulus pixels_sha256 and grid (some of them, Base64), and suppressed (1: the eye saw little,
    as far as gaze had come)."""
    further: tuple[FurtherAnswer, ...] = ()
    """Answers to all other questions of the trial, in their order. Left out where there are none,
    as in a void attempt."""
    live: LiveFrames | None = None
    """Age of gaze in frames that were drawn to it. Left out where there were none."""
    head_turn_deg: Annotated[float, Field(ge=0, le=180)] | None = None
    """Largest angle of the head from straight ahead in watched phases. Left out without a
    headset."""
    poses_file: SideFile | None = None
    """Every flip: CSV with flip (number), x, y, z, w (the head's pose, in whole numbers) and
    turn_deg (empty: not tracked). Left out without a headset."""

    added_later: ClassVar[tuple[str, ...]] = ("further", "live", "head_turn_deg", "poses_file")

    @property
    def side_files(self) -> tuple[SideFile, ...]:
        """Every file that it names."""
        return tuple(filter(None, (self.gaze_file, self.flips_file, self.poses_file)))

    @property
    def decides(self) -> bool:
        """True if it is one of the session's decisions."""
        return self.outcome == "completed" and self.role == "main"

    @property
    def refreshes(self) -> int:
        """Refreshes of all phases."""
        return sum(phase.refreshes for phase in self.phases)

    @property
    def missed(self) -> int:
        """Missed refreshes of all phases, as in the file of flips; `dropped` counts fewer."""
        return sum(phase.dropped for phase in self.phases)

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
        if not completed and self.further:
            raise ValueError("a void attempt must have no further answers")
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
    """An answer to a closing question."""

    kind: Literal["answer"] = "answer"
    question: Name
    text: str
    """Text as typed or chosen. Escape it before use."""


class Note(Event, ExtendedModel):
    """A remark by the operator or the program."""

    kind: Literal["note"] = "note"
    text: Text
    file: SideFile | None = None
    """Data that the tracker recorded or sent, byte for byte. Left out if the note is of no file."""

    added_later: ClassVar[tuple[str, ...]] = ("file",)


class Withdrawal(Event):
    """The participant withdrew. The only event left of a session."""

    kind: Literal["withdrawal"] = "withdrawal"
    study: Name
    slot: Count
    """The slot that became free."""


class SessionEnd(Event):
    """The last line of a run. A session that was quit can be resumed."""

    kind: Literal["session-end"] = "session-end"
    reason: Literal["completed", "quit", "consent-refused", "disk-full", "tracker-lost", "error"]
    completed_trials: Count
    """Main trials completed so far."""
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


def event_line(event: AnyEvent) -> bytes:
    """Return the journal line of an event, with its line feed."""
    return canonical_json(event) + b"\n"
