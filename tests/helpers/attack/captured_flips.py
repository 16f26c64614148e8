"""Pictures of a screen with `--strip`, as a camera or a frame grabber has them, against the log."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple


class CapturedPicture(NamedTuple):
    """One captured picture."""

    number: int
    """Number that its strip says."""
    content: str
    """A hash of the clip's place, by any function of the pixels."""


@dataclass(frozen=True)
class FlipMismatch:
    """One flip that was not what the log says."""

    number: int
    expected: str
    found: str

    def __str__(self) -> str:
        return f"flip {self.number}: must show {self.expected} (found {self.found})"


def compare(
    logged: Mapping[int, str | None],
    captured: Sequence[CapturedPicture],
    names: Mapping[str, str],
    *,
    attempts: Sequence[range] = (),
    blank: Collection[str] = (),
) -> list[FlipMismatch]:
    """Return every difference between what was logged and what was captured.

    Also compared is what the log does not name: pages, waits and the warm-up. There, as in
    every phase without a clip, no clip frame may be seen, and numbers only rise.

    Parameters
    ----------
    logged : mapping
        Number of each flip -> the name of the clip frame it showed; None: no clip.
    captured : sequence of CapturedPicture
        In the order in which the pictures appeared, each once.
    names : mapping
        Hash of the pixels -> name of the clip frame.
    attempts : sequence of range
        Numbers of the flips of each attempt, from its first to its last: all of them are logged.
    blank : collection of str
        Hashes of pixels that are also seen where no clip is, such as a frame as grey as the screen.

    Returns
    -------
    list of FlipMismatch
        In the order of the log: flips that are missing, out of order, or show something else. Then,
        in the order of the capture, flips that were shown again and flips that are not in the
        log. Empty where all flips appeared once, in order, with the right content.
    """
    first_at: dict[int, int] = {}
    for place, seen in enumerate(captured):
        first_at.setdefault(seen.number, place)
    found: list[FlipMismatch] = []
    latest = -1
    for number, frame in logged.items():
        expected = frame or "no clip"
        place = first_at.get(number, -1)
        if place < 0:
            found.append(FlipMismatch(number, expected, "no such flip"))
            continue
        if place < latest:
            found.append(FlipMismatch(number, expected, "the flip after a later one"))
        latest = max(latest, place)
        content = captured[place].content
        shown = names.get(content)
        if shown != frame and not (frame is None and content in blank):
            found.append(FlipMismatch(number, expected, shown or "pixels of no clip frame"))
    return found + _besides(logged, captured, names, attempts, blank)


def _besides(
    logged: Mapping[int, str | None],
    captured: Sequence[CapturedPicture],
    names: Mapping[str, str],
    attempts: Sequence[range],
    blank: Collection[str],
) -> list[FlipMismatch]:
    """Return the captures that should not have been."""
    found: list[FlipMismatch] = []
    latest, before = -1, None
    seen_before: set[int] = set()
    for seen in captured:
        if seen == before:
            continue
        before, frame = seen, names.get(seen.content)
        said = "nothing, it is not in the log"
        if seen.number in seen_before:
            found.append(
                FlipMismatch(seen.number, "nothing any more", f"the flip again, after {latest}")
            )
        elif seen.number < latest and seen.number not in logged:
            found.append(FlipMismatch(seen.number, said, f"an earlier flip after {latest}"))
        elif seen.number not in logged:
            if frame is not None and seen.content not in blank:
                found.append(FlipMismatch(seen.number, said, frame))
            elif any(seen.number in attempt for attempt in attempts):
                found.append(FlipMismatch(seen.number, said, "a flip within an attempt"))
        seen_before.add(seen.number)
        latest = max(latest, seen.number)
    return found
