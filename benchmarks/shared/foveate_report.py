"""Report of `script/bench foveate`: in Markdown, and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

MIB = 2**20
TIMES = {True: "CPU time over all cores", False: "least of the runs; on the CPU, CPU time"}


@dataclass(frozen=True)
class Line:
    """One condition at one size.

    Attributes
    ----------
    where : str
        gpu, numpy, or the package.
    cpu_ms : float or None
        CPU time of this process, over all cores; None on hardware that is no CPU.
    over_blur, over_copy : float or None
        Medians of the ratios, turn by turn; of CPU times where they are known.
    analysis_ms, synthesis_ms : float or None
        The time that counts, shared out as the passes' least times are: what measures the picture
        (pulls), and all that follows (levels of detail, gains, noise).
    held_bytes, analysis_bytes : int or None
        Held beyond source and target; the part of it that the analysis made.
    """

    edge_px: int
    condition: str
    where: str
    median_ms: float
    least_ms: float
    cpu_ms: float | None = None
    over_blur: float | None = None
    over_copy: float | None = None
    analysis_ms: float | None = None
    synthesis_ms: float | None = None
    passes: int | None = None
    held_bytes: int | None = None
    analysis_bytes: int | None = None

    @property
    def counted_ms(self) -> float:
        """CPU time where the CPU does the work; else the least time."""
        return self.least_ms if self.cpu_ms is None else self.cpu_ms

    @property
    def bytes_per_px(self) -> float | None:
        """Bytes held for each pixel."""
        return None if self.held_bytes is None else self.held_bytes / self.edge_px**2


def number(value: float | None, digits: int) -> str:
    """A number as a table has it; nothing where there is none."""
    return "" if value is None else f"{value:.{digits}f}"


def milliseconds(value: float) -> str:
    """Three figures, whole from a hundred on."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def markdown(lines: Sequence[Line], renderer: str, machine: str) -> str:
    """Return two tables: time by size, and analysis beside synthesis."""
    edges = sorted({line.edge_px for line in lines})
    found = {(line.condition, line.where, line.edge_px): line for line in lines}
    kind = TIMES[any(line.cpu_ms is not None for line in lines if line.where == "gpu")]
    rows = [
        f"{renderer}; {machine}. ms per frame ({kind}), beside it times the blur of the same turn:",
        "",
        "| condition | by | "
        + " | ".join(f"{edge}²" for edge in edges)
        + " | passes | B/px held |",
        "| --- | --- |" + " ---: |" * (len(edges) + 2),
    ]
    for condition, where in dict.fromkeys((line.condition, line.where) for line in lines):
        cells = []
        for edge in edges:
            line = found.get((condition, where, edge))
            cell = "" if line is None else milliseconds(line.counted_ms)
            if line is not None and line.over_blur is not None and condition != "blur":
                cell += f" ({line.over_blur:.2f})"
            cells.append(cell)
        last = found[condition, where, max(e for c, w, e in found if (c, w) == (condition, where))]
        passes, held = number(last.passes, 0), number(last.bytes_per_px, 0)
        rows.append(f"| `{condition}` | {where} | " + " | ".join([*cells, passes, held]) + " |")
    rows += [
        "",
        "Passes and bytes are those of the largest size. Analysis (the picture's chain and its moments) and synthesis (levels of detail, gains, noise) apart:",  # noqa: E501
        "",
        "| condition | size | analysis, ms | synthesis, ms | analysis, MiB | synthesis, MiB |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for line in lines:
        if line.analysis_ms is None or line.synthesis_ms is None:
            continue
        analysis, rest = _mib(line)
        rows.append(
            f"| `{line.condition}` | {line.edge_px}² | {milliseconds(line.analysis_ms)}"
            f" | {milliseconds(line.synthesis_ms)} | {analysis:.1f} | {rest:.1f} |"
        )
    return "\n".join(rows)


def _mib(line: Line) -> tuple[float, float]:
    """Memory of analysis and of synthesis, MiB."""
    held, own = line.held_bytes or 0, line.analysis_bytes or 0
    return own / MIB, (held - own) / MIB


# Okabe and Ito's colours, told apart by every kind of colour vision; markers and dashes as well.
SERIES = (
    ("copy", "gpu", "#555555", "X", "-"),
    ("blur", "gpu", "#D55E00", "s", "-"),
    ("metamer", "gpu", "#0072B2", "o", "-"),
    ("warped-metamer", "gpu", "#009E73", "D", "-"),
    ("noise-enhanced", "", "#CC79A7", "^", "-"),
    ("gen_metamer", "odak", "#0072B2", "o", ":"),
    ("RadiallyVaryingBlur", "odak", "#D55E00", "s", ":"),
)


def plot(lines: Sequence[Line], renderer: str, target: Path) -> None:
    """Draw time by size; time and memory of analysis and synthesis, as Beyond Blur's Fig. 8."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "metamerlab", "font.size": 9.0})
    figure, (by_size, parts, memory) = pyplot.subplots(
        1, 3, figsize=(12, 5.2), layout="constrained"
    )
    for name, where, colour, marker, dash in SERIES:
        rows = [one for one in lines if one.condition == name and where in ("", one.where)]
        if rows:
            by = rows[0].where
            by_size.plot(
                [row.edge_px for row in rows], [row.counted_ms for row in rows], dash,
                color=colour, marker=marker, label=name if by == "gpu" else f"{name} ({by})",
            )  # fmt: skip
    by_size.set(ylabel="ms per frame", title="time")
    rows = [line for line in lines if line.condition == "metamer" and line.where == "gpu"]
    edges = [row.edge_px for row in rows]
    blur = [line for line in lines if line.condition == "blur" and line.where == "gpu"]
    blur_edges = [row.edge_px for row in blur]
    for axes, whole, analysis, synthesis, plain in (
        (
            parts,
            [row.counted_ms for row in rows],
            [row.analysis_ms for row in rows],
            [row.synthesis_ms for row in rows],
            [row.counted_ms for row in blur],
        ),
        (
            memory,
            [sum(_mib(row)) for row in rows],
            [_mib(row)[0] for row in rows],
            [_mib(row)[1] for row in rows],
            [sum(_mib(row)) for row in blur],
        ),
    ):
        axes.plot(edges, whole, "-", color="#0072B2", marker="o", label="metamer")
        axes.plot(edges, analysis, "--", color="#56B4E9", marker="v", label="its analysis")
        axes.plot(edges, synthesis, "-.", color="#E69F00", marker="^", label="its synthesis")
        axes.plot(blur_edges, plain, "-", color="#D55E00", marker="s", label="blur")
    parts.set(ylabel="ms per frame", title="analysis and synthesis")
    memory.set(ylabel="MiB held beside the two pictures", title="memory")
    sizes = sorted({line.edge_px for line in lines})
    for axes in (by_size, parts, memory):
        axes.set(xscale="log", yscale="log", xlabel="edge of the picture, px")
        axes.set_xticks(sizes, [str(edge) for edge in sizes], minor=False)
        axes.set_xticks([], minor=True)
        axes.grid(visible=True, which="major", alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(
            frameon=False, fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14)
        )
    kind = TIMES[any(line.cpu_ms is not None for line in lines if line.where == "gpu")]
    figure.suptitle(f"{renderer}: {kind}", fontsize=9)
    figure.savefig(target, metadata={"Date": None} if target.suffix == ".svg" else None)
    pyplot.close(figure)
