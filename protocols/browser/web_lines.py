"""The lines that a browser sends home: the journal's events, with who sent them.

JSON, one event each, ended by a line feed. Lines come at least once, in any grouping. So each says
whose it is (`study`, `participant`), its number `n` among that participant's lines (0, 1, 2, ...
without gaps, over all runs) and the run of the page that wrote it. `study_app.web.import_lines`
makes an ordinary journal of them. An attempt holds what was observed, not what follows from it:
Python runs the trial again on these stamps and keys, and the outcome that the browser claims must
come out.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import FailFast, Field, JsonValue, StringConstraints, TypeAdapter
from pydantic.json_schema import SkipJsonSchema

from protocols.journal import (
    Answer,
    AttemptOutcome,
    BlockBegun,
    BlockEnd,
    Break,
    BrowserWindow,
    ConsentGiven,
    Event,
    Machine,
    Note,
    Pause,
    RemoteStart,
    UtcTime,
)
from protocols.units import (
    Count,
    Hertz,
    LanguageCode,
    Model,
    Name,
    ParticipantCode,
    Sha256,
    Share,
    Stamp,
    Text,
    WebSeed,
)

Disturbance: TypeAlias = Literal[
    "focus",
    "hidden",
    "full-screen",
    "size",
    "turned",
    "session-end",
    "controller-lost",
    "head-lost",
]
"""Event that comes between participant and page. The last four are those of headsets."""
Microseconds = Annotated[int, Field(ge=0, le=2**53 - 1, json_schema_extra={"unit": "µs"})]


class Sent(Event):
    """Fields of every line: of an event, and who sent it."""

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
    opening: Count | None = None
    """Drawn by chance when the page was opened: tells two tabs of one link apart. Null in lines of
    older pages."""
    chain: SkipJsonSchema[None] = None
    """Null: it is made where the journal is written."""

    def told(self) -> dict[str, JsonValue]:
        """Return the event without number, times and sender."""
        return self.model_dump(exclude=set(Sent.model_fields))


class StartLine(Sent, RemoteStart):
    """The first line of a participant."""

    kind: Literal["start"] = "start"
    format: Literal[1] = 1
    protocol_sha256: Sha256
    manifest_sha256: Sha256
    slot: Count
    seed: WebSeed
    """Drawn by the browser."""
    language: LanguageCode
    rate_hz: Hertz
    """Refresh rate that is used, of those of the study."""


class ResumeLine(Sent):
    """The page was opened again for the same participant."""

    kind: Literal["resume"] = "resume"
    rate_hz: Hertz
    """Refresh rate that is used from here on, of those of the study."""
    machine: Machine
    continues: Count | None = None
    """Opening of the page that wrote the line before. Null in lines of older pages."""


class ConsentLine(Sent, ConsentGiven):
    """The participant read the consent page, and agreed or not."""


class BlockStartLine(Sent, BlockBegun):
    """A block begins."""


class BlockEndLine(Sent, BlockEnd):
    """A block is over."""


class BreakLine(Sent, Break):
    """A break between blocks, sent at its end."""


class PauseLine(Sent, Pause):
    """A pause, sent at its end."""


class Press(Model):
    """A key, or the pointer, in an attempt."""

    flip: Count
    """Number of the flip after which it was read."""
    key: Text
    at_us: Microseconds
    """Time on the page's clock."""
    x: Share | None = None
    """Place of the pointer across the study's screen."""


class AttemptLine(Sent, AttemptOutcome):
    """One attempt at a trial, with what was observed in it."""

    flips_us: Annotated[tuple[Microseconds, ...], FailFast()]
    """Times of flips: the first on the page's clock, each other one since that before."""
    presses: Annotated[tuple[Press, ...], FailFast()]
    disturbed: tuple[Count, Disturbance] | None
    """After which flip something came between participant and page, and what."""
    window: BrowserWindow | None = None
    """The window as the attempt began. Null in lines of older pages, which looked at it once, and
    of headsets."""
    poses: Annotated[str, StringConstraints(max_length=4_000_000)] | None = None
    """Pose of the head at each flip, as it was drawn for: Base64 of four numbers of 16 bits each,
    the lower byte first, x, y, z, w of its unit quaternion times 32767. All 0: not tracked. Null
    where no headset was used."""


class AnswerLine(Sent, Answer):
    """An answer to a closing question."""

    text: Annotated[str, StringConstraints(max_length=20_000)]


class NoteLine(Sent, Note):
    """A remark by the page, such as a file that was not the one that was hashed."""

    text: Annotated[Text, StringConstraints(max_length=2000)]
    file: SkipJsonSchema[None] = None


class EndLine(Sent):
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
