"""Blocks that every task with trials in a row has: change over the session."""

from collections.abc import Sequence

from analysis.learning import Trend
from analysis.report.blocks import Block, Cautions, Picture, Table
from analysis.report.wording import grouped, number, number_range, p_number


def learning_blocks(trends: Sequence[tuple[str, Trend]]) -> tuple[Block, ...]:
    """Return the figure and the table of changes over the session."""
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
                    number_range(t.lower, t.upper),
                    number(t.df, 0),
                    p_number(t.p),
                    p_number(t.sign_flip_p),
                    number(t.spearman_rho),
                    p_number(t.spearman_p),
                )
                for name, t in trends
            ],
        ),
        Cautions("About these trends", grouped([(name, t.warnings) for name, t in trends])),
    )
