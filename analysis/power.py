"""Power of a study by number of participants: answers are drawn, and planned tests made."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from typing import Any, ClassVar, Generic, TypeAlias, TypeVar

import numpy as np
import pandas as pd
import scipy

from analysis import SEED
from analysis.answers import SimulatedAnswers, codes_of, crossed_effects
from analysis.arrays import Bools, Floats
from analysis.models.numeric import ROUNDING
from analysis.parts import EQUIVALENCE, AnalysisPlan, AnyPart, Part, Tests, computed, with_added
from analysis.plans.rate_plan import RatePlan
from analysis.power_curves import DesignPower, Power
from analysis.showable import FamilyOfTests, limits_of_design
from protocols.errors import StudyError, count_of

OnCount = Callable[[int, int], None]
S = TypeVar("S", bound=AnalysisPlan)

COMMON = 0.5
"""Share of the variance between participants, and scenes, that all conditions have in common."""
SIZES = 6
"""Number of points of a power curve where each costs as much as the others."""
BY_TABLE = 100
"""Studies that are simulated where a part is asked about the table of each."""
CANNOT_SHOW = 0.5
"""Below this chance of showing what is true, a study had better not promise it."""

DESIGN_STUDIES = 1000
SCENES_SHOWN = (2, 4, 6, 8, 12, 16, 24)
REPEATS_SHOWN = (1, 2, 4)
"""Numbers of scenes and of repeats that are simulated beside the study's own."""


@dataclass(frozen=True)
class Assumption:
    """A number that a simulation of power takes for true, within limits."""

    name: str
    value: float
    """Not a number: left out, unless it is asked for."""
    meaning: str
    lowest: float = 0.0
    highest: float = float("inf")


TIMES = (
    Assumption("rt_ratio", 1.1, "how many times as long answers take in {}", 0.01, 100.0),
    Assumption("rt_participant_sd", 0.2, "deviation of ln s between participants"),
    Assumption("rt_scene_sd", 0.1, "deviation of ln s between scenes"),
    Assumption("rt_sd", 0.4, "deviation of ln s between a participant's answers", 1e-6),
)
"""Assumptions about reaction times, where a study tests them."""


class PowerSimulation(ABC, Generic[S]):
    """A study's design, how participants answer in it, and the parts that test the answers.

    `cells` has a row for each cell that a participant meets `repeats` times; its ``condition``
    names what is compared, of which `names` has the baseline first. `planned` is the study's
    number of participants.
    """

    studies: ClassVar[int] = 400
    """Number of simulated studies, which take seconds."""
    at_once: ClassVar[int] = 20
    """Studies drawn together; bounds memory."""
    against = ""
    """Condition that the others are compared with."""
    chance_alone = False
    """A single condition is tested against chance."""
    assumptions: tuple[Assumption, ...]
    """Assumptions of the simulation, with values that fit the study."""

    def __init__(
        self,
        plan: S,
        parts: Sequence[AnyPart],
        cells: pd.DataFrame,
        repeats: int,
        planned: int | None,
    ) -> None:
        self.plan, self.parts, self.cells = plan, tuple(parts), cells
        self.repeats, self.planned = repeats, planned
        known = plan.in_order(list(dict.fromkeys(cells.get("condition", ()))))
        baseline = plan.reference_in(known)
        self.names = sorted(known, key=lambda name: baseline not in (None, name))
        number = self.cells.get("condition", pd.Series(dtype=object)).map(self.names.index)
        self._number = number.to_numpy(dtype=np.int64)
        self.timed: tuple[Assumption, ...] = ()

    @abstractmethod
    def draw(
        self, assumed: Mapping[str, float], studies: int, people: int, rng: np.random.Generator
    ) -> SimulatedAnswers:
        """Draw the answers of participants who differ, about scenes that differ."""

    @abstractmethod
    def nothing(self, assumed: Mapping[str, float]) -> dict[str, float]:
        """Return the same assumptions with nothing to find."""

    @abstractmethod
    def table(self, answers: SimulatedAnswers) -> pd.DataFrame:
        """Return the answers of the first study as the parts take them.

        Raises
        ------
        StudyError
            If answers were not drawn trial by trial.
        """

    @abstractmethod
    def from_pilot(
        self, decisions: pd.DataFrame, plan: S
    ) -> tuple[Mapping[str, float], Sequence[str]]:
        """Return assumptions by name, as a pilot's decisions have them, and notes on them.

        Parameters
        ----------
        plan
            Of the pilot, which may be a table of another study.

        Raises
        ------
        StudyError
            If they cannot be had from such decisions.
        """

    def with_times(self) -> tuple[Assumption, ...]:
        """Draw times too, whose differences between conditions are tested; return what is assumed.

        Nothing where a single condition is shown.
        """
        if len(self.names) > 1:
            first = self.plan.reference_in(self.names) is not None
            which = "every other condition" if first else "each condition after the one before"
            self.timed = tuple(replace(a, meaning=a.meaning.format(which)) for a in TIMES)
        return self.timed

    def drawn(
        self, assumed: Mapping[str, float], studies: int, people: int, rng: np.random.Generator
    ) -> SimulatedAnswers:
        """Draw answers, and how long they took where the study tests that."""
        answers = self.draw(assumed, studies, people, rng)
        if not self.timed:
            return answers
        number, scene = self._number, codes_of(self.cells["scene"])
        several = self.plan.reference_in(self.names) is None
        times = np.log(assumed["rt_ratio"]) * (number if several else number > 0)
        for name, units, whole in (
            ("rt_participant_sd", (studies, people), np.zeros_like(number)),
            ("rt_scene_sd", (studies, 1), scene),
        ):
            own = codes_of(whole, number)
            times = times + assumed[name] * crossed_effects(rng, units, whole, own, COMMON)
        shape = (self.repeats, studies, people, number.size)
        noise = assumed["rt_sd"] * rng.standard_normal(shape, dtype=np.float32)
        return replace(answers, times=times + noise)

    def families(self) -> tuple[FamilyOfTests, ...]:
        """Return the families of tests that the study plans, that of the planned test first."""
        parts = with_added(self.parts)
        return tuple(one for part in parts for one in part.families(self.cells, self.plan))

    def participants(self) -> tuple[int, ...]:
        """Return the numbers of participants that a curve shows."""
        return thinned(default_participants(self.planned), self.planned)

    def deciding(self) -> "PowerSimulation[S]":
        """Return the simulation of what the planned test is about alone."""
        return self

    def resized(self, _scenes: int, _repeats: int) -> "PowerSimulation[S] | None":
        """Return that with other numbers of scenes and repeats, where they can be changed."""
        return None

    def singled_out(self, _assumed: Mapping[str, float]) -> Sequence[str]:
        """Return names of the comparisons, where what is assumed differs between them."""
        return ()

    def taken(self, assumed: Mapping[str, float]) -> str:
        """Return the assumptions, in words."""
        return ", ".join(f"{name} {value:g}" for name, value in assumed.items())

    def notes(self, _assumed: Mapping[str, float]) -> list[str]:
        """Return notes on such a simulation."""
        return []


AnySimulation: TypeAlias = PowerSimulation[Any]


def power(
    simulation: AnySimulation,
    assumed: Mapping[str, float],
    *,
    rng: np.random.Generator,
    participants: Sequence[int] | None = None,
    studies: int | None = None,
    designs: bool = False,
    progress: OnCount | None = None,
) -> Power:
    """Simulate a study's own design and planned tests for growing numbers of participants.

    Every simulated study is analysed at all numbers of participants: its first n people are a
    study of n. With `designs` other numbers of scenes and repeats are simulated too.

    Parameters
    ----------
    assumed : mapping
        Values of assumptions; of others their own.
    studies : int, optional
        How many to simulate; left out, as many as take seconds.

    Raises
    ------
    ValueError
        If an assumption is beyond its limits, or a number of participants below 2.
    """
    taken, plan, planned = _checked(simulation, assumed), simulation.plan, simulation.planned
    tables, notes = _by_table(simulation, taken)
    people = tuple(participants or simulation.participants())
    people = thinned(people, planned) if tables and participants is None else people
    if min(people) < 2:
        raise ValueError(f"participants must be at least 2 (got {min(people)})")
    count = studies or (BY_TABLE if tables else simulation.studies)
    batches = _batches(simulation, count, progress)
    found, wrong = _significant(simulation, taken, batches, people, rng, tables)
    first = next(iter(found))
    each = {name: one.mean(axis=(0, -1)) for name, one in found.items()}
    every = {name: one.all(axis=-1).mean(axis=0) for name, one in found.items()}
    curves = _curves(simulation, taken, found, each, every)
    titled = {
        f"{f'{_title(name)}: ' * (name != first)}false positives": one
        for name, one in wrong.items()
    }
    families = simulation.families()
    alone = families[0].uncorrected if families else ""
    errs = [
        note
        for name, one in wrong.items()
        for note in _errs_too_often(
            people, one, plan.alpha, count, _title(name) * (name != first), alone * (name == first)
        )
    ]
    by_means = (
        "reaction times are compared by analysis of variance of ln s, not by the report's mixed"
        " model, which takes longer"
    )
    by_shares = (
        "the study compares critical scalings, which take longer: power is that of differences of"
        " right answers over all scalings"
    )
    scaled = isinstance(plan, RatePlan) and plan.by_scaling
    instead = [*([by_means] if simulation.timed else []), *([by_shares] if scaled else [])]
    notes = [*simulation.notes(taken), *instead, *errs, *notes]
    scenes = simulation.cells["scene"].replace("", None).nunique()
    notes += limits_of_design(families, planned, plan.alpha, scenes, plan)
    if EQUIVALENCE in each:
        notes += _hardly_equivalent(simulation, people, each[EQUIVALENCE])
    needed = tuple(
        (name, goal, first_reaching(people, curve, goal))
        for name, curve in curves.items()
        for goal in (() if errs else (0.8, 0.9))
    )
    changed = _designs(simulation, taken, max(people), count, rng) if designs else ()
    family = found.get("", found[first])
    comparisons = 0 if simulation.chance_alone else family.shape[-1]
    tested = f"{count_of(comparisons, 'comparison')}{simulation.against}"
    numbers = {
        "participants": people,
        "planned": planned,
        "studies": count,
        "alpha": plan.alpha,
        **({"margin": plan.margin} if EQUIVALENCE in each else {}),
        "assumptions": taken,
        "comparisons": comparisons,
        "each": each.get("", each[first]),
        "every": every.get("", every[first]),
        "false_positives": wrong[first],
        **{name: each[name] for name in ("primary", EQUIVALENCE) if name in each},
        "also": {**curves, **titled},
        "designs": changed,
        "needed": needed,
        "warnings": notes,
    }
    lead = (
        f"{count} simulated studies; {simulation.taken(taken)}; alpha {plan.alpha:g},"
        f" {tested if comparisons else 'one condition against chance'}"
    )
    legend = _legend(simulation, found, people)
    return Power(
        people, planned, curves, titled, needed, changed, lead, legend, tuple(notes), numbers
    )


def _significant(
    simulation: AnySimulation,
    taken: Mapping[str, float],
    batches: Iterable[int],
    people: Sequence[int],
    rng: np.random.Generator,
    tables: Sequence[AnyPart],
) -> tuple[dict[str, Bools], dict[str, Floats]]:
    """Return the tests that are significant, and the share of studies with any wrong one."""
    alpha, nothing = simulation.plan.alpha, _nothing(simulation, taken)
    # A statistic of a lab may be about all that is shown, not the planned test's part of it.
    lab = len(with_added(simulation.parts)) > len(simulation.parts)
    deciding = simulation if lab or simulation.timed else simulation.deciding()
    yes: dict[str, list[Bools]] = {}
    no: dict[str, list[Bools]] = {}
    for batch in batches:
        true = _tests(simulation, taken, batch, people, rng, tables)
        null = _tests(deciding, nothing, batch, people, rng, tables)
        first = next(iter(true))
        for name in true:
            test = null[name] if name == EQUIVALENCE else true[name]
            yes.setdefault(name, []).append(test() < alpha)
            if name == first or name not in ("", EQUIVALENCE):
                no.setdefault(name, []).append(null[name]() < alpha)
    found = {name: np.concatenate(some) for name, some in yes.items()}
    wrong = {name: np.concatenate(some).any(axis=-1).mean(axis=0) for name, some in no.items()}
    return found, wrong


def _curves(
    simulation: AnySimulation,
    taken: Mapping[str, float],
    found: Mapping[str, Bools],
    each: Mapping[str, Floats],
    every: Mapping[str, Floats],
) -> dict[str, Floats]:
    """Return power by title: of each test, and of single comparisons where they differ."""
    first = next(iter(found))
    curves: dict[str, Floats] = {}
    for name, one in found.items():
        title = _title(name)
        if one.shape[-1] > 1:
            singled = () if name else simulation.singled_out(taken)
            curves |= dict(zip(singled, one.mean(axis=0).T, strict=False))
            before = f"{title}: " * bool(name)
            curves |= {
                f"{before}a comparison": each[name],
                f"{before}every comparison": every[name],
            }
        elif name == first or name:
            alone = "better than chance" if simulation.chance_alone else "the comparison"
            curves[title or alone] = each[name]
    return curves


def _hardly_equivalent(
    simulation: AnySimulation, people: Sequence[int], equal: Floats
) -> list[str]:
    """Say if a study could hardly show equivalence where there is nothing."""
    shown = equal[people.index(simulation.planned)] if simulation.planned in people else equal.max()
    if shown >= CANNOT_SHOW:
        return []
    return [
        f"equivalence within ±{simulation.plan.margin:g} would be shown in {shown:.2f} of such"
        " studies even if the share were one half: do not plan to claim it"
    ]


def planned_p_values(
    simulation: AnySimulation,
    assumed: Mapping[str, float],
    participants: Sequence[int],
    *,
    rng: np.random.Generator,
    studies: int,
) -> Floats:
    """Return p of the planned test (studies, numbers of participants); of several the least.

    The first n people of a study are a study of n.
    """
    taken, deciding = _checked(simulation, assumed), simulation.deciding()
    tables = _by_table(simulation, taken)[0]
    first = (
        next(iter(_tests(deciding, taken, batch, participants, rng, tables).values()))
        for batch in _batches(simulation, studies, None)
    )
    return np.concatenate([test().min(axis=-1) for test in first])


def _nothing(simulation: AnySimulation, assumed: Mapping[str, float]) -> dict[str, float]:
    """Return the same assumptions with nothing to find, in answers and in times."""
    return simulation.nothing(assumed) | ({"rt_ratio": 1.0} if simulation.timed else {})


def default_participants(planned: int | None) -> tuple[int, ...]:
    """Return the numbers of participants a curve shows: 4 to 40, wider for larger plans."""
    top = max(40, 2 * (planned or 0))
    step = max(1, top // 40)
    wanted = {*range(4, top, step), top, planned or top}
    return tuple(sorted(people for people in wanted if people > 1))


def thinned(people: Sequence[int], planned: int | None) -> tuple[int, ...]:
    """Return a few of the numbers of participants, the planned one among them."""
    places = np.unique(np.linspace(0, len(people) - 1, SIZES).round().astype(int))
    wanted = {people[place] for place in places} | ({planned} if planned and planned > 1 else set())
    return tuple(sorted(wanted))


def first_reaching(participants: Sequence[int], curve: Floats, goal: float) -> int | None:
    """Return the smallest number from which the smoothed, rising curve stays above `goal`."""
    rising = scipy.optimize.isotonic_regression(curve).x
    above = np.nonzero(rising >= goal - ROUNDING)[0]
    return int(participants[above[0]]) if above.size else None


def _checked(simulation: AnySimulation, assumed: Mapping[str, float]) -> dict[str, float]:
    """Return a value for every assumption that is made."""
    known = [one.name for one in simulation.assumptions]
    if unknown := sorted(set(assumed) - set(known)):
        raise ValueError(f"assumed must name some of {', '.join(known)} (got {', '.join(unknown)})")
    values = {one.name: assumed.get(one.name, one.value) for one in simulation.assumptions}
    for one in simulation.assumptions:
        if values[one.name] < one.lowest or values[one.name] > one.highest:
            raise ValueError(
                f"{one.name} must lie between {one.lowest:g} and {one.highest:g}"
                f" (got {values[one.name]:g})"
            )
    return {name: value for name, value in values.items() if not np.isnan(value)}


def _batches(simulation: AnySimulation, studies: int, progress: OnCount | None) -> Iterator[int]:
    for start, end in pairwise([*range(0, studies, simulation.at_once), studies]):
        yield end - start
        if progress:
            progress(end, studies)


def _tests(
    simulation: AnySimulation,
    assumed: Mapping[str, float],
    studies: int,
    people: Sequence[int],
    rng: np.random.Generator,
    tables: Sequence[AnyPart],
) -> Tests:
    """Draw studies; return their tests, the planned one first."""
    answers = simulation.drawn(assumed, studies, max(people), rng)
    found: dict[str, Callable[[], Floats]] = {}
    for part in with_added(simulation.parts):
        found |= part.planned_over(answers, people, simulation.plan)
    found |= {part.name: partial(_by_tables, simulation, answers, people, part) for part in tables}
    if not found:
        raise StudyError(f"{simulation.plan.study}: no statistic of its analysis plans a test")
    return found


def _by_tables(
    simulation: AnySimulation,
    answers: SimulatedAnswers,
    people: Sequence[int],
    part: AnyPart,
) -> Floats:
    """Return `planned_p` of a part (studies, numbers of participants, 1); NaN where it has none."""
    every = {one.name: one for one in with_added(simulation.parts)}
    wanted = [part.name]
    for name in wanted:
        wanted += [needed for needed in every[name].needs if needed in every]
    parts = [one for one in every.values() if one.name in wanted]

    def p_of(study: int, count: int) -> float:
        table = simulation.table(answers.of(study, count))
        try:
            numbers = computed(parts, table, simulation.plan)[0].get(part.name)
        except StudyError:  # such as answers that are all alike: nothing is found
            return np.nan
        p = None if numbers is None else part.planned_p(numbers, simulation.plan)
        return np.nan if p is None else p

    studies = range(answers.given.shape[1])
    return np.array([[[p_of(study, count)] for count in people] for study in studies])


def _by_table(
    simulation: AnySimulation, assumed: Mapping[str, float]
) -> tuple[list[AnyPart], list[str]]:
    """Return the parts that are asked about tables, and why others are not."""
    every, own = with_added(simulation.parts), {part.name for part in simulation.parts}
    asked = [part for part in every if _has(part, "planned_p") and not _has(part, "planned_over")]
    if any(_has(part, "planned_over") and not part.secondary for part in simulation.parts):
        asked = [part for part in asked if part.name not in own]
    kept, notes = [], []
    for part in asked:
        why = "answers are drawn without what it is about, such as reaction times"
        try:
            drawn = simulation.drawn(assumed, 1, 2, np.random.default_rng(SEED))
            if part.wanted(simulation.table(drawn), simulation.plan):
                kept.append(part)
                continue
        except StudyError as problem:
            why = str(problem)
        notes.append(f"the test of {_title(part.name)} is not simulated: {why}")
    return kept, notes


def _title(name: str) -> str:
    return name.replace("_", " ")


def _has(part: AnyPart, method: str) -> bool:
    return getattr(type(part), method) is not getattr(Part, method)


def _legend(simulation: AnySimulation, found: Mapping[str, Bools], people: Sequence[int]) -> str:
    """Return the meaning of the table's columns."""
    primary = "primary" in found
    said = ["primary: the primary comparison is significant, tested alone"] * primary
    which = "the primary comparison" if primary else "any test"
    if any(one.shape[-1] > 1 for one in found.values()):
        said.append(
            f"a comparison: one{simulation.against} is significant, on average, after correction;"
            " every comparison: all are"
        )
    if "interaction" in found:
        said.append(
            f"interaction: the change of {'the primary preference' if primary else 'a comparison'}"
            f" with {simulation.plan.interaction} is significant"
        )
    if EQUIVALENCE in found:
        margin = simulation.plan.margin
        said.append(f"equivalence: were the share one half, it is shown within ±{margin:.2f} of it")
    said.append(f"false positives: were there nothing to find, {which} is significant all the same")
    fewer = ". Other numbers of participants were not tried" * (len(people) <= SIZES + 1)
    return "; ".join(said) + fewer


def _errs_too_often(
    participants: Sequence[int],
    false_positives: Floats,
    alpha: float,
    studies: int,
    of: str,
    alone: str,
) -> list[str]:
    """Say if the test errs more than twice as often as alpha allows, beyond chance of `studies`.

    `of` says of what it is; empty: of what the study is about. `alone`: why several err so often.
    """
    worst, doubled = int(np.argmax(false_positives)), 2 * alpha
    if false_positives[worst] <= doubled + 3 * np.sqrt(doubled * (1 - doubled) / studies):
        return []
    return [
        f"do not plan by these numbers: in this design the test{f' of {of}' * bool(of)} errs too"
        " often. With nothing to"
        f" find, {false_positives[worst]:.2f} of studies of"
        f" {count_of(participants[worst], 'participant')} are"
        f" significant all the same, at alpha {alpha:g}"
        + (f": {alone}. Correct for them" if alone else ". Add scenes")
    ]


def _designs(
    simulation: AnySimulation,
    assumed: Mapping[str, float],
    most: int,
    studies: int,
    rng: np.random.Generator,
) -> tuple[DesignPower, ...]:
    """Simulate the planned test over numbers of scenes and repeats, where they can be changed."""
    deciding, found = simulation.deciding(), []
    people, studies = [simulation.planned or most], min(studies, DESIGN_STUDIES)
    scenes = {*SCENES_SHOWN, deciding.cells["scene"].nunique()}
    for count, times in product(sorted(scenes), sorted({*REPEATS_SHOWN, deciding.repeats})):
        changed = deciding.resized(count, times)
        if changed is None:
            return ()
        p = planned_p_values(changed, assumed, people, rng=rng, studies=studies)
        found.append(DesignPower(count, times, float((p < simulation.plan.alpha).mean())))
    return tuple(found)
