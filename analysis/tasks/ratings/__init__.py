"""The analysis of ordered ratings, kind `ratings`."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NoReturn

import numpy as np
import pandas as pd

from analysis.exclusions import FlowStep
from analysis.plots import learning_plot, sized
from analysis.plots.ratings import ratings_plot
from analysis.report.wording import leading
from analysis.tables.ratings import read_ratings, scale_of
from analysis.tables.table import Source
from analysis.tasks.base import (
    Counted,
    Estimate,
    Step,
    TableOptions,
    TaskAnalysis,
)
from analysis.tasks.blocks import Block, ReportFigure, Section
from analysis.tasks.common_figures import reaction_figure
from analysis.tasks.ratings.sections import clearest, decisive_p, lead, sections
from analysis.tasks.ratings.settings import (
    RatingSettings,
    RatingsOptions,
    from_protocol,
    settings_of,
)
from analysis.tasks.ratings.study import RatingResults, analyse, category, fitted
from analysis.tasks.ratings.wording import apa_rating, rating_tables
from protocols.columns import Column, decided
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.tasks.rating import RATING_COLUMNS

_ALWAYS = ("session", "participant", "simulated", "trial", "kind", "order", "included", "exclusion")


class Ratings(TaskAnalysis[RatingSettings, RatingResults]):
    """A cumulative-link mixed model of ratings, or of graded comparisons of pairs."""

    kind: ClassVar[str] = "ratings"
    options: ClassVar[type[TableOptions]] = RatingsOptions

    def settings(self, study: StudyProtocol) -> RatingSettings:
        """Return the settings that a protocol fixes."""
        return from_protocol(study)

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> RatingSettings:
        """Return what the options say."""
        return settings_of(decisions, name, options)

    def options_of(self, settings: RatingSettings) -> RatingsOptions:
        """Return the options that say the same."""
        return RatingsOptions(
            by=settings.by,
            baseline=settings.baseline,
            scale=",".join(settings.scale) or None,
            link=settings.link,
            correction=settings.correction,
            alpha=settings.alpha,
        )

    def read(self, table: Source, mapping: Mapping[str, str], options: Any) -> pd.DataFrame:
        """Read ratings: who gave which to what."""
        scale = scale_of(options.scale, "--set scale")
        rows = read_ratings(table, mapping, by=options.by, scale=scale, option="--set {}=")
        return rows.assign(
            session=rows["participant"],
            trial=[f"row-{number}" for number in range(1, len(rows) + 1)],
            kind="main",
            included=1,
            exclusion="",
        )[[column.name for column in _columns(rows)]]

    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of the table."""
        return _columns(decisions)

    def analyse(
        self, decisions: pd.DataFrame, settings: RatingSettings, step: Step
    ) -> RatingResults:
        """Return places, comparisons, trends and times."""
        try:
            return analyse(decisions, settings, step)
        except ValueError as problem:
            raise StudyError(f"{settings.study}: {problem}") from None

    def estimates(self, decisions: pd.DataFrame, settings: RatingSettings) -> Sequence[Estimate]:
        """Return the differences between conditions that the ratings identify."""
        model = fitted(decisions, settings)
        return tuple(
            Estimate(
                f"{one.first} over {one.second}",
                one.difference,
                one.lower,
                one.upper,
                decisive_p(one, settings),
                model.ratings,
            )
            for one in model.contrasts
            if not math.isnan(one.difference)
        )

    def planned_p(self, results: RatingResults) -> float | None:
        """Return the least adjusted p of the comparisons."""
        known = [one.p_adjusted for one in results.model.contrasts if one.p_adjusted >= 0]
        return min(known, default=None)

    def warnings(self, results: RatingResults) -> tuple[str, ...]:
        """Return what is odd about the table as a whole."""
        return results.warnings

    def tables(self, decisions: pd.DataFrame, results: RatingResults) -> Mapping[str, pd.DataFrame]:
        """Return conditions, comparisons and thresholds."""
        return rating_tables(results.model, pairs="first" in decisions)

    # The page.

    def counted(self, settings: RatingSettings) -> str:
        """Return what is rated."""
        return "pairs, graded" if settings.by is None else f"ratings by {settings.by}"

    def lead(self, results: RatingResults, settings: RatingSettings) -> Sequence[Block]:
        """Return the clearest comparison."""
        return lead(results, settings)

    def sections(self, results: RatingResults, settings: RatingSettings) -> Sequence[Section]:
        """Return ratings, people, checks."""
        return sections(results, settings)

    def figures(
        self,
        decisions: pd.DataFrame,
        results: RatingResults,
        settings: RatingSettings,
        *,
        simulated: bool,
    ) -> Sequence[ReportFigure]:
        """Return the figures of all sections."""
        level = f"{100 * settings.confidence:g} %"
        shares = "Left: share of each rating. " if settings.by is not None else ""
        made = [
            ReportFigure(
                "ratings",
                f"{shares}Places on the latent axis with {level} limits, from the first"
                " condition on.",
                sized(
                    ratings_plot,
                    results.model,
                    shares=settings.by is not None,
                    simulated=simulated,
                ),
            )
        ]
        steps = decisions["rating"].map(category).map(results.model.steps).astype(float)
        rows = decisions.assign(step=steps)
        if results.learning:
            made.append(
                ReportFigure(
                    "learning",
                    "Ratings, in steps of the scale, along the session; thin lines: participants;"
                    " band: 95 % t limits.",
                    sized(
                        learning_plot, rows, "step", y_label="Rating, steps", simulated=simulated
                    ),
                )
            )
        if results.reaction:
            made.append(
                reaction_figure(
                    decisions, settings.by, results.reaction, level, simulated=simulated
                )
            )
        return made

    def methods(
        self,
        results: RatingResults,
        settings: RatingSettings,
        *,
        people: int,
        decisions: int,
        flow: Sequence[FlowStep],  # noqa: ARG002
        version: str,
    ) -> str:
        """Return how ratings were analysed."""
        model = results.model
        kind = "graded comparisons of pairs" if settings.by is None else "ordered ratings"
        random = ", ".join(model.sd)
        corrected = "Holm-adjusted" if settings.correction == "holm" else "not adjusted"
        return (
            f"We analysed {decisions} {kind} of {people} participant{'s' * (people != 1)} on"
            f" {len(model.categories)} categories by a cumulative-link mixed model"
            f" ({model.link}; McCullagh, 1980; Laplace approximation), random over {random}."
            f" Differences are Wald's with t of {people - 1} degrees of freedom, two-sided, alpha ="
            f" {leading(f'{settings.alpha:g}')}, {corrected} over {len(model.contrasts)}"
            f" comparisons. Analyses were run with metamerlab {version}."
        )

    def sentences(self, results: RatingResults, _settings: RatingSettings) -> Sequence[str]:
        """Return every comparison as a sentence."""
        return [apa_rating(one, results.model) for one in results.model.contrasts]

    def headline(self, results: RatingResults, _settings: RatingSettings) -> str:
        """Return the comparison that is clearest."""
        return apa_rating(clearest(results), results.model)

    # Power.

    def assumptions(self, _study: StudyProtocol) -> NoReturn:
        """Refuse: nobody simulates ratings yet."""
        raise StudyError(
            "analysis.kind: the power of 'ratings' cannot be simulated; plan by a pilot, whose"
            " report gives the limits of every difference"
        )

    def power(
        self,
        study: StudyProtocol,
        _assumed: Mapping[str, float],
        *,
        rng: np.random.Generator,  # noqa: ARG002
        studies: int | None = None,  # noqa: ARG002
        progress: Counted | None = None,  # noqa: ARG002
    ) -> NoReturn:
        """Refuse, as `assumptions` does."""
        self.assumptions(study)


def _columns(decisions: pd.DataFrame) -> tuple[Column, ...]:
    known = {*_ALWAYS, "scene", "rating", "rt_s"}
    condition = [
        Column("scene", "text", "", "Scene"),
        *(
            Column(str(name), "text", "", "Column of the table's conditions")
            for name in decisions.columns
            if name not in known
        ),
    ]
    there = {*_ALWAYS, *decisions.columns}
    return tuple(column for column in decided(condition, RATING_COLUMNS) if column.name in there)
