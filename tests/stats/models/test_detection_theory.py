"""d' and criterion by condition, and ideal observers: values by hand, R, recovery, coverage."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_trials import TaskDesign, simulate_abx, simulate_identification, simulate_yes_no
from scipy import stats
from scipy.special import ndtr
from yes_no_table import of_table

from analysis.models.clustered import two_way_influence
from analysis.models.detection import corrected_share, d_prime_influence, discrimination, yes_no
from protocols.answer_rules import Alternatives, answer_rule

R = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_tasks.json").read_text())
SIGNAL = "inconsistent"
SPREADS = ((0.0, 0.0, 0.0, 0.0), (0.4, 0.4, 0.0, 0.4), (0.4, 0.4, 0.4, 0.4), (0.6, 0.4, 0.6, 0.4))
"""Deviations of the criterion between participants and scenes, then of d'."""


def test_alternatives_equal_rs_integral():
    d = np.array([-0.5, 0, 0.5, 1, 2, 4])

    np.testing.assert_allclose(Alternatives(3).share(d), R["alternatives_3"], atol=1e-9)
    np.testing.assert_allclose(Alternatives(8).share(d), R["alternatives_8"], atol=1e-9)
    np.testing.assert_allclose(Alternatives(8).d_prime(Alternatives(8).share(d)), d, atol=1e-6)


def test_two_alternatives_by_hand():
    assert Alternatives(2).share(1.0) == pytest.approx(stats.norm.cdf(1 / np.sqrt(2)))
    assert Alternatives(2).d_prime(0.76) == pytest.approx(np.sqrt(2) * stats.norm.ppf(0.76))


def test_abx_differencing_equals_rs_integral():
    d = np.array([0, 0.5, 1, 2, 4])

    np.testing.assert_allclose(
        answer_rule("differencing").share(d), R["abx_differencing"], atol=1e-9
    )


@pytest.mark.parametrize("rule", ["differencing", "independent"])
def test_abx_observers_who_see_noise_answer_as_the_formula_says(rng, proof_count, rule):
    """Draw A, B and X and apply each rule as it is defined."""
    trials, d = proof_count(2_000_000), 1.7
    a, b = rng.standard_normal(trials), rng.standard_normal(trials) + d
    is_a = rng.random(trials) < 0.5
    x = rng.standard_normal(trials) + np.where(is_a, 0.0, d)
    says_a = {
        "differencing": np.abs(x - a) < np.abs(x - b),
        # The likelihood ratio: which way round A and B came, and which of them X is.
        "independent": (x - d / 2) * (b - a) < 0,
    }

    share = np.mean(says_a[rule] == is_a)

    assert share == pytest.approx(answer_rule(rule).share(d), abs=4 * np.sqrt(0.25 / trials))


@pytest.mark.parametrize("rule", ["differencing", "independent"])
def test_abx_d_prime_is_the_inverse_and_keeps_the_sign(rule):
    d = np.array([-3.0, -0.4, 0.0, 0.4, 3.0])

    np.testing.assert_allclose(answer_rule(rule).d_prime(answer_rule(rule).share(d)), d, atol=1e-6)


def test_signed_d_prime_of_noise_averages_to_nothing_where_the_folded_one_does_not(rng):
    """At d' = 0 the size of d' follows a folded law, like Rice's."""
    shares = corrected_share(rng.binomial(120, 0.5, 4000).astype(float), 120, 0.5, "log-linear")
    d = answer_rule("differencing").d_prime(shares)

    assert abs(np.mean(d)) < 0.05
    assert np.mean(np.abs(d)) > 0.5


def test_unknown_rules_and_corrections_are_refused():
    with pytest.raises(ValueError, match="differencing"):
        answer_rule("difference").share(1.0)
    with pytest.raises(ValueError, match="at least 2"):
        Alternatives(1).share(1.0)
    with pytest.raises(ValueError, match="log-linear"):
        corrected_share(1.0, 2.0, 0.5, "none at all")


def observed(hits, signal, alarms, noise, *, method="ours", who="a"):
    """One participant's yes-no table as trials."""
    rows = [(SIGNAL, k < hits) for k in range(signal)]
    rows += [("consistent", k < alarms) for k in range(noise)]
    return pd.DataFrame(
        [
            {
                "participant": who,
                "scene": f"s{k % 3}",
                "method": method,
                "expected": expected,
                "answer": SIGNAL if said else "consistent",
            }
            for k, (expected, said) in enumerate(rows)
        ]
    )


def test_yes_no_counts_and_measures_are_those_of_the_whole_table():
    rows = pd.concat([observed(15, 20, 4, 18), observed(11, 20, 6, 22, who="b")])
    one = yes_no(rows, ("method",), signal=SIGNAL)["ours"]
    whole = of_table(26, 14, 10, 30, "log-linear")

    assert (one.hits, one.misses, one.false_alarms, one.correct_rejections) == (26, 14, 10, 30)
    assert one.d_prime.value == pytest.approx(whole.d_prime.value)
    assert one.criterion.value == pytest.approx(whole.criterion.value)
    assert one.d_prime.standard_error >= whole.d_prime.standard_error
    assert one.correct.count == 26 + 30
    assert one.bias.count == 36
    assert one.bias_answer == SIGNAL


def test_perfect_observers_show_no_bias_and_a_finite_d_prime():
    """All right: 'inconsistent' is said in exactly half the trials; p was 2 / 2^n."""
    rows = pd.concat([observed(6, 6, 0, 6, who=str(k)) for k in range(10)])
    one = yes_no(rows, signal=SIGNAL)["all"]

    assert one.bias.share == 0.5
    assert one.bias.p == 1.0
    assert one.criterion.p == 1.0
    assert one.correct.p == pytest.approx(2 / 2**10)
    assert 0 < one.d_prime.lower < one.d_prime.value < one.d_prime.upper < np.inf
    assert one.d_prime.p >= 2 / 2**10
    assert any("lower bound" in note for note in one.warnings)


@pytest.mark.parametrize("trials", [(40, 10), (200, 5), (1000, 2)])
def test_perfect_people_do_not_differ_by_the_size_of_the_correction_alone(trials):
    """Half a trial of 1,000 leaves d' at 7.7, half a trial of 2 at 3.8; nobody erred in either."""
    rows = pd.DataFrame(
        [
            (person, name, answer, answer)
            for person in range(8)
            for name, count in zip("ab", trials, strict=True)
            for answer in ("yes", "no")
            for _ in range(count)
        ],
        columns=["participant", "method", "expected", "answer"],
    )
    (gap,) = yes_no(rows, ("method",), signal="yes").d_prime_contrasts

    assert gap.p > 0.3
    assert gap.lower < 0.0 < gap.difference < gap.upper


def test_observers_at_exact_chance_show_neither_sensitivity_nor_bias():
    rows = pd.concat([observed(3, 6, 3, 6, who=str(k)) for k in range(10)])
    one = yes_no(rows, signal=SIGNAL)["all"]

    assert one.d_prime.value == 0.0
    assert one.d_prime.p == one.criterion.p == one.correct.p == one.bias.p == 1.0


def test_without_correction_an_extreme_rate_gives_no_measure_and_says_so():
    rows = pd.concat([observed(6, 6, 2, 6, who=str(k)) for k in range(4)])
    found = yes_no(rows, signal=SIGNAL, correction="none")

    assert found["all"].d_prime is None
    assert found.correction == "none"
    assert any("infinite" in note for note in found["all"].warnings)


def test_a_control_shown_without_signal_has_rates_and_no_d_prime():
    rows = pd.concat(
        [observed(4, 6, 2, 6, who=str(k)) for k in range(4)]
        + [observed(0, 0, 1, 6, method="reference", who=str(k)) for k in range(4)]
    )
    found = yes_no(rows, ("method",), signal=SIGNAL, bias_answer="consistent")

    assert found["reference"].d_prime is None
    assert found["reference"].correct.share == pytest.approx(5 / 6)
    assert found["reference"].bias.share == pytest.approx(5 / 6)
    assert found.d_prime_contrasts == ()
    assert len(found.bias_contrasts) == 1


def test_bias_without_sensitivity_is_told_apart(rng):
    """[BB] Fig. 20: correct at chance, "consistent" said far more often than not."""
    rows = simulate_yes_no(
        TaskDesign(10, 7, 6), {"ours": 0.0}, rng, criterion=0.7, criterion_sd=(0.2, 0.2)
    )
    one = yes_no(rows, ("method",), signal=SIGNAL, bias_answer="consistent")["ours"]

    assert one.correct.lower < 0.5 < one.correct.upper
    assert one.d_prime.lower < 0 < one.d_prime.upper
    assert one.bias.lower > 0.6
    assert one.criterion.lower > 0.2


def test_one_participant_gets_the_errors_of_independent_trials():
    one = yes_no(observed(15, 20, 4, 20), signal=SIGNAL)["all"]

    # Gourevitch and Galanter 1967, of rates with half a trial more in every cell.
    rates = np.array([15.5, 4.5]) / 21
    variance = rates * (1 - rates) / (20 * stats.norm.pdf(stats.norm.ppf(rates)) ** 2)
    assert one.d_prime.standard_error == pytest.approx(np.sqrt(variance.sum()))
    assert one.d_prime.df == np.inf
    assert any("one participant" in note for note in one.warnings)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows.drop(columns="answer"), r"missing \['answer'\]"),
        (lambda rows: rows.assign(answer="maybe"), "two answers"),
        (lambda rows: rows.assign(participant=np.nan), "value in every row"),
    ],
)
def test_yes_no_tables_that_cannot_be_read_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        yes_no(change(observed(3, 6, 3, 6)), signal=SIGNAL)


def test_unknown_references_and_answers_are_refused():
    rows = observed(3, 6, 3, 6)
    with pytest.raises(ValueError, match="reference must be one of"):
        yes_no(rows, signal=SIGNAL, reference="blur")
    with pytest.raises(ValueError, match="bias_answer must be one of"):
        yes_no(rows, signal=SIGNAL, bias_answer="unsure")


def effects(rng, design, spread):
    return spread[0] * rng.standard_normal((design[0], 1)) + spread[1] * rng.standard_normal(
        (1, design[1])
    )


@pytest.mark.slow
@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize(("d_prime", "criterion"), [(0.0, 0.0), (1.0, 0.5), (2.0, 0.3)])
def test_d_prime_and_criterion_cover_and_differences_keep_their_level(
    rng, proof_count, spread, d_prime, criterion
):
    """11 people x 6 scenes x 2: coverage .935 or more, false positives .06 or fewer.

    People and scenes differ in each condition anew, the hardest case for a difference.
    """
    design, repeats, studies = (11, 6), 2, proof_count(2000)
    shown = np.full(design, float(repeats))
    slack = 3.5 * np.sqrt(0.05 * 0.95 / studies)
    mixed = np.sqrt(1 + spread[0] ** 2 + spread[1] ** 2 + (spread[2] ** 2 + spread[3] ** 2) / 4)
    covered, wrong = np.zeros(2), np.zeros(2)
    for _ in range(studies):
        moved = []
        for _condition in range(2):
            c = criterion + effects(rng, design, spread[:2])
            d = d_prime + effects(rng, design, spread[2:])
            hits = rng.binomial(repeats, ndtr(d / 2 - c)).astype(float)
            alarms = rng.binomial(repeats, ndtr(-d / 2 - c)).astype(float)
            moved.append(d_prime_influence(hits, shown, alarms, shown, "log-linear"))
        for k, true in enumerate((d_prime / mixed, criterion / mixed)):
            for one in moved:
                lower, upper = one[k].estimate().limits()
                covered[k] += 0.5 * (lower <= true <= upper)
            gap = two_way_influence(
                np.asarray(moved[0][k].value - moved[1][k].value),
                moved[0][k].cells - moved[1][k].cells,
                moved[0][k].shown + moved[1][k].shown,
                0.5 * (moved[0][k].least + moved[1][k].least),
            )
            wrong[k] += gap.p_value() < 0.05

    assert np.all(covered / studies >= 0.935 - slack)
    assert np.all(wrong / studies <= 0.06 + slack)


def test_a_difference_in_bias_between_methods_is_found_and_named(rng):
    """Claim of [BB] 6.3: ours is called consistent more often than blur."""
    rows = simulate_yes_no(
        TaskDesign(10, 7, 6), {"blur": 0.3, "ours": 0.3}, rng, criterion={"blur": 0.0, "ours": 0.7}
    )
    found = yes_no(rows, ("method",), signal=SIGNAL, bias_answer="consistent", reference="blur")

    (bias,), (d_prime,), (criterion,) = (
        found.bias_contrasts,
        found.d_prime_contrasts,
        found.criterion_contrasts,
    )
    assert (bias.first, bias.second) == ("ours", "blur")
    assert bias.lower > 0
    assert criterion.lower > 0
    assert d_prime.p > 0.05


def test_identification_recovers_d_prime_and_its_limits_are_those_of_the_share(rng):
    rows = simulate_identification(
        TaskDesign(10, 4, 8), {"ours": 0.0}, rng, levels=[0.6], width=3.0, alternatives=4, lapse=0.0
    )
    one = discrimination(rows, Alternatives(4), ("method",))["ours"]
    share = 0.25 + 0.75 * stats.norm.cdf(0.6 / 3.0 * 2 * stats.norm.ppf(0.95))

    assert one.lower < Alternatives(4).d_prime(share) < one.upper
    assert one.lower == pytest.approx(float(Alternatives(4).d_prime(one.correct.lower)))
    assert one.correct.chance == 0.25


def test_abx_says_nothing_was_seen_exactly_where_the_share_says_so(rng):
    rows = simulate_abx(
        TaskDesign(10, 1, 20), {"v1": 0.2}, rng, scalings=[0.1, 0.5], critical_sd=0.0
    )
    found = discrimination(rows, answer_rule("differencing"), ("scaling",))

    for one in found.conditions:
        assert (one.lower <= 0 <= one.upper) == (one.correct.p >= 0.05)
    assert found["0.5"].lower > 1
    assert found.contrasts[0].upper < 0
    assert found.rule == "ABX, differencing rule"
    assert (
        discrimination(rows, answer_rule("independent"), ("scaling",))["0.5"].d_prime
        < found["0.5"].d_prime
    )


def test_all_right_in_abx_is_a_bound_and_not_infinite():
    rows = pd.DataFrame({"participant": np.repeat(list("abcdefg"), 10), "scene": "x", "correct": 1})
    one = discrimination(rows, answer_rule("differencing"))["all"]

    assert np.isfinite(one.d_prime)
    assert one.upper == np.inf
    assert any("bound" in note for note in one.warnings)
