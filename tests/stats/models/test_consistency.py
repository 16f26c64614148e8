"""Circular triads, agreement, transitivity: counted by hand."""

from itertools import combinations, product

import numpy as np
import pytest

from analysis.models.consistency import (
    _triad_distribution,
    agreement,
    circular_triads,
    majority,
    transitivity,
)

CIRCLE = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], dtype=float)
ORDER = np.array([[0, 1, 1], [0, 0, 1], [0, 0, 0]], dtype=float)


def test_one_circle_of_three():
    found = circular_triads(CIRCLE)

    assert (found.circular, found.largest, found.zeta) == (1.0, 1, 0.0)
    assert found.p == 1.0


def test_an_order_has_no_circle_and_happens_by_chance_in_six_of_eight():
    found = circular_triads(ORDER)

    assert (found.circular, found.zeta, found.p) == (0.0, 1.0, 0.75)


def test_formula_counts_what_looking_at_every_triple_counts(rng):
    wins = np.triu(rng.integers(0, 2, (7, 7)), 1).astype(float)
    wins += np.tril(1 - wins.T, -1)
    by_hand = sum(wins[a, b] == wins[b, c] == wins[c, a] for a, b, c in combinations(range(7), 3))

    assert circular_triads(wins).circular == by_hand


def test_distribution_of_triads_equals_enumeration():
    pairs = list(combinations(range(4), 2))
    counted: dict[int, int] = {}
    for answers in product((0, 1), repeat=6):
        wins = np.zeros((4, 4))
        for (i, j), answer in zip(pairs, answers, strict=True):
            wins[i, j], wins[j, i] = answer, 1 - answer
        t = int(circular_triads(wins).circular)
        counted[t] = counted.get(t, 0) + 1

    assert counted == _triad_distribution(4)


def test_six_conditions_have_kendalls_published_distribution():
    """Kendall and Babington Smith 1940, table for n = 6; 5 or fewer: p = .50928."""
    assert _triad_distribution(6) == {
        0: 720,
        1: 960,
        2: 2240,
        3: 2880,
        4: 6240,
        5: 3648,
        6: 8640,
        7: 4800,
        8: 2640,
    }


def test_agreement_is_one_where_all_agree_and_negative_at_an_even_split():
    everyone = agreement(10 * ORDER)
    split = agreement(5.0 * (1 - np.eye(3)))

    assert everyone.u == pytest.approx(1.0)
    assert everyone.p < 1e-6
    assert split.u == pytest.approx(-1 / 9)  # -1 / (m - 1) for even m
    assert split.smallest == pytest.approx(-1 / 9)


def test_repeats_are_reduced_to_the_majority():
    np.testing.assert_array_equal(
        majority(np.array([[0, 3, 2], [1, 0, 0], [2, 4, 0]], float)),
        [[0, 1, 0.5], [0, 0, 0], [0.5, 1, 0]],
    )


@pytest.mark.parametrize(
    ("direct", "violated"), [(0.9, (0, 0, 0)), (0.7, (0, 0, 1)), (0.55, (0, 1, 1))]
)
def test_transitivity_by_hand(direct, violated):
    """a over b .8, b over c .6; a over c as given."""
    share = np.array([[0, 0.8, direct], [0.2, 0, 0.6], [1 - direct, 0.4, 0]])
    found = transitivity(share * 100)

    assert (found.weak, found.moderate, found.strong) == violated
    assert found.triples == 1


def test_a_circle_violates_weak_transitivity():
    assert transitivity(CIRCLE * 10).weak == 1


def test_incomplete_answers_are_refused_in_words():
    with pytest.raises(ValueError, match="every pair exactly once"):
        circular_triads(np.zeros((4, 4)))
    with pytest.raises(ValueError, match="at least three conditions"):
        circular_triads(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="0 to 4 answers per pair"):
        agreement(np.array([[0, 4.0, 0], [0, 0, 0], [0, 0, 0]]))
