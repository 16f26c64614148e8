"""`metamerlab analysis`: from journals to tables, statistics, plots and the report."""

from __future__ import annotations

import dataclasses
import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis import SEED
from protocols.errors import StudyError, count_of
from protocols.tasks.task_kinds import TASKS
from study_app.cli.export_commands import export
from study_app.cli.option_groups import CommandGroup
from study_app.cli.options import (
    SESSIONS_PROTOCOL_HELP,
    FiguresOption,
    NewFolderOption,
    ReplaceOption,
    SessionsArgument,
    SessionsProtocolOption,
    assumed_values,
    pairs,
    recorded_protocol,
)
from study_app.cli.progress import one_line
from study_app.cli.table_commands import (
    AnswerOption,
    WhereOption,
    detection,
    psychometric,
    ratings,
    reaction,
    table_told,
)
from study_app.cli.terminal import PlainConsole, say, say_notes, table_of

if TYPE_CHECKING:  # a command imports its own part of the analysis when it runs
    import pandas as pd

    from analysis.parts import AnalysisPlan
    from analysis.power_curves import Power
    from analysis.report.report_source import Progress, TableSettings
    from analysis.tables.counts import Counted
    from protocols.study_file.schema import StudyProtocol

app = CommandGroup(
    help="""Statistics, plots and the report, from the journals of a study.

    Examples:

        metamerlab analysis power demo --rate 0.65

        metamerlab analysis report sessions --protocol demo --out report

        metamerlab analysis tidy sessions --protocol demo --out tables

        metamerlab analysis import old.csv --map participant=subject --out imported

        metamerlab analysis import old.csv --task yes-no --set signal=seen --out imported

        metamerlab analysis psychometric acuity.csv --level ecc_deg --by method

        metamerlab analysis detection seen.csv --signal seen --by method

        metamerlab analysis export sessions --protocol demo --format bids --out bids
    """,
)


@dataclasses.dataclass(frozen=True)
class ReportedTable:
    """Options of a report on a table alone."""

    title: str | None = None
    """Top of the page, for a table only; left out: its file's name."""
    where: WhereOption = None
    told: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None
    """Settings of the analysis, in place of what is noted beside it, such as primary=ours/blur,
    alpha=0.01 or label.ours='Our method'; may be given more than once."""

    def settings(self, study: StudyProtocol | None) -> TableSettings:
        """Return them as the report takes them."""
        from analysis.report.report_source import TableSettings

        return TableSettings(study, self.title, self.where or (), pairs("--set", self.told or ()))

    def refuse_for_sessions(self, study: StudyProtocol) -> None:
        """Refuse what the protocol of sessions says."""
        if self.title is not None:
            raise StudyError(
                "--title must be left out for sessions: the protocol has it as study.title"
                f" ({study.study.title!r})"
            )
        if self.where is not None or self.told is not None:
            raise StudyError(
                "--where and --set must be left out for sessions: the protocol says in"
                " [analysis] what is left out, and how they are analysed"
            )


@app.command()
def report(
    sessions: Annotated[
        Path,
        typer.Argument(
            help="Folder of sessions, searched to any depth; or a decisions.csv made by"
            " `analysis import` or `analysis tidy` (decisions.json beside it notes the task)."
        ),
    ],
    out: NewFolderOption,
    protocol: Annotated[
        Path | None, typer.Option(help=SESSIONS_PROTOCOL_HELP + " Optional for a table only.")
    ] = None,
    *,
    of_table: ReportedTable,
    figures: FiguresOption = "svg",
    replace: ReplaceOption = False,
) -> None:
    """Analyse a study and write a report: one HTML page, a JSON of every number, tables, figures.

    The page opens offline and prints well. Exclusion rules come from the protocol. Sessions of
    two protocols are refused. Simulated data are marked on every page and figure. Running again
    gives the same numbers to the last digit.

    Example: metamerlab analysis report sessions --protocol demo --out report
    """
    from analysis.report.write_report import report_decisions, report_sessions

    study = recorded_protocol(protocol) if protocol else None
    with one_line() as progress:
        if sessions.suffix.lower() in (".csv", ".tsv", ".xlsx", ".ods") and not sessions.is_dir():
            made = report_decisions(
                sessions,
                out,
                table=of_table.settings(study),
                replace=replace,
                figure_files=figures,
                progress=progress,
            )
        elif study is None:
            table = sessions / "decisions.csv"
            raise StudyError(
                "--protocol must name the protocol of the sessions"
                " (only a table of decisions goes without one"
                + f"; there is one: metamerlab analysis report {table}" * table.is_file()
                + ")"
            )
        else:
            of_table.refuse_for_sessions(study)
            made = report_sessions(
                sessions,
                study,
                out,
                replace=replace,
                figure_files=figures,
                progress=progress,
            )
    say_notes(made.warnings)
    say(made.headline)
    say(f"report: {made.html}")


@app.command()
def tidy(
    sessions: SessionsArgument,
    protocol: SessionsProtocolOption,
    out: NewFolderOption,
    replace: ReplaceOption = False,
) -> None:
    """Write journals as tidy CSV tables: one row per attempt, per decision, per session.

    dictionary.csv explains every column, flow.csv lists what the protocol's rules left out,
    participants.csv how many people reached each step, demographics.csv what they chose in closing
    questions, and decisions.json names the task of decisions.csv.

    Example: metamerlab analysis tidy sessions --protocol demo --out tables
    """
    from analysis.tables.table_files import write_table
    from analysis.tasks import analysis_of
    from analysis.tasks.note import write_note
    from analysis.tidy import read_sessions, write_tables
    from protocols.disk.result_folder import whole_folder

    study = recorded_protocol(protocol)
    with (
        one_line() as progress,
        whole_folder(out, replace=replace, reads=[sessions]) as work,
    ):
        tables = read_sessions(sessions, study, progress=progress)
        write_tables(tables, study, work)
        analysis = analysis_of(study.analysis.kind)
        for name, table in analysis.tidy_tables(tables.analysed).items():
            write_table(table, work / name)
        write_note(work / "decisions.csv", analysis.section_of_table(analysis.plan(study)))
    say_notes(tables.warnings)
    kept, every = len(tables.analysed), int((tables.decisions["kind"] == "main").sum())
    mark = " SIMULATED" if tables.simulated else ""
    say(f"{out}: {len(tables.sessions)}{mark} sessions, {kept} of {every} main decisions kept")


@dataclasses.dataclass(frozen=True)
class DesignOptions:
    """A design without a protocol."""

    pair_count: Annotated[int | None, typer.Option("--pairs")] = None
    """Without a protocol: pairs of methods."""
    scenes: int | None = None
    """Without a protocol: scenes."""
    repeats: int | None = None
    """Without a protocol: decisions of a person on a pair in a scene."""
    participants: int | None = None
    """Without a protocol: how many there are."""

    def study(self) -> StudyProtocol:
        """Return a study of preferences with these numbers."""
        from protocols.study_file.new_study import preferences_of

        sizes = (self.pair_count, self.scenes, self.repeats, self.participants)
        numbers = dict(zip(("pairs", "scenes", "repeats", "participants"), sizes, strict=True))
        missing = [f"--{name}" for name, value in numbers.items() if value is None]
        if missing:
            raise StudyError(
                "power needs a protocol, or all numbers of a design (missing:"
                f" {', '.join(missing)}); metamerlab analysis power --pairs 3 --scenes 6"
                " --repeats 2 --participants 11 --rate 0.65"
            )
        return preferences_of(**{name: value or 0 for name, value in numbers.items()})


@dataclasses.dataclass(frozen=True)
class AssumedOptions:
    """Assumptions of a simulation of power."""

    rate: float | None = None
    """Short for --set rate=..., of preferences."""
    assume: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=NUMBER")] = None
    """Assumption of the simulation; may be given more than once. The command prints the
    defaults."""
    pilot: Annotated[Path | None, typer.Option("--from")] = None
    """A pilot's sessions of this protocol, or a decisions.csv of another: they say how much people
    and scenes differ. --set takes precedence."""
    participant_sd: float | None = None
    """Short for --set participant_sd=..."""
    scene_sd: float | None = None
    """Short for --set scene_sd=..."""

    def values(self) -> tuple[dict[str, str], dict[str, str]]:
        """Return all that is given by name, and what of it by options of its own."""
        shorts = {name: getattr(self, name) for name in ("rate", "participant_sd", "scene_sd")}
        own = {name: f"{value:g}" for name, value in shorts.items() if value is not None}
        return pairs("--set", self.assume or ()) | own, own


@app.command()
def power(
    protocol: Annotated[
        Path | None,
        typer.Argument(
            help="The study's file (.toml), or the name of a shipped study; left out: --pairs,"
            " --scenes, --repeats and --participants say the design."
        ),
    ] = None,
    *,
    design: DesignOptions,
    assumed: AssumedOptions,
    studies: Annotated[
        int | None,
        typer.Option(min=100, help="Studies to simulate. Default: as many as take seconds."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same numbers.")] = SEED,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the curve (SVG, PDF, PNG) and a JSON.")
    ] = None,
    replace: ReplaceOption = False,
) -> None:
    """Compute the participants that a study needs, by simulating its own design and test.

    Power is the chance that such a study finds the effect. The assumed effect depends on the
    task and is printed: a share of choices for pairs, d' or shares of right answers for other
    tasks. Deviations say how much people and scenes differ.

    Examples:

        metamerlab analysis power demo --rate 0.65 --out power

        metamerlab analysis power demo --rate 0.65 --from pilot-sessions --out power

        metamerlab analysis power detection.toml --set d_prime=1.2 --set difference=0.5

        metamerlab analysis power --pairs 3 --scenes 6 --repeats 2 --participants 11 --rate 0.65
    """
    import numpy as np

    from analysis.power import power as simulated_power
    from analysis.tasks import analysis_of
    from protocols.disk.result_folder import check_result, whole_folder
    from protocols.load import load_protocol

    pilot = assumed.pilot
    reads = () if pilot is None else [pilot]
    if out is not None:
        check_result(out, replace=replace, reads=reads)
    study = design.study() if protocol is None else load_protocol(protocol)
    if protocol is not None and design != DesignOptions():
        raise StudyError(
            "--pairs, --scenes, --repeats and --participants are for a design without a"
            f" protocol (got {protocol} too); leave one of both out"
        )
    simulation = analysis_of(study.analysis.kind).simulation(study)
    given, shorts = assumed.values()
    known = simulation.assumptions
    with one_line() as progress:
        notes: Sequence[str] = ()
        if pilot is not None:
            values, notes = simulation.from_pilot(*_pilot(pilot, study, progress))
            known = tuple(dataclasses.replace(a, value=values.get(a.name, a.value)) for a in known)
        found = simulated_power(
            simulation,
            assumed_values(known, given, shorts),
            rng=np.random.default_rng(seed),
            studies=studies,
            designs=True,
            progress=lambda done, total: progress("simulating studies", done, total),
        )
    if out is not None:
        with whole_folder(out, replace=replace, reads=reads) as work:
            _write_power(found, work)
    _print_power(dataclasses.replace(found, warnings=(*notes, *found.warnings)))
    if out is not None:
        say(f"curve: {out / 'power-2-column.png'}")


@dataclasses.dataclass(frozen=True)
class ImportOptions:
    """Task of an imported table, its columns, and settings of its analysis."""

    task: Annotated[str, typer.Option(metavar="|".join((*TASKS, "ratings", "reaction")))] = (
        "two-interval"
    )
    """Task of participants in a trial."""
    columns: Annotated[list[str] | None, typer.Option("--map", metavar="OURS=THEIRS")] = None
    """Columns of the table; may be given more than once. Pairs need participant, first, second, and
    chosen (a method) or chose_first (1/0); also scene, size. Other tasks need participant, and
    expected with answer, or correct (1/0); also scene, and any columns of your own. Ratings need
    participant, rating, and the column that --set by=COLUMN names, or first and second; also scene.
    All: order, rt_s. Columns that already have our names need no --map. A unit may follow:
    rt_s=rt:ms."""
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None
    """Settings of the analysis, as in a protocol's section on analysis; may be given more than
    once: by=method, level=eccentricity_deg, falling=true, baseline=reference, signal=seen (yes-no),
    alternatives=4 (identification), rule=independent (abx), scale=bad,fair,good (ratings),
    primary=ours/blur (pairs). All but ratings: order=ours,blur,none and label.ours='Our method'."""


@app.command("import")
def import_(
    table: Annotated[
        Path,
        typer.Argument(
            help="CSV, .xlsx or .ods of any tool, one decision per row; or a square table of"
            " counts; or a folder of such, for example one per participant."
        ),
    ],
    out: NewFolderOption,
    asked: ImportOptions,
    where: WhereOption = None,
    answer: AnswerOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Convert a table of another program into tidy form, by naming its columns.

    Example, a table of pwcmp:

        metamerlab analysis import votes.csv --map participant=observer --map first=condition_A
        --map second=condition_B --map chose_first=is_A_selected --out imported

        metamerlab analysis report imported/decisions.csv --out report

    Decimal commas, semicolons, Latin-1, .xlsx, .ods, left and right for the chosen one, and rows
    without an answer are understood and reported.

    Of a square table of counts the row's method was chosen over the column's, or the column's
    answer given where the row's was right. It does not say who decided.

    A table of 'analysis export --format pwcmp' needs --map scene=scene_name too: its column scene
    holds scene and size, as pwcmp wants it.

    Example, psychometric functions over eccentricity for each method:

        metamerlab analysis import old.csv --task identification --map participant=subject
        --map correct=hit --set by=method --set level=ecc --set falling=true --out imported
    """
    from analysis.data_dictionary import dictionary
    from analysis.plans.table_sections import RateTableSection
    from analysis.tables.table import BY_IMPORT
    from analysis.tables.table_files import write_table
    from analysis.tasks import analysis_of_task
    from analysis.tasks.note import options_from, write_note
    from protocols.disk.result_folder import check_result, whole_folder

    check_result(out, replace=replace, reads=[table])
    analysis = analysis_of_task(asked.task)
    section = options_from(analysis.kind, pairs("--set", asked.settings or ()))
    has_answers = issubclass(analysis.options, RateTableSection)
    square: Counted | None = "answers" if has_answers else None
    if analysis.kind == "preference":
        square = "choices"
    plain = table_told(table, (asked.columns, where, answer), BY_IMPORT, square)
    decisions = analysis.read(plain, section)
    plan = analysis.plan_of_table(decisions, table.stem, section)
    plain.notes += analysis.table_notes(decisions, plan)
    with whole_folder(out, replace=replace, reads=[table]) as work:
        tables = {
            "decisions.csv": decisions,
            "dictionary.csv": dictionary({"decisions": analysis.columns_of(decisions)}),
            **analysis.tidy_tables(decisions),
        }
        for name, frame in tables.items():
            write_table(frame, work / name)
        write_note(work / "decisions.csv", section)
    say_notes(plain.notes)
    people = count_of(decisions["participant"].nunique(), "participant")
    written = out / "decisions.csv"
    say(f"{written}: {count_of(len(decisions), 'decision')} of {people}")
    if lack := analysis.lacks(decisions, plan):
        say(f"no report yet: {lack}")
    else:
        told = () if getattr(plan, "primary", None) else getattr(plan, "pairings", ())
        pairings = ["/".join(one) for one in told]
        primary = f" --set primary={shlex.quote(pairings[0])}" if pairings else ""
        say(f"next: metamerlab analysis report {shlex.quote(str(written))}{primary} --out report")
        if len(pairings) > 1:
            say(f"primary is the comparison that was planned: {', '.join(pairings)}")


for _command in (export, psychometric, detection, reaction, ratings):
    app.command()(_command)


def _pilot(
    path: Path, study: StudyProtocol, progress: Progress
) -> tuple[pd.DataFrame, AnalysisPlan]:
    """Return decisions and plan of a pilot: of sessions, or of a table."""
    from analysis.report.report_source import from_sessions, from_table

    table = path.suffix.lower() in (".csv", ".tsv") and not path.is_dir()
    found = from_table(path) if table else from_sessions(path, study, progress)
    if found.analysis.kind != study.analysis.kind:
        raise StudyError(
            f"{path}: must hold decisions of the study's kind of task ({study.analysis.kind})"
            f" (found {found.analysis.kind})"
        )
    say_notes(found.warnings if table else ())
    return found.decisions, found.plan


def _write_power(found: Power, folder: Path) -> None:
    """Write the curves at both widths, and every number."""
    from analysis.plots import ONE_COLUMN_IN, TWO_COLUMNS_IN, save_figure
    from analysis.report.values import as_json

    for name, width in (("1-column", ONE_COLUMN_IN), ("2-column", TWO_COLUMNS_IN)):
        save_figure(found.draw(width), folder, f"power-{name}")
        if found.designs:
            save_figure(found.draw_designs(width), folder, f"scenes-{name}")
    text = json.dumps(as_json(found.numbers), indent=1, sort_keys=True, allow_nan=False)
    (folder / "power.json").write_text(text + "\n", encoding="utf-8", newline="\n")


def _print_power(found: Power) -> None:
    console = PlainConsole()
    console.print(found.lead)
    rows = list(found.rows())
    console.print(table_of(tuple(rows[0]), [tuple(row.values()) for row in rows], right=0))
    console.print(found.legend)
    for line in found.needs():
        console.print(line)
    for warning in found.warnings:
        console.print(f"note: {warning}")
