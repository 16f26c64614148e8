"""A session that ran to its end without one decision is no success: it says why, and what to do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from protocols.errors import StudyError
from protocols.journal import VoidReason
from study_app.session_folders import SessionFolder

# Of every reason that can use up `max_attempts` (`study_app.session.NOT_THE_PARTICIPANTS` cannot).
_CURES: dict[VoidReason, str] = {
    "dropped-frames": "measure the display with 'metamerlab session check-display', close what else"
    " runs on this machine, or tolerate more in trial.dropped_frames_max",
    "too-late": "let the participant practise the keys, or give more time in response.timeout_s",
    "no-fixation": "calibrate the tracker again and read the validation, or give more time in"
    " trial.fixation_timeout_s",
    "gaze-break": "calibrate the tracker again and read the validation, or widen gaze.window_deg",
    "data-loss": "see that the tracker keeps the eye in view, or tolerate more in"
    " gaze.loss_max_share",
}
_NAMED = 5


def require_decisions(sessions: Iterable[SessionFolder]) -> None:
    """Refuse to call sessions a success that are complete and hold no decision.

    Raises
    ------
    StudyError
        With how often each reason made an attempt void, and the cure of the most frequent one.
    """
    empty = [each for each in sessions if each.state == "completed" and each.main_done == 0]
    if not empty:
        return
    voids = Counter(
        attempt.void_reason
        for session in empty
        for attempt in session.journal.attempts
        if attempt.void_reason and attempt.role == "main"
    )
    counts = ", ".join(f"{count} {reason}" for reason, count in voids.most_common())
    worst = max(_CURES, key=lambda reason: voids[reason])
    codes = ", ".join(session.participant for session in empty[:_NAMED])
    more = f" and {len(empty) - _NAMED} more" if len(empty) > _NAMED else ""
    raise StudyError(
        f"{empty[0].folder.parent}: a session must end with decisions (recorded: none of"
        f" {empty[0].journal.start.trials} by {codes}{more}; void attempts: {counts});"
        f" {_CURES[worst]}. Everything is kept as it was recorded, and the session is over: begin"
        " again with another participant code, or with another --out"
    )
