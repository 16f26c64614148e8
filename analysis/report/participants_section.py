"""Participants as CONSORT asks: a table of their flow, a sentence, and what they said of them."""

from collections.abc import Iterator

from analysis.tidy import TidyTables
from protocols.blocks import Block, Paragraph, TableBlock
from protocols.prose import count_of


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
