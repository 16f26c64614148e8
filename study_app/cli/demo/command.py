"""`metamerlab demo`: the whole chain on real input, with nothing to bring."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from protocols.disk.result_folder import remove_listed, stranger
from protocols.errors import StudyError
from study_app.cli.progress import going_on
from study_app.cli.terminal import PlainConsole


def demo(
    out: Annotated[Path, typer.Option(help="Folder to fill; made if it is missing.")] = Path(
        "out/demo"
    ),
    pictures_only: Annotated[
        bool, typer.Option(help="Only warp and fill one photograph, without a study.")
    ] = False,
    participants: Annotated[
        int, typer.Option(min=2, help="Simulated observers, the one before the window included.")
    ] = 12,
    display: Annotated[
        str | None,
        typer.Option(
            help="Show the window on this machine's screen, which this display file (or name)"
            r" describes. \[default: a screen of its own without a monitor]",
            show_default=False,
        ),
    ] = None,
    no_window: Annotated[
        bool, typer.Option(help="Simulate every observer without a window.")
    ] = False,
    no_studies: Annotated[
        bool, typer.Option(help="Leave out foveated pictures, their studies, and another task.")
    ] = False,
    fresh: Annotated[
        bool, typer.Option(help="Delete an earlier demonstration there first.")
    ] = False,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of noise and observers: same seed, same results.")
    ] = 0,
) -> None:
    """See the whole chain at work: clips, sessions, report.

    A pair of photographs and two rendered scenes are warped, and their holes are filled.
    Simulated observers compare the fills in real sessions, one of them in a real window. Their
    answers are analysed. Each study on foveated pictures shows its trials and a report. The
    demonstration runs the commands that a study runs, and prints them. One page shows and links
    all: OUT/index.html. The same command continues after an interruption, and keeps what is done.

    Examples:

        metamerlab demo --out out/demo

        metamerlab demo --pictures-only --out out/pictures
    """
    if no_window and display is not None:
        raise StudyError(
            "--no-window and --display exclude each other: a display is where the window goes"
        )
    from study_app.cli.demo.demonstration import RECORD_NAME, run_demo
    from study_app.cli.demo.steps import Options

    if fresh and out.exists():
        if not (out / RECORD_NAME).is_file():
            raise StudyError(
                f"--fresh: {out} must be the folder of a demonstration (it holds no"
                f" {RECORD_NAME}); nothing was deleted"
            )
        if strange := stranger(out):
            raise StudyError(
                f"--fresh: {out} must hold nothing but a demonstration (it holds {strange},"
                " which none listed as its own); nothing was deleted: move that away, or delete"
                " the folder yourself"
            )
        remove_listed(out)
    console = PlainConsole(soft_wrap=True)
    if not pictures_only:
        console.print("The demonstration takes some minutes. Observers are simulated.")
    options = Options(
        out,
        observers=participants,
        window=not no_window,
        # Commands run in the folder of the demonstration.
        display=str(Path(display).resolve()) if display and Path(display).exists() else display,
        seed=seed,
        studies=not no_studies,
        pictures_only=pictures_only,
    )
    with going_on():
        page = run_demo(options, console)
    console.print(f"Look at {page} (open it in a browser)", style="bold")
