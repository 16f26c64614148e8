"""Tables in the layout of [MI]'s Tables 1 and 2: a row per scene, a column per method, means."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from protocols.errors import StudyError, did_you_mean
from protocols.outside import markdown, safe_cell
from stimuli.score.measure_clips import ScoreResults
from stimuli.score.metrics import FRAME, HOLES, RINGS, Metric

OURS, RIVAL = "metameric", "push-pull"
RIVALS = (RIVAL, "push-pull-depth")
"""Methods that ours is compared with in words: the paper's rival, and what depth alone buys."""
PAPERS = {
    ("lpips", HOLES): "Table 1",
    ("fvvdp-1.0", HOLES): "Table 2",
    ("fvvdp", HOLES): "Table 2, current parameters",
}
BY_RING = "rings"
REGION_TEXT = {
    BY_RING: "in rings around the gaze, mean of the scenes",
    HOLES: "inside the disocclusions, all other pixels set to the reference",
    FRAME: "over the whole frame",
}


@dataclass(frozen=True)
class ScoreTable:
    """One metric in one region, for one size.

    Attributes
    ----------
    rows : tuple of (scene, values)
        A value per method, None where there is none; the last row holds the means.
    labels : mapping
        What people read in place of names; see `Subjects`.
    """

    metric: Metric
    region: str
    size: str
    methods: tuple[str, ...]
    rows: tuple[tuple[str, tuple[float | None, ...]], ...]
    labels: Mapping[str, str] = field(default_factory=dict)

    def shown(self, name: str) -> str:
        """Return the words that people read for a name: its label where it has one."""
        return self.labels.get(name, name)

    @property
    def heads(self) -> tuple[str, ...]:
        """Headings of the methods, as people read them."""
        return tuple(map(self.shown, self.methods))

    @property
    def title(self) -> str:
        """Title: the number of the paper's table, if it is one of them, and what is shown."""
        paper = PAPERS.get((self.metric.name, self.region))
        unit = f", {self.metric.unit}" if self.metric.unit else ""
        text = f"{self.metric.label}{unit} ({self.metric.arrow}) {REGION_TEXT[self.region]}"
        size = f"; size {self.shown(self.size)}" if self.size else ""
        return f"{paper}: {text}{size}" if paper else text + size

    def text(self, value: float | None) -> str:
        """Print one value with the metric's digits."""
        return "-" if value is None else f"{value:.{self.metric.digits}f}"

    def cells(self, values: tuple[float | None, ...], strong: Callable[[str], str]) -> list[str]:
        """Return a row's values as text, the best of them made `strong`, if there are several."""
        badness = [None if one is None else self.printed_badness(one) for one in values]
        there = [one for one in badness if one is not None]
        best = min(there) if len(there) > 1 else None
        return [
            self.text(value) if own is None or own != best else strong(self.text(value))
            for value, own in zip(values, badness, strict=True)
        ]

    def printed_badness(self, value: float) -> float:
        """Rank by what is printed: equal digits are equally good."""
        return self.metric.badness(float(self.text(value)))

    def markdown(self) -> str:
        """Render for a document; the best of each row in bold."""
        lines = [
            "| | " + " | ".join(map(markdown, self.heads)) + " |",
            "| --- |" + " ---: |" * len(self.methods),
        ]
        for scene, values in self.rows:
            cells = self.cells(values, "**{}**".format)
            lines.append(f"| {markdown(self.shown(scene))} | " + " | ".join(cells) + " |")
        return "\n".join(lines)


def tables_latex(tables: tuple[ScoreTable, ...]) -> str:
    """Return all tables for a paper, the best of each row in bold; needs the package booktabs."""
    return "\n".join(map(_latex, tables))


def _latex(table: ScoreTable) -> str:
    lines = [
        r"\begin{table}",
        rf"\caption{{{_escaped(table.title)}}}",
        rf"\begin{{tabular}}{{l{'r' * len(table.methods)}}}",
        r"\toprule",
        " & ".join(["", *map(_escaped, table.heads)]) + r" \\",
        r"\midrule",
    ]
    for scene, values in table.rows:
        cells = table.cells(values, r"\textbf{{{}}}".format)
        lines += [r"\midrule"] if scene == "mean" and len(table.rows) > 1 else []
        lines.append(" & ".join([_escaped(table.shown(scene)), *cells]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}"]) + "\n"


def _escaped(text: str) -> str:
    """Text without what LaTeX would obey."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(char, rf"\{char}" if char in "&%$#_{}" else char) for char in text)


def tables_csv(tables: tuple[ScoreTable, ...]) -> str:
    """Return all tables with the digits printed: a line per row, a column per method, by name."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    methods = list(dict.fromkeys(method for table in tables for method in table.methods))
    names = map(safe_cell, methods)
    writer.writerow(("metric", "unit", "better", "region", "size", "scene", *names))
    for table in tables:
        metric = table.metric
        for scene, values in table.rows:
            by_method = dict(zip(table.methods, values, strict=True))
            cells = ("" if by_method.get(m) is None else table.text(by_method[m]) for m in methods)
            what = (metric.name, metric.unit, metric.better, table.region, table.size)
            writer.writerow((*what, safe_cell(scene), *cells))
    return buffer.getvalue()


def method_order(results: ScoreResults) -> tuple[str, ...]:
    """Ours, push-pull, then the others as the study names them."""
    names = list(dict.fromkeys(subject.method for subject in results.subjects.items))
    names.sort(key=lambda name: (name != OURS, name != RIVAL))
    return tuple(names)


def all_tables(results: ScoreResults) -> tuple[ScoreTable, ...]:
    """Return every table that has a number: the paper's first, then by metric and region."""
    methods = method_order(results)
    sizes = tuple(dict.fromkeys(subject.size for subject in results.subjects.items))
    keys = [(metric, region) for metric in results.metrics for region in metric.regions]
    keys.sort(key=lambda key: list(PAPERS).index((key[0].name, key[1]))
              if (key[0].name, key[1]) in PAPERS else len(PAPERS))  # fmt: skip
    tables = [
        _table(results, metric, region, size, methods) for metric, region in keys for size in sizes
    ]
    tables += [_by_ring(results, metric, size, methods)
               for metric in results.metrics for size in sizes]  # fmt: skip
    return tuple(
        table
        for table in tables
        if any(value is not None for _, values in table.rows for value in values)
    )


def _table(
    results: ScoreResults, metric: Metric, region: str, size: str, methods: tuple[str, ...]
) -> ScoreTable:
    places = {(item.scene, item.method): item for item in results.subjects.items
              if item.size == size}  # fmt: skip
    rows: list[tuple[str, tuple[float | None, ...]]] = []
    for scene in dict.fromkeys(scene for scene, _ in places):
        found = (places.get((scene, method)) for method in methods)
        rows.append((scene, tuple(
            None if item is None else results.value(item, metric, region) for item in found
        )))  # fmt: skip
    if len(rows) > 1:
        rows.append(("mean", tuple(_mean([values[k] for _, values in rows])
                                   for k in range(len(methods)))))  # fmt: skip
    return ScoreTable(metric, region, size, methods, tuple(rows), results.subjects.labels)


def _by_ring(
    results: ScoreResults, metric: Metric, size: str, methods: tuple[str, ...]
) -> ScoreTable:
    items = [item for item in results.subjects.items if item.size == size]
    rows = tuple(
        (ring, tuple(_mean([results.value(item, metric, ring) for item in items
                            if item.method == method]) for method in methods))
        for ring in RINGS
        if any(results.value(item, metric, ring) is not None for item in items)
    )  # fmt: skip
    return ScoreTable(metric, BY_RING, size, methods, rows, results.subjects.labels)


def _mean(column: list[float | None]) -> float | None:
    """The mean of a column that is whole: means of different scenes are not comparable."""
    there = [value for value in column if value is not None]
    return sum(there) / len(there) if there and len(there) == len(column) else None


@dataclass(frozen=True)
class PairedMethods:
    """Comparison of one method with another by one table.

    Attributes
    ----------
    lost, tied : tuple of str
        Scenes in which `method` is worse, and those in which it is as good, by the digits printed.
    """

    table: ScoreTable
    method: str
    against: str
    means: tuple[float, float]
    scenes: int
    lost: tuple[str, ...]
    tied: tuple[str, ...] = ()

    @property
    def loses_on_average(self) -> bool:
        """True if the mean is worse, by the digits printed."""
        ours, theirs = (self.table.printed_badness(value) for value in self.means)
        return ours > theirs

    @property
    def sentence(self) -> str:
        """Say it plainly."""
        ours, theirs = (self.table.text(value) for value in self.means)
        verdict = "worse than" if self.loses_on_average else "better than"
        if len({self.table.printed_badness(value) for value in self.means}) == 1:
            verdict = "as good as"
        where = "in holes" if self.table.region == HOLES else "over the frame"
        won = self.scenes - len(self.lost) - len(self.tied)
        equal = f", equal in {len(self.tied)}" if self.tied else ""
        method, against = map(self.table.shown, (self.method, self.against))
        return (
            f"{self.table.metric.label} {where}: {method} {ours} is {verdict}"
            f" {against} {theirs} on average, and better in {won} of {self.scenes} scenes"
            f"{equal}"
        )


def duels(
    tables: tuple[ScoreTable, ...], method: str = OURS, against: str = RIVAL
) -> tuple[PairedMethods, ...]:
    """Compare two methods by every table that has both."""
    found = []
    for table in tables:
        if table.region == BY_RING or not {method, against} <= set(table.methods):
            continue
        ours, theirs = table.methods.index(method), table.methods.index(against)
        pairs = [
            (scene, a, b)
            for scene, values in table.rows
            if scene != "mean" or len(table.rows) == 1
            if (a := values[ours]) is not None and (b := values[theirs]) is not None
        ]
        if not pairs:
            continue
        behind = {
            scene: table.printed_badness(a) - table.printed_badness(b) for scene, a, b in pairs
        }
        lost = tuple(scene for scene, by in behind.items() if by > 0)
        tied = tuple(scene for scene, by in behind.items() if by == 0)
        means = (
            sum(a for _, a, _ in pairs) / len(pairs),
            sum(b for _, _, b in pairs) / len(pairs),
        )
        found.append(PairedMethods(table, method, against, means, len(pairs), lost, tied))
    return tuple(found)


def all_duels(
    tables: tuple[ScoreTable, ...], focus: str | None = None
) -> tuple[PairedMethods, ...]:
    """Compare `focus` with every other method; left out: ours with each of `RIVALS` that is there.

    Of one scene the table says all: it gets no comparison without a focus.

    Raises
    ------
    StudyError
        If no table has the method `focus`.
    """
    if focus is None:
        found = (duel for against in RIVALS for duel in duels(tables, OURS, against))
        return tuple(duel for duel in found if duel.scenes > 1)
    methods = list(dict.fromkeys(method for table in tables for method in table.methods))
    check_focus(focus, methods)
    return tuple(
        duel for against in methods if against != focus for duel in duels(tables, focus, against)
    )


def check_focus(focus: str, methods: Sequence[str]) -> None:
    """Refuse a method that is not scored.

    Raises
    ------
    StudyError
        With those that are.
    """
    if focus not in methods:
        raise StudyError(
            f"--focus: must be a method of the clips, {', '.join(methods)} (got {focus!r})"
            f"{did_you_mean(focus, methods)}"
        )


def summary(
    results: ScoreResults, region: str
) -> tuple[tuple[str, ...], list[tuple[str, list[str]]]]:
    """Return heads and rows of one table for a terminal: a line per method, a mean per metric."""
    metrics = [metric for metric in results.metrics if region in metric.regions]
    rows = []
    for method in method_order(results):
        cells = []
        for metric in metrics:
            mean = _mean(results.values_of(method, metric, region))
            cells.append("-" if mean is None else f"{mean:.{metric.digits}f}")
        rows.append((results.subjects.shown(method), cells))
    return tuple(metric.name for metric in metrics), rows
