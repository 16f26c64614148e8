"""`metamerlab session`: run a session with a participant, or without one."""

from __future__ import annotations

import dataclasses
import gc
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from protocols.browser.browser_window import headset_in_words
from protocols.disk.whole_file import whole_path
from protocols.errors import StudyError, count_of, must_be_one_of
from protocols.journal import Attempt, SessionEnd, SessionStart
from protocols.journal_file import Journal
from protocols.latency import LatencySummary
from protocols.load import load_study
from protocols.manifest import read_manifest
from protocols.plan import make_plan
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.pairs import PairTask
from protocols.tasks.rates import RatesAnalysis
from protocols.units import Scalar
from study_app.cli.option_groups import CommandGroup
from study_app.cli.options import DisplayOption, ProtocolArgument, SessionArgument
from study_app.cli.progress import going_on
from study_app.cli.sessions.session_run_commands import register
from study_app.cli.terminal import Description, PlainConsole, say, table_of
from study_app.gaze.simulated import HUMAN, STEADY
from study_app.observers import DEFAULT_UTILITIES, ObserverModel, default_model
from study_app.operator_view import standing
from study_app.session_folders import SessionFolder, find_sessions, require_decisions
from study_app.simulate import SimulatedStudy, participant_code, simulate_study
from study_app.verification import checksums_of

GAZE_HZ = 250.0
"""Samples of a simulated eye."""

app = CommandGroup(
    help="""Run sessions with participants or artificial observers.

    Examples:

        metamerlab session check-display fhd27-60hz

        metamerlab session run demo --stimuli clips --participant P01

        metamerlab session simulate demo --out sessions --participants 11

        metamerlab session list sessions

        metamerlab session status sessions/demo/S001
    """,
)
register(app)


@dataclass(frozen=True)
class ObserverOptions:
    """Options of the artificial observers; what is left out stays as the task's own."""

    utility: Annotated[
        list[str] | None,
        typer.Option(
            help="METHOD=LOGIT, may be given more than once. Two methods 1.1 apart are preferred"
            " 75 to 25. Default: "
            + ", ".join(f"{name}={value:g}" for name, value in DEFAULT_UTILITIES.items())
        ),
    ] = None
    strength: list[str] | None = None
    """VALUE=SENSITIVITY, for tasks with a right answer: d' of a value of analysis.by at the middle
    level; may be given more than once."""
    critical: list[str] | None = None
    """VALUE=LEVEL, for abx and which-half: the level up to which a value of analysis.by cannot be
    discriminated; may be given more than once."""
    slope: float | None = None
    """Change of the sensitivity over the range of levels."""
    criterion: float | None = None
    """Tendency to say no, in units of the noise (yes-no)."""
    participant_sd: Annotated[float | None, typer.Option(min=0)] = None
    """Deviation between participants, in logits, d' or ln critical."""
    scene_sd: Annotated[float | None, typer.Option(min=0)] = None
    """Deviation between scenes, in logits, d' or ln critical."""
    lapse: Annotated[float | None, typer.Option(min=0, max=1)] = None
    """Share of blind answers. Default: .02."""
    order_bias: float | None = None
    """Logit in favour of the first of two."""

    def model(self, study: StudyProtocol) -> ObserverModel:
        """Return the default population of the task with what was asked for in its place.

        Raises
        ------
        StudyError
            If an option is not one of the task's observers, or names a value that is unknown.
        """
        model, task = default_model(study), study.task
        options = {name: value for name, value in vars(self).items() if value not in (None, [])}
        if named := options.pop("utility", None):
            known = study.stimuli.values(task.compare) if isinstance(task, PairTask) else ()
            options["utilities"] = dict(DEFAULT_UTILITIES) | _numbers("--utility", named, known)
        for name in options.keys() & {"strength", "critical"}:
            analysis = study.analysis
            known = analysis.known(task, study.pool) if isinstance(analysis, RatesAnalysis) else ()
            options[name] = _numbers(f"--{name}", options[name], known)
        if (options.keys() & {"strength", "slope"}) and hasattr(model, "critical"):
            options.setdefault("critical", {})  # they are for what has no critical level
        has = {field.name for field in dataclasses.fields(model)}
        for name in options:
            if name not in has:
                option = "--utility" if name == "utilities" else "--" + name.replace("_", "-")
                others = has & {"utilities", *vars(self)}
                raise StudyError(
                    f"{option}: must be left out for the task {task.kind!r}, whose observers have"
                    f" {', '.join(sorted(others))}"
                )
        return dataclasses.replace(model, **options)


@dataclasses.dataclass(frozen=True)
class CrowdOptions:
    """Number of observers, and their seed."""

    participants: Annotated[int, typer.Option(min=1)] = 1
    """Number of observers."""
    seed: Annotated[int, typer.Option(min=0)] = 0
    """Same seed, same answers."""


@dataclasses.dataclass(frozen=True)
class VirtualDisplayOptions:
    """Faults of the virtual display, and the virtual eye."""

    missed_per_1000: Annotated[float, typer.Option(min=0, max=1000)] = 0.0
    """Flips per thousand that miss their refresh."""
    late_per_1000: Annotated[float, typer.Option(min=0, max=1000)] = 0.0
    """Flips per thousand that come late."""
    doubled_per_1000: Annotated[float, typer.Option(min=0, max=1000)] = 0.0
    """Flips per thousand that do not wait."""
    gaze_hz: Annotated[float, typer.Option(min=1)] = GAZE_HZ
    """Gaze samples per second."""
    steady_gaze: bool = False
    """An eye that never blinks or looks away."""


@app.command()
def simulate(
    protocol: ProtocolArgument,
    out: Annotated[Path, typer.Option(help="Folder of sessions. Complete ones are kept.")],
    crowd: CrowdOptions,
    *,
    observers: ObserverOptions,
    desk: VirtualDisplayOptions,
    display: DisplayOption = None,
    stimuli: Annotated[
        Path | None, typer.Option(help="Folder of built clips. Default: clips without pixels.")
    ] = None,
) -> None:
    """Run artificial observers through the real session, on a virtual display.

    Journals have the usual format and are marked as simulated.

    Example: metamerlab session simulate demo --out sessions --participants 11
    """
    study, screen = load_study(protocol, display)
    simulation = SimulatedStudy(
        study,
        screen,
        seed=crowd.seed,
        model=observers.model(study),
        gaze=STEADY if desk.steady_gaze else HUMAN,
        gaze_rate_hz=desk.gaze_hz,
        missed_per_flip=desk.missed_per_1000 / 1000,
        late_per_flip=desk.late_per_1000 / 1000,
        doubled_per_flip=desk.doubled_per_1000 / 1000,
        manifest=read_manifest(stimuli) if stimuli else None,
    )
    plan = make_plan(study, simulation.shown, "S001", 0)
    with going_on(), _trials_done() as progress:
        task = progress.add_task("trials", total=crowd.participants * len(plan.trials))

        def on_attempt(code: str, attempt: Attempt) -> None:
            done = attempt.outcome == "completed"
            progress.update(task, description=f"{code} trials", advance=float(done))

        gc.freeze()  # what is loaded by now stays: no session need search it for garbage
        try:
            ended = simulate_study(simulation, out, crowd.participants, on_attempt=on_attempt)
        finally:
            gc.unfreeze()
    made = count_of(len(ended), "simulated session")
    decisions = sum(outcome.main_done for outcome in ended.values())
    say(f"{out / study.study.name}: {made}, {count_of(decisions, 'decision')}")
    codes = {*map(participant_code, range(crowd.participants))}
    require_decisions(
        session for session in find_sessions(out, study.study.name) if session.participant in codes
    )


def _trials_done() -> Progress:
    """Return the bar of a simulation, with the time that is left."""
    terminal = PlainConsole(stderr=True)
    return Progress(
        Description(), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=terminal, transient=True, disable=not terminal.is_terminal,
    )  # fmt: skip


@app.command("list")
def list_(
    sessions: Annotated[Path, typer.Argument(help="Folder of sessions.")],
    study: Annotated[str | None, typer.Option(help="Only this study.")] = None,
    identifiers: Annotated[
        Path | None, typer.Option(help="New file, .csv, of panels' codes, for payment. Private.")
    ] = None,
) -> None:
    """List all sessions of a folder: participant, slot, state, decisions.

    Examples:

        metamerlab session list sessions --study demo

        metamerlab session list sessions --identifiers paid.csv
    """
    found = find_sessions(sessions, study)
    if not found:
        others = {one.study for one in find_sessions(sessions)}
        if study is not None and others:
            raise StudyError(must_be_one_of(f"{sessions}: --study", study, sorted(others)))
        raise StudyError(
            f"{sessions}: must hold sessions (found no journal in SESSIONS/STUDY/CODE); name"
            " the folder that was given as --out"
        )
    if identifiers is not None:
        _write_identifiers(found, identifiers)
    heads = ["study", "participant", "slot", "state", "decisions", "void", "data"]
    latencies = list(map(_latency, found))
    heads += ["sample to flip"] * any(latencies)
    rows = [
        (*_row(one), *[told] * any(latencies)) for one, told in zip(found, latencies, strict=True)
    ]
    PlainConsole().print(table_of(heads, rows))


def _write_identifiers(sessions: Sequence[SessionFolder], path: Path) -> None:
    """Write the panel's code of each participant who has one."""
    import pandas as pd  # loaded here: a list alone needs no tables

    from analysis.tables.table_files import write_table

    starts = [(one, one.journal.events[0]) for one in sessions if one.journal.events]
    rows = [
        (start.study, one.participant, start.remote.identifier, one.state)
        for one, start in starts
        if isinstance(start, SessionStart) and start.remote and start.remote.identifier
    ]
    if not rows:
        raise StudyError(
            "--identifiers: a session must hold a panel's code (none does): web.identifier names"
            " the link's parameter to keep"
        )
    if path.exists():
        raise StudyError(f"--identifiers: must be a new file (got {path}); name another one")
    heads = ["study", "participant", "identifier", "state"]
    with whole_path(path) as part:
        write_table(pd.DataFrame(rows, columns=heads), part)


@app.command()
def status(
    session: SessionArgument,
) -> None:
    """Show the state of a session: blocks, void attempts, missed refreshes, gaze, damage.

    Example: metamerlab session status sessions/demo/S001
    """
    if not session.is_dir():
        raise StudyError(f"{session}: must be the folder of one session (there is no such folder)")
    absolute = session.resolve()
    beside = find_sessions(absolute.parent.parent, absolute.parent.name)
    found = next((one for one in beside if one.folder.resolve() == absolute), None)
    if found is None:
        raise StudyError(
            f"{session}: must be the folder of one session (found no journal there);"
            " 'metamerlab session list' names them"
        )
    PlainConsole().print(table_of((), _details(found)))


def _numbers(option: str, given: list[str], known: Sequence[Scalar]) -> dict[str, float]:
    names = [str(value) for value in known]
    found = {}
    for entry in given:
        name, equals, value = entry.partition("=")
        if names and name not in names:
            raise StudyError(must_be_one_of(f"{option}: NAME", name, names))
        try:
            found[name] = float(value)
        except ValueError:
            raise StudyError(
                f"{option}: must be NAME=NUMBER{' with a number' if equals else ''} (got {entry!r})"
            ) from None
    return found


def _row(session: SessionFolder) -> tuple[str, ...]:
    attempts = session.journal.attempts
    voids = sum(attempt.outcome == "void" and attempt.role == "main" for attempt in attempts)
    if session.state in {"damaged", "withdrawn", "stillborn"}:
        slot, planned, data = "", "", ""
    else:
        start = session.journal.start
        slot, planned = str(start.slot), f" of {start.trials}"
        data = _data_of(start)
        data += ", browser" if start.remote else ""
    return (
        session.study, session.participant, slot, session.state,
        f"{session.main_done}{planned}", str(voids), data,
    )  # fmt: skip


def _latency(session: SessionFolder) -> str:
    """Return the age of gaze in frames that followed it; empty where none did."""
    live = [attempt.live for attempt in session.journal.attempts if attempt.live is not None]
    found = LatencySummary.of(live)
    if found.median_ms is None:
        return "none" if live else ""
    return f"{found.median_ms:.1f} ms, 95 % {found.p95_ms:.1f}, most {found.max_ms:.1f}"


def _data_of(start: SessionStart) -> str:
    """Return the kind of data: with a mouse for an eye, or a timer, only a rehearsal."""
    if start.simulated:
        return "simulated"
    stand_ins = [
        name
        for name, used in (
            ("mouse", start.gaze is not None and start.gaze.source == "mouse"),
            ("timer", start.timing_evidence == "software timer"),
        )
        if used
    ]
    return f"rehearsal ({' and '.join(stand_ins)})" if stand_ins else "real"


def _browser(journal: Journal) -> list[tuple[str, str]]:
    """Return the evidence for a session in a browser; nothing for one at a desk."""
    remote, off_s = journal.start.remote, journal.time_off_s
    if remote is None or off_s is None:
        return []
    machine = remote.machine
    return [
        (
            "browser",
            f"{machine.browser}, {machine.refresh_hz:g} Hz, screen pixels x{machine.scale}",
        ),
        *([("headset", headset_in_words(machine.headset))] if machine.headset else []),
        *(("went on at", change) for change in journal.rate_changes),
        ("frames", "files hashed before they were decoded; stamped by animation frames"),
        ("times", f"up to {1000 * off_s:.3g} ms from those stated"),
        ("slot from", remote.slot_from),
    ]


def _details(session: SessionFolder) -> list[tuple[str, str]]:
    journal = session.journal
    attempts = journal.attempts
    details = [("session", f"{session.study} / {session.participant}"), ("state", session.state)]
    details += [("damaged", f"line {line.line}: {line.reason}") for line in journal.damaged]
    if journal.has_lines:
        details.append(("checksums", checksums_of(journal)))
    if journal.torn:
        details.append(("last line", "torn: the program was killed while writing it"))
    if session.state in {"damaged", "withdrawn", "stillborn"} and not attempts:
        return details
    if not journal.damaged:
        start = journal.start
        gaze = f"{start.gaze.source}, {start.gaze.rate_hz:g} Hz" if start.gaze else "none"
        details += [
            ("data", _data_of(start).replace("simulated", "SIMULATED")),
            ("slot", str(start.slot)),
            ("begun", start.at),
            ("display", f"{start.display}, {start.refresh_hz:g} Hz"),
            ("gaze", f"{start.gaze_mode} ({gaze})"),
            *_browser(journal),
            ("decisions", f"{session.main_done} of {start.trials}"),
        ]
    now = standing(journal.events)
    details += now.rows(" of the watched time")
    if told := _latency(session):
        details.append(("sample to flip", told))
    last = journal.events[-1] if journal.events else None
    if isinstance(last, SessionEnd):
        details.append(("ended", f"{last.reason}, {last.at}"))
    if now.message:
        details.append(("message", now.message))
    return details
