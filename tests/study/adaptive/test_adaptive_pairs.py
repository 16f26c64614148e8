"""Active pairs: by hand and by integration, against ASAP's posterior, and what must hold."""

import json
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, optimize
from scipy.sparse.csgraph import connected_components
from scipy.special import entr, log_ndtr, ndtr
from scipy.stats import norm

from analysis.models.paired import paired_counts as analysed
from protocols.adaptive.active_pairs import (
    JOD_SIGMA,
    Scores,
    information_gain,
    next_batch,
    score_posterior,
)
from protocols.disk.hashing import Chance
from protocols.errors import StudyError

ORACLE = json.loads(
    (Path(__file__).parents[1] / "oracles" / "adaptive.json").read_text(encoding="utf-8")
)["active_pairs"]


def votes(rng, truth, count):
    """Draw `count` comparisons of random pairs."""
    wins = np.zeros((truth.size, truth.size))
    for _ in range(count):
        i, j = rng.choice(truth.size, 2, replace=False)
        first = rng.random() < ndtr((truth[i] - truth[j]) / JOD_SIGMA)
        wins[(i, j) if first else (j, i)] += 1
    return wins


def test_a_jod_is_that_of_the_analysis():
    assert JOD_SIGMA == analysed.JOD_SIGMA
    assert ndtr(1.0 / JOD_SIGMA) == pytest.approx(0.75)


def test_without_answers_the_posterior_is_the_prior():
    found = score_posterior(np.zeros((3, 3)), prior_sd_jod=2.0)

    np.testing.assert_allclose(found.mean, 0.0)
    np.testing.assert_allclose(found.covariance, 4.0 * np.eye(3))
    np.testing.assert_allclose(found.difference_variance(), 8.0 * (1 - np.eye(3)))


def test_the_mean_of_two_conditions_is_the_highest_point_on_their_difference():
    """With independent priors of SD s, the difference has a prior of SD s sqrt 2."""
    found = score_posterior([[0, 5], [2, 0]], prior_sd_jod=1.5)

    def cost(d: float) -> float:
        return d * d / (4 * 1.5**2) - 5 * log_ndtr(d / JOD_SIGMA) - 2 * log_ndtr(-d / JOD_SIGMA)

    best = optimize.minimize_scalar(cost, bounds=(-5, 5), options={"xatol": 1e-10}).x
    step = 1e-4
    bend = (cost(best + step) - 2 * cost(best) + cost(best - step)) / step**2
    assert found.mean[0] - found.mean[1] == pytest.approx(best, abs=1e-7)
    assert found.mean.sum() == pytest.approx(0.0, abs=1e-12)
    assert found.difference_variance()[0, 1] == pytest.approx(1 / bend, rel=1e-5)


def test_the_posterior_is_close_to_the_exact_one():
    """Three conditions, few answers, integrated on a grid: Laplace is off by a little."""
    wins = np.array([[0, 3, 4], [1, 0, 3], [0, 1, 0]])
    axis = np.linspace(-6.0, 6.0, 81)
    q = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"))
    log_weight = -0.5 * (q**2).sum(axis=0)
    for i, j in product(range(3), repeat=2):
        log_weight += wins[i, j] * log_ndtr((q[i] - q[j]) / JOD_SIGMA)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = (q * weight).sum(axis=(1, 2, 3))
    gap = q[0] - q[2]
    variance = (weight * (gap - (weight * gap).sum()) ** 2).sum()

    found = score_posterior(wins, prior_sd_jod=1.0)

    np.testing.assert_allclose(found.mean, mean - mean.mean(), atol=0.08)
    assert found.difference_variance()[0, 2] == pytest.approx(variance, rel=0.08)


def test_it_is_the_maximum_of_the_analysis_where_answers_are_many(rng):
    wins = votes(rng, np.array([1.5, 0.5, 0.0, -2.0]), 4000)
    first, second = analysed.pair_index(4)

    scores = analysed.fit_scores(wins[first, second], wins[second, first], 4)

    np.testing.assert_allclose(score_posterior(wins, prior_sd_jod=50.0).mean, scores, atol=1e-3)


def test_it_is_the_highest_point_whatever_the_answers(proof_count):
    """At the highest point of a concave function every slope is 0, here to rounding."""
    for seed in range(proof_count(600)):
        rng = np.random.default_rng(seed)
        count, prior_sd_jod = int(rng.integers(2, 8)), float(10 ** rng.uniform(-1, 2))
        wins = np.rint(10 ** rng.uniform(-1, 6, (count, count)))
        wins *= rng.random((count, count)) < 0.5
        np.fill_diagonal(wins, 0)

        mean = score_posterior(wins, prior_sd_jod=prior_sd_jod).mean

        gap = (mean[:, None] - mean[None, :]) / JOD_SIGMA
        pull = wins * np.exp(norm.logpdf(gap) - log_ndtr(gap)) / JOD_SIGMA
        prior = mean / prior_sd_jod**2
        scale = pull.sum() + np.abs(prior).sum() + 1.0
        np.testing.assert_allclose((pull - pull.T).sum(axis=1) - prior, 0.0, atol=1e-8 * scale)


def test_a_condition_that_always_wins_has_a_finite_score():
    found = score_posterior([[0, 1000, 1000], [0, 0, 500], [0, 500, 0]], prior_sd_jod=1.0)

    assert np.all(np.isfinite(found.covariance))
    assert 2.0 < found.mean[0] < 10.0
    assert found.mean[1] == pytest.approx(found.mean[2])


@pytest.mark.parametrize("case", ORACLE, ids=lambda case: f"{len(case['wins'])} conditions")
def test_the_posterior_agrees_with_that_of_asap(case):
    """Two approximations of one posterior; ASAP's has no covariances, and passes messages.

    Its mean is that of the posterior and ours the highest point, which lies a little nearer to 0.
    """
    mean, variance = np.array(case["mean"]), np.array(case["variance"])

    found = score_posterior(case["wins"])

    own = found.mean / JOD_SIGMA
    assert np.corrcoef(own, mean)[0, 1] > 0.999
    assert np.all(np.abs(own - mean + mean.mean()) < 0.25 * np.sqrt(variance))


def by_integration(mean: float, variance: float) -> float:
    """Mutual information of an answer and a normal difference, by adaptive quadrature."""

    def answer_entropy(d: float) -> float:
        p = ndtr(d / JOD_SIGMA)
        return float((entr(p) + entr(ndtr(-d / JOD_SIGMA))) * norm.pdf(d, mean, variance**0.5))

    reach = 10 * variance**0.5
    known, _ = integrate.quad(answer_entropy, mean - reach, mean + reach, points=[mean, 0.0])
    p = ndtr(mean / np.sqrt(JOD_SIGMA**2 + variance))
    return float(entr(p) + entr(1 - p) - known)


@pytest.mark.parametrize(("mean", "variance"), [(0, 1), (0, 8), (2, 0.5), (-4, 3), (6, 10)])
def test_the_gain_is_what_integration_gives(mean, variance):
    half = Scores(np.array([mean / 2, -mean / 2]), np.eye(2) * variance / 2)

    gain = information_gain(half)

    assert gain[0, 1] == gain[1, 0] == pytest.approx(by_integration(mean, variance), abs=1e-6)
    assert gain[0, 0] == gain[1, 1] == 0.0


def test_the_gain_is_the_expected_divergence_from_the_present_posterior():
    """ASAP's definition, on a grid: average over both answers of KL(after || before)."""
    d = np.linspace(-14.0, 16.0, 20_001)
    before = norm.pdf(d, 1.0, 1.5)
    before /= before.sum()
    expected = 0.0
    for answer in (ndtr(d / JOD_SIGMA), ndtr(-d / JOD_SIGMA)):
        chance = (before * answer).sum()
        after = before * answer / chance
        expected += chance * (after * np.log(answer / chance)).sum()

    scores = Scores(np.array([0.5, -0.5]), np.eye(2) * 1.5**2 / 2)

    assert information_gain(scores)[0, 1] == pytest.approx(expected, abs=1e-7)


def test_what_is_nearly_equal_or_little_known_tells_more():
    def gain(mean, variance):
        return information_gain(Scores(np.array([mean, 0.0]), np.eye(2) * variance / 2))[0, 1]

    assert gain(0.0, 1.0) > gain(1.0, 1.0) > gain(4.0, 1.0) > 0.0
    assert gain(1.0, 4.0) > gain(1.0, 1.0) > gain(1.0, 0.1) > 0.0
    assert gain(1.0, 0.0) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("count", [2, 3, 10, 60])
def test_a_batch_is_a_spanning_tree(count, rng):
    wins = votes(rng, rng.normal(0.0, 2.0, count), 5 * count)

    batch = next_batch(wins, Chance("batch", count))

    assert len(batch) == len(set(batch)) == count - 1
    assert all(0 <= i < j < count for i, j in batch)
    graph = np.zeros((count, count))
    graph[tuple(np.transpose(batch))] = 1
    assert connected_components(graph, directed=False)[0] == 1


@pytest.mark.parametrize("seed", range(6))
def test_no_other_tree_has_less_inverse_gain(seed):
    """All 125 trees of five conditions."""
    rng = np.random.default_rng(seed)
    wins = votes(rng, rng.normal(0.0, 2.0, 5), 20)
    gain = information_gain(score_posterior(wins))

    def cost(tree):
        return sum(1.0 / gain[i, j] for i, j in tree)

    def spans(tree):
        graph = np.zeros((5, 5))
        graph[tuple(np.transpose(tree))] = 1
        return connected_components(graph, directed=False)[0] == 1

    trees = [tree for tree in combinations(combinations(range(5), 2), 4) if spans(tree)]
    batch = next_batch(wins, Chance(1))

    assert len(trees) == 125
    assert cost(batch) == pytest.approx(min(map(cost, trees)), rel=1e-9)
    assert list(batch) == sorted(batch, key=lambda pair: -gain[pair])


def test_the_same_seed_gives_the_same_batch_and_another_seed_another():
    nothing = np.zeros((12, 12))
    before = nothing.copy()

    batch = next_batch(nothing, Chance("study", 7))

    assert next_batch(nothing, Chance("study", 7)) == batch
    assert next_batch(nothing, Chance("study", 8)) != batch
    np.testing.assert_array_equal(nothing, before)


def test_the_first_batch_gives_no_condition_most_of_the_trials():
    batch = next_batch(np.zeros((100, 100)), Chance("first"))

    assert np.bincount(np.ravel(batch)).max() < 12


def test_names_of_conditions_do_not_matter(rng):
    """Without equal gains a batch of renumbered conditions is the batch, renumbered."""
    wins = votes(rng, rng.normal(0.0, 2.0, 9), 60)
    order = rng.permutation(9)

    batch = next_batch(wins, Chance(1))
    renumbered = next_batch(wins[np.ix_(order, order)], Chance(1))

    back = [tuple(sorted((int(order[i]), int(order[j])))) for i, j in renumbered]
    assert sorted(back) == sorted(batch)


def test_settled_pairs_are_left_and_near_ones_taken():
    """0 and 1 are alike, far above 2 and 3, which are alike; all were compared as often."""
    wins = np.array([[0, 10, 20, 20], [10, 0, 20, 20], [0, 0, 0, 10], [0, 0, 10, 0]])

    batch = next_batch(wins, Chance(1))

    assert set(batch[:2]) == {(0, 1), (2, 3)}


@pytest.mark.parametrize(
    ("wins", "told"),
    [
        (np.zeros((1, 1)), "wins: must be a square table with two conditions or more (got 1 x 1)"),
        (np.zeros((2, 3)), "wins: must be a square table with two conditions or more (got 2 x 3)"),
        (5.0, "wins: must be a square table with two conditions or more (got a number)"),
        ([[0, -1], [0, 0]], "wins[0, 1]: must be a count of at least 0 (got -1)"),
        ([[0, 1], [float("nan"), 0]], "wins[1, 0]: must be a count of at least 0 (got nan)"),
        ([[0, 1], [1, 2]], "wins[1, 1]: must be 0, since no condition is compared with itself"),
    ],
)
def test_a_table_that_cannot_be_is_refused(wins, told):
    with pytest.raises(StudyError) as raised:
        next_batch(wins, Chance(1))

    assert told in str(raised.value)


def test_a_prior_without_width_is_refused():
    with pytest.raises(StudyError, match=r"prior_sd_jod: must be greater than 0 \(got 0\)"):
        score_posterior(np.zeros((2, 2)), prior_sd_jod=0.0)
