"""Figures of scores: dots per scene, bands by eccentricity, and where a method errs."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from protocols.outside import inline_svg
from stimuli.score.measure_clips import ScoreResults
from stimuli.score.metrics import FRAME
from stimuli.score.tables import ScoreTable, method_order

# Okabe and Ito's colours, told apart by every kind of colour vision; markers for print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#7F7F7F")
MARKERS = "os^DvPX*"
_LEAST_RATIO = 0.1  # lower ones are drawn here
MAP_COLOURS = cv2.COLORMAP_INFERNO
_STYLE: dict[Any, Any] = {  # matplotlib's keys are a type of 300 words
    "font.family": "DejaVu Sans", "font.size": 8.0, "axes.spines.top": False,
    "axes.spines.right": False, "axes.axisbelow": True, "axes.grid": False, "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "svg.hashsalt": "metamerlab", "hatch.linewidth": 0.5, "legend.frameon": False,
}  # fmt: skip


def dots(table: ScoreTable) -> Figure:
    """Draw a row of dots per scene: the farther to the right the better.

    Where 1 is right, as for a ratio, a line stands there, and the nearer to it the better.
    """
    metric, count = table.metric, len(table.methods)
    with figure_style():
        figure = arranged_figure(7.2, 0.9 + 0.21 * len(table.rows) * max(2.2, 0.75 * count))
        axes = figure.subplots()
        for index, method in enumerate(table.methods):
            points = [
                (value, row + (index - (count - 1) / 2) * 0.82 / count)
                for row, (_, values) in enumerate(table.rows)
                if (value := values[index]) is not None and math.isfinite(value)
            ]
            axes.plot(
                [value for value, _ in points], [place for _, place in points],
                MARKERS[index % len(MARKERS)], label=table.shown(method), markersize=6,
                color=COLOURS[index % len(COLOURS)], markeredgecolor="white",
            )  # fmt: skip
        axes.set_yticks(range(len(table.rows)), [table.shown(scene) for scene, _ in table.rows])
        axes.set_ylim(len(table.rows) - 0.5, -0.5)
        for row in range(1, len(table.rows)):
            axes.axhline(row - 0.5, color="#E3E3E3", linewidth=0.6)
        if metric.better == "one":
            axes.axvline(1.0, color="#444444", linewidth=0.8)
        axes.xaxis.grid(color="#E3E3E3", linewidth=0.6)
        unit = f" ({metric.unit})" if metric.unit else ""
        axes.set_xlabel(f"{metric.label}{unit}, {metric.arrow}")
        figure.legend(loc="outside upper center", ncols=min(count, 4))
        if metric.better == "lower":
            axes.invert_xaxis()
    return figure


def by_eccentricity(results: ScoreResults, scene: str) -> Figure | None:
    """Draw the ratio of every level's bands against the distance from the gaze, a panel a method.

    None where nothing was measured around a gaze.
    """
    items = [
        item for item in results.subjects.items
        if item.scene == scene and results.curves.get(item.name)
    ]  # fmt: skip
    if not items:
        return None
    columns = min(3, len(items))
    rows = math.ceil(len(items) / columns)
    with figure_style():
        figure = arranged_figure(1.2 + 2.0 * columns, 0.7 + 1.7 * rows)
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for panel in panels[len(items) :]:
            panel.set_visible(False)
        for index, (panel, item) in enumerate(zip(panels, items, strict=False)):
            panel.axhline(1.0, color="#444444", linewidth=0.8)
            for level, (name, points) in enumerate(results.curves[item.name].items()):
                if points:
                    x, y = zip(*points, strict=True)
                    panel.plot(
                        x, np.maximum(y, _LEAST_RATIO), marker=MARKERS[level], markersize=3,
                        linewidth=1, color=COLOURS[level], label=name if index == 0 else None,
                    )  # fmt: skip
            panel.set_title(results.subjects.shown(item.method), fontsize=8)
            panel.set_xscale("log")
            panel.set_yscale("log")
            panel.set_ylim(_LEAST_RATIO, 4.0)
            panel.set_xticks([1, 2, 5, 10, 20, 40], ["1", "2", "5", "10", "20", "40"])
            panel.set_yticks([0.1, 0.25, 0.5, 1, 2, 4], ["≤ .1", ".25", ".5", "1", "2", "4"])
            panel.minorticks_off()
            panel.grid(color="#E3E3E3", linewidth=0.6)
        figure.supxlabel("eccentricity (degrees)", fontsize=8)
        figure.supylabel("band deviation over the reference's", fontsize=8)
        figure.legend(loc="outside upper center", ncols=4)
    return figure


def middle_frames(results: ScoreResults) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return the pictures of each scene as they are seen, with a mark at the gaze.

    Returns
    -------
    list of (scene, pictures)
        Label and data address of the reference's middle frame, then of the methods'; empty where
        no gaze is known.
    """
    gaze = results.settings.gaze
    if not gaze.points_px:
        return []
    rows = []
    for (scene, size), members in results.subjects.alike().items():
        pair = members[0].pair
        middle = pair.frames // 2
        at = gaze.at(middle, pair.width_px, pair.height_px)
        shown = [(results.subjects.shown("reference"), pair.truth_frame(middle))]
        shown += [
            (results.subjects.shown(item.method), item.pair.test_frame(middle, FRAME))
            for item in members
        ]
        pictures = [(label, _address(_marked(colour, at), 640)) for label, colour in shown]
        rows.append((", ".join(results.subjects.shown(x) for x in (scene, size) if x), pictures))
    return rows


def _marked(colour: NDArray[np.float32], gaze_px: tuple[float, float]) -> NDArray[np.uint8]:
    """Draw a ring around the gaze that light and dark pictures both show."""
    picture = np.rint(255 * colour).astype(np.uint8)
    height, width = picture.shape[:2]
    radius = max(3, min(height, width) // 60)
    centre = round(gaze_px[0] - 0.5), round(gaze_px[1] - 0.5)
    for grow, level in ((1, 0), (0, 255)):
        cv2.circle(picture, centre, radius + grow, (level,) * 3, 1 + grow, cv2.LINE_AA)
    return picture


def error_maps(results: ScoreResults) -> tuple[float, list[tuple[str, str, list[tuple[str, str]]]]]:
    """Paint where each method errs.

    Returns
    -------
    top : float
        The error that the brightest colour stands for; one scale for all.
    rows : list of (scene, size, pictures)
        Label and data address of each picture: the reference's middle frame, then the methods.
    """
    maps = results.maps
    if not maps:
        return 0.0, []
    peaks = [float(np.quantile(one[one > 0], 0.99)) for one in maps.values() if (one > 0).any()]
    top = max(peaks, default=1.0)
    rows = []
    for (scene, size), members in results.subjects.alike().items():
        pair = members[0].pair
        truth = pair.truth_frame(pair.frames // 2)
        pictures = [
            (results.subjects.shown("reference"), _address(np.rint(255 * truth).astype(np.uint8)))
        ]
        for method in method_order(results):
            for item in members:
                if item.method == method and item.name in maps:
                    level = np.clip(255 * maps[item.name] / top, 0, 255).astype(np.uint8)
                    painted = cv2.applyColorMap(level, MAP_COLOURS)[..., ::-1]
                    pictures.append((results.subjects.shown(method), _address(painted)))
        rows.append((results.subjects.shown(scene), results.subjects.shown(size), pictures))
    return top, rows


def colour_bar(top: float, label: str) -> Figure:
    """Draw the scale of the error maps."""
    with figure_style():
        figure = arranged_figure(3.6, 0.62)
        axes = figure.subplots()
        axes.imshow(
            np.linspace(0, 1, 256)[None], aspect="auto", cmap="inferno", extent=(0, top, 0, 1)
        )
        axes.set_yticks([])
        axes.locator_params(axis="x", nbins=4)
        axes.set_xlabel(label)
    return figure


def figure_element(figure: Figure, name: str, title: str) -> str:
    """Return a figure as an SVG element; see `inline_svg`."""
    return inline_svg(_saved(figure, "svg", {"Date": None, "Creator": "metamerlab"}), name, title)


def png_bytes(figure: Figure) -> bytes:
    """Return a figure as PNG, without a date."""
    return _saved(figure, "png", {"Software": None}, dpi=200)


def vector_bytes(figure: Figure, kind: Literal["svg", "pdf"]) -> bytes:
    """Return a figure as vectors with text as text, without a date."""
    return _saved(figure, kind, {"Date" if kind == "svg" else "CreationDate": None})


def arranged_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure that arranges its parts itself."""
    figure = Figure(figsize=(width_in, height_in))
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    return figure


def _saved(
    figure: Figure, kind: str, metadata: dict[str, str | None], dpi: float | None = None
) -> bytes:
    buffer = io.BytesIO()
    with figure_style():
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
            figure.set_layout_engine(None)  # else every kind is drawn twice, and laid out anew
        figure.savefig(buffer, format=kind, metadata=metadata, dpi=dpi or "figure")
    return buffer.getvalue()


def pictured(table: ScoreTable) -> bool:
    """True if a table is worth a figure: those over the whole frame say less about the fill."""
    numbers = (value for _, values in table.rows for value in values if value is not None)
    return any(map(math.isfinite, numbers)) and (table.region != FRAME or len(table.rows) == 1)


@contextmanager
def figure_style() -> Iterator[None]:
    """Apply the look of figures of clips and their scores."""
    with mpl.rc_context(_STYLE):
        yield


def _address(colour: NDArray[np.uint8], widest_px: int = 320) -> str:
    height, width = colour.shape[:2]
    scale = min(1.0, widest_px / width)
    if scale < 1:
        small = (max(1, round(scale * width)), max(1, round(scale * height)))
        colour = np.asarray(cv2.resize(colour, small, interpolation=cv2.INTER_AREA), np.uint8)
    image = np.ascontiguousarray(colour[..., ::-1])
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 88])
    return "data:image/jpeg;base64," + base64.b64encode(bytes(data)).decode()
