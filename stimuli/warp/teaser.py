"""The figure that papers open with: a frame, and what each method makes of its hardest places.

Labels, scores and outlines stay text and lines; pictures are the clips' own pixels, never smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pipeline.errors import InputError
from pipeline.pictures.drawing import Crop, Picture, auto_crops, difference
from protocols.errors import must_be_one_of
from protocols.manifest import Clip, Manifest
from protocols.recipes.base import SCENE
from stimuli.media.png import decode_png
from stimuli.score.plots import COLOURS, figure_style

METHOD: Final = "method"
REFERENCE: Final = "reference"
WIDTHS_IN: Final = {1: 3.33, 2: 7.0}
"""Widths of figures in one and two columns."""
TRIED_FRAMES: Final = 8
_GAP_IN = 0.04
_BETWEEN_IN = 0.09
_PAD_IN = 0.015  # room for outlines
_LEAST_PT = 5.0
_LINES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)))
_LETTERS = "abcdefgh"


@dataclass(frozen=True)
class FigureRow:
    """One scene of the figure: a frame of every method, and where to look."""

    title: str
    whole: Picture
    frames: tuple[Picture, ...]
    """One for each method of the figure."""
    crops: tuple[Crop, ...]
    frame: int
    """Index of the clips' frame."""
    size: str | None = None
    """The size of its clips, where there are any."""


@dataclass(frozen=True)
class RowSettings:
    """Methods, scenes, frame and crops of a figure.

    Parameters
    ----------
    methods : tuple of str
        In their order in the figure; left out: all, the true view last.
    scenes : tuple of str
        Left out: the one whose crops differ most.
    size : str, optional
        Left out: the one whose crops differ most.
    frame : int, optional
        Left out: the one of a few whose crops differ most.
    crops : tuple of Crop
        Left out: where the methods differ most, `count` of them.
    """

    methods: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    size: str | None = None
    frame: int | None = None
    crops: tuple[Crop, ...] = ()
    count: int = 2


def figure_rows(
    folder: Path,
    manifest: Manifest,
    asked: RowSettings = RowSettings(),
    labels: Mapping[str, str] | None = None,
) -> tuple[tuple[str, ...], list[FigureRow]]:
    """Return the figure's methods, and its rows.

    Parameters
    ----------
    folder, manifest : Path, Manifest
        Built clips, whose conditions have a column `method`.
    asked : RowSettings
    labels : mapping, optional
        What to print for names.

    Raises
    ------
    InputError
        If a name, frame or crop is not there.
    """
    named, scenes = labels or {}, asked.scenes
    groups = _groups(manifest, scenes, asked.size)
    every = list(dict.fromkeys(str(clip.condition[METHOD]) for clip in manifest.clips))
    chosen = asked.methods or tuple(sorted(every, key=lambda name: name == REFERENCE))
    for name in chosen:
        if name not in every:
            raise InputError(f"--methods: must be of {', '.join(every)} (got {name!r})")
    found: dict[str, tuple[float, FigureRow]] = {}
    for group in groups:
        clips = {str(clip.condition[METHOD]): clip for clip in group}
        missing = [name for name in chosen if name not in clips]
        if missing:
            if scenes:
                raise InputError(
                    f"--scene {group[0].column(SCENE)}: must have a clip of every method (has none"
                    f" of {', '.join(missing)}); choose others with --methods"
                )
            continue
        differs, row = _row(folder, clips, chosen, asked, named)
        scene = str(group[0].condition.get(SCENE, ""))
        if scene not in found or differs > found[scene][0]:
            found[scene] = differs, row
    if not found:
        raise InputError(
            f"--methods: some scene must have a clip of each of {', '.join(chosen)} (none has)"
        )
    if scenes:
        return chosen, [found[scene][1] for scene in scenes]
    return chosen, [max(found.values(), key=lambda entry: entry[0])[1]]


def _groups(manifest: Manifest, scenes: Sequence[str], size: str | None) -> list[list[Clip]]:
    """Return the clips that differ in their method alone, of the scenes and the size asked for."""
    if any(METHOD not in clip.condition for clip in manifest.clips):
        raise InputError(
            "clips must have a column 'method' to be compared side by side (these have"
            f" {', '.join(manifest.clips[0].condition)})"
        )
    for option, column, wanted in (("--scene", SCENE, scenes), ("--size", "size", [size])):
        known = list(dict.fromkeys(str(clip.condition.get(column)) for clip in manifest.clips))
        for name in wanted:
            if name is not None and name not in known:
                raise InputError(must_be_one_of(f"{option}:", name, known))
    groups: dict[tuple[object, ...], list[Clip]] = {}
    for clip in manifest.clips:
        condition = {key: value for key, value in clip.condition.items() if key != METHOD}
        if scenes and condition.get(SCENE) not in scenes:
            continue
        if size is not None and condition.get("size") != size:
            continue
        groups.setdefault(tuple(condition.items()), []).append(clip)
    return list(groups.values())


def _row(
    folder: Path,
    clips: Mapping[str, Clip],
    methods: Sequence[str],
    asked: RowSettings,
    labels: Mapping[str, str],
) -> tuple[float, FigureRow]:
    frame, crops, count = asked.frame, asked.crops, asked.count
    first = clips[methods[0]]
    length = len(first.frames_sha256)
    if frame is not None and not 0 <= frame < length:
        raise InputError(f"--frame: must be 0 to {length - 1} (got {frame})")
    for crop in crops:
        if (
            min(crop.x, crop.y) < 0
            or min(crop.width, crop.height) < 2
            or crop.x + crop.width > first.width_px
            or crop.y + crop.height > first.height_px
        ):
            raise InputError(
                f"--crops: must lie in the frame of {first.width_px} x {first.height_px} px (got"
                f" {','.join(map(str, crop))}: x, y, width, height)"
            )
    tried = sorted({round(k) for k in np.linspace(0, length - 1, min(TRIED_FRAMES, length))})
    compared = [name for name in methods if name != REFERENCE] or list(methods)
    if len(compared) < 2:
        compared = list(methods)
    best: tuple[float, int, tuple[Crop, ...]] | None = None
    for index in [frame] if frame is not None else tried:
        seen = [_read(folder, clips[name], index) for name in compared]
        apart = difference(seen)
        places = tuple(crops) or auto_crops(apart, count)
        value = float(np.mean([crop.of(apart).mean() for crop in places]))
        if best is None or value > best[0]:
            best = value, index, places
    assert best is not None
    value, index, places = best
    whole = clips.get(REFERENCE, first)
    rest = [
        labels.get(str(entry), str(entry))
        for key, entry in first.condition.items()
        if key != METHOD
    ]
    return value, FigureRow(
        ", ".join(rest),
        _read(folder, whole, index),
        tuple(_read(folder, clips[name], index) for name in methods),
        places,
        index,
        str(first.condition["size"]) if "size" in first.condition else None,
    )


def teaser(
    methods: Sequence[str],
    rows: Sequence[FigureRow],
    *,
    columns: int,
    labels: Mapping[str, str] | None = None,
    scores: Mapping[str, str] | None = None,
    simulated: bool = False,
) -> Figure:
    """Draw the figure.

    In two columns each scene's frame stands left of its crops, in one column above them. Outlines
    differ in colour and in dashes, and have letters, so that they are told apart in print.

    Parameters
    ----------
    methods, rows : sequences
        As `figure_rows` returns them.
    columns : {1, 2}
        Of the page that the figure is as wide as.
    scores : mapping, optional
        A line for each method, under its crops.
    simulated : bool
        Scores are of artificial observers: the figure says so.
    """
    width_in = WIDTHS_IN[columns]
    points = 8.0 if columns == 2 else 6.5
    line_in = 1.45 * points / 72
    layouts = [_Layout.of(row, len(methods), width_in, columns) for row in rows]
    head, foot = line_in, line_in * (1.05 if scores else 0) + (line_in if simulated else 0)
    title = line_in if any(row.title for row in rows) else 0.0
    height_in = foot + sum(head + title + each.height_in + _BETWEEN_IN for each in layouts)
    with figure_style(), mpl.rc_context({"font.size": points}):
        figure = Figure(figsize=(width_in, height_in))
        FigureCanvasAgg(figure)
        top = height_in
        for row, layout in zip(rows, layouts, strict=True):
            top -= title
            if title:
                figure.text(0, (top + 0.3 * line_in) / height_in, row.title, fontweight="bold")
            top = _draw_row(
                figure, top, row, layout, [(labels or {}).get(name, name) for name in methods],
                head,
            )  # fmt: skip
            top -= _BETWEEN_IN
        if scores:
            at = (top + _BETWEEN_IN - 0.95 * line_in) / height_in
            for place, name in enumerate(methods):
                left, across = layouts[-1].column(place)
                middle = (left + across / 2) / width_in
                _fitting(figure, middle, at, scores.get(name, ""), across)
        if simulated:
            figure.text(
                1, 0.25 * line_in / height_in, "SIMULATED DATA", ha="right", color="#A63F00",
                fontweight="bold",
            )  # fmt: skip
    return figure


@dataclass(frozen=True)
class _Layout:
    """Sizes of one row, in inches."""

    whole_in: tuple[float, float]
    crop_in: tuple[float, float]
    count: int
    beside: bool

    @classmethod
    def of(cls, row: FigureRow, methods: int, width_in: float, columns: int) -> _Layout:
        high, wide = row.whole.shape[:2]
        width_in -= 2 * _PAD_IN
        tall = max(crop.height / crop.width for crop in row.crops)
        count = len(row.crops)
        if columns == 1:
            across = (width_in - (methods - 1) * _GAP_IN) / methods
            whole = (width_in, width_in * high / wide)
            return cls(whole, (across, across * tall), count, beside=False)
        # The frame is as high as its crops together: across * tall * count + gaps.
        ratio = wide / high
        free = width_in - methods * _GAP_IN - ratio * (count - 1) * _GAP_IN
        across = free / (methods + ratio * tall * count)
        height = across * tall * count + (count - 1) * _GAP_IN
        return cls((height * ratio, height), (across, across * tall), count, beside=True)

    @property
    def crops_in(self) -> float:
        return self.count * self.crop_in[1] + (self.count - 1) * _GAP_IN

    @property
    def height_in(self) -> float:
        return self.whole_in[1] if self.beside else self.whole_in[1] + _GAP_IN + self.crops_in

    def column(self, place: int) -> tuple[float, float]:
        """Left edge and width of a method's crops."""
        start = _PAD_IN + (self.whole_in[0] + _GAP_IN if self.beside else 0.0)
        return start + place * (self.crop_in[0] + _GAP_IN), self.crop_in[0]


def _draw_row(
    figure: Figure, top: float, row: FigureRow, layout: _Layout, names: Sequence[str], head: float
) -> float:
    """Draw one scene from `top` downwards; return where it ends."""
    width_in, height_in = figure.get_size_inches()

    def place(left: float, upper: float, size: tuple[float, float]) -> Axes:
        axes = figure.add_axes(
            (left / width_in, (upper - size[1]) / height_in, size[0] / width_in,
             size[1] / height_in)
        )  # fmt: skip
        axes.set_axis_off()
        return axes

    if layout.beside:
        top -= head
        whole = place(_PAD_IN, top, layout.whole_in)
        first, labels_at = top, top + 0.3 * head
    else:
        whole = place(_PAD_IN, top, layout.whole_in)
        labels_at = top - layout.whole_in[1] - 0.75 * head
        first = top - layout.whole_in[1] - head
    _image(whole, row.whole)
    for index, crop in enumerate(row.crops):
        _outline(whole, index, (crop.x, crop.y, crop.width, crop.height), letter=True)
    for column, (name, picture) in enumerate(zip(names, row.frames, strict=True)):
        left, across = layout.column(column)
        _fitting(figure, (left + across / 2) / width_in, labels_at / height_in, name, across)
        for index, crop in enumerate(row.crops):
            upper = first - index * (layout.crop_in[1] + _GAP_IN)
            axes = place(left, upper, layout.crop_in)
            _image(axes, crop.of(picture))
            _outline(axes, index, (0, 0, crop.width, crop.height), letter=column == 0)
    return (first - layout.crops_in) if not layout.beside else top - layout.whole_in[1]


def _image(axes: Axes, picture: Picture) -> None:
    height, width = picture.shape[:2]
    axes.imshow(picture, interpolation="none", extent=(0, width, height, 0), aspect="auto")
    axes.set(xlim=(0, width), ylim=(height, 0))


def _outline(
    axes: Axes, index: int, box: tuple[float, float, float, float], *, letter: bool
) -> None:
    """Outline a part: white beneath, then its colour with dashes of its own."""
    x, y, width, height = box
    colour = COLOURS[index % len(COLOURS)]
    for ink, thick, line in (("white", 2.6, "-"), (colour, 1.3, _LINES[index % len(_LINES)])):
        axes.add_patch(
            Rectangle((x, y), width, height, fill=False, edgecolor=ink, linewidth=thick,
                      linestyle=line, clip_on=False)
        )  # fmt: skip
    if letter:
        axes.annotate(
            _LETTERS[index % len(_LETTERS)], (x, y), xytext=(3, -3), textcoords="offset points",
            ha="left", va="top", color="white", fontweight="bold",
            bbox={"facecolor": colour, "edgecolor": "none", "pad": 1.2},
        )  # fmt: skip


def _fitting(figure: Figure, x: float, y: float, text: str, across_in: float) -> None:
    """Write a text that is no wider than its column: letters shrink, then the text is cut."""
    made = figure.text(x, y, text, ha="center", va="baseline")
    canvas: Any = figure.canvas
    renderer = canvas.get_renderer()

    def wide() -> float:
        return float(made.get_window_extent(renderer).width) / figure.dpi

    if wide() > across_in:
        size = float(made.get_fontsize())
        made.set_fontsize(max(_LEAST_PT, size * across_in / wide()))
    while wide() > across_in and len(text) > 4:
        text = text[:-2].rstrip(" …") + "…"
        made.set_text(text)


def _read(folder: Path, clip: Clip, index: int) -> Picture:
    frame = decode_png(folder / clip.frame_path(index))
    if frame.dtype == np.uint16:
        frame = frame >> 8
    return np.ascontiguousarray(frame[..., :3], np.uint8)
