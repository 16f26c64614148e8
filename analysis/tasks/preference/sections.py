"""The sections of a report of preferences."""

import numpy as np
from markupsafe import Markup

from analysis.models import ModelFit
from analysis.plans.preference import Settings
from analysis.preference import Preference
from analysis.report.blocks import (
    Block,
    Box,
    Cautions,
    Heading,
    Paragraph,
    Picture,
    Section,
    Table,
    strong,
)
from analysis.report.wording import (
    big,
    grouped,
    number,
    number_range,
    p_number,
    p_text,
    share,
    share_range,
)
from analysis.tasks.preference.study import SizeScale, StudyResults
from analysis.tasks.preference.wording import (
    TEST_NAMES,
    apa_preference,
    comparison,
    scale_text,
    verdict,
)

_BF10 = Markup("BF<sub>10</sub>")
LARGEST_LOG = 700.0
"""Of odds that a number can hold."""


def lead(results: StudyResults, settings: Settings) -> list[Block]:
    """Return the primary comparison, where one was declared."""
    primary = results.primary
    if primary is None:
        return []
    text = Markup(
        "Result: {}. Equivalence within ±{}: {}.\n"
        "Sign-flip test of participants: {} (no smaller than {:.2g} with {} participants)."
    ).format(
        strong(verdict(primary, settings)),
        share(primary.equivalence.margin),
        p_text(primary.equivalence.p),
        p_text(primary.sensitivity.sign_flip_p),
        primary.sensitivity.sign_flip_floor,
        primary.answers.participants,
    )
    return [
        Box("Primary comparison", apa_preference(primary, settings, adjusted=False), text),
        Cautions("When not to trust the primary comparison", primary.warnings),
    ]


def sections(results: StudyResults, settings: Settings) -> tuple[Section, ...]:
    """Return every section of preferences, in reading order."""
    return (
        Section("preference", "Preference", "Preference", _preference(results, settings)),
        Section("models", "Models", "Models", _models(results, settings)),
        Section("scale", "Scale", "Scale", _scales(results, settings)),
        Section(
            "people",
            "Participants and scenes",
            "Participants and scenes",
            (Picture("participants"), Picture("scenes")),
        ),
        Section("checks", "Order, learning, speed", "Order, learning, speed", _checks(results)),
    )


def _name(cell: Preference, settings: Settings) -> str:
    return comparison(cell.method, cell.against, cell.size, settings)


def _preference(results: StudyResults, settings: Settings) -> tuple[Block, ...]:
    table = results.table
    cells = table.cells
    level = f"{100 * cells[0].estimate.level:g} % limits"
    adjusted = f", Holm-adjusted over {len(cells)}" if table.correction == "holm" else ""
    margin = share(settings.margin)
    shares = Table.each(
        f"Every comparison, p by {TEST_NAMES[settings.test]}{adjusted}",
        cells,
        ("Comparison", "l c", lambda c: _name(c, settings)),
        ("Chosen", "n", lambda c: f"{c.answers.chosen} / {c.answers.trials}"),
        ("Share", "strong", lambda c: share(c.estimate.share)),
        (level, "n", lambda c: share_range(c.estimate.lower, c.estimate.upper)),
        (
            "t(df)",
            "n",
            lambda c: (
                "none"
                if c.test.t is None or c.test.df is None
                else f"{number(c.test.t)} ({number(c.test.df, 1)})"
            ),
        ),
        ("p", "n", lambda c: p_number(c.test.p)),
        ("p adj.", "n", lambda c: p_number(c.test.p_adjusted)),
        ("h", "", lambda c: number(c.estimate.cohens_h)),
        ("OR", "n", lambda c: big(c.estimate.odds_ratio)),
        (_BF10, "n", lambda c: big(c.test.bayes_factor)),
        ("Result", "l", lambda c: verdict(c, settings)),
    )
    beside = Table.each(
        "Beside it: sign-flip test with its floor, equivalence, and the papers' pooled exact test",
        cells,
        ("Comparison", "l c", lambda c: _name(c, settings)),
        ("eff. n", "", lambda c: f"{c.estimate.effective_n:.0f}"),
        ("Sign-flip p", "n", lambda c: p_number(c.sensitivity.sign_flip_p)),
        ("Floor", "", lambda c: f"{c.sensitivity.sign_flip_floor:.2g}"),
        (f"TOST p adj. (±{margin})", "n", lambda c: p_number(c.equivalence.p_adjusted)),
        ("SD of participants", "", lambda c: share(c.answers.participant_sd)),
        ("Pooled exact p", "n", lambda c: p_number(c.sensitivity.exact_p)),
        (
            "Clopper-Pearson",
            "n",
            lambda c: share_range(c.sensitivity.exact_lower, c.sensitivity.exact_upper),
        ),
        (Markup("Pooled {}").format(_BF10), "n", lambda c: big(c.sensitivity.bayes_factor_pooled)),
    )
    return (
        Picture("preference"),
        shares,
        Paragraph(
            Markup(
                "p adj. decides: p corrected for the number of comparisons. Limits leave out .5"
                " exactly where p is small. t(df): clustered score test of the share against .5; p"
                " is never smaller than that of independent trials, or of unanimous participants."
                " h (Cohen): size of that distance, .2 small,"
                " .5 medium, .8 large. OR: odds of choosing the first method, 1 at .5. {}: how many"
                " times likelier the data are with a preference than without one; below 1/3 they"
                " speak for none."
            ).format(_BF10),
            muted=True,
        ),
        beside,
        Paragraph(
            "eff. n: so many independent trials would tell as much. Sign-flip: a test of the"
            " participants' own shares that assumes no normal law; with so few people p cannot fall"
            f" below the floor. TOST: a small p shows that the share lies within ±{margin} of .5,"
            f" too near to matter. Clopper-Pearson: pooled exact {level}. The pooled tests take"
            " trials as independent. They are not: at a participant SD of 0.5 logits they call"
            " chance an effect more than twice as often as they say.",
            muted=True,
        ),
        Cautions(
            "When not to trust these comparisons",
            grouped([(_name(c, settings), c.warnings) for c in cells]),
        ),
        Picture("forest"),
    )


def _models(results: StudyResults, settings: Settings) -> tuple[Block, ...]:
    rows = []
    for method, against, size, fit in results.models:
        for place, c in enumerate(fit.coefficients):
            first = place == 0
            rows.append(
                (
                    comparison(method, against, size, settings) if first else "",
                    "preference" if c.term == "Intercept" else "shown first",
                    number(c.estimate),
                    number(c.standard_error),
                    f"{c.statistic_name} = {number(c.statistic)}",
                    p_number(c.p),
                    "none" if c.ratio_p is None else p_number(c.ratio_p),
                    " ".join((_odds(c.estimate), f"[{_odds(c.lower)}, {_odds(c.upper)}]")),
                    _spread(fit) if first else "",
                )
            )
    return (
        Table.of(
            "Logit mixed models: crossed random intercepts, order of presentation as covariate",
            (
                ("Comparison", "l c"),
                ("Term", "l"),
                ("b", ""),
                ("SE", ""),
                ("Statistic", "n"),
                ("p", "n"),
                ("LR p", "n"),
                (f"OR, {100 * (1 - settings.alpha):g} % limits", "n"),
                ("Random SD", "l"),
            ),
            rows,
        ),
        Paragraph(
            "b: logarithm of the odds (OR) of choosing the first method, for a participant and a"
            ' scene in the middle; "shown first": how far b rises where that method was shown first'
            " instead of second. LR p: of the likelihood ratio without the term; where it and p of"
            " z differ, LR p errs less often. Where a mixed model cannot be had, the row says what"
            " stands in its place: clustered errors with t, or Firth's penalty, whose p and limits"
            " are of its profile likelihood and take trials as independent. Random SD: how far"
            " participants, and scenes, differ on the scale of b.",
            muted=True,
        ),
        *_all_pairings(results, settings),
        Cautions(
            "When not to trust these models",
            tuple(
                grouped(
                    [
                        (comparison(method, against, size, settings), fit.warnings)
                        for method, against, size, fit in results.models
                    ]
                    + [(_at(size, settings), model.warnings) for size, model in results.paired]
                )
            ),
        ),
    )


def _all_pairings(results: StudyResults, settings: Settings) -> tuple[Block, ...]:
    if not results.paired:
        return ()
    rows = []
    for size, model in results.paired:
        spread = ", ".join(f"{name} {number(sd)}" for name, sd in model.random_sd.items())
        for place, c in enumerate(model.contrasts):
            rows.append(
                (
                    comparison(c.first, c.second, size, settings),
                    number(c.estimate),
                    number(c.standard_error),
                    f"{number(c.ratio)} ({model.df})",
                    p_number(c.p),
                    p_number(c.p_adjusted),
                    spread if place == 0 else "",
                )
            )
    return (
        Table.of(
            "One mixed model of all pairings: each participant and scene has own tastes of the"
            " methods",
            (
                ("Comparison", "l c"),
                ("b", ""),
                ("SE", ""),
                ("LR (df)", "n"),
                ("p", "n"),
                ("p adj.", "n"),
                ("Random SD", "l"),
            ),
            rows,
        ),
        Paragraph(
            "b as above, now with all answers together: what one pairing tells of two methods"
            " counts for the others too. LR: likelihood ratio against two methods being equal; its"
            " root is judged by t with df of participants. p adj.: Holm over the comparisons of a"
            " size. Random SD: of one method's b between participants, and between scenes.",
            muted=True,
        ),
    )


def _odds(logarithm: float) -> str:
    return big(float(np.exp(np.clip(logarithm, -LARGEST_LOG, LARGEST_LOG))))


def _at(size: str, settings: Settings) -> str:
    if not settings.sized:
        return ""
    return "all sizes" if size == "all" else settings.label(size)


def _spread(fit: ModelFit) -> str:
    if fit.random_sd:
        return ", ".join(f"{name} {number(sd)}" for name, sd in fit.random_sd.items())
    return "none: " + ("Firth" if "Firth" in fit.method else "clustered")


def _scales(results: StudyResults, settings: Settings) -> tuple[Block, ...]:
    blocks: list[Block] = [Picture("scale")]
    for one in results.scales:
        blocks += [
            *(
                [Heading("All sizes" if one.size == "all" else settings.label(one.size))]
                if settings.sized
                else []
            ),
            _scores(one, settings),
            _differences(one, settings),
            Paragraph(scale_text(one, settings), muted=True),
        ]
    notes = [
        (
            _at(one.size, settings),
            one.scale.warnings
            + (one.intervals.warnings if one.intervals else ())
            + one.observers.warnings
            + one.warnings,
        )
        for one in results.scales
    ]
    return (*blocks, Cautions("When not to trust these scales", grouped(notes)))


def _scores(one: SizeScale, settings: Settings) -> Table:
    rows = []
    for i, name in enumerate(one.scale.conditions):
        limits, error = "none", "none"
        if one.intervals is not None:
            lower, upper = one.intervals.lower[i], one.intervals.upper[i]
            limits = number_range(lower, upper)
            error = number(one.intervals.standard_error[i])
        rows.append((settings.label(name), number(one.scale.scores[i]), limits, error))
    return Table.of(
        "Thurstone Case V, mean zero",
        (
            ("Method", "l"),
            ("JOD", "strong"),
            (f"{100 * (1 - settings.alpha):g} % limits", "n"),
            ("bootstrap SE", ""),
        ),
        rows,
    )


def _differences(one: SizeScale, settings: Settings) -> Table:
    columns = [("Methods", "l"), ("JOD", "strong")]
    if one.intervals is not None:
        columns.append((f"{100 * (1 - settings.alpha):g} % limits", "n"))
    columns += [("p", "n"), ("p adj.", "n")]
    rows = []
    for c in one.contrasts:
        row = [f"{settings.label(c.first)} - {settings.label(c.second)}", number(c.difference)]
        if one.intervals is not None:
            i, j = (one.scale.conditions.index(name) for name in (c.first, c.second))
            lower = one.intervals.difference_lower[i, j]
            upper = one.intervals.difference_upper[i, j]
            row.append(number_range(lower, upper))
        both = (c.clustered_p, c.clustered_p_adjusted)
        rows.append([*row, *("none" if p is None else p_number(p) for p in both)])
    return Table.of(
        "Differences; limits and p by bootstrap of participants and scenes, p adj. by Holm",
        columns,
        rows,
    )


def _checks(results: StudyResults) -> tuple[Block, ...]:
    biases = [bias for bias in (results.order, results.side) if bias is not None]
    blocks: list[Block] = [
        Picture("bias"),
        Table.each(
            "Order and side bias, against .5",
            biases,
            ("Alternative", "l", lambda b: b.alternative),
            ("Trials", "", lambda b: str(b.trials)),
            ("Share", "", lambda b: share(b.share)),
            ("Limits", "n", lambda b: share_range(b.lower, b.upper)),
            ("p", "n", lambda b: p_number(b.p)),
            ("Sign-flip p", "n", lambda b: p_number(b.sign_flip_p)),
        ),
        Cautions("About these shares", grouped([(b.alternative, b.warnings) for b in biases])),
    ]
    return tuple(blocks)
