"""Participants in browsers who share a link, a panel's code, or a worker of JATOS.

One person may have taken part twice, or a link was given to several: nothing is refused for it,
and it is said. By which results and workers of JATOS lines came stands beside the journal, in
`sender.json`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from pydantic import TypeAdapter, ValidationError

from protocols.disk.whole_file import write_whole
from protocols.errors import count_of
from protocols.journal import SessionStart

Mark: TypeAlias = tuple[str, str]
"""Kind of what one person has alone, and its name."""
SENDER_NAME = "sender.json"
SLOT, PANEL_CODE = "slot", "panel code"
_SENDER = TypeAdapter(list[Mark])
_SHOWN = 10


@dataclass(frozen=True)
class SharedLink:
    """Participants who share the same marks."""

    marks: tuple[Mark, ...]
    participants: tuple[str, ...]

    def __str__(self) -> str:
        kinds = dict.fromkeys(
            f"{kind} {name}" if kind == SLOT else f"a {kind}" for kind, name in self.marks
        )
        who = ", ".join(self.participants[:_SHOWN]) + ", ..." * (len(self.participants) > _SHOWN)
        return f"{count_of(len(self.participants), 'participant')} share {', '.join(kinds)} ({who})"


def link_marks(slot: int, identifier: str | None, sender: Iterable[Mark]) -> frozenset[Mark]:
    """Return all marks of a session in a browser."""
    code = [(PANEL_CODE, identifier)] if identifier else []
    return frozenset([(SLOT, str(slot)), *code, *sender])


def session_marks(start: SessionStart, folder: Path) -> frozenset[Mark]:
    """Return the marks of a recorded session; none where it ran at a desk."""
    if start.remote is None:
        return frozenset()
    return link_marks(start.slot, start.remote.identifier, sender_of(folder))


def sender_of(folder: Path) -> list[Mark]:
    """Return the marks beside a journal; none where they were not kept, or are damaged."""
    try:
        return _SENDER.validate_json((folder / SENDER_NAME).read_bytes())
    except (OSError, ValidationError):
        return []


def keep_sender(folder: Path, marks: Iterable[Mark]) -> None:
    """Write marks beside a journal, to those that are there.

    Raises
    ------
    OSError
        If the disk refuses.
    """
    there = set(sender_of(folder))
    if every := there.union(marks) - there:
        write_whole(folder / SENDER_NAME, _SENDER.dump_json(sorted(there | every)))


def shared_links(sessions: Mapping[str, Iterable[Mark]]) -> list[SharedLink]:
    """Return the groups of participants who share marks, of marks by participant."""
    people: dict[Mark, list[str]] = defaultdict(list)
    for who, marks in sorted(sessions.items()):
        for mark in marks:
            people[mark].append(who)
    groups: dict[tuple[str, ...], list[Mark]] = defaultdict(list)
    for mark, sharing in sorted(people.items()):
        if len(sharing) > 1:
            groups[tuple(sharing)].append(mark)
    return [SharedLink(tuple(marks), sharing) for sharing, marks in sorted(groups.items())]
