"""A trial as data that any stage can draw: phases in refreshes, pictures in pixels, questions.

`protocols.make_script` makes it of study, display, clips, planned trial and language; that is all
it depends on. The trial machine runs it, and window, preview and painter draw it. Frame strip and
photodiode are the stage's, and in no script.

Places are whole pixels from the screen's middle, right and down: the pixel whose left and upper
edges have half of the screen's pixels, rounded down, before them is (0, 0). So a script fits any
window that is large enough.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from enum import Enum
from functools import cached_property
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, TypeAlias, assert_never

from pydantic import Field, WithJsonSchema, model_validator

from protocols.journal import TrialId
from protocols.phases import ITI, STUDY_QUESTION
from protocols.recipes.base import LiveMethod
from protocols.study_file.session_schema import KEY_PATTERN, KEYS_IN_WORDS, POINTER, Keys
from protocols.units import (
    Count,
    ExtendedModel,
    Hertz,
    LanguageCode,
    Model,
    Name,
    Pixels,
    Positive,
    Sha256,
    Text,
)

Place: TypeAlias = tuple[int, int]
"""Place of an upper left corner: pixels right of and below the screen's middle."""
PixelSize: TypeAlias = tuple[Pixels, Pixels]
"""Width and height."""
Rect: TypeAlias = tuple[int, int, Count, Count]
"""Left, top, width, height."""
Grey = Annotated[int, Field(ge=0, le=255)]


class GazeMode(Enum):
    """Consequence of a violation or a loss."""

    ENFORCE = "enforce"
    WARN = "warn"
    MONITOR = "monitor"
    NONE = "none"


class Dot(Model):
    """The fixation target, black with a cross of the background's grey."""

    kind: Literal["dot"] = "dot"
    diameter_px: Annotated[float, Field(ge=0)]
    """Outer diameter."""
    grey: Grey
    """Grey of the cross."""

    @property
    def edge_px(self) -> int:
        """Edge of its picture: even, so that the middle lies between pixels."""
        return 2 * math.ceil(self.diameter_px / 2 + 0.5)


class Ring(Model):
    """A Landolt ring after ISO 8596."""

    kind: Literal["ring"] = "ring"
    gap_deg: float | None
    """Direction of the gap, counter-clockwise from the right. Null: the ring is closed."""
    height_px: Annotated[float, Field(ge=0)]
    """Outer diameter."""
    middle_px: tuple[float, float]
    """Middle of the ring, from the upper left corner of its picture."""
    grey: Grey

    @property
    def edge_px(self) -> int:
        """Edge of its picture."""
        return 2 * ring_reach_px(self.height_px)


class Words(Model):
    """Text on a picture of the screen's size: a notice, or a question above its answers."""

    kind: Literal["words"] = "words"
    size_px: PixelSize
    background: Grey
    """Grey of the screen: letters are black or white on it."""
    text: Text
    labels: tuple[Text, ...] = ()
    """Labels of the answers, from left to right."""
    keys: tuple[Text, ...] = ()
    """Text below each label."""


class StoredPicture(Model):
    """A picture that is known by its pixels."""

    kind: Literal["stored"] = "stored"
    size_px: PixelSize
    sha256: Sha256
    """Hash of the text `WIDTHxHEIGHT` and the pixels, four bytes each, rows from the top."""


Drawn: TypeAlias = Annotated[Dot | Ring | Words | StoredPicture, Field(discriminator="kind")]
"""Subject of a picture."""


class Frames(Model):
    """Frames of one of the trial's stimuli, pixel by pixel."""

    kind: Literal["frames"] = "frames"
    stimulus: Count
    """Number of the trial's stimulus, from 0."""
    every: Count
    """Refreshes that each frame stands for. 0: the first one stays."""
    last: Count
    """Number of the last frame, from 0, which stays."""
    at: Place
    crop: Rect | None = None
    """The part that is shown, from the upper left corner of the frame. Null: all of it."""

    def frame(self, refreshes: int) -> int:
        """Return the index of the frame that is shown after so many refreshes of the phase."""
        if not self.every:
            return 0
        frame = refreshes // self.every
        return frame if frame < self.last else self.last


class Live(Model):
    """One of the trial's stimuli, drawn to the gaze frame by frame, by what the stimulus says."""

    kind: Literal["live"] = "live"
    stimulus: Count
    """Number of the trial's stimulus, from 0."""
    at: Place

    @property
    def crop(self) -> Rect | None:
        """None: all of it is shown."""
        return None

    def frame(self, _refreshes: int) -> int:
        """Return the index of the stimulus's frame that is drawn from: a still has one."""
        return 0


class Picture(Model):
    """A picture that Python makes beforehand, drawn over what is there."""

    kind: Literal["picture"] = "picture"
    of: Drawn
    at: Place

    @property
    def size_px(self) -> PixelSize:
        """Width and height."""
        match self.of:
            case Dot(edge_px=edge) | Ring(edge_px=edge):
                return edge, edge
            case Words(size_px=size) | StoredPicture(size_px=size):
                return size
            case _:
                assert_never(self.of)


class Fill(Model):
    """A rectangle of one grey."""

    kind: Literal["fill"] = "fill"
    rect: Rect
    grey: Grey


Entry: TypeAlias = Annotated[Frames | Live | Picture | Fill, Field(discriminator="kind")]
"""All that a stage must be able to draw."""


class ScriptQuestion(Model):
    """Question of a phase. The picture of its words is one of those that the phase shows."""

    name: Name
    """`answer`: the study's own question."""
    answers: tuple[Name, ...]
    """Names from left to right."""
    keys: tuple[tuple[Text, ...], ...]
    """A list of keys per answer."""
    pointer: bool = False
    """A click or touch gives an answer too: each has a column of the screen, equally wide."""

    @model_validator(mode="after")
    def _can_be_answered(self) -> ScriptQuestion:
        where, answers = f"question {self.name!r}", self.answers
        if not answers:
            raise ValueError(f"{where}: can never end, it has no answers; name them")
        if len(set(answers)) < len(answers):
            raise ValueError(f"{where}: every answer must be given once (got {', '.join(answers)})")
        if len(self.keys) != len(answers) or not all(self.keys):
            raise ValueError(
                f"{where}: must have keys for each of its {len(answers)} answers"
                f" ({', '.join(answers)}) (got {sum(map(bool, self.keys))}); give every answer a"
                " list of keys"
            )
        found: dict[str, str] = {}
        for answer, keys in zip(answers, self.keys, strict=True):
            for key in keys:
                if not re.fullmatch(KEY_PATTERN, key):
                    raise ValueError(f"{where}: must have {KEYS_IN_WORDS} (got {key!r})")
                if key in found:
                    raise ValueError(
                        f"{where}: a key must give one answer (got {key!r} for {found[key]!r} and"
                        f" {answer!r}); give one of them another key"
                    )
                found[key] = answer
        return self

    def answer_of(self, key: str, at: float = 0.0) -> str | None:
        """Return the answer that a key gives; None where it gives none.

        `at` is where the pointer pressed, as a share of the screen's width, from the left.
        """
        if key == POINTER:
            place = min(max(int(at * len(self.answers)), 0), len(self.answers) - 1)
            return self.answers[place] if self.pointer else None
        found = (a for a, keys in zip(self.answers, self.keys, strict=True) if key in keys)
        return next(found, None)


class ScriptPhase(Model):
    """One phase of a trial."""

    name: Name
    frames: Positive | None
    """Refreshes that it lasts. Null: until an answer ends it."""
    show: tuple[Entry, ...] = ()
    """Drawn in this order on the background's grey."""
    gate_frames: Positive | None = None
    """Longest wait, in refreshes, for gaze to be held for `frames`."""
    watched: bool = False
    """Gaze that leaves the dot voids the attempt. Missed refreshes count."""
    question: ScriptQuestion | None = None
    """An answer to it ends the phase, and the next ones where these ask the same."""
    timeout_frames: Positive | None = None
    """Refreshes of this phase after which the attempt is void without an answer. Null: no limit. A
    phase without a length that asks the study's question has the study's `response.timeout_s`."""
    follows: dict[str, Picture] = Field(default_factory=dict)
    """Picture that is drawn first, by how the attempt stands: `right` or `wrong`; in the last phase
    the reason why it is void, or `warned`."""


class ScriptStimulus(ExtendedModel):
    """One of the trial's stimuli."""

    name: Text
    """Name in the manifest."""
    sha256: Sha256
    """Hash of the hashes of its frames."""
    frames: Positive
    live: LiveMethod | None = None
    """Method that draws it to the gaze. Left out where its frames are shown as they are."""

    added_later: ClassVar[tuple[str, ...]] = ("live",)


class TrialScript(Model):
    """A trial on one display, for one participant."""

    trial: TrialId
    language: LanguageCode
    display: Text
    """Name of the display."""
    size_px: PixelSize
    """Size of its screen."""
    refresh_hz: Hertz
    background: Grey
    stimuli: tuple[ScriptStimulus, ...]
    """Stimuli as phases count them. Empty until an adaptive rule has chosen them."""
    stimulus_px: PixelSize
    """Width and height of each."""
    phases: Annotated[tuple[ScriptPhase, ...], Field(min_length=1)]
    """Phases in their order. The last one is the blank that ends the trial; a void attempt goes
    there at once."""
    correct: Name | None
    """The right answer to the study's question. Null where there is none."""
    gaze: Annotated[GazeMode, WithJsonSchema({"enum": [mode.value for mode in GazeMode]})]
    """Consequence where gaze leaves the dot."""
    dropped_max: Count
    """More missed refreshes than this make the attempt void."""
    pause_keys: Keys
    quit_keys: Keys

    @model_validator(mode="after")
    def _can_be_run(self) -> TrialScript:
        if self.phases[-1].name != ITI or self.phases[-1].frames is None:
            raise ValueError("the last phase must be the inter-trial interval, of a fixed length")
        if not any(phase.question for phase in self.phases):
            raise ValueError("a trial must have a phase that an answer ends")
        self._check_phases()
        self._check_questions()
        watched = [index for index, phase in enumerate(self.phases) if phase.watched]
        if not watched:
            raise ValueError("a trial must have watched phases; give a stimulus watched = True")
        for before, after in pairwise(watched):
            between = self.phases[before + 1 : after]
            if between and not any(phase.question for phase in between):
                raise ValueError(
                    f"phase {between[0].name!r}: watched phases must stand together, unless a"
                    " question comes between; make it watched, or ask something in it"
                )
        return self

    def _check_phases(self) -> None:
        for phase in self.phases:
            where = f"phase {phase.name!r}"
            if phase.frames is None and phase.question is None:
                raise ValueError(
                    f"{where}: can never end, for it has no length and asks nothing; give it"
                    " frames, or a question that it asks"
                )
            if phase.timeout_frames is not None and phase.question is None:
                raise ValueError(
                    f"{where}: has a time-out and asks nothing; leave it out, or give it the"
                    " question that it asks"
                )
            if sum(isinstance(entry, Live) for entry in phase.show) > 1:
                raise ValueError(
                    f"{where}: one live picture at most fits into a refresh; show them one after"
                    " the other"
                )
            if phase.gate_frames is not None and (phase.frames is None or phase.question):
                raise ValueError(
                    f"{where}: a phase that waits for gaze must have frames and ask nothing; ask in"
                    " a phase of its own"
                )

    def _check_questions(self) -> None:
        taken = dict.fromkeys(self.pause_keys, "pause_keys")
        taken |= dict.fromkeys(self.quit_keys, "quit_keys")
        asked: list[ScriptQuestion] = []
        for before, phase in zip((None, *self.phases), self.phases, strict=False):
            question = phase.question
            if question is None or (before is not None and question == before.question):
                continue
            where = f"phase {phase.name!r}: question {question.name!r}"
            if question.name in (other.name for other in asked):
                raise ValueError(
                    f"{where}: must be asked once, in one phase or several in a row; give the other"
                    " one a name of its own"
                )
            for key in (key for keys in question.keys for key in keys):
                if key in taken:
                    raise ValueError(
                        f"{where}: a key must do one thing (got {key!r}, which is one of"
                        f" response.{taken[key]}); give the answer another key"
                    )
            asked.append(question)
        if STUDY_QUESTION.name not in (question.name for question in asked):
            raise ValueError(
                f"the study's own question must be asked (got {', '.join(q.name for q in asked)});"
                " let a phase ask STUDY_QUESTION"
            )

    def planned(self, index: int) -> int | None:
        """Return the length of a phase in refreshes; None where the participant decides."""
        phase = self.phases[index]
        gated = phase.gate_frames is not None and self.gaze is GazeMode.ENFORCE
        return None if gated or phase.question else phase.frames

    @property
    def watched_frames(self) -> float:
        """Refreshes in which gaze is watched; infinite where a question without a time-out is."""
        lengths = (p.frames or p.timeout_frames or math.inf for p in self.phases if p.watched)
        return sum(lengths)

    def rests(self, index: int) -> bool:
        """Return True if nothing moves any more, so that the next stimuli may load."""
        return index > self._last_watched

    @cached_property
    def _last_watched(self) -> int:
        return max(index for index, phase in enumerate(self.phases) if phase.watched)

    @cached_property
    def frames(self) -> tuple[tuple[Frames | Live, ...], ...]:
        """Frames of the trial's stimuli that each phase shows."""
        return tuple(
            tuple(entry for entry in phase.show if isinstance(entry, Frames | Live))
            for phase in self.phases
        )

    @cached_property
    def answers(self) -> tuple[frozenset[str], ...]:
        """The answers that end each phase."""
        return tuple(
            frozenset(phase.question.answers if phase.question else ()) for phase in self.phases
        )

    @cached_property
    def after_answer(self) -> tuple[int, ...]:
        """The phase that follows on an answer in each phase."""
        places = range(len(self.phases))
        return tuple(
            next(
                (j for j in places[i + 1 :] if self.phases[j].question != self.phases[i].question),
                i + 1,
            )
            for i in places
        )

    @cached_property
    def questions(self) -> int:
        """Number of questions asked."""
        return len({phase.question.name for phase in self.phases if phase.question})

    def pictures(self) -> Iterator[Picture]:
        """Yield every picture, as often as it is shown."""
        for phase in self.phases:
            yield from (entry for entry in phase.show if isinstance(entry, Picture))
            yield from phase.follows.values()


def ring_reach_px(height_px: float) -> int:
    """Return half the edge of a ring's picture, room for its smooth edge included."""
    return math.ceil(height_px / 2) + 1
