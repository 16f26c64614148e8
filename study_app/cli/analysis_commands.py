"""`metamerlab analysis`: from journals to tables, statistics, plots and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from analysis.columns import PREFERENCE_COLUMNS, dictionary
from analysis.plain_csv import OPTIONAL, REQUIRED, read_decisions
from analysis.plots import ONE_COLUMN_IN, TWO_COLUMNS_IN, power_plot, save_figure
from analysis.power import (
    DEFAULT_PARTICIPANT_SD,
    DEFAULT_SCENE_SD,
    Assumptions,
    PowerCurve,
    power_curve,
)
from analysis.report import ReportPaths, report_decisions, report_sessions
from analysis.report.folder import whole_folder
from analysis.report.values import as_json
from analysis.settings import from_protocol
from analysis.study import SEED
from analysis.tidy import pwcmp_table, read_sessions, write_tables
from protocols.errors import StudyError
from protocols.load import load_protocol
from protocols.tasks.pairs import PairTask
from study_app.cli.errors import user_errors
from study_app.cli.export_commands import register
from study_app.cli.options import (
    SESSIONS_PROTOCOL_HELP,
    NewFolderOption,
    ProtocolArgument,
    ReplaceOption,
    SessionsArgument,
    SessionsProtocolOption,
)
from study_app.cli.progress import one_line

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="""Statistics, plots and the report, from the journals of a study.

    Examples:

        metamerlab analysis power demo --rate 0.65

        metamerlab analysis report sessions --protocol demo --out report

        metamerlab analysis tidy sessions --protocol demo --out tables

        metamerlab analysis import old.csv --map participant=subject --out imported

        metamerlab analysis export sessions --protocol demo --format bids --out bids
    """,
)


@app.command()
def report(
    sessions: Annotated[
        Path,
        typer.Argument(
            help="Folder of sessions, searched to any depth; or a decisions.csv made by"
            " `analysis import` or `analysis tidy`."
        ),
    ],
    out: NewFolderOption,
    protocol: Annotated[
        Path | None, typer.Option(help=SESSIONS_PROTOCOL_HELP + " Optional for a table only.")
    ] = None,
    figures: Annotated[
        bool, typer.Option(help="Also write every figure as SVG, PDF and PNG at both widths.")
    ] = True,
    replace: ReplaceOption = False,
) -> None:
    """Analyse a study and write a report: one HTML page, a JSON of every number, tables, figures.

    The page opens offline and prints well. Sessions of two protocols are refused, exclusion
    rules come from the protocol, and simulated data is stamped on every page and figure. Run
    again, the numbers are the same to the last digit.

    Example: metamerlab analysis report sessions --protocol demo --out report
    """
    with user_errors():
        study = load_protocol(protocol) if protocol else None
        with one_line() as progress:
            if sessions.suffix.lower() in (".csv", ".tsv") and not sessions.is_dir():
                made = report_decisions(
                    sessions,
                    out,
                    protocol=study,
                    replace=replace,
                    figure_files=figures,
                    progress=progress,
                )
            elif study is None:
                raise StudyError(
                    "--protocol must name the protocol of the sessions"
                    " (only a table of decisions goes without one)"
                )
            else:
                made = report_sessions(
                    sessions,
                    study,
                    out,
                    replace=replace,
                    figure_files=figures,
                    progress=progress,
                )
    _print_report(made)


@app.command()
def tidy(
    sessions: SessionsArgument,
    protocol: SessionsProtocolOption,
    out: NewFolderOption,
    replace: ReplaceOption = False,
) -> None:
    """Write journals as tidy CSV tables: one row per attempt, per decision, per sitting.

    Beside them dictionary.csv says what every column means, and flow.csv what the protocol's rules
    left out.

    Example: metamerlab analysis tidy sessions --protocol demo --out tables
    """
    with user_errors():
        study = load_protocol(protocol)
        with one_line() as progress, whole_folder(out, "decisions.csv", replace=replace) as work:
            tables = read_sessions(sessions, study, progress=progress)
            write_tables(tables, study, work)
            if isinstance(study.task, PairTask):
                table = pwcmp_table(tables.analysed)
                table.to_csv(work / "pwcmp.csv", index=False, lineterminator="\n")
    for warning in tables.warnings:
        print(f"note: {warning}")
    kept, every = len(tables.analysed), int((tables.decisions["kind"] == "main").sum())
    mark = " SIMULATED" if tables.simulated else ""
    print(f"{out}: {len(tables.sessions)}{mark} sittings, {kept} of {every} main decisions kept")


@app.command()
def power(
    protocol: ProtocolArgument,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=0.99,
            help="True share in every comparison, averaged over people and scenes; left out: one"
            " half plus the protocol's smallest effect.",
        ),
    ] = None,
    participant_sd: Annotated[
        float, typer.Option(min=0, max=5, help="Logit deviation between participants.")
    ] = DEFAULT_PARTICIPANT_SD,
    scene_sd: Annotated[
        float, typer.Option(min=0, max=5, help="Logit deviation between scenes.")
    ] = DEFAULT_SCENE_SD,
    studies: Annotated[int, typer.Option(min=100, help="Studies to simulate.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same numbers.")] = SEED,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the curve (SVG, PDF, PNG) and a JSON.")
    ] = None,
    replace: ReplaceOption = False,
) -> None:
    """Say how many participants a protocol needs, by simulating its own design and test.

    Trials of one person, and of one scene, are alike; the deviations say how much. The
    defaults, 0.6 and 0.4 logits, are those of published listening and image studies of this
    shape. Power is the chance that such a study finds what is there.

    Example: metamerlab analysis power demo --rate 0.65 --out power
    """
    with user_errors():
        settings = from_protocol(load_protocol(protocol))
        assumptions = Assumptions(
            rate if rate is not None else 0.5 + settings.margin, participant_sd, scene_sd
        )
        with one_line() as progress:
            curve = power_curve(
                settings,
                assumptions,
                rng=np.random.default_rng(seed),
                studies=studies,
                progress=lambda done, total: progress("simulating studies", done, total),
            )
        if out is not None:
            with whole_folder(out, "power.json", replace=replace) as work:
                for name, width in (("1-column", ONE_COLUMN_IN), ("2-column", TWO_COLUMNS_IN)):
                    save_figure(power_plot([curve], width_in=width), work, f"power-{name}")
                text = json.dumps(as_json(curve), indent=1, sort_keys=True, allow_nan=False)
                (work / "power.json").write_text(text + "\n", encoding="utf-8")
    _print_power(curve)
    if out is not None:
        print(f"curve: {out / 'power-2-column.png'}")


@app.command("import")
def import_(
    table: Annotated[Path, typer.Argument(help="CSV of any tool, one decision per row.")],
    out: NewFolderOption,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            help="OURS=THEIRS, may be given more than once. Needed: "
            + ", ".join(REQUIRED)
            + ", and chosen (a method) or chose_first (1/0). Also: "
            + ", ".join(name for name in OPTIONAL if not name.startswith("chose"))
            + ". Columns that have our names already need no --map.",
        ),
    ] = None,
    replace: ReplaceOption = False,
) -> None:
    """Bring decisions of another tool into our tidy form, by naming its columns.

    Example, a table of pwcmp:

        metamerlab analysis import votes.csv --map participant=observer --map first=condition_A
        --map second=condition_B --map chose_first=is_A_selected --out imported

        metamerlab analysis report imported/decisions.csv --out report

    A table of 'analysis export --format pwcmp' needs --map scene=scene_name too: its column scene
    holds scene and size, as pwcmp wants it.
    """
    with user_errors():
        mapping = {}
        for entry in columns or ():
            ours, sign, theirs = entry.partition("=")
            if not sign or not ours or not theirs:
                raise StudyError(f"--map must read OURS=THEIRS (got {entry!r})")
            mapping[ours.strip()] = theirs.strip()
        decisions = read_decisions(table, mapping)
        with whole_folder(out, "decisions.csv", replace=replace) as work:
            for name, frame in (
                ("decisions.csv", decisions),
                ("pwcmp.csv", pwcmp_table(decisions)),
                ("dictionary.csv", dictionary({"decisions": PREFERENCE_COLUMNS})),
            ):
                frame.to_csv(work / name, index=False, lineterminator="\n")
    people = decisions["participant"].nunique()
    print(f"{out / 'decisions.csv'}: {len(decisions)} decisions of {people} participants")
    print(f"next: metamerlab analysis report {out / 'decisions.csv'} --out report")


register(app)


def _print_report(made: ReportPaths) -> None:
    for warning in made.warnings:
        print(f"note: {warning}")
    print(made.headline)
    print(f"report: {made.html}")


def _print_power(curve: PowerCurve) -> None:
    console = Console(highlight=False)
    assumed = curve.assumptions
    console.print(
        f"{curve.studies} simulated studies; true share {assumed.rate:g}; deviations"
        f" {assumed.participant_sd:g} (participants) and {assumed.scene_sd:g} (scenes) logits;"
        f" alpha {curve.alpha:g}, {curve.family} comparisons"
    )
    table = Table()
    for column in (
        "participants",
        "primary",
        "each of family",
        "every",
        "equivalent at .5",
        "false positives",
    ):
        table.add_column(column, justify="right")
    shown = range(0, len(curve.participants), max(1, len(curve.participants) // 12))
    rows = sorted({*shown, *(i for i, n in enumerate(curve.participants) if n == curve.planned)})
    for index in rows:
        people = curve.participants[index]
        table.add_row(
            f"{people} (planned)" if people == curve.planned else str(people),
            *(
                f"{values[index]:.2f}"
                for values in (curve.primary, curve.each, curve.every, curve.equivalence)
            ),
            f"{curve.false_positives[index]:.3f}",
        )
    console.print(table)
    console.print(
        "primary: the primary comparison is significant, tested alone; each of family: one of the"
        " comparisons, on average, after correction; every: all of them;"
        f" equivalent at .5: were the share one half, it is shown to lie within ±{curve.margin:.2f}"
        " of it; false positives: were it one half, the primary comparison is significant all the"
        " same"
    )
    for name, goal, people in curve.needed:
        wanted = f"more than {curve.participants[-1]}" if people is None else str(people)
        console.print(f"{name}, power {goal:.0%}: {wanted} participants")
    for warning in curve.warnings:
        console.print(f"note: {warning}")
