"""Recorded gaze: EyeLink ASC files and CSV, as this program and others write them."""

from __future__ import annotations

import csv
import math
import re
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.limits import check_rows, unpacked
from protocols.load import read_bytes
from protocols.outside import lines_of, reading

_SCREEN = re.compile(
    r"^MSG\s+\S+\s+(?:DISPLAY_COORDS|GAZE_COORDS)\s*=?\s*"
    r"(-?[\d.]+)\s+(-?[\d.]+)\s+(-?[\d.]+)\s+(-?[\d.]+)"
)
_RATE = re.compile(r"^SAMPLES\s.*\bRATE\s+([\d.]+)")
_BLINK = re.compile(r"^EBLINK\s+[LR]\s+(\d+)\s+(\d+)")
FARTHEST_PX = 1e6
"""No screen is as wide; what lies farther away is no gaze."""


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
    blinks_s: tuple[tuple[float, float], ...]
    """(start, end) of the blinks the tracker itself found, seconds since the first sample."""


def load_recording(path: Path) -> Recording:
    """Read ``.asc`` or ``.csv``, also compressed (``.gz``).

    A CSV needs columns ``t_s`` (or ``t_ms``), ``x_px`` and ``y_px``; an empty field or `nan`
    is a lost eye. An ASC file with both eyes gives the left one.

    Raises
    ------
    StudyError
        If the file cannot be read, names its columns otherwise, or has no samples.
    """
    data = read_bytes(path, "the gaze recording")
    if path.suffix == ".gz":
        data = unpacked(data, path)
    text = data.decode("utf-8", errors="replace")
    check_rows(path, text)
    name = path.name.removesuffix(".gz")
    with reading(path, "a whole recording of gaze", StudyError):
        if name.endswith(".asc"):
            return _read_asc(path, text)
        if name.endswith(".csv"):
            return _read_csv(path, text)
    raise StudyError(f"{path}: must be an EyeLink .asc or a .csv file (or .gz of one)")


def _read_asc(path: Path, text: str) -> Recording:
    samples = array("d")
    blinks: list[tuple[float, float]] = []
    rate_hz, screen = 0.0, None
    recording = False
    for line in text.splitlines():
        if line[:1].isdigit():
            if recording:
                samples.extend(_asc_sample(line))
        elif line.startswith("START"):
            recording = True
        elif line.startswith("END"):
            recording = False
        elif match := _RATE.match(line):
            rate_hz = float(match[1])
        elif match := _BLINK.match(line):
            blinks.append((float(match[1]), float(match[2])))
        elif match := _SCREEN.match(line):
            left, top, right, bottom = map(float, match.groups())
            screen = (round(right - left) + 1, round(bottom - top) + 1)
    if not samples:
        raise StudyError(f"{path}: must hold samples between START and END (found none)")
    stamps, x, y = np.array(samples).reshape(-1, 3).T
    t_s = (stamps - stamps[0]) / 1e3
    _check_places(path, x, y)
    if not np.isfinite(stamps).all() or (np.diff(stamps) < 0).any():
        raise StudyError(f"{path}: stamps of samples must be finite numbers that do not fall")
    if any(not a <= b for a, b in blinks):
        raise StudyError(f"{path}: a blink (EBLINK) must not end before it begins")
    blinks_s = tuple(((a - stamps[0]) / 1e3, (b - stamps[0]) / 1e3) for a, b in blinks)
    return Recording(path, stamps, t_s, x, y, rate_hz or _median_rate(path, t_s), screen, blinks_s)


def _asc_sample(line: str) -> tuple[float, float, float]:
    fields = line.split()

    def number(index: int) -> float:
        try:
            return float(fields[index])
        except (ValueError, IndexError):  # "." is a lost eye
            return math.nan

    return number(0), number(1), number(2)


def _read_csv(path: Path, text: str) -> Recording:
    reader = csv.reader(lines_of(text))
    names = next(reader, [])
    unit = next((unit for unit in ("t_s", "t_ms") if unit in names), None)
    missing = [name for name in ("x_px", "y_px") if name not in names]
    if unit is None or missing:
        raise StudyError(
            f"{path}: must have columns t_s (or t_ms), x_px and y_px (got {', '.join(names)})"
        )
    places = [names.index(name) for name in (unit, "x_px", "y_px")]
    samples = array("d")
    for row in reader:
        try:
            samples.extend([float(row[place] or "nan") for place in places] if row else [])
        except (IndexError, ValueError):
            raise StudyError(
                f"{path}: line {reader.line_num}: must hold numbers (got {','.join(row)[:80]!r})"
            ) from None
    if len(samples) < 2 * len(places):
        raise StudyError(
            f"{path}: must hold at least two samples (got {len(samples) // len(places)})"
        )
    stamps, x, y = np.array(samples).reshape(-1, 3).T
    t_s = (stamps - stamps[0]) * (1.0 if unit == "t_s" else 1e-3)
    _check_places(path, x, y)
    if not np.isfinite(t_s).all():
        line = int(np.argmin(np.isfinite(t_s))) + 2
        raise StudyError(f"{path}: line {line}: {unit} must be a finite number")
    if (np.diff(t_s) < 0).any():
        line = int(np.argmax(np.diff(t_s) < 0)) + 3
        raise StudyError(
            f"{path}: line {line}: {unit} must not fall from line to line (got"
            f" {stamps[line - 2]:g} after {stamps[line - 3]:g}); sort the samples by time"
        )
    return Recording(path, stamps, t_s, x, y, _median_rate(path, t_s), None, ())


def _check_places(path: Path, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    """Gaze is somewhere or lost (not a number), but never farther away than any screen."""
    farthest = np.nanmax(np.abs([x, y]), initial=0.0)
    if farthest > FARTHEST_PX:
        raise StudyError(
            f"{path}: gaze must be in pixels of the screen, or empty where the eye was lost"
            f" (got {farthest:g})"
        )


def _median_rate(path: Path, t_s: NDArray[np.float64]) -> float:
    step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
    if step_s <= 0:
        raise StudyError(f"{path}: must hold samples at different times (more than half share one)")
    return 1.0 / step_s
