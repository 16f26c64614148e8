"""`metamerlab analysis psychometric`, `detection` and others: one CSV, one question, one answer."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from markupsafe import Markup
from rich.box import SIMPLE_HEAD
from rich.table import Table

from protocols.errors import StudyError
from study_app.cli.assumed import pairs
from study_app.cli.errors import user_errors
from study_app.cli.options import ReplaceOption, one_of
from study_app.cli.progress import one_line
from study_app.cli.terminal import PlainConsole, say

if TYPE_CHECKING:  # a command imports its own part of the analysis when it runs
    from analysis.from_csv.found import Found
    from analysis.ordinal import OrdinalLink
    from analysis.report.blocks import Table as Rows
    from analysis.report.content import Content
    from analysis.tables.table import Table as AnyTable

TrialsArgument = Annotated[
    Path,
    typer.Argument(
        help="CSV or .xlsx of any tool, one answer per row; a folder of such, for example one per"
        " participant; or a decisions.csv of ours. What was left out or changed is noted."
    ),
]
MapOption = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="OURS=THEIRS",
        help="Which column holds what; may be given more than once. Columns that already have our"
        " names need no --map. A unit may follow: rt_s=rt:ms, correct=miss:errors.",
    ),
]
WhereOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CONDITION",
        help="Rows to keep, such as 'contrast>0' or 'block!=practice' (=, !=, <, <=, >, >=); may be"
        " given more than once.",
    ),
]
AnswerOption = Annotated[
    str | None,
    typer.Option(
        metavar="THEIRS=OURS,...",
        help="What answers are called otherwise, such as y=present,n=absent.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(help="Folder for figures (SVG, PDF, PNG), tables and results.json."),
]
ByOption = Annotated[str | None, typer.Option(help="Column whose values are compared.")]
BaselineOption = Annotated[
    str | None, typer.Option(help="The value of --by that the others are compared with.")
]
LINKS: tuple[OrdinalLink, ...] = ("probit", "logit")
LevelOption = Annotated[
    float, typer.Option("--confidence", min=0.5, max=0.999, help="Coverage of limits.")
]


def psychometric(
    table: TrialsArgument,
    level: Annotated[str, typer.Option(help="Column of numbers along which answers change.")],
    by: ByOption = None,
    guess: Annotated[
        str, typer.Option(metavar="RATE|fit", help="Rate of guessing, such as 0.5; fit: unknown.")
    ] = "0.5",
    shape: Annotated[
        str, typer.Option(help="Of the curve: gauss, logistic, gumbel or weibull.")
    ] = "gauss",
    falling: Annotated[
        bool, typer.Option("--falling", help="Answers get worse as the level rises.")
    ] = False,
    log: Annotated[
        bool, typer.Option("--log", help="Fit on the logarithm of the level; weibull always does.")
    ] = False,
    columns: MapOption = None,
    where: WhereOption = None,
    answer: AnswerOption = None,
    confidence: LevelOption = 0.95,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Fit psychometric functions: thresholds of each person and of all people, compared.

    Needs the columns participant, correct (1/0; or expected and answer) and the level. Each
    person's curve has priors on lapses, guesses and on answers that vary more than chance; limits
    of all people come from one model in which thresholds vary between people.

    Examples, the second a folder of PsychoPy's files:

        metamerlab analysis psychometric acuity.csv --level ecc_deg --by method --falling
        --guess 0.25 --out acuity

        metamerlab analysis psychometric data/ --level contrast --log --by method
        --map correct=key_resp.corr
    """
    from protocols.adaptive.psychometric import SHAPES

    with user_errors():
        options = {
            "level": level,
            "by": by,
            "guess": _guess(guess),
            "shape": one_of("--shape", shape, SHAPES),
            "falling": falling,
            "log": log,
            "alpha": round(1.0 - confidence, 12),
        }
        ask("psychometric", table, (columns, where, answer), options, out, replace=replace)


def detection(
    table: TrialsArgument,
    signal: Annotated[
        str, typer.Option(help="The answer that is right where the signal is.")
    ] = "yes",
    by: ByOption = None,
    baseline: BaselineOption = None,
    columns: MapOption = None,
    where: WhereOption = None,
    answer: AnswerOption = None,
    confidence: LevelOption = 0.95,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Measure detection in a yes-no task: d', criterion and bias by condition.

    Needs the columns participant, expected and answer; limits account for participants, and for
    scenes if there is a column scene.

    Example: metamerlab analysis detection seen.csv --signal seen --by method --map answer=said
    --out seen
    """
    options = {
        "signal": signal,
        "by": by,
        "baseline": baseline,
        "alpha": round(1.0 - confidence, 12),
    }
    with user_errors():
        only = ("sensitivity", "typical")
        ask("detection", table, (columns, where, answer), options, out, replace=replace, only=only)


def confidence_(
    table: TrialsArgument,
    by: ByOption = None,
    signal: Annotated[
        str | None, typer.Option(help="Of a yes-no task: the answer that is right where it is.")
    ] = None,
    alternatives: Annotated[
        int | None, typer.Option(min=2, help="How many answers there were, if no column says.")
    ] = None,
    columns: MapOption = None,
    where: WhereOption = None,
    answer: AnswerOption = None,
    confidence: LevelOption = 0.95,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Ask what confidence tells of answers: type-2 ROC area, meta-d', M-ratio, calibration.

    Needs the columns participant, confidence (steps, the least sure first) and correct (1/0), and
    expected and answer of two answers for meta-d'. With --signal, of a yes-no task, answers graded
    by confidence give the ROC, and d' with unequal variances.

    Example: metamerlab analysis confidence seen.csv --signal seen --map confidence=sure --out sure
    """
    own: dict[str, object] = {"signal": signal} if signal else {"alternatives": alternatives}
    options = {"by": by, "alpha": round(1.0 - confidence, 12), **own}
    with user_errors():
        if signal and alternatives:
            raise StudyError(
                "--alternatives: must be left out with --signal, whose answers are two"
                f" (got {alternatives})"
            )
        kind = "detection" if signal else "identification"
        only = ("confidence", "metacognition", "graded")
        told = columns, where, answer
        ask(kind, table, told, options, out, replace=replace, only=only, needed=("confidence",))


def reaction(
    table: TrialsArgument,
    by: ByOption = None,
    baseline: BaselineOption = None,
    columns: MapOption = None,
    where: WhereOption = None,
    answer: AnswerOption = None,
    confidence: LevelOption = 0.95,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Compare reaction times between conditions: a log-normal mixed model, and EZ diffusion.

    Needs the columns participant and rt_s (seconds), of any task, and scene if there are several.
    With correct (1/0; or expected and answer) of a task with two answers, EZ diffusion splits
    times and errors into how fast evidence arrives, caution, and the time for seeing and pressing.

    Example: metamerlab analysis reaction acuity.csv --by method --map rt_s=seconds --out times
    """
    options = {"by": by, "baseline": baseline, "alpha": round(1.0 - confidence, 12)}
    with user_errors():
        ask("reaction", table, (columns, where, answer), options, out, replace=replace)


def ratings(
    table: TrialsArgument,
    by: ByOption = None,
    scale: Annotated[
        str | None,
        typer.Option(metavar="LOWEST,...,HIGHEST", help="Ratings, if they are not numbers."),
    ] = None,
    baseline: BaselineOption = None,
    link: Annotated[
        str, typer.Option(metavar="|".join(LINKS), help="Of the cumulative-link model.")
    ] = "probit",
    columns: MapOption = None,
    where: WhereOption = None,
    answer: AnswerOption = None,
    confidence: LevelOption = 0.95,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Compare ordered ratings, or graded comparisons of pairs with ties.

    Needs the columns participant, rating and --by, and scene if there are several. Without --by
    it needs first and second: then the rating says how much better the first is, 0 for a tie.
    The model is cumulative-link with participants, their taste for each condition, and scenes as
    random.

    Examples:

        metamerlab analysis ratings votes.csv --by method --scale bad,poor,fair,good,excellent

        metamerlab analysis ratings pairs.csv --map first=left --map second=right --out graded
    """
    with user_errors():
        options = {
            "by": by,
            "scale": scale,
            "baseline": baseline,
            "link": one_of("--link", link, LINKS),
            "alpha": round(1.0 - confidence, 12),
        }
        only = ("ratings", "random_ratings")
        ask("ratings", table, (columns, where, answer), options, out, replace=replace, only=only)


def bayes(
    table: TrialsArgument,
    method: Annotated[str | None, typer.Option(help="Default: all methods.")] = None,
    against: Annotated[str | None, typer.Option(help="Default: all others.")] = None,
    margin: Annotated[
        float,
        typer.Option(
            min=0.001,
            max=0.499,
            help="Shares up to this far from one half count as practically equal.",
        ),
    ] = 0.1,
    columns: MapOption = None,
    where: WhereOption = None,
    answer: AnswerOption = None,
    confidence: LevelOption = 0.95,
    out: OutOption = None,
    replace: ReplaceOption = False,
) -> None:
    """Compute posteriors of preferences: credible limits, equality, influence of the prior.

    Needs participant, first, second, and chosen or chose_first, and scene if there are several. A
    hierarchical logit model is sampled under three priors. Needs the extra `bayes`.

    Example: metamerlab analysis bayes decisions.csv --method ours --margin 0.1 --out posterior
    """
    from analysis.from_csv.bayes import bayes_of_csv
    from protocols.result_folder import check_result

    with user_errors():
        if out is not None:
            check_result(out, replace=replace, reads=[table])
        with one_line() as progress:
            rows = table_told(table, (columns, where, answer))
            found = bayes_of_csv(
                rows, method=method, against=against, margin=margin, level=confidence,
                progress=progress,
            )  # fmt: skip
        hand_over(found, out, replace=replace, reads=[table])


def register(app: typer.Typer) -> None:
    """Add the commands to the group `analysis`."""
    app.command()(psychometric)
    app.command()(detection)
    app.command("confidence")(confidence_)
    app.command()(reaction)
    app.command()(ratings)
    app.command()(bayes)


def _guess(text: str) -> float | None:
    if text == "fit":
        return None
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 1.0:
        raise StudyError(f"--guess must be a rate from 0 to below 1, or 'fit' (got {text!r})")
    return value


Told = tuple[list[str] | None, list[str] | None, str | None]
"""What the options --map, --where and --answer say."""


def table_told(path: Path, told: Told, command: str = "") -> AnyTable:
    """Read a table with the columns, rows and answers that options name.

    `command` stands before the options in messages.
    """
    from analysis.tables.table import Table as Rows

    columns, where, answer = told
    return Rows(
        path,
        pairs("--map", columns or ()),
        where or (),
        pairs("--answer", [] if answer is None else answer.split(",")),
        command=command,
    )


def ask(
    kind: str,
    path: Path,
    told: Told,
    options: Mapping[str, object],
    out: Path | None,
    *,
    replace: bool,
    only: Collection[str] = (),
    needed: Collection[str] = (),
) -> None:
    """Print what an analysis says of a table, and write its report where a folder is named.

    `only` are the parts that answer the question; none: all of the analysis. `needed` are columns
    that it cannot do without, beside those of the analysis.
    """
    from analysis.report.build import write_report
    from analysis.report.content import content_of
    from analysis.report.source import from_question
    from analysis.tasks import analysis_of
    from protocols.result_folder import check_result

    analysis = analysis_of(kind)
    if out is not None:
        check_result(out, replace=replace, reads=[path])
    with one_line() as progress:
        rows = table_told(path, told)
        rows.need([name for name in needed if name not in rows.rows])
        try:
            source = from_question(analysis, rows, analysis.options(**options), only)
        except StudyError as problem:  # its keys are options here
            raise StudyError(re.sub(r"--set (\w+)[= ]", r"--\1 ", str(problem))) from None
        if out is None:
            content = content_of(source, lambda name: progress(name, 0, 0))
        else:
            content = write_report(source, path, out, replace=replace, progress=progress).content
    print_content(content, simulated=source.simulated)
    if out is not None:
        say(f"page, tables, figures, numbers: {out}")


def print_content(content: Content, *, simulated: bool) -> None:
    """Print what a page says, without its figures."""
    from analysis.report.blocks import Cautions, Heading, Paragraph
    from analysis.report.blocks import Table as Rows

    console = PlainConsole()
    console.print(content.counted + " (SIMULATED)" * simulated)
    notes = list(content.warnings)
    for block in (*content.lead, *(b for section in content.sections for b in section.blocks)):
        match block:
            case Rows():
                console.print(_plain(block.caption))
                console.print(_printed(block))
            case Heading(text=text) | Paragraph(text=text):
                console.print(_plain(text))
            case Cautions(notes=found):
                notes += found
    for sentence in content.sentences:
        console.print(sentence)
    for note in dict.fromkeys(notes):
        say(f"note: {note}")


def _printed(rows: Rows) -> Table:
    """Return a table for a terminal; a narrow one breaks lines within cells, and drops no digit."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in rows.columns:
        left = column.head_style == "l"
        table.add_column(_plain(column.title), justify="left" if left else "right", overflow="fold")
    for row in rows.rows:
        table.add_row(*map(_plain, row))
    return table


def _plain(text: str) -> str:
    return str(text.striptags()) if isinstance(text, Markup) else text


def hand_over(found: Found, out: Path | None, *, replace: bool, reads: Iterable[Path] = ()) -> None:
    """Print what was found, and write it where a folder is named."""
    from analysis.from_csv.found import write_found
    from protocols.result_folder import whole_folder

    if out is not None:
        with whole_folder(out, replace=replace, reads=reads) as work:
            write_found(found, work)
    console = PlainConsole()
    console.print(found.title)
    # Narrow terminals break lines within cells: no digit is ever left out.
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for place, name in enumerate(found.shown.columns):
        table.add_column(str(name), justify="left" if place == 0 else "right", overflow="fold")
    for row in found.shown.itertuples(index=False):
        table.add_row(*map(str, row))
    console.print(table)
    for sentence in found.sentences:
        console.print(sentence)
    for note in found.notes:
        say(f"note: {note}")
    if out is not None:
        say(f"figures, tables, numbers: {out}")
