"""The sections of a report of right and wrong answers."""

from collections.abc import Mapping, Sequence

from analysis.critical_scaling import CriticalScaling
from analysis.detection import DiscriminationResults, Measure, YesNoResults
from analysis.models import ModelFit
from analysis.psychometric import Psychometric
from analysis.rates import Difference, Rate
from analysis.report.wording import (
    NOT_IDENTIFIED,
    big,
    grouped,
    number,
    number_range,
    p_number,
    p_text,
    share,
    share_range,
)
from analysis.tasks.blocks import (
    Block,
    Box,
    Cautions,
    Heading,
    Paragraph,
    Picture,
    Section,
    Table,
)
from analysis.tasks.common_blocks import (
    diffusion_blocks,
    learning_blocks,
    reaction_blocks,
    time_model_blocks,
)
from analysis.tasks.rates.settings import RateSettings
from analysis.tasks.rates.study import RateResults
from analysis.tasks.rates.wording import column_in_words, sd_digits
from analysis.thresholds import ThresholdModel
from protocols.adaptive.psychometric import Shape

INFINITE = "\N{INFINITY}"
SHAPES: Mapping[Shape, str] = {
    "gauss": "cumulative normal",
    "logistic": "logistic",
    "gumbel": "Gumbel (Weibull on logarithms)",
    "weibull": "Weibull",
}


def lead(results: RateResults, settings: RateSettings) -> list[Block]:
    """Return the planned comparisons in short; of a single condition, its sensitivity."""
    lines = [f"{said(one, settings)}." for one in results.comparisons]
    if not lines:
        lines = [
            f"{settings.label(one.condition)}: {share(one.share)} of answers were right,"
            f" {share_range(one.lower, one.upper)}, {p_text(one.p)} against chance"
            f" ({share(one.chance)})."
            for one in results.rates
        ]
    shown = " ".join(lines[:6])
    more = f" {len(lines) - 6} more are below." if len(lines) > 6 else ""
    title = "Planned comparisons" if results.comparisons else "Right answers"
    placed = [one for one in results.critical if one.critical_identified]
    scalings = [
        Box(
            f"Critical {settings.level}",
            " ".join(
                f"{settings.label(one.condition)}: {one.critical:.3g} {_pair(one.critical_limits)}."
                for one in placed
            ),
            f"Up to it the typical participant has d' = 0; {100 * settings.confidence:g}% CI.",
        )
    ]
    return [*(scalings if placed else []), Box(title, shown + more, _decides(results, settings))]


def said(one: Difference, settings: RateSettings) -> str:
    """Return a comparison with the baseline in short."""
    p = decisive_p(one, settings)
    between = f"{settings.label(one.first)} against {settings.label(one.second)}"
    level = f"{100 * one.level:g}% CI [{number(one.lower)}, {number(one.upper)}]"
    word = "they differ" if p < settings.alpha else "no difference is shown"
    return f"{between}: {number(one.difference)} in {one.measure}, {level}, {p_text(p)}: {word}"


def decisive_p(one: Difference, settings: RateSettings) -> float:
    """Return the p that decides: adjusted where the study corrects."""
    return one.p_adjusted if settings.correction == "holm" else one.p


def _decides(results: RateResults, settings: RateSettings) -> str:
    if not results.comparisons:
        return ""
    count = len(results.comparisons)
    adjusted = (
        f", Holm-adjusted over {count} comparisons"
        if settings.correction == "holm" and count > 1
        else ""
    )
    return f"Each against {settings.label(results.comparisons[0].second)}, two-sided{adjusted}."


def sections(results: RateResults, settings: RateSettings) -> tuple[Section, ...]:
    """Return every section that these results allow, in reading order."""
    by = f"By {column_in_words(str(settings.level))}"
    found = (
        [] if not results.counts else [Section("levels", by, "Levels", _levels(results, settings))]
    )
    answers = [
        Section("correct", "Right answers", "Right answers", _correct(results, settings)),
        Section("sensitivity", "Sensitivity", "Sensitivity", _sensitivity(results, settings)),
    ]
    # Where levels were chosen from the answers, thresholds are the result.
    found = [*found, *answers] if settings.adaptive else [*answers, *found]
    if results.models is not None:
        found.append(Section("models", "Models", "Models", _models(results)))
    found.append(
        Section(
            "people",
            "Participants and scenes" if results.scene_shares else "Participants",
            "Participants and scenes" if results.scene_shares else "Participants",
            (Picture("participants"), Picture("scenes")),
        )
    )
    found.append(
        Section("checks", "Learning, speed", "Learning, speed", _checks(results, settings))
    )
    return tuple(found)


def _correct(results: RateResults, settings: RateSettings) -> tuple[Block, ...]:
    rates = results.rates
    return (
        Picture("correct"),
        _rate_table(f"Right answers by {settings.by or 'condition'}", rates, settings),
        Paragraph(
            "p: against chance, with errors clustered by participant"
            + (" and scene" if results.by_scene else "")
            + "; limits belong to the same test. Pooled exact p takes trials as independent, which"
            " they are not.",
            muted=True,
        ),
        Cautions(
            "When not to trust these shares",
            grouped([(settings.label(one.condition), one.warnings) for one in rates]),
        ),
        Picture("confusion"),
    )


def _rate_table(caption: str, rates: Sequence[Rate], settings: RateSettings) -> Table:
    return Table.each(
        caption,
        rates,
        ("Condition", "l c", lambda one: settings.label(one.condition)),
        ("Right", "n", lambda one: f"{one.count} / {one.trials}"),
        ("Share", "strong", lambda one: share(one.share)),
        (_limits(settings), "n", lambda one: share_range(one.lower, one.upper)),
        ("Chance", "", lambda one: share(one.chance)),
        ("p", "n", lambda one: p_number(one.p)),
        ("Pooled exact p", "n", lambda one: p_number(one.exact_p)),
    )


def _sensitivity(results: RateResults, settings: RateSettings) -> tuple[Block, ...]:
    found = results.sensitivity
    blocks: list[Block] = [Picture("sensitivity")]
    if isinstance(found, YesNoResults):
        blocks += _yes_no(found, results, settings)
        blocks += _differences("Differences of d'", found.d_prime_contrasts, settings)
        blocks += _differences("Differences of the criterion", found.criterion_contrasts, settings)
        blocks += _differences("Differences of bias", found.bias_contrasts, settings)
    else:
        blocks += _discrimination(found, settings)
        blocks += _differences("Differences of shares of right answers", found.contrasts, settings)
        if results.answered is not None:
            blocks.append(
                _rate_table(
                    f'How often "{settings.label(settings.answers[0])}" was answered, against one'
                    " half",
                    (results.answered,),
                    settings,
                )
            )
    notes = [(settings.label(one.condition), one.warnings) for one in found.conditions]
    notes += [
        (f"{settings.label(name)}, mixed model", fit.warnings) for name, fit in results.typical
    ]
    blocks.append(Cautions("When not to trust these sensitivities", grouped(notes)))
    return tuple(blocks)


def _yes_no(found: YesNoResults, results: RateResults, settings: RateSettings) -> list[Block]:
    rows = [
        (
            settings.label(one.condition),
            f"{one.hits} / {one.hits + one.misses}",
            f"{one.false_alarms} / {one.false_alarms + one.correct_rejections}",
            *_measure(one.d_prime),
            *_measure(one.criterion),
            share(one.bias.share),
            p_number(one.bias.p),
        )
        for one in found.conditions
    ]
    answer = settings.label(found.conditions[0].bias_answer)
    blocks: list[Block] = [
        Table.of(
            f'Hits and false alarms ("{answer}" where it was right, and where it was not)',
            (
                ("Condition", "l c"),
                ("Hits", "n"),
                ("False alarms", "n"),
                ("d'", "strong"),
                ("Limits", "n"),
                ("p", "n"),
                ("c", "strong"),
                ("Limits", "n"),
                ("p", "n"),
                (f'Share "{answer}"', ""),
                ("p", "n"),
            ),
            rows,
        ),
        Paragraph(
            "d': how far signal and noise lie apart, in standard deviations of the noise; p against"
            f' 0. c: where the criterion lies; negative: inclined to "{answer}". Of the whole'
            " table: participants who set different criteria make this d' smaller than their own.",
            muted=True,
        ),
    ]
    if results.typical:
        blocks += [
            Table.of(
                "d' and criterion of the typical participant: probit mixed models",
                (
                    ("Condition", "l c"),
                    ("d'", "strong"),
                    ("SE", ""),
                    ("c", "strong"),
                    ("SE", ""),
                    ("Random SD", "l"),
                ),
                [
                    (
                        settings.label(name),
                        number(fit["signal"].estimate),
                        number(fit["signal"].standard_error),
                        number(-fit["Intercept"].estimate),
                        number(fit["Intercept"].standard_error),
                        _spread(fit),
                    )
                    for name, fit in results.typical
                ],
            )
        ]
    return blocks


def _measure(one: Measure | None) -> tuple[str, str, str]:
    if one is None:
        return "none", "none", "none"
    return number(one.value), f"[{_end(one.lower)}, {_end(one.upper)}]", p_number(one.p)


def _discrimination(found: DiscriminationResults, settings: RateSettings) -> list[Block]:
    return [
        Table.each(
            f"d' from shares of right answers ({found.rule})",
            found.conditions,
            ("Condition", "l c", lambda one: settings.label(one.condition)),
            ("Share", "", lambda one: share(one.correct.share)),
            ("d'", "strong", lambda one: number(one.d_prime)),
            (_limits(settings), "n", lambda one: f"[{_end(one.lower)}, {_end(one.upper)}]"),
            ("p", "n", lambda one: p_number(one.correct.p)),
        ),
        Paragraph(
            "d': how far the stimuli lie apart, in standard deviations of the noise, for an"
            " observer who decides as the rule in brackets says. Limits and p are the share's.",
            muted=True,
        ),
    ]


def _differences(caption: str, found: Sequence[Difference], settings: RateSettings) -> list[Block]:
    if not found:
        return []
    return [
        Table.each(
            caption,
            found,
            (
                "Conditions",
                "l c",
                lambda one: f"{settings.label(one.first)} - {settings.label(one.second)}",
            ),
            ("Difference", "strong", lambda one: number(one.difference)),
            (_limits(settings), "n", lambda one: number_range(one.lower, one.upper)),
            ("SE", "", lambda one: number(one.standard_error)),
            ("df", "", lambda one: number(one.df, 1)),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        )
    ]


def _levels(results: RateResults, settings: RateSettings) -> tuple[Block, ...]:
    blocks: list[Block] = [Picture("levels"), *_curves(results, settings)]
    if results.thresholds is not None:
        shown = [level for one in results.counts.values() for level in one.levels]
        blocks += _thresholds(results.thresholds, shown, settings)
    if results.critical:
        blocks += [Heading("Critical scaling"), Picture("scaling")]
        blocks += _critical(results.critical, settings)
        blocks += _differences(
            "Differences of the logarithm of critical scalings, paired over participants",
            results.critical_contrasts,
            settings,
        )
        if results.critical_contrasts:
            blocks.append(
                Paragraph(
                    "Differences are means of each participant's own fit. With few trials of each"
                    " these fits are noisy, and their mean can differ from the typical"
                    " participant's critical scalings above, even in sign.",
                    muted=True,
                )
            )
    notes = [(settings.label(name), fit.warnings) for name, fit in results.curves.items()]
    if results.thresholds is not None:
        notes.append(("thresholds over participants", results.thresholds.warnings))
    notes += [(settings.label(one.condition), one.warnings) for one in results.critical]
    return (*blocks, Cautions("When not to trust these levels", grouped(notes)))


def _curves(results: RateResults, settings: RateSettings) -> list[Block]:
    if not results.curves:
        return []
    return [
        Table.of(
            "Psychometric functions, all participants together",
            (
                ("Condition", "l c"),
                ("Threshold", "strong"),
                ("Limits", "n"),
                ("Width", ""),
                ("Lapse rate", ""),
                ("Misfit p", "n"),
            ),
            [
                (
                    settings.label(name),
                    *_placed(fit, results.counts[name].levels),
                    share(fit.lapse),
                    p_number(fit.p) if fit.df > 0 else "none",
                )
                for name, fit in results.curves.items()
            ],
        ),
        Paragraph(
            "Threshold: where half of the way from guessing to lapsing is done. Width: from 5 to"
            f" 95 % of that way. Shape: {SHAPES[settings.shape]}. These limits speak of answers,"
            " not of people; the next table's do.",
            muted=True,
        ),
    ]


def _placed(fit: Psychometric, levels: Sequence[float]) -> tuple[str, str, str]:
    """Return threshold, limits and width as text; none where the answers do not place them."""
    if not fit.identified(levels):
        return NOT_IDENTIFIED, "none", "none"
    return f"{fit.threshold:.3g}", _pair(fit.threshold_limits), f"{fit.width:.3g}"


def _thresholds(
    model: ThresholdModel, levels: Sequence[float], settings: RateSettings
) -> list[Block]:
    placed = {one.condition for one in model.thresholds if one.identified(levels)}
    own = sorted({who for one in model.thresholds for who in one.individual})
    blocks: list[Block] = [
        Table.each(
            "Thresholds in the population: one model, random over participants"
            + (" and scenes" if model.scene_sd else ""),
            model.thresholds,
            ("Condition", "l c", lambda one: settings.label(one.condition)),
            (
                "Threshold",
                "strong",
                lambda one: f"{one.value:.3g}" if one.condition in placed else NOT_IDENTIFIED,
            ),
            (
                f"{100 * model.level:g} % limits",
                "n",
                lambda one: _pair(
                    (one.lower, one.upper)
                    if one.condition in placed and one.lower is not None and one.upper is not None
                    else None
                ),
            ),
            (
                "Width, as a ratio" if model.logarithmic else "Width",
                "",
                lambda one: f"{one.width:.3g}" if one.condition in placed else "none",
            ),
        ),
        Paragraph(
            f"Mean lapse rate of participants {share(model.lapse)}; thresholds differ between"
            f" participants by SD {sd_digits(model.participant_sd)}"
            + (
                f", of one participant between conditions by SD {sd_digits(model.interaction_sd)}"
                if len(model.thresholds) > 1
                else ""
            )
            + (f", between scenes by SD {sd_digits(model.scene_sd)}" if model.scene_sd else "")
            + (
                f", of one scene between conditions by SD {sd_digits(model.scene_interaction_sd)}"
                if model.scene_interaction_sd
                else ""
            )
            + (" of the threshold's natural logarithm" if model.logarithmic else "")
            + ".",
            muted=True,
        ),
    ]
    differing = "natural logarithms of thresholds" if model.logarithmic else "thresholds"
    blocks += _differences(f"Differences of {differing}", model.contrasts, settings)
    if not own:
        return blocks
    blocks.append(
        Table.of(
            "Participants' thresholds",
            (
                ("Participant", "l"),
                *((settings.label(one.condition), "") for one in model.thresholds),
            ),
            [
                (
                    who,
                    *(
                        f"{one.individual[who]:.3g}"
                        if who in one.individual and one.condition in placed
                        else "none"
                        for one in model.thresholds
                    ),
                )
                for who in own
            ],
        )
    )
    note = "Each is drawn towards the mean as far as the participant's answers leave open."
    blocks.append(Paragraph(note, muted=True))
    return blocks


def _critical(fits: Sequence[CriticalScaling], settings: RateSettings) -> list[Block]:
    return [
        Table.each(
            "The largest scaling that cannot be told apart",
            fits,
            ("Condition", "l c", lambda one: settings.label(one.condition)),
            (
                "Critical scaling",
                "strong",
                lambda one: f"{one.critical:.3g}" if one.critical_identified else NOT_IDENTIFIED,
            ),
            (
                "Limits",
                "n",
                lambda one: _pair(one.critical_limits if one.critical_identified else None),
            ),
            ("Gain", "", lambda one: f"{one.gain:.3g}" if one.gain_identified else NOT_IDENTIFIED),
            ("Limits", "n", lambda one: _pair(one.gain_limits if one.gain_identified else None)),
            (
                "SD of ln s",
                "",
                lambda one: number(one.critical_sd) if one.critical_identified else "none",
            ),
            ("Lapse rate", "", lambda one: share(one.lapse)),
        ),
        Paragraph(
            "Of the typical participant. d' is 0 up to the critical scaling s and rises towards the"
            f" gain above it ({fits[0].law} law).",
            muted=True,
        ),
        Table.of(
            "Participants' critical scalings",
            (("Participant", "l"), *((settings.label(one.condition), "n") for one in fits)),
            [
                (who, *(_own_critical(one, who) for one in fits))
                for who in sorted({who for one in fits for who in one.individual})
            ],
        ),
        Paragraph(
            "Each is drawn towards the typical one as far as the participant's answers leave open;"
            " in brackets: fitted to these answers alone.",
            muted=True,
        ),
    ]


def _own_critical(one: CriticalScaling, who: str) -> str:
    if who not in one.individual or not one.critical_identified:
        return "none"
    alone = f" ({one.alone[who]:.3g})" if who in one.alone else ""
    return f"{one.individual[who][0]:.3g}{alone}"


def _models(results: RateResults) -> tuple[Block, ...]:
    beside = results.models
    assert beside is not None
    groups = results.groups
    fits = (
        ("trials independent", beside.independent),
        ("clustered", beside.clustered),
        ("mixed", beside.mixed),
    )
    rows = []
    for name, fit in fits:
        for place, c in enumerate(fit.coefficients):
            rows.append(
                (
                    name if place == 0 else "",
                    c.term,
                    number(c.estimate, 3),
                    number(c.standard_error, 3),
                    number(c.statistic),
                    "z" if c.df is None else f"t({c.df:g})",
                    p_number(c.p),
                    big(c.odds_ratio),
                    _spread(fit) if place == 0 else "",
                )
            )
    return (
        Table.of(
            f"Logistic models of right answers, {beside.independent.formula}",
            (
                ("Errors", "l"),
                ("Term", "l"),
                ("b", ""),
                ("SE", ""),
                ("Statistic", ""),
                ("Law", ""),
                ("p", "n"),
                ("OR", ""),
                ("Random SD", "l"),
            ),
            rows,
        ),
        Paragraph(
            "b: logarithm of the odds (OR) of a right answer. The first takes trials as"
            " independent, as papers print it; the second clusters its errors by"
            f" {' and '.join(groups)}; the third has"
            f" {'them as crossed' if len(groups) > 1 else f'{groups[0]}s as'} random intercepts"
            " and lets effects differ between them (t of participants - 1),"
            f" and so speaks of the typical {groups[0]}.",
            muted=True,
        ),
        Cautions(
            "When not to trust these models",
            grouped([(name, fit.warnings) for name, fit in fits]),
        ),
    )


def _checks(results: RateResults, settings: RateSettings) -> tuple[Block, ...]:
    blocks: list[Block] = []
    if results.learning:
        blocks += learning_blocks(results.learning)
    blocks += reaction_blocks(results.reaction, "Condition", settings.label)
    blocks += time_model_blocks(results.times, settings.label)
    blocks += diffusion_blocks(results.diffusion, settings.label)
    return tuple(blocks) or (Paragraph("The table holds neither order nor reaction times."),)


def _limits(settings: RateSettings) -> str:
    return f"{100 * settings.confidence:g} % limits"


def _spread(fit: ModelFit) -> str:
    return ", ".join(f"{name} {number(sd)}" for name, sd in fit.random_sd.items()) or "none"


def _pair(ends: tuple[float, float] | None) -> str:
    return "none" if ends is None else f"[{ends[0]:.3g}, {ends[1]:.3g}]"


def _end(value: float) -> str:
    if value in (float("inf"), float("-inf")):
        return INFINITE if value > 0 else "-" + INFINITE
    return number(value)
