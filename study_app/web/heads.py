"""Poses of the head in an attempt's line: checked, and written beside the journal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from protocols.browser.head_poses import decoded_poses, turned_away, turns_deg
from protocols.browser.web_lines import AttemptLine
from protocols.journal import SideFile
from protocols.study_file.session_schema import Headset
from study_app.recorder import Recorder
from study_app.web.check_lines import wrong

Head: TypeAlias = Mapping[str, float | SideFile | None]
"""Fields of an attempt's event about the head."""


def head_of(
    line: AttemptLine, watched: Sequence[bool], headset: Headset | None, recorder: Recorder
) -> Head:
    """Return the journal's fields on the head in an attempt, after writing its poses.

    Parameters
    ----------
    watched : sequence of bool
        For each flip until the outcome was known: it showed a phase that is watched.
    headset : Headset or None
        Of the study.

    Raises
    ------
    ContradictionError
        If there is not a pose for each flip, or the head turned farther than the study allows and
        the attempt goes on, or it did not and is void for it.
    """
    if headset is None or line.poses is None:
        if (headset is None) != (line.poses is None):
            must = "poses must be given of a headset, and only of one"
            raise wrong(line, must, "none" if line.poses is None else "some")
        return {}
    try:
        poses = decoded_poses(line.poses)
    except ValueError as error:
        raise wrong(line, "poses must be Base64 of whole poses", error) from None
    if len(poses) != len(line.flips_us):
        raise wrong(line, f"poses must be {len(line.flips_us)}, one for each flip", len(poses))
    of = poses[: len(watched)]
    turns = turns_deg(poses)
    if headset.turn_deg is not None:
        away = np.flatnonzero(turned_away(of, headset.turn_deg) & np.array(watched))
        flip, what = line.disturbed or (len(of), None)
        if what == "turned" and flip not in away:
            raise wrong(
                line, f"poses must turn by more than {headset.turn_deg:g} deg at flip {flip}"
            )
        if any(away < flip):
            must = (
                f"a flip {away[0]} that is turned by {turns[away[0]]:.1f} deg must void the attempt"
            )
            raise wrong(line, must, line.outcome)
    rows = [
        f"{flip},{','.join(map(str, pose))},{'' if np.isnan(turn) else f'{turn:.2f}'}\n"
        for flip, (pose, turn) in enumerate(zip(poses.tolist(), turns.tolist(), strict=True))
    ]
    data = "flip,x,y,z,w,turn_deg\n" + "".join(rows)
    seen = turns[: len(watched)][watched]
    seen = seen[~np.isnan(seen)]
    return {
        "head_turn_deg": round(float(seen.max()), 2) if len(seen) else None,
        "poses_file": recorder.side_file(
            f"poses/{line.position:04d}", ".csv", data.encode("ascii")
        ),
    }
