"""Stimuli that follow the gaze in trials: the loop of `live`, one flip of a stage at a time."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, NamedTuple, Protocol, cast

from protocols.disk.hashing import sha256_json
from protocols.display import Display
from protocols.errors import StudyError
from protocols.manifest import Manifest
from protocols.recipes.base import LiveMethod
from protocols.script import Live, PixelSize, ScriptPhase, TrialScript
from study_app.gaze.saccades import SaccadeWatch
from study_app.gaze.source import GazeSample
from study_app.live.loop import SPARE_SHARE, DrawnFlip, GazeSamples, LiveLoop, Screen
from study_app.live.renderer import (
    GazePlace,
    GazeState,
    LiveRenderer,
    LiveView,
    RendererDescription,
    Studio,
)

if TYPE_CHECKING:  # sessions without a screen load no graphics
    import moderngl
    import numpy as np
    from numpy.typing import NDArray

    from study_app.live.log import FrameReadback

TRIED = 9
"""Frames of each method that are drawn before a session."""


class LiveFrame(NamedTuple):
    """A frame that was drawn to the gaze."""

    flip: DrawnFlip
    sha256: str
    """Hash of all that decides it beside gaze, field and seed: `RendererDescription`."""


class KeptPixels(NamedTuple):
    """Record of a frame's pixels."""

    sha256: str
    """Hash of all of them, as they were drawn."""
    grid: str
    """Base64 of some, as in the log of a live picture."""


def described(
    live: LiveMethod, source_sha256: str, entry: Live, size_px: PixelSize, display: Display
) -> RendererDescription:
    """Return a description of the renderer of a stimulus at its place on a display.

    Parameters
    ----------
    source_sha256 : str
        Of the stimulus' frame, as the manifest has it.
    size_px : (width, height)
        Of the stimulus.
    """
    middle = display.width_px / 2 - display.width_px // 2, display.height_px / 2
    return RendererDescription(
        source_sha256=source_sha256,
        panorama=False,
        size_px=size_px,
        centre_px=(middle[0] - entry.at[0], middle[1] - display.height_px // 2 - entry.at[1]),
        distance_px=display.distance_mm / display.pitch_x_mm,
        method=live.method,
        parameters=dict(live.parameters),
        cut=live.cut,
    )


def live_entries(script: TrialScript) -> dict[int, Live]:
    """Return the entry of each stimulus that follows the gaze, by its number."""
    shown = (entry for phase in script.phases for entry in phase.show)
    return {entry.stimulus: entry for entry in shown if isinstance(entry, Live)}


def live_entry(phase: ScriptPhase) -> Live | None:
    """Return the part of a phase that follows the gaze; None: nothing."""
    return next((entry for entry in phase.show if isinstance(entry, Live)), None)


class NullRenderer:
    """A `LiveRenderer` for stages without pixels. The field's gaze is the eye's."""

    def __init__(self, _place: int, said: RendererDescription, _pixels: object) -> None:
        self._said, self._eye_px = said, said.centre_px

    def hold(self, view: LiveView) -> None:
        """Nothing to hold."""

    def prepare(self, seed: int) -> None:
        """Nothing to make."""

    def follow(self, eye_px: GazePlace, elapsed_s: float) -> tuple[GazePlace, GazePlace]:  # noqa: ARG002
        """Hold the last gaze while the eye is lost."""
        if eye_px[0] == eye_px[0]:
            self._eye_px = eye_px
        return self._eye_px, self._eye_px

    def draw(self, gaze_state: GazeState) -> moderngl.Texture:  # noqa: ARG002
        """There is none."""
        return cast("moderngl.Texture", None)

    def describe(self) -> RendererDescription:
        """Return a description of the renderer."""
        return self._said


class SessionGaze(GazeSamples, Protocol):
    """The gaze of a session, which also knows when it last saw the eye, and how the eye moves."""

    @property
    def seen(self) -> GazeSample | None:
        """The newest sample that saw the eye."""

    @property
    def saccades(self) -> SaccadeWatch | None:
        """Watch that has all samples."""


class _NoGaze:
    seen = saccades = None

    def poll(self) -> Sequence[GazeSample]:
        return ()


@dataclass(frozen=True)
class _Stimulus:
    renderer: LiveRenderer
    live: LiveMethod
    sha256: str
    corner_px: GazePlace


class LiveShow:
    """Live frames of a stage: stimuli that follow the gaze.

    Parameters
    ----------
    screen : Screen
        The stage's.
    display : Display
    manifest : Manifest
        Of the stimuli.
    studio : Studio, optional
        What draws; left out: nothing does.
    """

    def __init__(
        self, screen: Screen, display: Display, manifest: Manifest, studio: Studio | None = None
    ) -> None:
        self._screen, self._display, self._studio = screen, display, studio
        self._manifest = manifest
        self._cost_s = 0.0
        self._gaze: SessionGaze = _NoGaze()
        self._loop = LiveLoop(screen, self._gaze, (0, 0), polled=False)
        self._stimuli: dict[int, _Stimulus] = {}
        self._drawn: dict[int, tuple[int, moderngl.Texture]] = {}
        self._pixels: FrameReadback | None = None

    def follow(self, gaze: SessionGaze, *, polled: bool) -> None:
        """Set the gaze to follow; `polled` as in `LiveLoop`."""
        self._gaze = gaze
        self._loop = LiveLoop(
            self._screen, gaze, (0, 0), polled=polled, cost_s=self._cost_s, watch=gaze.saccades
        )

    def release(self) -> None:
        """Free what draws."""
        if self._studio is not None:
            self._studio.release()

    def prepare(
        self,
        script: TrialScript,
        pixels_of: Callable[[int], NDArray[np.uint8] | None],
    ) -> None:
        """Have all that is drawn in a trial ready.

        Parameters
        ----------
        pixels_of : callable
            Gives the pixels of the trial's stimuli by number, (H, W, 4); None: it has none.
        """
        self._stimuli.clear()
        self._drawn.clear()
        across, down = self._display.width_px // 2, self._display.height_px // 2
        for number, entry in live_entries(script).items():
            stimulus = script.stimuli[number]
            live, clip = stimulus.live, self._manifest.clip(stimulus.name)
            assert live is not None
            said = described(live, clip.frames_sha256[0], entry, script.stimulus_px, self._display)
            pixels = pixels_of(number)
            draws = (
                self._studio if self._studio is not None and pixels is not None else NullRenderer
            )
            renderer = draws(number, said, cast("NDArray[np.uint8]", pixels))
            renderer.prepare(live.seed)
            renderer.hold(LiveView())
            corner = float(entry.at[0] + across), float(entry.at[1] + down)
            self._stimuli[number] = _Stimulus(renderer, live, sha256_json(said), corner)

    def first(self, number: int) -> moderngl.Texture:
        """Return the picture of a stimulus for an eye before its middle."""
        one = self._stimuli[number]
        middle = one.renderer.describe().centre_px
        return one.renderer.draw(GazeState(middle, middle, one.live.seed))

    def show(self, entry: Live, last_flip_s: float, *, begins: bool) -> LiveFrame:
        """Show one frame.

        Parameters
        ----------
        last_flip_s : float
            When the screen last flipped.
        begins : bool
            Whether it is the first frame of its phase.
        """
        one = self._stimuli[entry.stimulus]
        self._loop.corner_px, self._loop.change = one.corner_px, one.live.change
        if begins:
            self._loop.begin(last_flip_s, self._gaze.seen)
        flip, picture = self._loop.step(one.renderer, LiveView(), one.live.seed)
        self._drawn[entry.stimulus] = flip.number, picture
        return LiveFrame(flip, one.sha256)

    def kept(self) -> dict[int, KeptPixels]:
        """Return the pixels of the last frame of each stimulus of the trial, by number of frame.

        It waits for the graphics card: nothing may move meanwhile.
        """
        drawn = [(number, picture) for number, picture in self._drawn.values() if picture]
        if not drawn:
            return {}
        if self._pixels is None:
            from study_app.live.log import FrameReadback

            self._pixels = FrameReadback()
        found = {}
        for number, picture in drawn:
            sha256, some = self._pixels.of(picture)
            found[number] = KeptPixels(sha256, base64.b64encode(some.tobytes()).decode())
        return found

    def dearest_s(
        self,
        every: Mapping[str, LiveMethod],
        script: TrialScript,
        pixels: NDArray[np.uint8],
        settle: Callable[[], None],
    ) -> tuple[float, str]:
        """Return the seconds that the dearest frame takes here, and its method.

        Gaze and field move from frame to frame, and the seed after the first one. What a seed
        decides is made beforehand, as in trials.

        Parameters
        ----------
        every : mapping
            What draws each stimulus, by name.
        script : TrialScript
            Shows one of them.
        pixels : ndarray of shape (H, W, 4)
            Of any picture.
        settle : callable
            Waits until what was asked of the graphics card is done.
        """
        assert self._studio is not None
        entry, size_px = next(iter(live_entries(script).values())), script.stimulus_px
        (width, height), found = size_px, (0.0, "")
        kinds = {(one.method, repr(one.parameters), one.cut is None): one for one in every.values()}
        for live in kinds.values():
            said = described(live, "0" * 64, entry, size_px, self._display)
            renderer = self._studio(0, said, pixels)
            renderer.hold(LiveView())
            taken_s = []
            for number in range(TRIED + 1):  # the first one also makes what is kept
                place = width * (0.2 + 0.6 * (number % 2)), height * (0.2 + 0.6 * number / TRIED)
                seed = live.seed + min(number, 1)
                renderer.prepare(seed)
                settle()
                begin_s = self._screen.now()
                gaze_state = GazeState(*renderer.follow(place, 0.1), seed)
                self._screen.paint(renderer.draw(gaze_state), gaze_state)
                taken_s.append(self._screen.now() - begin_s)
            found = max(found, (median(taken_s[1:]), live.method))
        self._cost_s = found[0]
        return found


def too_dear(display: Display, taken_s: float, method: str, drawn_by: str) -> StudyError | None:
    """Return the error on frames that take too long to follow the gaze; None where they can."""
    room_s = (1 - SPARE_SHARE) / display.refresh_hz
    if taken_s <= room_s:
        return None
    return StudyError(
        f"display {display.name!r}: a frame of {method!r} must be drawn in {1000 * room_s:.1f} ms,"
        f" within a refresh of {display.refresh_hz:g} Hz (it took {1000 * taken_s:.1f} ms on"
        f" {drawn_by}); take a faster graphics card, smaller stimuli, a lower refresh rate, or"
        " leave the method out. --software-pacing rehearses all the same"
    )
