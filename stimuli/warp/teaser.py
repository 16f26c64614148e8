"""The figure that papers open with: a frame, and what each method makes of its hardest places.

Frames are those of built clips, or of a folder of steps that `metamerlab warp` wrote. Labels,
scores and outlines stay text and lines; pictures are the clips' own pixels, never smoothed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pipeline.errors import InputError
from pipeline.pictures.drawing import Crop, Picture, auto_crops, mean_difference
from protocols.errors import must_be_one_of
from protocols.manifest import Clip, Manifest
from protocols.recipes.base import SCENE
from stimuli.media.png import decode_in_8_bits
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

    condition: tuple[str, ...]
    """Labels of scene, size and whatever else its clips have in common."""
    whole: Picture
    whole_is: str
    """Name of the method that `whole` is of."""
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


@dataclass(frozen=True)
class Compared:
    """Frames of several methods under one condition, read when they are asked for."""

    frames: Mapping[str, Callable[[int], Picture]]
    length: int
    condition: Mapping[str, str] = field(default_factory=dict)


def of_clips(folder: Path, manifest: Manifest) -> list[Compared]:
    """Return the clips that differ in their method alone, side by side.

    Raises
    ------
    InputError
        If their conditions have no column `method`.
    """
    groups: dict[tuple[tuple[str, str], ...], list[Clip]] = {}
    for clip in manifest.clips:
        if METHOD not in clip.condition:
            raise InputError(
                "clips must have a column 'method' to be compared side by side (these have"
                f" {', '.join(clip.condition)})"
            )
        shared = {key: str(value) for key, value in clip.condition.items() if key != METHOD}
        groups.setdefault(tuple(shared.items()), []).append(clip)
    return [
        Compared(
            {str(clip.condition[METHOD]): partial(_read_clip, folder, clip) for clip in clips},
            len(clips[0].frames_sha256),
            dict(shared),
        )
        for shared, clips in groups.items()
    ]


def of_steps(folder: Path) -> list[Compared]:
    """Return the fills of one frame, and its true view, that `metamerlab warp --steps` wrote.

    Raises
    ------
    InputError
        If they are not there.
    """
    found = {}
    for path in sorted(folder.glob("*.png")):
        if named := re.fullmatch(r"\d+-(?:filled-(.+)|true-view)", path.stem):
            found[named[1] or REFERENCE] = lambda _, path=path: _read(path)
    if not found.keys() - {REFERENCE}:
        raise InputError(
            f"{folder}: must hold built clips (manifest.json), or what 'metamerlab warp --steps"
            f" {folder}' writes"
        )
    return [Compared(found, 1)]


def figure_rows(
    groups: Sequence[Compared],
    asked: RowSettings = RowSettings(),
    labels: Mapping[str, str] | None = None,
) -> tuple[tuple[str, ...], list[FigureRow]]:
    """Return the figure's methods, and its rows.

    Parameters
    ----------
    groups : sequence of Compared
    asked : RowSettings
    labels : mapping, optional
        What to print for names.

    Raises
    ------
    InputError
        If a name, frame or crop is not there.
    """
    scenes = asked.scenes
    every = list(dict.fromkeys(name for group in groups for name in group.frames))
    chosen = asked.methods or tuple(sorted(every, key=lambda name: name == REFERENCE))
    for name in chosen:
        if name not in every:
            raise InputError(f"--methods: must be of {', '.join(every)} (got {name!r})")
    found: dict[str, tuple[float, FigureRow]] = {}
    for group in _wanted(groups, asked):
        scene = group.condition.get(SCENE, "")
        missing = [name for name in chosen if name not in group.frames]
        if missing and scenes:
            raise InputError(
                f"--scene {scene}: must have a clip of every method (has none"
                f" of {', '.join(missing)}); choose others with --methods"
            )
        if missing:
            continue
        differs, row = _row(group, chosen, asked, labels or {})
        if scene not in found or differs > found[scene][0]:
            found[scene] = differs, row
    if not found:
        raise InputError(
            f"--methods: some scene must have a clip of each of {', '.join(chosen)} (none has)"
        )
    if scenes:
        return chosen, [found[scene][1] for scene in scenes]
    return chosen, [max(found.values(), key=lambda entry: entry[0])[1]]


def _wanted(groups: Sequence[Compared], asked: RowSettings) -> list[Compared]:
    """Return the groups of the scenes and the size asked for."""
    left = list(groups)
    sizes = () if asked.size is None else (asked.size,)
    for option, column, wanted in (("--scene", SCENE, asked.scenes), ("--size", "size", sizes)):
        known = list(dict.fromkeys(group.condition.get(column, "none") for group in groups))
        for name in wanted:
            if name not in known:
                raise InputError(must_be_one_of(f"{option}:", name, known))
        if wanted:
            left = [group for group in left if group.condition.get(column) in wanted]
    return left


def _row(
    group: Compared, methods: Sequence[str], asked: RowSettings, labels: Mapping[str, str]
) -> tuple[float, FigureRow]:
    whole_is = REFERENCE if REFERENCE in group.frames else methods[0]
    if asked.frame is not None and not 0 <= asked.frame < group.length:
        raise InputError(f"--frame: must be 0 to {group.length - 1} (got {asked.frame})")
    high, wide = group.frames[whole_is](0).shape[:2]
    for crop in asked.crops:
        if (
            min(crop.x, crop.y) < 0
            or min(crop.width, crop.height) < 2
            or crop.x + crop.width > wide
            or crop.y + crop.height > high
        ):
            raise InputError(
                f"--crops: must lie in the frame of {wide} x {high} px (got"
                f" {','.join(map(str, crop))}: x, y, width, height)"
            )
    steps = np.linspace(0, group.length - 1, min(TRIED_FRAMES, group.length))
    compared = [name for name in methods if name != REFERENCE]
    if len(compared) < 2:
        compared = list(methods)
    tried = []
    for index in {round(k) for k in steps} if asked.frame is None else [asked.frame]:
        apart = mean_difference([group.frames[name](index) for name in compared])
        places = asked.crops or auto_crops(apart, asked.count)
        value = float(np.mean([crop.of(apart).mean() for crop in places]))
        tried.append((value, -index, places))
    value, index, places = max(tried)
    return value, FigureRow(
        tuple(labels.get(entry, entry) for entry in group.condition.values()),
        group.frames[whole_is](-index),
        whole_is,
        tuple(group.frames[name](-index) for name in methods),
        places,
        -index,
        group.condition.get("size"),
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
        As `figure_rows` returns them. Several rows say in what they differ.
    columns : {1, 2}
        Of the page that the figure is as wide as.
    scores : mapping, optional
        Of each method, under its crops: a line, or two.
    simulated : bool
        Scores are of artificial observers: the figure says so.
    """
    width_in = WIDTHS_IN[columns]
    points = 8.0 if columns == 2 else 6.5
    line_in = 1.45 * points / 72
    layouts = [_Layout.of(row, len(methods), width_in, columns) for row in rows]
    lines = max((text.count("\n") + 1 for text in (scores or {}).values()), default=0)
    head, foot = line_in, line_in * (0.85 * lines + simulated)
    titles = _titles(rows)
    title = line_in if any(titles) else 0.0
    height_in = foot + sum(head + title + each.height_in + _BETWEEN_IN for each in layouts)
    with figure_style(), mpl.rc_context({"font.size": points}):
        figure = Figure(figsize=(width_in, height_in))
        FigureCanvasAgg(figure)
        top = height_in
        for row, layout, said in zip(rows, layouts, titles, strict=True):
            top -= title
            figure.text(0, (top + 0.3 * line_in) / height_in, said, fontweight="bold")
            top = _draw_row(figure, top, row, layout, methods, labels or {}, head)
            top -= _BETWEEN_IN
        if scores:
            at = (top + _BETWEEN_IN - 0.2 * line_in) / height_in
            for place, name in enumerate(methods):
                left, across = layouts[-1].column(place)
                middle = (left + across / 2) / width_in
                _fitting(figure, (middle, at), scores.get(name, ""), across, "top")
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


def _titles(rows: Sequence[FigureRow]) -> list[str]:
    """Return the labels that tell rows apart, joined: empty for a row alone."""
    shared = [len(set(said)) == 1 for said in zip(*(row.condition for row in rows), strict=False)]
    return [
        ", ".join(said for said, same in zip(row.condition, shared, strict=False) if not same)
        for row in rows
    ]


def _draw_row(
    figure: Figure,
    top: float,
    row: FigureRow,
    layout: _Layout,
    methods: Sequence[str],
    labels: Mapping[str, str],
    head: float,
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
    said = labels.get(row.whole_is, row.whole_is)
    _tag(whole, (0, row.whole.shape[0]), said, "black", (3, 4), "bottom")
    for index, crop in enumerate(row.crops):
        _outline(whole, index, (crop.x, crop.y, crop.width, crop.height), letter=True)
    for column, (name, picture) in enumerate(zip(methods, row.frames, strict=True)):
        left, across = layout.column(column)
        at = (left + across / 2) / width_in, labels_at / height_in
        _fitting(figure, at, labels.get(name, name), across, "baseline")
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
        _tag(axes, (x, y), _LETTERS[index % len(_LETTERS)], colour, (3, -3), "top")


def _tag(
    axes: Axes,
    at: tuple[float, float],
    text: str,
    colour: str,
    off_pt: tuple[float, float],
    side: str,
) -> None:
    """Write on a picture, in a box of a colour."""
    axes.annotate(
        text, at, xytext=off_pt, textcoords="offset points", ha="left", va=side,
        color="white", fontweight="bold",
        bbox={"facecolor": colour, "edgecolor": "none", "pad": 1.2},
    )  # fmt: skip


def _fitting(
    figure: Figure, at: tuple[float, float], text: str, across_in: float, side: str
) -> None:
    """Write a text that is no wider than its column: letters shrink, then a name is cut."""
    made = figure.text(*at, text, ha="center", va=side, linespacing=1.1)
    canvas: Any = figure.canvas
    renderer = canvas.get_renderer()

    def wide() -> float:
        return float(made.get_window_extent(renderer).width) / figure.dpi

    is_score, size = side == "top", float(made.get_fontsize())
    if wide() > across_in:
        made.set_fontsize(max(0 if is_score else _LEAST_PT, size * across_in / wide()))
    while wide() > across_in and len(text) > 4 and not is_score:
        text = text[:-2].rstrip(" …") + "…"
        made.set_text(text)


def _read_clip(folder: Path, clip: Clip, index: int) -> Picture:
    return _read(folder / clip.frame_path(index))


def _read(path: Path) -> Picture:
    return np.ascontiguousarray(decode_in_8_bits(path)[..., :3])
