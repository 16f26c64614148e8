"""Builds the report folder: HTML, JSON, tables, figures; whole or not at all."""

import json
import warnings as python_warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from analysis.columns import dictionary
from analysis.exclusions import FlowStep
from analysis.plain_csv import read_decisions
from analysis.plots import ONE_COLUMN_IN, TWO_COLUMNS_IN, save_figure
from analysis.preference import pairing_rows
from analysis.report import wording
from analysis.report.figures import ReportFigure, inline_svg, report_figures
from analysis.report.folder import whole_folder
from analysis.report.values import as_json
from analysis.settings import Settings, from_decisions, from_protocol
from analysis.study import BOOTSTRAP_SAMPLES, SEED, StudyResults, analyse
from analysis.tidy import Tidy, pwcmp_table, read_sessions, write_tables
from protocols.errors import StudyError
from protocols.hashing import Json, sha256_file
from protocols.revision import code_revision, package_version
from protocols.schema import StudyProtocol

Progress = Callable[[str, int, int], None]

HTML_NAME = "report.html"
JSON_NAME = "results.json"
_TEMPLATES = Path(__file__).parent
_LIBRARIES = ("numpy", "scipy", "pandas", "statsmodels", "matplotlib")


@dataclass(frozen=True)
class ReportPaths:
    """Where a report lies, and what a command should say about it."""

    html: Path
    json: Path
    warnings: tuple[str, ...]
    headline: str


@dataclass(frozen=True)
class _Source:
    """What was analysed, whichever way it came."""

    decisions: pd.DataFrame
    tidy: Tidy | None
    settings: Settings
    simulated: bool
    provenance: dict[str, Json]
    warnings: tuple[str, ...]


def report_sessions(
    folder: Path,
    protocol: StudyProtocol,
    out: Path,
    *,
    replace: bool = False,
    figure_files: bool = True,
    progress: Progress | None = None,
) -> ReportPaths:
    """Analyse every sitting below `folder` and write a report into `out`.

    Raises
    ------
    StudyError
        As `analysis.tidy.read_sessions`; also if exclusions leave no decision, or `out` holds
        something else.
    """
    tidy = read_sessions(folder, protocol, progress=progress)
    decisions = tidy.analysed
    if decisions.empty:
        lost = "; ".join(
            f"{step.step}: {step.sittings_out} sittings, {step.decisions_out} decisions out"
            for step in tidy.flow[1:]
            if step.sittings_out or step.decisions_out
        )
        raise StudyError(
            f"{folder}: at least one decision must remain after exclusions"
            f" (none of {tidy.flow[0].decisions_left} does: {lost or 'no main trial was decided'})"
        )
    sessions = tidy.sessions
    provenance: dict[str, Json] = {
        "protocol": protocol.study.name,
        "protocol_version": protocol.study.version,
        "protocol_sha256": protocol.sha256,
        "stimuli_sha256": protocol.stimuli_sha256,
        "manifest_sha256": sorted(set(sessions["manifest_sha256"])),
        "recorded_with": sorted(set(sessions["revision"])),
        "timing_evidence": sorted(set(sessions["timing_evidence"])),
        "journals_sha256": {
            str(name): str(digest)
            for name, digest in zip(sessions["session"], sessions["journal_sha256"], strict=True)
        },
    }
    source = _Source(
        decisions, tidy, from_protocol(protocol), tidy.simulated, provenance, tidy.warnings
    )
    return _write(source, out, replace=replace, figure_files=figure_files, progress=progress)


def report_decisions(
    path: Path,
    out: Path,
    *,
    protocol: StudyProtocol | None = None,
    alpha: float = 0.05,
    margin: float = 0.1,
    replace: bool = False,
    figure_files: bool = True,
    progress: Progress | None = None,
) -> ReportPaths:
    """Analyse a table of decisions (`analysis import` made it, or another tool).

    A protocol, where given, names methods, primary comparison and rules; its exclusions are
    not applied, because a plain table does not hold what they need.
    """
    decisions = read_decisions(path)
    decisions = decisions[(decisions["included"] == 1) & (decisions["kind"] == "main")]
    decisions = decisions.reset_index(drop=True)
    if decisions.empty:
        raise StudyError(f"{path}: must hold at least one main decision that is included")
    settings = from_decisions(decisions, path.stem, alpha=alpha, margin=margin)
    notes = ["imported table: no record of timing, gaze or exclusions can be checked"]
    if protocol is not None:
        settings = from_protocol(protocol)
        unknown = sorted(
            (set(decisions["first"]) | set(decisions["second"])) - set(settings.methods)
        )
        if unknown:
            raise StudyError(
                f"{path}: methods must be those of the protocol"
                f" ({', '.join(settings.methods)}) (got {', '.join(unknown)})"
            )
        if not any(
            len(pairing_rows(decisions, method, against)) for method, against in settings.pairings
        ):
            raise StudyError(f"{path}: must compare at least one of the protocol's pairings")
        notes.append("the protocol's exclusion rules were not applied to this table")
    source = _Source(
        decisions,
        None,
        settings,
        bool(decisions["simulated"].fillna(0).max()),
        {"table_sha256": sha256_file(path), "protocol_sha256": settings.protocol_sha256},
        tuple(notes),
    )
    return _write(source, out, replace=replace, figure_files=figure_files, progress=progress)


def _write(
    source: _Source, out: Path, *, replace: bool, figure_files: bool, progress: Progress | None
) -> ReportPaths:
    say = progress or (lambda _name, _done, _total: None)
    settings = source.settings
    with whole_folder(out, JSON_NAME, replace=replace) as work:
        say("analysing", 0, 0)
        results = analyse(
            source.decisions, settings, step=lambda name: say(f"analysing: {name}", 0, 0)
        )
        warnings = (*source.warnings, *results.warnings)
        figures = report_figures(source.decisions, results, settings, simulated=source.simulated)
        provenance = source.provenance | {
            "analysed_with": f"{package_version()} ({code_revision()})",
            "libraries": {name: metadata.version(name) for name in _LIBRARIES},
            "seed": SEED,
            "bootstrap_samples": BOOTSTRAP_SAMPLES,
        }
        with python_warnings.catch_warnings(record=True) as caught:
            python_warnings.simplefilter("always")
            drawn = _draw(figures, work, files=figure_files, say=say)
        warnings = (*warnings, *_font_notes(caught))
        say("writing", 0, 0)
        tables = work / "tables"
        tables.mkdir()
        _write_csv(source, results, tables)
        numbers: dict[str, Json] = {
            "format": 1,
            "simulated": source.simulated,
            "settings": as_json(settings),
            "results": as_json(results),
            "flow": as_json(source.tidy.flow if source.tidy else ()),
            "sessions": _rows(source.tidy.sessions) if source.tidy else [],
            "warnings": list(warnings),
            "provenance": provenance,
        }
        html = _html(source, results, drawn, warnings, provenance)
        (work / HTML_NAME).write_text(html, encoding="utf-8", newline="\n")
        text = json.dumps(numbers, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False)
        # Last: the folder is known as a report by this file.
        (work / JSON_NAME).write_text(text + "\n", encoding="utf-8", newline="\n")
    first = results.primary or results.table.cells[0]
    return ReportPaths(
        html=out / HTML_NAME,
        json=out / JSON_NAME,
        warnings=warnings,
        headline=wording.apa_preference(first, settings, adjusted=results.primary is None),
    )


def _draw(
    figures: tuple[ReportFigure, ...],
    work: Path,
    *,
    files: bool,
    say: Progress,
) -> list[dict[str, str | Markup]]:
    folder = work / "figures"
    if files:
        folder.mkdir()
    drawn: list[dict[str, str | Markup]] = []
    for number, figure in enumerate(figures):
        say("drawing figures", number, len(figures))
        entry: dict[str, str | Markup] = {"name": figure.name, "caption": figure.caption}
        for key, width in (("narrow", ONE_COLUMN_IN), ("wide", TWO_COLUMNS_IN)):
            made = figure.draw(width)
            entry[key] = Markup(inline_svg(made, f"{figure.name}-{key}", figure.caption))
            if files:
                columns = "1-column" if key == "narrow" else "2-column"
                save_figure(made, folder, f"{figure.name}-{columns}")
        drawn.append(entry)
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


def _write_csv(source: _Source, results: StudyResults, folder: Path) -> None:
    if source.tidy is not None:
        write_tables(source.tidy, folder)
    else:
        source.decisions.to_csv(folder / "decisions.csv", index=False, lineterminator="\n")
        pwcmp_table(source.decisions).to_csv(folder / "pwcmp.csv", index=False, lineterminator="\n")
        dictionary().to_csv(folder / "dictionary.csv", index=False, lineterminator="\n")
    cells = pd.DataFrame(
        [vars(cell) | {"warnings": "; ".join(cell.warnings)} for cell in results.table.cells]
    )
    cells.to_csv(folder / "preferences.csv", index=False, lineterminator="\n")


def _html(
    source: _Source,
    results: StudyResults,
    figures: list[dict[str, str | Markup]],
    warnings: tuple[str, ...],
    provenance: dict[str, Json],
) -> str:
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    settings, tidy = source.settings, source.tidy
    flow: tuple[FlowStep, ...] = tidy.flow if tidy else ()
    people = source.decisions["participant"].nunique()
    return environment.get_template("template.html").render(
        css=Markup((_TEMPLATES / "report.css").read_text(encoding="utf-8")),
        s=settings,
        r=results,
        w=wording,
        figures={str(figure["name"]): figure for figure in figures},
        simulated=source.simulated,
        warnings=warnings,
        provenance=provenance,
        flow=flow,
        sessions=_rows(tidy.sessions) if tidy else [],
        answers=_rows(tidy.answers) if tidy else [],
        people=people,
        decisions=len(source.decisions),
        methods_text=wording.methods_paragraph(
            settings,
            people=people,
            decisions=len(source.decisions),
            flow=flow,
            version=package_version(),
        ),
        apa=_apa(results, settings),
        notes=_notes(results, settings),
    )


def _notes(results: StudyResults, settings: Settings) -> dict[str, list[str]]:
    """Return the warnings of each section, equal ones merged."""

    def name(method: str, against: str, size: str) -> str:
        return wording.comparison(method, against, size, settings)

    biases = [bias for bias in (results.order, results.side) if bias is not None]
    return {
        "cells": wording.grouped(
            [(name(c.method, c.against, c.size), c.warnings) for c in results.table.cells]
        ),
        "models": wording.grouped([(name(*key), fit.warnings) for *key, fit in results.models]),
        "scales": wording.grouped(
            [
                (
                    "all sizes" if one.size == "all" else settings.label(one.size),
                    one.scale.warnings
                    + (one.intervals.warnings if one.intervals else ())
                    + one.observers.warnings
                    + one.warnings,
                )
                for one in results.scales
            ]
        ),
        "bias": wording.grouped([(bias.alternative, bias.warnings) for bias in biases]),
        "learning": wording.grouped([(about, t.warnings) for about, t in results.learning]),
        "reaction": wording.grouped(
            [(settings.label(t.condition), t.warnings) for t in results.reaction]
        ),
    }


def _apa(results: StudyResults, settings: Settings) -> list[str]:
    sentences = []
    if results.primary is not None:
        sentences.append(
            "Primary comparison: "
            + wording.apa_preference(results.primary, settings, adjusted=False)
        )
    sentences += [
        wording.apa_preference(cell, settings, adjusted=True) for cell in results.table.cells
    ]
    sentences += [
        wording.apa_model(method, against, fit, settings, size)
        for method, against, size, fit in results.models
    ]
    return sentences


def _rows(table: pd.DataFrame) -> list[Json]:
    """Return a table's rows as JSON objects; missing values become null."""
    plain = table.astype(object).where(table.notna(), None)
    return [as_json(row) for row in plain.to_dict("records")]
