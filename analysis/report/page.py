"""The page of a report: one HTML file that needs no other."""

from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from analysis.exclusions import FlowStep
from analysis.report import wording
from analysis.report.blocks import Block
from analysis.report.content import Content
from analysis.report.participants import participant_blocks
from analysis.report.source import Source
from analysis.report.values import rows_as_json
from protocols.hashing import Json

_TEMPLATES = Path(__file__).parent


def report_page(
    source: Source,
    content: Content,
    figures: list[dict[str, str | Markup]],
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
    tidy = source.tidy
    flow: tuple[FlowStep, ...] = tidy.flow if tidy else ()
    return environment.get_template("template.html").render(
        css=Markup((_TEMPLATES / "report.css").read_text(encoding="utf-8")),
        s=source.settings,
        w=wording,
        content=content,
        first=first,
        figures={str(figure["name"]): figure for figure in figures},
        simulated=source.simulated,
        provenance=provenance,
        flow=flow,
        people=participant_blocks(tidy),
        quality=quality,
        sessions=rows_as_json(tidy.sessions) if tidy else [],
        answers=rows_as_json(tidy.answers) if tidy else [],
    )
