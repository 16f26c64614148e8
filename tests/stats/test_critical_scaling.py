"""Critical scaling of ABX: the law, recovery, coverage, comparisons, refusals."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up_trials import TaskDesign, simulate_abx
from scipy.special import expit, logsumexp
from scipy.stats import norm

from analysis.models.critical_scaling import (
    critical_misfits,
    critical_scaling,
    critical_scalings,
)
from analysis.models.curves.critical_likelihood import (
    CriticalLikelihood,
    Parameters,
    scaling_d_prime,
)
from analysis.report.values import as_json
from protocols.answer_rules import answer_rule

SCALINGS = list(np.geomspace(0.06, 0.6, 8))


def study(rng, critical=0.2, *, people=10, repeats=18, **more):
    return simulate_abx(
        TaskDesign(people, 1, repeats),
        {"v1": critical},
        rng,
        scalings=SCALINGS,
        **{"interaction_sd": 0.0, **more},
    )


def test_the_law_by_hand():
    """Twice the critical scaling: d'^2 = 16 (1 - 1/4); 0 up to it."""
    scaling = np.array([0.1, 0.2, 0.4])

    np.testing.assert_allclose(scaling_d_prime(scaling, 0.2, 4.0), [0, 0, 4 * np.sqrt(0.75)])


def likelihood(rng, scenes=2):
    """Two people in two conditions at three scalings, four trials each."""
    shown = np.full((2, 2, scenes, 3), 4.0)
    right = rng.binomial(4, 0.75, shown.shape).astype(float)
    return CriticalLikelihood(right, shown, np.array([0.1, 0.2, 0.5]), "differencing", common=True)


THETA = [-1.9, -1.5, 1.2, 1.6, *np.log([0.4, 0.3, 0.5]), -3.0, 0.1, -0.2, 0.0, 0.15]


def test_the_likelihood_is_the_integral_over_peoples_deviations(rng):
    """Of a deviation in all conditions, one in each, and of gain, by sums over finer nodes."""
    model = likelihood(rng)
    at = Parameters.of(np.array(THETA), 2)
    z = np.linspace(-4.5, 4.5, 46)
    weight = np.log(norm.pdf(z) * (z[1] - z[0]))
    a, b, e = np.meshgrid(z, z, z[::3], indexing="ij", sparse=True)
    lapse, total = expit(-3.0), 0.0
    for person in range(2):
        by_a = weight.copy()
        for k in range(2):
            log_s = at.place[k] + 0.4 * a + 0.3 * b + at.scenes[k][:, None, None, None]
            d = scaling_d_prime(
                model.scalings, np.exp(log_s)[..., None], np.exp(at.gain[k] + 0.5 * e)[..., None]
            )
            share = (1 - lapse) * answer_rule("differencing").share(d) + 0.5 * lapse
            right = model.right[k, person][:, None, None, None]
            told = (right * np.log(share) + (4 - right) * np.log1p(-share)).sum(axis=(0, -1))
            by_a += logsumexp(told + weight[:, None] + weight[::3] + np.log(3.0), axis=(1, 2))
        total += logsumexp(by_a)
    above = model.above(at.scenes)
    found = model.people(at, (above @ model.logs(lapse)[0], above @ model.logs(lapse)[1]))

    assert found.log_likelihood == pytest.approx(total, abs=0.02)


@pytest.mark.parametrize(("scenes", "common"), [(1, True), (2, True), (1, False)])
def test_the_slope_is_that_of_the_likelihood(rng, scenes, common):
    model = replace(likelihood(rng, scenes), common=common)
    theta = np.array(THETA[: 8 + 4 * (scenes > 1)])
    steps = 1e-4 * np.eye(theta.size)
    slope = [(model(theta + step)[0] - model(theta - step)[0]) / 2e-4 for step in steps]

    # The slope along scenes is read between the places of a table, as its values are.
    np.testing.assert_allclose(model(theta)[1], slope, atol=0.03)


@pytest.mark.slow
def test_limits_of_the_typical_critical_scaling_cover(rng, proof_count):
    """10 people x 8 scalings x 18: coverage .93 or more; bias below a tenth of the spread."""
    studies = proof_count(100)
    covered, errors = [], []
    for _ in range(studies):
        fit = critical_scaling(study(rng))
        assert fit.critical_limits is not None
        covered.append(fit.critical_limits[0] <= 0.2 <= fit.critical_limits[1])
        errors.append(np.log(fit.critical / 0.2))

    assert np.mean(covered) >= 0.93 - 3.5 * np.sqrt(0.05 * 0.95 / studies)
    # The law goes from its foot to three quarters of its height over ln 2.
    assert abs(np.mean(errors)) < 0.1 * np.log(2) + 3.5 * 0.1 / np.sqrt(studies)


def test_participants_have_their_own_critical_scaling(rng):
    rows = study(rng, repeats=60, critical_sd=0.5, gain_sd=0.0)
    fit = critical_scaling(rows)
    right = rows.groupby("participant")["correct"].mean()

    assert fit.critical_sd == pytest.approx(0.5, abs=0.3)
    assert list(fit.individual) == list(right.index)
    drawn = np.log([fit.individual[who][0] for who in right.index])
    assert np.corrcoef(drawn, right)[0, 1] < -0.9


@pytest.mark.slow
def test_scenes_have_their_own_critical_scaling():
    true = {"a": 0.08, "b": 0.12, "c": 0.2, "d": 0.3}
    alike = {"people": 5, "repeats": 12, "gain_sd": 0.0, "critical_sd": 0.05}
    parts = [
        study(np.random.default_rng(5), one, **alike).assign(scene=name)
        for name, one in true.items()
    ]
    fit = critical_scaling(pd.concat(parts))

    assert fit.scene_sd == pytest.approx(np.std(np.log(list(true.values())), ddof=1), rel=0.4)
    for name, one in true.items():
        value, low, high = fit.scenes[name]
        assert low < value < high
        assert value == pytest.approx(one, rel=0.3)
    assert fit.critical_limits[1] / fit.critical_limits[0] > 1.5  # they speak of other scenes
    alone = critical_scaling(parts[0])
    assert (alone.scenes, alone.scene_sd) == ({}, 0.0)


def test_the_mean_curve_follows_the_answers_of_all(rng):
    rows = study(rng, people=12, repeats=60, critical_sd=0.4)
    fit = critical_scaling(rows)
    share = rows.groupby("scaling")["correct"].mean()

    np.testing.assert_allclose(fit.average_share(share.index.to_numpy()), share, atol=0.06)
    assert fit.share(np.array([0.01]))[0] == pytest.approx(0.5)
    assert fit.d_prime(np.array([0.01]))[0] == 0.0


def test_two_models_with_different_critical_scalings_are_told_apart(rng):
    rows = simulate_abx(
        TaskDesign(8, 1, 20), {"luminance": 0.1, "v1": 0.25}, rng, scalings=SCALINGS
    )
    found = critical_scalings(rows, ("method",))
    fits, (gap,) = found.fits, found.contrasts

    assert [fit.condition for fit in fits] == ["luminance", "v1"]
    assert (gap.first, gap.second, gap.measure) == ("luminance", "v1", "ln s_c")
    assert gap.upper < 0
    assert gap.p < 0.01
    assert gap.difference == pytest.approx(np.log(fits[0].critical / fits[1].critical))
    for fit in fits:
        assert fit.critical_limits[0] < fit.critical_limits[1]


def test_a_condition_in_which_nothing_was_seen_is_not_compared(rng):
    rows = simulate_abx(
        TaskDesign(6, 1, 12), {"luminance": 0.1, "v1": 0.25}, rng, scalings=SCALINGS
    )
    guessed = rows["correct"].where(rows["method"] == "luminance", rows.index % 2)
    found = critical_scalings(rows.assign(correct=guessed), ("method",))
    fits, gaps = found.fits, found.contrasts

    assert [fit.critical_identified for fit in fits] == [True, False]
    assert gaps == ()
    written = as_json(fits[1])
    assert (written["critical"], written["individual"], written["scenes"]) == (None, None, None)
    assert as_json(fits[0])["critical"] == pytest.approx(fits[0].critical)


def test_people_who_never_see_a_difference_are_said_to(rng):
    fit = critical_scaling(study(rng, 5.0, people=6))

    assert any("hardly a difference was seen" in note for note in fit.warnings)
    assert not any("hardly" in note for note in critical_scaling(study(rng)).warnings)


def test_limits_of_one_person_hold_the_critical_scaling(rng):
    """Of 7 or 8 answers at each scaling; nobody else's deviation widens or narrows them."""
    fits = [
        critical_scaling(study(rng, people=1, repeats=8, critical_sd=0.0, gain_sd=0.0))
        for _ in range(40)
    ]
    known = [fit for fit in fits if fit.critical_identified]
    covered = [fit.critical_limits[0] <= 0.2 <= fit.critical_limits[1] for fit in fits]

    assert len(known) > 30
    assert np.mean(covered) >= 0.95 - 3.5 * np.sqrt(0.05 * 0.95 / len(fits))
    assert np.median([one.critical_limits[1] / one.critical_limits[0] for one in known]) < 4
    assert {fit.participants for fit in fits} == {1}
    (misfit,), _ = critical_misfits(critical_scalings(study(rng, people=1)), rng)
    assert 0.0 < misfit.p <= 1.0


def test_one_person_who_guesses_or_sees_all_has_no_critical_scaling(rng):
    rows = study(rng, people=1)
    seen = critical_scaling(rows.assign(correct=1))
    guessed = critical_scaling(rows.assign(correct=np.arange(len(rows)) % 2))

    assert not seen.critical_identified
    assert not guessed.critical_identified
    assert seen.critical_limits[0] == 0.0
    assert seen.critical_limits[1] < 0.1
    assert guessed.critical_limits[1] == np.inf


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.drop(columns="scaling"), "missing"),
        (lambda r: r.assign(scaling=-1.0), "positive"),
        (lambda r: r.assign(scaling=0.2), "two scalings"),
    ],
)
def test_tables_without_critical_scaling_are_refused(rng, change, message):
    with pytest.raises(ValueError, match=message):
        critical_scaling(change(study(rng, people=3, repeats=2)))


def test_groups_of_people_who_saw_one_condition_each_are_two_samples(rng):
    both = [
        study(rng, one, people=6, repeats=8, critical_sd=0.1).assign(method=name)
        for name, one in (("a", 0.12), ("b", 0.3))
    ]
    both[1]["participant"] = "Q" + both[1]["participant"]
    (gap,) = critical_scalings(pd.concat(both), ("method",)).contrasts

    assert gap.df == pytest.approx(10.0)
    assert gap.upper < 0


@pytest.mark.slow
def test_goodness_of_fit_keeps_its_level_and_sees_another_curve(rng, proof_count):
    """Studies of the law: p is about uniform; shares that rise evenly are no such law."""
    studies = proof_count(30)
    p = []
    for _ in range(studies):
        (one,), _ = critical_misfits(critical_scalings(study(rng, people=6)), rng)
        p.append((one.p, one.level_p))
    error = np.sqrt(0.25 / studies)

    assert np.mean(np.array(p) < 0.05, axis=0).max() <= 0.05 + 3.5 * np.sqrt(0.05 * 0.95 / studies)
    assert np.abs(np.mean(np.array(p) < 0.5, axis=0) - 0.5).max() < 3.5 * error
    rows = study(rng, people=12, repeats=30)
    even = 0.5 + 0.45 * np.log(rows["scaling"] / 0.06) / np.log(10.0)
    (one,), _ = critical_misfits(
        critical_scalings(rows.assign(correct=(rng.random(len(rows)) < even).astype(int))), rng
    )
    assert one.level_p < 0.01
