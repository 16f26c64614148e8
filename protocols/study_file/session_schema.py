"""The sections of a study that decide its sessions: design, trial, gaze, response, text, ...

Texts that participants read have placeholders, which are filled here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints, TypeAdapter, ValidationError, model_validator
from pydantic_core import SchemaError

from protocols.errors import did_you_mean
from protocols.units import (
    Degrees,
    ExtendedModel,
    Few,
    Hertz,
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
    matching,
)


class StudyInfo(Model):
    """The study itself."""

    name: Name
    """Used in file and folder names."""
    title: Text
    """Shown to readers of reports."""
    description: str = ""
    """The question, in a sentence or two."""
    version: Text = "1"
    """Raise it when the study changes after the first participant."""
    source: str = ""
    """The publication whose design this follows."""
    participants: Annotated[int, Field(ge=1, le=100_000)]
    """Planned number of participants."""


class StudyDisplay(Model):
    """The display, and what surrounds the stimuli."""

    display: Text
    """Name of a display that comes with metamerlab, or a display file (.toml)."""
    background: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Grey around the stimuli and during waits, gamma-encoded."""


class Practice(Model):
    """Trials before the first block. Their answers are kept but never analysed."""

    trials: Positive
    """Trials per round."""
    scenes: tuple[Name, ...] = ()
    """Default: the scenes of the design."""
    feedback: bool = False
    """Tell participants whether an answer was right. Needs right answers, or catch trials."""
    criterion_share: Annotated[float, Field(gt=0, le=1)] | None = None
    """Share of right answers below which another round follows. Default: one round only."""
    rounds_max: Few = 3
    """Largest number of rounds, if there is a criterion."""

    @property
    def rounds(self) -> int:
        """Largest number of rounds."""
        return 1 if self.criterion_share is None else self.rounds_max

    @property
    def judged(self) -> bool:
        """True if its answers must be right or wrong."""
        return self.feedback or self.criterion_share is not None


class Design(ExtendedModel):
    """Design: repeats of each condition, and their order."""

    added_later: ClassVar[tuple[str, ...]] = ("places",)

    scenes: tuple[Name, ...] = ()
    """Scenes of the main trials. Default: all."""
    repeats: Positive
    """Trials per condition and participant. Arrangements, such as which interval comes first,
    balance within each participant if this is a multiple of their number (2; 4 for `abx`),
    otherwise across slots."""
    scene_order: Literal["random", "balanced"] = "balanced"
    """`balanced`: each round shows every scene once, in a Latin-square order given by the slot."""
    side: Literal["by-participant", "by-trial", "fixed"] = "by-participant"
    """Rule by which response keys swap. Tasks with more than two answers, or whose answers name a
    side, need `fixed`."""
    blocks: Few = 1
    """Number of blocks, with a break between blocks."""
    break_s: SecondsOrNone = 30.0
    """Shortest break between two blocks."""
    practice: Practice | None = None
    """Practice trials. Default: none."""
    places: Literal["by-arrival", "drawn"] = "by-arrival"
    """Each participant's place in the counterbalancing. `drawn`: by the study's secret, so that
    nobody without it tells who came when. `by-arrival`: first come, first place."""
    seed: Seed
    """Determines the order of trials."""
    max_attempts: Few = 3
    """A trial void this often is given up and counted as missing. Pauses, quits and lost focus do
    not count."""


class TrialTiming(Model):
    """Timing and fixation, common to all tasks.

    Every time must be a whole number of display refreshes.
    """

    fixation_s: Seconds = 0.5
    """Time that gaze must rest on the target before the first stimulus."""
    fixation_timeout_s: Seconds = 10.0
    """Longest time that the target waits for gaze. Then the attempt is void."""
    iti_s: Seconds = 0.5
    """Blank after the answer."""
    feedback_s: Seconds = 0.8
    """Duration of feedback in practice."""
    fixation_x_deg: SignedDegrees = 0.0
    """Position of the target, right of the screen's centre."""
    fixation_y_deg: SignedDegrees = 0.0
    """Position of the target, below the screen's centre."""
    dot_deg: Degrees = 0.6
    """Outer diameter of the target."""
    dot_over_clips: bool = False
    """Draw the target over the stimuli. Otherwise it is shown only beside them."""
    dropped_frames_max: Annotated[int, Field(ge=0, le=1_000_000)] = 2
    """Missed refreshes tolerated per attempt. One more makes the attempt void."""


class Gaze(Model):
    """Fixation rule: when gaze counts as held, and what happens when it is not."""

    mode: Literal["enforce", "warn", "monitor", "none"]
    """`enforce`: the attempt is void and the trial repeated. `warn`: the participant is told
    afterwards. `monitor`: gaze is only recorded. `none`: no tracker is needed."""
    window_deg: Degrees = 1.5
    """Largest angle between gaze and target."""
    violation_s: SecondsOrNone = 0.02
    """Shortest time outside the window that counts as a violation."""
    violation_samples: Few = 2
    """Fewest consecutive samples outside that count as a violation."""
    blink_s: SecondsOrNone = 0.15
    """Missing data up to this long is a tolerated blink."""
    blink_margin_s: SecondsOrNone = 0.05
    """Gaze outside the window this soon after a blink is tolerated: the lid causes it."""
    silence_s: Seconds = 0.1
    """A tracker silent for longer has lost the eye."""
    loss_max_share: Share = 0.2
    """Largest share of the watched time without data, blinks included."""
    accuracy_max_deg: Degrees = 1.0
    """Largest mean error at which validation still lets a block start."""
    rate_min_hz: Annotated[float, Field(ge=0, le=1e6)] = 50.0
    """Slower gaze sources are refused."""


KEY_PATTERN = (
    r"^([a-z0-9]|left|right|up|down|space|enter|escape|tab|backspace|f([1-9]|1[0-2])"
    r"|kp_[0-9]|pad_(a|b|x|y|left|right|up|down|start|back|lb|rb))$"
)
KEYS_IN_WORDS = (
    "a key: a letter, a digit, left, right, up, down, space, enter, escape, tab, backspace, f1 to"
    " f12, kp_0 to kp_9, or a button of a gamepad such as pad_a"
)
KeyName = Annotated[str, matching(KEY_PATTERN, KEYS_IN_WORDS)]
"""A key of the keyboard, of the number block (kp_4) or of a gamepad (pad_a)."""

Keys = Annotated[tuple[KeyName, ...], Field(min_length=1)]


POINTER = "pointer"
"""Name in a journal for the key of an answer that was clicked or touched."""


class Response(ExtendedModel):
    """Keys, pointer and time-out."""

    added_later: ClassVar[tuple[str, ...]] = ("pointer",)

    keys: Annotated[tuple[Keys, ...], Field(min_length=2)] = (("left",), ("right",))
    """A list of keys per answer, from left to right. Any key of a list gives its answer."""
    continue_keys: Keys = ("space",)
    """Turn a page, end a break."""
    pause_keys: Keys = ("p",)
    """End the attempt and rest. The trial is repeated."""
    quit_keys: Keys = ("escape",)
    """Ask whether to stop. The session can be resumed."""
    timeout_s: Seconds | None = None
    """A later answer makes the attempt void. Default: no limit."""
    pointer: bool = False
    """Answers may also be clicked, or touched, in the column of their label. The cursor is shown
    while a question is."""

    def actions(self) -> dict[str, tuple[str, ...]]:
        """Return the keys of every action, by its place in the section."""
        return {f"keys[{place}]": keys for place, keys in enumerate(self.keys)} | {
            "continue_keys": self.continue_keys,
            "pause_keys": self.pause_keys,
            "quit_keys": self.quit_keys,
        }


class ClosingQuestion(Model):
    """A question after the last block."""

    name: Name
    """Its column in tables."""
    text: Text
    """Text of the question."""
    choices: tuple[Text, ...] = ()
    """Default: free text."""


PLACEHOLDERS = ("left", "right", "continue", "quit", "done", "total")
"""Names in `{...}` that a text may hold: keys, and the numbers of blocks done and in all."""


class Texts(ExtendedModel):
    """Everything a participant reads, in one language.

    `{left}` and `{right}` stand for the leftmost and rightmost answer key, `{continue}` and
    `{quit}` for the first key of that action, `{done}` and `{total}` for numbers of blocks.
    """

    consent: Text
    """The first page. The continue key agrees."""
    instructions: Annotated[tuple[Text, ...], Field(min_length=1)]
    """One page per entry."""
    practice: Text
    """Before the practice trials."""
    start: Text
    """Before the first block."""
    question: Text
    """While the answer is awaited."""
    answers: Annotated[dict[Name, Text], Field(min_length=2)]
    """Label of each answer of the task, by the answer's name."""
    break_page: Text
    """Between two blocks."""
    paused: Text
    """After the pause key."""
    gaze_lost: Text
    """After gaze left the target."""
    too_late: Text
    """After no answer in time."""
    preparing: Text
    """While stimuli are loaded."""
    quit_question: Text
    """After the quit key."""
    thanks: Text
    """The last page."""
    right: Text | None = None
    """After a right answer in practice. Required for feedback."""
    wrong: Text | None = None
    """After a wrong answer in practice."""
    questions: tuple[ClosingQuestion, ...] = ()
    """Asked after the last block."""
    key_names: Annotated[dict[KeyName, Text], Field(default_factory=dict)]
    """Names of keys on pages, such as { space = "Leertaste" }. Default: the English word."""

    added_later: ClassVar[tuple[str, ...]] = ("key_names",)


class TextSection(Model):
    """Texts by language."""

    default_language: LanguageCode
    """Language of sessions that do not name one."""
    languages: Annotated[dict[LanguageCode, Texts], Field(min_length=1)]
    """The texts, by language code."""


class Exclusions(Model):
    """Exclusions by the analysis, fixed before data collection."""

    completed_min_share: Share = 0.8
    """Sessions with fewer completed main trials are left out."""
    catch_min_share: Share = 0.75
    """Sessions with fewer right answers in catch trials are left out."""
    same_side_max_share: Share = 1.0
    """Sessions with more answers by one key are left out."""
    rt_min_s: SecondsOrNone = 0.1
    """Faster answers are left out."""
    rt_max_s: Seconds | None = None
    """Slower answers are left out. Default: no limit."""


class Headset(Model):
    """Settings of the study in a headset, by its browser (WebXR), in place of a screen.

    The head's pose is not fixation: eyes move in a head that is still. Preregister these keys.
    """

    rates: Annotated[tuple[Hertz, ...], Field(min_length=1)] = (72.0, 80.0, 90.0, 120.0)
    """Refresh rates at which it may run. The first one that a headset has is asked for."""
    turn_deg: Annotated[float, Field(gt=0, le=180, json_schema_extra={"unit": "deg"})] | None = None
    """Largest angle of the head from straight ahead while stimuli are watched; beyond it the trial
    is void, and comes again. Default: any."""
    around: bool = False
    """Stimuli are panoramas, twice as wide as high, and are all around the participant. False:
    they are on a flat screen, as large and as far away as that of the study's display."""
    memory_mb: Annotated[float, Field(gt=0, le=1e5, json_schema_extra={"unit": "MB"})] = 500.0
    """Most that the decoded stimuli of two trials may take."""


class Web(ExtendedModel):
    """Settings of the study in a participant's own browser."""

    added_later: ClassVar[tuple[str, ...]] = ("share", "headset")

    gaze: Literal["none"]
    """A browser does not watch gaze: fixation is not controlled there, whatever `[gaze]` says."""
    tolerance_s: Annotated[float, Field(ge=0, le=0.1, json_schema_extra={"unit": "s"})] = 0.0
    """Largest change of times to make them whole refreshes. 150 ms are 10.8 refreshes at 72 Hz. A
    refresh rate that needs more is refused. Preregister it."""
    share: Annotated[float, Field(gt=0, le=1, json_schema_extra={"unit": "share of 1"})] = 1.0
    """Share of the scenes that one participant is shown there, at least one scene: fewer megabytes
    and trials each. The place in the counterbalancing says which, so that all scenes are shown to
    equally many. Preregister it."""
    identifier: (
        Annotated[
            str,
            matching(
                r"^[A-Za-z][A-Za-z0-9_-]{0,63}$",
                "a letter and up to 63 letters, digits, dashes and underscores, like 'PANEL_ID'",
            ),
        ]
        | None
    ) = None
    """Parameter of the link whose value is kept, such as a panel's code of the participant.
    Default: none is kept."""
    completion_url: (
        Annotated[
            str,
            matching(
                r"^https?://\S+$",
                "an address without spaces, like 'https://example.org/thanks'",
                2048,
            ),
        ]
        | None
    ) = None
    """Address that the last page links to. Default: none."""
    completion_code: Text | None = None
    """Code that the last page shows. Default: none."""
    headset: Headset | None = None
    """The study runs in a headset. Default: on a screen."""


class Privacy(Model):
    """Rules on what is kept about a participant."""

    code_pattern: Text = r"[A-Za-z0-9_-]{2,32}"
    """Regular expression that a whole participant code must match. Codes are pseudonyms, never
    names."""
    consent_required: bool = True
    """Ask for consent before recording anything."""
    store_gaze: bool = True
    """Keep the gaze samples of every attempt."""
    retention_months: Few | None = None
    """Months after which the data must be deleted. Default: not stated."""
    contact: str = ""
    """Person whom participants may ask. Printed on the consent page."""
    secret_sha256: Sha256 | None = None
    """Hash of the study's secret (NAME.secret), which helps to seed the order of trials. Without
    it, the order can give a participant's code away."""

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
        """Return True if the pattern matches a participant's code, in time linear in its length."""
        # pydantic matches by automata and never goes back, as Python's own expressions do
        try:
            TypeAdapter(
                Annotated[str, StringConstraints(pattern=self._whole_pattern)]
            ).validate_python(code)
        except ValidationError:
            return False
        return True


_DEVICES = {"kp": "num", "pad": "pad"}
_SHOWN = {"left": "←", "right": "→", "up": "↑", "down": "↓"}


def filled_text(text: str, response: Response, *, done: int = 0, total: int = 0) -> str:
    """Return `text` with `{left}`, `{done}` and so on replaced; other braces stay as they are.

    Parameters
    ----------
    text : str
        As the protocol has it.
    response : Response
        Its first key of each action is named.
    done, total : int
        Blocks done, and in all.
    """
    values = {
        "left": response.keys[0][0],
        "right": response.keys[-1][0],
        "continue": response.continue_keys[0],
        "quit": response.quit_keys[0],
        "done": str(done),
        "total": str(total),
    }
    for name in PLACEHOLDERS:
        text = text.replace("{" + name + "}", values[name])
    return text


def unknown_placeholders(text: str) -> Iterator[str]:
    """Yield the fault of each `{...}` of a text that stands for nothing."""
    for word in re.findall(r"\{(\w*)\}", text):
        if word not in PLACEHOLDERS:
            yield (
                f"{{...}} must be one of {', '.join(PLACEHOLDERS)} (got {{{word}}})"
                f"{did_you_mean(word, PLACEHOLDERS)}"
            )


def consent_text(texts: Texts, contact: str) -> str:
    """Return the text of the consent page, placeholders included: the text, and whom to ask."""
    return texts.consent + (f"\n\n{contact}" if contact else "")


def key_label(name: str, names: Mapping[str, str] | None = None) -> str:
    """Return the participant's name of a key: ``←``, ``F``, ``space``, ``num 4``.

    `names` has the words of the participant's language.
    """
    if names and name in names:
        return names[name]
    kind, joined, rest = name.partition("_")
    if joined and kind in _DEVICES:
        return f"{_DEVICES[kind]} {key_label(rest)}"
    return _SHOWN.get(name, name.upper() if len(name) == 1 else name)
