"""A study of preferences that is known by its numbers alone, for the question how many people."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from protocols.errors import StudyError
from protocols.limits import FIXED
from protocols.load import load_display, protocol_of, with_tuples
from protocols.study_file.new_study import study_files
from protocols.study_file.schema import StudyProtocol

NAME = "from-numbers"
MOST = FIXED["design"].most
"""Of pairs, of scenes, of repeats, of participants: more is a slip of the hand."""


def preferences_of(*, pairs: int, scenes: int, repeats: int, participants: int) -> StudyProtocol:
    """Return a study in which everybody compares every pair in every scene so often.

    Parameters
    ----------
    pairs : int
        Pairs of methods; the planned test is that of the first, alone.
    scenes, repeats, participants : int
        How many scenes, how often everybody decides on a pair in each, and how many they are.

    Raises
    ------
    StudyError
        If a number is below 1 (scenes and participants: 2), or above 1000.
    """
    for name, value, least in (
        ("pairs", pairs, 1), ("scenes", scenes, 2), ("repeats", repeats, 1),
        ("participants", participants, 2),
    ):  # fmt: skip
        if not least <= value <= MOST:
            raise StudyError(f"--{name}: must be {least} to {MOST} (got {value})")
    text = study_files(NAME, "From numbers", load_display("fhd27-60hz"))["study.toml"]
    study: dict[str, Any] = tomllib.loads(text)
    study["study"]["participants"] = participants
    study["display"]["display"] = "fhd27-60hz"
    stimuli, first = study["stimuli"], study["stimuli"]["scenes"][0]
    stimuli["scenes"] = [
        first | {"name": f"scene-{k}", "label": f"scene {k}"} for k in range(scenes)
    ]
    stimuli["sizes"] = stimuli["sizes"][:1]
    stimuli["methods"] = [{"name": f"method-{k}", "method": "push-pull"} for k in range(pairs + 1)]
    study["task"]["pairings"] = [["method-0", f"method-{k + 1}"] for k in range(pairs)]
    del study["task"]["catch"], study["design"]["practice"]
    study["design"] |= {"repeats": repeats, "blocks": 1}
    study["analysis"]["primary"] = {"method": "method-0", "against": "method-1"}
    raw = {key: with_tuples(value) for key, value in study.items()}
    return protocol_of(raw, Path(f"{NAME}.toml"))
