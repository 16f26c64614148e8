"""`metamerlab analysis psychometric`, `detection` and others: one CSV, one question, one answer."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer
from markupsafe import Markup
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analysis.plans.table_sections import (
    CurveTableSection,
    DetectionTableSection,
    RatingTableSection,
    TimeTableSection,
)
from protocols.errors import StudyError
from protocols.tasks.base import Analysis
from protocols.units import key_docs
from study_app.cli.options import FiguresOption, ReplaceOption, pairs
from study_app.cli.progress import one_line
from study_app.cli.terminal import PlainConsole, say, say_notes

if TYPE_CHECKING:  # a command imports its own part of the analysis when it runs
    from analysis.report.content import ReportContent
    from analysis.report.write_report import FigureFiles
    from analysis.tables.counts import Counted
    from analysis.tables.table import Table as AnyTable
    from protocols.blocks import Block
    from protocols.blocks import TableBlock as Rows

TrialsArgument = Annotated[
    Path,
    typer.Argument(
        help="CSV, .xlsx or .ods of any tool, one answer per row; a folder of such, for example one"
        " per participant; or a decisions.csv of ours. What was left out or changed is noted."
    ),
]
MapOption = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="OURS=THEIRS",
        help="Names of a column, ours and the table's; may be given more than once. Columns that"
        " already have our names need no --map. A unit may follow: rt_s=rt:ms,"
        " correct=miss:errors.",
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
        metavar="THEIRS=OURS,...", help="Other names of answers, such as y=present,n=absent."
    ),
]
OutOption = Annotated[
    Path | None, typer.Option(help="Folder for the page, figures, tables and results.json.")
]
CoverageOption = Annotated[
    float, typer.Option(min=0.5, max=0.999, help="Share of limits that hold the truth.")
]


def _question(
    told: type[Analysis],
    keys: Sequence[str],
    only: Sequence[str] = (),
    needed: Sequence[str] = (),
) -> Callable[[Callable[[], None]], Callable[..., None]]:
    """Make a command of a kind of analysis, whose options are keys of what a table is told.

    `only` are the parts that answer the question; none: all of them.
    """

    def command(
        table: TrialsArgument,
        columns: MapOption = None,
        where: WhereOption = None,
        answer: AnswerOption = None,
        coverage: CoverageOption = 0.95,
        out: OutOption = None,
        figures: FiguresOption = "svg",
        replace: ReplaceOption = False,
        **given: str | bool | list[str] | None,
    ) -> None:
        several = {key: one for key, one in given.items() if isinstance(one, list)}
        said = {
            key: one
            for key, one in given.items()
            if one is not None and one is not False and key not in several
        }
        texts = {key: "true" if one is True else str(one) for key, one in said.items()}
        texts["alpha"] = f"{1.0 - coverage:.12g}"
        kind, how = str(told.model_fields["kind"].default), (columns, where, answer)
        for key, named in several.items():
            texts |= {f"{key}.{name}": one for name, one in pairs(f"--{key}", named).items()}
        ask(kind, table, how, texts, out, figures=figures, replace=replace, only=only)

    def made(described: Callable[[], None]) -> Callable[..., None]:
        hints = get_type_hints(command, include_extras=True)
        table, *common, _ = (
            one.replace(kind=one.KEYWORD_ONLY, annotation=hints[one.name])
            for one in inspect.signature(command).parameters.values()
        )
        own = [_option(told, key, needed=key in needed) for key in keys]
        every = [table, *own, *common]
        command.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
        command.__annotations__ = {one.name: one.annotation for one in every}
        command.__name__, command.__doc__ = described.__name__, described.__doc__
        return command

    return made


def _option(told: type[Analysis], key: str, *, needed: bool) -> inspect.Parameter:
    """Return the option of a key: its help is what the format says of it."""
    field = told.model_fields[key]
    said = next(filter(None, (key_docs(owner).get(key) for owner in told.__mro__)), "")
    how: dict[str, Any] = {"help": " ".join(said.replace("`", "").split())}
    if get_origin(field.annotation) is Literal:
        how["metavar"] = "|".join(get_args(field.annotation))
    hint: Any = str | None
    default: Any = str(field.default) if field.default else None
    if needed:
        hint, default = str, inspect.Parameter.empty
    if get_origin(field.annotation) is dict:
        how["metavar"] = "NAME='CONDITION=WEIGHT,...'"
        hint, default = list[str] | None, None
    if field.annotation is bool:
        hint, default = bool, False
    hint = Annotated[hint, typer.Option(**how)]
    return inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)


@_question(
    CurveTableSection,
    ("level", "by", "guess", "shape", "falling", "log"),
    needed=("level",),
)
def psychometric() -> None:
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


@_question(DetectionTableSection, ("signal", "by", "baseline"), ("sensitivity", "typical"))
def detection() -> None:
    """Measure detection in a yes-no task: d', criterion and bias by condition.

    Needs the columns participant, expected and answer; limits account for participants, and for
    scenes if there is a column scene.

    Example: metamerlab analysis detection seen.csv --signal seen --by method --map answer=said
    --out seen
    """


@_question(TimeTableSection, ("by", "baseline", "contrasts", "bootstrap_draws"))
def reaction() -> None:
    """Compare reaction times between conditions by a log-normal mixed model.

    Needs the columns participant and rt_s (seconds), of any task, and scene if there are several.

    Example: metamerlab analysis reaction acuity.csv --by method --map rt_s=seconds --out times
    """


@_question(
    RatingTableSection,
    ("by", "scale", "baseline", "link", "contrasts", "bootstrap_draws"),
    ("ratings", "random_ratings"),
)
def ratings() -> None:
    """Compare ordered ratings, or graded comparisons of pairs with ties.

    Needs the columns participant, rating and --by, and scene if there are several. Without --by
    it needs first and second: then the rating says how much better the first is, 0 for a tie.
    The model is cumulative-link with participants, their taste for each condition, and scenes as
    random.

    Examples:

        metamerlab analysis ratings votes.csv --by method --scale bad,poor,fair,good,excellent

        metamerlab analysis ratings pairs.csv --map first=left --map second=right --out graded
    """


Told = tuple[list[str] | None, list[str] | None, str | None]
"""Options --map, --where and --answer."""


def table_told(
    path: Path, told: Told, command: str = "", counted: Counted | None = None
) -> AnyTable:
    """Read a table with the columns, rows and answers that options name.

    `command` stands before the options in messages; `counted` is what a square table counts.
    """
    from analysis.tables.table import Table as Rows

    columns, where, answer = told
    return Rows(
        path,
        pairs("--map", columns or ()),
        where or (),
        pairs("--answer", [] if answer is None else answer.split(",")),
        command=command,
        counted=counted,
    )


def ask(
    kind: str,
    path: Path,
    told: Told,
    texts: Mapping[str, str],
    out: Path | None,
    *,
    figures: FigureFiles,
    replace: bool,
    only: Collection[str] = (),
) -> None:
    """Print what an analysis says of a table, and write its report where a folder is named.

    `only` are the parts that answer the question; none: all of the analysis.
    """
    from analysis.report.content import content_of
    from analysis.report.report_source import from_question
    from analysis.report.write_report import write_report
    from analysis.tasks import analysis_of
    from analysis.tasks.note import options_from
    from protocols.disk.result_folder import check_result

    analysis = analysis_of(kind)
    if out is not None:
        check_result(out, replace=replace, reads=[path])
    with one_line() as progress:
        rows = table_told(path, told)
        try:
            source = from_question(analysis, rows, options_from(kind, texts), only)
        except StudyError as problem:  # its keys are options here
            said = re.sub(
                r"--set (\w+)(=?)",
                lambda key: f"--{key[1].replace('_', '-')}{' ' * bool(key[2])}",
                str(problem),
            )
            raise StudyError(said) from None
        if out is None:
            content = content_of(source, lambda name: progress(name, 0, 0))
        else:
            content = write_report(
                source, path, out, replace=replace, figure_files=figures, progress=progress
            ).content
    print_content(content, simulated=source.simulated)
    if out is not None:
        say(f"page, tables, figures, numbers: {out}")


def print_content(content: ReportContent, *, simulated: bool) -> None:
    """Print what a page says, without its figures: the answer first, other analyses last."""
    from protocols.blocks import Box, Cautions, CopyText, Folded, Heading, Paragraph
    from protocols.blocks import TableBlock as Rows

    console = PlainConsole()
    notes = list(content.warnings)

    def show(blocks: Iterable[Block]) -> None:
        for block in blocks:
            match block:
                case Box(title=title, lead=lead, text=text):
                    console.print(f"{title}: {lead}", *[_plain(text)] * bool(text), sep="\n")
                case Rows():
                    console.print(*filter(None, [_plain(block.caption)]), _printed(block), sep="\n")
                case Folded(title=title, why=why, blocks=inner):
                    show((f"{title}: {why}", *inner))
                case CopyText(texts=texts):
                    show(texts)
                case str(text) | Heading(text=text) | Paragraph(text=text):
                    console.print(_plain(text))
                case Cautions(notes=found):
                    notes.extend(found)

    console.print(content.counted + " (SIMULATED)" * simulated)
    show(content.lead)
    for section in content.sections:
        show(section.blocks)
    show(content.sentences)
    for section in content.others:
        show((Heading(section.title), *section.blocks))
    say_notes(dict.fromkeys(notes))


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
