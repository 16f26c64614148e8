"""`metamerlab live`: a picture in the window that follows the gaze."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from protocols.errors import StudyError
from protocols.load import load_display
from study_app.cli.options import one_of
from study_app.cli.pictures.foveate import DEFAULT_METHOD, frames_of
from study_app.cli.pictures.one_picture_options import (
    FovOption,
    SettingsOption,
    ShownOption,
    check_file,
    choose_methods,
    named_methods,
)
from study_app.cli.terminal import say, say_notes

if TYPE_CHECKING:
    from pipeline.foveation.geometry import FlatGeometry
    from pipeline.named_classes import Choice
    from pipeline.pictures.colour_file import PictureReading
    from protocols.display import Display
    from protocols.recipes.base import Change
    from study_app.cli.pictures.live_renderer import FoveatingRenderer, LiveSource
    from study_app.desktop.window import Window
    from study_app.gaze.source import GazeSample
    from study_app.gaze.trusted import TrustedGaze
    from study_app.live.log import LiveChoice, LiveLog, ReadLog
    from study_app.live.loop import DrawnFlip, LiveLoop
    from study_app.live.redraw import RedrawResult
    from study_app.live.renderer import LiveView, RendererDescription
    from study_app.live.screen import WindowScreen
    from study_app.pacing import Pacing

KEYS = "m: method, l: law, s: seed, o: overlay, escape: end"
_LAWS = ("v1", "v2", "authors")
_POOLING = ("law", "scaling", "alpha", "rate")
_STEPS_PER_DEG = 64  # of a panorama's direction
_MARKED_S = 10.0
_TOLD_S = 0.5  # between two changes of what the overlay says
_FILE = typer.Option(rich_help_panel="The file")


@dataclass(frozen=True)
class LiveOptions:
    """Options of a picture that follows the gaze, and of its record."""

    gaze: str = "mouse"
    """mouse, lsl:NAME, or replay:FILE (.asc, .csv)."""
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--methods",
            "-m",
            metavar="A,B,...",
            help="Conditions, the first one to begin with; the key m goes through these."
            rf" \[default: {DEFAULT_METHOD}, then all that the GPU draws]",
        ),
    ] = None
    settings: SettingsOption = None
    head: str | None = None
    """lsl or lsl:NAME: the head's pose turns a panorama."""
    change: str = "always"
    """always: a frame follows the gaze; during-saccades: only in saccades."""
    seed: Annotated[int, typer.Option(min=0)] = 0
    """Seed to begin with."""
    display: ShownOption = None
    fov: FovOption = None
    panorama: bool = False
    """An equirectangular panorama; drag to look around."""
    fps: Annotated[float | None, typer.Option(min=1, max=1000)] = None
    r"""Frames a second. \[default: the video's, or 30]"""
    overlay: bool = False
    """Begin with rings, frame time and latency shown."""
    record: Annotated[Path | None, typer.Option(metavar="FILE")] = None
    """Keep a log of every flip (.jsonl), new."""
    proof_every: Annotated[int | None, typer.Option(min=1, metavar="N")] = None
    r"""Keep what --verify compares of every Nth frame. \[default: a hundred and more a minute]"""
    verify: Annotated[Path | None, typer.Option(metavar="LOG")] = None
    """Draw frames of a log again, off screen, instead of showing SOURCE."""
    seconds: Annotated[float | None, typer.Option(min=0.1)] = None
    """End after so long."""
    software_pacing: bool = False
    """A timer instead of the display's refresh."""
    stops: Annotated[float | None, _FILE] = None
    """Make light brighter by this many stops."""
    clip: Annotated[bool, _FILE] = False
    """Clip light that a display cannot show."""
    encoded: Annotated[bool, _FILE] = False
    """Floats hold display-referred colour, not light."""


def live(
    source: Annotated[
        str,
        typer.Argument(
            help="A picture, a folder of frames, a video, or builtin:NAME, such as builtin:garden."
        ),
    ],
    asked: LiveOptions,
) -> None:
    """Show a picture that follows the gaze: a metamer, or what it is compared with.

    Keys: m the next method, l the next pooling law, s the next seed, o the overlay, escape the end.

    Examples:

        metamerlab live photo.jpg

        metamerlab live photo.jpg --gaze lsl:eye --display fhd27-60hz --record seen.jsonl

        metamerlab live photo.jpg --verify seen.jsonl

        metamerlab live around.exr --panorama -m warped-metamer --set law=v2
    """
    from pipeline.pictures.colour_file import PictureReading
    from protocols.recipes.base import Change

    if asked.verify is not None:
        if replace(asked, verify=None) != LiveOptions():
            raise StudyError("--verify takes SOURCE and the log alone; leave other options out")
        _verify(source, asked.verify)
        return
    exposed = asked.panorama and asked.stops is None and not asked.clip
    reading = PictureReading(
        clip=asked.clip, stops=asked.stops or 0.0, encoded=asked.encoded, exposed=exposed
    )
    change = one_of("--change", asked.change, get_args(Change))
    show = _Show(source, asked, change, _choices(asked.methods, asked.settings), reading)
    record = asked.record
    if record is not None:
        check_file(record, (".jsonl",))
        if record.exists():
            raise StudyError(f"{record}: must be a new file, and is there; name another one")
    elif asked.proof_every is not None:
        raise StudyError("--proof-every is for a log; add --record FILE, or leave it out")
    _run(show)


@dataclass(frozen=True)
class _Show:
    """Options of the command, as they are shown."""

    source: str
    asked: LiveOptions
    change: Change
    choices: list[Choice]
    reading: PictureReading


def _choices(methods: list[str] | None, settings: list[str] | None) -> list[Choice]:
    """The conditions that keys go through, the first one first."""
    from pipeline.foveation.conditions import (
        LIVE,
        check_live,
        condition_parameters,
        create_condition,
    )
    from pipeline.named_classes import Choice

    names = list(dict.fromkeys(named_methods(methods) or [DEFAULT_METHOD, *LIVE]))
    chosen = choose_methods(
        names, settings, every=names, default=names[0], known=condition_parameters,
        sheet=len(names) > 1,
    )  # fmt: skip
    for name, parameters in chosen:
        check_live(name, parameters)
        create_condition(name, parameters)
    return [Choice(name, parameters) for name, parameters in chosen]


def _run(show: _Show) -> None:
    from study_app.cli.pictures.live_renderer import FoveatingRenderer, draw_source
    from study_app.desktop.monitor import monitor_display
    from study_app.desktop.window import Window
    from study_app.gaze.open_source import check_kind
    from study_app.live.screen import WindowScreen

    asked = show.asked
    check_kind(asked.gaze)
    if asked.head is not None:
        one_of("--head", asked.head.partition(":")[0], ("lsl",))
        if not asked.panorama:
            raise StudyError("--head turns a panorama; add --panorama, or leave --head out")
    shown_on = load_display(asked.display) if asked.display is not None else None
    read, fps = _read(show.source, show.reading, asked.panorama, asked.fps)
    if read is None and asked.panorama:
        raise StudyError(f"--panorama is for a file; {show.source} is flat")
    if asked.fps is not None and (read is None or len(read.frames) == 1):
        raise StudyError("--fps is for a folder of frames or a video (SOURCE is neither)")
    monitor = None if shown_on else monitor_display()
    shown_on = shown_on or monitor
    assert shown_on is not None
    screen_size = shown_on.height_px, shown_on.width_px
    flat_size = screen_size if read is None or asked.panorama else read.size
    geometry = _geometry(flat_size, show, monitor)
    corner = tuple((a - b) // 2 for a, b in zip(screen_size[::-1], flat_size[::-1], strict=True))
    pacing: Pacing = "software" if asked.software_pacing else "vsync"
    with ExitStack() as open_now:
        window = open_now.enter_context(Window(shown_on, pacing=pacing))
        screen = WindowScreen(
            window, (corner[0], corner[1]), geometry.centre_px, geometry.distance_px
        )
        open_now.callback(screen.release)
        screen.announce("The picture is being prepared.")
        source = read or draw_source(show.source, geometry, window.ctx)
        say_notes(source.notes)
        renderer = FoveatingRenderer(window.ctx, source, geometry, show.choices[0])
        open_now.callback(renderer.release)
        _Showing(show, window, screen, renderer, (corner[0], corner[1]), fps).run()


def _read(
    source: str, reading: PictureReading, panorama: bool, fps: float | None = None
) -> tuple[LiveSource | None, float]:
    """Return the frames of a file, and their rate; None for a picture of ours."""
    from study_app.cli.pictures.live_renderer import BUILTIN, read_source

    if source.startswith(BUILTIN):
        return None, 0.0
    with frames_of(Path(source), fps, say) as (path, rate_hz):
        return read_source(path, reading, panorama=panorama), rate_hz


def _geometry(size: tuple[int, int], show: _Show, monitor: Display | None) -> FlatGeometry:
    from pipeline.foveation.geometry import FlatGeometry
    from stimuli.media.gaze_and_display import StatedViewing

    stated = StatedViewing(display=show.asked.display, fov_deg=show.asked.fov, monitor=monitor)
    looking = stated.of(size)
    say(looking.words)
    say_notes(looking.notes)
    assert isinstance(looking.geometry, FlatGeometry)
    return looking.geometry


class _Showing:
    """One run in an open window: keys, the mouse's drag, the overlay, the log."""

    def __init__(
        self,
        show: _Show,
        window: Window,
        screen: WindowScreen,
        renderer: FoveatingRenderer,
        corner: tuple[int, int],
        fps: float,
    ) -> None:
        self._show, self._asked, self._corner = show, show.asked, corner
        self._window, self._renderer = window, renderer
        self._screen, screen.overlay = screen, show.asked.overlay
        self._fps, self._seed, self._choices = fps, show.asked.seed, list(show.choices)
        self._turned = (0.0, 0.0)
        self._head: TrustedGaze | None = None
        self._faced: GazeSample | None = None  # the head's first pose, then the newest
        self._pose: GazeSample | None = None
        self._dragged: tuple[float, float] | None = None
        self._log: LiveLog | None = None
        self._last: DrawnFlip

    def run(self) -> None:
        """Show until it is ended; say the latency."""
        from study_app.gaze.lsl import open_head
        from study_app.gaze.open_source import open_gaze
        from study_app.gaze.saccades import SaccadeWatch, check_saccade_rate
        from study_app.gaze.source import TrackerContext
        from study_app.live.loop import LiveLoop

        window, screen = self._window, self._screen
        self._warm_up()
        window.show_cursor(self._asked.gaze == "mouse", stays=True)
        gaze = open_gaze(
            self._asked.gaze,
            TrackerContext(window.display, window.now, window.cursor_px, screen.refresh_hz),
        )
        try:
            if self._asked.head is not None:
                self._head = open_head(self._asked.head, window.now)
                say(f"head: {self._head.info().description}, {self._head.info().rate_hz:g} Hz")
            info = gaze.info()
            say_notes(info.notes)
            say(f"gaze: {info.source} {info.description}, {info.rate_hz:g} Hz")
            say(KEYS + ("; drag to look around" if self._renderer.source.panorama else ""))
            if self._show.change != "always":
                check_saccade_rate("--change during-saccades", info.rate_hz)
            loop = LiveLoop(
                screen, gaze, self._corner, polled=info.polled,
                watch=SaccadeWatch(math.radians(self._renderer.geometry.distance_px)),
                change=self._show.change,
            )  # fmt: skip
            with self._logging() as self._log:
                with suppress(KeyboardInterrupt):
                    self._loop(loop, gaze)
                self._end(loop, gaze.left_out)
        finally:
            gaze.close()
            if self._head is not None:
                self._head.close()

    def _end(self, loop: LiveLoop, left_out: int) -> None:
        """Print the measurements, and write them."""
        latency = loop.latency.summary()
        if self._log is not None:
            self._log.end(
                flips=loop.number, missed=loop.missed, left_out=left_out,
                latency=latency.model_dump(mode="json"),
            )  # fmt: skip
            say(f"wrote {self._asked.record}")
        say(f"{loop.number} frames, {loop.missed} refreshes missed")
        poses = self._head.left_out if self._head is not None else 0
        for count, what in ((left_out, "samples"), (poses, "poses of the head")):
            if count:
                say(f"note: {count} {what} had stamps that fell or lay ahead: left out")
        say(latency.words())

    def _loop(self, loop: LiveLoop, gaze: TrustedGaze) -> None:
        window, begin_s = self._window, self._window.now()
        told_s, marked_s, told = begin_s, begin_s, 0
        self._tell()
        while self._keys(loop):
            now_s = window.now()
            if self._asked.seconds is not None and now_s - begin_s >= self._asked.seconds:
                return
            if now_s - marked_s > _MARKED_S:
                gaze.mark("live")  # the tracker's clock is measured anew: clocks drift
                if self._head is not None:
                    self._head.mark("live")
                marked_s = now_s
            if self._screen.overlay and now_s - told_s > _TOLD_S and loop.number > told:
                self._tell(*self._figures(loop, (loop.number - told) / (now_s - told_s)))
                told_s, told = now_s, loop.number
            flip, picture = loop.step(self._renderer, lambda: self._view(loop), self._seed)
            self._last = flip
            if self._log is not None:
                head_s = math.nan if self._pose is None else self._pose.t_s
                self._log.flip(flip, picture, head_s)

    def _view(self, loop: LiveLoop) -> LiveView:
        """View that is shown: the frame whose time has come, and where mouse and head turned to."""
        from study_app.live.renderer import LiveView

        source = self._renderer.source
        if not source.panorama:
            shown = (loop.number + loop.missed) * self._fps / self._screen.refresh_hz
            return LiveView(int(shown + 1e-6) % len(source.frames))
        here = self._window.cursor_px() if self._window.held_down() else None
        if here is not None and self._dragged is not None:
            per_px = math.degrees(1) / self._renderer.geometry.distance_px
            across, down = (per_px * (b - a) for a, b in zip(here, self._dragged, strict=True))
            self._turned = _direction(self._turned[0] + across, self._turned[1] + down)
        self._dragged = here
        right, down = self._turned
        for pose in self._head.poll() if self._head is not None else ():
            if pose.valid:
                self._faced, self._pose = self._faced or pose, pose
        if self._faced is not None and self._pose is not None:
            right += self._pose.x_px - self._faced.x_px
            down += self._pose.y_px - self._faced.y_px
        right, down = (
            round(_STEPS_PER_DEG * angle) / _STEPS_PER_DEG for angle in _direction(right, down)
        )
        return LiveView(0, right, down)

    def _keys(self, loop: LiveLoop) -> bool:
        """Do what keys say; False: end."""
        if self._window.closing():
            return False
        for press in self._window.key_presses():
            if press.key == "escape":
                return False
            if press.key == "o":
                self._screen.overlay = not self._screen.overlay
            elif press.key in ("m", "l", "s"):
                self._change(press.key)
                loop.pause()
        return True

    def _change(self, key: str) -> None:
        if key == "m":
            self._choices.append(self._choices.pop(0))
        elif key == "l":
            self._choices = [_other_law(choice) for choice in self._choices]
        else:
            self._seed += 1
        if key != "s":
            self._renderer.choose(self._choices[0])
        self._renderer.prepare(self._seed)
        say(f"{self._choices[0].label}, seed {self._seed}")
        self._tell()
        if key != "s" and self._log is not None:
            self._log.choice(self._renderer.describe())

    def _warm_up(self) -> None:
        """Make what the first frame makes, before the clock counts."""
        from study_app.live.renderer import GazeState, LiveView

        middle = self._renderer.geometry.centre_px
        gaze_state = GazeState(middle, middle, self._seed)
        self._renderer.prepare(self._seed)
        for _ in range(2):
            self._renderer.hold(LiveView())
            self._screen.paint(self._renderer.draw(gaze_state), gaze_state)
            self._screen.flip()

    @contextmanager
    def _logging(self) -> Iterator[LiveLog | None]:
        """Open the log, where one is asked for, and close it whatever comes."""
        from pipeline.gl.context import describe
        from protocols.revision import code_revision, package_version
        from study_app.live.log import LiveLog
        from study_app.recorder import utc_now

        if self._asked.record is None:
            yield None
            return
        drawn_by, reading = describe(self._window.ctx), self._show.reading
        log = LiveLog(
            self._asked.record, every=self._asked.proof_every, at=utc_now(),
            source=self._show.source, reading=vars(reading),
            gaze=self._asked.gaze, display=self._window.display.model_dump(mode="json"),
            renderer=drawn_by.name, driver=drawn_by.version,
            revision=f"{package_version()} {code_revision()}", refresh_hz=self._screen.refresh_hz,
            change=self._show.change, head=self._asked.head,
        )  # fmt: skip
        with closing(log):
            log.choice(self._renderer.describe())
            yield log

    def _tell(self, *figures: str) -> None:
        """Have the overlay say what is shown, and figures where there are some."""
        self._screen.write([f"{self._choices[0].label}, seed {self._seed}", *figures, KEYS])

    def _figures(self, loop: LiveLoop, rate_hz: float) -> tuple[str, str]:
        last = self._last
        drawn_ms = 1e3 * (last.drawn_s - last.poll_s)
        return (
            f"{rate_hz:.1f} frames/s, drawn in {drawn_ms:.1f} ms, {loop.missed} missed",
            f"sample to flip {1e3 * last.age_s:.1f} ms, gaze {last.eye}",
        )


def _direction(right_deg: float, down_deg: float) -> tuple[float, float]:
    """Return a direction of a panorama: right from -180 to 180, down from -90 to 90."""
    return (right_deg + 180) % 360 - 180, min(90.0, max(-90.0, down_deg))


def _other_law(choice: Choice) -> Choice:
    if choice.name == "reference":
        return choice
    law = choice.parameters.get("law", _LAWS[0])
    after = _LAWS[(_LAWS.index(law) + 1) % len(_LAWS)] if law in _LAWS else _LAWS[0]
    kept = {key: one for key, one in choice.parameters.items() if key not in _POOLING}
    return replace(choice, parameters={**kept, "law": after})


def _verify(source: str, path: Path) -> None:
    """Draw a log again, and say what is not as it was."""
    from study_app.live.log import LiveChoice, LiveFlip, read_log

    log = read_log(path)
    say_notes(log.notes)
    first = next((line for line in log.lines if isinstance(line, LiveChoice)), None)
    if first is None:
        if any(isinstance(line, LiveFlip) for line in log.lines):
            raise StudyError(f"{path}: must say what drew its flips before the first one")
        say("0 flips: nothing was shown")
        return
    found = _redrawn(source, path, log, first.described)
    say(
        f"{found.flips} flips, {found.drawn} drawn again: {found.equal} bit-equal"
        + ("" if found.exactly else "; another renderer: within 1 of 255 is right")
    )
    if found.problems:
        raise StudyError(f"{path}: " + "\n".join(found.problems))
    if found.flips and not found.drawn:
        raise StudyError(f"{path}: must hold frames to draw again (none was kept)")


def _redrawn(source: str, path: Path, log: ReadLog, said: RendererDescription) -> RedrawResult:
    """Draw the flips of a log again, whose first choice says what was shown."""
    from pipeline.foveation.geometry import FlatGeometry
    from pipeline.gl.context import describe, lent_context
    from pipeline.named_classes import Choice
    from pipeline.pictures.colour_file import PictureReading
    from pipeline.pictures.size_limits import check_need
    from study_app.cli.pictures.live_renderer import FoveatingRenderer, draw_source
    from study_app.live.redraw import redraw

    check_need(path, "foveate", *said.size_px)
    geometry = FlatGeometry(*said.size_px, said.distance_px, said.centre_px)
    reading = PictureReading(**log.start.reading.model_dump())
    with lent_context() as ctx:
        here = describe(ctx)
        exactly = (here.name, here.version) == (log.start.renderer, log.start.driver)
        say(f"drawn by {log.start.renderer} (OpenGL {log.start.driver}), again by {here}")
        read = _read(source, reading, said.panorama)[0] or draw_source(source, geometry, ctx)
        if read.sha256 != said.source_sha256:
            raise StudyError(
                f"{source}: must be the source of {path}, {log.start.source!r} (its pixels are"
                " others)"
            )
        renderer = FoveatingRenderer(ctx, read, geometry, Choice(said.method, said.parameters))

        def renderer_of(line: LiveChoice) -> FoveatingRenderer:
            wanted = Choice(line.described.method, line.described.parameters)
            if wanted != renderer.choice:
                renderer.choose(wanted)
            return renderer

        try:
            return redraw(log, renderer_of, exactly=exactly)
        finally:
            renderer.release()
