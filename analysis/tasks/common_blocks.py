"""Blocks that every task with trials in a row has: change over the sitting, reaction times."""

from collections.abc import Callable, Sequence

from analysis.learning import Trend
from analysis.reaction import ReactionTimes
from analysis.report.wording import grouped, number, p_number
from analysis.tasks.blocks import Block, Cautions, Picture, Table


def learning_blocks(trends: Sequence[tuple[str, Trend]]) -> tuple[Block, ...]:
    """Return the figure and the table of changes over the sitting."""
    return (
        Picture("learning"),
        Table.of(
            "Change from the first to the last trial, between participants; beside it the papers'"
            " pooled rank correlation",
            (
                ("Outcome", "l"),
                ("Change", ""),
                ("Limits", "n"),
                ("df", ""),
                ("p", "n"),
                ("Sign-flip p", "n"),
                ("Spearman \N{GREEK SMALL LETTER RHO}", ""),
                ("pooled p", "n"),
            ),
            [
                (
                    name,
                    number(t.change),
                    f"[{number(t.lower)}, {number(t.upper)}]",
                    f"{t.df:g}",
                    p_number(t.p),
                    p_number(t.sign_flip_p),
                    number(t.spearman_rho),
                    p_number(t.spearman_p),
                )
                for name, t in trends
            ],
        ),
        Cautions("About these trends", tuple(grouped([(name, t.warnings) for name, t in trends]))),
    )


def reaction_blocks(
    times: Sequence[ReactionTimes], title: str, label: Callable[[str], str]
) -> tuple[Block, ...]:
    """Return the figure and the table of reaction times; `title` heads the conditions."""
    if not times:
        return ()
    return (
        Picture("reaction"),
        Table.of(
            "Reaction times, s",
            (
                (title, "l"),
                ("Answers", ""),
                ("Median", ""),
                ("Quartiles", "n"),
                ("Trimmed mean", ""),
                ("Mean of medians", ""),
                ("Limits", "n"),
            ),
            [
                (
                    label(t.condition),
                    str(t.answers),
                    number(t.median),
                    f"{number(t.quartile_low)} to {number(t.quartile_high)}",
                    number(t.trimmed_mean),
                    number(t.mean_of_medians),
                    f"[{number(t.lower)}, {number(t.upper)}]",
                )
                for t in times
            ],
        ),
        Cautions(
            "About these times", tuple(grouped([(label(t.condition), t.warnings) for t in times]))
        ),
    )
