"""The stage of real sessions: a window that shows clips frame by frame and pages of text.

A thin shell: what is shown when is the trial machine's business, which frames and hashes the
manifest's, and how a flip is stamped the window's.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from pathlib import Path

import moderngl

from protocols.manifest import Manifest
from protocols.phases import Bar, Clip, Image, Optotype, Text
from protocols.plan import PlannedTrial
from protocols.schema import StudyProtocol
from protocols.session_schema import Texts
from study_app.clips import ClipStore, Names
from study_app.draw import Painter
from study_app.layout import PATCH_PX, Extras, Layout
from study_app.optotype import landolt_ring
from study_app.page_turner import NOTICE_S, PageTurner
from study_app.pages import Pages, answer_name
from study_app.stage import KeyPress, Page, PageResult, Picture, Shown
from study_app.target import target_image
from study_app.trial import Timeline
from study_app.virtual import Observer
from study_app.window import Window

_POLL_SHARE = 0.6
"""Share of a refresh in which keys are taken as they come while an answer is awaited."""
_UPLOAD_SHARE = 0.4
"""Share of a refresh that uploads may take while nothing moves."""
CLIP_PATIENCE_S = 60.0
"""How long to wait for the next frame of a disk that answers no more."""


class Presenter:
    """A `Stage` on a window.

    Parameters
    ----------
    window : Window
        Open.
    protocol : StudyProtocol
        What is shown.
    texts : Texts
        In the participant's language.
    manifest : Manifest
        Of the clips.
    stimuli : Path
        Their folder.
    refresh_hz : float
        As measured.
    extras : Extras
        Strip and patch.
    observer : Observer, optional
        Answers and turns pages in place of a person; real keys work as well.
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
        protocol: StudyProtocol,
        texts: Texts,
        manifest: Manifest,
        stimuli: Path,
        *,
        refresh_hz: float,
        extras: Extras | None = None,
        observer: Observer | None = None,
        on_prepare: Callable[[PlannedTrial, int], None] = lambda _t, _a: None,
    ) -> None:
        self._window, self._protocol = window, protocol
        self._refresh_hz, self._extras = refresh_hz, extras or Extras()
        self._observer, self._on_prepare = observer, on_prepare
        background = round(255 * protocol.display.background)
        self._painter = Painter(window.ctx, window.size, background)
        self._pages = Pages(window.size, texts, background)
        self._layout = Layout.of(window.display, protocol, manifest, self._extras)
        self._store = ClipStore(window.ctx, stimuli, manifest, protocol.task.stimuli_per_trial)
        image = target_image(self._layout.dot_diameter_px, background)
        self._reach = len(image) // 2
        x_px, y_px = self._layout.dot_px
        self._target = self._painter.texture(image)
        self._target_place = round(x_px) - self._reach, round(y_px) - self._reach
        self._statics = {
            name: self._painter.texture(image)
            for name, image in self._pages.fixed(protocol.response, protocol.task.answers()).items()
        }
        self._trial: PlannedTrial | None = None
        self._attempt = 1
        self._next: Names | None = None
        self._stimuli: tuple[moderngl.TextureArray, ...] = ()
        self._rings: dict[Optotype, tuple[moderngl.Texture, tuple[int, int]]] = {}
        self._number = 0
        self._last_s = window.now()
        self._notice: tuple[str, float] | None = None
        self._answer: tuple[str, float] | None = None
        self._asked = False
        self._turner = PageTurner(
            window,
            self._painter,
            self._pages,
            protocol.response.quit_keys,
            self._flip_and_load,
            self.key_presses,
            observer,
        )

    def __enter__(self) -> Presenter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free what is on the graphics card; the window stays open."""
        gc.enable()
        self._store.close()
        self._turner.release()
        rings = (texture for texture, _ in self._rings.values())
        for texture in (*self._statics.values(), self._target, *rings):
            texture.release()
        self._painter.release()

    @property
    def refresh_hz(self) -> float:
        """The measured rate."""
        return self._refresh_hz

    def now(self) -> float:
        """Return the monotonic clock, in seconds."""
        return self._window.now()

    def expect(self, trial: PlannedTrial) -> None:
        """Load the trial's stimuli while nothing moves: it comes next."""
        self._next = trial.stimuli

    def prepare(self, trial: PlannedTrial, attempt: int) -> None:
        """Have the trial's stimuli in graphics memory, saying so while it takes time."""
        self._store.allow(True)
        while self._notice and self.now() < self._notice[1] + NOTICE_S:
            self._flip(lambda: self._draw_static(str(self._notice and self._notice[0])))
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
                self._flip(lambda: self._draw_static("preparing"))
        self._window.require_display()
        self._store.allow(False)
        self._trial, self._attempt, self._next = trial, attempt, None
        self._stimuli = self._store.show(trial.stimuli)
        self._answer, self._asked = None, False
        self._warm_up()
        self._on_prepare(trial, attempt)
        gc.collect()
        gc.disable()
        self._window.poll()
        self._window.disturbed()  # what happened while preparing voids nothing

    def show(self, picture: Picture) -> Shown:
        """Draw, flip, and return the flip's stamp and number."""
        if picture.rests:
            self._between_stimuli(picture)
        shown = self._flip(lambda: self._draw(picture))
        if picture.phase.ends_on and self._observer and self._trial and not self._asked:
            self._asked = True
            key, after_s = self._observer.answer(self._trial, self._attempt)
            self._answer = key, shown.t_s + after_s
        return shown

    def key_presses(self) -> Sequence[KeyPress]:
        """Return the keys that went down since the last call."""
        presses = list(self._window.key_presses())
        if self._window.closing():
            presses.append(KeyPress(self._protocol.response.quit_keys[0], self.now()))
        if self._answer and self.now() >= self._answer[1]:
            presses.append(KeyPress(*self._answer))
            self._answer = None
        return presses

    def disturbed(self) -> str:
        """Return what came between participant and display since the last call."""
        return self._window.disturbed()

    def page(self, page: Page) -> PageResult:
        """Show a page until one of its keys goes down."""
        gc.enable()
        self._store.allow(True)
        self._notice = None
        return self._turner.turn(page)

    def look_at(
        self, place_px: tuple[float, float], duration_s: float, poll: Callable[[], None]
    ) -> bool:
        """Show the fixation target somewhere, calling `poll` at every flip.

        Returns
        -------
        bool
            False if a quit key went down.
        """
        edge = self._target.width // 2
        place = round(place_px[0]) - edge, round(place_px[1]) - edge

        def draw() -> None:
            self._painter.clear()
            self._painter.image(self._target, place)

        until_s = self.now() + duration_s
        while self.now() < until_s:
            self._window.require_display()
            self._flip(draw)
            poll()
            if any(press.key in self._protocol.response.quit_keys for press in self.key_presses()):
                return False
        return True

    def _flip_and_load(self, draw: Callable[[], None]) -> None:
        self._window.require_display()
        self._store.pump(self.now())
        self._flip(draw)

    def _flip(self, draw: Callable[[], None]) -> Shown:
        draw()
        if self._extras.strip:
            self._painter.strip(self._number)
        stamp = self._window.flip()
        shown = Shown(stamp.t_s, self._number, stamp.evidence)
        self._number += 1
        self._last_s = stamp.t_s
        return shown

    def _draw(self, picture: Picture) -> None:
        painter, phase = self._painter, picture.phase
        light = 0.0
        painter.clear()
        name = self._pages.notice_of(picture)
        if name:
            painter.image(self._statics[name], (0, 0))
        places = []
        for entry in phase.show:
            if isinstance(entry, Clip | Image):
                frame = phase.clip_frame(entry, picture.refreshes)
                places.append(self._layout.places[entry.x_deg, entry.y_deg])
                shown = self._stimuli[entry.stimulus], frame, places[-1]
                if isinstance(entry, Image) and entry.half is not None:
                    painter.half_frame(*shown, entry.half)
                else:
                    painter.clip_frame(*shown)
                light = 1.0 - frame % 2
            elif isinstance(entry, Text):
                painter.image(self._statics[self._text_name(entry, picture)], (0, 0))
            elif isinstance(entry, Bar):
                painter.bar(*self._layout.bars[entry.width_deg])
            elif isinstance(entry, Optotype):
                painter.image(*self._ring(entry))
            elif self._dot_shows(places):
                painter.image(self._target, self._target_place)
        if self._extras.photodiode:
            painter.patch(self._layout.patch, PATCH_PX, light)

    def _dot_shows(self, places: Sequence[tuple[int, int]]) -> bool:
        """Return whether the target is drawn beside or over stimuli at these places."""
        over = self._protocol.trial.dot_over_clips
        return not places or over or self._layout.beside(places, self._reach)

    def _text_name(self, text: Text, picture: Picture) -> str:
        if text.name == "answer" and self._trial is not None:
            return answer_name(self._trial.answers)
        return "right" if picture.correct else "wrong"

    def _ring(self, entry: Optotype) -> tuple[moderngl.Texture, tuple[int, int]]:
        """Return a ring's texture and its place; drawn once, before its trial begins."""
        if entry not in self._rings:
            image, place = landolt_ring(entry, self._window.display)
            self._rings[entry] = self._painter.texture(image), place
        return self._rings[entry]

    def _draw_static(self, name: str) -> None:
        self._painter.clear()
        self._painter.image(self._statics[name], (0, 0))
        if self._extras.photodiode:
            self._painter.patch(self._layout.patch, PATCH_PX, 0.0)

    def _between_stimuli(self, picture: Picture) -> None:
        """Use the time in which nothing moves: load what comes next, take keys as they come."""
        self._store.allow(True)
        if self._next is not None:
            self._store.expect(self._next)
            self._next = None
        period_s = 1.0 / self._refresh_hz
        self._store.pump(self.now() + _UPLOAD_SHARE * period_s)
        if picture.phase.ends_on:
            self._window.pump_until(self._last_s + _POLL_SHARE * period_s)
        else:
            gc.enable()
            name = self._pages.notice_of(picture)
            if name and self._notice is None:
                self._notice = name, self.now()

    def _warm_up(self) -> None:
        """Draw everything the trial will draw, without flipping, so that nothing is the first."""
        assert self._trial is not None
        timeline = Timeline.of(self._protocol, self._window.display, self._trial)
        for phase in timeline.phases:
            for refreshes in (0, (phase.frames or 1) - 1):
                self._draw(Picture(phase, refreshes))
        if self._extras.strip:
            self._painter.strip(self._number)
        self._painter.finish()
