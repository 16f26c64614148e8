"""Logit mixed models of choices, one of each comparison."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
import pandas as pd
from numpy.random import Generator

from analysis.models.compared_methods import Comparisons
from analysis.models.logistic import Coefficient, ModelFit, glmm_logit
from analysis.models.mixed.inference import Inference
from analysis.models.preference import Preference
from analysis.parts import Part, PartNumbers, Presentation
from analysis.parts.preferences import PreferenceResults
from analysis.parts.shared import GroupedRow, group_rows, sd_text
from analysis.plans.preference_plan import PreferencePlan
from analysis.repeat import scripts
from analysis.report.result_table import ResultColumn, ResultTable, attribute
from analysis.report.wording import NONE, big, p_number, t_text
from protocols.blocks import Block, Cautions, Paragraph, grouped


@dataclass(frozen=True)
class PairModel:
    """The model of one comparison; its intercept is the preference without order bias."""

    method: str
    against: str
    size: str
    fit: ModelFit


@dataclass(frozen=True)
class ChoiceModels:
    """Every number."""

    pairs: tuple[PairModel, ...]
    notes: tuple[str, ...]


class ChoiceModelsPart(Part[PreferencePlan, ChoiceModels]):
    """Preferences with participants and scenes as random effects."""

    name: ClassVar[str] = "choice_models"
    section: ClassVar[tuple[str, str]] = ("models", "Models")
    needs: ClassVar[tuple[str, ...]] = ("preferences",)
    beside: ClassVar[tuple[str, str]] = (
        "Mixed model of each comparison",
        "Reviewers ask for it. It gives the order of presentation a term of its own, and says how"
        " far participants and scenes differ.",
    )

    def compute(
        self, table: pd.DataFrame, _plan: PreferencePlan, found: PartNumbers, _chance: Generator
    ) -> ChoiceModels:
        """Fit each comparison."""
        preferences: PreferenceResults = found["preferences"]
        decisions = Comparisons(table)
        pairs = tuple(
            PairModel(one.method, one.against, one.size, _mixed(decisions, one))
            for one in preferences.table.cells
        )
        return ChoiceModels(pairs, ())

    def show(self, found: ChoiceModels, plan: PreferencePlan) -> Presentation:
        """Return the table of models, and what each says."""
        models = _pairs(found, plan)
        mixed = any(
            one.fit.random_sd and math.isfinite(one.fit["Intercept"].estimate)
            for one in found.pairs
        )
        return Presentation(
            blocks=tuple(_blocks(found, models, plan)),
            methods=(
                "Logit mixed models had crossed random intercepts of participants and scenes"
                " (Laplace approximation) and the order of presentation as a covariate."
            ),
            tables={"models.csv": models.frame()},
            scripts=scripts("choices", *(["R"] if mixed else []), "py"),
        )


def _mixed(decisions: Comparisons, cell: Preference) -> ModelFit:
    rows = decisions.rows(cell.method, cell.against, cell.size)
    table = pd.DataFrame(
        {
            "preferred": (rows["chosen"] == cell.method).astype(int),
            "shown_first": np.where(rows["first"] == cell.method, 0.5, -0.5),
            "participant": rows["participant"],
            "scene": rows["scene"],
        }
    )
    groups = [column for column in ("participant", "scene") if table[column].nunique() > 1]
    terms = "1 + shown_first" if table["shown_first"].nunique() > 1 else "1"
    return glmm_logit(
        f"preferred ~ {terms}",
        table,
        groups=groups or ["participant"],
        between=True,
        inference=Inference(cell.estimate.level),
    )


PairRow: TypeAlias = GroupedRow[PairModel, Coefficient]


def _pairs(found: ChoiceModels, plan: PreferencePlan) -> ResultTable[PairRow]:
    def fitted(row: PairRow) -> dict[str, object]:
        fit = row.group.fit
        random = {f"sd_{name}": sd for name, sd in fit.random_sd.items()}
        return vars(row.entry) | random | {"model": fit.method, "warnings": "; ".join(fit.warnings)}

    return ResultTable.of(
        "Logit mixed models: crossed random intercepts, order of presentation as covariate",
        group_rows((one, one.fit.coefficients) for one in found.pairs),
        ResultColumn(
            "Comparison",
            "l c",
            lambda row: _name(row.group, plan) * row.first,
            "group.method group.against group.size",
        ),
        ResultColumn(
            "Term",
            "l",
            lambda row: "preference" if row.entry.term == "Intercept" else "shown first",
            fitted,
        ),
        attribute("b", "entry.estimate"),
        attribute("SE", "entry.standard_error"),
        ResultColumn(
            "Statistic",
            "n",
            lambda row: t_text(row.entry.statistic, row.entry.df, none=NONE),
        ),
        attribute("p", "entry.p", p_number, "n"),
        ResultColumn(f"OR, {plan.limits}", "n", lambda row: _odds_text(row.entry)),
        ResultColumn("Random SD", "l", lambda row: _spread(row.group.fit) * row.first),
    )


def _name(one: PairModel, plan: PreferencePlan) -> str:
    return plan.named(one.method, one.against, one.size)


def _blocks(
    found: ChoiceModels,
    models: ResultTable[PairRow],
    plan: PreferencePlan,
) -> Iterator[Block]:
    yield models.block()
    yield Paragraph(
        "b: logarithm of the odds (OR) of choosing the first method, for a participant and a"
        ' scene in the middle; "shown first": how far b rises where that method was shown first'
        " instead of second. p and limits: of the likelihood ratio, its root by t. Where a mixed"
        " model cannot be had, the row says what stands in its place: clustered errors with t, or"
        " Firth's penalty, whose p and limits are of its profile likelihood and take trials as"
        " independent."
        " Random SD: how far participants, and scenes, differ on the scale of b.",
        muted=True,
    )
    yield Cautions(
        "When not to trust these models",
        grouped([(_name(one, plan), one.fit.warnings) for one in found.pairs]),
    )


def _odds_text(row: Coefficient) -> str:
    with np.errstate(over="ignore"):
        ratio, lower, upper = map(big, np.exp([row.estimate, row.lower, row.upper]).tolist())
    return f"{ratio} [{lower}, {upper}]"


def _spread(fit: ModelFit) -> str:
    if fit.random_sd:
        return sd_text(fit.random_sd)
    return "none: " + ("Firth" if "Firth" in fit.method else "clustered")
