"""How many participants does a protocol need? Simulation of its own design and test."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from analysis.clustered import ClusteredShare, Variances, combine, holm
from analysis.plans.preference import Comparison, Settings
from analysis.power import (
    Power,
    default_participants,
    errs_too_often,
    few_scenes,
    mean_logit,
    numbers_needed,
)

Floats = NDArray[np.float64]

CHUNK = 500
"""Studies simulated at once; bounds memory."""

CANNOT_SHOW = 0.5
"""Below this chance of showing what is true, a study had better not promise it."""

DESIGN_STUDIES = 1000
SCENES_SHOWN = (2, 4, 6, 8, 12, 16, 24)
REPEATS_SHOWN = (1, 2, 4)
"""What is simulated beside the study's own scenes and repeats."""

DEFAULT_PARTICIPANT_SD = 0.6
DEFAULT_SCENE_SD = 0.4


@dataclass(frozen=True)
class Assumptions:
    """What the simulation takes for true.

    `rate` is the population's mean share in every comparison; the deviations are of the random
    effects of participants and scenes on the logit, drawn anew for every pairing.
    `size_correlation` is how alike the effects of one pairing are at two sizes: 1 where who
    prefers a method at one size prefers it as much at all, 0 where sizes have nothing in common.
    Effects that sizes share do not average out over them, so 1 promises least.
    """

    rate: float
    participant_sd: float = DEFAULT_PARTICIPANT_SD
    scene_sd: float = DEFAULT_SCENE_SD
    size_correlation: float = 1.0


@dataclass(frozen=True)
class DesignPower:
    """Power of the primary comparison with other numbers of scenes and repeats."""

    scenes: int
    repeats: int
    primary: float


@dataclass(frozen=True)
class PowerCurve(Power):
    """Power by number of participants; false positives are of the primary comparison.

    Attributes
    ----------
    primary : ndarray
        Chance that the primary comparison is significant (two-sided, alpha, alone).
    equivalence : ndarray
        Chance that the primary comparison is shown equivalent where the true rate is one half.
    designs : tuple of DesignPower
        With the planned participants (else the most simulated), scenes and repeats changed.
    """

    primary: Floats
    equivalence: Floats
    margin: float
    designs: tuple[DesignPower, ...]


def power_curve(
    settings: Settings,
    assumptions: Assumptions,
    *,
    rng: np.random.Generator,
    participants: Sequence[int] | None = None,
    studies: int = 2000,
    designs: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> PowerCurve:
    """Simulate the protocol's design and analysis for growing numbers of participants.

    Every simulated study is analysed at all numbers of participants at once: its first n
    people are a study of n (the curves are smooth, and cost little more than one point). With
    `designs` other numbers of scenes and repeats are simulated too.

    Raises
    ------
    ValueError
        If the rate is not in (0, 1), a deviation is negative, or the study has no comparison.
    """
    if not 0.0 < assumptions.rate < 1.0:
        raise ValueError(f"rate must lie between 0 and 1 (got {assumptions.rate})")
    if min(assumptions.participant_sd, assumptions.scene_sd) < 0:
        raise ValueError("standard deviations must not be negative")
    if not 0.0 <= assumptions.size_correlation <= 1.0:
        raise ValueError(
            f"size_correlation must lie between 0 and 1 (got {assumptions.size_correlation})"
        )
    if not settings.comparisons:
        raise ValueError("the study must declare comparisons (a protocol, not a plain table)")
    sizes = tuple(participants or default_participants(settings.planned_participants))
    picks = np.array(sizes) - 1
    if picks.min() < 1:
        raise ValueError(f"participants must be at least 2 (got {min(sizes)})")
    null = replace(assumptions, rate=0.5)
    sums = np.zeros((5, len(sizes)))
    done = 0
    while done < studies:
        batch = min(CHUNK, studies - done)
        p, primary_p, _ = _batch(settings, assumptions, batch, picks, rng)
        adjusted = holm(p) if settings.correction == "holm" else p
        significant = adjusted < settings.alpha
        sums[0] += (primary_p < settings.alpha).sum(axis=0)
        sums[1] += significant.mean(axis=-1).sum(axis=0)
        sums[2] += significant.all(axis=-1).sum(axis=0)
        _, null_p, null_tost = _batch(settings, null, batch, picks, rng, primary_only=True)
        sums[3] += (null_tost < settings.alpha).sum(axis=0)
        sums[4] += (null_p < settings.alpha).sum(axis=0)
        done += batch
        if progress:
            progress(done, studies)
    power = sums / studies
    curves = {"primary": power[0], "every comparison": power[2], "equivalence": power[3]}
    scenes = min(len(entry.scenes) for entry in settings.comparisons)
    errs = errs_too_often(sizes, power[4], settings.alpha, studies)
    claimed = settings.test == "participant-scene"
    notes = few_scenes(scenes, assumptions.scene_sd, claimed=claimed) + errs
    if settings.test == "pooled":
        notes.append("simulated with the participant-scene test, not the protocol's pooled one")
    planned = settings.planned_participants
    shown = float(power[3][sizes.index(planned)]) if planned in sizes else float(power[3].max())
    if shown < CANNOT_SHOW:
        notes.append(
            f"equivalence within ±{settings.margin:g} would be shown in {shown:.2f} of such studies"
            " even if the share were one half: do not plan to claim it"
        )
    return PowerCurve(
        participants=sizes,
        primary=power[0],
        each=power[1],
        every=power[2],
        equivalence=power[3],
        false_positives=power[4],
        comparisons=len(settings.comparisons),
        needed=numbers_needed(sizes, curves, errs=errs),
        studies=studies,
        assumptions=vars(assumptions),
        alpha=settings.alpha,
        margin=settings.margin,
        planned=planned,
        designs=_designs(settings, assumptions, planned or max(sizes), studies, rng)
        if designs
        else (),
        warnings=tuple(notes),
    )


def primary_p_values(
    settings: Settings,
    assumptions: Assumptions,
    participants: Sequence[int],
    *,
    studies: int,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> Floats:
    """Return p of the primary comparison (studies, numbers of participants).

    The first n people of a simulated study are a study of n.
    """
    picks = np.array(participants, dtype=np.intp) - 1
    found = []
    for done in range(0, studies, CHUNK):
        batch = min(CHUNK, studies - done)
        found.append(_batch(settings, assumptions, batch, picks, rng, primary_only=True)[1])
        if progress:
            progress(done + batch, studies)
    return np.concatenate(found)


def _designs(
    settings: Settings,
    assumptions: Assumptions,
    people: int,
    studies: int,
    rng: np.random.Generator,
) -> tuple[DesignPower, ...]:
    """Simulate the primary comparison over numbers of scenes and repeats."""
    primary = [entry for entry in settings.comparisons if _is_primary(entry, settings)]
    scenes = sorted({*SCENES_SHOWN, *(len(entry.scenes) for entry in primary)})
    repeats = sorted({*REPEATS_SHOWN, *(entry.repeats for entry in primary)})
    studies = min(studies, DESIGN_STUDIES)
    found = []
    for count, times in product(scenes, repeats):
        names = tuple(f"scene {number}" for number in range(count))
        other = tuple(replace(entry, scenes=names, repeats=times) for entry in primary)
        changed = replace(settings, comparisons=other)
        p = primary_p_values(changed, assumptions, [people], studies=studies, rng=rng)
        found.append(DesignPower(count, times, float((p < settings.alpha).mean())))
    return tuple(found)


def _batch(
    settings: Settings,
    assumptions: Assumptions,
    studies: int,
    picks: NDArray[np.intp],
    rng: np.random.Generator,
    *,
    primary_only: bool = False,
) -> tuple[Floats, Floats, Floats]:
    """Simulate studies.

    Returns p (studies, numbers of participants, comparisons) of the family, and p and TOST p
    of the primary comparison (studies, numbers of participants).
    """
    people = int(picks.max()) + 1
    family, parts = [], []
    shared: dict[tuple[str, str], _Shared] = {}
    for entry in settings.comparisons:
        is_primary = _is_primary(entry, settings)
        if primary_only and not is_primary:
            continue
        common = shared.get((entry.method, entry.against))
        if common is None:
            common = _Shared(rng.standard_normal((studies, people, 1), dtype=np.float32), {})
            shared[entry.method, entry.against] = common
        votes = _votes(entry, assumptions, common, rng)
        if not primary_only:
            family.append(_prefix(votes, entry.repeats, picks).p_value())
        if is_primary:
            parts.append((votes, entry.repeats))
    # Sizes taken together are one comparison with more repeats.
    together = np.sum([votes for votes, _ in parts], axis=0)
    repeats = sum(count for _, count in parts)
    primary = _prefix(together, repeats, picks, one_way=settings.test == "participant")
    return (
        np.stack(family, axis=-1) if family else np.zeros((studies, picks.size, 0)),
        primary.p_value(),
        primary.equivalence_p(settings.margin),
    )


def _is_primary(entry: Comparison, settings: Settings) -> bool:
    if settings.primary is None:
        return entry is settings.comparisons[0]
    method, against, size = settings.primary
    return (entry.method, entry.against) == (method, against) and size in ("all", entry.size)


@dataclass(frozen=True)
class _Shared:
    """Standard normal effects that a pairing has at every size, of people and of each scene."""

    person: NDArray[np.float32]
    scenes: dict[str, NDArray[np.float32]]


def _votes(
    entry: Comparison, assumptions: Assumptions, common: _Shared, rng: np.random.Generator
) -> Floats:
    """Draw choices (studies, people, scenes) of one comparison."""
    studies, people, _ = common.person.shape
    for name in entry.scenes:
        if name not in common.scenes:
            common.scenes[name] = rng.standard_normal((studies, 1, 1), dtype=np.float32)
    scene = np.concatenate([common.scenes[name] for name in entry.scenes], axis=2)
    spread = float(np.hypot(assumptions.participant_sd, assumptions.scene_sd))
    logit = mean_logit(assumptions.rate, spread) + sum(
        deviation * _own(effect, assumptions.size_correlation, rng)
        for deviation, effect in (
            (assumptions.participant_sd, common.person),
            (assumptions.scene_sd, scene),
        )
    )
    share = expit(logit)
    votes = np.zeros((studies, people, len(entry.scenes)), dtype=np.float32)
    for _ in range(entry.repeats):
        votes += rng.random(votes.shape, dtype=np.float32) < share
    return votes.astype(np.float64)


def _own(
    shared: NDArray[np.float32], correlation: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return effects of variance 1 that correlate so with those of the pairing at other sizes."""
    if correlation == 1.0:
        return shared
    own = rng.standard_normal(shared.shape, dtype=np.float32)
    both = np.sqrt(correlation) * shared + np.sqrt(1.0 - correlation) * own
    return np.asarray(both, dtype=np.float32)


def _prefix(
    votes: Floats, repeats: int, picks: NDArray[np.intp], *, one_way: bool = False
) -> ClusteredShare:
    """Return `two_way` of the first n people for every n, from running sums."""
    scenes = votes.shape[-1]
    rows = votes.sum(axis=-1)
    total = np.cumsum(rows, axis=-1)[:, picks]
    row_squares = np.cumsum(rows**2, axis=-1)[:, picks]
    cell_squares = np.cumsum(np.einsum("ijk,ijk->ij", votes, votes), axis=-1)[:, picks]
    columns = np.cumsum(votes, axis=1)[:, picks]
    column_squares = np.einsum("ijk,ijk->ij", columns, columns)
    people = (picks + 1).astype(np.float64)
    trials = people * scenes * repeats
    mean_square = total**2 / people
    var_person = (row_squares - mean_square) / trials**2 * people / (people - 1.0)
    if one_way or scenes == 1:
        var_scene = var_cell = np.zeros_like(var_person)
    else:
        var_scene = (column_squares - total**2 / scenes) / trials**2 * scenes / (scenes - 1.0)
        residual = cell_squares - row_squares / scenes - column_squares / people
        residual += mean_square / scenes
        var_cell = residual / trials**2 * people * scenes / ((people - 1.0) * (scenes - 1.0))
    parts = Variances(
        person=np.maximum(var_person, 0.0),
        scene=np.maximum(var_scene, 0.0),
        cell=np.maximum(var_cell, 0.0),
        persons=people,
        person_df=people - 1.0,
        scene_df=np.full_like(people, 0.0 if one_way else scenes - 1.0),
    )
    return combine(total / trials, trials, parts)
