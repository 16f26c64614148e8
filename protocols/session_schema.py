"""The sections of a study that decide its sessions: design, trial, gaze, response, text, ..."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from protocols.units import (
    Count,
    Degrees,
    LanguageCode,
    Model,
    Name,
    Positive,
    Seconds,
    SecondsOrNone,
    Seed,
    Share,
    SignedDegrees,
    Text,
)

SideName = Literal["left", "right"]


class StudyInfo(Model):
    """What the study is."""

    name: Name
    """Its name in files and folders."""
    title: Text
    """What people read."""
    description: str = ""
    """What it asks, in a sentence or two."""
    version: Text = "1"
    """Raise it when the study changes after the first participant."""
    source: str = ""
    """The publication whose design this follows."""
    participants: Positive
    """How many people the study plans for."""


class StudyDisplay(Model):
    """On which display the study runs, and what surrounds a clip."""

    display: Text
    """A display that comes with metamerlab (its name), or a display file (.toml)."""
    background: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Encoded grey around the clip and during every wait."""


class Practice(Model):
    """Trials before the first block; their answers are kept and never analysed."""

    trials: Positive
    """How many."""
    scenes: tuple[Name, ...] = ()
    """Left out: the scenes of the design."""


class CatchTrials(Model):
    """Trials whose answer is known, spread evenly over the blocks."""

    trials: Positive
    """How many."""
    better: Name
    """The method that an attentive participant picks."""
    worse: Name
    """The method it is shown against."""
    size: Name
    """The size at which the difference is plain."""


class Design(Model):
    """Which pairs are compared, how often, and in which order."""

    pairings: Annotated[tuple[tuple[Name, Name], ...], Field(min_length=1)] | Literal["all"] = "all"
    """Pairs of methods; `all` takes every pair once."""
    scenes: tuple[Name, ...] = ()
    """Scenes of the main trials; left out: all."""
    repeats: Positive
    """How often a participant sees each pairing x size x scene. Orders alternate: with an even
    number both orders come equally often for everyone, with an odd number across slots."""
    scene_order: Literal["random", "balanced"] = "balanced"
    """`balanced`: each round shows every scene once, in a Latin-square order of the slot."""
    side: Literal["by-participant", "by-trial", "fixed"] = "by-participant"
    """Which side's key stands for the first interval: swapped between slots, within a session,
    or never (left is first)."""
    blocks: Positive = 1
    """The trials are dealt into this many blocks, with breaks between."""
    break_s: SecondsOrNone = 30.0
    """Shortest break between two blocks."""
    practice: Practice | None = None
    """Left out: no practice."""
    catch: CatchTrials | None = None
    """Left out: no catch trials."""
    seed: Seed
    """Of the order of trials."""
    max_attempts: Positive = 3
    """A trial that fails this often is given up and counted as missing."""


class TrialTiming(Model):
    """One trial: fixate, interval 1, gap, interval 2, respond, inter-trial interval.

    The intervals last `clips.duration_s`. Every time must be whole frames of the display.
    """

    kind: Literal["2afc"] = "2afc"
    fixation_s: Seconds = 0.5
    """How long gaze is held on the dot before interval 1."""
    fixation_timeout_s: Seconds = 10.0
    """How long the dot waits for that; then the attempt is void."""
    gap_s: Seconds = 0.5
    """Blank between the intervals."""
    iti_s: Seconds = 0.5
    """Blank after the answer; no feedback."""
    fixation_x_deg: SignedDegrees = 0.0
    """Place of the dot, right of the screen's centre (clips are centred)."""
    fixation_y_deg: SignedDegrees = 0.0
    """Place of the dot, below the screen's centre."""
    dot_deg: Degrees = 0.6
    """Outer diameter of the fixation target."""
    dot_over_clips: bool = False
    """Keep the target on the screen during the intervals, over the clips. Left out: clips are
    shown untouched, and the target only where it lies beside them."""
    dropped_frames_max: Count = 2
    """Refreshes that may be missed during an attempt; one more makes it void."""


class Gaze(Model):
    """When gaze counts as held, and what follows when it is not."""

    mode: Literal["enforce", "warn", "monitor", "none"]
    """`enforce` voids and repeats; `warn` tells the participant afterwards; `monitor` only
    records; `none` needs no tracker."""
    window_deg: Degrees = 1.5
    """Largest angle between gaze and dot."""
    violation_s: SecondsOrNone = 0.02
    """How long gaze must be outside, over at least `violation_samples`."""
    violation_samples: Positive = 2
    """How many samples in a row must be outside."""
    blink_s: SecondsOrNone = 0.15
    """Lost data up to this long is a blink and pardoned."""
    blink_margin_s: SecondsOrNone = 0.05
    """Gaze outside this shortly after a blink is the lid's doing, and pardoned."""
    silence_s: Seconds = 0.1
    """A tracker that sends nothing for longer has lost the eye."""
    loss_max_share: Share = 0.2
    """Share of the watched time that may be lost, blinks included."""
    accuracy_max_deg: Degrees = 1.0
    """Worst mean error of a validation that still lets a block start."""
    rate_min_hz: Annotated[float, Field(ge=0)] = 50.0
    """A slower gaze source is refused."""


KeyName = Annotated[
    str,
    StringConstraints(
        pattern=r"^([a-z0-9]|left|right|up|down|space|enter|escape|tab|backspace|f([1-9]|1[0-2])"
        r"|kp_[0-9]|pad_(a|b|x|y|left|right|up|down|start|back|lb|rb))$"
    ),
]
"""A key of the keyboard, of the number block (kp_4) or of a gamepad (pad_a)."""

Keys = Annotated[tuple[KeyName, ...], Field(min_length=1)]


class Response(Model):
    """Keys, and how long the answer may take."""

    left_keys: Keys = ("left",)
    """Any of them answers for the left label."""
    right_keys: Keys = ("right",)
    """Any of them answers for the right label."""
    continue_keys: Keys = ("space",)
    """Turn a page, end a break."""
    pause_keys: Keys = ("p",)
    """End the attempt, which comes again, and rest."""
    quit_keys: Keys = ("escape",)
    """Ask whether to stop; the sitting can be resumed."""
    timeout_s: Seconds | None = None
    """Left out: no time-out. A later answer makes the attempt void."""

    def actions(self) -> dict[str, tuple[str, ...]]:
        """Return the keys of every action, by field name."""
        return {
            "left_keys": self.left_keys,
            "right_keys": self.right_keys,
            "continue_keys": self.continue_keys,
            "pause_keys": self.pause_keys,
            "quit_keys": self.quit_keys,
        }


class Question(Model):
    """One question after the last block, answered in free text or by choice."""

    name: Name
    """Its name in tables."""
    text: Text
    """What is asked."""
    choices: tuple[Text, ...] = ()
    """Left out: free text."""


PLACEHOLDERS = ("left", "right", "continue", "quit", "done", "total")
"""What `{...}` in a text may stand for: keys, and the numbers of blocks done and in all."""


class Texts(Model):
    """Everything a participant reads, in one language.

    `{left}`, `{right}`, `{continue}` and `{quit}` are replaced by the first key of that action,
    `{done}` and `{total}` by numbers of blocks.
    """

    consent: Text
    """The first page; the continue key agrees."""
    instructions: Annotated[tuple[Text, ...], Field(min_length=1)]
    """One page each."""
    practice: Text
    """Before the practice trials."""
    start: Text
    """Before the first block."""
    question: Text
    """While the answer is awaited."""
    first: Text
    """Label of the first interval on the answer screen."""
    second: Text
    """Label of the second interval."""
    break_page: Text
    """Between two blocks."""
    paused: Text
    """After the pause key."""
    gaze_lost: Text
    """After an attempt that ended because gaze left the dot."""
    too_late: Text
    """After an attempt without an answer in time."""
    preparing: Text
    """While clips are loaded."""
    quit_question: Text
    """After the quit key."""
    thanks: Text
    """The last page."""
    questions: tuple[Question, ...] = ()
    """Asked after the last block."""


class TextSection(Model):
    """Texts by language."""

    default_language: LanguageCode
    """The language of a sitting that names none."""
    languages: Annotated[dict[LanguageCode, Texts], Field(min_length=1)]


class PrimaryComparison(Model):
    """The comparison the study stands or falls with."""

    method: Name
    """The method expected to be preferred."""
    against: Name
    """The method it is compared with."""
    size: Name | None = None
    """Left out: all sizes together."""


class Exclusions(Model):
    """Rules fixed before the data: which sessions and trials the analysis leaves out."""

    completed_min_share: Share = 0.8
    """Least share of the planned main trials that were decided."""
    catch_min_share: Share = 0.75
    """Least share of right answers in catch trials."""
    same_side_max_share: Share = 1.0
    """Largest share of answers on one side."""
    rt_min_s: SecondsOrNone = 0.1
    """Faster answers are left out, one by one."""
    rt_max_s: Seconds | None = None
    """Slower answers are left out, one by one; left out: none."""


class Analysis(Model):
    """What will be tested, fixed before the data."""

    primary: PrimaryComparison
    """The comparison that is tested by itself."""
    alpha: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    """Level of the tests."""
    smallest_effect_rate: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    """Smallest effect of interest: distance of the preference rate from one half."""
    test: Literal["participant-scene", "participant", "pooled"] = "participant-scene"
    """Whose variation the inference respects."""
    correction: Literal["holm", "none"] = "holm"
    """Over all pairings and sizes; the primary comparison stands alone."""
    exclusions: Exclusions = Exclusions()


class Privacy(Model):
    """What is kept about a participant."""

    code_pattern: Text = r"[A-Za-z0-9_-]{2,32}"
    """Regular expression that participant codes match whole: pseudonyms, never names."""
    consent_required: bool = True
    """Ask for consent before anything is recorded."""
    store_gaze: bool = True
    """Keep the gaze samples of every attempt."""
    retention_months: Positive | None = None
    """After how long the data is to be deleted; left out: not stated."""
    contact: str = ""
    """Whom a participant asks, printed on the consent page."""

    @model_validator(mode="after")
    def _pattern_compiles(self) -> Privacy:
        import re

        try:
            re.compile(self.code_pattern)
        except re.error as error:
            raise ValueError(
                f"code_pattern must be a regular expression (got {self.code_pattern!r}: {error})"
            ) from None
        return self
