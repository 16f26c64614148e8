"""Recorded gaze: EyeLink ASC files and CSV, as this program and others write them."""

from __future__ import annotations

import csv
import math
import re
from array import array
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from protocols.disk.whole_file import decoded_text, read_bytes, separator_of
from protocols.errors import StudyError
from protocols.limits import check_rows, gunzipped
from protocols.outside import lines_of, reading
from protocols.plausible_numbers import RANGES

Eye = Literal["left", "right"]
_STAMPS = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6, "t_ns": 1e-9}
"""Columns of stamps, and how many seconds one is."""
Box = tuple[float, float, float, float]
"""Coordinates of the left, top, right and bottom pixel."""

_SCREEN = re.compile(
    r"^MSG\s+\S+\s+(DISPLAY_COORDS|GAZE_COORDS)\s*=?\s*"
    r"(-?[\d.]+)\s+(-?[\d.]+)\s+(-?[\d.]+)\s+(-?[\d.]+)"
)
_RATE = re.compile(r"^SAMPLES\s.*\bRATE\s+([\d.]+)")
_BLINK = re.compile(r"^EBLINK\s+[LR]\s+(\d+)\s+(\d+)")
FARTHEST_PX = 1e6
"""No screen is as wide; what lies farther away is no gaze."""
STAND_INS = (0.0, -1.0, -9999.0, 9999.0, -32768.0, 32767.0, 65535.0)
"""Numbers that trackers write into both coordinates for a lost eye."""
NEAR_PX = 10.0
"""Others lie this near where an eye was there."""
MANY = 1e-3
"""Share of the samples from which a number may stand for something."""
NO_DATA = -32768.0
"""Number that EyeLink writes for one that it does not have, where it is not a dot."""
WORSE_SHARE = 0.1
"""Share of samples: an eye that is lost so much more often than the other is not replayed."""
CORNER_PX = 60.0
"""Gaze that never leaves so small a corner is given in degrees, or in shares of the screen."""


@dataclass(frozen=True)
class Recording:
    """One eye's samples, with the stamps the tracker gave."""

    path: Path
    raw_t: NDArray[np.float64]
    """The tracker's stamps, in its own unit."""
    t_s: NDArray[np.float64]
    """Seconds since the first sample."""
    x_px: NDArray[np.float64]
    """nan where lost."""
    y_px: NDArray[np.float64]
    rate_hz: float
    screen_px: tuple[int, int] | None
    """Width and height that the coordinates belong to, where the file says so."""
    from_zero: bool
    """The file's own coordinates begin at 0; from elsewhere they were shifted."""
    blinks_s: NDArray[np.float64]
    """Start and end of the blinks the tracker itself found, shape (N, 2), seconds since the first
    sample."""
    notes: tuple[str, ...] = ()

    def on_screen(self, width_px: int, height_px: int) -> Recording:
        """Return the recording as one of this screen, with what had to be assumed as notes.

        Raises
        ------
        StudyError
            If it belongs to another screen, or its gaze is not in pixels of this one.
        """
        said, notes = self.screen_px, self.notes
        if said == (width_px + 1, height_px + 1) and self.from_zero:
            notes += (
                f"{self.path.name}: its coordinates end at {width_px} and {height_px}, one more"
                f" than the last pixel: taken as the size of the screen, {width_px}x{height_px}",
            )
        elif said is not None and said != (width_px, height_px):
            raise StudyError(
                f"{self.path}: must be recorded on a screen of {width_px}x{height_px} pixels, as"
                f" the display has (got {said[0]}x{said[1]}); name the display of the recording"
                " with --display"
            )
        found = np.isfinite(self.x_px) & np.isfinite(self.y_px)
        if not found.any():
            raise StudyError(f"{self.path}: must hold gaze (the eye was lost in every sample)")
        x, y = self.x_px[found], self.y_px[found]
        inside = (x >= 0) & (x <= width_px) & (y >= 0) & (y <= height_px)
        corner_px = min(CORNER_PX, 0.1 * min(width_px, height_px))
        if inside.mean() < 0.5 or np.abs([x, y]).max() < corner_px:
            raise StudyError(
                f"{self.path}: gaze must be in pixels from the upper left corner of the screen of"
                f" {width_px}x{height_px} (got x from {x.min():g} to {x.max():g}, y from"
                f" {y.min():g} to {y.max():g}); turn degrees, shares of the screen and pixels from"
                " its middle into these"
            )
        return replace(self, notes=notes)


def load_recording(
    path: Path, eye: Eye | None = None, unknown: tuple[float, ...] | None = None
) -> Recording:
    """Read ``.asc`` or ``.csv``, also compressed (``.gz``).

    A CSV needs columns ``t_s`` (or ``t_ms``, ``t_us``, ``t_ns``), ``x_px`` and ``y_px``; an empty
    field or `nan` is a lost eye. An ASC file with both eyes gives `eye`; left out, the left one,
    unless it was lost far more often than the right one. Its coordinates are those that its header
    names.

    The eye is lost, too, where both coordinates are a number of `unknown`.

    Raises
    ------
    StudyError
        If the file cannot be read, names its columns otherwise, or has no samples; or if a number
        may stand for a lost eye and `unknown` is None: nobody has said.
    """
    data = read_bytes(path, "the gaze recording")
    if path.suffix == ".gz":
        data = gunzipped(data, path)
    notes: list[str] = []
    text = decoded_text(data, notes)
    check_rows(path, text)
    name = path.name.removesuffix(".gz")
    with reading(path, "a whole recording of gaze", StudyError):
        if name.endswith(".asc"):
            found = _read_asc(path, text, eye, unknown)
            return replace(found, notes=(*notes, *found.notes))
        if name.endswith(".csv"):
            if eye is not None:
                raise StudyError(f"{path}: a .csv file holds one eye; leave ',eye={eye}' away")
            return replace(_read_csv(path, text, unknown), notes=tuple(notes))
    raise StudyError(f"{path}: must be an EyeLink .asc or a .csv file (or .gz of one)")


def _read_asc(
    path: Path, text: str, eye: Eye | None, unknown: tuple[float, ...] | None
) -> Recording:
    samples = array("d")
    blinks = array("d")
    rate_hz = 0.0
    boxes: dict[str, Box] = {}
    recording = False
    eyes: list[str] = []
    every: set[str] = set()
    for line in text.splitlines():
        if line[:1].isdigit():
            if recording:
                samples.extend(_asc_sample(line, len(eyes)))
        elif line.startswith(("START", "SAMPLES")):
            recording = True
            eyes = [word for word in ("LEFT", "RIGHT") if word in line.split()]
            every.update(eyes)
            _check_kind(path, line)
            if match := _RATE.match(line):
                rate_hz = float(match[1])
        elif line.startswith("END"):
            recording = False
        elif match := _BLINK.match(line):
            blinks.extend((float(match[1]), float(match[2])))
        elif match := _SCREEN.match(line):
            _take_box(path, boxes, match)
    if not samples:
        raise StudyError(f"{path}: must hold samples between START and END (found none)")
    stamps, *places = np.array(samples).reshape(-1, 5).T
    t_s = (stamps - stamps[0]) / 1e3
    said = boxes.get("GAZE_COORDS", boxes.get("DISPLAY_COORDS"))
    screen = None if said is None else (_size(said[0], said[2]), _size(said[1], said[3]))
    x, y, notes = _one_eye(path, places, every, eye)
    x, y = _found(path, x, y, unknown)
    if said is not None:
        x, y = (x - said[0]) * _sense(said[0], said[2]), (y - said[1]) * _sense(said[1], said[3])
    if not np.isfinite(stamps).all() or (np.diff(stamps) < 0).any():
        raise StudyError(f"{path}: stamps of samples must be finite numbers that do not fall")
    pairs = np.array(blinks).reshape(-1, 2)
    if not (pairs[:, 0] <= pairs[:, 1]).all():
        raise StudyError(f"{path}: a blink (EBLINK) must not end before it begins")
    blinks_s = (pairs - stamps[0]) / 1e3
    rate_hz = rate_hz or _median_rate(path, t_s)
    from_zero = said is not None and said[:2] == (0.0, 0.0)
    return Recording(path, stamps, t_s, x, y, rate_hz, screen, from_zero, blinks_s, notes)


def _take_box(path: Path, boxes: dict[str, Box], match: re.Match[str]) -> None:
    """Keep the coordinates of a line; those of gaze may not change."""
    left, top, right, bottom = map(float, match.groups()[1:])
    box = (left, top, right, bottom)
    if match[1] == "GAZE_COORDS" and boxes.setdefault(match[1], box) != box:
        first, then = (" ".join(f"{v:g}" for v in one) for one in (boxes[match[1]], box))
        raise StudyError(
            f"{path}: must keep its coordinates (GAZE_COORDS {first}, later {then}); cut the file,"
            " and replay one part"
        )
    boxes[match[1]] = box


def _asc_sample(line: str, eyes: int) -> tuple[float, float, float, float, float]:
    """Return stamp, gaze of the left, and of the right eye: of the one where there is one."""
    fields = line.split()

    def number(index: int) -> float:
        try:
            value = float(fields[index])
        except (ValueError, IndexError):  # "." is a lost eye
            return math.nan
        return math.nan if value == NO_DATA else value

    right = 4 if eyes == 2 else 1
    return number(0), number(1), number(2), number(right), number(right + 1)


def _check_kind(path: Path, line: str) -> None:
    """Samples may be of gaze, of angles of the head (HREF), or raw places of the pupil."""
    kind = line.split()[1:2]
    if line.startswith("SAMPLES") and kind != ["GAZE"]:
        raise StudyError(
            f"{path}: samples must be gaze in pixels of the screen (SAMPLES GAZE; got"
            f" {' '.join(['SAMPLES', *kind])}); convert the .edf file again, with 'edf2asc -sg'"
        )


def _one_eye(
    path: Path, places: list[NDArray[np.float64]], eyes: set[str], eye: Eye | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[str, ...]]:
    """Return gaze (x, y) of the wanted eye, or of the one that was found; and what to note."""
    if eye is not None and eyes and eye.upper() not in eyes:
        raise StudyError(
            f"{path}: must hold the {eye} eye (has the {' and '.join(eyes).lower()} one); leave"
            f" ',eye={eye}' away"
        )
    lost = [float(np.mean(~np.isfinite(x + y))) for x, y in (places[:2], places[2:])]
    notes: tuple[str, ...] = () if eye is None else (f"{path.name}: its {eye} eye is replayed",)
    if eye is None and lost[0] > lost[1] + WORSE_SHARE:
        eye = "right"
        notes = (
            f"{path.name}: the left eye was lost in {100 * lost[0]:.0f} % of samples, the right one"
            f" in {100 * lost[1]:.0f} %: the right one is replayed (',eye=left' after the file's"
            " name takes the other)",
        )
    x, y = places[2:] if eye == "right" else places[:2]
    return x, y, notes


def _size(first: float, last: float) -> int:
    return round(abs(last - first)) + 1


def _sense(first: float, last: float) -> float:
    """Return -1 where coordinates fall to the right or downwards, else 1."""
    return -1.0 if last < first else 1.0


def _read_csv(path: Path, text: str, unknown: tuple[float, ...] | None) -> Recording:
    separator = separator_of(text)
    reader = csv.reader(lines_of(text), delimiter=separator)
    names = next(reader, [])
    unit = next((unit for unit in _STAMPS if unit in names), None)
    missing = [name for name in ("x_px", "y_px") if name not in names]
    if unit is None or missing:
        raise StudyError(
            f"{path}: must have columns t_s (or t_ms, t_us, t_ns), x_px and y_px"
            f" (got {', '.join(names)})"
        )
    places = [names.index(name) for name in (unit, "x_px", "y_px")]
    samples = array("d")
    for row in reader:
        try:
            cells = [row[place] or "nan" for place in places] if row else []
            points = cells if separator == "," else [cell.replace(",", ".") for cell in cells]
            samples.extend(map(float, points))
        except (IndexError, ValueError):
            raise StudyError(
                f"{path}: line {reader.line_num}: must hold numbers (got {','.join(row)[:80]!r})"
            ) from None
    if len(samples) < 2 * len(places):
        raise StudyError(
            f"{path}: must hold at least two samples (got {len(samples) // len(places)})"
        )
    stamps, x, y = np.array(samples).reshape(-1, 3).T
    t_s = (stamps - stamps[0]) * _STAMPS[unit]
    x, y = _found(path, x, y, unknown)
    if not np.isfinite(t_s).all():
        line = int(np.argmin(np.isfinite(t_s))) + 2
        raise StudyError(f"{path}: line {line}: {unit} must be a finite number")
    if (np.diff(t_s) < 0).any():
        line = int(np.argmax(np.diff(t_s) < 0)) + 3
        raise StudyError(
            f"{path}: line {line}: {unit} must not fall from line to line (got"
            f" {stamps[line - 2]:g} after {stamps[line - 3]:g}); sort the samples by time"
        )
    rate_hz = _median_rate(path, t_s)
    _check_rate(path, unit, rate_hz)
    return Recording(path, stamps, t_s, x, y, rate_hz, None, True, np.empty((0, 2)))


def _check_rate(path: Path, unit: str, rate_hz: float) -> None:
    """Refuse stamps in another unit than their column says: no tracker has such a rate."""
    least, most = RANGES["tracker_hz"]
    if least <= rate_hz <= most:
        return
    meant = [
        f"{name} ({in_it_hz:.6g} Hz)"
        for name, one in _STAMPS.items()
        if least <= (in_it_hz := rate_hz * _STAMPS[unit] / one) <= most
    ]
    raise StudyError(
        f"{path}: {unit} must give a tracker's rate, {least:g} to {most:g} Hz (got {rate_hz:.4g}"
        f" Hz); if the stamps are in another unit, name the column"
        f" {' or '.join(meant) or 'by it, t_s, t_ms, t_us or t_ns'}"
    )


def _found(
    path: Path,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    unknown: tuple[float, ...] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return gaze, not a number where it is lost; it is never farther away than any screen.

    Asked about is one number in both coordinates that trackers write for a lost eye, in as many
    samples as of a depth's pixels (`pipeline.pictures.depth_and_flow`), five or more, and far from
    all others: an eye that rests there drifts.
    """
    lost = (x == y) & np.isin(x, unknown or ())
    x, y = np.where(lost, np.nan, x), np.where(lost, np.nan, y)
    held, counts = np.unique(x[x == y], return_counts=True)
    stands = np.isin(held, STAND_INS) | (np.abs(held) > FARTHEST_PX)
    for place in np.flatnonzero(stands & (counts >= max(5, MANY * x.size))):
        apart = np.hypot(x - held[place], y - held[place])
        if unknown is not None or not np.nanmin(apart, initial=np.inf, where=apart > 0) > NEAR_PX:
            continue
        value, count = f"{held[place]:.12g}", counts[place]
        raise StudyError(
            f"{path}: each sample must be known or said to be unknown ({count} samples hold"
            f" ({value}, {value}): trackers write it where they lost the eye); if it stands for"
            f" unknown, say so by replay:{path},unknown={value}; if it is gaze, by unknown=none"
        )
    farthest = np.nanmax(np.abs([x, y]), initial=0.0)
    if farthest > FARTHEST_PX:
        raise StudyError(
            f"{path}: gaze must be in pixels of the screen, or empty where the eye was lost"
            f" (got {farthest:g})"
        )
    return x, y


def _median_rate(path: Path, t_s: NDArray[np.float64]) -> float:
    step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
    if step_s <= 0:
        raise StudyError(f"{path}: must hold samples at different times (more than half share one)")
    return 1.0 / step_s
