"""Checksums of a journal: each line vouches for itself and for all lines before it.

The checksum of a line is the SHA-256 of the line before's checksum, followed by the line as it
reads with ``null`` in the checksum's place, without its line feed. Before the first line that has
one stands the SHA-256 of all bytes before it, which are none in a journal begun since format 2
has checksums. It finds accidents and careless edits; who computes all checksums anew is not found.
"""

from __future__ import annotations

import hashlib
import re

from protocols.disk.hashing import sha256_bytes
from protocols.journal import AnyEvent, event_line

_NONE = b'"chain":null'
_FIELD = re.compile(rb'"chain":"([0-9a-f]{64})"')
# In canonical JSON the first match is the field of the event itself: within a text, quotes are
# escaped, and no key that sorts before "chain" holds an object.


def first_link(before: bytes) -> str:
    """Return the text in place of the checksum before the first line that has one.

    Parameters
    ----------
    before : bytes
        All of the journal before that line.
    """
    return sha256_bytes(before)


def sealed(event: AnyEvent, before: str) -> tuple[AnyEvent, bytes]:
    """Return an event with its checksum, and its journal line with its line feed.

    Parameters
    ----------
    event : AnyEvent
        Its own checksum, if any, is replaced.
    before : str
        Checksum of the line before, or `first_link`.
    """
    chain, line = sealed_line(event_line(event.model_copy(update={"chain": None})), before)
    return event.model_copy(update={"chain": chain}), line


def sealed_line(bare: bytes, before: str) -> tuple[str, bytes]:
    """Return the checksum of a line that has ``null`` in its place, and the line with it."""
    chain = due(bare[:-1], before)
    return chain, bare.replace(_NONE, b'"chain":"%b"' % chain.encode(), 1)


def stated(line: bytes) -> str | None:
    """Return the checksum that a line states; None where it states none."""
    found = _FIELD.search(line)
    return found[1].decode() if found else None


def due(line: bytes, before: str) -> str:
    """Return the checksum that a line must state, after a line with checksum `before`."""
    bare = _FIELD.sub(_NONE, line, count=1)
    return hashlib.sha256(before.encode() + bare).hexdigest()
