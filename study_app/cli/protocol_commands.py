"""`metamerlab protocol`: write, check and plan a study."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from protocols.blocks import html_page
from protocols.disk.whole_file import decode_utf8, read_bytes, write_new
from protocols.display import Display
from protocols.errors import StudyError, count_of, must_be_one_of
from protocols.feasibility import (
    MIB,
    TRIALS_IN_MEMORY,
    clip_memory_bytes,
    clip_size_px,
    session_duration_s,
    virtual_manifest,
)
from protocols.formats.format_reference import publish, reference_text, schema_names, schema_text
from protocols.load import is_display, load_display, load_study, read_toml, shipped
from protocols.manifest import Manifest, read_manifest
from protocols.outside import parsed_json
from protocols.plan import Plan, make_plan
from protocols.revision import code_revision, package_version
from protocols.study_file.plausible import display_notes, study_notes
from protocols.study_file.preregister import preregistration, to_markdown
from protocols.study_file.schema import StudyProtocol
from study_app.cli.new_study_command import slug, study_name, study_title
from study_app.cli.option_groups import CommandGroup
from study_app.cli.options import DisplayOption, ProtocolArgument
from study_app.cli.terminal import PlainConsole, say, say_notes
from study_app.cli.trial_tables import ScriptOptions, print_scripts, trial_table

app = CommandGroup(
    help="""Write, check and plan a study.

    A protocol is the TOML file of a study; `demo`, `inpainting-2afc` and `beyond-blur-task`,
    `-preference` and `-detection` come with metamerlab.

    Examples:

        metamerlab protocol check demo

        metamerlab protocol show inpainting-2afc

        metamerlab protocol copy beyond-blur-preference my-study.toml

        metamerlab protocol preview my-study.toml --out preview.html

        metamerlab protocol preregister my-study.toml --out preregistration.html
    """,
)

StimuliOption = Annotated[
    Path | None, typer.Option("--stimuli", help="Folder of built clips, to check them as well.")
]


@app.command()
def check(
    protocol: ProtocolArgument,
    display: DisplayOption = None,
    stimuli: StimuliOption = None,
    web: Annotated[bool, typer.Option(help="Also check whether it can run in a browser.")] = False,
    gaze: Annotated[
        str | None, typer.Option(help="Gaze source of its sessions; 'doctor --gaze' opens it.")
    ] = None,
) -> None:
    """Check a protocol: every mistake at once, and whether its display can show it.

    Checks the display file too. Ends with status 2 if anything is wrong.

    Example: metamerlab protocol check my-study.toml --stimuli clips
    """
    if protocol.suffix == ".toml" and is_display(read_toml(protocol)):
        _check_display(protocol)
        return
    study, screen = load_study(protocol, display)
    if gaze is not None:
        from study_app.gaze.open_source import check_choice  # it brings every tracker along

        check_choice(study.gaze, gaze, simulate=True)
    manifest = read_manifest(stimuli) if stimuli else None
    # Imported here: they bring the renderer and the statistics along.
    from analysis.tasks import planning_notes
    from study_app.cli.build_command import require_buildable

    builder, unwritten = require_buildable(protocol, study, screen, manifest)
    plan = _plan(study, screen, manifest)
    say(
        f"{study.study.name}: in order. {count_of(plan.main_trials, 'decision')} on"
        f" {screen.name}, protocol {study.sha256[:12]}."
    )
    for line in (
        *display_notes(screen),
        *study_notes(study, screen, len(plan.trials)),
        *study.stimuli.cut_away(),
        *planning_notes(study),
    ):
        say(f"note: {line}")
    for language, why in unwritten.items():
        say(f"note: {language}: {why}")
    # No mistake of the protocol: where sessions run, built clips are enough.
    if stimuli is None and protocol.suffix == ".toml":
        say_notes(study.stimuli.problems(protocol.absolute().parent))
    say_notes((*builder.notes(), *(builder.lacking() if stimuli is None else ())))
    say_notes(_not_live_here(study))
    if web:
        from study_app.cli.sessions.web_commands import web_check

        for line in web_check(study, screen, manifest):
            say(line)


def _not_live_here(study: StudyProtocol) -> list[str]:
    """Say of pictures that follow the gaze that this machine cannot draw them."""
    from pipeline.errors import GLUnavailableError
    from pipeline.gl.context import lent_context

    if not study.stimuli.live_methods():
        return []
    try:
        with lent_context():
            return []
    except GLUnavailableError as error:
        return [f"stimuli.live: sessions cannot run on this machine: {error}"]


def _check_display(path: Path) -> None:
    screen = load_display(str(path))
    say(
        f"{screen.name}: in order, a display of {screen.width_px} x {screen.height_px} px at"
        f" {screen.refresh_hz:g} Hz, {screen.distance_mm / 10:g} cm from the eye."
    )
    say_notes(display_notes(screen))


@app.command()
def show(
    protocol: ProtocolArgument,
    display: DisplayOption = None,
    slot: Annotated[
        int | None,
        typer.Option(min=0, max=2**53, help="List the trials of this counterbalancing slot."),
    ] = None,
    *,
    scripts: ScriptOptions,
) -> None:
    """Show a protocol's trials, duration and memory, and which displays can show it.

    With --script, shows what a participant meets. What an adaptive trial shows follows from
    answers, so it has no script before. The formats are those of `protocol schema plan` and
    `script`.

    Examples:

        metamerlab protocol show inpainting-2afc --slot 0

        metamerlab protocol show demo --script --code P01 --trial main-0003

        metamerlab protocol show demo --script --code P01 --slot 2 --json > scripts.json
    """
    if not scripts.script and scripts != ScriptOptions():
        raise StudyError(
            "--code, --trial, --json, --language, --pictures and --stimuli are for --script; add it"
        )
    study, screen = load_study(protocol, display)
    if scripts.script:
        print_scripts(study, screen, slot or 0, scripts)
        return
    plan = _plan(study, screen, None, slot or 0)
    console = PlainConsole()
    console.print(_summary(study, screen, plan))
    console.print(_feasibility_table(study, screen))
    if slot is not None:
        console.print(trial_table(plan))


@app.command()
def copy(
    name: Annotated[str, typer.Argument(help="A study that comes with metamerlab.")],
    out: Annotated[Path, typer.Argument(help="A new .toml file.", metavar="FILE")],
    title: Annotated[
        str | None, typer.Option(help="Title for people to read; default: that it is a copy.")
    ] = None,
) -> None:
    """Copy a study that comes with metamerlab, to change it into one of your own.

    The copy is named like its file, draws places in the counterbalancing, and names no source: it
    is a study of your own. All comments stay.

    Example: metamerlab protocol copy beyond-blur-preference my-study.toml
    """
    studies = shipped("studies")
    if name not in studies:
        raise StudyError(must_be_one_of("NAME:", name, studies))
    own = study_name(slug(out.stem), "FILE", "choose another name for the file")
    text = decode_utf8(read_bytes(studies[name], "a study"), studies[name])
    text = text.removeprefix("#:schema ../schemas/study.schema.json\n")
    text = text.replace(f'name = "{name}"', f'name = "{own}"', 1)
    if out.suffix != ".toml":
        raise StudyError(f"{out}: the new file must end in .toml")
    shown = study_title(f"Copy of {name}" if title is None else title)
    text = re.sub(r"^title = .*$", lambda _: f'title = "{shown}"', text, count=1, flags=re.M)
    text = re.sub(r"^source = .*\n", "", text, count=1, flags=re.M)
    text = text.replace("\n[design]\n", '\n[design]\nplaces = "drawn"\n', 1)
    _write_new(out, text, "choose a new name")
    to_change = "title and description" if title is None else "description"
    say(f"{out}: {name}, as the study {own!r}. Change it, its {to_change} first, then:")
    say(f"  metamerlab protocol check {shlex.quote(str(out))}")


def _write_new(out: Path, text: str, cure: str) -> None:
    try:
        write_new(out, text.encode())
    except FileExistsError:
        raise StudyError(f"{out}: is never written over; {cure}") from None
    except OSError as error:
        raise StudyError(f"{out}: must be writable ({error.strerror})") from None


@app.command()
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


@app.command()
def schema(
    name: Annotated[
        str, typer.Argument(help=f"One of {', '.join(schema_names())}.", metavar="FORMAT")
    ] = "study",
    write: Annotated[
        bool, typer.Option(help="Write the published files of all formats (for developers).")
    ] = False,
    markdown: Annotated[bool, typer.Option(help="Print the reference for people instead.")] = False,
) -> None:
    """Print the JSON Schema of a format, for editors and other programs.

    Examples:

        metamerlab protocol schema journal > journal.schema.json

        metamerlab protocol schema study --markdown
    """
    if write:
        changed = publish()
        say("\n".join(map(str, changed)) if changed else "nothing to change")
        return
    if name not in schema_names():
        raise StudyError(must_be_one_of("FORMAT:", name, schema_names()))
    say((reference_text(name) if markdown else schema_text(name)).removesuffix("\n"))


@app.command()
def preregister(
    protocol: ProtocolArgument,
    out: Annotated[
        Path | None, typer.Option(help="A new .md or .html file; left out: print Markdown.")
    ] = None,
    display: DisplayOption = None,
    stimuli: StimuliOption = None,
    why: Annotated[
        str | None, typer.Option(help="Reason for the number of participants, in your words.")
    ] = None,
    power: Annotated[
        Path | None,
        typer.Option(help="Folder that 'metamerlab analysis power --out' wrote, to report power."),
    ] = None,
) -> None:
    """Write a preregistration: participants, design, texts, analysis, exclusions and hashes.

    Examples:

        metamerlab protocol preregister my-study.toml --out preregistration.md

        metamerlab protocol preregister my-study.toml --power power --why "As in our pilot."
    """
    from analysis.tasks import planning_notes

    study, screen = load_study(protocol, display)
    manifest = read_manifest(stimuli) if stimuli else None
    _plan(study, screen, manifest)
    revision = f"{package_version()}, revision {code_revision()}"
    found = None if power is None else _read_power(power)
    limits = planning_notes(study)
    sections = preregistration(
        study, screen, revision, manifest, why=why, power=found, limits=limits
    )
    title = f"Preregistration: {study.study.title}"
    if out is None:
        say(to_markdown(title, sections))
        return
    if out.suffix not in (".md", ".html"):
        raise StudyError(f"--out: must end in .md or .html (got {out})")
    html = out.suffix == ".html"
    text = html_page(title, sections=sections) if html else to_markdown(title, sections)
    _write_new(out, text, "a preregistration is made once. Choose a new name")
    say(out)


def _read_power(folder: Path) -> dict[str, Any]:
    path = folder / "power.json"
    data, cure = read_bytes(path, "the simulated power"), "simulate it again"
    found = parsed_json(path, data, "JSON of 'metamerlab analysis power'", StudyError, cure)
    return found if isinstance(found, dict) else {}


def _plan(study: StudyProtocol, screen: Display, manifest: Manifest | None, slot: int = 0) -> Plan:
    clips = manifest or virtual_manifest(study, screen)
    return make_plan(study.in_any_order(), clips, f"P{slot}", slot)


def _summary(study: StudyProtocol, screen: Display, plan: Plan) -> Table:
    table = Table(title=study.study.title, show_header=False, title_justify="left")
    table.add_column()
    table.add_column(overflow="fold")
    width, height = clip_size_px(study, screen)
    count = TRIALS_IN_MEMORY * study.task.stimuli_per_trial
    memory = count * clip_memory_bytes(study, screen) / MIB
    practice = sum(trial.role == "practice" for trial in plan.trials)
    catch = sum(trial.role == "catch" for trial in plan.trials)
    frames = f" of {study.stimuli.frames} frames" if study.stimuli.frames > 1 else ""
    minutes = session_duration_s(study, len(plan.trials)) / 60
    for name, value in (
        ("study", f"{study.study.name}, version {study.study.version}"),
        ("protocol hash", study.sha256),
        ("participants", str(study.study.participants)),
        ("decisions", f"{plan.main_trials} each, + {practice} practice, + {catch} catch trials"),
        ("task", f"{study.task.kind}: {study.task.description(study.pool)}"),
        ("conditions", study.task.design_sentence(study.pool)),
        ("blocks", str(study.design.blocks)),
        ("duration", f"about {minutes:.0f} min, answers in 1.5 s"),
        ("stimuli", f"{len(study.shown())}{frames}, {width} x {height} px"),
        *(("cut away", line) for line in study.stimuli.cut_away()),
        ("memory", f"{max(1, memory):.0f} MiB for two trials"),
        ("gaze", study.gaze.mode),
        ("languages", ", ".join(study.text.languages)),
    ):
        table.add_row(name, value)
    return table


def _feasibility_table(study: StudyProtocol, screen: Display) -> Table:
    # Imported here: it draws texts.
    from study_app.shown_texts import shortcomings

    table = Table(title="Feasible on", title_justify="left")
    for column in ("display", "rate", "distance", "verdict"):
        table.add_column(column)
    screens = {name: load_display(name) for name in shipped("displays")} | {screen.name: screen}
    for name, entry in sorted(screens.items()):
        problems = shortcomings(study, entry).problems
        mark = " (chosen)" if name == screen.name else ""
        verdict = "\n".join(map(str, problems)) if problems else "yes"
        table.add_row(
            name + mark, f"{entry.refresh_hz:g} Hz", f"{entry.distance_mm / 10:g} cm", verdict
        )
    return table
