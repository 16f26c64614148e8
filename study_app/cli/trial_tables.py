"""Tables of `metamerlab protocol show`: a participant's trials, and their scripts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, assert_never

import typer
from rich.table import Table

from protocols.disk.result_folder import whole_folder
from protocols.display import Display
from protocols.errors import StudyError, did_you_mean
from protocols.feasibility import virtual_manifest
from protocols.make_script import Scripts
from protocols.manifest import read_manifest
from protocols.plan import Plan, make_plan
from protocols.script import (
    Entry,
    Fill,
    Frames,
    Live,
    Picture,
    ScriptPhase,
    StoredPicture,
    TrialScript,
    Words,
)
from protocols.study_file.schema import StudyProtocol
from study_app.cli.options import one_of
from study_app.cli.terminal import PlainConsole, say
from study_app.session_folders import session_folder


@dataclass(frozen=True)
class ScriptOptions:
    """A participant's plan and scripts, and their form."""

    script: bool = False
    """Print a participant's plan and the scripts of its trials instead: phases, pictures, questions
    in refreshes and pixels."""
    code: str | None = None
    """With --script: the participant's code. Default: P01."""
    trial: str | None = None
    """With --script: trial to print, such as main-0003. Left out: all."""
    as_json: Annotated[bool, typer.Option("--json")] = False
    """With --script: print plan and scripts as JSON, for programs."""
    language: str | None = None
    """With --script: language of the texts. Default: the study's."""
    pictures: Path | None = None
    """With --script: new folder for the pictures, HASH.png; scripts then name the hashes."""
    stimuli: Path | None = None
    """With --script: folder of built clips, for their hashes."""


def print_scripts(study: StudyProtocol, screen: Display, slot: int, wanted: ScriptOptions) -> None:
    """Print the plan of a participant, and what its planned trials show.

    Raises
    ------
    StudyError
        If there is no such participant, trial or language, or the display cannot show the texts.
    """
    # Imported here: it brings fonts and image libraries along.
    from study_app.shown_texts import require_showable

    code = "P01" if wanted.code is None else wanted.code
    session_folder(Path(), study, code)
    spoken = study.text.default_language if wanted.language is None else wanted.language
    one_of("--language", spoken, study.text.languages)
    stimuli, trial = wanted.stimuli, wanted.trial
    manifest = read_manifest(stimuli) if stimuli else virtual_manifest(study, screen)
    require_showable(study, screen, manifest if stimuli else None)
    plan = make_plan(study, manifest, code, slot)
    planned = [one for one in plan.trials if trial in (None, one.id)]
    if not planned:
        known = [one.id for one in plan.trials]
        raise StudyError(
            f"--trial: must be one of the plan, {known[0]} to {known[-1]} (got {trial!r})"
            f"{did_you_mean(str(trial), known)}"
        )
    if trial is not None and not planned[0].stimuli:
        raise StudyError(
            f"--trial: {trial} is adaptive: what it shows follows from the answers before it,"
            " so it has a script in the session only; name a planned trial"
        )
    compiler = Scripts(study, screen, spoken, manifest)
    scripts = [compiler.of(one) for one in planned if one.stimuli]
    if wanted.pictures is not None:
        from study_app.paint import write_pictures

        with whole_folder(wanted.pictures) as folder:
            scripts = write_pictures(folder, scripts, study, screen)
    if wanted.as_json:
        whole = {
            "plan": plan.model_dump(mode="json"),
            "scripts": [one.model_dump(mode="json") for one in scripts],
        }
        typer.echo(json.dumps(whole, ensure_ascii=False))
        return
    console = PlainConsole()
    console.print(trial_table(plan))
    for alike in _alike(scripts):
        console.print(_script_table(alike))
    if trial is None and len(scripts) < len(plan.trials):
        count = f"{len(plan.trials) - len(scripts)} of {len(plan.trials)} trials are adaptive"
        say(f"note: {count}, and have a script in the session only")


def trial_table(plan: Plan) -> Table:
    """Return a table of a participant's trials."""
    columns = list(dict.fromkeys(name for trial in plan.trials for name in trial.condition))
    orders = {trial.answers for trial in plan.trials}
    title = f"Trials of slot {plan.slot}"
    if len(orders) == 1:
        title += f"; keys from the left: {', '.join(plan.trials[0].answers)}"
    table = Table(title=title, title_justify="left")
    answered = ["correct"] if any(trial.correct for trial in plan.trials) else []
    for column in ("block", "trial", *columns, *answered, *(["keys"] if len(orders) > 1 else [])):
        table.add_column(column, overflow="fold", no_wrap=column == "trial")
    for trial in plan.trials:
        shown = [str(trial.condition.get(column, "adaptive")) for column in columns]
        right = [trial.correct or ""] if answered else []
        keys = [" ".join(trial.answers)] if len(orders) > 1 else []
        table.add_row(str(trial.block), trial.id, *shown, *right, *keys)
    return table


def _alike(scripts: Sequence[TrialScript]) -> list[list[TrialScript]]:
    """Return scripts that differ in their stimuli alone together."""
    found: list[list[TrialScript]] = []
    for script in scripts:
        for alike in found:
            if alike[0].phases == script.phases:
                alike.append(script)
                break
        else:
            found.append([script])
    return found


def _script_table(alike: Sequence[TrialScript]) -> Table:
    """Return a script in words; of several trials, their stimuli are numbered."""
    script = alike[0]
    names = [one.name for one in script.stimuli]
    if len(alike) > 1:
        names = [f"stimulus {place + 1}" for place in range(len(names))]
    width, height = script.size_px
    more = f" and {len(alike) - 4} more" if len(alike) > 4 else ""
    table = Table(
        title=f"{', '.join(one.trial for one in alike[:4])}{more}: refreshes of"
        f" {script.refresh_hz:g} Hz; pixels right and down from the middle of {width} x {height}",
        title_justify="left",
    )
    for column in ("phase", "refreshes", "shows", "gaze", "asks"):
        table.add_column(column, overflow="fold")
    for phase in script.phases:
        shows = [_in_words(entry, script, names) for entry in phase.show]
        told: dict[Picture, list[str]] = {}
        for outcome, picture in phase.follows.items():
            told.setdefault(picture, []).append(outcome)
        shows += [f"{', '.join(why)}: {_in_words(p, script, names)}" for p, why in told.items()]
        gate = f"held, waits {phase.gate_frames}" if phase.gate_frames else ""
        table.add_row(
            phase.name,
            "until answered" if phase.frames is None else str(phase.frames),
            "\n".join(shows) or "nothing",
            "watched" if phase.watched else gate,
            _asked(phase),
        )
    return table


def _asked(phase: ScriptPhase) -> str:
    """Return a question with its answers and their keys, in words."""
    question = phase.question
    if question is None:
        return ""
    keys = zip(question.answers, question.keys, strict=True)
    lines = [f"{question.name}:", *(f"{answer}: {', '.join(each)}" for answer, each in keys)]
    lines += ["or a click on a label"] if question.pointer else []
    lines += [f"void after {phase.timeout_frames}"] if phase.timeout_frames else []
    return "\n".join(lines)


def _in_words(entry: Entry, script: TrialScript, names: Sequence[str]) -> str:
    match entry:
        case Frames(stimulus=number, every=every, at=at, crop=crop):
            what = names[number] + (f", each frame for {every}" if every else "")
            what += f", its {'right' if crop[0] else 'left'} half" if crop else ""
            size = crop[2:] if crop else script.stimulus_px
        case Live(stimulus=number, at=at):
            what, size = f"{names[number]} to the gaze", script.stimulus_px
        case Picture(of=Words(text=text, labels=labels)):
            return f'"{text}"' + (f" over {', '.join(labels)}" if labels else "")
        case Picture(of=of, at=at, size_px=size):
            what = f"{of.kind} {of.sha256[:12]}" if isinstance(of, StoredPicture) else of.kind
        case Fill(rect=(left, top, *size), grey=grey):
            what, at = f"grey {grey}", (left, top)
        case _:
            assert_never(entry)
    return f"{what}, {size[0]} x {size[1]} at {at[0]:+d} {at[1]:+d}"
