"""The page of a report: one HTML file that needs no other."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from analysis.report import wording
from analysis.report.content import ReportContent, participant_blocks
from analysis.report.report_source import ReportSource
from analysis.report.values import rows_as_json
from analysis.tidy import TidyTables
from protocols.blocks import (
    Block,
    Cautions,
    CopyText,
    Figure,
    Heading,
    Paragraph,
    Section,
    TableBlock,
    html_page,
)
from protocols.disk.hashing import Json


def report_page(
    source: ReportSource,
    content: ReportContent,
    figures: Mapping[str, Figure],
    provenance: Mapping[str, Json],
    quality: Sequence[Block] = (),
) -> str:
    """Return the page; `quality` are blocks that end the section on data quality."""
    plan, simulated = source.plan, source.simulated
    protocol = (
        Markup(" · protocol {} <code>{}</code>").format(plan.study, plan.protocol_sha256[:12])
        if plan.protocol_sha256
        else ""
    )
    odd = tuple(one for one in content.warnings if one not in source.read)
    mark = Markup("<strong>[Simulated data, not to be published as a study.]</strong> ")
    return html_page(
        "SIMULATED: " * simulated + plan.title,
        heading=plan.title,
        under=Markup("{}{}").format(content.counted, protocol),
        stamp="SIMULATED DATA" * simulated,
        lead=(*content.lead, Cautions("When not to trust these data", odd)),
        sections=(
            *content.sections,
            *content.others,
            Section.of("Data quality", *_quality(source), *quality, name="quality"),
            *_answers(source.tidy),
            Section(
                "methods",
                "Methods, to paste",
                "Methods",
                (CopyText((mark * simulated + content.methods,)),),
            ),
            Section(
                "apa",
                "Sentences, to paste",
                "Sentences",
                (CopyText(tuple("[Simulated] " * simulated + one for one in content.sentences)),),
            ),
            Section.of("Provenance", *_provenance(provenance, [*content.scripts])),
        ),
        figures=figures,
    )


def _quality(source: ReportSource) -> Iterator[Block]:
    """Yield the participants, those that rules left out, and each session; or what was read."""
    tidy = source.tidy
    yield from participant_blocks(tidy)
    if tidy is None or not tidy.flow:
        yield from (Heading("What was read"), list(source.read))
        return
    yield TableBlock.each(
        "Exclusions, by the rules the protocol fixed",
        tidy.flow,
        ("Step", "l", lambda one: one.step),
        ("Sessions out", "", lambda one: str(one.sittings_out)),
        ("Decisions out", "", lambda one: str(one.decisions_out)),
        ("Sessions left", "", lambda one: str(one.sittings_left)),
        ("Decisions left", "", lambda one: str(one.decisions_left)),
    )
    rows: list[Any] = rows_as_json(tidy.sessions)
    yield TableBlock.each(
        "Sessions",
        rows,
        ("Participant", "l", lambda one: one["participant"]),
        ("Status", "l", lambda one: one["status"]),
        ("Decided", "n", lambda one: f"{one['decided']} / {one['planned']}"),
        ("Missing", "", lambda one: str(one["planned"] - one["decided"])),
        ("Void attempts", "", lambda one: str(one["void"])),
        ("Catch right", "", lambda one: _told(one["catch_correct"], wording.share, "no catch")),
        ("Dropped refreshes", "", lambda one: str(one["dropped"])),
        ("Gaze lost", "", lambda one: _told(one["gaze_lost_share"], lambda x: f"{100 * x:.1f} %")),
        ("Violations", "", lambda one: _told(one["gaze_violations"], str)),
        ("Mean gaze error, deg", "", lambda one: _told(one["gaze_mean_deg"], wording.number)),
        ("Damaged lines", "", lambda one: f"{one['damaged_lines']}{' + torn end' * one['torn']}"),
        ("Left out because", "l", lambda one: one["excluded"] or "kept"),
    )


def _told(value: Any, text: Callable[[Any], str], without: str = "no gaze") -> str:
    return without if value is None else text(value)


def _answers(tidy: TidyTables | None) -> Iterator[Section]:
    """Yield the section of what participants typed; none where nobody was asked."""
    if tidy is None or tidy.answers.empty:
        return
    rows: list[Any] = rows_as_json(tidy.answers)
    table = TableBlock.each(
        "",
        rows,
        ("Participant", "l", lambda one: one["participant"]),
        ("Question", "l", lambda one: one["question"]),
        (
            "Answer",
            "free",
            lambda one: Markup("<bdi>{}</bdi>").format(wording.printable(one["text"])),
        ),
    )
    warning = (
        "As typed. Read them before you publish them: people may have written what identifies them."
    )
    yield Section.of("Free answers", Paragraph(warning, muted=True), table, name="answers")


def _provenance(provenance: Mapping[str, Json], scripts: Sequence[str]) -> Iterator[Block]:
    rows = [(key.replace("_", " "), _value(value)) for key, value in provenance.items()]
    yield TableBlock.of("", (("", "l"), ("", "hash")), rows)
    yield Paragraph(
        Markup(
            "Every number of this page is in <code>results.json</code>, every table in"
            " <code>tables/</code>, every figure in <code>figures/</code>. Results were computed"
            " from the journals alone; running the command again gives the same numbers."
        ),
        muted=True,
    )
    if scripts:
        names = Markup(", ").join(Markup("<code>scripts/{}</code>").format(one) for one in scripts)
        yield Paragraph(
            Markup(
                "{}: repeat main models from <code>tables/</code> with lme4 and ordinal (R),"
                " statsmodels and scipy (Python). Each says in its first lines what it repeats and"
                " what not, and ends with status 1 where a number differs."
            ).format(names),
            muted=True,
        )


def _value(value: Json) -> str:
    match value:
        case None:
            return "none"
        case dict():
            return Markup("<br>").join(f"{key} {one}" for key, one in value.items())
        case list():
            return ", ".join(map(str, value))
        case _:
            return str(value)
