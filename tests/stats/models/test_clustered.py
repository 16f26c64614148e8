"""Inference on shares that respects participants and scenes."""

import tracemalloc

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from analysis.models.clustered import (
    holm,
    limits_by_scene,
    participant_t,
    sign_flip_floor,
    sign_flip_p,
    two_way,
    weighted_df,
)

STUDIES = 20_000
PEOPLE, SCENES, REPEATS = 11, 6, 2


def simulate(rng, participant_sd, scene_sd, studies=STUDIES):
    logit = rng.normal(0, participant_sd, (studies, PEOPLE, 1)) + rng.normal(
        0, scene_sd, (studies, 1, SCENES)
    )
    return rng.binomial(REPEATS, expit(np.broadcast_to(logit, (studies, PEOPLE, SCENES))))


def wald_p(found):
    ratio = np.abs(found.share - 0.5) / found.standard_error
    return 2 * stats.t.sf(ratio, found.df)


def test_one_scene_gives_the_textbook_t_of_participant_means():
    chosen = np.array([[3.0], [5.0], [9.0], [8.0]])

    found = two_way(chosen, np.full((4, 1), 10.0))
    textbook = stats.ttest_1samp([0.3, 0.5, 0.9, 0.8], 0.5)

    assert float(wald_p(found)) == pytest.approx(textbook.pvalue, abs=1e-12)
    assert float(found.df) == 3.0


def test_balanced_variance_is_the_sum_of_mean_squares_worked_by_hand():
    """Three people, five scenes; V = (MS_P + MS_S - MS_PS) / 15 where that is largest."""
    effect = np.array([0.0, 1.0, 2.0])[:, None] + np.array([0.0, 0, 1, 2, 2])[None, :]
    effect[0, 0] += 1.0
    shares = effect / 5.0
    mean = shares.mean()
    people, scenes = shares.mean(axis=1) - mean, shares.mean(axis=0) - mean
    rest = shares - mean - people[:, None] - scenes[None, :]
    ms_p, ms_s = 5 * (people**2).sum() / 2, 3 * (scenes**2).sum() / 4
    ms_e = (rest**2).sum() / 8

    found = two_way(effect * 2, np.full((3, 5), 10.0))

    assert float(found.standard_error) ** 2 == pytest.approx((ms_p + ms_s - ms_e) / 15, abs=1e-12)


def test_variance_never_falls_below_the_one_between_participants(rng):
    chosen = simulate(rng, 0.5, 0.0, 500)
    found = two_way(chosen, REPEATS)
    means = chosen.mean(axis=2) / REPEATS

    assert np.all(found.standard_error >= means.std(axis=1, ddof=1) / np.sqrt(PEOPLE) - 1e-12)


def test_unequal_cells_are_weighted_by_trials():
    chosen = np.array([[1.0, 0.0], [4.0, 3.0], [2.0, 2.0]])
    shown = np.array([[2.0, 0.0], [4.0, 4.0], [3.0, 4.0]])

    found = two_way(chosen, shown)

    assert float(found.share) == pytest.approx(12 / 17)
    assert np.isfinite(float(found.p_value()))


@pytest.mark.parametrize(
    ("participant_sd", "scene_sd", "lowest", "highest"),
    [
        (0.0, 0.0, 0.015, 0.060),
        (0.5, 0.0, 0.025, 0.060),
        (1.0, 0.0, 0.035, 0.060),
        (0.5, 0.5, 0.035, 0.060),
        (0.63, 0.43, 0.035, 0.060),
    ],
)
def test_the_default_test_calls_chance_an_effect_as_often_as_it_says(
    rng, participant_sd, scene_sd, lowest, highest
):
    p = two_way(simulate(rng, participant_sd, scene_sd), REPEATS).p_value()

    assert lowest <= float(np.mean(p < 0.05)) <= highest


def test_the_pooled_binomial_does_not(rng):
    """FACTS of the field: .114 at a participant sd of .5, .248 at 1, instead of .05."""
    totals = simulate(rng, 1.0, 0.0, 4000).sum(axis=(1, 2))
    p = np.array([stats.binomtest(k, 132).pvalue for k in range(133)])[totals]

    assert float(np.mean(p < 0.05)) > 0.2


def test_limits_equal_wilsons_where_trials_are_as_good_as_independent():
    """Answers that vary less than chance would: 132 trials, 76 of them."""
    chosen = np.ones((11, 6))
    chosen[np.arange(10), np.arange(10) % 6] += 1.0
    lower, upper = two_way(chosen, 2.0).limits()
    textbook = stats.binomtest(76, 132).proportion_ci(0.95, method="wilson")

    assert (float(lower), float(upper)) == pytest.approx((textbook.low, textbook.high), abs=1e-9)


def test_the_score_test_is_a_t_of_the_share_by_hand():
    """Four people, shares .3 .5 .9 .8: n = .625 x .375 / se^2, t = .125 sqrt(n) / .5."""
    found = two_way(np.array([[3.0], [5.0], [9.0], [8.0]]), np.full((4, 1), 10.0))
    size = 0.625 * 0.375 / (np.std([0.3, 0.5, 0.9, 0.8], ddof=1) / 2) ** 2

    assert float(found.score_t()) == pytest.approx(0.25 * np.sqrt(size))
    clustered, _, floor = found.p_parts()
    assert float(clustered) == pytest.approx(2 * stats.t.sf(0.25 * np.sqrt(size), 3))
    assert float(floor) == 2 / 16


def test_limits_by_scene_are_those_of_each_scene_alone(rng):
    shown = np.full((8, 3), 4.0)
    shown[3, 1] = 0.0
    chosen = rng.binomial(shown.astype(int), 0.7).astype(float)
    lower, upper = limits_by_scene(chosen, shown, 0.95)

    for scene in range(3):
        alone = [*map(float, two_way(chosen[:, [scene]], shown[:, [scene]]).limits(0.95))]
        assert [lower[scene], upper[scene]] == pytest.approx(alone)
    assert np.isnan(limits_by_scene(chosen[:1], shown[:1], 0.95)[0]).tolist() == [True] * 3


def test_unanimous_answers_have_the_participants_p_and_finite_limits():
    found = two_way(np.full((11, 6), 2.0), 2.0)
    lower, upper = found.limits()

    assert float(found.p_value()) == 2 / 2**11
    assert 0.5 < float(lower) < 1.0
    assert float(upper) == 1.0


def test_sign_flips_of_three_people_by_hand():
    """Patterns of (+.1, +.2, +.3): |sum| of .6 twice of eight, .0 twice, .2 twice, .4 twice."""
    assert sign_flip_p(np.array([0.1, 0.2, 0.3])) == pytest.approx(2 / 8)
    assert sign_flip_p(np.array([-0.1, 0.2, 0.3])) == pytest.approx(4 / 8)
    assert sign_flip_p(np.zeros(5)) == 1.0


def test_eleven_people_cannot_show_less_than_two_in_2048():
    assert sign_flip_floor(11) == 2 / 2048
    assert sign_flip_p(np.full(11, 0.5)) == 2 / 2048


def test_many_people_are_flipped_at_random_but_reproducibly(rng):
    values = rng.normal(0.1, 0.3, 30)

    assert sign_flip_p(values) == sign_flip_p(values)
    exact_t = stats.ttest_1samp(values, 0).pvalue
    assert sign_flip_p(values) == pytest.approx(exact_t, abs=0.02)


def test_holm_by_hand():
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm(np.array([[0.9, 0.9], [0.01, 0.9]])), [[1, 1], [0.02, 0.9]])


def test_participants_who_agree_exactly_give_no_t():
    assert participant_t(np.full(4, 0.25))[3] != participant_t(np.full(4, 0.25))[3]  # NaN
    assert participant_t(np.zeros(4))[3] == 1.0


def test_flipping_the_signs_of_hundreds_keeps_to_little_memory():
    """All patterns at once, as floats, are 320 MB for 200 participants."""
    values = np.random.default_rng(1).normal(0.02, 0.2, 200)
    tracemalloc.start()
    try:
        sign_flip_p(values, seed=5)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64 * 2**20


def test_degrees_of_freedom_of_unequal_clusters_are_those_of_the_quadratic_form():
    """Satterthwaite of sum (w (b - mean))², by its matrix; equal clusters give G - 1."""
    shown = np.array([10.0, 3.0, 1.0, 1.0, 0.0, 5.0])
    w = shown / shown.sum()
    rows = np.diag(w) @ (np.eye(6) - np.outer(np.ones(6), w))
    square = rows @ rows.T
    factor, df = weighted_df(shown)

    assert float(factor) == pytest.approx((w @ w) / np.trace(square))
    assert float(df) == pytest.approx(np.trace(square) ** 2 / np.trace(square @ square))
    np.testing.assert_allclose(weighted_df(np.full(6, 4.0)), (6 / 5, 5.0))
    np.testing.assert_allclose(weighted_df(np.array([7.0, 0.0])), (np.nan, 0.0))


def _ten_times(_rng):
    shown = np.full((11, 6), 1.0)
    shown[:, 0] = 10.0
    return shown


def _two_of_twenty(rng):
    return (rng.permuted(np.tile(np.arange(20), (30, 1)), axis=1) < 2) * 4.0


@pytest.mark.parametrize(
    ("design", "scene_sd"),
    [
        (_ten_times, 0.5),
        (_two_of_twenty, 1.0),
        (lambda _rng: np.full((40, 2), 2.0), 1.0),
        (lambda _rng: np.full((200, 2), 2.0), 0.43),
        (lambda _rng: np.full((40, 3), 2.0), 1.0),
    ],
    ids=["one scene ten times", "2 of 20 scenes", "40 x 2", "200 x 2", "40 x 3"],
)
def test_unbalanced_designs_and_few_scenes_rarely_find_an_effect_that_scenes_do_not_have(
    rng, design, scene_sd
):
    """Without weights, and with the residual of few cells, p was below .05 in .09 to .17."""
    wrong = []
    for _ in range(20):
        shown = design(rng)
        logit = rng.normal(0, 0.5, (100, len(shown), 1))
        logit = logit + rng.normal(0, scene_sd, (100, 1, shown.shape[1]))
        wrong.append(two_way(rng.binomial(shown.astype(int), expit(logit)), shown).p_value())

    assert np.mean(np.array(wrong) < 0.05) <= 0.06 + 0.015
    assert np.mean(np.array(wrong) < 0.001) <= 0.006
