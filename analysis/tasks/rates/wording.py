"""Results of tasks with right answers in words: APA style, ready to paste."""

import math
from collections.abc import Sequence

from analysis.critical_scaling import CriticalScaling
from analysis.detection import (
    Discrimination,
    DiscriminationResults,
    Measure,
    YesNo,
    YesNoResults,
)
from analysis.learning import Trend
from analysis.models import ModelFit
from analysis.rates import Difference, Rate
from analysis.report.wording import NOT_IDENTIFIED, leading, number, p_text, share, share_range
from analysis.thresholds import ThresholdModel


def column_in_words(column: str) -> str:
    """Return the name of a column as people read it: eccentricity_deg is "eccentricity (deg)"."""
    for unit in ("deg", "px", "m", "s"):
        if column.endswith(f"_{unit}"):
            column = f"{column.removesuffix(f'_{unit}')} ({unit})"
    return column.replace("_", " ")


def apa_rate(rate: Rate, *, name: str = "") -> str:
    """Return the share of right answers of one condition as a sentence."""
    who = name or rate.condition
    return (
        f"In condition {who}, {rate.count} of {rate.trials} answers were correct,"
        f" {share(rate.share)}, {_level(rate.level)} {share_range(rate.lower, rate.upper)},"
        f" {p_text(rate.p)} against chance ({share(rate.chance)};"
        f" {_people(rate.participants, rate.scenes)})."
    )


def apa_yes_no(one: YesNo, *, name: str = "") -> str:
    """Return d', criterion and bias of one condition as sentences."""
    who = name or one.condition
    bias = one.bias
    said = (
        f'"{one.bias_answer}" was answered in {share(bias.share)} of trials,'
        f" {_level(bias.level)} {share_range(bias.lower, bias.upper)}, {p_text(bias.p)}"
    )
    if one.d_prime is None or one.criterion is None:
        return f"In condition {who}, {said} (signal and noise were not both shown: no d')."
    return (
        f"In condition {who}, d' = {_measure(one.d_prime)}; c = {_measure(one.criterion)}; {said}."
    )


def apa_discrimination(one: Discrimination, rule: str, *, name: str = "") -> str:
    """Return d' of one condition of an identification or ABX task as a sentence."""
    right = one.correct
    return (
        f"In condition {name or one.condition}, d' = {number(one.d_prime)},"
        f" {_level(right.level)} {_range(one.lower, one.upper)} ({rule}), from"
        f" {share(right.share)} correct answers, {p_text(right.p)} against chance"
        f" ({share(right.chance)})."
    )


def apa_difference(one: Difference) -> str:
    """Return the difference of two conditions as a sentence."""
    ratio = one.difference / max(one.standard_error, 1e-12)
    text = (
        f"{one.first} minus {one.second}: {number(one.difference)} in {one.measure},"
        f" {_level(one.level)} {_range(one.lower, one.upper)},"
        f" t({one.df:.1f}) = {number(ratio)}, {p_text(one.p)}"
    )
    if abs(one.p_adjusted - one.p) > 1e-12:
        text += f" ({p_text(one.p_adjusted)} Holm-adjusted)"
    return text + "."


def sd_digits(value: float) -> str:
    """Return a deviation in the units of levels; one that no data could tell from 0 is 0."""
    return number(value) if math.isnan(value) else f"{value:.3g}" if value > 1e-6 else "0"


def apa_thresholds(model: ThresholdModel, *, unit: str = "", levels: Sequence[float] = ()) -> str:
    """Return the thresholds of all conditions as a sentence; `levels` are those shown."""
    after = f" {unit}" if unit else ""
    parts = [
        f"{one.condition} {_digits(one.value)}{after}, {_level(model.level)}"
        f" [{_digits(one.lower)}, {_digits(one.upper)}]"
        if one.lower is not None and one.upper is not None and one.identified(levels)
        else f"{one.condition} {NOT_IDENTIFIED}"
        for one in model.thresholds
    ]
    spread = f"participants SD = {sd_digits(model.participant_sd)}"
    if len(model.thresholds) > 1:
        spread += f", participants x conditions SD = {sd_digits(model.interaction_sd)}"
    if model.scene_sd:
        spread += f", scenes SD = {sd_digits(model.scene_sd)}"
    if model.scene_interaction_sd:
        spread += f", scenes x conditions SD = {sd_digits(model.scene_interaction_sd)}"
    scale = " of ln threshold" if model.logarithmic else ""
    return (
        f"Thresholds ({model.shape} functions of {model.participants} participants fitted"
        f" together; guess rate {share(model.guess)}, mean lapse rate"
        f" {leading(f'{model.lapse:.3f}')}):"
        f" {'; '.join(parts)} ({spread}{scale})."
    )


def apa_critical(fit: CriticalScaling) -> str:
    """Return a critical scaling as a sentence."""

    def quantity(
        name: str, value: float, ends: tuple[float, float] | None, identified: bool
    ) -> str:
        if not identified or ends is None:
            return f"{name} {NOT_IDENTIFIED}"
        interval = f"[{_digits(ends[0])}, {_digits(ends[1])}]"
        return f"{name} = {_digits(value)}, {_level(fit.level)} {interval}"

    who = "one participant" if fit.participants == 1 else f"{fit.participants} participants"
    laws = {
        "distance": "d'² = gain² (1 - s_c²/s²)",
        "published": "d' = gain (1 - s_c²/s²), as Freeman and Simoncelli fitted it",
    }
    text = (
        f"Critical scaling of condition {fit.condition} ({who}, ABX by the {fit.rule} rule,"
        f" {laws[fit.law]}):"
        f" {quantity('s_c', fit.critical, fit.critical_limits, fit.critical_identified)};"
        f" {quantity('gain', fit.gain, fit.gain_limits, fit.gain_identified)}"
    )
    if fit.participants > 1:
        spreads = (
            ("ln s_c", fit.critical_sd, fit.critical_identified),
            ("ln gain", fit.gain_sd, fit.gain_identified),
        )
        said = [f"of {name} = {number(sd)}" for name, sd, known in spreads if known]
        text += f"; SD {', '.join(said)}" if said else ""
    return f"{text}; lapse rate {leading(f'{fit.lapse:.3f}')}."


def apa_term(fit: ModelFit, term: str) -> str:
    """Return one coefficient of a model of right answers as a sentence."""
    row = fit[term]
    if math.isnan(row.estimate):
        return f"{term}: {NOT_IDENTIFIED} ({fit.method})."
    law = "z" if row.df is None else f"t({row.df:.0f})"
    return (
        f"{term}: b = {number(row.estimate, 3)}, SE = {number(row.standard_error, 3)},"
        f" {law} = {number(row.statistic)}, {p_text(row.p)} ({fit.method})."
    )


def apa_trend(found: Trend) -> str:
    """Return whether an outcome changed over the session as a sentence."""
    if math.isnan(found.p):
        return f"Whether {found.outcome} changed over the session is {NOT_IDENTIFIED}."
    return (
        f"From the first to the last trial {found.outcome} changed by {number(found.change)},"
        f" [{number(found.lower)}, {number(found.upper)}], over {found.participants} participants,"
        f" t({found.df:.0f}), {p_text(found.p)}; all trials pooled: Spearman's rho ="
        f" {number(found.spearman_rho)}, {p_text(found.spearman_p)}."
    )


def methods_yes_no(results: YesNoResults) -> str:
    """Return how a yes-no task was analysed, ready to paste."""
    clusters = (
        "participant and scene (two-way, Cameron, Gelbach & Miller, 2011, of"
        if any(one.correct.scenes > 1 for one in results.conditions)
        else "participant (of"
    )
    return (
        "Sensitivity d' = z(H) - z(F) and criterion c = -(z(H) + z(F))/2 were taken from each"
        f" condition's table{_correction(results.correction)}. Limits and tests, also between"
        f" conditions, are t with standard errors clustered by {clusters}"
        " each trial's influence on z); shares have Wilson"
        " limits with the effective number of trials, and p from the same score test. Tests"
        " between conditions are Holm-adjusted."
    )


def methods_discrimination(results: DiscriminationResults) -> str:
    """Return how d' of an identification or ABX task was made, ready to paste."""
    several = any(one.correct.scenes > 1 for one in results.conditions)
    clusters = "participant and scene" if several else "participant"
    return (
        f"d' ({results.rule}) was taken from each condition's share of correct answers"
        f"{_correction(results.correction)}; its limits are those of the share (Wilson, effective"
        f" number of trials clustered by {clusters}), mapped to d'. Conditions were"
        " compared as shares correct, Holm-adjusted."
    )


def _correction(correction: str) -> str:
    return (
        ", with one trial at chance added to every rate of every condition (log-linear correction,"
        " Hautus, 1995)"
        if correction == "log-linear"
        else ", without correction"
    )


def _measure(one: Measure) -> str:
    df = "" if math.isinf(one.df) else f"({one.df:.1f})"
    ratio = one.value / max(one.standard_error, 1e-12)
    return (
        f"{number(one.value)}, {_level(one.level)} {_range(one.lower, one.upper)},"
        f" {'t' if df else 'z'}{df} = {number(ratio)}, {p_text(one.p)}"
    )


def _level(level: float) -> str:
    return f"{100 * level:g}% CI"


def _range(lower: float, upper: float) -> str:
    return f"[{_end(lower)}, {_end(upper)}]"


def _end(value: float) -> str:
    return ("∞" if value > 0 else "-∞") if math.isinf(value) else number(value)


def _digits(value: float) -> str:
    """Return a level in three significant digits."""
    return f"{value:.3g}"


def _people(participants: int, scenes: int) -> str:
    text = f"{participants} participant{'s' * (participants != 1)}"
    return text if scenes < 2 else f"{text}, {scenes} scenes"
