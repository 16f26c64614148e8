"""Preferences in words: APA style, ready to paste."""

import math
from collections.abc import Sequence

from analysis.exclusions import FlowStep
from analysis.models import ModelFit
from analysis.preference import Preference
from analysis.report.wording import (
    NOT_IDENTIFIED,
    big,
    leading,
    left_out_sentence,
    number,
    p_text,
    share,
    share_range,
)
from analysis.tasks.preference.settings import Settings
from analysis.tasks.preference.study import SizeScale
from protocols.prose import count_of

TESTS = {
    "participant-scene": (
        "a score t test with standard errors clustered by participant and by scene (two-way"
        " clustering, Cameron, Gelbach & Miller, 2011), p no smaller than that of independent"
        " trials or of unanimous participants"
    ),
    "participant": (
        "a score t test over participants' choice proportions, p no smaller than that of"
        " independent trials or of unanimous participants"
    ),
    "pooled": "an exact binomial test that takes trials as independent",
}

TEST_NAMES = {
    "participant-scene": "two-way clustered score t",
    "participant": "participant score t",
    "pooled": "pooled exact binomial",
}


def comparison(method: str, against: str, size: str, settings: Settings) -> str:
    """Return a comparison's name: ``A / B, small disocclusion``."""
    pair = f"{settings.label(method)} / {settings.label(against)}"
    if not settings.sized:
        return pair
    return f"{pair}, {'all sizes' if size == 'all' else settings.label(size)}"


def verdict(cell: Preference, settings: Settings) -> str:
    """Say in plain words what a comparison shows."""
    method, against = settings.label(cell.method), settings.label(cell.against)
    return {
        "preferred": f"{method} is preferred",
        "rejected": f"{against} is preferred",
        "equivalent": "equivalent",
        "undecided": "undecided",
    }[cell.verdict]


def size_text(size: str, settings: Settings, whole: str = "all sizes together") -> str:
    """Return the size of a comparison in brackets; nothing where the study has no sizes."""
    if not settings.sized:
        return ""
    return f" ({whole if size == 'all' else settings.label(size)})"


def apa_preference(cell: Preference, settings: Settings, *, adjusted: bool) -> str:
    """Return one comparison as an APA sentence."""
    found, decided = cell.estimate, cell.test
    p = decided.p_adjusted if adjusted else decided.p
    correction = (
        f" ({settings.correction.title()}-adjusted)"
        if (adjusted and settings.correction != "none")
        else ""
    )
    level = f"{100 * found.level:g}% CI {share_range(found.lower, found.upper)}"
    if decided.t is not None and decided.df is not None and "t" in decided.name.split():
        test = f"t({decided.df:.1f}) = {decided.t:.2f}, {p_text(p)}{correction}"
    else:
        test = f"{decided.name}, {p_text(p)}{correction}"
    text = (
        f"{settings.label(cell.method)} was chosen over {settings.label(cell.against)}"
        f"{size_text(cell.size, settings)} in {cell.answers.chosen} of {cell.answers.trials}"
        f" trials, {share(found.share)}, {level}, {test}, Cohen's h = {found.cohens_h:.2f},"
        f" OR = {big(found.odds_ratio)} [{big(found.odds_lower)}, {big(found.odds_upper)}],"
        f" BF10 = {big(decided.bayes_factor)}."
    )
    if cell.verdict == "equivalent":
        equivalence = cell.equivalence.p_adjusted if adjusted else cell.equivalence.p
        text += (
            f" The share was equivalent to .5 within ±{share(cell.equivalence.margin)} (TOST,"
            f" {p_text(equivalence)}{correction})."
        )
    return text


def apa_model(method: str, against: str, fit: ModelFit, settings: Settings, size: str) -> str:
    """Return a mixed model's preference as an APA sentence."""
    row = fit["Intercept"]
    spread = ", ".join(f"SD({name}) = {value:.2f}" for name, value in fit.random_sd.items())
    where = size_text(size, settings, "all sizes")
    if math.isnan(row.estimate):
        return (
            f"{settings.label(method)} over {settings.label(against)}{where}: {NOT_IDENTIFIED}"
            f" ({fit.method})."
        )
    return (
        f"{settings.label(method)} over {settings.label(against)}{where}: b ="
        f" {row.estimate:.2f}, SE = {row.standard_error:.2f},"
        f" {row.statistic_name} = {row.statistic:.2f}, {p_text(row.p)}"
        + ("" if row.ratio_p is None else f", likelihood ratio {p_text(row.ratio_p)}")
        + (f"; {spread}" if spread else "")
        + f" ({fit.method})."
    )


def methods_paragraph(
    settings: Settings, *, people: int, decisions: int, flow: Sequence[FlowStep], version: str
) -> str:
    """Return the statistical methods as a paragraph ready to paste."""
    text = (
        f"We analysed {decisions} two-alternative forced choices of {people}"
        f" participant{'s' * (people != 1)}"
        f" comparing {len(settings.methods)} methods"
        f" ({', '.join(settings.label(name) for name in settings.methods)})"
    )
    if settings.sized:
        text += f" at {len(settings.sizes)} sizes of disocclusion"
    text += ". "
    if settings.protocol_sha256:
        text += left_out_sentence(flow)
    text += (
        f"For every pairing{' and size' if settings.sized else ''} the share of choices"
        f" was compared with .5 by {TESTS[settings.test]}, two-sided, alpha ="
        f" {leading(f'{settings.alpha:g}')}"
    )
    if settings.correction == "holm":
        text += f", Holm-adjusted over {len(settings.pairings) * len(settings.sizes)} comparisons"
    if settings.primary is not None:
        declared = " was declared beforehand and" if settings.protocol_sha256 else ""
        text += f". The primary comparison{declared} is not adjusted"
    text += (
        ". Intervals invert the test (Wilson score intervals). Participant-level sign-flip tests,"
        " pooled exact binomial tests, Bayes factors"
        " (Rouder et al., 2009, of the t with this p, Cauchy prior of scale .707) and"
        f" equivalence tests (two one-sided tests against ±{share(settings.margin)}"
        f"{', Holm-adjusted as well' if settings.correction == 'holm' else ''}) are given"
        " beside. Logit mixed models had crossed random intercepts of participants and scenes"
        " (Laplace approximation) and the order of presentation as a covariate; one model of all"
        " pairings had random tastes of the methods by participant and by scene, with Holm-adjusted"
        " likelihood ratios. Quality in just"
        " objectionable differences (JOD; 1 JOD = 75% of choices) was estimated by maximum"
        " likelihood under Thurstone's Case V, with two-way bootstrap intervals over participants"
        f" and scenes. Analyses were run with metamerlab {version}."
    )
    return text


def scale_text(one: SizeScale, settings: Settings) -> str:
    """Return what the checks of a scale say, in sentences."""
    fitted = one.scale
    parts = [
        f"All equal: χ²({fitted.equal_df}) = {number(fitted.equal_statistic, 1)},"
        f" {p_text(fitted.equal_p)}"
    ]
    if fitted.fit_df > 0:
        parts[0] += (
            f"; one axis suffices: χ²({fitted.fit_df}) = {number(fitted.deviance)},"
            f" {p_text(fitted.fit_p)}"
        )
    parts[0] += " (likelihood ratios, trials as independent)."
    found = one.transitivity
    if found.triples:
        parts.append(
            f"Stochastic transitivity is violated by {found.weak} (weak), {found.moderate}"
            f" (moderate), {found.strong} (strong) of {found.triples}"
            f" triple{'s' * (found.triples != 1)}."
        )
    if one.agreement is not None:
        parts.append(
            f"Agreement between participants: Kendall's u = {number(one.agreement.u)} (1: all"
            f" alike), χ²({number(one.agreement.df, 1)}) ="
            f" {number(one.agreement.statistic, 1)}, {p_text(one.agreement.p)}."
        )
    if one.triads:
        circular = sum(result.circular > 0 for _, result in one.triads)
        zeta = sum(result.zeta for _, result in one.triads) / len(one.triads)
        parts.append(
            f"{circular} of {count_of(len(one.triads), 'participant')} contradict themselves in"
            f" circles (mean Kendall's ζ = {number(zeta)}; 1: never)."
        )
    if one.observers.flagged:
        parts.append(
            "Participants who answer unlike the others (family-wise rate"
            f" {leading(f'{settings.alpha:g}')}): {', '.join(one.observers.flagged)}."
        )
    elif not one.observers.turned:
        parts.append(
            "No participant answers unlike the others (family-wise rate"
            f" {leading(f'{settings.alpha:g}')})."
        )
    if one.observers.turned:
        parts.append(
            "Participants who answer the other way round (a test of its own, family-wise rate"
            f" {leading(f'{settings.alpha:g}')}): {', '.join(one.observers.turned)}. Did they take"
            " one answer for the other?"
        )
    return " ".join(parts)
