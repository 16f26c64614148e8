"""Gamma, peak and black from a photometer's readings of grey patches, kept in the display file."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from protocols.disk.read_file import decode_utf8, read_bytes
from protocols.disk.whole_file import whole_path
from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import load_toml

LEVELS = (0, 32, 64, 96, 128, 160, 192, 224, 255)
"""Encoded greys that are shown, 0 to 255."""
PATCH_SHARE = 0.5
"""Edge of the patch as a share of the screen's height."""


@dataclass(frozen=True)
class LuminanceFit:
    """L = black + (peak - black) (level / 255)^gamma."""

    peak_cd_m2: float
    black_cd_m2: float
    gamma: float
    worst_share: float
    """Largest distance of a reading from the fit, as a share of the peak."""


def fit_gamma(readings: Mapping[int, float]) -> LuminanceFit:
    """Fit the power law between the readings at levels 0 and 255, which are taken as they are.

    Parameters
    ----------
    readings : mapping
        Level, 0 to 255 -> cd/m2. Levels 0 and 255 and at least two others are needed.

    Raises
    ------
    StudyError
        If levels are missing, or the readings do not rise from black to peak.
    """
    inner = sorted(level for level in readings if 0 < level < 255)
    if 0 not in readings or 255 not in readings or len(inner) < 2:
        raise StudyError(
            "luminance: readings at 0, at 255 and at two or more levels between are needed"
            f" (got {', '.join(map(str, sorted(readings)))})"
        )
    black, peak = readings[0], readings[255]
    values = [readings[level] for level in sorted(readings)]
    if black < 0 or any(late < early for early, late in itertools.pairwise(values)):
        raise StudyError(
            "luminance: readings must rise with the level and be at least 0 (got"
            f" {', '.join(f'{readings[level]:g}' for level in sorted(readings))}); read again"
        )
    if peak <= black:
        raise StudyError("luminance: the peak must be brighter than black; read again")
    levels = np.array(inner) / 255
    shares = (np.array([readings[level] for level in inner]) - black) / (peak - black)

    def misfit(gamma: float) -> float:
        return float(np.square(levels**gamma - shares).sum())

    from scipy.optimize import minimize_scalar  # slow to import, and sessions need none of it

    gamma = float(minimize_scalar(misfit, bounds=(0.2, 6.0), method="bounded").x)
    worst = float(np.abs(levels**gamma - shares).max())
    return LuminanceFit(peak, black, gamma, worst * (peak - black) / peak)


def store_luminance(path: Path, fit: LuminanceFit) -> Display:
    """Write a fit into a display file; everything else in it, comments too, stays.

    Raises
    ------
    StudyError
        If the file cannot be read or written, or is no display any more afterwards.
    """
    text = decode_utf8(read_bytes(path, "the display file"), path)
    for key, value in (
        ("peak_cd_m2", fit.peak_cd_m2),
        ("black_cd_m2", fit.black_cd_m2),
        ("gamma", fit.gamma),
    ):
        line = f"{key} = {float(f'{value:.6g}')!r}"
        pattern = re.compile(rf"^{key}\s*=[^\n#]*?(?=\s*(#|$))", re.MULTILINE)
        if pattern.search(text):
            text = pattern.sub(line, text, count=1)
        else:
            text = text.rstrip("\n") + f"\n{line}\n"
    try:
        with whole_path(path, ".toml") as temporary:
            temporary.write_bytes(text.encode())
            display = load_toml(temporary, Display)
    except OSError as error:
        raise StudyError(f"{path}: must be writable ({error.strerror})") from None
    return display


def parse_reading(text: str) -> float | None:
    """Return the number that an operator typed as cd/m2; None where it is none."""
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if np.isfinite(value) and value >= 0 else None
