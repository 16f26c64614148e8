"""`metamerlab demo`: the whole chain on real input, with nothing to bring."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from protocols.disk.result_folder import remove_listed, stranger
from protocols.errors import StudyError
from study_app.cli.demo.steps import Options
from study_app.cli.progress import going_on
from study_app.cli.terminal import PlainConsole


def demo(options: Options) -> None:
    """See the whole chain at work: clips, sessions, report.

    A photograph is filled in three ways, and a metamer of it is made beside a blur. Simulated
    observers compare the fills in a small study, and the report is written: a minute in all. With
    --all one observer sits before a real window, more clips are made, and each study on foveated
    pictures shows its trials and a report: ten minutes. The demonstration runs the commands that
    a study runs, and prints them. One page shows all, and can be sent: OUT/index.html. The same
    command continues after an interruption, and keeps what is done.

    Examples:

        metamerlab demo --out out/demo

        metamerlab demo --all --out out/all
    """
    out = options.out
    if options.display is not None and not options.all:
        raise StudyError("--display must stand beside --all: no other demonstration has a window")
    from study_app.cli.demo.demonstration import RECORD_NAME, run_demo

    if options.fresh and out.exists():
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
    console.print("Observers are simulated.")
    if options.all:
        options = replace(options, study="showcase")
    display = options.display
    if display and Path(display).exists():  # commands run in the folder of the demonstration
        options = replace(options, display=str(Path(display).resolve()))
    with going_on():
        page = run_demo(options, console)
    console.print(f"Look at {page} (open it in a browser)", style="bold")
