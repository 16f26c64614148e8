"""The sections of a report of ratings."""

import math

from analysis.ordinal import RatingDifference
from analysis.report.wording import number, number_range, p_number, share
from analysis.tasks.blocks import (
    Block,
    Box,
    Cautions,
    Paragraph,
    Picture,
    Section,
    Table,
)
from analysis.tasks.common_blocks import learning_blocks, reaction_blocks, time_model_blocks
from analysis.tasks.ratings.settings import RatingSettings
from analysis.tasks.ratings.study import RatingResults
from analysis.tasks.ratings.wording import apa_rating


def lead(results: RatingResults, settings: RatingSettings) -> tuple[Block, ...]:
    """Return the clearest comparison, and how many others differ."""
    first = clearest(results)
    p = [decisive_p(one, settings) for one in results.model.contrasts]
    count = sum(value < settings.alpha for value in p)
    adjusted = ", Holm-adjusted" if settings.correction == "holm" and len(p) > 1 else ""
    return (
        Box(
            "Clearest comparison",
            apa_rating(first, results.model),
            f"{count} of {len(p)} comparisons differ, two-sided{adjusted}.",
        ),
    )


def clearest(results: RatingResults) -> RatingDifference:
    """Return the comparison with the least p; any, where the ratings identify none."""
    return min(results.model.contrasts, key=lambda one: (math.isnan(one.p), one.p))


def decisive_p(one: RatingDifference, settings: RatingSettings) -> float:
    """Return the p that decides: adjusted where the table's options correct."""
    return one.p_adjusted if settings.correction == "holm" else one.p


def sections(results: RatingResults, settings: RatingSettings) -> tuple[Section, ...]:
    """Return ratings, people, checks, in reading order."""
    return (
        Section("ratings", "Ratings", "Ratings", _ratings(results, settings)),
        Section("people", "Participants", "Participants", _people(results)),
        Section("checks", "Learning, speed", "Learning, speed", _checks(results, settings)),
    )


def _ratings(results: RatingResults, settings: RatingSettings) -> tuple[Block, ...]:
    model, pairs = results.model, settings.by is None
    unit = "SD" if model.link == "probit" else "logits"
    level = f"{100 * model.level:g} % limits"
    steps = [] if pairs else [(f"{name}", "") for name in model.categories]
    places = Table.of(
        f"Places on the latent axis, {unit} from the first",
        (
            ("Condition", "l c"),
            ("Ratings", ""),
            ("Place", "strong"),
            (level, "n"),
            *([] if pairs else [("Mean", "")]),
            *steps,
        ),
        [
            (
                one.condition,
                str(one.ratings),
                number(one.place),
                number_range(one.lower, one.upper),
                *([] if pairs else [number(one.mean_rating)]),
                *([] if pairs else map(share, one.shares)),
            )
            for one in model.conditions
        ],
    )
    differences = Table.each(
        "Comparisons",
        model.contrasts,
        ("Conditions", "l c", lambda one: f"{one.first} - {one.second}"),
        (f"Difference, {unit}", "strong", lambda one: number(one.difference)),
        (level, "n", lambda one: number_range(one.lower, one.upper)),
        ("t(df)", "n", lambda one: f"({one.df:.1f})"),
        ("p", "n", lambda one: p_number(one.p)),
        ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        ("Rated higher", "", lambda one: share(one.superiority)),
    )
    spread = ", ".join(f"{name} {number(sd)}" for name, sd in model.sd.items())
    told = (
        "Ratings cut a latent axis at thresholds (cumulative-link mixed model). Place: where a"
        f" condition lies on it. Random, SD: {spread}. Rated higher: the chance that one showing of"
        " the first is rated above one of the second by the same person, on the axis, where"
        " nothing ties."
    )
    if pairs:
        told += (
            f" Thresholds: {', '.join(map(number, model.thresholds))}; symmetric around 0 unless"
            " the place in the pair sways the answer."
        )
    else:
        told += (
            " Mean: for orientation only, the steps of a scale have no unit; under the ratings"
            " their shares."
        )
    return (
        Picture("ratings"),
        places,
        differences,
        Paragraph(told, muted=True),
        Cautions("When not to trust these ratings", model.warnings),
    )


def _people(results: RatingResults) -> tuple[Block, ...]:
    return (
        Table.of(
            "How often each participant gave each rating",
            (("Participant", "l"), *((name, "") for name in results.model.categories)),
            [(who, *map(str, counts)) for who, counts in results.levels.items()],
        ),
        Paragraph(
            "People use a scale in their own ways; the model takes a person who rates everything"
            " higher as just that. One who gave a single rating tells nothing.",
            muted=True,
        ),
    )


def _checks(results: RatingResults, settings: RatingSettings) -> tuple[Block, ...]:
    return (
        *learning_blocks(results.learning),
        *reaction_blocks(results.reaction, settings.by or "Trials", str),
        *time_model_blocks(results.times, str),
    )
