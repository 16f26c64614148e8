"""Planned looks at the data before all participants have come: the section of a study."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from protocols.units import Model, Positive

SequentialRule: TypeAlias = Literal["obrien-fleming", "pocock", "bayes-factor"]


class Sequential(Model):
    """Planned looks at the data, and when to stop."""

    rule: SequentialRule
    """`obrien-fleming` rarely stops early and costs almost no power. `pocock` treats all looks
    alike. Both keep alpha over all looks (Lan-DeMets spending). `bayes-factor` stops at evidence
    for or against a difference and does not control error rates."""
    looks: Annotated[tuple[Positive, ...], Field(min_length=2)]
    """Number of participants at each look, rising. The last is `study.participants`."""
    bayes_factor: Annotated[float, Field(gt=1, le=1e9)] = 10.0
    """Factor of `bayes-factor`: stop at it, or at its inverse."""

    @model_validator(mode="after")
    def _looks_rise(self) -> Sequential:
        if self.looks[0] < 2 or any(
            later <= sooner for sooner, later in zip(self.looks, self.looks[1:], strict=False)
        ):
            raise ValueError(
                "looks must rise, from 2 participants on, or a look tests nothing new"
                f" (got {list(self.looks)})"
            )
        return self

    def plain_sentences(self, alpha: float, judged: str) -> list[str]:
        """Return the rule in sentences, for a preregistration; `judged` says which p."""
        people = f"{', '.join(map(str, self.looks))} participants"
        looks = f"{people} left after exclusions, by its p, {judged}"
        if self.rule == "bayes-factor":
            return [
                f"The planned test is looked at with {looks}. The study stops where its"
                f" default Bayes factor is at least {self.bayes_factor:g}, or at most"
                f" 1/{self.bayes_factor:g}."
            ]
        name = {"obrien-fleming": "O'Brien-Fleming", "pocock": "Pocock"}[self.rule]
        return [
            f"The planned test is looked at with {looks}. Error is spent by the Lan-DeMets"
            f" function of {name} type, alpha {alpha:g} over all looks; the study stops"
            " where the test is significant at its look."
        ]
