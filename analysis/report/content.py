"""What a report says, whichever door it came by: page, printed text, tables and figures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import pandas as pd

from analysis.parts import computed
from analysis.parts.added import added_parts
from analysis.report.blocks import Block, Paragraph, ReportFigure, Section
from analysis.report.source import Source
from analysis.report.values import as_json
from protocols.errors import StudyError
from protocols.hashing import Json
from protocols.prose import count_of
from protocols.revision import package_version

_NOTHING = Paragraph("The table does not hold what this takes.")


@dataclass(frozen=True)
class Content:
    """All that is said of a source.

    Attributes
    ----------
    counted : str
        What was analysed, in a line.
    lead, sections
        Blocks of the page.
    methods : str
        A paragraph; `sentences` are results, the most important one is `headline`.
    tables : mapping of file name to DataFrame
    numbers : mapping of part to its numbers
    planned_p : float or None
        Of the planned test, which looks at unfinished data test.
    warnings : tuple of str
        What is odd about the data as a whole.
    """

    counted: str
    lead: tuple[Block, ...]
    sections: tuple[Section, ...]
    figures: tuple[ReportFigure, ...]
    methods: str
    sentences: tuple[str, ...]
    headline: str
    tables: Mapping[str, pd.DataFrame]
    numbers: Mapping[str, Json]
    planned_p: float | None
    warnings: tuple[str, ...]


def content_of(source: Source, step: Callable[[str], None] = lambda _name: None) -> Content:
    """Analyse a source: what its kind of analysis says by itself, and each of its parts."""
    analysis, plan, decisions = source.analysis, source.settings, source.decisions
    own = None if source.only else analysis.analyse(decisions, plan, step)
    held = as_json(own)
    assert held is None or isinstance(held, dict)
    numbers = held or {}
    taken = {*numbers, *(part.name for part in analysis.parts)}
    parts = (*analysis.parts, *added_parts(taken))
    parts = tuple(one for one in parts if not source.only or one.name in source.only)
    found, notes = computed(parts, analysis.table(decisions, plan), plan, step)
    shown = {part.name: part.show(found[part.name], plan) for part in parts if part.name in found}
    sections = list(analysis.sections(own, plan))
    for part in parts:
        if part.name in shown:
            name, title = part.section
            own_section = Section(name, title, title, tuple(shown[part.name].blocks))
            for section in (own_section, *shown[part.name].further):
                _append(sections, section)
    sections = [one if one.blocks else replace(one, blocks=(_NOTHING,)) for one in sections]
    if own is None and not found:
        raise StudyError(
            f"{plan.study}: must hold what {analysis.kind} is about"
            f" ({'; '.join(notes) or 'it does not'})"
        )
    people = decisions["participant"].nunique()
    tidy = source.tidy
    methods = analysis.methods(
        own,
        plan,
        people=people,
        decisions=len(decisions),
        flow=tidy.flow if tidy else (),
    )
    sentences = (
        *analysis.sentences(own, plan),
        *(sentence for one in shown.values() for sentence in one.sentences),
    )
    said = (
        analysis.headline(own, plan),
        *(one.headline for one in shown.values()),
        *sentences,
    )
    planned = (
        None if own is None else analysis.planned_p(own),
        *(part.planned_p(found[part.name]) for part in parts if part.name in found),
    )
    tables = dict(analysis.tables(decisions, own))
    for one in shown.values():
        tables |= one.tables
    return Content(
        counted=f"{len(decisions)} {analysis.task} of {count_of(people, 'participant')}"
        f" · {analysis.counted(plan)}",
        lead=(
            *analysis.lead(own, plan),
            *(block for one in shown.values() for block in one.lead),
        ),
        sections=tuple(sections),
        figures=(
            *analysis.figures(decisions, own, plan, simulated=source.simulated),
            *(
                figure.marked(simulated=source.simulated)
                for one in shown.values()
                for figure in one.figures
            ),
        ),
        methods=" ".join(
            [
                methods,
                *(one.methods for one in shown.values() if one.methods),
                f"Analyses were run with metamerlab {package_version()}.",
            ]
        ),
        sentences=sentences,
        headline=next(filter(None, said), ""),
        tables=tables,
        numbers=numbers | {name: as_json(one) for name, one in found.items()},
        planned_p=next((p for p in planned if p is not None), None),
        warnings=(
            *source.warnings,
            *(analysis.warnings(own) if own is not None else ()),
            *notes,
            *(note for one in found.values() for note in one.notes),
        ),
    )


def _append(sections: list[Section], new: Section) -> None:
    """Add blocks to the section of that name, or a new one at the end."""
    for place, section in enumerate(sections):
        if section.name == new.name:
            sections[place] = replace(section, blocks=(*section.blocks, *new.blocks))
            return
    sections.append(new)
