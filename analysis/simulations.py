"""Simulated answers of participants in each kind of task, for power."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, TypeVar

import numpy as np
import pandas as pd
import scipy
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.special import expit, ndtr, ndtri

from analysis.answers import SimulatedAnswers, codes_of, crossed_effects
from analysis.arrays import Floats
from analysis.models.compared_methods import as_numbers
from analysis.models.numeric import ROUNDING
from analysis.parts import AnyPart
from analysis.pilot import (
    Found,
    preference_deviations,
    rating_deviations,
    sensitivity_deviations,
    threshold_deviations,
    time_deviations,
)
from analysis.plans.preference_plan import PreferencePlan
from analysis.plans.rate_plan import RatePlan, combined, prepared
from analysis.plans.rating_plan import RatingPlan
from analysis.power import COMMON, Assumption, PowerSimulation, default_participants
from protocols.adaptive.psychometric_function import sigmoid
from protocols.adaptive.section import AdaptiveLevels
from protocols.errors import StudyError
from protocols.study_file.schema import StudyProtocol

C = TypeVar("C", bound=RatePlan | RatingPlan)

INTERACTION = "interaction"
INTERACTION_SD = "interaction_sd"
OWN = "difference."
"""Before a condition: what it alone has more than the baseline."""
OWN_CRITERION = "criterion."
"""Before a condition: what its criterion alone has more than the baseline's."""
CRITERION_DIFFERENCE = "criterion_difference"
LAPSE = 0.02
TRACKS = 60
"""Adaptive tracks that are run to see how exact they are."""


def mean_logit(rate: float, spread: float) -> float:
    """Return the logit whose mean response over normal effects of sd `spread` is `rate`."""
    if spread == 0:
        return float(np.log(rate / (1.0 - rate)))
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    weights = weights / weights.sum()
    return float(
        scipy.optimize.brentq(lambda mu: weights @ expit(mu + spread * nodes) - rate, -60.0, 60.0)
    )


def tabulated(share: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    """Return a function of d' that looks its values up; d' below 0 counts as 0."""
    d_prime = np.linspace(0.0, 12.0, 2401)
    values = share(d_prime)
    return lambda found: np.interp(found, d_prime, values)


class Choices(PowerSimulation[PreferencePlan]):
    """Choices between pairs: random effects of participants and scenes on the logit.

    They are drawn anew for every pairing. `size_correlation` is how alike the effects of one
    pairing are at two sizes: 1 where who prefers a method at one size prefers it as much at all.
    Effects that sizes share do not average out over them, so 1 promises least, and most of an
    interaction, whose differences they leave.
    """

    studies: ClassVar[int] = 10_000
    at_once: ClassVar[int] = 500

    def __init__(self, plan: PreferencePlan, parts: Sequence[AnyPart]) -> None:
        if not plan.comparisons:
            raise ValueError("the study must declare comparisons (a protocol, not a plain table)")
        columns = ["method", "against", "size", "scene"]
        cells = [(c.method, c.against, c.size, s) for c in plan.comparisons for s in c.scenes]
        frame = pd.DataFrame(cells, columns=columns)
        frame["condition"] = frame["size"]
        super().__init__(plan, parts, frame, plan.comparisons[0].repeats, plan.planned_participants)
        pairing = codes_of(frame["method"], frame["against"])
        self._person = pairing, codes_of(pairing, frame["size"])
        self._scene = codes_of(pairing, frame["scene"]), np.arange(len(frame))
        one = "logit deviation between"
        # What promises least of a preference over all sizes promises most of their difference.
        alike_most = 1.0 if plan.interaction is None else COMMON
        alike = "how alike participants' and scenes' deviations are at two sizes"
        share = "true share in every comparison, averaged over people and scenes"
        self.assumptions = (
            Assumption("rate", 0.5 + plan.margin, share, 0.01, 0.99),
            Assumption("participant_sd", 0.6, f"{one} participants", 0.0, 5.0),
            Assumption("scene_sd", 0.4, f"{one} scenes", 0.0, 5.0),
            Assumption("size_correlation", alike_most, alike, 0.0, 1.0),
            *(self.with_times() if plan.reaction == "models" else ()),
        )
        if plan.interaction is not None:
            more = "what the true share has more at the last size than at the first, others between"
            self.assumptions += (Assumption(INTERACTION, plan.margin, more, -0.98, 0.98),)
        sizes = [size for size in plan.sizes if size in set(frame["size"])]
        self._along = frame["size"].map(sizes.index).to_numpy() / max(len(sizes) - 1, 1) - 0.5

    def draw(
        self, assumed: Mapping[str, float], studies: int, people: int, rng: Generator
    ) -> SimulatedAnswers:
        """Draw choices of the first method of each pairing."""
        sds, common = (assumed["participant_sd"], assumed["scene_sd"]), assumed["size_correlation"]
        logit = sum(
            np.float32(sd) * crossed_effects(rng, (studies, units), *codes, common)
            for sd, units, codes in zip(sds, (people, 1), (self._person, self._scene), strict=True)
        )
        rates = assumed["rate"] + assumed.get(INTERACTION, 0.0) * self._along
        if not (rates.min() > 0.0 and rates.max() < 1.0):
            raise StudyError(
                f"--set {INTERACTION}: must leave every size a share between 0 and 1 (got"
                f" {rates.min():g} to {rates.max():g}); lower it, or bring the rate nearer to 0.5"
            )
        means = {rate: mean_logit(rate, float(np.hypot(*sds))) for rate in set(rates.tolist())}
        share = expit(logit + np.array([means[rate] for rate in rates.tolist()], np.float32))
        shape = (self.repeats, studies, people, len(self.cells))
        return SimulatedAnswers(rng.random(shape, dtype=np.float32) < share, self.cells)

    def nothing(self, assumed: Mapping[str, float]) -> dict[str, float]:
        """Return a share of one half."""
        return {**assumed, "rate": 0.5, **dict.fromkeys({INTERACTION} & {*assumed}, 0.0)}

    def table(self, answers: SimulatedAnswers) -> pd.DataFrame:
        """Return decisions; each of a pair comes first in turn."""
        rows, event = answers.rows()
        won, turned = event.astype(bool), rows["order"].to_numpy() % 2 == 1
        sides = (("chosen", won), ("rejected", ~won), ("first", turned), ("second", ~turned))
        for name, ours in sides:
            rows[name] = np.where(ours, rows["method"], rows["against"])
        return as_numbers(rows.drop(columns=["method", "against", "condition"]))

    def participants(self) -> tuple[int, ...]:
        """Return all numbers: they cost little more than one."""
        return default_participants(self.planned)

    def deciding(self) -> "Choices":
        """Return the simulation of the primary comparison alone."""
        assert self.plan.primary is not None, "every study declares it"
        method, against, size = self.plan.primary
        kept = tuple(
            one
            for one in self.plan.comparisons
            if (one.method, one.against) == (method, against)
            and (size in ("all", one.size) or self.plan.interaction is not None)
        )
        return Choices(self.plan.but(comparisons=kept), self.parts)

    def resized(self, scenes: int, repeats: int) -> "Choices":
        """Return that with other numbers of scenes and repeats."""
        names = tuple(f"scene {number}" for number in range(scenes))
        other = [replace(one, scenes=names, repeats=repeats) for one in self.plan.comparisons]
        return Choices(self.plan.but(comparisons=tuple(other)), self.parts)

    def taken(self, assumed: Mapping[str, float]) -> str:
        """Return the assumptions, in words."""
        return (
            f"true share {assumed['rate']:g}; deviations {assumed['participant_sd']:g}"
            f" (participants) and {assumed['scene_sd']:g} (scenes) logits, correlated"
            f" {assumed['size_correlation']:g} between sizes"
            + (f"; {assumed[INTERACTION]:+g} at the last size" if INTERACTION in assumed else "")
            + "".join(f", {one.name} {assumed[one.name]:g}" for one in self.timed)
        )

    def notes(self, assumed: Mapping[str, float]) -> list[str]:
        """Return notes on the power of an interaction."""
        note = (
            "interaction: its power rests on size_correlation, how alike people's and scenes'"
            " deviations are at two sizes; 1 promises most"
        )
        return [*super().notes(assumed), *[note] * (INTERACTION in assumed)]

    def from_pilot(self, decisions: pd.DataFrame, plan: PreferencePlan) -> Found:
        """Return the deviations of a pilot's participants and scenes."""
        found = preference_deviations(decisions)
        return time_deviations(found, decisions, plan) if self.timed else found


class _Conditions(PowerSimulation[C]):
    """Base of simulations whose conditions differ by a number each."""

    def __init__(
        self, study: StudyProtocol, plan: C, parts: Sequence[AnyPart], baseline: str | None
    ) -> None:
        cells = study.task.cells(study.pool)
        if not cells:
            raise StudyError("task: must show at least one condition (there is no stimulus for it)")
        shown = [cell.arrangements[0] for cell in cells]
        columns = plan.by_columns if isinstance(plan, RatePlan) else plan.compared
        frame = pd.DataFrame([one.condition for one in shown]).assign(
            scene=[cell.scene for cell in cells],
            expected=[one.correct or "" for one in shown],
            condition=[combined(one.condition.get(name) for name in columns) for one in shown],
        )
        super().__init__(plan, parts, frame, study.design.repeats, study.study.participants)
        self._timed = study.analysis.reaction == "models"
        self.compared = self.names[1:]
        self.against = "" if baseline is None else " with the baseline"
        scene = codes_of(frame["scene"])
        self._person = np.zeros_like(scene), self._number
        self._scene = scene, codes_of(scene, self._number)

    def _each(self, before: str, meaning: str) -> list[Assumption]:
        """Return the assumptions that each condition but the baseline may have of its own."""
        return [
            Assumption(f"{before}{name}", np.nan, meaning.format(self.plan.label(name)), -10.0)
            for name in self.names[1:]
        ]

    def _more(self, assumed: Mapping[str, float], own: str, every: str) -> Floats:
        """Return the surplus of each condition over the baseline."""
        all_more = assumed.get(every, 0.0)
        return np.array([0.0, *(assumed.get(own + name, all_more) for name in self.names[1:])])

    def _effects(
        self, assumed: Mapping[str, float], name: str, units: tuple[int, int], rng: Generator
    ) -> NDArray[np.float32]:
        """Draw deviations (*units, cells) of participants, or of scenes."""
        whole, own = self._scene if name == "scene_sd" else self._person
        return np.float32(assumed.get(name, 0.0)) * crossed_effects(rng, units, whole, own, COMMON)

    def nothing(self, assumed: Mapping[str, float]) -> dict[str, float]:
        """Return no differences; of one condition no sensitivity, alike for all."""
        gone: tuple[str, ...] = ("difference", CRITERION_DIFFERENCE, INTERACTION)
        if len(self.names) == 1:
            gone = ("d_prime", "slope", "participant_sd", "scene_sd", INTERACTION, INTERACTION_SD)
        return {
            name: 0.0 if name in gone or name.startswith((OWN, OWN_CRITERION)) else value
            for name, value in assumed.items()
        }

    def singled_out(self, assumed: Mapping[str, float]) -> Sequence[str]:
        """Return names of compared conditions, where one has a difference of its own."""
        own = self.against and any(name.startswith(OWN) for name in assumed)
        return [self.plan.label(name) for name in self.compared] if own else []


class RightAnswers(_Conditions[RatePlan]):
    """Right answers by d' of participants in conditions; yes-no where there is no `share`.

    `share`: from d' to the chance of a right answer.
    """

    def __init__(
        self,
        study: StudyProtocol,
        plan: RatePlan,
        parts: Sequence[AnyPart],
        share: Callable[[Floats], Floats] | None,
    ) -> None:
        super().__init__(study, plan, parts, plan.values[0])
        self.share, self.chance_alone = share, len(self.names) == 1
        self._there = (self.cells["expected"] == plan.answers[0]).to_numpy()
        held = [self._there[self._number == k] for k in range(len(self.names))]
        lacking = share is None and any(one.all() for one in held)
        self._told = np.array([one.any() or not lacking for one in held])
        self.compared = [self.names[k] for k in np.flatnonzero(self._told)][1:]
        self._place = np.full(len(self.cells), 0.5)
        if plan.level is not None:
            column = pd.to_numeric(self.cells[plan.level], errors="coerce").fillna(0.0)
            self._place = ((column - column.min()) / (np.ptp(column) or 1.0)).to_numpy()
            self._place = 1.0 - self._place if plan.falling else self._place
        several, scenes = len(self.names) > 1, self.cells["scene"].nunique() > 1
        more, own = "what {} of every other condition has more", "the same of {}"
        found = [
            Assumption("d_prime", 1.0, "sensitivity to the baseline, of the typical participant")
        ]
        if several:
            found.append(Assumption("difference", 0.5, more.format("d'"), -10.0))
            found += self._each(OWN, f"{own} alone")
        found.append(Assumption("participant_sd", 0.4, "deviation of d' between participants"))
        if scenes:
            found.append(Assumption("scene_sd", 0.2, "deviation of d' between scenes"))
        if plan.level is not None:
            found.append(Assumption("slope", 1.0, "how far d' rises over the range of levels"))
        if share is None:
            towards = "towards no, in deviations of the noise"
            found.append(Assumption("criterion", 0.0, towards, -5.0))
            if several:
                bias = f"{more.format('the criterion')}: bias"
                found.append(Assumption(CRITERION_DIFFERENCE, -0.4, bias, -5.0))
                found += self._each(OWN_CRITERION, own)
            found.append(Assumption("criterion_sd", 0.4, "of the criterion between participants"))
        if plan.interaction is not None:
            at = f"value of {plan.interaction}"
            subject = "that difference" if several else "d'"
            what = f"what {subject} has more at the last {at} than at the first, others between"
            own = f"deviation of d' of a person{' and of a scene' * scenes} at one {at}"
            found += [Assumption(INTERACTION, 0.5, what, -10.0)]
            found += [Assumption(INTERACTION_SD, 0.2, own)]
            value = pd.factorize(self.cells[plan.interaction], sort=True)[0]
            self._along = value / max(value.max(), 1) - 0.5
            person = codes_of(self._number, value)
            self._at = (person, *[codes_of(self.cells["scene"], person)] * scenes)
        self.assumptions = (*found, *(self.with_times() if self._timed else ()))

    def draw(
        self, assumed: Mapping[str, float], studies: int, people: int, rng: Generator
    ) -> SimulatedAnswers:
        """Draw right answers, or in yes-no tasks the signal's answer."""
        persons = studies, people
        # The first condition that holds the signal is the one whose d' is assumed.
        differing = self._told & (np.arange(self._told.size) != np.argmax(self._told))
        more = self._more(assumed, OWN, "difference") * differing
        d = (
            assumed["d_prime"]
            + more[self._number]
            + assumed.get("slope", 0.0) * (self._place - 0.5)
        )
        d = d + self._effects(assumed, "participant_sd", persons, rng)
        d = d + self._effects(assumed, "scene_sd", (studies, 1), rng)
        if self.plan.interaction is not None:
            changing = differing | (differing.size == 1)
            d = d + assumed[INTERACTION] * self._along * changing[self._number]
            for units, own in zip((persons, (studies, 1)), self._at, strict=False):
                d = d + assumed[INTERACTION_SD] * crossed_effects(rng, units, own, own, 1.0)
        if self.share is None:
            bias = self._more(assumed, OWN_CRITERION, CRITERION_DIFFERENCE) * differing
            criterion = assumed["criterion"] + bias[self._number]
            criterion = criterion + self._effects(assumed, "criterion_sd", persons, rng)
            # The criterion 0 lies midway between noise and signal of a condition; where
            # conditions share noise, midway between it and the baseline's signal.
            shared = self._there * d - 0.5 * assumed["d_prime"]
            chance = ndtr((shared if not self._told.all() else (self._there - 0.5) * d) - criterion)
        else:
            chance = self.share(d)
        return SimulatedAnswers(
            rng.random((self.repeats, *d.shape), dtype=np.float32) < chance, self.cells
        )

    def notes(self, assumed: Mapping[str, float]) -> list[str]:
        """Return notes on the power of an interaction."""
        note = f"interaction: its power rests on {INTERACTION_SD}; 0 promises most"
        return [*super().notes(assumed), *[note] * (INTERACTION in assumed)]

    def table(self, answers: SimulatedAnswers) -> pd.DataFrame:
        """Return decisions; who is wrong gives any of the other answers."""
        rows, event = answers.rows()
        known, expected = np.array(self.plan.answers), rows["expected"]
        if self.share is None:
            rows["answer"] = np.where(event, known[0], known[1])
        else:
            step = 1 + rows["order"].to_numpy() % (len(known) - 1)
            other = known[(expected.map(list(known).index) + step) % len(known)]
            rows["answer"] = np.where(event, expected, other)
        return prepared(rows.assign(correct=(rows["answer"] == expected).astype(int)), self.plan)

    def from_pilot(self, decisions: pd.DataFrame, plan: RatePlan) -> Found:
        """Return the deviations of d' between a pilot's participants, and scenes."""
        _same_levels(self.plan, plan)
        found = sensitivity_deviations(decisions, plan, self.share)
        rows = prepared(decisions, plan)
        return time_deviations(found, rows, plan) if self.timed else found


class Tracks(_Conditions[RatePlan]):
    """Thresholds of levels that are chosen from the answers, as shares of the levels' range."""

    def __init__(self, study: StudyProtocol, plan: RatePlan, parts: Sequence[AnyPart]) -> None:
        super().__init__(study, plan, parts, plan.values[0])
        rule = study.task.adaptation
        if not isinstance(rule, AdaptiveLevels):
            raise StudyError(f"task.adaptive: no simulation of power is known for {rule!r}")
        if len(self.names) < 2:
            raise StudyError(
                f"analysis.by: {plan.by_name!r} must have two values, or there is no difference of"
                " thresholds to find"
            )
        self.cells = pd.DataFrame({"condition": self.names, "scene": ""})
        self._rule, self._levels = rule, rule.levels(study.task, study.pool)
        trials = rule.trials_of(study.task, study.pool)
        self._averaged = max(1, trials // (rule.trials * len(self.names)))
        self._errors: dict[tuple[float, float], Floats] = {}
        share = "as a share of that range"
        width = f"of the psychometric function, {share}"
        self.assumptions = (
            Assumption("difference", 0.1, "between thresholds, as a share of the range of levels"),
            Assumption("width", 0.5, width, 0.01),
            Assumption("participant_sd", 0.15, f"of thresholds, {share}"),
            Assumption("interaction_sd", 0.07, "of a participant's deviation in a condition"),
        )

    def draw(
        self, assumed: Mapping[str, float], studies: int, people: int, rng: Generator
    ) -> SimulatedAnswers:
        """Draw thresholds, as exact as the study's own rule makes them."""
        key = assumed["width"], assumed["participant_sd"]
        if key not in self._errors:
            self._errors[key] = self._track_errors(*key, rng)
        shape = (studies, people, len(self.cells))
        found = assumed["participant_sd"] * rng.standard_normal((studies, people, 1))
        found = found + assumed["interaction_sd"] * rng.standard_normal(shape)
        found += rng.choice(self._errors[key], shape)
        found[..., 1:] += assumed["difference"]
        return SimulatedAnswers(found[None], self.cells)

    def _track_errors(self, wide: float, participant_sd: float, rng: Generator) -> Floats:
        """Return estimated minus true thresholds of a condition's tracks.

        The study's own rule chooses levels for simulated observers. A threshold is the most likely
        one where width, guess and lapse rate are known; tracks of one condition are averaged.
        """
        levels, plan = self._levels, self.plan
        low, span = float(levels[0]), float(np.ptp(levels))
        width = -wide if plan.falling else wide
        candidates = np.linspace(-0.5, 1.5, 401)

        def chance(place: float, threshold: Floats | float) -> Floats:
            rise = sigmoid(np.asarray(place - np.asarray(threshold)), 0.0, width, "gauss")
            return np.asarray(plan.chance + (1.0 - plan.chance - LAPSE) * rise)

        errors = []
        for _ in range(TRACKS):
            true = 0.5 + participant_sd * float(rng.standard_normal())
            history: list[tuple[float, bool]] = []
            likelihood = np.zeros(candidates.size)
            for _ in range(self._rule.trials):
                level = self._rule.next_level(levels, history)
                place = (level - low) / span
                right = bool(rng.random() < float(chance(place, true)))
                history.append((level, right))
                share = chance(place, candidates)
                likelihood += np.log(share if right else 1.0 - share)
            best = np.argmax(likelihood >= likelihood.max() - ROUNDING)
            errors.append(float(candidates[best]) - true)
        return np.array(errors) / float(np.sqrt(self._averaged))

    def table(self, _answers: SimulatedAnswers) -> pd.DataFrame:
        """Refuse: a track's answers are not drawn in each study."""
        raise StudyError("levels are chosen from the answers, of which only thresholds are drawn")

    def notes(self, _assumed: Mapping[str, float]) -> list[str]:
        """Return notes on how thresholds were drawn."""
        return [
            f"a track's threshold is as exact as {TRACKS} simulated tracks of the study's own rule;"
            " thresholds are compared by paired t tests, not by the report's mixed model; the"
            " observers' psychometric functions are cumulative normal distributions"
        ]

    def from_pilot(self, decisions: pd.DataFrame, plan: RatePlan) -> Found:
        """Return the deviation of thresholds between a pilot's participants."""
        _same_levels(self.plan, plan)
        return threshold_deviations(decisions, plan, float(np.ptp(self._levels)))


def _same_levels(own: RatePlan, pilots: RatePlan) -> None:
    if own.adaptive != pilots.adaptive:
        raise StudyError(
            "--from: must hold levels chosen as the study chooses them"
            f" ({'adaptive' if own.adaptive else 'constant'}); give deviations by --set"
        )


class RatedSteps(_Conditions[RatingPlan]):
    """Ratings: places of conditions on a latent axis that thresholds cut.

    Where conditions are nowhere different, all steps of the scale are given equally often.
    """

    def __init__(self, study: StudyProtocol, plan: RatingPlan, parts: Sequence[AnyPart]) -> None:
        super().__init__(study, plan, parts, plan.reference_in(()))
        unit = "SD of a rating" if plan.link == "probit" else "logits"
        more = "every other condition has more"
        if plan.baseline is None:
            more = "each condition has more than the one before"
        self.assumptions = (
            Assumption("difference", 0.5, f"what {more}, {unit}", -10.0),
            *self._each(OWN, "the same of {} alone"),
            Assumption("participant_sd", 0.5, "between participants, in the same unit"),
            Assumption("scene_sd", 0.3, "between scenes, in the same unit"),
            *(self.with_times() if self._timed else ()),
        )

    def draw(
        self, assumed: Mapping[str, float], studies: int, people: int, rng: Generator
    ) -> SimulatedAnswers:
        """Draw the steps that are given."""
        more = self._more(assumed, OWN, "difference")
        more = np.cumsum(more) if self.plan.baseline is None else more
        latent = (more - more.mean())[self._number]
        latent = latent + self._effects(assumed, "participant_sd", (studies, people), rng)
        latent = latent + self._effects(assumed, "scene_sd", (studies, 1), rng)
        shape, probit = (self.repeats, studies, people, len(self.cells)), self.plan.link == "probit"
        noise = rng.standard_normal(shape) if probit else rng.logistic(size=shape)
        spread = np.hypot(assumed["participant_sd"], assumed["scene_sd"])
        spread = np.hypot(spread, 1.0 if probit else np.pi / np.sqrt(3.0))
        edges = spread * ndtri(np.linspace(0.0, 1.0, len(self.plan.scale) + 1)[1:-1])
        return SimulatedAnswers(np.digitize(latent + noise, edges), self.cells)

    def table(self, answers: SimulatedAnswers) -> pd.DataFrame:
        """Return ratings."""
        rows, step = answers.rows()
        return rows.assign(rating=np.array(self.plan.scale)[step])

    def notes(self, assumed: Mapping[str, float]) -> list[str]:
        """Return notes on the test that compared ratings."""
        return [
            *super().notes(assumed),
            "ratings are compared by analysis of variance of normal scores, not by the report's"
            " mixed model, which takes seconds a study",
        ]

    def from_pilot(self, decisions: pd.DataFrame, plan: RatingPlan) -> Found:
        """Return the deviations of the model of a pilot's ratings."""
        found = rating_deviations(decisions, plan)
        return time_deviations(found, decisions, plan) if self.timed else found
