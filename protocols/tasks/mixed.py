"""Settings that analyses by mixed models share: contrasts that a study names, p by bootstrap."""

import math
import re
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field

from protocols.errors import Problem, count_of, did_you_mean
from protocols.tasks.base import Analysis

NOTHING_LEFT = 2e-3
"""Largest sum that counts as 0, as a share of the largest weight: thirds have three digits."""
MOST_DRAWS = 100_000
"""Largest number of draws of a parametric bootstrap."""
_WEIGHT = re.compile(r"\s*(.+?)\s*=\s*([-+]?[\d./]+)\s*(?:,|$)")


def _weights(given: object) -> object:
    if not isinstance(given, str):
        return given
    found = _WEIGHT.findall(given)
    try:
        return {name: float(Fraction(weight)) for name, weight in found if found}
    except (ValueError, ZeroDivisionError):
        return given


Weights = Annotated[dict[str, float], BeforeValidator(_weights)]
"""Weights of conditions by name; in one text `ours=1, blur=-1/2, none=-1/2`."""


class MixedAnalysis(Analysis):
    """An analysis with a mixed model of its answers."""

    added_later: ClassVar[tuple[str, ...]] = (
        *Analysis.added_later,
        "contrasts",
        "bootstrap_draws",
    )

    contrasts: dict[str, Weights] = Field(default_factory=dict)
    """Contrasts of the mixed models' means by name, Holm-adjusted together: of each, weights of
    conditions that sum to 0, such as `{ ours = 1, blur = -0.5, none = -0.5 }`. Default: none."""
    bootstrap_draws: Annotated[int, Field(ge=0, le=MOST_DRAWS)] = 0
    """Studies drawn from each smaller model, for p of likelihood ratios by parametric bootstrap,
    which holds where people are few; some 1000, each a fit. Default: none."""

    def contrast_problems(self, known: Sequence[str]) -> Iterator[Problem]:
        """Yield the faults of contrasts of these conditions."""
        for name, weights in self.contrasts.items():
            where = f"analysis.contrasts.{name}"
            for condition in weights:
                if condition not in known:
                    yield Problem(
                        where,
                        f"must name conditions ({'; '.join(known)}) (got {condition!r})"
                        f"{did_you_mean(condition, known)}",
                    )
            largest = max(map(abs, weights.values()), default=0.0)
            total = math.fsum(weights.values())
            if not (0.0 < largest < math.inf and abs(total) <= NOTHING_LEFT * largest):
                yield Problem(
                    where,
                    "must have weights above and below 0 that sum to 0, such as 1 and -1 (got"
                    f" {', '.join(f'{one} = {own:g}' for one, own in weights.items()) or 'none'})",
                )

    def mixed_sentences(self) -> list[str]:
        """Return contrasts and bootstrap in sentences, for a preregistration."""
        found = [
            f"Contrast {name} of the mixed model's means:"
            f" {', '.join(f'{own:g} x {one}' for one, own in weights.items())}; two-sided, alpha"
            f" {self.alpha:g}, Holm-adjusted over"
            f" {count_of(len(self.contrasts), 'named contrast')}."
            for name, weights in self.contrasts.items()
        ]
        if self.bootstrap_draws:
            found.append(
                "Likelihood ratios of mixed models are judged by a parametric bootstrap of"
                f" {self.bootstrap_draws} draws."
            )
        return found
