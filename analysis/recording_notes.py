"""Notes on how sessions were recorded, as far as it bears on what their numbers can say."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

_NAMED = 5
_TIMING = {
    "software timer": "a timer stood in for the display's refresh, as in rehearsals: nothing"
    " vouches for how long anything was shown",
    "unverified": "the driver did not vouch for the flips: frames may have been shown later or"
    " shorter than the journal says",
}


def recording_notes(sessions: pd.DataFrame) -> tuple[str, ...]:
    """Return the weaknesses of how sessions were recorded, a sentence each.

    Parameters
    ----------
    sessions : DataFrame
        A row per session, with ``session``, ``simulated``, ``timing_evidence`` and ``dropped``,
        as `analysis.tidy` makes it.
    """
    notes = []
    if (sessions["simulated"] == 1).any():
        count = int((sessions["simulated"] == 1).sum())
        who = "All" if count == len(sessions) else f"{count} of {len(sessions)}"
        notes.append(
            f"{who} sessions are simulated: they show what the analysis does, not what people do"
        )
    for evidence, said in _TIMING.items():
        names = sessions.loc[sessions["timing_evidence"] == evidence, "session"]
        if len(names):
            notes.append(f"In {_sessions(list(names))} {said}")
    late = sessions[sessions["dropped"] > 0]
    if len(late):
        notes.append(
            f"In {_sessions(list(late['session']))} refreshes were missed in trials that count"
            f" ({int(late['dropped'].sum())} in all, at most {int(late['dropped'].max())} in one"
            " session): clips skipped a frame there"
        )
    return tuple(notes)


def _sessions(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
    return f"{len(names)} session{'s' * (len(names) != 1)} ({shown})"
