"""A trial as data that any stage can draw: phases in refreshes, pictures in pixels, questions.

`trial_script` makes it of study, display, clips, planned trial and language; that is all it depends
on. The trial machine runs it, and window, preview and painter draw it. Frame strip and photodiode
are the stage's, and in no script.

Places are whole pixels from the screen's middle, right and down: the pixel whose left and upper
edges have half of the screen's pixels, rounded down, before them is (0, 0). So a script fits any
window that is large enough.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, TypeAlias, assert_never, get_args

from pydantic import Field, ValidationError, WithJsonSchema, model_validator

from protocols import phases
from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import TrialId
from protocols.manifest import Manifest
from protocols.phases import ITI, STUDY_QUESTION, Drawable
from protocols.plan import PlannedTrial
from protocols.recipes.base import LiveMethod
from protocols.study_file.problems import in_words
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import (
    KEY_PATTERN,
    KEYS_IN_WORDS,
    POINTER,
    Keys,
    fill,
    key_label,
    unknown_placeholders,
)
from protocols.tasks.base import whole_frames
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
from protocols.viewing import Viewing

Place: TypeAlias = tuple[int, int]
"""Place of an upper left corner: pixels right of and below the screen's middle."""
Size: TypeAlias = tuple[Pixels, Pixels]
"""Width and height."""
Rect: TypeAlias = tuple[int, int, Count, Count]
"""Left, top, width, height."""
ShownAlone: TypeAlias = (
    phases.Fixation
    | phases.Image
    | phases.Clip
    | phases.LiveImage
    | phases.Optotype
    | phases.Bar
    | phases.Bitmap
)
_COMMON = ("fixate", "respond", "feedback", ITI)
_BOUNDS = {
    "x_deg": (-90, 90),
    "y_deg": (-90, 90),
    "width_deg": (0, 180),
    "height_deg": (0, 180),
    "refreshes_per_frame": (1, 1_000_000),
}
"""Bounds of the numbers of drawables: at least the first, below the second."""
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
    size_px: Size
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
    size_px: Size
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
    def size_px(self) -> Size:
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
    size_px: Size
    """Size of its screen."""
    refresh_hz: Hertz
    background: Grey
    stimuli: tuple[ScriptStimulus, ...]
    """Stimuli as phases count them. Empty until an adaptive rule has chosen them."""
    stimulus_px: Size
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


def trial_script(
    study: StudyProtocol,
    display: Display,
    manifest: Manifest,
    trial: PlannedTrial,
    language: str,
) -> TrialScript:
    """Return the script of a trial; of an adaptive one, after its stimuli were chosen.

    Raises
    ------
    StudyError
        If a time is not whole refreshes, or the task's phases cannot be run or drawn, naming the
        phase: `protocols.feasibility` says it before a session.
    """
    return Scripts(study, display, language, manifest).of(trial)


def example_scripts(
    study: StudyProtocol,
    display: Display,
    language: str | None = None,
) -> tuple[TrialScript, ...]:
    """Return scripts of no stimuli in particular: a practice trial, for both orders of keys.

    Raises
    ------
    StudyError
        As `trial_script` does.
    """
    spoken = study.text.default_language if language is None else language
    scripts = Scripts(study, display, spoken)
    answers = study.task.answers()
    found = tuple(scripts.script(order, practice=True) for order in (answers, answers[::-1]))
    first, again = (
        [one.of for one in script.pictures() if isinstance(one.of, StoredPicture)]
        for script in found
    )
    if first != again:
        raise StudyError(
            "task: phases must draw the same Bitmaps each time (got other pixels the second time);"
            " draw chance from a fixed seed"
        )
    return found


def fixation_target(study: StudyProtocol, display: Display) -> Picture:
    """Return the fixation target at its place."""
    timing, viewing = study.trial, Viewing.of(display)
    x_deg, y_deg = timing.fixation_x_deg, timing.fixation_y_deg
    left, _ = viewing.to_px(x_deg - timing.dot_deg / 2, y_deg)
    right, _ = viewing.to_px(x_deg + timing.dot_deg / 2, y_deg)
    x_px, y_px = viewing.to_px(x_deg, y_deg)
    of = Dot(diameter_px=right - left, grey=round(255 * study.display.background))
    reach = of.edge_px // 2
    return Picture(of=of, at=_from_middle(display, round(x_px) - reach, round(y_px) - reach))


def landolt_ring(entry: phases.Optotype, display: Display) -> Picture:
    """Return the picture of a ring at its place on a display."""
    viewing = Viewing.of(display)
    x_px, y_px = viewing.to_px(entry.x_deg, entry.y_deg)
    _, top = viewing.to_px(entry.x_deg, entry.y_deg - entry.height_deg / 2)
    _, bottom = viewing.to_px(entry.x_deg, entry.y_deg + entry.height_deg / 2)
    reach = ring_reach_px(bottom - top)
    x, y = math.floor(x_px) - reach, math.floor(y_px) - reach
    of = Ring(
        gap_deg=entry.gap_deg,
        height_px=bottom - top,
        middle_px=(x_px - x, y_px - y),
        grey=round(255 * entry.grey),
    )
    return Picture(of=of, at=_from_middle(display, x, y))


def text_picture(
    study: StudyProtocol,
    display: Display,
    text: str,
    labels: tuple[str, ...] = (),
    keys: tuple[str, ...] = (),
) -> Picture:
    """Return the picture of a text, its placeholders filled; of a question with its answers."""
    of = Words(
        size_px=(display.width_px, display.height_px),
        background=round(255 * study.display.background),
        text=fill(text, study.response),
        labels=labels,
        keys=keys,
    )
    return Picture(of=of, at=_from_middle(display, 0, 0))


def ring_reach_px(height_px: float) -> int:
    """Return half the edge of a ring's picture, room for its smooth edge included."""
    return math.ceil(height_px / 2) + 1


def _from_middle(display: Display, x_px: int, y_px: int) -> Place:
    return x_px - display.width_px // 2, y_px - display.height_px // 2


def _why(error: ValidationError) -> str:
    """Return the first fault that pydantic, or a check of ours, found."""
    detail = error.errors()[0]
    said = detail.get("ctx", {}).get("error")
    place = ".".join(map(str, detail["loc"]))
    return str(said or f"{place}: {in_words(detail)}; give such a value")


def _wrong(phase: phases.Phase, why: str) -> StudyError:
    return StudyError(f"task: phase {phase.name!r}: {why}")


class Scripts:
    """Scripts of one participant's trials, which share nearly all: it is made once.

    Parameters
    ----------
    study, display : StudyProtocol, Display
        Checked.
    language : str
        One of the study's.
    manifest : Manifest, optional
        Of the clips; left out, there are scripts of no stimuli in particular alone.
    """

    def __init__(
        self,
        study: StudyProtocol,
        display: Display,
        language: str,
        manifest: Manifest | None = None,
    ) -> None:
        self.study, self.display, self.manifest = study, display, manifest
        self.language, self.texts = language, study.text.languages[language]
        self.viewing, self.background = Viewing.of(display), round(255 * study.display.background)
        clip = manifest.clips[0] if manifest else None
        self.stimulus_px = (
            (clip.width_px, clip.height_px) if clip else study.stimuli.size_px(display)
        )
        self.dot = fixation_target(study, display)
        self.live = study.stimuli.live_methods()
        self.made: dict[tuple[tuple[str, ...], bool], TrialScript] = {}

    def of(self, trial: PlannedTrial) -> TrialScript:
        """Return the script of a trial; raises as `trial_script`."""
        kind = trial.answers, trial.role == "practice"
        if kind not in self.made:
            self.made[kind] = self.script(*kind)
        clips = [self.manifest.clip(name) for name in trial.stimuli] if self.manifest else []
        stimuli = tuple(
            ScriptStimulus(
                name=clip.name,
                sha256=clip.sha256,
                frames=len(clip.frames_sha256),
                live=self.live.get(clip.name),
            )
            for clip in clips
        )
        return self.made[kind].model_copy(
            update={"trial": trial.id, "stimuli": stimuli, "correct": trial.correct}
        )

    def script(self, answers: tuple[str, ...], practice: bool) -> TrialScript:
        """Return a script of no stimuli in particular, with this order of the study's answers."""
        study, display = self.study, self.display
        try:
            return TrialScript(
                trial="practice-0000",
                language=self.language,
                display=display.name,
                size_px=(display.width_px, display.height_px),
                refresh_hz=display.refresh_hz,
                background=self.background,
                stimuli=(),
                stimulus_px=self.stimulus_px,
                phases=tuple(self.all_phases(answers, practice)),
                correct=None,
                gaze=GazeMode(study.gaze.mode),
                dropped_max=study.trial.dropped_frames_max,
                pause_keys=study.response.pause_keys,
                quit_keys=study.response.quit_keys,
            )
        except ValidationError as error:
            raise StudyError(f"task: {_why(error)}") from None

    def all_phases(self, answers: tuple[str, ...], practice: bool) -> Iterator[ScriptPhase]:
        """Yield all phases: fixation, the task's own, answer, feedback, blank."""
        study, texts, timing = self.study, self.texts, self.study.trial
        whole = partial(whole_frames, self.display)
        own = study.task.phases(study.pool, self.display)
        after = study.task.phases_after(study.pool, self.display)
        sure = study.task.confidence
        for given in (own, after):
            if not (
                isinstance(given, tuple | list) and all(isinstance(p, phases.Phase) for p in given)
            ):
                raise StudyError(
                    "task: phases must be a tuple of protocols.phases.Phase (got"
                    f" {given!r:.80}); return such a tuple"
                )
        after = (*((sure.phase(),) if sure else ()), *after)
        for phase in (*own, *after):
            if phase.name in _COMMON or [one.name for one in (*own, *after)].count(phase.name) > 1:
                raise _wrong(
                    phase,
                    "names of phases must differ, also from those that every trial has"
                    f" ({', '.join(_COMMON)}); rename it",
                )
        yield ScriptPhase(
            name="fixate",
            frames=whole(timing.fixation_s),
            show=(self.dot,),
            gate_frames=whole(timing.fixation_timeout_s),
        )
        yield from (self.phase(phase, answers) for phase in own)
        if not any(phase.asks == STUDY_QUESTION for phase in own):
            shown = (phases.QuestionText(),)
            respond = phases.Phase("respond", None, shown, asks=STUDY_QUESTION)
            yield self.phase(respond, answers)
        yield from (self.phase(phase, answers) for phase in after)
        if practice and study.design.practice is not None and study.design.practice.feedback:
            told = self.notices({"right": texts.right, "wrong": texts.wrong})
            yield ScriptPhase(name="feedback", frames=whole(timing.feedback_s), follows=told)
        lost = dict.fromkeys(("gaze-break", "no-fixation", "data-loss", "warned"), texts.gaze_lost)
        told = self.notices({**lost, "too-late": texts.too_late})
        yield ScriptPhase(name=ITI, frames=whole(timing.iti_s), follows=told)

    def notices(self, texts: Mapping[str, str | None]) -> dict[str, Picture]:
        return {
            name: text_picture(self.study, self.display, text)
            for name, text in texts.items()
            if text
        }

    def phase(self, phase: phases.Phase, answers: tuple[str, ...]) -> ScriptPhase:
        try:
            return self.compiled(phase, answers)
        except ValidationError as error:
            raise _wrong(phase, _why(error)) from None
        except (AttributeError, OverflowError, TypeError, ValueError) as error:
            raise _wrong(
                phase,
                "every part must be of the type that protocols.phases states (Python says:"
                f" {error}); give such values",
            ) from error

    def compiled(self, phase: phases.Phase, answers: tuple[str, ...]) -> ScriptPhase:
        asks, timeout_frames = phase.asks, phase.timeout_frames
        if not isinstance(asks, phases.Question | None):
            raise _wrong(
                phase,
                f"must ask one question at a time (got {asks!r:.120}): a key must give one answer;"
                " ask each in a phase of its own",
            )
        if asks == STUDY_QUESTION:
            keys, timeout_s = self.study.response.keys, self.study.response.timeout_s
            if timeout_s is not None and phase.frames is None and timeout_frames is None:
                timeout_frames = whole_frames(self.display, timeout_s)
            asks = phases.Question(
                STUDY_QUESTION.name,
                answers,
                keys,
                {self.language: self.texts.question},
                {self.language: tuple(self.texts.answers[answer] for answer in answers)},
            )
        shown: list[Entry] = []
        for entry in phase.show:
            if type(entry) not in get_args(Drawable):
                known = ", ".join(one.__name__ for one in get_args(Drawable))
                raise _wrong(
                    phase,
                    f"must show what every stage can draw ({known}) (got {type(entry).__name__});"
                    " draw it as a Bitmap",
                )
            if isinstance(entry, phases.QuestionText):
                shown.append(self.words(phase, asks))
            elif not isinstance(entry, phases.Fixation) or self.dot_shows(shown):
                shown.append(self.entry(entry, phase))
        question = None
        if asks is not None:
            question = ScriptQuestion(
                name=asks.name,
                answers=asks.answers,
                keys=asks.keys,
                pointer=self.study.response.pointer,
            )
        return ScriptPhase(
            name=phase.name,
            frames=phase.frames,
            show=tuple(shown),
            gate_frames=phase.gate_frames,
            watched=phase.watched,
            question=question,
            timeout_frames=timeout_frames,
        )

    def words(self, phase: phases.Phase, asks: phases.Question | None) -> Picture:
        if asks is None:
            raise _wrong(
                phase,
                "shows the text of a question and asks none; give it the question that it asks, or"
                " leave QuestionText out",
            )
        text, labels = asks.text.get(self.language), asks.labels.get(self.language, ())
        if not text or not len(labels) == len(asks.answers) == len(asks.keys):
            raise _wrong(
                phase,
                f"question {asks.name!r} must have a text in {self.language!r}, and for each of its"
                f" {len(asks.answers)} answers a label and keys (got {'a' if text else 'no'} text,"
                f" {len(labels)} labels, keys for {len(asks.keys)}); give them",
            )
        for word in unknown_placeholders(text):
            raise _wrong(phase, f"question {asks.name!r}: {word}")
        names = tuple(key_label(keys[0], self.texts.key_names) for keys in asks.keys if keys)
        return text_picture(self.study, self.display, text, tuple(labels), names)

    def checked(self, entry: ShownAlone, phase: phases.Phase) -> None:
        """Refuse a drawable with numbers out of bounds, or of a stimulus that is not there."""
        kind = type(entry).__name__
        for name, (low, high) in _BOUNDS.items():
            value = getattr(entry, name, None)
            if value is not None and not low <= value < high:
                raise _wrong(
                    phase,
                    f"{name} of {kind} must be at least {low} and below {high} (got {value!r});"
                    " give such a value",
                )
        count = self.study.task.stimuli_per_trial
        of_trial = phases.Image | phases.Clip | phases.LiveImage
        if isinstance(entry, of_trial) and not 0 <= entry.stimulus < count:
            raise _wrong(
                phase,
                f"must show one of the trial's {count} stimuli, counted from 0 (got"
                f" {entry.stimulus}); name such a one, or raise stimuli_per_trial",
            )
        follows = self.study.stimuli.follows_gaze
        if isinstance(entry, of_trial) and isinstance(entry, phases.LiveImage) != follows:
            said = "follow the gaze: show them as Live" if follows else "do not follow the gaze"
            raise _wrong(phase, f"stimuli of this study {said} (got {kind}), or take another task")

    def entry(self, entry: ShownAlone, phase: phases.Phase) -> Entry:
        """Return a drawable in pixels."""
        self.checked(entry, phase)
        width, height = self.stimulus_px
        match entry:
            case phases.LiveImage(stimulus=number, x_deg=x_deg, y_deg=y_deg):
                return Live(stimulus=number, at=self.place(x_deg, y_deg, width, height))
            case phases.Image(stimulus, x_deg, y_deg, half):
                if half not in (None, "left", "right"):
                    raise _wrong(
                        phase, f"half of Image must be 'left', 'right' or None (got {half!r})"
                    )
                x, y = self.place(x_deg, y_deg, width, height)
                left = width // 2 if half == "right" else 0
                crop = None if half is None else (left, 0, width // 2, height)
                return Frames(stimulus=stimulus, every=0, last=0, at=(x + left, y), crop=crop)
            case phases.Clip(stimulus, every, x_deg, y_deg):
                at = self.place(x_deg, y_deg, width, height)
                last = self.study.stimuli.frames - 1
                return Frames(stimulus=stimulus, every=every, last=last, at=at)
            case phases.Fixation():
                return self.dot
            case phases.Optotype():
                return landolt_ring(entry, self.display)
            case phases.Bar(width_deg):
                across, down = self.display.width_px, self.display.height_px
                edge = math.floor(self.viewing.to_px(-width_deg / 2, 0.0)[0] + 0.5)
                rect = (*_from_middle(self.display, edge, 0), max(0, across - 2 * edge), down)
                return Fill(rect=rect, grey=self.background)
            case phases.Bitmap(width_px, height_px, rgba, x_deg, y_deg):
                if len(rgba) != 4 * width_px * height_px:
                    raise _wrong(
                        phase,
                        f"a Bitmap of {width_px}x{height_px} px must have"
                        f" {4 * width_px * height_px} bytes, RGBA (got {len(rgba)})",
                    )
                of = StoredPicture(size_px=(width_px, height_px), sha256=entry.sha256)
                return Picture(of=of, at=self.place(x_deg, y_deg, width_px, height_px))
            case _:
                assert_never(entry)

    def place(self, x_deg: float, y_deg: float, width: int, height: int) -> Place:
        """Return the upper left corner of what has its middle at these angles."""
        x_px, y_px = self.viewing.to_px(x_deg, y_deg)
        x, y = math.floor(x_px - width / 2 + 1e-6), math.floor(y_px - height / 2 + 1e-6)
        return _from_middle(self.display, x, y)

    def dot_shows(self, shown: list[Entry]) -> bool:
        """Return True if the target stands beside the stimuli of its phase, or is drawn over."""
        timing, (width, height) = self.study.trial, self.stimulus_px
        x_px, y_px = self.viewing.to_px(timing.fixation_x_deg, timing.fixation_y_deg)
        x, y = x_px - self.display.width_px // 2, y_px - self.display.height_px // 2
        reach = self.dot.size_px[0] // 2
        for entry in shown if not timing.dot_over_clips else ():
            if isinstance(entry, Frames | Live):
                left = entry.at[0] - (entry.crop[0] if entry.crop else 0)
                over = left - reach < x < left + width + reach
                if over and entry.at[1] - reach < y < entry.at[1] + height + reach:
                    return False
        return True
