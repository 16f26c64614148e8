"""Builds the report folder: HTML, JSON, tables, figures; whole or not at all."""

import dataclasses
import json
import warnings as python_warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

import pandas as pd
from markupsafe import Markup, escape

from analysis.data_dictionary import dictionary
from analysis.parts import PartFigure
from analysis.plots import ONE_COLUMN_IN, TWO_COLUMNS_IN, figure_bytes
from analysis.report.content import ReportContent, content_of
from analysis.report.exclusion_comparison import beside, beside_blocks
from analysis.report.report_page import report_page
from analysis.report.report_source import (
    Progress,
    ReportSource,
    TableSettings,
    from_sessions,
    from_table,
)
from analysis.report.result_table import DECIDES
from analysis.report.values import as_json, rows_as_json
from analysis.tables.table_files import write_table
from analysis.tidy import write_tables
from protocols.blocks import Figure, Paragraph
from protocols.disk.hashing import Json
from protocols.disk.result_folder import check_result, whole_folder
from protocols.latency import LatencySummary
from protocols.outside import inline_svg, json_bytes, page_bytes
from protocols.results import FORMAT, NAME
from protocols.revision import code_revision, package_version
from protocols.study_file.schema import StudyProtocol

HTML_NAME = "report.html"
_WIDTHS = {"narrow": (ONE_COLUMN_IN, "1-column"), "wide": (TWO_COLUMNS_IN, "2-column")}
FigureFiles = Literal["svg", "pdf", "png", "all", "none"]
"""Files of figures beside the page: of one format, at the width of two columns; or all, at both."""

_LIBRARIES = ("numpy", "scipy", "pandas", "statsmodels", "matplotlib")


@dataclass(frozen=True)
class ReportPaths:
    """Files of a report, and what a command should say about it."""

    html: Path
    json: Path
    content: ReportContent
    simulated: bool

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the data as a whole."""
        return self.content.warnings

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        return "SIMULATED data. " * self.simulated + self.content.headline


def report_sessions(
    folder: Path,
    study: StudyProtocol,
    out: Path,
    *,
    replace: bool = False,
    figure_files: FigureFiles = "svg",
    progress: Progress | None = None,
) -> ReportPaths:
    """Analyse every session below `folder` and write a report into `out`.

    Raises
    ------
    StudyError
        As `analysis.tidy.read_sessions`; also if exclusions leave no decision, or `out` holds
        something else.
    """
    check_result(out, replace=replace, reads=[folder])
    source = from_sessions(folder, study, progress)
    return write_report(
        source, folder, out, replace=replace, figure_files=figure_files, progress=progress
    )


def report_decisions(
    path: Path,
    out: Path,
    *,
    table: TableSettings | None = None,
    replace: bool = False,
    figure_files: FigureFiles = "svg",
    progress: Progress | None = None,
) -> ReportPaths:
    """Analyse a table of decisions (`analysis import` made it, or another tool)."""
    check_result(out, replace=replace, reads=[path])
    source = from_table(path, table or TableSettings())
    return write_report(
        source, path, out, replace=replace, figure_files=figure_files, progress=progress
    )


def write_report(
    source: ReportSource,
    read: Path,
    out: Path,
    *,
    replace: bool = False,
    figure_files: FigureFiles = "svg",
    progress: Progress | None = None,
) -> ReportPaths:
    """Write the report of a source into `out`; `read` is where the source lies."""
    say = progress or (lambda _name, _done, _total: None)
    with whole_folder(out, replace=replace, reads=[read]) as work:
        say("analysing", 0, 0)
        content = content_of(source, lambda name: say(f"analysing: {name}", 0, 0))
        provenance = source.provenance | {
            "analysed_with": f"{package_version()} ({code_revision()})",
            "libraries": {name: metadata.version(name) for name in _LIBRARIES},
            **source.analysis.constants,
        }
        with python_warnings.catch_warnings(record=True) as caught:
            python_warnings.simplefilter("always")
            drawn = _draw(
                content.figures, work, simulated=source.simulated, files=figure_files, say=say
            )
        content = dataclasses.replace(content, warnings=(*content.warnings, *_font_notes(caught)))
        say("writing", 0, 0)
        tables = work / "tables"
        tables.mkdir()
        _write_csv(source, content, tables)
        if content.scripts:
            (work / "scripts").mkdir()
        for name, text in content.scripts.items():
            (work / "scripts" / name).write_bytes(page_bytes(text))
        both = beside(source)
        numbers: dict[str, Json] = {
            "format": FORMAT,
            "simulated": source.simulated,
            "settings": source.plan.said(),
            "results": {**content.numbers},
            "deciding": {
                name: sorted({one for told in table[DECIDES] for one in told.split()})
                for name, table in content.tables.items()
                if DECIDES in table
            },
            "flow": as_json(source.tidy.flow if source.tidy else ()),
            "participants": as_json(source.tidy.participants if source.tidy else None),
            "without_exclusions": as_json(both),
            "sessions": rows_as_json(source.tidy.sessions) if source.tidy else [],
            "warnings": list(content.warnings),
            "provenance": provenance,
        }
        quality = (*_latency(source), *beside_blocks(both))
        html = report_page(source, content, drawn, provenance, quality)
        (work / HTML_NAME).write_bytes(page_bytes(html))
        text = json.dumps(numbers, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False)
        (work / NAME).write_bytes(json_bytes(text + "\n"))
    return ReportPaths(
        html=out / HTML_NAME,
        json=out / NAME,
        content=content,
        simulated=source.simulated,
    )


def _latency(source: ReportSource) -> tuple[Paragraph, ...]:
    """Return the age of gaze in frames that followed it, as a paragraph; nothing where none did."""
    if source.tidy is None or not source.tidy.live:
        return ()
    words = LatencySummary.of(source.tidy.live).words()
    return (Paragraph(f"Frames that followed the gaze, {words}."),)


def _draw(
    figures: Sequence[PartFigure],
    work: Path,
    *,
    simulated: bool,
    files: FigureFiles,
    say: Progress,
) -> dict[str, Figure]:
    folder = work / "figures"
    if files != "none":
        folder.mkdir()
    mark = Markup(" <strong>Simulated data.</strong>") * simulated
    drawn = {}
    for number, figure in enumerate(figures):
        say("drawing figures", number, len(figures))
        svgs = {}
        for key, (width_in, columns) in _WIDTHS.items():
            made = figure.draw(width_in=width_in)
            svg = figure_bytes(made, "svg")
            for kind in ("svg", "pdf", "png"):
                if files == "all" or (files == kind and key == "wide"):
                    data = svg if kind == "svg" else figure_bytes(made, kind)
                    (folder / f"{figure.name}-{columns}.{kind}").write_bytes(data)
            svgs[key] = Markup(inline_svg(svg, f"{figure.name}-{key}", figure.caption))
        caption = escape(figure.caption) + mark
        drawn[figure.name] = Figure(caption, svgs.get("wide", ""), svgs.get("narrow", ""))
    say("drawing figures", len(figures), len(figures))
    return drawn


def _font_notes(caught: list[python_warnings.WarningMessage]) -> tuple[str, ...]:
    """Turn matplotlib's warnings of missing letters into one note; pass others on."""
    missing = [one for one in caught if "missing from font" in str(one.message)]
    for one in caught:
        if one not in missing:
            python_warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    if not missing:
        return ()
    return (
        "some letters of the labels are in no font of this machine and show as boxes in figures;"
        " install fonts for their script (Noto), then run this again",
    )


def _write_csv(source: ReportSource, content: ReportContent, folder: Path) -> None:
    tables: dict[str, pd.DataFrame] = {}
    if source.tidy is not None and source.study is not None:
        write_tables(source.tidy, source.study, folder)
        tables |= source.analysis.tidy_tables(source.decisions)
    else:
        columns = source.analysis.columns_of(source.decisions)
        tables["decisions.csv"] = source.decisions
        tables["dictionary.csv"] = dictionary({"decisions": columns})
    tables |= content.tables
    for name, table in tables.items():
        write_table(table, folder / name)
