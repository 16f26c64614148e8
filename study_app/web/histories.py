"""Histories of one participant: two tabs of a link, or two devices, each go on from the same line.

Each line follows on the last before it of its own opening of the page; where a page was opened
again, on the last that it was told of. So lines are a tree, and a history leads to one of its ends.
"""

from __future__ import annotations

import zlib
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime

from protocols.browser.web_lines import LINE, AnyLine, EndLine, ResumeLine

MOST_HISTORIES = 8
"""Histories that are looked at; hostile lines may make up any number."""


@dataclass(frozen=True, eq=False)
class TreeLine:
    """A line in the tree."""

    n: int
    run: int
    opening: int | None
    at: str
    opened_s: float
    """Moment at which its page was opened, by that page's clocks."""
    packed: bytes
    before: TreeLine | None
    length: int
    """Lines up to this one."""
    completed_at: str
    """Time at which the session was completed; empty where it was not."""

    @property
    def history(self) -> list[TreeLine]:
        """All lines up to this one, in order."""
        found = [self]
        while (before := found[-1].before) is not None:
            found.append(before)
        return found[::-1]


def unpacked_line(packed: bytes) -> AnyLine:
    """Return a line."""
    return LINE.validate_json(zlib.decompress(packed))


def histories(told: Mapping[int, Sequence[bytes]]) -> list[TreeLine]:
    """Return the ends of histories: of those that were completed first, then of the longest.

    `told` holds all different lines of each number, packed.
    """
    openings: dict[tuple[int, int | None], list[TreeLine]] = {}
    ends: dict[int, TreeLine] = {}
    level: list[TreeLine] = []
    for n in sorted(told):
        level = [_placed(packed, openings, level) for packed in told[n]]
        fresh: dict[tuple[int, int | None], list[TreeLine]] = defaultdict(list)
        for place in level:
            fresh[place.run, place.opening].append(place)
            ends[id(place)] = place
            ends.pop(id(place.before), None)
        openings |= fresh
    best = sorted(
        ends.values(), key=lambda end: (not end.completed_at, end.completed_at, -end.length, end.at)
    )
    return best[:MOST_HISTORIES]


def _placed(
    packed: bytes,
    openings: Mapping[tuple[int, int | None], Sequence[TreeLine]],
    last: Sequence[TreeLine],
) -> TreeLine:
    """Return the place of a line among the last ones of each opening, and of all."""
    line = unpacked_line(packed)
    opened_s = 0.0
    with suppress(ValueError):  # of a date that is none
        opened_s = datetime.fromisoformat(line.at).timestamp() - line.t_s
    # What nobody began is a stranger's who knows the code, and takes back no completed session.
    open_ones = [one for one in last if not one.completed_at]
    if isinstance(line, ResumeLine):  # its page was told what had been kept last
        rest = last if line.continues is None else open_ones
        near = openings.get((line.run - 1, line.continues), rest)
        before = max(near, key=lambda one: (one.at <= line.at, one.at), default=None)
    else:
        rest = last if line.opening is None else open_ones
        near = openings.get((line.run, line.opening), rest)
        before = min(near, key=lambda one: abs(one.opened_s - opened_s), default=None)
    done = line.at if isinstance(line, EndLine) and line.reason == "completed" else ""
    length, done = (before.length, before.completed_at or done) if before else (0, done)
    return TreeLine(
        line.n, line.run, line.opening, line.at, opened_s, packed, before, length + 1, done
    )


def left_by(kept: Sequence[TreeLine], told: Mapping[int, Sequence[bytes]]) -> str:
    """Return the number of lines of each run that a history leaves, in words; empty: none."""
    ours = {id(place.packed) for place in kept}
    left = [text for texts in told.values() for text in texts if id(text) not in ours]
    runs = sorted(Counter(unpacked_line(text).run for text in left).items())
    said = ", ".join(f"{count} of run {run}" for run, count in runs)
    return said and f"lines of another tab or device were left: {said}"
