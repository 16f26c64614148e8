"""Content of a report, whichever way it came: page, printed text, tables and figures.

And its participants as CONSORT asks: a table of their flow, a sentence, and what they said of them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import pandas as pd

from analysis.parts import PartFigure, Presentation, computed, with_added
from analysis.parts.places import PlacesPart
from analysis.report.report_source import ReportSource, recording_sentence
from analysis.report.values import as_json
from analysis.report.wording import left_out_sentence
from analysis.tidy import TidyTables
from protocols.blocks import Block, Box, CopyText, Folded, Paragraph, Section, TableBlock
from protocols.disk.hashing import Json
from protocols.errors import StudyError, count_of
from protocols.revision import package_version

_OTHERS = (
    "These decide nothing: the deciding p of each comparison stands above. Each says why it is"
    " here; where they disagree, the deciding test is the result."
)


@dataclass(frozen=True)
class ReportContent:
    """All that is said of a source.

    Attributes
    ----------
    counted : str
        What was analysed, in a line.
    lead, sections, others
        Blocks of the page; `others` is the section of analyses that do not decide, if any.
    methods : str
        A paragraph; `sentences` are results, the most important one is `headline`.
    tables : mapping of file name to DataFrame
    scripts : mapping of file name to text
    numbers : mapping of part to its numbers
    warnings : tuple of str
        What is odd about the data as a whole.
    """

    counted: str
    lead: tuple[Block, ...]
    sections: tuple[Section, ...]
    others: tuple[Section, ...]
    figures: tuple[PartFigure, ...]
    methods: str
    sentences: tuple[str, ...]
    headline: str
    tables: Mapping[str, pd.DataFrame]
    scripts: Mapping[str, str]
    numbers: Mapping[str, Json]
    warnings: tuple[str, ...]


def content_of(
    source: ReportSource, step: Callable[[str], None] = lambda _name: None
) -> ReportContent:
    """Analyse a source, part by part."""
    analysis, plan, decisions = source.analysis, source.plan, source.decisions
    every = with_added(analysis.parts_of(plan))
    parts = tuple(one for one in every if not source.only or one.name in source.only)
    parts = (*parts, PlacesPart(parts, source.tidy.sessions if source.tidy else None))
    found, notes = computed(parts, analysis.table(decisions, plan), plan, step)
    if not {*found} - {PlacesPart.name}:
        raise StudyError(
            f"{plan.study}: must hold what {analysis.kind} is about"
            f" ({'; '.join(notes) or 'it does not'})"
        )
    shown = [(part, part.show(found[part.name], plan)) for part in parts if part.name in found]
    people = count_of(decisions["participant"].nunique(), "participant")
    counted = f"{len(decisions)} {analysis.task} of {people}"
    recorded: list[str] = []
    if source.tidy is not None:
        recorded = [left_out_sentence(source.tidy.flow), recording_sentence(source.tidy.sessions)]
    said = Presentation(methods=" ".join([f"We analysed {counted}.", *filter(None, recorded)]))
    sections: list[Section] = []
    figures: list[PartFigure] = []
    others: list[Block] = []
    for place, (part, one) in enumerate(shown):
        if part.beside:
            inside = (*one.blocks, CopyText(tuple(one.sentences)))
            one = replace(one, blocks=(), sentences=(), others=(Folded(*part.beside, inside),))
            shown[place] = part, one
        name, title = part.section
        for section in (Section(name, one.title or title, title, tuple(one.blocks)), *one.further):
            _append(sections, section)
        others += one.others
        figures += (figure.marked(simulated=source.simulated) for figure in one.figures)
    people_sentence = Presentation(sentences=participant_sentence(source.tidy))
    told = (said, *(one for _, one in shown), people_sentence)
    sentences = tuple(sentence for one in told for sentence in one.sentences)
    headline = next(filter(None, (*(one.headline for one in told), *sentences)), "")
    lead = tuple(block for one in told for block in one.lead)
    version = f"Analyses were run with metamerlab {package_version()}."
    return ReportContent(
        counted=f"{counted} · {plan.counted}",
        lead=lead or (Box("Result", headline),),
        sections=tuple(one for one in sections if one.blocks),
        others=(Section.of("Other analyses", _OTHERS, *others, name="other"),) * bool(others),
        figures=tuple(figures),
        methods=" ".join([*(one.methods for one in told if one.methods), version]),
        sentences=sentences,
        headline=headline,
        tables={name: table for one in told for name, table in one.tables.items()},
        scripts={name: text for one in told for name, text in one.scripts.items()},
        numbers={name: as_json(one) for name, one in found.items()},
        warnings=(
            *source.warnings,
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


def participant_blocks(tidy: TidyTables | None) -> tuple[Block, ...]:
    """Return the flow of participants, and answers to questions with choices; none of a table."""
    return () if tidy is None else tuple(_blocks(tidy))


def _blocks(tidy: TidyTables) -> Iterator[Block]:
    before = {"began": "of these ", "completed the session": "stopped: ", "analysed": "left out: "}
    yield TableBlock.of(
        "Participants, from the first page to the analysis",
        (("Step", "l c"), ("Participants", "")),
        [
            (f"{before.get(stage, '')}{why}" if why else stage, str(count))
            for stage, why, count in tidy.participants.steps
        ],
    )
    found = tidy.demographics
    if found.empty:
        return
    yield TableBlock.of(
        "Answers of participants about themselves",
        (("Question", "l c"), ("Answer", "l"), ("Participants", ""), ("Analysed", "")),
        [
            (asked if place == rows.index[0] else "", answer, str(every), str(kept))
            for _, rows in found.groupby("question", sort=False)
            for place, asked, answer, every, kept in rows.drop(columns="question").itertuples()
        ],
    )
    yield Paragraph(
        "Closing questions with choices. Few people may be recognised by such counts together.",
        muted=True,
    )


def participant_sentence(tidy: TidyTables | None) -> tuple[str, ...]:
    """Return the flow of participants in a sentence; none of a table."""
    if tidy is None:
        return ()
    found = tidy.participants
    steps = found.steps

    def reasons(stage: str, form: str) -> str:
        listed = [f"{why}: {count}" for at, why, count in steps if at == stage and why]
        return form.format(", ".join(listed)) if listed else ""

    agreed = "consented" if found.consent_asked else "took part"
    return (
        f"{count_of(found.began, 'participant')} began{reasons('began', ' ({})')},"
        f" {found.consented} {agreed}, {found.completed} completed the session"
        f"{reasons('completed the session', ' (stopped: {})')}, and {found.analysed}"
        f" {'was' if found.analysed == 1 else 'were'} analysed"
        f"{reasons('analysed', ' (left out: {})')}.",
    )
