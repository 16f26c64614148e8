"""The page of a report: one HTML file that needs no other."""

from collections.abc import Sequence

from markupsafe import Markup

from analysis.exclusions import FlowStep
from analysis.report import wording
from analysis.report.blocks import Block
from analysis.report.content import Content
from analysis.report.participants import participant_blocks
from analysis.report.source import Source
from analysis.report.values import rows_as_json
from protocols.hashing import Json
from protocols.html_page import html_page


def report_page(
    source: Source,
    content: Content,
    figures: list[dict[str, str | Markup]],
    provenance: dict[str, Json],
    quality: Sequence[Block] = (),
) -> str:
    """Return the page; `figures` hold a name, a caption, and SVG under `narrow` and `wide`.

    `quality` are blocks that end the section on data quality.
    """
    tidy = source.tidy
    flow: tuple[FlowStep, ...] = tidy.flow if tidy else ()
    return html_page(
        "analysis.report",
        "template.html",
        s=source.settings,
        w=wording,
        content=content,
        figures={str(figure["name"]): figure for figure in figures},
        simulated=source.simulated,
        provenance=provenance,
        flow=flow,
        people=participant_blocks(tidy),
        quality=quality,
        sessions=rows_as_json(tidy.sessions) if tidy else [],
        answers=rows_as_json(tidy.answers) if tidy else [],
    )
