"""`metamerlab protocol script`: the trials of a participant as data that any stage can draw."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_study
from protocols.manifest import read_manifest
from protocols.plan import make_plan
from protocols.result_folder import whole_folder
from protocols.script import Scripts
from protocols.suggest import did_you_mean
from study_app.cli.errors import user_errors
from study_app.cli.options import DisplayOption, ProtocolArgument, one_of
from study_app.cli.terminal import PlainConsole, say
from study_app.sittings import sitting_folder


def script(
    protocol: ProtocolArgument,
    code: Annotated[str, typer.Option(help="The participant's code.")],
    slot: Annotated[int, typer.Option(min=0, max=2**53, help="The counterbalancing slot.")] = 0,
    trial: Annotated[str | None, typer.Option(help="This trial alone, such as main-0003.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print plan and scripts as JSON, for programs.")
    ] = False,
    language: Annotated[
        str | None, typer.Option(help="Language of the texts. Default: the study's.")
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(help="New folder for the pictures, HASH.png; scripts then name the hashes."),
    ] = None,
    display: DisplayOption = None,
    stimuli: Annotated[
        Path | None, typer.Option("--stimuli", help="Folder of built clips, for their hashes.")
    ] = None,
) -> None:
    """Print a participant's plan, and the scripts of its trials: phases, pictures, questions.

    A script counts in refreshes and pixels. What an adaptive trial shows follows from answers, so
    it has no script before. The formats are those of `protocol schema plan` and `script`.

    Examples:

        metamerlab protocol script demo --code P01 --trial main-0003

        metamerlab protocol script demo --code P01 --slot 2 --json > scripts.json
    """
    # Imported here: it brings fonts and image libraries along.
    from study_app.shown_texts import require_showable

    with user_errors():
        study, screen = load_study(protocol, display)
        sitting_folder(Path(), study, code)
        spoken = study.text.default_language if language is None else language
        one_of("--language", spoken, study.text.languages)
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
        if pictures is not None:
            from study_app.paint import write_pictures

            with whole_folder(pictures) as folder:
                scripts = write_pictures(folder, scripts, study, screen)
        if as_json:
            whole = {
                "plan": plan.model_dump(mode="json"),
                "scripts": [one.model_dump(mode="json") for one in scripts],
            }
            typer.echo(json.dumps(whole, ensure_ascii=False))
            return
        from study_app.cli.protocol_commands import trial_table

        console = PlainConsole()
        console.print(trial_table(plan))
        for one in scripts[:1]:
            say(one.model_dump_json(indent=1, exclude_none=True))
        if trial is None:
            count = f"{len(scripts)} of {len(plan.trials)} trials have a script before the session"
            say(f"note: {count}; --trial names one, --json prints all")
