"""Critical scaling of ABX: the law, recovery, coverage, comparisons, refusals."""

import numpy as np
import pytest
from made_up_trials import TaskDesign, simulate_abx

from analysis.models.critical_scaling import (
    critical_scaling,
    critical_scalings,
    fit_alone,
    scaling_d_prime,
)
from analysis.report.values import as_json

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


@pytest.mark.parametrize("rule", ["differencing", "independent"])
def test_one_persons_critical_scaling_is_recovered(rng, rule):
    rows = study(rng, people=1, repeats=400, critical_sd=0.0, gain_sd=0.0, rule=rule)
    critical, gain = fit_alone(rows, column="scaling", rule=rule)

    assert critical == pytest.approx(0.2, rel=0.12)
    assert gain == pytest.approx(4.0, rel=0.2)


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
    own = {
        who: fit_alone(part, column="scaling", rule="differencing")[0]
        for who, part in rows.groupby("participant")
    }

    assert fit.critical_sd == pytest.approx(0.5, abs=0.3)
    assert list(fit.individual) == list(own)
    drawn = np.log([fit.individual[who][0] for who in own])
    alone = np.log(list(own.values()))
    assert np.corrcoef(drawn, alone)[0, 1] > 0.9


def test_the_mean_curve_follows_the_answers_of_all(rng):
    rows = study(rng, people=12, repeats=60, critical_sd=0.4)
    fit = critical_scaling(rows)
    share = rows.groupby("scaling")["correct"].mean()

    np.testing.assert_allclose(fit.average_share(share.index.to_numpy()), share, atol=0.05)
    assert fit.share(np.array([0.01]))[0] == pytest.approx(0.5)
    assert fit.d_prime(np.array([0.01]))[0] == 0.0


def test_two_models_with_different_critical_scalings_are_told_apart(rng):
    rows = simulate_abx(
        TaskDesign(8, 1, 20), {"luminance": 0.1, "v1": 0.25}, rng, scalings=SCALINGS
    )
    fits, (gap,) = critical_scalings(rows, ("method",))

    assert [fit.condition for fit in fits] == ["luminance", "v1"]
    assert (gap.first, gap.second, gap.measure) == ("luminance", "v1", "ln s_c")
    assert gap.upper < 0
    assert gap.p < 0.01
    for fit in fits:
        assert fit.critical_limits[0] < fit.critical_limits[1]


def test_a_condition_in_which_nothing_was_seen_is_not_compared(rng):
    rows = simulate_abx(
        TaskDesign(6, 1, 12), {"luminance": 0.1, "v1": 0.25}, rng, scalings=SCALINGS
    )
    guessed = rows["correct"].where(rows["method"] == "luminance", rows.index % 2)
    fits, gaps = critical_scalings(rows.assign(correct=guessed), ("method",))

    assert [fit.critical_identified for fit in fits] == [True, False]
    assert gaps == ()
    written = as_json(fits[1])
    assert (written["critical"], written["individual"], written["alone"]) == (None, None, None)
    assert as_json(fits[0])["critical"] == pytest.approx(fits[0].critical)


def test_people_who_never_see_a_difference_are_said_to(rng):
    fit = critical_scaling(study(rng, 5.0, people=6))

    assert any("hardly a difference was seen" in note for note in fit.warnings)
    assert not any("hardly" in note for note in critical_scaling(study(rng)).warnings)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.drop(columns="scaling"), "missing"),
        (lambda r: r.assign(scaling=-1.0), "positive"),
        (lambda r: r.assign(scaling=0.2), "two scalings"),
        (lambda r: r[r["participant"] == "P001"], "two participants"),
    ],
)
def test_tables_without_critical_scaling_are_refused(rng, change, message):
    with pytest.raises(ValueError, match=message):
        critical_scaling(change(study(rng, people=3, repeats=2)))
