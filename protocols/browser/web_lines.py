"""The lines that a browser sends home: JSON, one event each, ended by a line feed.

Lines come at least once, in any grouping. So each says whose it is (`study`, `participant`), its
number `n` among that participant's lines (0, 1, 2, ... without gaps, over all runs) and the run of
the page that wrote it. `study_app.web.import_lines` makes an ordinary journal of them. An attempt
holds what was observed, not what follows from it: Python runs the trial again on these stamps and
keys, and the outcome that the browser claims must come out.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints, TypeAdapter

from protocols.journal import Machine, SlotFrom, TrialId, UtcTime, VoidReason
from protocols.units import (
    Count,
    Hertz,
    LanguageCode,
    Magnitude,
    Model,
    Name,
    ParticipantCode,
    Positive,
    Sha256,
    Share,
    Stamp,
    Text,
)

WebSeed = Annotated[int, Field(ge=0, le=2**53 - 1)]
"""Drawn by the browser: JavaScript holds such whole numbers exactly."""
Microseconds = Annotated[int, Field(ge=0, le=2**53 - 1, json_schema_extra={"unit": "µs"})]


class Line(Model):
    """Fields of every line."""

    study: Name
    participant: ParticipantCode
    run: Count
    """Number of the opening of the page that wrote it, from 0."""
    n: Count
    """Number of the line, from 0, over all runs."""
    t_s: Stamp
    """Time on the page's clock: monotonic, 0 when this run opened it."""
    at: UtcTime
    """Time on the participant's clock, UTC."""


class StartLine(Line):
    """The first line of a participant."""

    kind: Literal["start"] = "start"
    format: Literal[1] = 1
    protocol_sha256: Sha256
    manifest_sha256: Sha256
    study_file_sha256: Sha256
    """Hash of `study.json`, so of the export."""
    revision: Text
    """Revision of metamerlab, which made the export."""
    slot: Count
    slot_from: SlotFrom
    seed: WebSeed
    language: LanguageCode
    rate_hz: Hertz
    """Refresh rate that is used, of those of the study."""
    machine: Machine
    identifier: Annotated[str, StringConstraints(max_length=200)] | None = None
    """Value of the link's parameter that the study names."""


class ResumeLine(Line):
    """The page was opened again for the same participant."""

    kind: Literal["resume"] = "resume"
    rate_hz: Hertz
    machine: Machine


class ConsentLine(Line):
    """The participant read the consent page, and agreed or not."""

    kind: Literal["consent"] = "consent"
    agreed: bool
    text_sha256: Sha256


class BlockStartLine(Line):
    """A block begins."""

    kind: Literal["block-start"] = "block-start"
    block: Count


class BlockEndLine(Line):
    """A block is over."""

    kind: Literal["block-end"] = "block-end"
    block: Count


class BreakLine(Line):
    """A break between blocks, sent at its end."""

    kind: Literal["break"] = "break"
    after_block: Count
    duration_s: Magnitude


class PauseLine(Line):
    """A pause, sent at its end."""

    kind: Literal["pause"] = "pause"
    duration_s: Magnitude


class Press(Model):
    """A key, or the pointer, in an attempt."""

    flip: Count
    """Number of the flip after which it was read."""
    key: Text
    at_us: Microseconds
    """Time on the page's clock."""
    x: Share | None = None
    """Place of the pointer across the study's screen."""


class AttemptLine(Line):
    """One attempt at a trial, with what was observed in it."""

    kind: Literal["attempt"] = "attempt"
    trial: TrialId
    attempt: Positive
    position: Count
    flips_us: tuple[Microseconds, ...]
    """Times of flips: the first on the page's clock, each other one since that before."""
    presses: tuple[Press, ...]
    disturbed: tuple[Count, Literal["focus", "hidden", "full-screen", "size"]] | None
    """After which flip something came between participant and page, and what."""
    outcome: Literal["completed", "void"]
    void_reason: VoidReason | None
    answer: Name | None


class AnswerLine(Line):
    """An answer to a closing question."""

    kind: Literal["answer"] = "answer"
    question: Name
    text: Annotated[str, StringConstraints(max_length=20_000)]


class NoteLine(Line):
    """A remark by the page, such as a file that was not the one that was hashed."""

    kind: Literal["note"] = "note"
    text: Annotated[str, StringConstraints(min_length=1, max_length=2000)]


class EndLine(Line):
    """The session is over, or the participant left."""

    kind: Literal["end"] = "end"
    reason: Literal["completed", "quit", "consent-refused", "error"]


AnyLine: TypeAlias = Annotated[
    StartLine
    | ResumeLine
    | ConsentLine
    | BlockStartLine
    | BlockEndLine
    | BreakLine
    | PauseLine
    | AttemptLine
    | AnswerLine
    | NoteLine
    | EndLine,
    Field(discriminator="kind"),
]
LINE: TypeAdapter[AnyLine] = TypeAdapter(AnyLine)
