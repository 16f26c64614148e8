"""The display a metric is told about, and where its viewer looks."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pipeline.foveation.geometry import Flat, FlatGeometry
from protocols.disk.hashing import Json
from protocols.disk.whole_file import decoded_text, separator_of
from protocols.errors import StudyError
from protocols.limits import check_cells
from protocols.load import load_display
from protocols.outside import bounded_bytes, reading

STANDARD_FHD = "standard_fhd"
_INCH_M = 0.0254
_FARTHEST_PX = 1e6  # no clip is as wide


@dataclass(frozen=True)
class ViewingConditions:
    """Display, as metrics need to know it.

    Attributes
    ----------
    peak_cd_m2, contrast, ambient_lux : float
        Light of white, white over black in the dark, and light that falls onto the screen.
    gamma : float or None
        None: the sRGB curve.
    """

    name: str
    width_px: int
    height_px: int
    width_m: float
    height_m: float
    distance_m: float
    peak_cd_m2: float = 200.0
    contrast: float = 1000.0
    ambient_lux: float = 250.0
    gamma: float | None = None

    @property
    def px_per_deg(self) -> float:
        """Pixels per degree in the middle of the screen."""
        return 1.0 / (2 * math.degrees(math.atan(0.5 * self.pitch_m / self.distance_m)))

    def before(self, width_px: int, height_px: int) -> FlatGeometry:
        """Return pictures of a size in the middle of the display, before the eye."""
        return Flat(distance_px=self.distance_m / self.pitch_m).of(width_px, height_px)

    @property
    def pitch_m(self) -> float:
        """Width of a pixel."""
        return self.width_m / self.width_px

    @property
    def diagonal_inches(self) -> float:
        """Diagonal of the visible area."""
        return math.hypot(self.width_m, self.height_m) / _INCH_M

    def as_json(self) -> dict[str, Json]:
        """Return everything, for cache keys and results."""
        return {**asdict(self), "px_per_deg": self.px_per_deg}


def standard_fhd() -> ViewingConditions:
    """Return FovVideoVDP's display of that name: 24-inch full HD from 0.6 m, as in [MI]."""
    height_m = 24 * _INCH_M / math.hypot(1920, 1080) * 1080
    return ViewingConditions(STANDARD_FHD, 1920, 1080, height_m * 1920 / 1080, height_m, 0.6)


def open_viewing(name_or_path: str) -> ViewingConditions:
    """Return `standard_fhd`, or a display of ours with its measured light where it has any.

    Raises
    ------
    StudyError
        If there is no such display, or its file has mistakes.
    """
    if name_or_path == STANDARD_FHD:
        return standard_fhd()
    try:
        display = load_display(name_or_path)
    except StudyError as error:
        if name_or_path.endswith(".toml"):
            raise
        raise StudyError(f"--display: {error}; {STANDARD_FHD} is known as well") from None
    plain = standard_fhd()
    peak = display.peak_cd_m2 or plain.peak_cd_m2
    measured_black = display.black_cd_m2 is not None and display.black_cd_m2 > 0
    return ViewingConditions(
        display.name,
        display.width_px,
        display.height_px,
        display.width_mm / 1000,
        display.height_mm / 1000,
        display.distance_mm / 1000,
        peak,
        peak / (display.black_cd_m2 or 1.0) if measured_black else plain.contrast,
        0.0 if measured_black else plain.ambient_lux,  # a measured black holds the room's light
        display.gamma,
    )


@dataclass(frozen=True)
class ViewerGaze:
    """Points at which the viewer looks, in pixels of the clip from its upper left corner.

    Attributes
    ----------
    points_px : tuple of (x, y)
        One for all frames, or one per frame; empty: nothing is known of the gaze.
    """

    points_px: tuple[tuple[float, float], ...] = ()

    def at(self, frame: int, width_px: int, height_px: int) -> tuple[float, float]:
        """Return the place in a frame; where nothing is known, the middle."""
        if not self.points_px:
            return width_px / 2, height_px / 2
        return self.points_px[frame if len(self.points_px) > 1 else 0]

    def check(self, frames: int, width_px: int, height_px: int) -> None:
        """Require a point for every frame, on the clip.

        Raises
        ------
        StudyError
            Naming the first point that is not.
        """
        if len(self.points_px) not in (0, 1, frames):
            raise StudyError(
                f"--gaze: must hold one line per frame ({frames} frames, got"
                f" {len(self.points_px)} lines)"
            )
        for x_px, y_px in self.points_px:
            if not (0 <= x_px <= width_px and 0 <= y_px <= height_px):
                raise StudyError(
                    f"--gaze: must lie on the clip, {width_px} x {height_px} px"
                    f" (got {x_px:g}, {y_px:g})"
                )


def read_viewer_gaze(text: str | None, *, may_be_lost: bool = False) -> ViewerGaze:
    """Read ``X,Y`` in pixels of the clip, or a CSV file with columns x_px and y_px.

    Where the eye `may_be_lost`, a line may have two empty cells, or nan: both numbers are nan then.

    Raises
    ------
    StudyError
        Saying what is wrong with it.
    """
    if text is None:
        return ViewerGaze()
    parts = text.split(",")
    if len(parts) == 2:
        return ViewerGaze((_point(parts, "--gaze"),))
    path = Path(text)
    points: tuple[tuple[float, float], ...] = ()
    try:
        with reading(path, "a CSV file in UTF-8", StudyError):
            text = decoded_text(bounded_bytes(path, StudyError, "table"), [])
            separator = separator_of(text)
            check_cells(path, text, separator)
            lines = io.StringIO(text, newline="")
            reader = csv.DictReader(lines, restkey="(more)", delimiter=separator)
            header = list(reader.fieldnames or ())
            if has_both := header.count("x_px") == header.count("y_px") == 1:
                points = tuple(
                    _point(
                        [_with_point(row[name], separator) for name in ("x_px", "y_px")],
                        f"{path}: line {reader.line_num}",
                        may_be_lost,
                    )
                    for row in reader
                )
    except (FileNotFoundError, IsADirectoryError):
        raise StudyError(
            f"--gaze: must be X,Y in pixels or a CSV file (there is no file {text!r})"
        ) from None
    if not points:
        found = "no line below its header" if has_both else ", ".join(header) or "no line"
        raise StudyError(
            f"{path}: must have the columns x_px and y_px, each once, and one line per frame"
            f" (got {found})"
        )
    return ViewerGaze(points)


def _with_point(cell: str | None, separator: str) -> str | None:
    """Return a cell with a decimal point: beside semicolons and tabs commas are decimal ones."""
    return cell if cell is None or separator == "," else cell.replace(",", ".")


def _point(
    parts: Sequence[str | None], where: str, may_be_lost: bool = False
) -> tuple[float, float]:
    nothing = "nan" if may_be_lost else ""
    try:
        x_px, y_px = (float(nothing if part == "" else part or "") for part in parts)
    except ValueError:
        x_px = y_px = math.inf
    if may_be_lost and math.isnan(x_px) and math.isnan(y_px):
        return math.nan, math.nan
    if not (abs(x_px) <= _FARTHEST_PX and abs(y_px) <= _FARTHEST_PX):
        lost = ", or two empty cells where the eye was lost" if may_be_lost else ""
        raise StudyError(
            f"{where}: must be two numbers, pixels from the clip's upper left corner{lost}"
            f" (got {', '.join(str(part) for part in parts)})"
        )
    return x_px, y_px
