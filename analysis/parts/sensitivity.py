"""Sensitivity by detection theory: d' by condition, criterion and bias, and what differs."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis.answers import SimulatedAnswers
from analysis.arrays import Bools, Floats
from analysis.models.cells import grid
from analysis.models.clustered import holm, two_way_of_first
from analysis.models.contrasts import MEAN, Difference, pairs_of
from analysis.models.detection import (
    Discrimination,
    DiscriminationResults,
    Measure,
    YesNoCondition,
    YesNoResults,
    d_prime_influence,
    discrimination,
    yes_no,
)
from analysis.models.logistic import ModelFit, glmm_probit
from analysis.models.mixed.inference import Inference
from analysis.models.right_answers import Influence, Rate, mean_influence, rate, share_influence
from analysis.parts import Estimate, PartFigure, Presentation, SimplePart, Tests, tried
from analysis.parts.correct import answers_in, clusters, rate_table, respected
from analysis.parts.shared import (
    alone,
    apa_difference,
    condition,
    difference_estimates,
    difference_table,
    difference_tables,
    estimate,
    in_order,
    planned_family,
    sd_text,
    told_apart,
)
from analysis.plans.rate_plan import RatePlan, baseline_in, shown_in
from analysis.plots import d_prime_plot, detection_plot
from analysis.report.result_table import (
    DECIDES,
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    estimated,
    limits,
    p_value,
    set_aside,
    within,
)
from analysis.report.wording import (
    NONE,
    level_text,
    number,
    number_range,
    p_text,
    placed,
    share,
    share_range,
    t_text,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import Cautions, FigurePlace, Folded, Paragraph, grouped

TRUST = "When not to trust these sensitivities"


@dataclass(frozen=True)
class YesNoSensitivity(YesNoResults):
    """Every number of a yes-no task; the planned comparisons are those of d'."""

    notes: tuple[str, ...]

    @property
    def planned(self) -> tuple[Difference, ...]:
        """Comparisons that a study plans: differences of d'."""
        return self.d_prime_contrasts

    @property
    def alone(self) -> Measure | None:
        """d' of the only condition that has one: it is tested against 0."""
        known = [one.d_prime for one in self.conditions if one.d_prime is not None]
        return known[0] if len(known) == 1 else None

    @property
    def measures(self) -> tuple[tuple[str, tuple[Difference, ...]], ...]:
        """Differences by what they are of."""
        return (
            ("d'", self.d_prime_contrasts),
            ("the criterion", self.criterion_contrasts),
            ("bias", self.bias_contrasts),
        )


class YesNoPart(SimplePart[RatePlan, YesNoSensitivity]):
    """d', criterion and bias of a yes-no task."""

    name: ClassVar[str] = "sensitivity"
    section: ClassVar[tuple[str, str]] = ("sensitivity", "Sensitivity")
    essential: ClassVar[bool] = True

    def of(self, table: pd.DataFrame, plan: RatePlan) -> YesNoSensitivity:
        """Take them from hits and false alarms; conditions without noise share that of others."""
        rows = with_shared_noise(table, plan.answers[0])
        notes = [*alone(table, plan)]
        if rows is not table:
            notes.append("conditions without noise trials of their own share those of the others")
        found = yes_no(
            rows,
            plan.compared,
            signal=plan.answers[0],
            reference=baseline_in(rows, plan),
            level=plan.confidence,
        )
        results = YesNoSensitivity(
            in_order(found.conditions, plan, lambda one: one.condition),
            told_apart(found.d_prime_contrasts, plan),
            told_apart(found.criterion_contrasts, plan),
            told_apart(found.bias_contrasts, plan),
            found.correction,
            tuple(notes),
        )
        if results.alone is None or plan.adaptive:
            return results
        few = planned_family(0, plan).hopeless(table["participant"].nunique(), plan.alpha)
        return replace(results, notes=(*notes, *few))

    def planned_p(self, found: YesNoSensitivity, plan: RatePlan) -> float | None:
        """Return p of d' against 0 where one condition alone has a d'."""
        return None if found.alone is None or plan.adaptive else found.alone.p

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: RatePlan
    ) -> Tests:
        """Test differences of d', and of bias where the baseline has a d' too."""
        if plan.adaptive:
            return {}
        own, told = _told(answers.cells, plan)
        test = partial(_planned, answers, people, plan)
        found: dict[str, Callable[[], Floats]] = {"": partial(test, told, _moved_d_prime)}
        if len(own) > 1 and plan.values[0] in told:
            every = {name: (cells,) for name, cells in own.items()}
            held = [list(own).index(name) - 1 for name in list(told)[1:]]
            found["bias"] = lambda: test(every, share_influence)[..., held]
        return found

    def families(self, cells: pd.DataFrame, plan: RatePlan) -> Sequence[FamilyOfTests]:
        """Return the comparisons of d'; of a single condition the test against chance."""
        return () if plan.adaptive else (planned_family(len(_told(cells, plan)[1]) - 1, plan),)

    def estimates(self, found: YesNoSensitivity, plan: RatePlan) -> Sequence[Estimate]:
        """Return d' and what they differ by, unless levels adapt."""
        trials = {one.condition: one.correct.trials for one in found.conditions}
        measured = [
            estimate(
                f"d' of {plan.label(one.condition)}",
                one.d_prime.value,
                one.d_prime,
                one.correct.trials,
            )
            for one in found.conditions
            if one.d_prime is not None
        ]
        differing = difference_estimates(found.planned, trials, plan)
        return () if plan.adaptive else (*measured, *differing)

    def show(self, found: YesNoSensitivity, plan: RatePlan) -> Presentation:
        """Return hits and false alarms, what follows from them, and differences."""
        label, cells = plan.label, found.conditions
        answer = label(cells[0].bias_answer)
        known = [(name, several) for name, several in found.measures if several]
        compared = [one for _, several in known for one in several]
        main, rest = known[: 2 * (not plan.by_threshold)], known[2 * (not plan.by_threshold) :]
        tested = [one for _, several in main for one in several]
        files = difference_table(compared, plan).every_field(kind=Difference)
        files.loc[len(tested) :, DECIDES] = ""
        table = _yes_no_table(found, plan)
        figures = [
            PartFigure(
                "detection",
                f"Shares of right answers, and of one answer, with {plan.limits} that respect"
                f" {respected(one.correct for one in cells)}; p against one half; dashed: one"
                " half.",
                partial(detection_plot, found, label=label),
            )
        ]
        if any(one.d_prime for one in cells):
            caption = (
                f"Sensitivity d' by condition with {plan.limits}, and the criterion: negative"
                " where the signal's answer is given too readily."
            )
            draw = partial(d_prime_plot, found, label=label)
            figures.append(PartFigure("sensitivity", caption, draw))
        return Presentation(
            blocks=(
                FigurePlace("detection"),
                FigurePlace("sensitivity"),
                table.block(),
                Paragraph(
                    "d': how far signal and noise lie apart, in standard deviations of the noise."
                    " Deciding p: against 0. c: where the criterion lies; negative: inclined to"
                    f' "{answer}". Of the whole table: participants who set different criteria make'
                    " this d' smaller than their own.",
                    muted=True,
                ),
                *(
                    block
                    for name, several in main
                    for block in difference_tables(f"Differences of {name}", several, plan)
                ),
                Cautions.each(TRUST, cells, lambda one: label(one.condition)),
            ),
            others=(
                table.folded(
                    f'Share answered "{answer}", against one half',
                    "Papers print it as bias. It depends on how often the signal was there, and on"
                    " d'; the criterion does not.",
                    *(
                        block
                        for name, several in rest
                        for block in difference_tables(
                            f"Differences of {name}", several, plan, told=False
                        )
                    ),
                ),
            ),
            sentences=(
                *(
                    apa_yes_no(
                        replace(one, bias_answer=label(one.bias_answer)), name=label(one.condition)
                    )
                    for one in cells
                ),
                *(apa_difference(one, plan) for one in tested),
            ),
            methods=methods_yes_no(found),
            tables={
                "sensitivity.csv": table.every_field(),
                "sensitivity_differences.csv": files,
            },
            figures=figures,
        )


def with_shared_noise(rows: pd.DataFrame, signal: str) -> pd.DataFrame:
    """Give conditions that hold the signal in every trial the noise trials of those without any.

    Where methods are compared with a reference that never holds the signal, all methods share its
    trials. A difference between two methods takes them away again. Conditions that never hold the
    signal then have no d' of their own, and are left out.
    """
    there = (rows["expected"].astype(str) == signal).groupby(rows["condition"]).agg(["any", "all"])
    only_signal = there.index[there["all"]]
    only_noise = there.index[~there["any"]]
    if only_signal.empty or only_noise.empty:
        return rows
    noise = rows[rows["condition"].isin(only_noise)]
    shared = [noise.assign(condition=name) for name in only_signal]
    kept = rows[~rows["condition"].isin(only_noise)]
    return pd.concat([kept, *shared], ignore_index=True)


def _told(
    cells: pd.DataFrame, plan: RatePlan
) -> tuple[dict[str, Bools], dict[str, tuple[Bools, Bools]]]:
    """Return each condition's cells, and with signal and noise those of which d' is known."""
    own = {name: _cells_of(cells, name) for name in plan.values}
    there = (cells["expected"] == plan.answers[0]).to_numpy()
    lacking = [one for one in own.values() if not there[one].any()]
    shared = np.any(lacking, axis=0) if lacking else ~there
    told = {
        name: (one & there, one & ~there if not there[one].all() else shared & ~there)
        for name, one in own.items()
        if there[one].any() and (lacking or not there[one].all())
    }
    return own, told


def _planned(
    answers: SimulatedAnswers,
    people: Sequence[int],
    plan: RatePlan,
    cells: Mapping[str, Sequence[Bools]],
    influence: Callable[..., Influence],
) -> Floats:
    """Return p of differences between conditions, or of a single one against 0, adjusted.

    Parameters
    ----------
    cells : mapping of a condition to sets of its cells
    influence : callable
        From counts and trials (participants, scenes) of each set to what they move an estimate.

    Returns
    -------
    ndarray (studies, numbers of participants, comparisons)
    """
    grids = {
        name: [answers.grid(one, by_scene=plan.test == "participant-scene") for one in sets]
        for name, sets in cells.items()
    }

    def tested(count: int) -> Floats:
        moved = {
            name: influence(
                *(
                    part
                    for counts, shown in sets
                    for part in (counts[:, :count], np.tile(shown, (count, 1)))
                )
            )
            for name, sets in grids.items()
        }
        if len(moved) == 1:
            return np.stack([one.estimate().p_value() for one in moved.values()], axis=-1)
        pairs = pairs_of(moved, plan.reference_in(list(moved)))
        moved[MEAN] = mean_influence(moved.values())
        return np.stack([moved[a].less(moved[b]).p_value() for a, b in pairs], axis=-1)

    p = np.stack([tested(count) for count in people], axis=1)
    return holm(p) if plan.correction == "holm" else p


def _cells_of(cells: pd.DataFrame, condition: str) -> Bools:
    return np.asarray(cells["condition"] == condition)


def _moved_d_prime(hits: Floats, signal: Floats, alarms: Floats, noise: Floats) -> Influence:
    return d_prime_influence(hits, signal, alarms, noise, "log-linear")[0]


def _yes_no_table(found: YesNoSensitivity, plan: RatePlan) -> ResultTable[YesNoCondition]:
    answer = plan.label(found.conditions[0].bias_answer)
    return ResultTable.of(
        f'Hits and false alarms ("{answer}" where it was right, and where it was not)',
        found.conditions,
        condition(plan),
        ResultColumn("Hits", "n", lambda one: f"{one.hits} / {one.hits + one.misses}"),
        ResultColumn(
            "False alarms",
            "n",
            lambda one: f"{one.false_alarms} / {one.false_alarms + one.correct_rejections}",
        ),
        *_measured("d'", "d_prime_p", lambda one: one.d_prime),
        *_measured("c", "criterion_p", lambda one: one.criterion),
        set_aside(attribute(f'Share "{answer}"', "bias.share", share)),
        p_value("p", "bias.p"),
    )


def _measured(
    title: str, file: str, of: Callable[[YesNoCondition], Measure | None]
) -> Iterator[ResultColumn[YesNoCondition]]:
    """Yield the columns of a quantity, its p as `file` names it; none where it cannot be had."""

    def known(column: ResultColumn[Measure]) -> ResultColumn[Measure | None]:
        text = column.text
        return ResultColumn(
            column.title,
            column.style,
            lambda one: NONE if one is None or not text else text(one),
            decides=lambda one: "" if one is None else str(column.decides),
        )

    value: tuple[ResultColumn[Measure], ...] = (estimated(title, "value"), limits())
    yield from within(of, map(known, value))
    p: ResultColumn[Measure] = deciding("p", file)
    yield from within(of, [known(p)])


def apa_yes_no(one: YesNoCondition, *, name: str = "") -> str:
    """Return d', criterion and bias of one condition as sentences."""
    who = name or one.condition
    bias = one.bias
    said = (
        f'"{one.bias_answer}" was answered in {share(bias.share)} of trials,'
        f" {level_text(bias.level)} {share_range(bias.lower, bias.upper)}"
    )
    if one.d_prime is None or one.criterion is None:
        return f"In condition {who}, {said} (signal and noise were not both shown: no d')."
    return f"In condition {who}, d' = {_said(one.d_prime)}; c = {_said(one.criterion)}; {said}."


def _said(one: Measure) -> str:
    return (
        f"{placed(one, one.value)}, {level_text(one.level)} {number_range(one.lower, one.upper)},"
        f" {t_text(one.t, one.df)}, {p_text(one.p)}"
    )


def methods_yes_no(results: YesNoResults) -> str:
    """Return a paragraph on how a yes-no task was analysed, ready to paste."""
    start = (
        "Sensitivity d' = z(H) - z(F) and criterion c = -(z(H) + z(F))/2 were taken from each"
        f" condition's table{_corrected(results.correction)}. Limits and tests"
    )
    if all(one.correct.participants < 2 for one in results.conditions):
        return f"{start} are of one participant: normal, with trials taken as independent."
    by = clusters(one.correct for one in results.conditions)
    two_way = "two-way, Cameron, Gelbach & Miller, 2011, of" if " and " in by else "of"
    return (
        f"{start}, also between conditions, are t with standard errors clustered by {by} ({two_way}"
        " each trial's influence on z); shares have Wilson"
        " limits with the effective number of trials, and p from the same score test."
        + " Tests between conditions are Holm-adjusted."
        * (len(results.d_prime_contrasts) > 1)
    )


def _corrected(correction: str) -> str:
    return (
        ", with one trial at chance added to every rate of every condition (log-linear correction,"
        " Hautus, 1995)"
        if correction == "log-linear"
        else ", without correction"
    )


@dataclass(frozen=True)
class TypicalSensitivity:
    """Probit mixed models by condition; their slope is d' of the typical participant."""

    fits: tuple[tuple[str, ModelFit], ...]
    notes: tuple[str, ...]


class TypicalPart(SimplePart[RatePlan, TypicalSensitivity]):
    """d' and criterion of the typical participant of a yes-no task."""

    name: ClassVar[str] = "typical"
    section: ClassVar[tuple[str, str]] = ("sensitivity", "Sensitivity")
    beside: ClassVar[tuple[str, str]] = (
        "d' of the typical participant",
        "People who set different criteria make d' of the whole table smaller than their own; this"
        " model gives each participant a criterion and a d'.",
    )

    def of(self, table: pd.DataFrame, plan: RatePlan) -> TypicalSensitivity:
        """Fit d' of the typical participant, condition by condition."""
        rows, signal = with_shared_noise(table, plan.answers[0]), plan.answers[0]
        found, notes = [], list[str]()
        for name in shown_in(table, plan):
            part = rows[rows["condition"] == name]
            there, said = (part[column].astype(str) == signal for column in ("expected", "answer"))
            groups = [column for column in ("participant", "scene") if column in part]
            groups = [column for column in groups if part[column].nunique() > 1]
            if there.all() or not there.any() or not groups:
                continue
            fit = tried(
                partial(
                    glmm_probit,
                    "said ~ 1 + signal",
                    part[groups].assign(said=said.astype(int), signal=there.astype(float) - 0.5),
                    groups=groups,
                    slopes=[("signal", "participant")] if "participant" in groups else (),
                    inference=Inference(plan.confidence),
                ),
                f"mixed model of {name}",
                notes,
            )
            if fit is not None:
                found.append((name, fit))
        if not found:
            raise ValueError("; ".join(notes) or "one participant and one scene vary in nothing")
        return TypicalSensitivity(tuple(found), tuple(notes))

    def show(self, found: TypicalSensitivity, plan: RatePlan) -> Presentation:
        """Return both with their errors."""
        lines = [
            {"condition": name} | vars(one) for name, fit in found.fits for one in fit.coefficients
        ]
        return Presentation(
            blocks=(
                ResultTable.of(
                    "d' and criterion of the typical participant: probit mixed models",
                    found.fits,
                    ResultColumn("Condition", "l c", lambda one: plan.label(one[0])),
                    *(
                        column
                        for title, term, sign in (("d'", "signal", 1.0), ("c", "Intercept", -1.0))
                        for column in _typical(title, term, sign)
                    ),
                    ResultColumn("Random SD", "l", lambda one: sd_text(one[1].random_sd)),
                ).block(),
                Cautions(
                    "When not to trust these mixed models",
                    grouped([(plan.label(name), fit.warnings) for name, fit in found.fits]),
                ),
            ),
            sentences=tuple(
                f"The typical participant's d' in condition {plan.label(name)} was"
                f" {number(fit['signal'].estimate)}, SE = {number(fit['signal'].standard_error)},"
                f" and c {number(-fit['Intercept'].estimate)}, SE ="
                f" {number(fit['Intercept'].standard_error)} ({fit.method})."
                for name, fit in found.fits
                if not math.isnan(fit["signal"].estimate)
            ),
            methods=(
                "d' and c of the typical participant come from a probit mixed model of each"
                " condition, with random intercepts and participants' own slopes of the signal."
            ),
            tables={"typical.csv": pd.DataFrame(lines)},
        )


def _typical(
    title: str, term: str, sign: float
) -> tuple[ResultColumn[tuple[str, ModelFit]], ResultColumn[tuple[str, ModelFit]]]:
    """Return the columns of a coefficient and its error."""
    return (
        ResultColumn(title, "strong", lambda one: number(sign * one[1][term].estimate)),
        ResultColumn("SE", "", lambda one: number(one[1][term].standard_error)),
    )


@dataclass(frozen=True)
class ChoiceSensitivity(DiscriminationResults):
    """Every number of an identification or ABX task.

    `answered`: of two answers, how often the first was given, against one half.
    """

    answered: Rate | None
    notes: tuple[str, ...]

    @property
    def planned(self) -> tuple[Difference, ...]:
        """Comparisons that a study plans: differences of d'."""
        return self.contrasts


class DiscriminationPart(SimplePart[RatePlan, ChoiceSensitivity]):
    """d' from shares of right answers, by the plan's answer rule.

    `sides`: its two answers are places, of which one may be preferred.
    """

    name: ClassVar[str] = "sensitivity"
    section: ClassVar[tuple[str, str]] = ("sensitivity", "Sensitivity")

    def __init__(self, *, sides: bool = False) -> None:
        self._sides = sides

    def of(self, table: pd.DataFrame, plan: RatePlan) -> ChoiceSensitivity:
        """Turn shares into d'; compare them as shares."""
        reference = baseline_in(table, plan)
        found = discrimination(
            table, plan.answer_rule, plan.compared, reference=reference, level=plan.confidence
        )
        answers, answered = answers_in(table, plan), None
        if self._sides and answers:
            said = (table["answer"] == answers[0]).astype(float)
            answered = rate(said, grid(table), condition=answers[0], level=plan.confidence)
        return ChoiceSensitivity(
            in_order(found.conditions, plan, lambda one: one.condition),
            told_apart(found.contrasts, plan),
            found.rule,
            found.correction,
            answered,
            alone(table, plan),
        )

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: RatePlan
    ) -> Tests:
        """Test differences of shares, or of a single condition's against chance."""
        if plan.adaptive:
            return {}
        own = {name: (_cells_of(answers.cells, name),) for name in plan.values}
        if len(own) > 1:
            return {"": partial(_planned, answers, people, plan, own, share_influence)}
        by_scene = plan.test == "participant-scene"
        alone = answers.grid(own[plan.values[0]][0], by_scene=by_scene)
        return {"": lambda: two_way_of_first(*alone, people).p_value(plan.chance)[..., None]}

    def families(self, _cells: pd.DataFrame, plan: RatePlan) -> Sequence[FamilyOfTests]:
        """Return the comparisons of shares; of a single condition the test against chance."""
        return () if plan.adaptive else (planned_family(len(plan.values) - 1, plan),)

    def estimates(self, found: ChoiceSensitivity, plan: RatePlan) -> Sequence[Estimate]:
        """Return shares of right answers and what they differ by, unless levels adapt."""
        rates = [one.correct for one in found.conditions]
        shares = [
            estimate(f"right answers, {plan.label(one.condition)}", one.share, one, one.trials)
            for one in rates
        ]
        trials = {one.condition: one.trials for one in rates}
        differing = difference_estimates(found.planned, trials, plan)
        return () if plan.adaptive else (*shares, *differing)

    def show(self, found: ChoiceSensitivity, plan: RatePlan) -> Presentation:
        """Return d' by condition, and differences of shares."""
        label, cells = plan.label, found.conditions
        table = ResultTable.of(
            f"d' from shares of right answers ({found.rule})",
            cells,
            condition(plan),
            attribute("Share", "correct.share", share),
            estimated("d'", "d_prime"),
            limits(plan.limits),
            replace(deciding("correct.p", "correct_p"), text=None),
        )
        told = not (plan.by_threshold or plan.by_scaling)
        title = "Differences of shares of right answers"
        differences = difference_tables(title, found.contrasts, plan, told=told)
        files = difference_table(found.contrasts, plan, told=told).every_field(kind=Difference)
        beside = Folded(
            title,
            "Critical scalings compare; shares also depend on the scalings that were shown."
            if plan.by_scaling
            else "Levels were chosen from the answers: thresholds compare, shares do not.",
            differences,
        )
        caption = f"Sensitivity d' by condition with {plan.limits}."
        draw = partial(d_prime_plot, found, label=label)
        return Presentation(
            blocks=(
                FigurePlace("sensitivity"),
                table.block(),
                Paragraph(
                    "d': how far the stimuli lie apart, in standard deviations of the noise, for an"
                    " observer who decides as the rule in brackets says. Limits are the share's.",
                    muted=True,
                ),
                *(differences if told else ()),
                *(
                    rate_table(
                        f'How often "{label(plan.answers[0])}" was answered, against one half',
                        (one,),
                        plan,
                    ).block()
                    for one in (found.answered,)
                    if one is not None
                ),
                Cautions.each(TRUST, cells, lambda one: label(one.condition)),
            ),
            others=(beside,) * (not told and bool(differences)),
            sentences=(
                *(apa_discrimination(one, found.rule, name=label(one.condition)) for one in cells),
                *(apa_difference(one, plan) for one in found.contrasts if told),
            ),
            methods=methods_discrimination(found),
            tables={
                "sensitivity.csv": table.every_field(),
                "sensitivity_differences.csv": files,
            },
            figures=(PartFigure("sensitivity", caption, draw),),
        )


def apa_discrimination(one: Discrimination, rule: str, *, name: str = "") -> str:
    """Return d' of one condition of an identification or ABX task as a sentence."""
    right = one.correct
    return (
        f"In condition {name or one.condition}, d' = {placed(one, one.d_prime)},"
        f" {level_text(right.level)} {number_range(one.lower, one.upper)} ({rule}), from"
        f" {share(right.share)} correct answers."
    )


def methods_discrimination(results: DiscriminationResults) -> str:
    """Return a paragraph on how d' of identification or ABX was made, ready to paste."""
    by = clusters(one.correct for one in results.conditions)
    return (
        f"d' ({results.rule}) was taken from each condition's share of correct answers"
        f"{_corrected(results.correction)}; its limits are those of the share (Wilson, effective"
        f" number of trials clustered by {by}), mapped to d'."
        + " Conditions were compared as shares correct" * bool(results.contrasts)
        + ", Holm-adjusted" * (len(results.contrasts) > 1)
        + "." * bool(results.contrasts)
    )
