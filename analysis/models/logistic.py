"""Models of trials by formula: logit GLM, robust and penalised, and the crossed GLMM."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pandas as pd

from analysis.arrays import Floats, Ints
from analysis.models.contrasts import MOST_IN_PAIRS, Effect, between_df
from analysis.models.curves.response import LOGIT, PROBIT, ResponseFunction
from analysis.models.mixed.deviations import Deviation
from analysis.models.mixed.formula import FormulaDesign, group_codes
from analysis.models.mixed.glmm import (
    SINGULAR_SD,
    CrossedFit,
    crossed_deviations,
    fit_crossed,
)
from analysis.models.mixed.inference import USUAL, Inference
from analysis.models.mixed.logit import (
    cluster_covariance,
    firth_limits,
    fit_logit,
    likelihood_ratio_p,
    separated,
)
from analysis.models.mixed.profile import HeldContrast, ratio_test
from analysis.models.numeric import two_sided_p, two_sided_quantile

FEW_CLUSTERS = 10

GROUPS = ("participant", "scene")
CENTRED = " from its mean"


@dataclass(frozen=True)
class Coefficient:
    """One row of a model's table.

    Attributes
    ----------
    df : float or None
        Of t; None where the statistic is z.
    estimate, standard_error, statistic : float
        The last is the first by the second, or where `by_ratio` the root of the likelihood ratio
        without this term. NaN, as all numbers of the row, where the trials do not identify the
        term.
    p, lower, upper : float
        Of t, z or parametric bootstrap; limits of a likelihood ratio are of the profile likelihood,
        as p and limits under Firth's penalty are.
    by_ratio : bool
        A mixed model's likelihood ratio judges the term, and not Wald's statistic.
    """

    term: str
    estimate: float
    standard_error: float
    statistic: float
    df: float | None
    p: float
    lower: float
    upper: float
    by_ratio: bool = False

    @property
    def odds_ratio(self) -> float:
        """exp(estimate)."""
        return float(np.exp(self.estimate))


@dataclass(frozen=True)
class ModelFit:
    """A fitted logit model.

    Attributes
    ----------
    formula, method : str
        `method` says how estimates and standard errors were made.
    coefficients : tuple of Coefficient
    random_sd : mapping
        Standard deviation of each random intercept (GLMM only).
    trials : int
    log_likelihood : float
    level : float
        Coverage of the limits.
    warnings : tuple of str
        When not to trust it.
    deviations : tuple of Deviation
        Of random effects, with profile limits, where they were asked for.
    covariance : ndarray (coefficients, coefficients) or None
        Of the coefficients of a mixed model.
    """

    formula: str
    method: str
    coefficients: tuple[Coefficient, ...]
    random_sd: Mapping[str, float]
    trials: int
    log_likelihood: float
    level: float
    warnings: tuple[str, ...]
    deviations: tuple[Deviation, ...] = ()
    covariance: Floats | None = field(default=None, compare=False)

    def __getitem__(self, term: str) -> Coefficient:
        for coefficient in self.coefficients:
            if coefficient.term == term:
                return coefficient
        raise KeyError(f"{term!r}; the model has {[c.term for c in self.coefficients]}")


def glm_logit(
    formula: str,
    trials: pd.DataFrame,
    *,
    cluster: Sequence[str] = (),
    reference: Mapping[str, str] | None = None,
    level: float = 0.95,
) -> ModelFit:
    """Fit ``logit(correct) ~ 1 + eccentricity + method`` and the like by maximum likelihood.

    Parameters
    ----------
    formula : str
        Wilkinson notation. The left side is a 0/1 column, as ``y`` or, as papers write it,
        ``logit(y)``.
    trials : DataFrame, one row per trial
    cluster : sequence of at most two columns
        Cluster-robust standard errors with t(G - 1), G the smaller number of clusters. Empty:
        the model's own, with z, as [BB] 6.1 (takes trials as independent).
    reference : mapping of column to level
        The level other levels are compared with; left out, the first in sorted order.

    Raises
    ------
    ValueError
        If the formula names no column of `trials`, its left side holds more than 0 and 1, a value
        is missing, more than two columns are clusters, or one of them has a single group.

    Notes
    -----
    Under separation no maximum exists and Wald tests read "p > .99"; the fit then uses Firth's
    penalty with penalised likelihood-ratio p-values (Heinze and Schemper 2002) and says so.
    """
    if len(cluster) > 2:
        raise ValueError(f"cluster must name at most two columns (got {list(cluster)})")
    model = FormulaDesign.of(formula, trials, reference)
    design, y, terms, back = model.scaled, model.y, model.terms, model.back
    ones, found, hidden = np.ones_like(y), model.notes, model.hidden
    if separated(design, y, ones):
        return _firth(model, level)
    solution = fit_logit(design, y, ones)
    if not solution.converged:
        found.append("the fit did not converge: its numbers are left out")
        hidden = tuple(terms)
    covariance, df, method = solution.covariance, None, "maximum likelihood, trials independent"
    if cluster:
        codes = tuple(group_codes(trials, column) for column in cluster)
        groups = [int(code.max()) + 1 for code in codes]
        covariance = cluster_covariance(design, y, ones, solution.beta, codes)
        df = float(min(groups) - 1)
        method = "maximum likelihood, clustered by " + " and ".join(cluster)
        if min(groups) < FEW_CLUSTERS:
            found.append(f"only {min(groups)} clusters: robust standard errors tend to be small")
        if min(groups) < 2:
            raise ValueError(f"cluster columns must have at least two groups (got {groups})")
    else:
        found.append("takes trials as independent; trials of one participant are not")
    fit = ModelFit(
        formula=formula,
        method=method,
        coefficients=_table(
            terms,
            back @ solution.beta,
            np.sqrt(np.diag(back @ covariance @ back.T).clip(min=0.0)),
            [df] * len(terms),
            level,
        ),
        random_sd={},
        trials=int(y.size),
        log_likelihood=solution.log_likelihood,
        level=level,
        warnings=tuple(found),
    )
    return _without(fit, hidden)


def glmm_logit(
    formula: str,
    trials: pd.DataFrame,
    *,
    groups: Sequence[str],
    slopes: Sequence[tuple[str, str]] = (),
    reference: Mapping[str, str] | None = None,
    between: bool = False,
    inference: Inference = USUAL,
) -> ModelFit:
    """Fit a logit model with crossed random intercepts by the Laplace approximation.

    Parameters
    ----------
    groups : sequence of columns
        For example ``("participant", "scene")``: one random intercept each, crossed.
    slopes : sequence of (column of numbers, group)
        Random slopes, each independent of all else: ``("signal", "participant")``.
    between : bool
        Statistics and likelihood ratios are judged by t with degrees of freedom between those of
        participants and of scenes, whose effects `groups` and `slopes` then are (the first word
        or the last of a name says whose); else by z and chi-square.

    Raises
    ------
    ValueError
        As `glm_logit` for the formula, or if the column of a random slope holds no numbers.

    Notes
    -----
    Same likelihood as lme4 and glmmTMB; standard errors from its full second derivative, as
    glmmTMB's. Likelihood ratios judge terms, and limits are those of the profile likelihood. By
    z, with about ten participants, p are somewhat small. A term whose effect differs between
    people, in a model without a random effect that says so, is found far too often.
    """
    model = FormulaDesign.of(formula, trials, reference)
    if separated(model.scaled, model.y, np.ones_like(model.y)):
        return _firth(model, inference.level)
    fit = _mixed(model, trials, groups, slopes, LOGIT, inference, between=between)
    if fit.covariance is None:
        # Nearly everyone always answers alike: deviations run off to infinity. Or terms do.
        several = [column for column in groups if trials[column].nunique() > 1][:2]
        robust = glm_logit(
            formula, trials, cluster=several, reference=reference, level=inference.level
        )
        why = "" if model.hidden else " (nearly everyone always answers alike)"
        note = (
            f"the mixed model has no finite maximum{why};"
            " a model with clustered standard errors stands in its place"
        )
        return replace(robust, warnings=(note, *robust.warnings))
    return fit


def glmm_probit(
    formula: str,
    trials: pd.DataFrame,
    *,
    groups: Sequence[str],
    slopes: Sequence[tuple[str, str]] = (),
    inference: Inference = USUAL,
) -> ModelFit:
    """Fit a probit model with crossed random effects: detection theory as a regression.

    With ``signal`` coded -.5 and .5, ``said ~ 1 + signal`` gives the criterion (minus the
    intercept) and d' (the slope) of the typical participant and scene; ``slopes`` let d' vary
    too (DeCarlo 1998; Rouder and Lu 2005). This d' is larger than the one of the whole table
    (`detection.yes_no`), whose rates mix people with different criteria.

    Notes
    -----
    As `glmm_logit`; a model without finite maximum is flagged and has no numbers.
    """
    model = FormulaDesign.of(formula, trials, None)
    fit = _mixed(model, trials, groups, slopes, PROBIT, inference)
    if fit.covariance is not None:
        return fit
    note = "the mixed model has no finite maximum: its numbers are left out"
    return replace(_without(fit, model.terms), random_sd={}, warnings=(note, *fit.warnings))


@dataclass(frozen=True)
class ModelsBeside:
    """One formula, three ways to judge it.

    `independent` is what papers print and takes trials as independent; `clustered` has the same
    estimates with robust standard errors; `mixed` has random intercepts, and effects that differ
    between people and between scenes, and so the effect on the typical participant, which is
    larger than that on the average answer.
    """

    independent: ModelFit
    clustered: ModelFit
    mixed: ModelFit


def models_beside(
    formula: str,
    trials: pd.DataFrame,
    *,
    reference: Mapping[str, str] | None = None,
    inference: Inference = USUAL,
) -> ModelsBeside:
    """Fit ``logit(correct) ~ 1 + level + method`` as a GLM, with clustered errors, and mixed.

    Groups are participants and scenes, where there are several; one of both must be. In the mixed
    model a column of names has deviations in each of its levels (participant x column), and a
    column of numbers random slopes about its mean, wherever it varies within a group. It is judged
    by t with degrees of freedom between those of participants and of scenes.

    Raises
    ------
    ValueError
        If there is one participant and one scene, or as `glm_logit`.
    """
    several = [c for c in GROUPS if c in trials.columns and trials[c].nunique() > 1]
    if not several:
        raise ValueError(f"one of the columns {list(GROUPS)} must have two values at least")
    table, groups, slopes = trials.copy(), list(several), []
    for column in re.findall(r"\w+", formula.partition("~")[2]):
        if column not in trials.columns:
            continue
        numbers = trials[column].dtype.kind in "iuf" and trials[column].nunique() > 2
        for group in several:
            name = f"{group} x {column}"
            if name in table or trials.groupby(group)[column].nunique().max() < 2:
                continue
            if numbers:
                table[column + CENTRED] = trials[column] - trials[column].mean()
                slopes.append((column + CENTRED, group))
            else:
                table[name] = trials[group].astype(str) + "\0" + trials[column].astype(str)
                groups.append(name)
    plain = partial(glm_logit, formula, trials, reference=reference, level=inference.level)
    return ModelsBeside(
        independent=plain(),
        clustered=plain(cluster=several),
        mixed=glmm_logit(
            formula, table, groups=groups, slopes=slopes, reference=reference, between=True,
            inference=inference,
        ),
    )  # fmt: skip


def _random_words(groups: Sequence[str], slopes: Sequence[str]) -> str:
    several = {group.partition(" x ")[0] for group in groups}
    crossed = "crossed random" if len(several) > 1 else "random"
    words = f"{crossed} intercepts ({', '.join(groups)})"
    return f"{words}, random slopes ({', '.join(slopes)})" if slopes else words


def _without(fit: ModelFit, hidden: Collection[str]) -> ModelFit:
    """Return the model without the numbers of terms that the trials do not identify: NaN."""
    nan = math.nan
    return replace(
        fit,
        coefficients=tuple(
            Coefficient(row.term, nan, nan, nan, row.df, nan, nan, nan)
            if row.term in hidden
            else row
            for row in fit.coefficients
        ),
    )


def _mixed(
    model: FormulaDesign,
    trials: pd.DataFrame,
    groups: Sequence[str],
    slopes: Sequence[tuple[str, str]],
    response: ResponseFunction,
    inference: Inference,
    between: bool = False,
) -> ModelFit:
    """Return the fit; it has no covariance where the likelihood has no finite maximum."""
    design, back, terms, found = model.scaled, model.back, model.terms, model.notes
    codes = [group_codes(trials, column) for column in groups]
    for column, code in zip(groups, codes, strict=True):
        if int(code.max()) + 1 < 5:
            found.append(f"only {int(code.max()) + 1} levels of {column}: its sd is a guess")
    times: list[Floats | None] = [None] * len(codes)
    names = list(groups)
    for column, group in slopes:
        codes.append(group_codes(trials, group))
        value = pd.to_numeric(trials[column], errors="coerce").to_numpy(dtype=np.float64)
        if not np.all(np.isfinite(value)):
            raise ValueError(f"column {column!r} of a random slope must hold numbers")
        times.append(value)
        names.append(f"{column} | {group}")
    solution = fit_crossed(design, model.y, codes, response=response, slopes=times)
    fixed = np.arange(len(terms))
    variance = back @ solution.covariance[np.ix_(fixed, fixed)] @ back.T
    errors = solution.beta_se
    if not np.array_equal(back, np.eye(len(terms))):
        errors = np.sqrt(np.diag(variance).clip(min=0.0))
    found += [
        f"no variance between levels of {column} was found (sd 0): the model is that without it"
        for column, deviation in zip(names, solution.sd, strict=True)
        if deviation < SINGULAR_SD
    ]
    df: list[float | None] = [None] * len(terms)
    if between and solution.converged:
        owners = [group.partition(" x ")[0] for group in groups] + [one for _, one in slopes]
        effects = [
            Effect(owner == "scene", group_codes(trials, owner), code, values, float(sd))
            for owner, code, values, sd in zip(owners, codes, times, solution.sd, strict=True)
        ]
        influence = zip(back @ np.linalg.pinv(design), errors, strict=True)
        df = [between_df(own, effects, float(error) ** 2) for own, error in influence]
    table = _table(terms, back @ solution.beta, errors, df, inference.level)
    many = len(terms) > 1 + MOST_IN_PAIRS
    if many:
        found.append(f"more than {MOST_IN_PAIRS} terms: Wald's statistics judge them")
    if solution.converged and not many:
        trial_groups = tuple(zip(codes, times, strict=True))
        table = tuple(
            _by_ratio(row, own, model, trial_groups, solution, inference)
            for row, own in zip(table, back, strict=True)
        )
    deviations: tuple[Deviation, ...] = ()
    if inference.profile and solution.converged:
        deviations = crossed_deviations(
            solution, names, slopes=names[len(groups) :], level=inference.level
        )
    random = _random_words(groups, names[len(groups) :])
    fit = ModelFit(
        formula=model.formula,
        method=f"{'probit ' * (response.link == 'probit')}GLMM, {random}, Laplace",
        coefficients=table,
        random_sd=dict(zip(names, map(float, solution.sd), strict=True)),
        trials=int(model.y.size),
        log_likelihood=solution.log_likelihood,
        level=inference.level,
        warnings=tuple(found),
        deviations=deviations,
        covariance=variance if solution.converged else None,
    )
    return _without(fit, model.hidden)


def _by_ratio(
    row: Coefficient,
    weights: Floats,
    model: FormulaDesign,
    groups: Sequence[tuple[Ints, Floats | None]],
    solution: CrossedFit,
    inference: Inference,
) -> Coefficient:
    """Return a coefficient judged by its likelihood ratio; the intercept is by no bootstrap.

    Parameters
    ----------
    weights : ndarray (coefficients,)
        Of the coefficients of `solution` in this one.
    groups
        Levels of each random effect, and what they are multiplied by.
    """
    held, response, size = HeldContrast(solution.maximum, weights), solution.response, weights.size
    _, point = held.ratio()

    def drawn(rng: np.random.Generator) -> float:
        eta = model.scaled @ point[:size]
        for (code, values), sd in zip(groups, np.abs(point[size:]), strict=True):
            effect = sd * rng.standard_normal(int(code.max()) + 1)[code]
            eta = eta + (effect if values is None else values * effect)
        answers = (rng.random(eta.size) < response.share(eta, (0.0, 0.0))).astype(np.float64)
        codes, times = zip(*groups, strict=True)
        study = fit_crossed(
            model.scaled, answers, codes, response=response, slopes=times, start=point
        )
        return HeldContrast(study.maximum, weights).ratio()[0] if study.converged else np.nan

    draws = None
    if inference.draws is not None and row.term != "Intercept":
        draws = inference.draws.ratios(drawn)
    df = np.inf if row.df is None else row.df
    found = ratio_test(
        held, solution.log_likelihood, row.estimate, row.standard_error, df, inference.level, draws
    )
    return replace(
        row, statistic=found.root, p=found.p, lower=found.lower, upper=found.upper, by_ratio=True
    )


def _firth(model: FormulaDesign, level: float) -> ModelFit:
    y, terms, back = model.y, model.terms, model.back
    rows, place = np.unique(model.scaled, axis=0, return_inverse=True)
    trials = np.bincount(place.ravel()).astype(np.float64)
    counted = rows, np.bincount(place.ravel(), weights=y).astype(np.float64), trials
    solution = fit_logit(*counted, firth=True)
    p_values = likelihood_ratio_p(*counted, firth=True)
    note = (
        "answers are separated (some condition was always or never chosen): Firth's penalty was"
        " used, p and limits by penalised likelihood ratio; it takes trials as independent, and"
        " trials of one participant are not"
    )
    errors = np.sqrt(np.diag(back @ solution.covariance @ back.T))
    table = _table(terms, back @ solution.beta, errors, [None] * len(terms), level)
    # An intercept that was shifted has the limits of its standard error.
    shifted = np.any(back != np.diag(np.diag(back)), axis=1)
    limits = [
        (row.lower, row.upper) if moved else tuple(ends * factor)
        for row, moved, ends, factor in zip(
            table, shifted, firth_limits(*counted, level), np.diag(back), strict=True
        )
    ]
    fit = ModelFit(
        formula=model.formula,
        method="Firth's penalised likelihood, trials independent",
        coefficients=tuple(
            replace(row, p=float(p), lower=float(low), upper=float(high))
            for row, p, (low, high) in zip(table, p_values, limits, strict=True)
        ),
        random_sd={},
        trials=int(y.size),
        log_likelihood=solution.log_likelihood,
        level=level,
        warnings=(*model.notes, note),
    )
    return _without(fit, model.hidden)


def _table(
    terms: Sequence[str],
    beta: Floats,
    errors: Floats,
    degrees: Sequence[float | None],
    level: float,
) -> tuple[Coefficient, ...]:
    rows = []
    for term, estimate, error, df in zip(terms, beta, errors, degrees, strict=True):
        free = np.inf if df is None else df
        reach = float(two_sided_quantile(level, free))
        ratio = float(estimate / max(error, 1e-12))
        rows.append(
            Coefficient(
                term=term,
                estimate=float(estimate),
                standard_error=float(error),
                statistic=ratio,
                df=df,
                p=float(two_sided_p(ratio, free)),
                lower=float(estimate - reach * error),
                upper=float(estimate + reach * error),
            )
        )
    return tuple(rows)
