"""Random effects of a report's mixed models: how much people and scenes differ."""

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import pandas as pd
from numpy.random import Generator

from analysis.models.mixed.deviations import MOST_PROFILED, Deviation
from analysis.parts import AnalysisPlan, AnyPart, Part, PartNumbers, Presentation
from analysis.report.result_table import (
    ResultTable,
    attribute,
    estimated,
    limits,
)
from analysis.report.wording import level_text, number_range, placed, share
from protocols.blocks import Paragraph

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
    """Deviations with profile limits, and shares of variance.

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
                f"deviations of {self.about} have no profile limits: more than"
                f" {MOST_PROFILED} random effects would take minutes"
            )
        return RandomEffectResults(models, tuple(notes))

    def show(self, found: RandomEffectResults, plan: P) -> Presentation:
        """Return the deviations."""
        rows = [
            ModelDeviation(**vars(own), model=one.model)
            for one in found.models
            for own in one.deviations
        ]
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
            tables={f"{self.name}.csv": table.frame()},
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
