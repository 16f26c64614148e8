"""`metamerlab stimuli export-holes`: warped frames and masks, for other programs to fill."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from protocols.errors import StudyError
from protocols.prose import count_of
from study_app.cli.options import DisplayOption, ProtocolArgument
from study_app.cli.progress import progress_line
from study_app.cli.terminal import say, say_notes


def export_holes(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="A new or empty folder.")],
    display: DisplayOption = None,
) -> None:
    """Write a study's warped frames with masks and depth, for another program to fill.

    A README in the folder says what to send back. What comes back enters the study as the
    method 'frames:FOLDER/{scene}/{size}', and frames of another scene are refused.

    Example: metamerlab stimuli export-holes my-study.toml --out holes
    """
    from protocols.load import load_study
    from stimuli.build_plan import BuildPlan
    from stimuli.export_holes import export_holes as write
    from stimuli.recipes.warped_checks import look_at_scenes

    study, screen = load_study(protocol, display)
    plan = BuildPlan(study, screen, protocol.absolute().parent)
    found = look_at_scenes(plan)
    if found.wrong:
        raise StudyError("\n".join(f"{protocol}: {problem}" for problem in found.wrong))
    say_notes(found.doubtful)
    with progress_line("starting") as report:
        frames = write(plan, out, report)
    made = count_of(frames, "frame")
    say(f"{out}: {made} with holes; {out / 'README.md'} says what to send back")
