"""Random effects of a report's mixed models: how much people and scenes differ, and who how."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import pandas as pd
from numpy.random import Generator

from analysis.models.mixed.deviations import MOST_PROFILED, Deviation
from analysis.parts import AnalysisPlan, AnyPart, Part, PartFigure, PartNumbers, Presentation
from analysis.plots.trial_plots import caterpillar_plot
from analysis.report.result_table import (
    ResultTable,
    attribute,
    estimated,
    limits,
)
from analysis.report.wording import level_text, number_range, placed, share
from protocols.blocks import FigurePlace, Paragraph

P = TypeVar("P", bound=AnalysisPlan, contravariant=True)


@dataclass(frozen=True)
class ModelEffects:
    """The random effects of one model; `model` is empty where there is one only."""

    model: str
    deviations: tuple[Deviation, ...]


@dataclass(frozen=True)
class ModelDeviation(Deviation):
    """A deviation of a model, which `model` names."""

    model: str = ""


@dataclass(frozen=True)
class RandomEffectResults:
    """Every number."""

    models: tuple[ModelEffects, ...]
    notes: tuple[str, ...]


class RandomEffectsPart(Part[P, RandomEffectResults]):
    """Deviations with profile limits, shares of variance, and a caterpillar of their levels.

    `of` is the part whose models they are of.
    """

    about: ClassVar[str]
    """Model, named in a sentence."""
    unit: ClassVar[str]
    """Unit of deviations, as an axis has it."""

    def __init__(self, of: AnyPart) -> None:
        self._of = of

    def wanted(self, table: pd.DataFrame, plan: P) -> bool:
        """Return True if the models are asked for."""
        return self._of.wanted(table, plan)

    @abstractmethod
    def models(self, found: Any, plan: P) -> Iterator[ModelEffects]:
        """Yield the models of the other part."""

    def compute(
        self, _table: pd.DataFrame, plan: P, found: PartNumbers, _chance: Generator
    ) -> RandomEffectResults:
        """Take them from the models that were fitted."""
        (name,) = self.needs
        fitted = self.models(found[name], plan) if name in found else ()
        models = tuple(one for one in fitted if one.deviations)
        if not models:
            raise ValueError  # the part with the models says why there is none
        notes = []
        if any(math.isnan(own.lower) for one in models for own in one.deviations):
            notes.append(
                f"deviations of {self.about} have no profile limits, and no levels: more than"
                f" {MOST_PROFILED} random effects would take minutes"
            )
        return RandomEffectResults(models, tuple(notes))

    def show(self, found: RandomEffectResults, plan: P) -> Presentation:
        """Return the deviations, and the levels of participants and scenes."""
        rows = [
            ModelDeviation(**vars(own), model=one.model)
            for one in found.models
            for own in one.deviations
        ]
        name, drawn = self.name, [own for own in rows if own.levels]
        model = attribute("Model", "model", str, "l c")
        table = ResultTable[ModelDeviation].of(
            f"Random effects of {self.about}",
            rows,
            model if any(own.model for own in rows) else replace(model, text=None),
            attribute("Of", "name", str, "l"),
            estimated(f"SD, {self.unit}", "sd"),
            limits(plan.limits),
            attribute("ICC", "icc", share),
        )
        return Presentation(
            blocks=(
                table.block(),
                Paragraph(
                    "Limits: where the profile likelihood falls as far as chi-square (1) allows."
                    " ICC: share of the variance of one answer on the model's scale"
                    " (intraclass correlation); none where effects differ by condition.",
                    muted=True,
                ),
                FigurePlace(name),
            ),
            sentences=tuple(
                f"Random effects of {self.about}{own.model and f' ({own.model})'}: the SD of"
                f" {own.name} was {placed(own, own.sd)} {self.unit}, {level_text(plan.confidence)}"
                f" {number_range(own.lower, own.upper)}"
                + (f" (ICC = {share(own.icc)})." if not math.isnan(own.icc) else ".")
                for own in rows
            ),
            methods=(
                f"Standard deviations of random effects of {self.about} have limits of the profile"
                " likelihood."
            ),
            tables={
                f"{name}.csv": table.frame(),
                **({f"{name}_levels.csv": _levels(drawn)} if drawn else {}),
            },
            figures=[self._figure(drawn, plan)] if drawn else [],
        )

    def _figure(self, drawn: Sequence[Deviation], plan: P) -> PartFigure:
        levels = {own.name: own.levels for own in drawn}
        caption = (
            f"Random effects of {self.about}: how far each {' and '.join(levels)} lies from the"
            f" typical one, with {plan.limits} given the model's deviations."
        )
        draw = partial(
            caterpillar_plot,
            levels,
            x_label=f"From the typical one, {self.unit}",
            level=plan.confidence,
            label=plan.label,
        )
        return PartFigure(self.name, caption, draw)


def _levels(rows: Sequence[ModelDeviation]) -> pd.DataFrame:
    return pd.DataFrame(
        {"model": own.model, "of": own.name, "level": one.name}
        | {"value": one.value, "error": one.error}
        for own in rows
        for one in own.levels
    )


class RightEffects(RandomEffectsPart[AnalysisPlan]):
    """Random effects of the mixed model of right answers."""

    name: ClassVar[str] = "random_effects"
    section: ClassVar[tuple[str, str]] = ("models", "Models")
    needs: ClassVar[tuple[str, ...]] = ("models",)
    about: ClassVar[str] = "right answers"
    unit: ClassVar[str] = "logits"

    def models(self, found: Any, _plan: AnalysisPlan) -> Iterator[ModelEffects]:
        """Yield the mixed one."""
        yield ModelEffects("", found.mixed.deviations)


class TimeEffects(RandomEffectsPart[AnalysisPlan]):
    """Random effects of the model of reaction times."""

    name: ClassVar[str] = "random_times"
    section: ClassVar[tuple[str, str]] = ("checks", "Learning, speed")
    needs: ClassVar[tuple[str, ...]] = ("times",)
    about: ClassVar[str] = "reaction times"
    unit: ClassVar[str] = "ln s"

    def wanted(self, table: pd.DataFrame, plan: AnalysisPlan) -> bool:
        """Return True if times are modelled."""
        return plan.reaction == "models" and super().wanted(table, plan)

    def models(self, found: Any, _plan: AnalysisPlan) -> Iterator[ModelEffects]:
        """Yield the log-normal one."""
        if found.model is not None:
            yield ModelEffects("", found.model.deviations)


class RatingEffects(RandomEffectsPart[AnalysisPlan]):
    """Random effects of the model of ratings."""

    name: ClassVar[str] = "random_ratings"
    section: ClassVar[tuple[str, str]] = ("ratings", "Ratings")
    needs: ClassVar[tuple[str, ...]] = ("ratings",)
    about: ClassVar[str] = "ratings"
    unit: ClassVar[str] = "latent units"

    def models(self, found: Any, _plan: AnalysisPlan) -> Iterator[ModelEffects]:
        """Yield the cumulative-link one."""
        yield ModelEffects("", found.model.deviations)
