"""The stage of real sessions: a window that shows clips frame by frame and pages of text.

A thin shell: what is shown when is the trial machine's business, which frames and hashes the
manifest's, and how a flip is stamped the window's.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence
from typing import assert_never

import moderngl
import numpy as np
from numpy.typing import NDArray

from protocols.make_script import example_scripts, fixation_target, text_picture
from protocols.phases import ITI
from protocols.plan import PlannedTrial
from protocols.script import Drawn, Entry, Fill, Frames, Live, ScriptPhase, TrialScript
from protocols.script import Picture as Drawing
from study_app.attempt import BLANK
from study_app.clips import ClipStore, Names
from study_app.desktop.draw import Painter
from study_app.desktop.page_turner import NOTICE_S, PageTurner
from study_app.desktop.strip import PATCH_PX, patch_place
from study_app.desktop.window import Window
from study_app.live.in_trials import KeptPixels, LiveShow, SessionGaze, live_entries, live_entry
from study_app.live.renderer import GazeState
from study_app.observers import ArtificialObserver, default_model
from study_app.pages import PageLayout
from study_app.paint import bitmaps_of, drawn
from study_app.session_setup import SessionSetup
from study_app.stage import FlipPicture, FlipReport, KeyPress, Page, PageResult
from study_app.virtual import AskedQuestions

_POLL_SHARE = 0.6
"""Share of a refresh in which keys are taken as they come while an answer is awaited."""
_UPLOAD_SHARE = 0.4
"""Share of a refresh that uploads may take while nothing moves."""
CLIP_PATIENCE_S = 60.0
"""Longest wait for the next frame of a disk that answers no more."""


class Presenter:
    """A `Stage` on a window.

    Parameters
    ----------
    window : Window
        Open.
    setup : SessionSetup
        What is shown, from which clips, and how. In a simulated session an artificial observer
        answers and turns pages in place of a person; real keys work as well.
    refresh_hz : float
        As measured.
    on_prepare : callable, optional
        Called with (trial, attempt) before each attempt.

    Raises
    ------
    StudyError
        If a text cannot be written, memory is too small, or an extra would cover a clip.
    """

    def __init__(
        self,
        window: Window,
        setup: SessionSetup,
        refresh_hz: float,
        on_prepare: Callable[[PlannedTrial, int], None] = lambda _t, _a: None,
    ) -> None:
        study, texts, manifest = setup.study, setup.texts, setup.manifest
        self._window, self._study = window, study
        self._refresh_hz, self._marks, self._on_prepare = refresh_hz, setup.marks, on_prepare
        self._observer = (
            ArtificialObserver(default_model(study), study.response, setup.seed, setup.participant)
            if setup.simulated
            else None
        )
        studio = None
        if setup.studio is not None and study.stimuli.follows_gaze:
            studio = setup.studio(window.ctx)
        display, background = window.display, round(255 * study.display.background)
        self._middle = display.width_px // 2, display.height_px // 2
        self._painter = Painter(window.ctx, window.size, background)
        self._pages = PageLayout(window.size, texts.key_names, background)
        self._marks.check(example_scripts(study, display)[0])
        self._store = ClipStore(window.ctx, setup.stimuli, manifest, study.task.stimuli_per_trial)
        self._live = LiveShow(self, display, manifest, studio)
        self._live_pictures: dict[int, moderngl.Texture] = {}
        """As they were last drawn, by number of the trial's stimuli."""
        self._showing = FlipPicture(BLANK)
        self._phase: ScriptPhase | None = None
        self._evidence = ""
        self._bitmaps = bitmaps_of(study, display)
        self._textures: dict[Drawn, moderngl.Texture] = {}
        self._ready: dict[int, tuple[Drawing, moderngl.Texture]] = {}
        """Pictures by identity: found faster than by what they are of."""
        self._target = self._texture(fixation_target(study, display))
        self._preparing = text_picture(study, display, texts.preparing)
        self._ready[id(self._preparing)] = self._preparing, self._texture(self._preparing)
        self._asked: AskedQuestions | None = None
        self._next: Names | None = None
        self._stimuli: tuple[moderngl.TextureArray, ...] = ()
        self._number = 0
        self._last_s = window.now()
        self._notice: tuple[Drawing, float] | None = None
        self._answer: KeyPress | None = None
        quit_keys = study.response.quit_keys
        self._turner = PageTurner(
            window, self._painter, self._pages, quit_keys, self._flip_and_load, self.key_presses,
            self._observer,
        )  # fmt: skip

    def __enter__(self) -> Presenter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free what is on the graphics card; the window stays open."""
        gc.enable()
        self._live.release()
        self._store.close()
        self._turner.release()
        for texture in self._textures.values():
            texture.release()
        self._painter.release()

    @property
    def refresh_hz(self) -> float:
        """The measured rate."""
        return self._refresh_hz

    def now(self) -> float:
        """Return the monotonic clock, in seconds."""
        return self._window.now()

    def follow(self, gaze: SessionGaze, *, polled: bool) -> None:
        """Set the gaze that live pictures follow."""
        self._live.follow(gaze, polled=polled)

    def kept(self) -> Mapping[int, KeptPixels]:
        """Return the pixels that are kept of an attempt's live frames."""
        return self._live.kept()

    def dearest_live_s(self) -> tuple[float, str]:
        """Return the seconds that the dearest frame that follows the gaze takes, and its method.

        Pictures of noise stand in for the study's.
        """
        study = self._study
        script = example_scripts(study, self._window.display)[0]
        width, height = script.stimulus_px
        noise = np.random.default_rng(0).integers(0, 256, (height, width, 4), np.uint8)
        noise[..., 3] = 255
        phase = next(one for one in script.phases if live_entry(one))
        self._showing = FlipPicture(phase)
        known = study.stimuli.live_methods()
        every = {name: known[name] for name in study.shown()}
        return self._live.dearest_s(every, script, noise, self._painter.finish)

    def expect(self, trial: PlannedTrial) -> None:
        """Load the trial's stimuli while nothing moves: it comes next."""
        self._next = trial.stimuli

    def prepare(self, trial: PlannedTrial, script: TrialScript, attempt: int) -> None:
        """Have all that the script shows in graphics memory, saying so while it takes time."""
        self._store.allow(True)
        while self._notice and self.now() < self._notice[1] + NOTICE_S:
            self._flip_notice(self._notice[0])
            self._store.pump(self.now())
        self._notice = None
        self._store.expect(trial.stimuli)
        moved_s = self.now()
        while not self._store.ready(trial.stimuli):
            self._window.require_display()
            if self._store.pump(self.now() + _UPLOAD_SHARE / self._refresh_hz):
                moved_s = self.now()
            elif self.now() > moved_s + CLIP_PATIENCE_S:
                raise self._store.too_slow(CLIP_PATIENCE_S)
            if not self._store.ready(trial.stimuli):
                self._flip_notice(self._preparing)
        self._window.require_display()
        self._store.allow(False)
        self._next, self._answer = None, None
        self._asked = AskedQuestions(self._observer, trial, attempt) if self._observer else None
        self._stimuli = self._store.show(trial.stimuli)
        self._live.prepare(script, self._pixels)
        self._live_pictures = {number: self._live.first(number) for number in live_entries(script)}
        self._warm_up(script)
        self._on_prepare(trial, attempt)
        gc.collect()
        gc.disable()
        self._window.poll()
        self._window.disturbed()  # what happened while preparing voids nothing

    def show(self, picture: FlipPicture) -> FlipReport:
        """Draw, flip, and return the flip's stamp and number."""
        if picture.rests:
            self._between_stimuli(picture)
        question = picture.phase.question
        if self._study.response.pointer:
            self._window.show_cursor(question is not None)
        before, self._phase = self._phase, picture.phase
        if (live := live_entry(picture.phase)) is not None:
            self._showing = picture
            drawn_to = self._live.show(live, self._last_s, begins=before is not picture.phase)
            shown = FlipReport(drawn_to.flip.t_s, self._number - 1, self._evidence, drawn_to)
        else:
            if question:  # keys are taken as they come
                self._window.pump_until(self._last_s + _POLL_SHARE / self._refresh_hz)
            shown = self._flip(lambda: self._draw(picture))
        if question and self._asked and (press := self._asked.press(question, shown.t_s)):
            self._answer = press
        return shown

    def wait_until(self, t_s: float) -> None:
        """Take events until then, for a live frame."""
        self._window.pump_until(t_s)

    def paint(self, picture: moderngl.Texture, gaze_state: GazeState) -> None:  # noqa: ARG002
        """Draw the flip that is shown next, with what follows the gaze; return once it is drawn."""
        live = live_entry(self._showing.phase)
        assert live is not None
        self._live_pictures[live.stimulus] = picture
        self._draw(self._showing)
        self._painter.finish()

    def flip(self) -> float:
        """Show what was painted, and return when that was."""
        shown = self._flip(lambda: None)
        self._evidence = shown.evidence
        return shown.t_s

    def key_presses(self) -> Sequence[KeyPress]:
        """Return the keys that went down since the last call."""
        presses = list(self._window.key_presses())
        if self._window.closing():
            presses.append(KeyPress(self._study.response.quit_keys[0], self.now()))
        if self._answer and self.now() >= self._answer.t_s:
            presses.append(self._answer)
            self._answer = None
        return presses

    def disturbed(self) -> str:
        """Return the disturbance between participant and display since the last call."""
        return self._window.disturbed()

    def page(self, page: Page) -> PageResult:
        """Show a page until one of its keys goes down."""
        gc.enable()
        self._store.allow(True)
        self._notice = None
        return self._turner.turn(page)

    def look_at(
        self,
        place_px: tuple[float, float] | None,
        duration_s: float,
        poll: Callable[[], None],
        on_key: Callable[[str], None] = lambda _: None,
    ) -> bool:
        """Show the fixation target somewhere, or nothing, calling `poll` at every flip.

        At least one flip is shown. `on_key` is told the other keys that go down.

        Returns
        -------
        bool
            False if a quit key went down.
        """
        edge = self._target.width // 2

        def draw() -> None:
            self._painter.clear()
            if place_px is not None:
                place = round(place_px[0]) - edge, round(place_px[1]) - edge
                self._painter.image(self._target, place)

        until_s = self.now() + duration_s
        while True:
            self._window.require_display()
            self._flip(draw)
            poll()
            for press in self.key_presses():
                if press.key in self._study.response.quit_keys:
                    return False
                on_key(press.key)
            if self.now() >= until_s:
                return True

    def _flip_and_load(self, draw: Callable[[], None]) -> None:
        self._window.require_display()
        self._store.pump(self.now())
        self._flip(draw)

    def _flip(self, draw: Callable[[], None]) -> FlipReport:
        draw()
        if self._marks.strip:
            self._painter.strip(self._number)
        stamp = self._window.flip()
        shown = FlipReport(stamp.t_s, self._number, stamp.evidence)
        self._number += 1
        self._last_s = stamp.t_s
        return shown

    def _draw(self, picture: FlipPicture) -> None:
        painter, ready, light, (x, y) = self._painter, self._ready, 0.0, self._middle
        painter.clear()
        shown: Sequence[Entry] = picture.phase.show
        for entry in shown if picture.notice is None else (picture.notice, *shown):
            match entry:
                case Frames():
                    (left, top), frame = entry.at, entry.frame(picture.refreshes)
                    stimulus = self._stimuli[entry.stimulus]
                    painter.clip_frame(stimulus, frame, (x + left, y + top), entry.crop)
                    light = 1.0 - frame % 2
                case Live(stimulus=number, at=(left, top)):
                    painter.image(self._live_pictures[number], (x + left, y + top))
                    light = 1.0 - picture.refreshes % 2
                case Drawing():
                    (left, top), (_, texture) = entry.at, ready[id(entry)]
                    painter.image(texture, (x + left, y + top))
                case Fill():
                    left, top, width, height = entry.rect
                    painter.fill((x + left, y + top), (width, height), entry.grey / 255)
                case _:
                    assert_never(entry)
        if self._marks.photodiode:
            painter.fill(patch_place(self._window.size), (PATCH_PX, PATCH_PX), light)

    def _pixels(self, number: int) -> NDArray[np.uint8]:
        """Return a still of the trial as it was hashed, decoded and uploaded: (H, W, 4)."""
        array = self._stimuli[number]
        return np.frombuffer(array.read(), np.uint8).reshape(array.height, array.width, 4)

    def _texture(self, picture: Drawing) -> moderngl.Texture:
        """Return a picture's texture; drawn once, before its trial begins."""
        if picture.of not in self._textures:
            self._textures[picture.of] = self._painter.texture(drawn(picture.of, self._bitmaps))
        return self._textures[picture.of]

    def _flip_notice(self, said: Drawing) -> None:
        self._flip(lambda: self._draw(FlipPicture(BLANK, notice=said)))

    def _between_stimuli(self, picture: FlipPicture) -> None:
        """Use the time in which nothing moves: load what comes next."""
        self._store.allow(True)
        if self._next is not None:
            self._store.expect(self._next)
            self._next = None
        self._store.pump(self.now() + _UPLOAD_SHARE / self._refresh_hz)
        if not picture.phase.question:
            gc.enable()
            if picture.notice and picture.phase.name == ITI and self._notice is None:
                self._notice = picture.notice, self.now()

    def _warm_up(self, script: TrialScript) -> None:
        """Draw everything the trial will draw, without flipping, so that nothing is the first."""
        for entry in script.pictures():
            self._ready[id(entry)] = entry, self._texture(entry)
        for phase in script.phases:
            for refreshes in (0, (phase.frames or 1) - 1):
                self._draw(FlipPicture(phase, refreshes))
        if self._marks.strip:
            self._painter.strip(self._number)
        self._painter.finish()
