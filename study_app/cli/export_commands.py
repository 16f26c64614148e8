"""`metamerlab analysis export`: a study in the form that an archive or another program reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from analysis.export import EYES, FORMATS, ExportOptions
from protocols.errors import StudyError
from study_app.cli.options import (
    SessionsArgument,
    SessionsProtocolOption,
    one_of,
    recorded_protocol,
)
from study_app.cli.progress import one_line
from study_app.cli.terminal import say, say_notes


@dataclass(frozen=True)
class ExportedOptions:
    """Content of an export, and statements on the sessions."""

    public: bool = False
    """Renumber participants, and leave out wall-clock times, typed answers, notes, the names of
    machines, devices and folders, and what tells codes or who came when."""
    display: list[str] | None = None
    """bids: display that sessions were recorded on, if not the protocol's; may be given more than
    once."""
    recorded_eye: Annotated[str, typer.Option(metavar="|".join(EYES))] = "cyclopean"
    """Eye that the tracker reported (bids); cyclopean: both."""
    author: list[str] | None = None
    """Author of the data set; may be given more than once."""
    licence: str = ""
    """Licence of the data set, such as CC0."""


def export(
    sessions: SessionsArgument,
    protocol: SessionsProtocolOption,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="|".join(FORMATS),
            help="bids or pwcmp (preferences only).",
        ),
    ],
    out: Annotated[Path, typer.Option(help="New folder. It appears only when complete.")],
    *,
    content: ExportedOptions,
) -> None:
    """Export sessions for an archive (BIDS) or for the program pwcmp.

    Journals are only read. Participants who withdrew or did not consent are never exported.
    Incomplete sessions are exported and marked. Read a public export before you publish it: the
    program cannot judge the study's own texts.

    Examples:

        metamerlab analysis export sessions --protocol demo --format bids --out bids

        metamerlab analysis export sessions --protocol demo --format bids --out shared --public

        metamerlab analysis export sessions --protocol demo --format pwcmp --out pwcmp
    """
    from analysis.export.write_export import export_study
    from protocols.gone import gone
    from protocols.load import load_display

    study = recorded_protocol(protocol)
    if message := gone(f"analysis export --format {form}"):
        raise StudyError(f"--format {form} {message}")
    chosen = one_of("--format", form, FORMATS)
    eye = one_of("--recorded-eye", content.recorded_eye, EYES)
    names = content.display or ([study.display.display] if chosen == "bids" else [])
    options = ExportOptions(
        public=content.public,
        displays=tuple(load_display(name, beside=protocol) for name in names),
        recorded_eye=eye,
        authors=tuple(content.author or ()),
        licence=content.licence,
    )
    with one_line() as progress:
        made = export_study(sessions, study, out, chosen, options, progress=progress)
    say_notes(made.notes)
    mark = " SIMULATED" if made.simulated else ""
    say(f"{made.folder}: {made.participants}{mark} participants as {chosen}")
