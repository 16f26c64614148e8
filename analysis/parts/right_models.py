"""Logistic models of right answers: trials as independent, clustered, and mixed."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd
from scipy.special import expit

from analysis.arrays import Floats
from analysis.models.logistic import Coefficient, ModelFit, ModelsBeside, models_beside
from analysis.models.mixed.marginal_means import NO_MARGINS, Margins, margins
from analysis.parts import Presentation, SimplePart
from analysis.parts.margins import (
    contrast_sentences,
    contrasts_table,
    margin_tables,
    means_table,
)
from analysis.parts.shared import (
    GroupedRow,
    bootstrapped,
    group_rows,
    law_of_mixed,
    pairs_in,
    sd_text,
)
from analysis.plans.rate_plan import RatePlan, baseline_in, shown_in
from analysis.repeat import lme4_effects, scripts
from analysis.report.result_table import (
    ResultColumn,
    ResultTable,
    attribute,
    limits,
)
from analysis.report.wording import (
    big,
    law,
    number,
    p_number,
    share,
    share_range,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import Cautions, Folded, Paragraph, grouped


@dataclass(frozen=True)
class RightModels(ModelsBeside):
    """``logit(correct) ~ 1 + level + by``; `groups`: what its errors are clustered by.

    `margins` are logits of the mixed model, at the mean level.
    """

    groups: tuple[str, ...]
    margins: Margins
    notes: tuple[str, ...] = ()

    @property
    def fits(self) -> tuple[tuple[str, ModelFit], ...]:
        """Each by how it takes errors."""
        return (
            ("trials independent", self.independent),
            ("clustered", self.clustered),
            ("mixed", self.mixed),
        )


class ModelsPart(SimplePart[RatePlan, RightModels]):
    """Logistic models of right answers."""

    name: ClassVar[str] = "models"
    section: ClassVar[tuple[str, str]] = ("models", "Models")

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a level, or conditions to compare."""
        return plan.level is not None or (bool(plan.by) and baseline_in(table, plan) is not None)

    def families(self, cells: pd.DataFrame, plan: RatePlan) -> Sequence[FamilyOfTests]:
        """Return a term of the mixed model, whose p a parametric bootstrap alone holds."""
        asked = plan.level is not None or bool(pairs_in(cells, plan))
        return (_term(plan),) * asked

    def of(self, table: pd.DataFrame, plan: RatePlan) -> RightModels:
        """Fit the models, with names that a formula can hold."""
        held: dict[str, pd.Series] = {}
        reference = {}
        if plan.level is not None:
            held[_identifier(plan.level)] = pd.to_numeric(table[plan.level]).astype(float)
        baseline = baseline_in(table, plan)
        if baseline is not None and plan.by:
            held[_identifier(plan.by_name)] = table[plan.compared[0]]
            reference[_identifier(plan.by_name)] = baseline
        groups = [name for name in ("participant", "scene") if name in table]
        rows = table[["correct", *groups]].assign(**held)
        formula = "logit(correct) ~ 1 + " + " + ".join(held)
        beside = models_beside(formula, rows, reference=reference or None, inference=plan.inference)
        several = tuple(name for name in groups if rows[name].nunique() > 1)
        shown = shown_in(rows.assign(condition=table["condition"]), plan) if reference else []
        margins = _margins(beside.mixed, rows, shown, plan)
        notes = _term(plan).hopeless(rows["participant"].nunique(), plan.alpha)
        return RightModels(**vars(beside), groups=several, margins=margins, notes=tuple(notes))

    def show(self, found: RightModels, plan: RatePlan) -> Presentation:
        """Return the three beside each other, and the mixed one's terms as sentences."""
        groups, formula = found.groups, found.independent.formula
        effects = lme4_effects(found.mixed.random_sd, own_names=True)
        crossed = " + ".join([formula, *effects])
        random = "as crossed" if len(groups) > 1 else f"{groups[0]}s as"
        terms = _terms(found)
        blocks = (
            terms.block(),
            Paragraph(
                "b: logarithm of the odds (OR) of a right answer. The first takes trials as"
                " independent, as papers print it; the second clusters its errors by"
                f" {' and '.join(groups)}; the third has"
                f" {'them ' * (len(groups) > 1)}{random} random intercepts and lets effects"
                f" differ between them ({law_of_mixed(scenes=len(groups) > 1)}), and so speaks"
                f" of the typical {groups[0]}."
                + f" Its statistic is the root of the likelihood ratio without the term"
                f"{bootstrapped(plan.bootstrap_draws)}, which errs less often than Wald's."
                * any(one.by_ratio for one in found.mixed.coefficients),
                muted=True,
            ),
        )
        return Presentation(
            others=(
                Folded(
                    "Logistic models of right answers",
                    "Reviewers ask for the mixed model, and papers print the first, which takes"
                    " trials as independent. They speak of odds, for a participant in the middle.",
                    blocks,
                ),
            ),
            blocks=(
                *means_table(
                    f"Marginal means, logits{' at the mean level' * (plan.level is not None)}",
                    found.margins,
                    plan,
                    ResultColumn(
                        "Share right", "strong", lambda one: share(float(expit(one.value)))
                    ),
                    limits(plan.limits, lambda *ends: share_range(*map(float, expit(ends)))),
                ),
                *contrasts_table(found.margins, plan, "logits"),
                Cautions(
                    "When not to trust these models",
                    grouped([(name, fit.warnings) for name, fit in found.fits]),
                ),
            ),
            sentences=tuple(contrast_sentences(found.margins, plan, "logits")),
            methods=(
                f"Logistic models, {formula}, are given with trials as independent, with standard"
                f" errors clustered by {' and '.join(groups)}, and with"
                f" {'both ' * (len(groups) > 1)}{random} random intercepts and effects that differ"
                f" between them{f' ({crossed})' * bool(effects)}, by"
                f" {law_of_mixed(scenes=len(groups) > 1)}."
            ),
            tables={
                "models.csv": terms.frame(),
                **margin_tables(found.margins, "models"),
            },
            scripts=_scripts(found, plan),
        )


def _terms(found: RightModels) -> ResultTable[GroupedRow[tuple[str, ModelFit], Coefficient]]:
    return ResultTable.of(
        f"Logistic models of right answers, {found.independent.formula}",
        group_rows((one, one[1].coefficients) for one in found.fits),
        ResultColumn(
            "Errors",
            "l",
            lambda row: row.group[0] * row.first,
            lambda row: {"errors": row.group[0], **vars(row.entry)},
        ),
        attribute("Term", "entry.term", str, "l"),
        attribute("b", "entry.estimate", _of_three),
        attribute("SE", "entry.standard_error", _of_three),
        attribute("Statistic", "entry.statistic"),
        ResultColumn("Law", "", lambda row: law(row.entry.df, row.entry.statistic)),
        attribute("p", "entry.p", p_number, "n"),
        ResultColumn("OR", "", lambda row: big(row.entry.odds_ratio)),
        ResultColumn("Random SD", "l", lambda row: sd_text(row.group[1].random_sd) * row.first),
    )


_of_three = partial(number, digits=3)


def _term(plan: RatePlan) -> FamilyOfTests:
    return FamilyOfTests("term", " of the mixed model", people=False, draws=plan.bootstrap_draws)


def _margins(
    fit: ModelFit, rows: pd.DataFrame, conditions: Sequence[str], plan: RatePlan
) -> Margins:
    """Return means of conditions at the mean level; none where there is no mixed model."""
    if fit.covariance is None or any(np.isnan(one.estimate) for one in fit.coefficients):
        return NO_MARGINS
    terms = [one.term for one in fit.coefficients]
    design = np.zeros((len(conditions), len(terms)))
    design[:, terms.index("Intercept")] = 1.0
    if plan.level is not None:
        column = _identifier(plan.level)
        design[:, terms.index(column)] = rows[column].mean()
    for row, name in zip(design, conditions, strict=True):
        own = f"{_identifier(plan.by_name)}[T.{name}]"
        if own in terms:
            row[terms.index(own)] = 1.0

    def df(weights: Floats, _variance: float) -> float:
        """Return the least of those of the coefficients that are involved."""
        row = weights @ design
        return min(
            math.inf if one.df is None else one.df
            for one, own in zip(fit.coefficients, row, strict=True)
            if abs(own) > 1e-9
        )

    return margins(
        conditions,
        design,
        np.array([one.estimate for one in fit.coefficients]),
        fit.covariance,
        df,
        level=fit.level,
        asked=plan.contrasts,
    )


def _scripts(found: RightModels, plan: RatePlan) -> dict[str, str]:
    """Return scripts that repeat the models with a maximum, and so no penalty instead of one."""
    proper = all(np.isfinite(one.estimate) for one in found.independent.coefficients)
    independent = proper and "Firth" not in found.independent.method
    compared = any("[T." in one.term for one in found.independent.coefficients)
    terms = ["condition"] * compared + ["level"] * (plan.level is not None)
    return scripts(
        "right",
        *(["R"] if proper and found.mixed.random_sd else []),
        *(["py"] if independent else []),
        by=list(plan.by_columns),
        level=plan.level,
        values=list(plan.values),
        terms=terms,
        effects=lme4_effects(found.mixed.random_sd),
        groups=list(found.groups),
    )


def _identifier(name: str) -> str:
    """Return a column's name as a formula can hold it."""
    plain = re.sub(r"\W+", "_", name)
    # What these mean in a formula or in the table of the model is taken.
    taken = plain in ("C", "Q", "I", "correct", "participant", "scene") or not plain.isidentifier()
    return f"x_{plain}" if taken else plain
