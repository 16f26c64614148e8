"""`metamerlab protocol preview`: a study as a page to play."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from protocols.errors import StudyError
from protocols.load import load_study
from protocols.manifest import read_manifest
from study_app.cli.options import DisplayOption, ProtocolArgument
from study_app.cli.terminal import say, say_notes


def preview(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="Page to write, .html.")] = Path("preview.html"),
    display: DisplayOption = None,
    stimuli: Annotated[
        Path | None,
        typer.Option("--stimuli", help="Folder of built clips. Default: boxes stand for them."),
    ] = None,
    most: Annotated[int, typer.Option(min=1, help="Largest number of conditions to show.")] = 24,
) -> None:
    """Write a page that plays one trial of each condition, without display, gaze or participants.

    It also has every page of text in every language, each trial's timeline to scale, and the gaze
    window drawn in. One file that opens offline in any browser.

    Examples:

        metamerlab protocol preview demo --out demo.html

        metamerlab protocol preview study.toml --stimuli clips --out preview.html
    """
    from study_app.preview import MARK, preview_page

    if out.suffix != ".html":
        raise StudyError(f"--out: must end in .html (got {out})")
    if out.exists() and not (out.is_file() and MARK in out.read_text("utf-8", "replace")):
        raise StudyError(
            f"{out}: must be new, or an earlier preview (it is something else); choose another name"
        )
    study, screen = load_study(protocol, display)
    manifest = None if stimuli is None else read_manifest(stimuli)
    made = preview_page(study, screen, stimuli=stimuli, manifest=manifest, most=most)
    # Imported here: `stimuli` brings image libraries along.
    from protocols.disk.whole_file import write_whole

    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, made.html.encode())
    except OSError as error:
        raise StudyError(f"{out}: must be writable ({error.strerror})") from None
    say(f"{out}: {made.shown} of {made.conditions} conditions, {len(made.html) / 1e6:.1f} MB.")
    say_notes(made.notes)
    if made.shown < made.conditions:
        say(f"note: --most {made.conditions} shows all")
