"""The sections of a study that decide its sessions: design, trial, gaze, response, text, ..."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints, TypeAdapter, ValidationError, model_validator
from pydantic_core import SchemaError

from protocols.errors import Problem
from protocols.sequential import Sequential
from protocols.units import (
    Count,
    Degrees,
    Grown,
    LanguageCode,
    Model,
    Name,
    Positive,
    Seconds,
    SecondsOrNone,
    Seed,
    Sha256,
    Share,
    SignedDegrees,
    Text,
)

if TYPE_CHECKING:
    from protocols.schema import StudyProtocol


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
    """How many in a round."""
    scenes: tuple[Name, ...] = ()
    """Left out: the scenes of the design."""
    feedback: bool = False
    """Say after each answer whether it was right; the task must know the right answer."""
    criterion_share: Annotated[float, Field(gt=0, le=1)] | None = None
    """Least share of right answers in a round; below it another round follows. Left out: one
    round."""
    rounds_max: Positive = 3
    """How many rounds at most, where there is a criterion."""

    @property
    def rounds(self) -> int:
        """How many rounds are planned."""
        return 1 if self.criterion_share is None else self.rounds_max


class Design(Model):
    """How often everything is shown, and in which order."""

    scenes: tuple[Name, ...] = ()
    """Scenes of the main trials; left out: all."""
    repeats: Positive
    """How often a participant meets each condition. Arrangements within a trial (which interval
    comes first, say) take turns: with a multiple of their number (2, for `abx` 4) all come equally
    often for everyone, else across slots."""
    scene_order: Literal["random", "balanced"] = "balanced"
    """`balanced`: each round shows every scene once, in a Latin-square order of the slot."""
    side: Literal["by-participant", "by-trial", "fixed"] = "by-participant"
    """Which answer the first response key stands for: swapped between slots, within a session,
    or never. Tasks with more than two answers, or with answers that name a side, need `fixed`."""
    blocks: Positive = 1
    """The trials are dealt into this many blocks, with breaks between."""
    break_s: SecondsOrNone = 30.0
    """Shortest break between two blocks."""
    practice: Practice | None = None
    """Left out: no practice."""
    seed: Seed
    """Of the order of trials."""
    max_attempts: Positive = 3
    """A trial that fails this often is given up and counted as missing. What a pause, the quit key
    or another window cut short does not count: it comes again as often as need be."""


class TrialTiming(Model):
    """What is common to the trials of every task: fixation before, blank after.

    Every time must be whole frames of the display.
    """

    fixation_s: Seconds = 0.5
    """How long gaze is held on the dot before the first stimulus."""
    fixation_timeout_s: Seconds = 10.0
    """How long the dot waits for that; then the attempt is void."""
    iti_s: Seconds = 0.5
    """Blank after the answer."""
    feedback_s: Seconds = 0.8
    """How long practice says whether an answer was right."""
    fixation_x_deg: SignedDegrees = 0.0
    """Place of the dot, right of the screen's centre (a single stimulus is centred)."""
    fixation_y_deg: SignedDegrees = 0.0
    """Place of the dot, below the screen's centre."""
    dot_deg: Degrees = 0.6
    """Outer diameter of the fixation target."""
    dot_over_clips: bool = False
    """Keep the target on the screen over the stimuli. Left out: stimuli are shown untouched, and
    the target only where it lies beside them."""
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


KEY_PATTERN = (
    r"^([a-z0-9]|left|right|up|down|space|enter|escape|tab|backspace|f([1-9]|1[0-2])"
    r"|kp_[0-9]|pad_(a|b|x|y|left|right|up|down|start|back|lb|rb))$"
)
KEYS_IN_WORDS = (
    "a key: a letter, a digit, left, right, up, down, space, enter, escape, tab, backspace, f1 to"
    " f12, kp_0 to kp_9, or a button of a gamepad such as pad_a"
)
KeyName = Annotated[str, StringConstraints(pattern=KEY_PATTERN)]
"""A key of the keyboard, of the number block (kp_4) or of a gamepad (pad_a)."""

Keys = Annotated[tuple[KeyName, ...], Field(min_length=1)]


class Response(Model):
    """Keys, and how long the answer may take."""

    keys: Annotated[tuple[Keys, ...], Field(min_length=2)] = (("left",), ("right",))
    """One entry for each answer of the task, from left to right: any of its keys gives it."""
    continue_keys: Keys = ("space",)
    """Turn a page, end a break."""
    pause_keys: Keys = ("p",)
    """End the attempt, which comes again, and rest."""
    quit_keys: Keys = ("escape",)
    """Ask whether to stop; the sitting can be resumed."""
    timeout_s: Seconds | None = None
    """Left out: no time-out. A later answer makes the attempt void."""

    def actions(self) -> dict[str, tuple[str, ...]]:
        """Return the keys of every action, by its place in the section."""
        return {f"keys[{place}]": keys for place, keys in enumerate(self.keys)} | {
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


class Texts(Grown):
    """Everything a participant reads, in one language.

    `{left}` and `{right}` are replaced by the leftmost and rightmost answer key, `{continue}` and
    `{quit}` by the first key of that action, `{done}` and `{total}` by numbers of blocks.
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
    answers: Annotated[dict[Name, Text], Field(min_length=2)]
    """Label of each answer on the answer screen, by the answer's name; which answers there are is
    the task's business."""
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
    right: Text | None = None
    """After a right answer in practice; needed where practice gives feedback."""
    wrong: Text | None = None
    """After a wrong answer in practice."""
    questions: tuple[Question, ...] = ()
    """Asked after the last block."""
    key_names: Annotated[dict[KeyName, Text], Field(default_factory=dict)]
    """How pages call keys that bear a word, such as { space = "Leertaste" }; left out: the English
    word."""

    added_later: ClassVar[tuple[str, ...]] = ("key_names",)


class TextSection(Model):
    """Texts by language."""

    default_language: LanguageCode
    """The language of a sitting that names none."""
    languages: Annotated[dict[LanguageCode, Texts], Field(min_length=1)]


class Exclusions(Model):
    """Rules fixed before the data: which sessions and trials the analysis leaves out."""

    completed_min_share: Share = 0.8
    """Least share of the planned main trials that were decided."""
    catch_min_share: Share = 0.75
    """Least share of right answers in catch trials."""
    same_side_max_share: Share = 1.0
    """Largest share of answers with one key."""
    rt_min_s: SecondsOrNone = 0.1
    """Faster answers are left out, one by one."""
    rt_max_s: Seconds | None = None
    """Slower answers are left out, one by one; left out: none."""


class Analysis(Grown):
    """What will be tested, fixed before the data: what every kind of analysis has."""

    added_later: ClassVar[tuple[str, ...]] = ("sequential", "reaction")

    kind: str
    """Which analysis: the one that goes with the task."""
    alpha: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    """Level of the tests."""
    exclusions: Exclusions = Exclusions()
    sequential: Sequential | None = None
    """Planned looks before all participants have come; left out: one test, at the end."""
    reaction: Literal["summary", "models"] = "summary"
    """Of reaction times: medians and means; `models` adds a log-normal mixed model and, where
    answers are two and right or wrong, EZ diffusion."""

    def problems(self, _study: StudyProtocol, /) -> Iterator[Problem]:
        """Yield what does not fit the rest of the study."""
        yield from ()

    def plain_sentences(self, study: StudyProtocol) -> list[str]:
        """Return the analysis in sentences, for a preregistration."""
        raise NotImplementedError


class Privacy(Model):
    """What is kept about a participant."""

    code_pattern: Text = r"[A-Za-z0-9_-]{2,32}"
    """Regular expression that participant codes match whole: pseudonyms, never names. Without
    look-around and references back: it is matched in time linear in the code."""
    consent_required: bool = True
    """Ask for consent before anything is recorded."""
    store_gaze: bool = True
    """Keep the gaze samples of every attempt."""
    retention_months: Positive | None = None
    """After how long the data is to be deleted; left out: not stated."""
    contact: str = ""
    """Whom a participant asks, printed on the consent page."""
    secret_sha256: Sha256 | None = None
    """SHA-256 of the study's secret, which lies beside the study file as NAME.secret and also seeds
    the order of trials; left out: the order follows from the code, which can be guessed from it."""

    @model_validator(mode="after")
    def _pattern_compiles(self) -> Privacy:
        try:
            for pattern in (self.code_pattern, self._whole_pattern):
                TypeAdapter(Annotated[str, StringConstraints(pattern=pattern)])
        except SchemaError as error:
            reason = str(error).strip().splitlines()[-1].rpartition("rror: ")[2]
            raise ValueError(
                "code_pattern must be a regular expression without look-around and references back,"
                f" so that it is matched in bounded time (got {self.code_pattern!r}: {reason})"
            ) from None
        return self

    @property
    def _whole_pattern(self) -> str:
        return f"^(?:{self.code_pattern})$"

    def accepts(self, code: str) -> bool:
        """Return whether the pattern matches a participant's code, in time linear in its length."""
        # pydantic matches by automata and never goes back, as Python's own expressions do
        try:
            TypeAdapter(
                Annotated[str, StringConstraints(pattern=self._whole_pattern)]
            ).validate_python(code)
        except ValidationError:
            return False
        return True
