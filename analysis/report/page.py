"""The page of a report: one HTML file that needs no other."""

from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from analysis.exclusions import FlowStep
from analysis.report import wording
from analysis.report.source import Source
from analysis.report.values import rows_as_json
from analysis.tasks.blocks import Block
from protocols.hashing import Json
from protocols.revision import package_version

_TEMPLATES = Path(__file__).parent


def report_page(
    source: Source,
    results: object,
    figures: list[dict[str, str | Markup]],
    warnings: tuple[str, ...],
    provenance: dict[str, Json],
    quality: Sequence[Block] = (),
    first: Sequence[Block] = (),
) -> str:
    """Return the page; `figures` hold a name, a caption, and SVG under `narrow` and `wide`.

    `quality` are blocks that end the section on data quality, `first` stand before all others.
    """
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    analysis, settings, tidy = source.analysis, source.settings, source.tidy
    flow: tuple[FlowStep, ...] = tidy.flow if tidy else ()
    people = source.decisions["participant"].nunique()
    return environment.get_template("template.html").render(
        css=Markup((_TEMPLATES / "report.css").read_text(encoding="utf-8")),
        s=settings,
        w=wording,
        counted=analysis.counted(settings),
        lead=[*first, *analysis.lead(results, settings)],
        sections=analysis.sections(results, settings),
        figures={str(figure["name"]): figure for figure in figures},
        simulated=source.simulated,
        warnings=warnings,
        provenance=provenance,
        flow=flow,
        quality=quality,
        sessions=rows_as_json(tidy.sessions) if tidy else [],
        answers=rows_as_json(tidy.answers) if tidy else [],
        people=people,
        decisions=len(source.decisions),
        methods_text=analysis.methods(
            results,
            settings,
            people=people,
            decisions=len(source.decisions),
            flow=flow,
            version=package_version(),
        ),
        sentences=analysis.sentences(results, settings),
    )
