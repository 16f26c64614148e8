"""The commands of `metamerlab session` for studies in a browser: export, and what comes home."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from protocols.browser.web_study import BUDGET_MB, DECODED_MB, MB, STUDY_FILE
from protocols.disk.hashing import sha256_file
from protocols.disk.result_folder import without_links
from protocols.display import Display
from protocols.errors import StudyError, count_of
from protocols.feasibility import virtual_manifest
from protocols.load import load_study
from protocols.manifest import Manifest, read_manifest
from protocols.study_file.schema import StudyProtocol
from study_app.cli.options import DisplayOption, NewFolderOption, ProtocolArgument
from study_app.cli.terminal import PlainConsole, say, say_notes
from study_app.session_folders import require_no_batch

if TYPE_CHECKING:  # pictures and fonts load where a study is looked at
    from study_app.web.export import BrowserNeeds, WebBuild

BudgetOption = Annotated[
    float, typer.Option(min=1, max=1e6, help="Most that one participant may have to fetch, in MB.")
]
DecodedOption = Annotated[
    float, typer.Option(min=1, max=1e6, help="Most that the stimuli of two trials may take, in MB.")
]
LINE_MB_PER_S = 2.5
"""Speed of a participant's line at home: 20 Mbit/s."""


def export_web(
    protocol: ProtocolArgument,
    stimuli: Annotated[Path, typer.Option(help="Folder of the built stimuli.")],
    out: NewFolderOption,
    jatos: Annotated[
        Path | None, typer.Option(help="Also write a study archive for JATOS, NAME.jzip.")
    ] = None,
    budget_mb: BudgetOption = BUDGET_MB,
    decoded_mb: DecodedOption = DECODED_MB,
    display: DisplayOption = None,
) -> None:
    """Write a study as a folder that a browser runs: put it on any web server, or into JATOS.

    The study needs a section [web]. The folder holds frames, pictures, texts and the page, and no
    secret of the study. Links with ?slot=NUMBER give each participant a place in the
    counterbalancing. Results come home with 'metamerlab session import-web'.

    Examples:

        metamerlab session export-web my-study.toml --stimuli clips --out web

        metamerlab session export-web my-study.toml --stimuli clips --out web --jatos my-study.jzip
    """
    from study_app.web.export import WebBuild

    study, screen = load_study(protocol, display)
    if jatos is not None and (jatos.exists() or jatos.suffix not in (".jzip", ".zip")):
        raise StudyError(
            f"--jatos: must be a new file, NAME.jzip (got {jatos}"
            f"{', which exists' if jatos.exists() else ''})"
        )
    folder = without_links(jatos).parent if jatos else Path()
    if not folder.is_dir() or folder == without_links(out):
        raise StudyError(
            f"--jatos: must lie in a folder that exists, and not in --out (got {jatos})"
        )
    build = WebBuild(study, screen, read_manifest(stimuli))
    needs = build.write(stimuli, out, budget_mb=budget_mb, decoded_mb=decoded_mb)
    for line in needs_lines(build, needs):
        say(line)
    if jatos is not None:
        from study_app.web import jzip

        identity = f"{study.sha256}:{sha256_file(out / 'study.json')}"
        people = study.study.participants
        name, title = study.study.name, study.study.title
        jzip.write(out, jzip.jas_text(name, title, "index.html", identity, people), jatos)
        say(f"{jatos}: import it into JATOS as a study.")
    say(f"{out}: complete. Links for {count_of(study.study.participants, 'participant')}:")
    for slot in range(study.study.participants):
        say(f"  index.html?slot={slot}")


def import_web(
    results: Annotated[
        list[Path], typer.Argument(help="Archives of JATOS, texts of lines, or folders of these.")
    ],
    protocol: Annotated[Path, typer.Option(help="The study's file (.toml) that was exported.")],
    stimuli: Annotated[Path, typer.Option(help="Folder of the stimuli that were exported.")],
    sessions: Annotated[
        Path, typer.Option("--sessions", "--out", help="Folder of sessions to add to.")
    ] = Path("sessions"),
    check: Annotated[bool, typer.Option(help="Only say what would happen; write nothing.")] = False,
    display: DisplayOption = None,
) -> None:
    """Make sessions of the lines that browsers sent, as 'metamerlab session run' writes them.

    Every trial is run again on the times and keys that were observed, and must end as the browser
    says. Lines that came twice, torn, mixed or in pieces are told apart. A participant whose lines
    contradict the study or each other is named and left out. What is there already stays; lines
    that came later are added. Ends with status 2 if a participant was left out.

    Examples:

        metamerlab session import-web jatos-results.zip --protocol my-study.toml --stimuli clips

        metamerlab session import-web lines/ --protocol my-study.toml --stimuli clips --check
    """
    # Imported here: most commands of sessions need none of it.
    from study_app.web.import_lines import import_results
    from study_app.web.read_results import read_web_results

    require_no_batch(sessions)
    study, screen = load_study(protocol, display, recorded=True)
    manifest = read_manifest(stimuli)
    inbox = read_web_results(results)
    for damaged in inbox.damaged:
        say(f"note: {damaged}; left out", file=sys.stderr)
    if inbox.damages > len(inbox.damaged):
        say(f"note: and {inbox.damages - len(inbox.damaged)} more", file=sys.stderr)
    say_notes(inbox.notes)
    found = import_results(inbox, study, screen, manifest, sessions, write=not check)
    table = Table("participant", "state", "attempts", "ended", "", box=None, header_style="")
    for one in found:
        table.add_row(one.participant, one.state, str(one.attempts), one.reason or "-", one.message)
    PlainConsole().print(table)
    others = sorted({name for name, _ in inbox.found} - {study.study.name})
    if others:
        more = f" and {len(others) - 5} more" if len(others) > 5 else ""
        say(f"note: lines of other studies were left out: {', '.join(others[:5])}{more}")
    refused = [one for one in found if one.state == "refused"]
    left_out = inbox.unread
    if refused:
        left_out = [
            f"{count_of(len(refused), 'participant')} left out:"
            f" {', '.join(one.participant for one in refused)}; the table says why",
            *left_out,
        ]
    if left_out:
        raise StudyError("\n".join(left_out))


def web_check(study: StudyProtocol, screen: Display, manifest: Manifest | None) -> Iterator[str]:
    """Yield the lines of `protocol check --web` on a study.

    Raises
    ------
    StudyError
        If it cannot run in a browser.
    """
    from protocols.browser.web_study import web_design
    from study_app.web.export import WebBuild, check_budget

    build = WebBuild(study, screen, manifest or virtual_manifest(study, screen))
    web_design(study.in_a_browser().in_any_order())
    needs = build.needs()
    yield from needs_lines(build, needs)
    if build.headset and build.headset.turn_deg is not None:
        yield (
            f"void beyond a turn of the head by {build.headset.turn_deg:g} deg, which is not"
            " fixation: eyes move in a head that is still"
        )
    if study.gaze.mode != "none":
        yield f"dropped in a browser: gaze is not watched there (gaze.mode = {study.gaze.mode!r})"
    yield "dropped in a browser: gamma and luminance of the screen, viewing distance, photodiode"
    check_budget(needs, build)


def shared_lines(build: WebBuild) -> Iterator[str]:
    """Yield the effect of a share of the scenes on the decisions of a study, where it has one."""
    from protocols.plan import planned_trials, rounds, scenes_at, windows

    count = windows(build.shown)
    if count == 1:
        return
    study = build.study
    desk = planned_trials(study.in_any_order(), "web", 0)
    every = sum(trial.role == "main" for trial in desk)
    people = study.study.participants
    as_many = -(-people * every // build.decisions)
    both = rounds(build.shown)[0] * count
    yield (
        f"each participant is shown {len(scenes_at(build.shown, 0))} of"
        f" {len(study.main_scenes())} scenes and decides {build.decisions} times instead of"
        f" {every}; {as_many} participants instead of {people} decide as often on each condition"
        " ('analysis power' takes all scenes for each)"
    )
    yield (
        f"all scenes are shown to equally many after every {count_of(count, 'participant')}, with"
        f" arrangements and keys after {both}"
    )


def needs_lines(build: WebBuild, needs: BrowserNeeds) -> Iterator[str]:
    """Yield the study's needs of a browser, and what participants can read of it, in sentences."""
    from study_app.web.screens import headset_lines, screen_lines

    yield from headset_lines(build) if build.headset else screen_lines(build)
    for rate, wrong in build.rates.items():
        if wrong:
            yield f"not at {rate:g} Hz: {wrong[0]}"
    seconds = needs.fetched_bytes / MB / LINE_MB_PER_S
    about = "about " * needs.estimated
    yield (
        f"per participant: {about}{needs.fetched_bytes / MB:.1f} MB ({seconds:.0f} s at 20 Mbit/s),"
        f" {needs.decoded_bytes / MB:.0f} MB in memory, {build.duration_s / 60:.0f} min"
        + "; an estimate: the export says what the stimuli take"
        * needs.estimated
    )
    yield from shared_lines(build)
    web = build.study.web
    for key in ("completion_code", "completion_url"):
        if web is not None and getattr(web, key) is not None:
            yield (
                f"web.{key} is public: every participant can read it in {STUDY_FILE} before the"
                " end; pay by 'session list', or have JATOS lead on at the end (End Redirect URL)"
            )
