"""A display and a clock that exist only in numbers, with timing faults on request.

The virtual display refreshes on an exact grid. Sessions on it run as fast as the machine can
count, and every fault that was planted is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Literal, Protocol

from protocols.display import Display
from protocols.manifest import Manifest
from protocols.phases import STUDY_QUESTION
from protocols.plan import PlannedTrial
from protocols.script import ScriptQuestion, TrialScript
from study_app.live.in_trials import KeptPixels, LiveShow, SessionGaze, live_entry
from study_app.live.renderer import GazeState, Studio
from study_app.stage import FlipPicture, FlipReport, KeyPress, Page, PageResult

if TYPE_CHECKING:  # sessions without a screen load no graphics
    import moderngl
    import numpy as np
    from numpy.typing import NDArray

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
"""Wall clock of simulated sessions when their virtual clock reads 0."""


class VirtualClock:
    """A monotonic clock that moves when it is told to."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def __call__(self) -> float:
        """Return the time, in seconds."""
        return self._now_s

    def move_to(self, t_s: float) -> None:
        """Move forwards to `t_s`; a time in the past changes nothing."""
        self._now_s = max(self._now_s, t_s)

    def wall(self) -> str:
        """Return the virtual wall clock, UTC."""
        moment = EPOCH + timedelta(seconds=self._now_s)
        return moment.strftime("%Y-%m-%dT%H:%M:%S.%f") + "Z"


@dataclass(frozen=True)
class Fault:
    """Fault of one flip."""

    kind: Literal["late", "missed", "doubled"]
    amount: float = 1.0
    """`late`: share of a refresh period; `missed`: refreshes."""


class Observer(Protocol):
    """Observer before the virtual display."""

    def answer(self, trial: PlannedTrial, attempt: int) -> tuple[str, float]:
        """Return the key that will be pressed, and how long after the onset of the question."""

    def answer_further(
        self, question: ScriptQuestion, trial: PlannedTrial, attempt: int
    ) -> tuple[str, float]:
        """Return the same for a question that is not the study's own."""

    def turn_page(self, page: Page) -> PageResult:
        """Return the end of a page."""


@dataclass
class AskedQuestions:
    """Questions to an observer in one attempt, each once."""

    observer: Observer
    trial: PlannedTrial
    attempt: int
    questions: set[str] = field(default_factory=set)

    def press(self, question: ScriptQuestion, shown_s: float) -> KeyPress | None:
        """Return the key that will go down for a question that is now shown for the first time."""
        if question.name in self.questions:
            return None
        self.questions.add(question.name)
        if question.name == STUDY_QUESTION.name:
            key, after_s = self.observer.answer(self.trial, self.attempt)
        else:
            key, after_s = self.observer.answer_further(question, self.trial, self.attempt)
        return KeyPress(key, shown_s + after_s)


class VirtualStage:
    """A stage without a screen.

    Parameters
    ----------
    clock : VirtualClock
        Moved by every flip and page.
    refresh_hz : float
        The true refresh rate.
    observer : Observer
        Answers and turns pages.
    nominal_hz : float, optional
        What the display claims; default: the truth.
    on_prepare : callable, optional
        Called with (trial, attempt) before each attempt, for instance to restart a simulated
        gaze; returns the faults of the attempt by number of flip.
    """

    def __init__(
        self,
        clock: VirtualClock,
        refresh_hz: float,
        observer: Observer,
        *,
        nominal_hz: float | None = None,
        on_prepare: Callable[[PlannedTrial, int], Mapping[int, Fault]] = lambda _t, _a: {},
    ) -> None:
        self._clock, self._true_hz = clock, refresh_hz
        self._nominal_hz = nominal_hz or refresh_hz
        self._observer, self._on_prepare = observer, on_prepare
        self._asked: AskedQuestions | None = None
        self._faults: Mapping[int, Fault] = {}
        self._flips = 0
        self._number = 0
        self._pending: list[KeyPress] = []
        self._live: LiveShow | None = None
        self._pixels_of: Callable[[str], NDArray[np.uint8] | None] = lambda _name: None
        self._last: FlipPicture | None = None
        self._stamp_s = math.nan
        self.pictures: list[tuple[float, FlipPicture]] | None = None
        """Set to a list to have every flip's stamp and picture kept."""

    @property
    def refresh_hz(self) -> float:
        """Refresh rate that the display claims."""
        return self._nominal_hz

    def now(self) -> float:
        """Return the virtual clock."""
        return self._clock()

    def show_live(
        self,
        display: Display,
        manifest: Manifest,
        studio: Studio | None = None,
        pixels_of: Callable[[str], NDArray[np.uint8] | None] = lambda _name: None,
    ) -> None:
        """Have stimuli that follow the gaze, drawn where there are a studio and pixels."""
        self._live, self._pixels_of = LiveShow(self, display, manifest, studio), pixels_of

    def follow(self, gaze: SessionGaze, *, polled: bool) -> None:
        """Set the gaze that live pictures follow."""
        if self._live is not None:
            self._live.follow(gaze, polled=polled)

    def kept(self) -> Mapping[int, KeptPixels]:
        """Return the pixels that are kept of live frames."""
        return {} if self._live is None else self._live.kept()

    def prepare(self, trial: PlannedTrial, script: TrialScript, attempt: int, /) -> None:
        """Nothing to load, but what follows the gaze; a new attempt begins."""
        if self._live is not None:
            self._live.prepare(script, lambda n: self._pixels_of(script.stimuli[n].name))
        self._asked, self._flips = AskedQuestions(self._observer, trial, attempt), 0
        self._pending.clear()
        self._faults = self._on_prepare(trial, attempt)

    def press(self, key: str, t_s: float, at: float = 0.0) -> None:
        """Let a key go down at a time of the clock, or the pointer at a share of the width."""
        self._pending.append(KeyPress(key, t_s, at))

    def expect(self, trial: PlannedTrial) -> None:
        """Nothing to load."""

    def show(self, picture: FlipPicture) -> FlipReport:
        """Wait for the next refresh of the grid, or do what the planted fault says."""
        entry, before, self._last, live = live_entry(picture.phase), self._last, picture, None
        if entry is not None and self._live is not None:
            begins = before is None or before.phase is not picture.phase
            live = self._live.show(entry, self._stamp_s, begins=begins)
            stamp_s = live.flip.t_s
        else:
            stamp_s = self.flip()
        question = picture.phase.question
        if question and self._asked and (press := self._asked.press(question, stamp_s)):
            self.press(*press)
        if self.pictures is not None:
            self.pictures.append((stamp_s, picture))
        self._number += 1
        return FlipReport(stamp_s, self._number - 1, "virtual", live)

    def wait_until(self, t_s: float) -> None:
        """Move the clock."""
        self._clock.move_to(t_s)

    def paint(self, picture: moderngl.Texture, gaze_state: GazeState) -> None:
        """Nothing to paint on."""

    def flip(self) -> float:
        """Return the time of the next flip: at the next refresh, or as the planted fault says."""
        fault = self._faults.get(self._flips)
        self._flips += 1
        line = math.floor(self._clock() * self._true_hz + 1e-6) + 1
        stamp_s = line / self._true_hz
        if fault is not None and fault.kind in ("missed", "late"):
            stamp_s = (line + fault.amount) / self._true_hz
        elif fault is not None:  # doubled: the swap did not wait
            stamp_s = self._clock() + 0.02 / self._true_hz
        self._clock.move_to(stamp_s)
        self._stamp_s = stamp_s
        return stamp_s

    def key_presses(self) -> Sequence[KeyPress]:
        """Return the keys whose time has come."""
        if not self._pending:
            return ()
        now_s = self._clock()
        due = [press for press in self._pending if press.t_s <= now_s]
        self._pending = [press for press in self._pending if press.t_s > now_s]
        return due

    def disturbed(self) -> str:
        """Nothing comes between."""
        return ""

    def page(self, page: Page) -> PageResult:
        """Let the observer turn the page."""
        result = self._observer.turn_page(page)
        self._clock.move_to(self._clock() + result.duration_s)
        return result
