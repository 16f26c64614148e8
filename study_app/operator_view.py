"""View of the operator: one line per attempt in the session's own terminal, or a table elsewhere.

Both are made of journal events alone, so a second process shows the same by reading the journal.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from protocols.journal import AnyEvent, Attempt, Calibration, SessionEnd, SessionStart


@dataclass(frozen=True)
class SessionProgress:
    """State of a session."""

    done: int
    planned: int
    attempts: int
    voids: tuple[tuple[str, int], ...]
    missed: int
    """Missed refreshes in all attempts."""
    shown: int
    """Refreshes in all attempts."""
    lost_share: float | None
    """Mean share of the watched time without gaze; None where gaze is not watched."""
    accuracy_deg: float | None
    ended: str
    message: str
    """Reason why it ended, where that is an error."""

    def rows(self, of_what: str) -> list[tuple[str, str]]:
        """Return the attempts, missed refreshes, and lost gaze; `of_what` follows its percent."""
        voids = ", ".join(f"{count} {reason}" for reason, count in self.voids)
        lost = () if self.lost_share is None else (f"{100 * self.lost_share:.1f} %{of_what}",)
        return [
            ("attempts", f"{self.attempts}, void: {voids or 'none'}"),
            ("missed refreshes", f"{self.missed} of {self.shown}"),
            *(("gaze lost", share) for share in lost),
        ]


def standing(events: Sequence[AnyEvent]) -> SessionProgress:
    """Sum up a journal."""
    attempts = [event for event in events if isinstance(event, Attempt)]
    start = events[0] if events else None
    lost = [attempt.gaze.lost_share for attempt in attempts if attempt.gaze]
    checks = [event for event in events if isinstance(event, Calibration)]
    last = events[-1] if events else None
    voids = Counter(attempt.void_reason for attempt in attempts if attempt.void_reason)
    return SessionProgress(
        done=sum(attempt.decides for attempt in attempts),
        planned=start.trials if isinstance(start, SessionStart) else 0,
        attempts=len(attempts),
        voids=tuple((str(reason), count) for reason, count in voids.most_common()),
        missed=sum(attempt.missed for attempt in attempts),
        shown=sum(attempt.refreshes for attempt in attempts),
        lost_share=sum(lost) / len(lost) if lost else None,
        accuracy_deg=checks[-1].accuracy_deg if checks else None,
        ended=last.reason if isinstance(last, SessionEnd) else "",
        message=last.message if isinstance(last, SessionEnd) else "",
    )


def attempt_line(attempt: Attempt, events: Sequence[AnyEvent]) -> str:
    """Return one line on an attempt that is over."""
    now = standing(events)
    kind = attempt.role
    outcome = (
        f"{attempt.answer}, {attempt.rt_s:.2f} s"
        if attempt.outcome == "completed"
        else f"VOID {attempt.void_reason}"
    )
    parts = [
        f"{now.done}/{now.planned}",
        f"{kind} {attempt.trial}"
        + (f" (attempt {attempt.attempt})" if attempt.attempt > 1 else ""),
        outcome,
        f"missed {attempt.missed} of {attempt.refreshes} refreshes",
    ]
    if attempt.gaze is not None:
        parts.append(
            f"gaze lost {100 * attempt.gaze.lost_share:.0f} %"
            + (f", mean {attempt.gaze.mean_deg:.2f} deg" if attempt.gaze.mean_deg else "")
        )
    return "  ".join(parts)


def rows(events: Sequence[AnyEvent]) -> list[tuple[str, str]]:
    """Return the operator's table."""
    now = standing(events)
    start = events[0] if events else None
    attempts = [event for event in events if isinstance(event, Attempt)]
    table = [("decisions", f"{now.done} of {now.planned}")]
    if isinstance(start, SessionStart):
        who = f"{start.study} / {start.participant}" + (" (SIMULATED)" if start.simulated else "")
        table.insert(0, ("session", who))
        table.append(("vsync", f"{start.timing_evidence}, {start.refresh_hz:.3f} Hz"))
    if attempts:
        last = attempts[-1]
        table.append(("last", f"{last.trial}: {last.void_reason or last.answer}"))
    table += now.rows("")
    if now.accuracy_deg is not None:
        table.append(("gaze accuracy", f"{now.accuracy_deg:.2f} deg at the last validation"))
    table.append(("state", now.ended or "running"))
    if now.message:
        table.append(("message", now.message))
    return table
