"""Makes the script of a trial: of study, display, clips, planned trial and language alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TypeAlias, assert_never, get_args

from pydantic import ValidationError

from protocols import phases
from protocols.display import Display, Viewing
from protocols.errors import StudyError
from protocols.manifest import Manifest
from protocols.phases import ITI, STUDY_QUESTION, Drawable
from protocols.plan import PlannedTrial
from protocols.script import (
    Dot,
    Entry,
    Fill,
    Frames,
    GazeMode,
    Live,
    Picture,
    Place,
    Ring,
    ScriptPhase,
    ScriptQuestion,
    ScriptStimulus,
    StoredPicture,
    TrialScript,
    Words,
    ring_reach_px,
)
from protocols.study_file.problems import in_words
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import filled_text, key_label, unknown_placeholders
from protocols.tasks.base import whole_frames

ShownAlone: TypeAlias = (
    phases.Fixation
    | phases.Image
    | phases.MovingImage
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


def example_scripts(
    study: StudyProtocol,
    display: Display,
    language: str | None = None,
) -> tuple[TrialScript, ...]:
    """Return scripts of no stimuli in particular: a practice trial, for both orders of keys.

    Raises
    ------
    StudyError
        As `Scripts.of` does.
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
        text=filled_text(text, study.response),
        labels=labels,
        keys=keys,
    )
    return Picture(of=of, at=_from_middle(display, 0, 0))


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
        """Return the script of a trial; of an adaptive one, after its stimuli were chosen.

        Raises
        ------
        StudyError
            If a time is not whole refreshes, or the task's phases cannot be run or drawn, naming
            the phase: `protocols.feasibility` says it before a session.
        """
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
        return ScriptPhase(
            name=phase.name,
            frames=phase.frames,
            show=tuple(shown),
            gate_frames=phase.gate_frames,
            watched=phase.watched,
            question=ScriptQuestion(
                name=asks.name,
                answers=asks.answers,
                keys=asks.keys,
                pointer=self.study.response.pointer,
            )
            if asks is not None
            else None,
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
        of_trial = phases.Image | phases.MovingImage | phases.LiveImage
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
            case phases.MovingImage(stimulus, every, x_deg, y_deg):
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
