"""The log of a live picture: a line for each flip, enough to draw every frame again.

JSON lines, each with a checksum over itself and all lines before it
(`protocols.journal_file`). Lines reach the system one by one: whoever kills the program loses
the unfinished one at most.
"""

from __future__ import annotations

import base64
import errno
import hashlib
import math
import os
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import moderngl
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from pipeline.gl.texture import format_of
from protocols.disk.hashing import Json, canonical_json, sha256_json
from protocols.disk.whole_file import read_bytes
from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import UtcTime
from protocols.journal_file import due, first_link, line_sum, sealed_line
from protocols.latency import EyeState, LatencySummary
from protocols.limits import check_within
from protocols.recipes.base import Change
from protocols.study_file.problems import in_words
from protocols.units import Count, Model, Sha256, matching
from study_app.gaze.saccades import Saccade
from study_app.live.loop import DrawnFlip
from study_app.live.renderer import GazeState, LiveView, RendererDescription

FORMAT: Literal[1] = 1
EVERY, EVERY_S = 30, 0.5
"""Number of flips, and time, after which pixels are kept again: a minute has a hundred and more."""
GRID = 16
"""Along each edge, pixels of a frame that are kept."""


Grid = Annotated[
    str,
    matching(
        rf"^[A-Za-z0-9+/]{{{4 * GRID * GRID}}}$",
        f"{GRID} x {GRID} pixels in {4 * GRID * GRID} characters of base64",
    ),
]


class _Line(Model):
    chain: Sha256


class LoggedReading(Model):
    """Options by which the source's file was read."""

    background: float
    clip: bool
    stops: float
    encoded: bool
    exposed: bool


class LiveStart(_Line):
    """The first line."""

    kind: Literal["start"]
    format: Literal[1]
    at: UtcTime
    source: str
    """Name of the source, as it was given."""
    reading: LoggedReading
    gaze: str
    display: Display
    renderer: str
    driver: str
    revision: str
    refresh_hz: float
    change: Change = "always"
    """Times at which the gaze that is drawn for may change."""
    head: str | None = None
    """Source of the turns of a panorama, beside the mouse."""


class LiveChoice(_Line):
    """Method that draws the flips from here on."""

    kind: Literal["choice"]
    described: RendererDescription
    sha256: Sha256
    """Hash of that."""


class LiveFlip(_Line):
    """One frame."""

    kind: Literal["flip"]
    n: Count
    t_s: float
    poll_s: float
    drawn_s: float
    refreshes: Count
    gaze_px: tuple[float, float]
    field_px: tuple[float, float]
    seed: Count
    frame: Count
    turned_deg: tuple[float, float]
    eye: EyeState
    age_s: float | None
    """Time from the sample whose gaze is shown to the flip; null before the first one."""
    head_age_s: float | None = None
    """Time from the pose that turned the view to the flip; null: none did."""
    suppressed: bool | None = None
    """True if the eye saw little then, as far as gaze had come; null: nobody watched."""
    pixels: Sha256 | None = None
    """SHA-256 of the whole frame as it was drawn, of a few flips."""
    grid: Grid | None = None
    """Base64 of `GRID` x `GRID` of its pixels, red, green and blue of 8 bits, from the upper left.
    """

    @property
    def view(self) -> LiveView:
        """View that was drawn."""
        return LiveView(self.frame, *self.turned_deg)

    @property
    def gaze_state(self) -> GazeState:
        """Gaze and seed that it was drawn for."""
        return GazeState(self.gaze_px, self.field_px, self.seed)


class LiveSaccade(_Line):
    """A saccade that was over at the poll of the next flip; times are stamps of samples."""

    kind: Literal["saccade"]
    onset_s: float
    offset_s: float

    def suppresses(self, flip_s: float) -> bool:
        """True if a flip fell where the eye sees little."""
        return Saccade(self.onset_s, self.offset_s, over=True).suppresses(flip_s)


class LiveEnd(_Line):
    """The last line of a log that was closed."""

    kind: Literal["end"]
    flips: Count
    missed: Count
    left_out: Count
    """Samples that could not be judged: stamps that fell, lay ahead, or were none."""
    latency: LatencySummary


LiveLine: TypeAlias = Annotated[
    LiveStart | LiveChoice | LiveSaccade | LiveFlip | LiveEnd, Field(discriminator="kind")
]
_LINE: TypeAdapter[LiveLine] = TypeAdapter(LiveLine)


class FrameReadback:
    """Reads frames back into memory that is taken once, and says what is kept of them."""

    def __init__(self) -> None:
        self._room: dict[moderngl.Texture, NDArray[Any]] = {}

    def of(self, picture: moderngl.Texture) -> tuple[str, NDArray[np.uint8]]:
        """Return the SHA-256 of a picture, and its grid (GRID, GRID, 3)."""
        room = self._room.get(picture)
        if room is None:
            kind = format_of(picture).array_dtype
            room = np.empty((picture.height, picture.width, 4), kind)
            self._room = {picture: room}
        picture.read_into(room, alignment=1)
        rows, columns = (
            (2 * np.arange(GRID) + 1) * edge // (2 * GRID)
            for edge in (picture.height, picture.width)
        )
        some = room[rows[:, None], columns, :3]
        if some.dtype != np.uint8:
            some = np.rint(255 * some)
        return hashlib.sha256(room.data).hexdigest(), some.astype(np.uint8)


class LiveLog:
    """A log that is being written; never over another.

    Raises
    ------
    OSError
        If there is one, or the disk refuses a line: all before it are whole.
    """

    def __init__(self, path: Path, *, every: int | None = None, **start: Json) -> None:
        self._chain, self._every, self._due_s = first_link(b""), every, -math.inf
        self._pixels = FrameReadback()
        self.next_kept = 0
        """The first flip from which on pixels are kept again."""
        with ExitStack() as opening:
            self._file = opening.enter_context(path.open("xb", buffering=0))
            self._write({"kind": "start", "format": FORMAT, **start})
            opening.pop_all()

    def choice(self, described: RendererDescription) -> None:
        """Write what draws from here on; the next frame's pixels are kept."""
        plain = described.model_dump(mode="json")
        self._write({"kind": "choice", "described": plain, "sha256": sha256_json(described)})
        self.next_kept = 0

    def flip(self, flip: DrawnFlip, picture: moderngl.Texture, head_s: float = math.nan) -> None:
        """Write the saccades that ended, the flip, and of some what their pixels are.

        These are each `every`th, or by default each `EVERY`th and after `EVERY_S`.

        `head_s` is the stamp of the head's pose that turned the view.
        """
        for one in flip.saccades:
            self._write({"kind": "saccade", "onset_s": one.onset_s, "offset_s": one.offset_s})
        pixels = grid = None
        late = self._every is None and flip.t_s >= self._due_s
        if flip.number >= self.next_kept or late:
            self.next_kept, self._due_s = flip.number + (self._every or EVERY), flip.t_s + EVERY_S
            pixels, some = self._pixels.of(picture)
            grid = base64.b64encode(some.tobytes()).decode()
        self._write(
            {
                "kind": "flip",
                "n": flip.number,
                "t_s": flip.t_s,
                "poll_s": flip.poll_s,
                "drawn_s": flip.drawn_s,
                "refreshes": flip.refreshes,
                "gaze_px": list(flip.gaze_state.gaze_px),
                "field_px": list(flip.gaze_state.field_px),
                "seed": flip.gaze_state.seed,
                "frame": flip.view.frame,
                "turned_deg": [flip.view.right_deg, flip.view.down_deg],
                "eye": flip.eye,
                "age_s": None if math.isnan(flip.age_s) else flip.age_s,
                "head_age_s": None if math.isnan(head_s) else flip.t_s - head_s,
                "suppressed": flip.suppressed,
                "pixels": pixels,
                "grid": grid,
            }
        )

    def end(self, **end: Json) -> None:
        """Write the last line."""
        self._write({"kind": "end", **end})

    def close(self) -> None:
        """Close the file; all lines are whole."""
        self._file.close()

    def _write(self, line: Mapping[str, Json]) -> None:
        bare = canonical_json({**line, "chain": None}) + b"\n"
        chain, sealed = sealed_line(bare, self._chain)
        if self._file.write(sealed) < len(sealed):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._chain = chain


@dataclass(frozen=True)
class ReadLog:
    """A log as it stands on the disk."""

    start: LiveStart
    lines: tuple[LiveLine, ...]
    notes: tuple[str, ...]


def read_log(path: Path) -> ReadLog:
    """Read a log; an unfinished last line, of a killed program, is left out and noted.

    Raises
    ------
    StudyError
        If it is none, or a line is not as it was written.
    """
    data = read_bytes(path, "the log", "table")
    check_within("events", data.count(b"\n"), StudyError, path, "lines")
    *whole, torn = data.split(b"\n")
    chain, lines = first_link(b""), list[LiveLine]()
    for number, text in enumerate(whole, start=1):
        try:
            line = _LINE.validate_json(text)
        except ValidationError as error:
            found = error.errors()[0]
            where = ".".join(str(part) for part in found["loc"]) or "the line"
            raise StudyError(
                f"{path}: line {number}: must be a line of a live log ({where}: {in_words(found)});"
                " name a file that 'metamerlab live --record' wrote"
            ) from None
        if line_sum(text) != (chain := due(text, chain)):
            raise StudyError(
                f"{path}: line {number}: must be as it was written (its checksum is another); this"
                " line or one before it was changed"
            )
        lines.append(line)
    if not lines:
        raise StudyError(
            f"{path}: must hold lines of a live log (it holds none: the program was killed before"
            " its first line was whole); record another one"
        )
    if not isinstance(start := lines[0], LiveStart):
        raise StudyError(f"{path}: must begin with the first line of a live log (it does not)")
    notes = []
    if torn:
        notes.append("the last line is unfinished: the program was killed while writing it")
    if not isinstance(lines[-1], LiveEnd):
        notes.append("the log was not closed: the program was killed")
    return ReadLog(start, tuple(lines), tuple(notes))
