"""Removed parts: what to use instead, and how records that name them are still read."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path

LAST_WITH_ALL = "5076b993 (version 0.3.0)"
"""The last revision that has everything named here."""

INSTEAD: Mapping[str, str] = {
    **dict.fromkeys(
        ("analysis psychometric --threshold-at", "analysis.threshold_at"),
        "take the thresholds of the report, half of the way from guessing to lapsing (about 75 %"
        " right of two answers), or fit decisions.csv with psignifit or quickpsy for another"
        " performance",
    ),
    **dict.fromkeys(
        ("analysis bayes", "analysis.bayes"),
        "fit decisions.csv with brms (R) or bambi (Python)",
    ),
    **dict.fromkeys(
        ("analysis sequential", "analysis.sequential"),
        "compute the bounds of looks with rpact or gsDesign, and say in the preregistration when"
        " the study stops",
    ),
    "analysis confidence": (
        "read decisions.csv, whose column confidence holds the steps, with metadpy (Python) or"
        " HMeta-d (R, MATLAB)"
    ),
    "analysis export --format psych-ds": (
        "export with --format bids, or write the tables with 'metamerlab analysis tidy'"
    ),
    ".obj": "export the scene as glTF (.glb), which Blender and trimesh write",
    "session check-display --luminance": "type peak_cd_m2, black_cd_m2 and gamma into the display"
    " file by hand (docs/running-a-study.md says how to read them)",
    "--gaze gazepoint": "run Gazepoint's LSL program and name its stream, as --gaze"
    " lsl:GazepointEyeTracker,x=BPOGX,y=BPOGY,unit=norm (docs/trackers.md says what to check)",
    "--gaze pupil": "send gaze on the screen as an LSL stream and name it, as --gaze"
    " lsl:NAME,unit=norm (docs/trackers.md says how, by device)",
    "--gaze tobii": "run TittaLSL or App-TobiiPro and name its stream, as --gaze"
    " lsl:Tobii,x=left_x,y=left_y,unit=norm (docs/trackers.md says what to check)",
    "protocol script": "give the same options to 'metamerlab protocol show STUDY --script'",
    "session archive": "copy study, sessions and clips, or pack them by any program, and prove the"
    " copy with 'metamerlab session verify' and 'stimuli check'; an archive of before is unzipped,"
    " after 'age --decrypt' where it is encrypted, and its folder sessions proven",
    "session restore": "unzip the archive with any program, and prove the folder with 'metamerlab"
    " session verify'",
    "session simulate --web": "open the exported page by hand, with '?slot=0&simulated' in its link"
    " (docs/web.md, step 5)",
    "session verify --identity": "decrypt the archive by 'age --decrypt --identity key.txt --output"
    " backup.zip backup.zip.age', unzip it, and verify its folder sessions",
    "stimuli look --interactive": "draw the best views by 'metamerlab stimuli look SCENE --out"
    " views.png', and edit the numbers of one with --view",
    "stimuli probe": "use 'metamerlab stimuli check CLIPS --flicker'",
    "demo --no-studies": "use 'metamerlab demo', which runs one study; --all runs the others, too",
    "demo --no-window": "use 'metamerlab demo', which opens no window without --all",
    "demo --pictures-only": (
        "use 'metamerlab warp motorcycle OUT.png --compare SHEET.png', or 'metamerlab demo', which"
        " begins with these pictures"
    ),
    "denoise render": "render the noisy picture by any path tracer, as docs/denoising.md says",
    "denoise train": "use the networks that come along, as 'metamerlab denoise run' does",
}
"""Words that name a removed part, as a user writes them, and what to do instead.

Commands stand as ``analysis bayes``, options as ``session check-display --luminance``, keys of a
study as ``analysis.sequential``, trackers as ``--gaze tobii``, files by suffix, as ``.obj``.
"""


def gone(words: str) -> str | None:
    """Return the message on a removed part; None for words that name none."""
    if words not in INSTEAD:
        return None
    return f"was removed: {INSTEAD[words]}; revision {LAST_WITH_ALL} is the last that has it"


def moved(error: BaseException) -> str:
    """Return the words on the place where a module or name, which an import misses, lies now."""
    if not isinstance(error, ImportError):
        return ""
    import tomllib  # `--help` does without it

    name = re.match(r"cannot import name '(\w+)'", str(error))
    missed = f"{error.name}.{name[1]}" if name else str(error.name)
    table = Path(__file__).with_name("moved.toml").read_text(encoding="utf-8")
    places = tomllib.loads(table).get(missed, "").split()
    return f", which is {' or '.join(places)} now" * bool(places)


def gone_from_command(arguments: Sequence[str]) -> str | None:
    """Return the message on a removed command, or on a removed option of a command."""
    words = [*takewhile(lambda word: word != "--", arguments)]  # what follows names files
    named = next((i for i, word in enumerate(words) if word.startswith("-")), len(words))
    commands = [" ".join(words[:many]) for many in range(1, min(named, 3) + 1)]
    options = [word.partition("=")[0] for word in words if word.startswith("--")]
    for place in (*commands, *(f"{one} {option}" for one in commands for option in options)):
        if message := gone(place):
            return f"{place} {message}"
    return None


def without_gone(raw: Mapping[str, object]) -> tuple[dict[str, object], dict[str, object]]:
    """Return a parsed study without its removed keys, and what these said, by dotted place."""
    kept, found = dict(raw), dict[str, object]()
    for place in INSTEAD:
        section, _, key = place.partition(".")
        inside = kept.get(section)
        if isinstance(inside, Mapping) and key in inside:
            kept[section] = left = dict(inside)
            found[place] = left.pop(key)
    return kept, found


def as_hashed(place: str, value: object) -> object:
    """Return the part that a removed key had in the hash of a study; None where it had none."""
    if place == "analysis.sequential" and isinstance(value, dict):
        return {"bayes_factor": 10.0} | value  # its default was part of the hash
    return value if value is not False else None
