"""One look for all figures, and how they are saved: same result, same bytes.

matplotlib is imported when the first figure is drawn: most commands draw none.
"""

import io
import logging
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.arrays import Floats
from analysis.report.wording import size

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:  # names for hints
    Axes = Figure = object

ONE_COLUMN_IN = 3.33
TWO_COLUMNS_IN = 7.0

BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
PURPLE = "#AA4499"
GREY = "#5F5F5F"
LIGHT = "#E3E3E3"
PALE_BLUE = "#BBD9EC"
PALE_ORANGE = "#F6D3BC"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, "#7A5195", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES = ("-", "--", "-.", ":", (0, (6, 2)), (0, (1, 1)))
"""Dashes of curves, which grey prints and the colour-blind tell apart by these."""

SIMULATED_TEXT = "SIMULATED DATA"

_OTHER_SCRIPTS = (
    "Noto Sans CJK JP",
    "Noto Sans CJK SC",
    "Noto Sans CJK KR",
    "Noto Sans Arabic",
    "Noto Sans Devanagari",
    "Noto Sans Thai",
    "Droid Sans Fallback",
    "Arial Unicode MS",
    "WenQuanYi Zen Hei",
    "Unifont",
)
"""Fonts asked, where installed, for letters that the house font lacks."""

# Some of them have no bold face; that their plain one is used is no news to anybody.
logging.getLogger("matplotlib.font_manager").addFilter(
    lambda record: "Failed to find font weight" not in record.getMessage()
)

_STYLE = Path(__file__).with_name("paper.mplstyle")


@cache
def _style() -> Any:
    from matplotlib import rc_params_from_file

    return rc_params_from_file(str(_STYLE), use_default_template=False)


@contextmanager
def _styled(fonts: Any = None) -> Iterator[None]:
    from matplotlib import rc_context

    with rc_context({**_style(), **(fonts or {})}):
        yield


def series_look(number: int) -> tuple[str, str, object]:
    """Return colour, marker and dash of a series."""
    own = number % len(SERIES)  # there are as many of each
    return SERIES[own], MARKERS[own], DASHES[own]


def font_size(width_in: float) -> float:
    """Return the font size of a figure of this width, in points."""
    return 6.5 if width_in < 5 else 8.0


@cache
def _installed() -> tuple[str, ...]:
    from matplotlib.font_manager import fontManager

    names = {font.name for font in fontManager.ttflist}
    return tuple(name for name in _OTHER_SCRIPTS if name in names)


@contextmanager
def new_figure(width_in: float, height_in: float, *, simulated: bool) -> Iterator[Figure]:
    """Give an empty figure in the house style; one of simulated data says so above everything."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    families = ["DejaVu Sans", *_installed()]
    with _styled({"font.size": font_size(width_in), "font.family": families}):
        figure = Figure(figsize=(width_in, height_in + (0.22 if simulated else 0.0)))
        FigureCanvasAgg(figure)
        figure.set_layout_engine("constrained")
        if simulated:
            figure.suptitle(SIMULATED_TEXT, color=ORANGE, fontweight="bold", x=0.99, ha="right")
        yield figure


def wrapped(label: str, width_in: float) -> str:
    """Break a label so that it leaves room for the data."""
    width = 11 if width_in < 5 else 22
    return "\n".join(
        textwrap.wrap(label, width, break_long_words=len(label) > 2 * width) or [label]
    )


def row_in(labels: Iterable[str], width_in: float, least: float) -> float:
    """Return the height of rows, in inches, in which none of these labels touches the next."""
    lines = max(wrapped(label, width_in).count("\n") + 1 for label in labels)
    return max(least, (1.25 * lines + 0.8) * font_size(width_in) / 72)


def legend_columns(labels: Sequence[str], width_in: float) -> int:
    """Return the number of columns of a legend below the axes: 2 at most in one column of text."""
    narrow = width_in < 5
    em_in = font_size(width_in) / 72
    entry_in = (0.6 * max(map(len, labels), default=0) + 5.0) * em_in
    return max(1, min(2 if narrow else 4, len(labels), int(width_in / entry_in)))


def limits_text(level: float) -> str:
    """Return the name of lines and whiskers with limits on figures."""
    return f"{100 * level:g} % limits"


def explain(figure: Figure, text: str, width_in: float) -> None:
    """Say below a figure without a legend what its bars, lines and dots mean."""
    lines = textwrap.wrap(text, 62 if width_in < 5 else 120)
    figure.supxlabel("\n".join(lines), fontsize=font_size(width_in) - 0.5, color=GREY)


def key(figure: Figure, names: Sequence[str], text: str, width_in: float) -> None:
    """Write the meaning of bars above a legend of these names below; of one name, alone."""
    if len(names) < 2:
        explain(figure, text, width_in)
        return
    title = "\n".join(textwrap.wrap(text, 56 if width_in < 5 else 100))
    columns = legend_columns(names, width_in)
    figure.legend(loc="outside lower center", ncols=columns, title=title)


def share_axis(axes: Axes, label: str) -> None:
    """Set an axis from 0 to 1, whose ends keep dots clear of the names beside them."""
    axes.set_xlim(-0.03, 1.03)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", ".25", ".5", ".75", "1"])
    axes.set_xlabel(label)


def name_rows(axes: Axes, names: Sequence[str], width_in: float) -> None:
    """Set an axis with a name for each row, the first above."""
    axes.set_yticks(range(len(names)), [wrapped(name, width_in) for name in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)


def interval(
    axes: Axes, y: float, value: float, lower: float, upper: float, colour: str = BLUE
) -> None:
    """Draw a value with its limits in a row."""
    axes.plot([lower, upper], [y, y], color=colour, lw=1.4)
    axes.plot(value, y, "o", color=colour, ms=4)


def own_dots(axes: Axes, y: float, values: Sequence[float]) -> None:
    """Draw participants' own values below a row."""
    own = np.asarray(values)
    axes.scatter(own, np.full(own.size, y + 0.22), s=6, color=GREY, linewidth=0, alpha=0.7)


def null_line(axes: Axes, x: float) -> None:
    """Draw where there is no effect."""
    axes.axvline(x, color="black", lw=0.8, ls=(0, (4, 3)), zorder=3)


def level_axis(axes: Axes, levels: Floats) -> None:
    """Set a logarithmic axis of levels, with 1, 2 and 5 of each power of ten on it."""
    axes.set_xscale("log")
    low, high = float(np.min(levels)), float(np.max(levels))
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [m * 10.0**k for k in powers for m in (1, 2, 5) if low <= m * 10.0**k <= high]
    ends = None
    if len(ticks) < 3:
        shown = np.unique(levels)
        ticks = sorted({low, float(shown[shown.size // 2]), high})
        ends = (low, high) if shown.size < 3 else None
    elif len(ticks) > 6:
        ticks = [10.0**k for k in powers if low <= 10.0**k <= high]
    axes.set_xticks(ticks, [size(tick, within=ends) for tick in ticks])
    axes.minorticks_off()


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """Return a figure as svg, pdf or png; no date, no machine in it."""
    metadata: Mapping[str, Mapping[str, str | None]] = {
        "svg": {"Date": None, "Creator": "metamerlab"},
        "pdf": {"CreationDate": None, "Creator": "metamerlab", "Producer": None},
        "png": {"Software": None},
    }
    if kind not in metadata:
        raise ValueError(f"kind must be one of {sorted(metadata)} (got {kind!r})")
    buffer = io.BytesIO()
    with _styled(), _letters_alone() if kind == "pdf" else nullcontext():
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
            figure.set_layout_engine(None)  # else every kind is drawn twice, and laid out anew
        figure.savefig(buffer, format=kind, metadata=dict(metadata[kind]), dpi=300)
    return buffer.getvalue()


@contextmanager
def _letters_alone() -> Iterator[None]:
    """Leave out of fonts in a PDF how letters are set: that is done, and reading it is slow."""
    from fontTools.subset import Options

    name = "_drop_tables_default"
    usual: list[str] = getattr(Options, name, [])
    setattr(Options, name, [*usual, "GDEF", "GPOS", "GSUB"])
    try:
        yield
    finally:
        setattr(Options, name, usual)


def save_figure(figure: Figure, folder: Path, name: str) -> tuple[Path, ...]:
    """Write ``name.svg``, ``name.pdf`` and ``name.png`` into `folder`."""
    paths = []
    for kind in ("svg", "pdf", "png"):
        path = folder / f"{name}.{kind}"
        path.write_bytes(figure_bytes(figure, kind))
        paths.append(path)
    return tuple(paths)
