"""Effect of exclusions: the main numbers with and without them, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

from analysis.parts import Estimate, estimates_of, with_added
from analysis.report.report_source import ReportSource
from analysis.report.wording import number_range, p_number, placed
from protocols.blocks import Block, Paragraph, TableBlock
from protocols.errors import StudyError


@dataclass(frozen=True)
class ExclusionComparison:
    """The main numbers of the decisions that were kept, and of all that were made.

    Attributes
    ----------
    kept, every : tuple of Estimate
        With exclusions, as the rest of the report; without them.
    left_out : int
        Main decisions that rules left out.
    turned : tuple of str
        Numbers that are significant on one side only.
    why_not : str
        Why there are none; empty: there are.
    """

    kept: tuple[Estimate, ...]
    every: tuple[Estimate, ...]
    left_out: int
    alpha: float
    turned: tuple[str, ...]
    why_not: str = ""


def beside(source: ReportSource) -> ExclusionComparison | None:
    """Return the numbers with and without exclusions; None where no rule left anything out."""
    alpha = source.plan.alpha
    if source.tidy is None:
        return None
    main = source.tidy.decisions[source.tidy.decisions["kind"] == "main"]
    left_out = len(main) - len(source.decisions)
    if left_out == 0:
        return None
    own, plan = source.analysis, source.plan
    try:
        kept, every = (
            estimates_of(with_added(own.parts), own.table(rows, plan), plan)
            for rows in (source.decisions, main.assign(included=1).reset_index(drop=True))
        )
    except (ValueError, StudyError) as problem:
        why_not = str(problem).removeprefix(f"{plan.study}: ")
        return ExclusionComparison((), (), left_out, alpha, (), why_not)
    if not every:
        return None
    before = {one.what: one for one in kept}
    turned = tuple(
        one.what
        for one in every
        if one.what in before and (one.p <= alpha) != (before[one.what].p <= alpha)
    )
    return ExclusionComparison(kept, every, left_out, alpha, turned)


def beside_blocks(found: ExclusionComparison | None) -> Sequence[Block]:
    """Return the table of both, and what turned; nothing where nothing was left out."""
    if found is None:
        return ()
    many = f"{found.left_out} decision{'s' * (found.left_out != 1)}"
    if found.why_not:
        return (
            Paragraph(f"Rules left out {many}; nothing can be said without them: {found.why_not}"),
        )
    kept = {one.what: one for one in found.kept}
    rows = [
        (
            one.what,
            *_cells(kept.get(one.what)),
            *_cells(one),
        )
        for one in found.every
    ]
    turned = (
        f"Exclusions decide about: {'; '.join(found.turned)}. Report both."
        if found.turned
        else f"No result is significant on one side only (alpha {found.alpha:g})."
    )
    return (
        TableBlock.of(
            f"With exclusions, and without: rules left out {many}",
            (
                ("", "l c"),
                ("With", "strong"),
                ("Limits", "n"),
                ("p adj.", "n"),
                ("n", ""),
                ("Without", "strong"),
                ("Limits", "n"),
                ("p adj.", "n"),
                ("n", ""),
            ),
            rows,
        ),
        Paragraph(turned),
    )


def _cells(one: Estimate | None) -> tuple[str, str, str, str]:
    if one is None:
        return "none", "none", "none", "0"
    return (
        placed(one, one.value),
        number_range(one.lower, one.upper),
        p_number(one.p),
        str(one.decisions),
    )
