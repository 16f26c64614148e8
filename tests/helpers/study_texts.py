"""The study files of tests: a short one of any task, and shipped ones with other values."""

import json
import re
from collections.abc import Mapping, Sequence

from protocols.load import shipped

_SHORT = """
format = 2
[study]
name = "{name}"
title = "{title}"
participants = {participants}
[display]
display = "{display}"
[stimuli]
{stimuli}
[task]
{task}
[design]
side = "fixed"
seed = 5
{design}
[trial]
{trial}
[gaze]
{gaze}
[response]
keys = [{keys}]
[text]
default_language = "en"
[text.languages.en]
consent = "Do you agree?"
instructions = ["Look."]
practice = "Practice."
start = "Start."
question = "Which?"
answers = {{ {answers} }}
break_page = "Block {{done}} of {{total}} is done."
paused = "Paused."
gaze_lost = "Look at the dot."
too_late = "Too late."
preparing = "Preparing."
quit_question = "Stop?"
thanks = "Thank you."
right = "Right."
wrong = "Wrong."
{texts}
[analysis]
{analysis}
[privacy]
"""


def short_study(
    *,
    stimuli: str,
    task: str,
    answers: Sequence[str],
    analysis: str,
    name: str = "short",
    title: str = "A short study",
    participants: int = 3,
    display: str = "fhd27-60hz",
    design: str = "",
    trial: str = "",
    gaze: str = 'mode = "none"',
    texts: str = "",
) -> str:
    """Return a study file that has what every study needs, and the parts given.

    Answers are keyed 1, 2, ... in their order.
    """
    return _SHORT.format(
        name=name,
        title=title,
        participants=participants,
        display=display,
        stimuli=stimuli,
        task=task,
        design=design,
        trial=trial,
        gaze=gaze,
        keys=", ".join(f'["{number}"]' for number, _ in enumerate(answers, 1)),
        answers=", ".join(f'{answer} = "{answer}"' for answer in answers),
        texts=texts,
        analysis=analysis,
    )


def files_recipe(entries: Mapping[str, Mapping[str, object]], edge_px: int = 64) -> str:
    """Return a section `[stimuli]` of pictures: name, which is also the file's, and condition."""
    rows = []
    for name, condition in entries.items():
        said = ", ".join(f"{key} = {json.dumps(value)}" for key, value in condition.items())
        rows.append(f'  {{ name = "{name}", file = "{name}.png", condition = {{ {said} }} }},')
    lines = ['kind = "files"', f"width_px = {edge_px}", f"height_px = {edge_px}", "entries = ["]
    return "\n".join([*lines, *rows, "]"])


def with_values(text: str, values: Mapping[str, object]) -> str:
    """Give keys of a TOML text other values, as TOML; every key must be there."""
    for key, value in values.items():
        text, count = re.subn(rf"^{key} = [^#\n]*", f"{key} = {value}", text, flags=re.MULTILINE)
        assert count, key
    return text


def shipped_study(name: str, values: Mapping[str, object], *, questions: bool = True) -> str:
    """Return a shipped study file with other values, and without its questions if so wished."""
    text = shipped("studies")[name].read_text(encoding="utf-8")
    if not questions:
        section = r"\n\[\[text\.languages\.\w+\.questions\]\].*?(?=\n\[)"
        text = re.sub(section, "\n", text, flags=re.DOTALL)
    return with_values(text, values)
