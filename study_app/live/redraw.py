"""Frames drawn again from a log or a session: those that were kept must come out as shown."""

from __future__ import annotations

import base64
import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from pipeline.gl.texture import create_texture
from protocols.disk.hashing import sha256_json
from protocols.disk.whole_file import read_bytes
from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import Attempt, SessionResume, SessionStart
from protocols.latency import SaccadeTimes
from protocols.limits import check_within
from protocols.make_script import Scripts
from protocols.manifest import Manifest
from protocols.outside import reading
from protocols.script import Live, ScriptPhase, TrialScript
from protocols.study_file.schema import StudyProtocol
from study_app.desktop.draw import Painter
from study_app.desktop.strip import BLOCK_PX, PATCH_PX, patch_place
from study_app.gaze.saccades import SUPPRESSED_AFTER_S
from study_app.live.in_trials import described, live_entry
from study_app.live.log import GRID, FrameReadback, Grid, LiveChoice, LiveFlip, ReadLog
from study_app.live.renderer import STEPS_PER_PX, GazeState, LiveRenderer, LiveView, Studio
from study_app.paint import bitmaps_of, paint
from study_app.session_folders import SessionFolder

NEAR = 1
"""Steps of 255 by which another renderer, or another version of its driver, may be off."""
_GRID: TypeAdapter[str] = TypeAdapter(Grid)
_ROUNDED_PX = 0.006
"""Largest distance of a gaze from the one that was recorded, which has two decimals."""
Samples = Mapping[int, tuple[float, float]]
"""Gaze on the screen by its stamp, in microseconds of the session."""
Screens = Mapping[int, tuple[Path, NDArray[np.uint8]]]
"""Captures of the whole screen, (H, W, 3), by the number that their strips say."""


@dataclass
class RedrawResult:
    """Frames drawn again, and what came of it.

    Parameters
    ----------
    exactly : bool
        On the renderer that drew them first every bit must be the same; on another one pixels
        within `NEAR`.
    """

    exactly: bool
    flips: int = 0
    drawn: int = 0
    equal: int = 0
    """Bit for bit."""
    captures: dict[int, str] = field(default_factory=dict)
    """Problem with each capture that was compared, by its number; empty: none."""
    told: list[str] = field(default_factory=list)
    _pixels: FrameReadback = field(default_factory=FrameReadback)

    @property
    def problems(self) -> tuple[str, ...]:
        """Differences from what was recorded."""
        return tuple(self.told)

    def compare(
        self, number: int, gaze_state: GazeState, picture: moderngl.Texture, sha256: str, grid: str
    ) -> None:
        """Count a frame that was drawn again, and hold it to what was kept of its pixels."""
        found, some = self._pixels.of(picture)
        kept = np.frombuffer(base64.b64decode(grid), np.uint8).reshape(GRID, GRID, 3)
        off = int(np.abs(kept.astype(int) - some).max())
        self.drawn += 1
        self.equal += found == sha256
        if (self.exactly and found != sha256) or off > NEAR:
            self.told.append(f"flip {number}: {_must_show(gaze_state, off)}")


def draw_again(
    renderer: LiveRenderer, gaze_state: GazeState, view: LiveView | None = None
) -> moderngl.Texture:
    """Return the picture that a renderer draws for a gaze."""
    renderer.prepare(gaze_state.seed)
    renderer.hold(view or LiveView())
    return renderer.draw(gaze_state)


def redraw(
    log: ReadLog, renderer_of: Callable[[LiveChoice], LiveRenderer], *, exactly: bool
) -> RedrawResult:
    """Draw frames of a log again.

    Parameters
    ----------
    renderer_of : callable
        Gives what draws the flips after a choice.
    exactly : bool
        See `RedrawResult`.
    """
    result, renderer = RedrawResult(exactly), None
    for line in log.lines:
        if isinstance(line, LiveChoice):
            renderer = renderer_of(line)
            found, said = (one.model_dump() for one in (renderer.describe(), line.described))
            wrong = [key for key in said if found[key] != said[key]]
            if wrong:
                result.told.append(
                    f"flips from {result.flips} on: {', '.join(wrong)} must be as in the log (got"
                    f" {', '.join(str(found[key]) for key in wrong)})"
                )
            elif sha256_json(line.described) != line.sha256:
                result.told.append(f"flips from {result.flips} on: their choice must have its hash")
        if not isinstance(line, LiveFlip):
            continue
        result.flips += 1
        if line.pixels is None or line.grid is None or renderer is None:
            continue
        picture = draw_again(renderer, line.gaze_state, line.view)
        result.compare(line.n, line.gaze_state, picture, line.pixels, line.grid)
    return result


def _must_show(gaze_state: GazeState, off: int) -> str:
    return (
        f"must show what gaze {gaze_state.gaze_px[0]:g}, {gaze_state.gaze_px[1]:g} and seed"
        f" {gaze_state.seed} give (pixels differ, those that were kept by up to {off} of 255)"
    )


@dataclass
class TrialDrawer:
    """Draws the live frames of a study's sessions again.

    Parameters
    ----------
    pixels_of : callable
        Gives the pixels of a stimulus by name, (H, W, 4), held to its hash.
    studio : Studio
        In `ctx`.
    drawn_by : (renderer, version)
        Of `ctx`: frames of the same must come out bit for bit, of others within `NEAR`.
    """

    ctx: moderngl.Context
    study: StudyProtocol
    display: Display
    manifest: Manifest
    pixels_of: Callable[[str], NDArray[np.uint8]]
    studio: Studio
    drawn_by: tuple[str, str]

    def __post_init__(self) -> None:
        size = self.manifest.clips[0].width_px, self.manifest.clips[0].height_px
        self._painter = Painter(self.ctx, size, 0)
        self._target = create_texture(self.ctx, size, "rgba8")
        self._screen = self.ctx.framebuffer([self._target])
        self._methods = self.study.stimuli.live_methods()
        self._bitmaps = bitmaps_of(self.study, self.display)

    def release(self) -> None:
        """Free what was made, the studio's too."""
        self._painter.release()
        self._screen.release()
        self._target.release()
        self.studio.release()

    def redraw(self, session: SessionFolder, captured: Screens) -> RedrawResult:
        """Draw a session's frames again: those whose pixels were kept, or that were captured.

        Captures are of the last run of the program: strips count anew in each.

        Raises
        ------
        StudyError
            If the session was of other stimuli or another display, or a file cannot be read.
        """
        result, scripts = RedrawResult(exactly=False), None
        runs = sum(isinstance(e, SessionStart | SessionResume) for e in session.journal.events)
        for event in session.journal.events:
            runs -= isinstance(event, SessionStart | SessionResume)
            if isinstance(event, SessionStart | SessionResume):
                there = event.versions.get("renderer"), event.versions.get("opengl")
                result.exactly = there == self.drawn_by
            if isinstance(event, SessionStart):
                self._check(event)
                scripts = Scripts(self.study, self.display, event.language, self.manifest)
            if not isinstance(event, Attempt) or event.live is None or scripts is None:
                continue
            script = scripts.script(event.answers, event.role == "practice")
            gaze = event.gaze_file
            samples = {} if gaze is None else gaze_by_stamp(session.folder / gaze.file)
            file = event.flips_file
            flips, bad = ([], []) if file is None else read_flips(session.folder / file.file)
            result.flips += len(flips) + len(bad)
            result.told += bad
            for before, flip in pairwise((None, *flips)):
                assert flip is not None
                screens = {} if runs else captured
                self._frame((before, flip), event, script, samples, screens, result)
        seen = result.captures.items()
        result.told += [f"{captured[n][0]}: flip {n}: {why}" for n, why in seen if why]
        return result

    def _check(self, start: SessionStart) -> None:
        for what, here, there in (
            ("manifest of the stimuli", self.manifest.sha256, start.manifest_sha256),
            ("display", sha256_json(self.display), start.display_sha256),
            ("protocol", self.study.sha256, start.protocol_sha256),
        ):
            if here != there:
                raise StudyError(
                    f"the {what} must be the one that the session began with (hash {there[:12]},"
                    f" got {here[:12]}); name that one"
                )

    def _frame(
        self,
        flips: tuple[RecordedFlip | None, RecordedFlip],
        attempt: Attempt,
        script: TrialScript,
        samples: Samples,
        captured: Screens,
        result: RedrawResult,
    ) -> None:
        """Draw a flip again, as it was recorded after the one before it."""
        before, flip = flips
        gaze_state, number = flip.gaze_state, flip.number

        def tell(problem: str) -> None:
            result.told.append(f"flip {number}: {problem}")

        try:
            phase = next(one for one in script.phases if one.name == flip.phase)
            entry = live_entry(phase)
            if entry is None:
                raise ValueError(f"phase {phase.name} follows no gaze")
            name = attempt.stimuli[entry.stimulus].name
            live, source = self._methods[name], self.manifest.clip(name).frames_sha256[0]
        except (LookupError, StopIteration, StudyError, ValueError) as error:
            tell(f"must be a flip of this study ({error})")
            return
        said = described(live, source, entry, script.stimulus_px, self.display)
        if flip.drawn_sha256 != sha256_json(said):
            tell(f"{name}: source, place and parameters must be the study's")
        if gaze_state.seed != live.seed:
            tell(f"{name}: must have seed {live.seed} (got {gaze_state.seed})")
            return
        corner = entry.at[0] + script.size_px[0] // 2, entry.at[1] + script.size_px[1] // 2
        if flip.eye == "found" and samples and not _is_of(flip, corner, samples):
            tell(f"must have the gaze of the sample that is {flip.age_s:g} s old")
        moves = before and flip.phase == before.phase and flip.gaze_state != before.gaze_state
        if live.change != "always" and moves:
            windows = attempt.live.saccades if attempt.live is not None else ()
            if not _falls_into(windows, flip, self.display.refresh_hz):
                tell("must hold the gaze of the flip before (the eye was in no saccade)")
        if not flip.pixels_sha256 and number not in captured:
            return
        renderer = self.studio(entry.stimulus, said, self.pixels_of(name))
        picture = draw_again(renderer, gaze_state)
        if flip.pixels_sha256:
            result.compare(number, gaze_state, picture, flip.pixels_sha256, flip.grid)
        if number in captured:
            screen = self._whole(script, phase, entry, picture)
            off = _off(screen, captured[number][1])
            bad = off > (0 if result.exactly else NEAR)
            result.captures[number] = _must_show(gaze_state, off) if bad else ""

    def _whole(
        self, script: TrialScript, phase: ScriptPhase, entry: Live, picture: moderngl.Texture
    ) -> NDArray[np.uint8]:
        """Return the whole screen as the window shows it, (H, W, 3)."""
        self._screen.use()
        self._painter.clear()
        self._painter.image(picture, (0, 0))
        (width, height), data = self._screen.size, self._screen.read(alignment=1)
        frame = np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1]
        return paint(script, phase, {entry.stimulus: [frame]}, self._bitmaps)


@dataclass(frozen=True)
class RecordedFlip:
    """One line of a file of flips, of a flip that followed the gaze."""

    number: int
    phase: str
    t_s: float
    refreshes: int
    gaze_state: GazeState
    age_s: float
    """Age of the sample whose gaze is shown; not a number before the first one."""
    eye: str
    drawn_sha256: str
    pixels_sha256: str
    """Empty where pixels were not kept."""
    grid: str

    @classmethod
    def of(cls, row: Mapping[str, str]) -> RecordedFlip:
        """Read a line; raises LookupError, TypeError or ValueError where it is none."""
        kept = row["pixels_sha256"]
        gaze_x, gaze_y, field_x, field_y, t_s = (
            float(row[key]) for key in ("gaze_x_px", "gaze_y_px", "field_x_px", "field_y_px", "t_s")
        )
        if not all(map(math.isfinite, (gaze_x, gaze_y, field_x, field_y, t_s))):
            raise ValueError(f"gaze {gaze_x:g}, {gaze_y:g} at {t_s:g} s must be finite")
        return cls(
            number=int(row["flip"]),
            phase=row["phase"],
            t_s=t_s,
            refreshes=int(row["refreshes"]),
            gaze_state=GazeState((gaze_x, gaze_y), (field_x, field_y), int(row["seed"])),
            age_s=float(row["age_s"] or "nan"),
            eye=row["eye"],
            drawn_sha256=row["drawn_sha256"],
            pixels_sha256=kept,
            grid=_GRID.validate_python(row["grid"]) if kept else "",
        )


def read_flips(path: Path) -> tuple[list[RecordedFlip], list[str]]:
    """Read the flips that followed the gaze, and why others cannot be such.

    Raises
    ------
    StudyError
        If the file is no file of flips.
    """
    flips, bad = list[RecordedFlip](), list[str]()
    data = read_bytes(path, "the flips of a trial", "table")
    check_within("events", data.count(b"\n"), StudyError, path, "lines")
    with reading(path, "the flips of a trial, as they were recorded", StudyError):
        for row in csv.DictReader(io.StringIO(data.decode("ascii")), strict=True):
            if row.get("drawn_sha256"):
                try:
                    flips.append(RecordedFlip.of(row))
                except (LookupError, TypeError, ValueError) as error:
                    bad.append(f"flip {row.get('flip')}: must be a flip of this study ({error})")
    return flips, bad


def gaze_by_stamp(path: Path) -> Samples:
    """Return an attempt's gaze as it was recorded.

    Raises
    ------
    StudyError
        If the file is none.
    """
    data = read_bytes(path, "the gaze of a trial", "table")
    check_within("rows", data.count(b"\n"), StudyError, path, "lines")
    with reading(path, "the gaze of a trial, as it was recorded", StudyError):
        return {
            round(1e6 * float(row["t_s"])): (float(row["x_px"]), float(row["y_px"]))
            for row in csv.DictReader(io.StringIO(data.decode("ascii")), strict=True)
            if row["x_px"]
        }


def _is_of(flip: RecordedFlip, corner_px: tuple[int, int], samples: Samples) -> bool:
    """Return True if a gaze is that of the sample of its age."""
    if not math.isfinite(flip.age_s):
        return False
    stamp_us = round(1e6 * (flip.t_s - flip.age_s))
    near = [samples[us] for us in range(stamp_us - 2, stamp_us + 3) if us in samples]
    return any(
        all(
            abs(place - corner - gaze) <= 0.5 / STEPS_PER_PX + _ROUNDED_PX
            for place, corner, gaze in zip(sample, corner_px, flip.gaze_state.gaze_px, strict=True)
        )
        for sample in near
    )


def _falls_into(windows: Sequence[SaccadeTimes], flip: RecordedFlip, hz: float) -> bool:
    """Return True if a flip was due where the eye sees little, within half a refresh."""
    due_s = flip.t_s - max(0, flip.refreshes - 1) / hz
    return any(
        one.onset_s - 0.5 / hz <= due_s <= one.offset_s + SUPPRESSED_AFTER_S + 0.5 / hz
        for one in windows
    )


def _off(wanted: NDArray[np.uint8], found: NDArray[np.uint8]) -> int:
    """Return the largest difference of two screens, strips and patch aside; 255: in size."""
    if wanted.shape != found.shape:
        return 255
    off = np.abs(wanted.astype(int) - found).max(axis=2)
    off[:BLOCK_PX], off[-BLOCK_PX:] = 0, 0
    x, y = patch_place((wanted.shape[1], wanted.shape[0]))
    off[y : y + PATCH_PX, x : x + PATCH_PX] = 0
    return int(off.max())
