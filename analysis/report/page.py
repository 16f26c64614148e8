"""The page of a report: one HTML file that needs no other."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from analysis.exclusions import FlowStep
from analysis.report import wording
from analysis.report.source import Source
from analysis.report.values import rows_as_json
from analysis.settings import Settings
from analysis.study import StudyResults
from protocols.hashing import Json
from protocols.revision import package_version

_TEMPLATES = Path(__file__).parent


def report_page(
    source: Source,
    results: StudyResults,
    figures: list[dict[str, str | Markup]],
    warnings: tuple[str, ...],
    provenance: dict[str, Json],
) -> str:
    """Return the page; `figures` hold a name, a caption, and SVG under `narrow` and `wide`."""
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
        sessions=rows_as_json(tidy.sessions) if tidy else [],
        answers=rows_as_json(tidy.answers) if tidy else [],
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
