"""Blocks that every task with trials in a row has: change over the session, reaction times."""

from collections.abc import Callable, Sequence

from analysis.diffusion import MEASURES, DiffusionResults
from analysis.learning import Trend
from analysis.reaction import ReactionTimes
from analysis.reaction_model import TimeModel
from analysis.report.wording import grouped, number, number_range, p_number
from analysis.tasks.blocks import Block, Cautions, Paragraph, Picture, Table


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


def reaction_blocks(
    times: Sequence[ReactionTimes], title: str, label: Callable[[str], str]
) -> tuple[Block, ...]:
    """Return the figure and the table of reaction times; `title` heads the conditions."""
    if not times:
        return ()
    return (
        Picture("reaction"),
        Table.each(
            "Reaction times, s",
            times,
            (title, "l", lambda t: label(t.condition)),
            ("Answers", "", lambda t: str(t.answers)),
            ("Median", "", lambda t: number(t.median)),
            ("Quartiles", "n", lambda t: f"{number(t.quartile_low)} to {number(t.quartile_high)}"),
            ("Trimmed mean", "", lambda t: number(t.trimmed_mean)),
            ("Mean of medians", "", lambda t: number(t.mean_of_medians)),
            ("Limits", "n", lambda t: number_range(t.lower, t.upper)),
        ),
        Cautions("About these times", grouped([(label(t.condition), t.warnings) for t in times])),
    )


def time_model_blocks(model: TimeModel | None, label: Callable[[str], str]) -> tuple[Block, ...]:
    """Return the log-normal mixed model of reaction times; nothing where there is none."""
    if model is None:
        return ()
    level = f"{100 * model.level:g} % limits"
    spread = ", ".join(
        f"{name} {number(sd)}"
        for name, sd in (
            ("participants", model.participant_sd),
            ("participants x conditions", model.interaction_sd),
            ("scenes", model.scene_sd),
            ("scenes x conditions", model.scene_interaction_sd),
            ("the rest", model.residual_sd),
        )
        if sd is not None
    )
    return (
        Table.each(
            "Typical reaction times by a log-normal mixed model",
            model.times,
            ("Condition", "l", lambda one: label(one.condition)),
            ("Answers", "", lambda one: str(one.answers)),
            ("Typical, s", "strong", lambda one: number(one.median_s)),
            (level, "n", lambda one: number_range(one.lower, one.upper)),
        ),
        Table.each(
            "How many times as long answers take",
            model.ratios,
            ("Conditions", "l c", lambda one: f"{label(one.first)} / {label(one.second)}"),
            ("Ratio", "strong", lambda one: number(one.ratio)),
            (level, "n", lambda one: number_range(one.lower, one.upper)),
            ("df", "", lambda one: number(one.df, 1)),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        ),
        Paragraph(
            f"Typical: the median answer of the median person. SD of ln s: {spread}. p adj.: Holm.",
            muted=True,
        ),
        Cautions("When not to trust this model of times", model.warnings),
    )


def diffusion_blocks(
    found: DiffusionResults | None, label: Callable[[str], str]
) -> tuple[Block, ...]:
    """Return EZ diffusion by condition, and its differences; nothing where there is none."""
    if found is None:
        return ()
    names = {"drift": "Drift, 1/s", "boundary": "Boundary", "nondecision_s": "Other time, s"}
    return (
        Table.of(
            "EZ diffusion: means over participants",
            (
                ("Condition", "l"),
                ("People", ""),
                *((part, "n") for name in MEASURES for part in (names[name], "limits")),
            ),
            [
                (
                    label(one.condition),
                    str(one.participants),
                    *(
                        cell
                        for name in MEASURES
                        for cell in (
                            number(one.means[name]),
                            f"[{number(one.lower[name])}, {number(one.upper[name])}]",
                        )
                    ),
                )
                for one in found.conditions
            ],
        ),
        *(
            ()
            if not found.contrasts
            else (
                Table.each(
                    "Differences, paired over participants",
                    found.contrasts,
                    ("Conditions", "l c", lambda one: f"{label(one.first)} - {label(one.second)}"),
                    ("Of", "l", lambda one: one.measure),
                    ("Difference", "strong", lambda one: number(one.difference)),
                    ("Limits", "n", lambda one: number_range(one.lower, one.upper)),
                    ("df", "", lambda one: f"{one.df:g}"),
                    ("p", "n", lambda one: p_number(one.p)),
                    ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
                ),
            )
        ),
        Paragraph(
            "Drift: how fast evidence comes; boundary: how much of it is asked for; other time:"
            " for seeing and pressing (Wagenmakers et al. 2007). It takes right and wrong answers"
            " as equally fast.",
            muted=True,
        ),
        Cautions("When not to trust EZ diffusion", found.warnings),
    )
