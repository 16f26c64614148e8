"""How many participants does a study of right answers need? Simulation of its cells and test."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.clustered import holm
from analysis.plans.rates import RateSettings, by_columns, combined
from analysis.power import (
    Power,
    default_participants,
    errs_too_often,
    few_scenes,
    numbers_needed,
)
from analysis.psychometric import sigmoid
from analysis.rates import Influence, contrasts, share_influence, share_limits
from analysis.tasks.base import Assumption, Counted, PowerReport
from protocols.adaptive.section import AdaptiveLevels
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.tasks.base import Cell

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STUDIES = 400
SIZES = 6
"""How many numbers of participants a curve shows; each costs as much as the others."""

COMMON = 0.5
"""Share of the variance between participants, and scenes, that all conditions have in common."""

OWN = "difference."
"""Before a condition: what it alone has more than the baseline."""

OWN_CRITERION = "criterion."
"""Before a condition: what its criterion alone has more than the baseline's."""

CRITERION_DIFFERENCE = "criterion_difference"

LAPSE = 0.02
TRACKS = 60
"""Adaptive tracks that are run to see how exact they are."""


@dataclass(frozen=True)
class CellDesign:
    """What one participant meets, cell by cell.

    Attributes
    ----------
    conditions : tuple of str
        The baseline first.
    condition, scene : ndarray (cells,)
        Numbers of conditions and scenes.
    place : ndarray (cells,)
        Where the cell's level lies: 0 at the level where answers are worst, 1 at the best.
    signal : ndarray (cells,) of bool
        The right answer is the task's first.
    by_scene : bool
        The test respects scenes.
    """

    conditions: tuple[str, ...]
    condition: Ints
    scene: Ints
    place: Floats
    signal: NDArray[np.bool_]
    repeats: int
    by_scene: bool

    @property
    def noise_only(self) -> tuple[int, ...]:
        """Conditions that never hold the signal, where others always do and share its noise."""
        numbers = range(len(self.conditions))
        held = [self.signal[self.condition == k] for k in numbers]
        lacking = any(one.all() for one in held)
        return tuple(k for k in numbers if lacking and not held[k].any())

    @property
    def sensed(self) -> tuple[int, ...]:
        """Conditions that have a d' of yes and no: signal, and noise of their own or shared."""
        return tuple(
            k
            for k in range(len(self.conditions))
            if self.signal[self.condition == k].any()
            and (self.noise_only or not self.signal[self.condition == k].all())
        )

    def grid(self, counts: Floats, chosen: NDArray[np.bool_]) -> Floats:
        """Sum counts (participants, cells) of chosen cells into (participants, scenes)."""
        scene = self.scene if self.by_scene else 0 * self.scene
        where = np.zeros((scene.size, int(scene.max()) + 1))
        where[np.arange(scene.size), scene] = chosen
        return np.asarray(counts @ where)


Draw = Callable[[Floats, Floats, CellDesign, float], Floats]
"""From d' and criterion (participants, cells), the design, and d' of the typical participant to the
baseline, to the chance of the event that a task counts: an answer that is right, or in yes-no tasks
the signal's answer."""
Judge = Callable[[Floats, CellDesign, Sequence[int], RateSettings], Floats]
"""From events (participants, cells) to p (numbers of participants, comparisons)."""


@dataclass(frozen=True)
class RatePower(Power):
    """Power by number of participants; false positives are of any comparison.

    Attributes
    ----------
    also : mapping
        Power of a further measure, and its false positives, by what they are called.
    """

    also: Mapping[str, Floats]


def assumptions(settings: RateSettings, scenes: int) -> tuple[Assumption, ...]:
    """Return what a simulation takes for true, with values of ordinary studies."""
    several = len(settings.values) > 1
    if settings.adaptive:
        return (
            Assumption("difference", 0.1, "between thresholds, as a share of the range of levels"),
            Assumption(
                "width", 0.5, "of the psychometric function, as a share of that range", 0.01
            ),
            Assumption("participant_sd", 0.15, "of thresholds, as a share of that range"),
            Assumption("interaction_sd", 0.07, "of a participant's deviation in a condition"),
        )
    found = [
        Assumption("d_prime", 1.0, "sensitivity to the baseline, of the typical participant"),
        *(
            [Assumption("difference", 0.5, "what d' of every other condition has more", -10.0)]
            if several
            else []
        ),
        *(
            Assumption(f"{OWN}{name}", np.nan, f"the same of {settings.label(name)} alone", -10.0)
            for name in settings.values[1:]
        ),
        Assumption("participant_sd", 0.4, "deviation of d' between participants"),
    ]
    if scenes > 1:
        found.append(Assumption("scene_sd", 0.2, "deviation of d' between scenes"))
    if settings.level is not None:
        found.append(Assumption("slope", 1.0, "how far d' rises over the range of levels"))
    if settings.kind == "detection":
        found.append(Assumption("criterion", 0.0, "towards no, in deviations of the noise", -5.0))
        if several:
            found.append(
                Assumption(
                    CRITERION_DIFFERENCE,
                    -0.4,
                    "what the criterion of every other condition has more: bias",
                    -5.0,
                )
            )
            found += [
                Assumption(
                    f"{OWN_CRITERION}{name}", np.nan, f"the same of {settings.label(name)}", -5.0
                )
                for name in settings.values[1:]
            ]
        found.append(Assumption("criterion_sd", 0.4, "of the criterion between participants"))
    return tuple(found)


def cell_design(cells: Sequence[Cell], settings: RateSettings, repeats: int) -> CellDesign:
    """Return the design of a study's cells.

    Raises
    ------
    StudyError
        If the study shows nothing.
    """
    if not cells:
        raise StudyError("task: must show at least one condition (there is no stimulus for it)")
    conditions = [cell.arrangements[0].condition for cell in cells]
    columns = by_columns(settings.by)
    names = [combined(one.get(column) for column in columns) for one in conditions]
    levels = np.array([_number(one.get(settings.level or "")) for one in conditions])
    span = float(np.ptp(levels)) or 1.0
    place = (levels - levels.min()) / span if settings.level is not None else 0.5 + 0.0 * levels
    scenes = [cell.scene for cell in cells]
    known = {name: number for number, name in enumerate(dict.fromkeys(scenes))}
    first = settings.answers[0]
    return CellDesign(
        conditions=settings.values,
        condition=np.array([settings.values.index(name) for name in names], dtype=np.int64),
        scene=np.array([known[scene] for scene in scenes], dtype=np.int64),
        place=1.0 - place if settings.falling else place,
        signal=np.array([cell.arrangements[0].correct == first for cell in cells]),
        repeats=repeats,
        by_scene=settings.test == "participant-scene",
    )


def rate_power(
    study: StudyProtocol,
    settings: RateSettings,
    assumed: Mapping[str, float],
    draw: Draw,
    judge: Judge,
    *,
    beside: tuple[str, Judge] | None = None,
    rng: np.random.Generator,
    studies: int | None = None,
    progress: Counted | None = None,
) -> PowerReport:
    """Simulate a study and its planned test for growing numbers of participants.

    Every simulated study is analysed at all numbers of participants: its first n people are a
    study of n. `beside` is a further measure's name and test of all conditions against the first,
    corrected by itself; its power is that of the conditions that the main test compares.

    Raises
    ------
    StudyError
        If levels adapt and only one condition is shown: there is nothing to compare.
    """
    assumed = {name: value for name, value in assumed.items() if not np.isnan(value)}
    sizes = _thinned(default_participants(settings.planned_participants), settings)
    count = studies or STUDIES
    notes = []
    further = None if settings.adaptive or len(settings.values) < 2 else beside
    if settings.adaptive:
        tracked = _adaptive_studies(study, settings, assumed, sizes, rng)

        def simulate(null: bool) -> tuple[Floats, ...]:
            return (tracked(null),)

        notes.append(
            f"a track's threshold is as exact as {TRACKS} simulated tracks of the study's own rule;"
            " thresholds are compared by paired t tests, not by the report's mixed model; the"
            " observers' psychometric functions are cumulative normal distributions"
        )
    else:
        design = cell_design(study.task.cells(study.pool), settings, study.design.repeats)
        scenes, scene_sd = np.unique(design.scene).size, assumed.get("scene_sd", 0.0)
        notes += few_scenes(scenes, scene_sd, claimed=design.by_scene)

        def simulate(null: bool) -> tuple[Floats, ...]:
            values = {**assumed, **(_nothing(settings, assumed) if null else {})}
            events = _events(design, values, sizes[-1], draw, rng)
            judges = (judge,) if further is None else (judge, further[1])
            return tuple(one(events, design, sizes, settings) for one in judges)

        if 0 not in design.sensed:
            further = None  # the baseline holds no signal: shares differ by what is shown

    sums = np.zeros((3, len(sizes)))
    alone: Floats = np.zeros(0)
    also: Floats = np.zeros((3, len(sizes)))
    comparisons = 0
    for number in range(count):
        judged = [_significant(p, settings) for p in simulate(False)]
        nothing = [_significant(p, settings) for p in simulate(True)]
        significant = judged[0]
        comparisons = significant.shape[1]
        alone = significant.astype(float) + (alone if alone.size else 0.0)
        sums += _counted(significant, nothing[0])
        if further is not None:
            compared = [k - 1 for k in design.sensed[1:]]
            also += _counted(judged[1][:, compared], nothing[1][:, compared])
        if progress:
            progress(number + 1, count)
    each, every, wrong = sums / count
    errs = errs_too_often(sizes, wrong, settings.alpha, count)
    notes += errs
    curves = (
        {"a comparison": each, "every comparison": every}
        if comparisons > 1
        else {"the comparison" if len(settings.values) > 1 else "better than chance": each}
    )
    own = any(name.startswith(OWN) for name in assumed)
    if own and not settings.adaptive and comparisons > 1:
        tested = design.sensed if settings.kind == "detection" else range(len(settings.values))
        names = [settings.label(settings.values[k]) for k in tested][1:]
        curves = {**dict(zip(names, (alone / count).T, strict=True)), **curves}
    extra: dict[str, Floats] = {}
    if further is not None:
        said = ["a comparison", "every comparison"] if comparisons > 1 else ["the comparison"]
        extra = {
            f"{further[0]}: {name}": one for name, one in zip(said, also / count, strict=False)
        }
    found = RatePower(
        participants=sizes,
        each=each,
        every=every,
        false_positives=wrong,
        comparisons=comparisons if len(settings.values) > 1 else 0,
        needed=numbers_needed(sizes, {**curves, **extra}, errs=errs),
        studies=count,
        assumptions=dict(assumed),
        alpha=settings.alpha,
        planned=settings.planned_participants,
        warnings=tuple(notes),
        also=extra
        if further is None
        else {**extra, f"{further[0]}: false positives": also[2] / count},
    )
    return _report(found, curves)


def looked_p_values(
    study: StudyProtocol,
    settings: RateSettings,
    assumed: Mapping[str, float],
    participants: Sequence[int],
    draw: Draw,
    judge: Judge,
    *,
    null: bool,
    rng: np.random.Generator,
    studies: int,
    progress: Counted | None = None,
) -> Floats:
    """Return the least adjusted p of the planned comparisons (studies, numbers of participants).

    Raises
    ------
    StudyError
        If levels adapt and only one condition is shown.
    """
    if settings.adaptive:
        simulate = _adaptive_studies(study, settings, assumed, participants, rng)
    else:
        design = cell_design(study.task.cells(study.pool), settings, study.design.repeats)
        values = {**assumed, **(_nothing(settings, assumed) if null else {})}

        def simulate(_null: bool) -> Floats:
            events = _events(design, values, participants[-1], draw, rng)
            return judge(events, design, participants, settings)

    found = []
    for number in range(studies):
        p = simulate(null)
        found.append((holm(p) if settings.correction == "holm" else p).min(axis=-1))
        if progress:
            progress(number + 1, studies)
    return np.array(found)


def tabulated(share: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    """Return a function of d' that looks its values up; d' below 0 counts as 0."""
    d_prime = np.linspace(0.0, 12.0, 2401)
    values = share(d_prime)
    return lambda found: np.interp(found, d_prime, values)


def judge_shares(
    events: Floats, design: CellDesign, sizes: Sequence[int], settings: RateSettings
) -> Floats:
    """Test shares of right answers against the baseline's, or a single one against chance."""
    right, shown = _grids(events, design)

    def compare(people: int) -> list[float]:
        if len(design.conditions) == 1:
            _, _, p = share_limits(right[0][:people], shown[0][:people], chance=settings.chance)
            return [float(p)]
        moved = {
            name: share_influence(right[k][:people], shown[k][:people])
            for k, name in enumerate(design.conditions)
        }
        return _p_values("share correct", moved)

    return np.array([compare(people) for people in sizes])


def _p_values(measure: str, moved: dict[str, Influence]) -> list[float]:
    return [one.p for one in contrasts(measure, moved, reference=next(iter(moved)))]


def compare_influences(
    measure: str, moved_of: Callable[[int], dict[str, Influence]], sizes: Sequence[int]
) -> Floats:
    """Test conditions against the first, or a single one against 0, at each number of people."""

    def compare(people: int) -> list[float]:
        moved = moved_of(people)
        if len(moved) == 1:
            (only,) = moved.values()
            return [float(only.estimate().p_value())]
        return _p_values(measure, moved)

    return np.array([compare(people) for people in sizes])


def _grids(events: Floats, design: CellDesign) -> tuple[list[Floats], list[Floats]]:
    """Return events and trials (participants, scenes) of each condition."""
    shown = np.full(events.shape, float(design.repeats))
    chosen = [design.condition == k for k in range(len(design.conditions))]
    return [design.grid(events, one) for one in chosen], [design.grid(shown, one) for one in chosen]


def _events(
    design: CellDesign,
    assumed: Mapping[str, float],
    people: int,
    draw: Draw,
    rng: np.random.Generator,
) -> Floats:
    """Draw how often the event happens (participants, cells)."""
    conditions, scenes = len(design.conditions), int(design.scene.max()) + 1
    yes_no_noise = design.noise_only if "criterion" in assumed else ()

    def effects(units: int, sd: float) -> Floats:
        shared = rng.standard_normal((units, 1))
        own = rng.standard_normal((units, conditions))
        return np.asarray(sd * (np.sqrt(COMMON) * shared + np.sqrt(1.0 - COMMON) * own))

    typical = np.full(design.condition.size, assumed["d_prime"])
    compared = [k for k in range(conditions) if k not in yes_no_noise]
    for k, name in enumerate(design.conditions[1:], 1):
        more = assumed.get(OWN + name, assumed.get("difference", 0.0))
        typical += more * ((design.condition == k) & (k != compared[0]))
    typical += assumed.get("slope", 0.0) * (design.place - 0.5)
    d = typical + effects(people, assumed["participant_sd"])[:, design.condition]
    d = d + effects(scenes, assumed.get("scene_sd", 0.0))[design.scene, design.condition]
    criterion = np.full(d.shape, assumed.get("criterion", 0.0))
    for k, name in enumerate(design.conditions[1:], 1):
        if k in compared:
            more = assumed.get(OWN_CRITERION + name, assumed.get(CRITERION_DIFFERENCE, 0.0))
            criterion += more * ((design.condition == k) & (k != compared[0]))
    criterion += effects(people, assumed.get("criterion_sd", 0.0))[:, design.condition]
    chance = draw(d, criterion, design, assumed["d_prime"])
    return rng.binomial(design.repeats, chance).astype(np.float64)


def _counted(significant: NDArray[np.bool_], null: NDArray[np.bool_]) -> Floats:
    """Of one study: the share found, whether all were, and whether any would be in another."""
    found = (significant.mean(axis=1), significant.all(axis=1), null.any(axis=1))
    return np.asarray(found, np.float64)


def _significant(p_values: Floats, settings: RateSettings) -> NDArray[np.bool_]:
    adjusted = holm(p_values) if settings.correction == "holm" else p_values
    return np.asarray(adjusted < settings.alpha)


def _nothing(settings: RateSettings, assumed: Mapping[str, float]) -> dict[str, float]:
    """Return the assumptions that hold where there is nothing to find."""
    if len(settings.values) > 1:
        return {
            name: 0.0
            for name in assumed
            if name in ("difference", CRITERION_DIFFERENCE) or name.startswith((OWN, OWN_CRITERION))
        }
    return {"d_prime": 0.0, "slope": 0.0, "participant_sd": 0.0, "scene_sd": 0.0}


def _thinned(sizes: Sequence[int], settings: RateSettings) -> tuple[int, ...]:
    """Return a few of the numbers of participants, the planned one among them."""
    places = np.unique(np.linspace(0, len(sizes) - 1, SIZES).round().astype(int))
    planned = settings.planned_participants
    wanted = {sizes[place] for place in places} | ({planned} if planned and planned > 1 else set())
    return tuple(sorted(wanted))


def _adaptive_studies(
    study: StudyProtocol,
    settings: RateSettings,
    assumed: Mapping[str, float],
    sizes: Sequence[int],
    rng: np.random.Generator,
) -> Callable[[bool], Floats]:
    """Return a function that simulates one study of thresholds, with or without a difference."""
    conditions = len(settings.values)
    if conditions < 2:
        raise StudyError(
            f"analysis.by: {settings.by!r} must have two values, or there is no difference of"
            " thresholds to find"
        )
    errors = _track_errors(study, settings, assumed, rng)

    def simulate(null: bool) -> Floats:
        people = sizes[-1]
        own = assumed["participant_sd"] * rng.standard_normal((people, 1))
        own = own + assumed["interaction_sd"] * rng.standard_normal((people, conditions))
        found = own + rng.choice(errors, (people, conditions))
        found[:, 1:] += 0.0 if null else assumed["difference"]
        gaps = found[:, 1:] - found[:, :1]
        p = [stats.ttest_1samp(gaps[:n], 0.0, axis=0).pvalue for n in sizes]
        return np.array(p)

    return simulate


def _track_errors(
    study: StudyProtocol,
    settings: RateSettings,
    assumed: Mapping[str, float],
    rng: np.random.Generator,
) -> Floats:
    """Return estimated minus true thresholds of a condition's tracks, as shares of the range.

    The study's own rule chooses levels for simulated observers. A threshold is the most likely one
    where width, guess and lapse rate are known; tracks of one condition are averaged.
    """
    rule = study.task.adaptation
    if not isinstance(rule, AdaptiveLevels):
        raise StudyError(f"task.adaptive: no simulation of power is known for {rule!r}")
    levels = rule.levels(study.task, study.pool)
    low, span = float(levels[0]), float(np.ptp(levels))
    width = (-1.0 if settings.falling else 1.0) * assumed["width"]
    candidates = np.linspace(-0.5, 1.5, 401)

    def chance(place: Floats | float, threshold: Floats | float) -> Floats:
        rise = sigmoid(np.asarray(place - np.asarray(threshold)), 0.0, width, "gauss")
        return np.asarray(settings.chance + (1.0 - settings.chance - LAPSE) * rise)

    errors = []
    for _ in range(TRACKS):
        true = 0.5 + assumed["participant_sd"] * float(rng.standard_normal())
        history: list[tuple[float, bool]] = []
        likelihood = np.zeros(candidates.size)
        for _ in range(rule.trials):
            level = rule.next_level(levels, history)
            place = (level - low) / span
            right = bool(rng.random() < float(chance(place, true)))
            history.append((level, right))
            share = chance(place, candidates)
            likelihood += np.log(share if right else 1.0 - share)
        errors.append(float(candidates[int(np.argmax(likelihood))]) - true)
    each = max(1, rule.trials_of(study.task, study.pool) // (rule.trials * len(settings.values)))
    return np.array(errors) / float(np.sqrt(each))


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _report(found: RatePower, curves: Mapping[str, Floats]) -> PowerReport:
    several = found.comparisons > 1
    legend = (
        "a comparison: one with the baseline is significant, on average, after correction; every"
        " comparison: all are; "
    ) * several
    return found.report(
        {**curves, "false positives": found.false_positives, **found.also},
        {**curves, **{name: one for name, one in found.also.items() if "false" not in name}},
        taken=", ".join(f"{name} {value:g}" for name, value in found.assumptions.items()),
        tested=(
            f"{found.comparisons} comparison{'s' * several} with the baseline"
            if found.comparisons
            else "one condition against chance"
        ),
        legend=legend
        + "false positives: were there nothing to find, any test is significant all the same. Other"
        " numbers of participants were not tried",
    )
