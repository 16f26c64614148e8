"""QUEST+: by hand, against its definition, against the package questplus, and what must hold."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from adaptive_recovery import Marginal, of_posterior
from hypothesis import given
from hypothesis import strategies as st

from protocols.adaptive import quest_plus
from protocols.adaptive.psychometric_function import probability
from protocols.adaptive.quest_plus import (
    PARAMETERS,
    Axis,
    Grid,
    expected_entropy,
    next_level,
    posterior,
)
from protocols.errors import StudyError

ORACLE = json.loads(
    (Path(__file__).parents[1] / "oracles" / "adaptive.json").read_text(encoding="utf-8")
)["quest_plus"]

# Two thresholds and a step: .75 correct at the threshold, all above it, half below it.
STEP = Grid((0.0, 10.0), Axis((0.0, 10.0)), Axis((0.001,)), lapse=Axis((0.0,)))

GRID = Grid(
    levels=(0.0, 1.0, 2.5, 4.0, 6.0, 9.0),
    threshold=Axis((1.0, 2.0, 3.5, 5.0, 8.0)),
    width=Axis((1.0, 2.0, 5.0)),
    guess=Axis((0.1, 0.3), weights=(3.0, 1.0)),
    lapse=Axis((0.0, 0.05)),
)

histories = st.lists(st.tuples(st.sampled_from(GRID.levels), st.booleans()), max_size=60)


def test_a_posterior_by_hand():
    """Likelihoods of a correct answer at 0: .75 and .5; of a wrong one at 10: none and .25."""
    np.testing.assert_allclose(posterior([], STEP).ravel(), [0.5, 0.5])
    np.testing.assert_allclose(posterior([(0.0, True)], STEP).ravel(), [0.6, 0.4])
    np.testing.assert_allclose(posterior([(10.0, False)], STEP).ravel(), [0.0, 1.0], atol=1e-10)


def test_expected_entropies_by_hand():
    """At 0: .625 H(.6) + .375 H(1/3). At 10: .875 H(4/7), since a wrong answer settles it."""

    def entropy(p: float) -> float:
        return -p * np.log(p) - (1 - p) * np.log(1 - p)

    by_hand = [0.625 * entropy(0.6) + 0.375 * entropy(1 / 3), 0.875 * entropy(4 / 7)]

    np.testing.assert_allclose(expected_entropy([], STEP), by_hand, rtol=1e-9)
    assert next_level([], STEP) == 10.0


def test_the_marginals_by_hand():
    found = of_posterior([(0.0, True)], STEP)

    assert found.threshold.mean == pytest.approx(4.0)
    assert found.threshold.sd == pytest.approx(np.sqrt(0.6 * 16 + 0.4 * 36))
    assert found.guess == Marginal(0.5, 0.0)
    assert found.entropy_nats == pytest.approx(-0.6 * np.log(0.6) - 0.4 * np.log(0.4))


def by_definition(history, grid):
    """Watson's own words: update for each answer to each level, and average the entropies."""
    values = [getattr(grid, name).values for name in PARAMETERS]
    guess, threshold, width, lapse = np.meshgrid(*values, indexing="ij")
    told = {
        "threshold": threshold,
        "width": width,
        "guess": guess,
        "lapse": lapse,
        "shape": grid.shape,
        "falling": grid.falling,
    }
    weight = np.ones(grid.size)
    for axis, name in enumerate(PARAMETERS):
        shape = [-1 if other == axis else 1 for other in range(4)]
        weight = weight * getattr(grid, name).prior().reshape(shape)
    for level, correct in history:
        share = probability(level, **told)
        weight = weight * (share if correct else 1.0 - share)
    weight = weight / weight.sum()
    averages = []
    for level in grid.levels:
        share, average = probability(level, **told), 0.0
        for answer in (share, 1.0 - share):
            after = weight * answer
            chance = after.sum()
            after = after[after > 0] / chance
            average -= chance * (after * np.log(after)).sum()
        averages.append(average)
    return weight, np.array(averages)


@pytest.mark.parametrize("shape", ["gauss", "logistic", "gumbel", "weibull"])
@pytest.mark.parametrize("falling", [False, True])
def test_posterior_and_entropies_are_those_of_the_definition(shape, falling, rng):
    grid = replace(GRID, shape=shape, falling=falling)
    levels = rng.choice(grid.levels[1:-1], 12)
    history = [(float(level), bool(rng.random() < 0.6)) for level in levels]

    weight, entropies = by_definition(history, grid)

    np.testing.assert_allclose(posterior(history, grid), weight, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(expected_entropy(history, grid), entropies, rtol=1e-8)
    assert next_level(history, grid) == grid.levels[int(entropies.argmin())]


@given(histories)
def test_the_posterior_sums_to_one_and_the_next_level_is_allowed(history):
    weight = posterior(history, GRID)

    assert weight.shape == GRID.size == (2, 5, 3, 2)
    assert weight.sum() == pytest.approx(1.0, abs=1e-12)
    assert np.all(weight >= 0)
    assert next_level(history, GRID) in GRID.levels
    assert np.all(
        expected_entropy(history, GRID) <= of_posterior(history, GRID).entropy_nats + 1e-9
    )


@given(histories, st.randoms(use_true_random=False))
def test_the_order_of_answers_changes_nothing(history, random):
    other = list(history)
    random.shuffle(other)

    np.testing.assert_array_equal(posterior(other, GRID), posterior(history, GRID))
    assert next_level(other, GRID) == next_level(history, GRID)


@given(histories, st.sampled_from(GRID.levels))
def test_a_wrong_answer_means_a_higher_threshold_than_a_correct_one(history, level):
    """The threshold alone is unknown; else a wrong answer may speak for a wider function."""
    grid = replace(GRID, width=Axis((2.0,)), guess=Axis((0.3,)), lapse=Axis((0.05,)))
    right = of_posterior([*history, (level, True)], grid).threshold.mean
    wrong = of_posterior([*history, (level, False)], grid).threshold.mean

    assert right <= wrong + 1e-9


def test_nothing_is_remembered_between_calls():
    history = [(2.5, True), (4.0, False), (6.0, True)]
    first = next_level(history, GRID)
    next_level([(0.0, True)] * 5, GRID)
    quest_plus.tables.cache_clear()

    assert next_level(history, GRID) == first
    assert len(history) == 3


def test_levels_that_tell_the_same_give_the_lowest():
    """Symmetric about 5: 4 and 6 tell the same, up to rounding."""
    levels = (0.0, 4.0, 6.0, 10.0)
    grid = Grid(levels, Axis((3.0, 7.0)), Axis((4.0,)), Axis((0.1,)), Axis((0.1,)))
    entropies = expected_entropy([], grid)

    assert abs(entropies[1] - entropies[2]) < 1e-12
    assert next_level([], grid) == 4.0


def test_a_falling_function_is_the_mirror_of_a_rising_one():
    def mirror(values):
        return tuple(-value for value in reversed(values))

    mirrored = replace(
        GRID,
        levels=mirror(GRID.levels),
        threshold=Axis(mirror(GRID.threshold.values)),
        falling=True,
    )
    history = [(2.5, True), (4.0, False), (6.0, True), (1.0, False)]
    turned = [(-level, correct) for level, correct in history]

    np.testing.assert_allclose(
        posterior(turned, mirrored), posterior(history, GRID)[:, ::-1], rtol=1e-9
    )


def test_a_prior_of_zero_rules_a_value_out():
    grid = replace(GRID, width=Axis(GRID.width.values, weights=(1.0, 0.0, 2.0)))

    weight = posterior([(2.5, True), (4.0, False)], grid)

    assert np.all(weight[:, :, 1] == 0.0)
    assert weight.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(posterior([], grid).sum(axis=(0, 1, 3)), [1 / 3, 0.0, 2 / 3])


def test_answers_that_no_observer_could_give_do_not_stop_the_session():
    """Without guesses and lapses a step function holds both of these for impossible."""
    grid = Grid((0.0, 5.0, 10.0), Axis((4.0, 6.0)), Axis((1e-3,)), Axis((0.0,)), Axis((0.0,)))
    history = [(0.0, True), (10.0, False)] * 10

    assert posterior(history, grid).sum() == pytest.approx(1.0)
    assert next_level(history, grid) == 5.0


def test_false_alarms_of_a_yes_no_task_are_found(rng):
    grid = Grid(
        levels=tuple(float(level) for level in range(11)),
        threshold=Axis(tuple(float(value) for value in range(1, 10))),
        width=Axis((1.0, 2.0, 4.0)),
        guess=Axis((0.02, 0.1, 0.2, 0.3)),
    )
    history = []
    for _ in range(400):
        level = next_level(history, grid)
        share = probability(level, threshold=5.0, width=2.0, guess=0.2, lapse=0.02)
        history.append((level, bool(rng.random() < share)))

    found = of_posterior(history, grid)

    assert found.guess.mean == pytest.approx(0.2, abs=0.05)
    assert found.threshold.mean == pytest.approx(5.0, abs=0.3)
    assert found.width.mean == pytest.approx(2.0, abs=0.7)


@pytest.mark.parametrize("case", ORACLE, ids=lambda case: case["name"])
def test_levels_and_posterior_are_those_of_the_package_questplus(case):
    grid = Grid(tuple(case["levels"]), **{name: Axis(tuple(case[name])) for name in PARAMETERS})
    history = [(level, correct) for level, correct in case["history"]]
    assert len(history) == 40

    for trial, (level, _) in enumerate(history):
        entropies = expected_entropy(history[:trial], grid)
        assert entropies.min() == pytest.approx(case["entropy_nats"][trial], abs=1e-8)
        # Where two levels tell the same, the package lets rounding decide.
        assert entropies[grid.levels.index(level)] < entropies.min() + 1e-9
        best = np.sort(entropies)
        assert next_level(history[:trial], grid) == level or best[1] - best[0] < 1e-9
    weight = posterior(history, grid)
    for axis, name in enumerate(PARAMETERS):
        marginal = weight.sum(axis=tuple(other for other in range(4) if other != axis))
        np.testing.assert_allclose(marginal, case["marginals"][name], rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"levels": (0.0, 4.0, 2.0)}, "levels[2]: must be above the one before it, 4 (got 2)"),
        ({"levels": ()}, "levels: must hold two levels or more (got 0)"),
        ({"threshold": Axis(())}, "threshold: must hold one value or more (got none)"),
        ({"lapse": Axis(())}, "lapse: must hold one value or more (got none)"),
        ({"width": Axis((2.0, 1.0))}, "width[1]: must be above the one before it, 2 (got 1)"),
        (
            {"threshold": Axis((-1.0, 3.0, 12.0))},
            "threshold: must lie within the levels, from 0 to 9 (got -1, 12)",
        ),
        ({"width": Axis((0.0, 1.0))}, "width: must be greater than 0 (got 0)"),
        ({"guess": Axis((-0.1, 0.1))}, "guess: must be at least 0 (got -0.1)"),
        ({"lapse": Axis((0.0, 0.7))}, "guess + lapse: must stay below 1 (got up to 1)"),
        ({"width": Axis((1.0,), (1.0, 2.0))}, "width: there must be one weight for each of the 1"),
        ({"width": Axis((1.0, 2.0), (1.0, -2.0))}, "width: weights must be finite and at least 0"),
        ({"width": Axis((1.0, 2.0), (0.0, 0.0))}, "width: one weight or more must be above 0"),
        ({"width": Axis((float("inf"),))}, "width: must be a finite number (got inf)"),
        ({"shape": "weibul"}, "shape: must be one of gauss, logistic, gumbel, weibull"),
        (
            {"shape": "weibull", "levels": (-1.0, 9.0)},
            "shape: weibull needs levels of at least 0 and thresholds above 0 (got levels from -1",
        ),
    ],
)
def test_a_grid_that_cannot_be_is_refused(change, told):
    with pytest.raises(StudyError) as raised:
        replace(GRID, **change)

    assert told in str(raised.value)


@pytest.mark.parametrize("job", [posterior, next_level, of_posterior, expected_entropy])
def test_an_answer_at_another_level_is_refused(job):
    with pytest.raises(StudyError, match=r"history\[1\]: must be one of the 6 allowed levels"):
        job([(0.0, True), (5.0, True)], GRID)
