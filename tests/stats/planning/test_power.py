"""Power by simulation of the protocol's own design and test."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

from analysis.models.clustered import two_way, two_way_of_first
from analysis.parts.preferences import PreferencesPart
from analysis.pilot import preference_deviations
from analysis.plans.preference_plan import PreferencePlan, preference_plan, preference_plan_of_table
from analysis.plans.table_sections import PreferenceTableSection
from analysis.power import default_participants, power
from analysis.simulations import Choices, mean_logit
from protocols.errors import StudyError

SCENES = tuple(f"s{i}" for i in range(6))


@pytest.fixture(scope="module")
def settings(demo_protocol) -> PreferencePlan:
    """The demonstration study with six scenes and eleven people, as the paper's."""
    found = preference_plan(demo_protocol)
    wide = tuple(replace(entry, scenes=SCENES) for entry in found.comparisons)
    return found.but(comparisons=wide, planned_participants=11)


def curve_of(settings: PreferencePlan, rng, participants=None, **how: float) -> SimpleNamespace:
    """Power of choices; `how` says what is assumed, and ``studies``, ``designs``."""
    own = {name: how.pop(name) for name in ("studies", "designs") if name in how}
    simulation = Choices(settings, (PreferencesPart(),))
    found = power(simulation, how, rng=rng, participants=participants, **own)
    return SimpleNamespace(**found.numbers)


def test_running_sums_give_what_the_test_gives_for_the_first_people(rng):
    votes = rng.binomial(2, 0.6, (40, 12, 6)).astype(float)

    at_once = two_way_of_first(votes, np.full(6, 2.0), (5, 12))
    alone = two_way(votes[:, :5], 2.0)

    np.testing.assert_allclose(at_once.standard_error[:, 0], alone.standard_error, atol=1e-12)
    np.testing.assert_allclose(at_once.df[:, 0], alone.df, rtol=1e-9)
    np.testing.assert_allclose(at_once.share[:, 0], alone.share)


def test_power_agrees_with_analysing_simulated_studies_one_by_one(settings):
    """The same question asked of `two_way` directly, primary comparison over both sizes."""
    rng = np.random.default_rng(3)
    curve = curve_of(settings, rng, [11], rate=0.65, studies=3000)

    assert curve.primary[0] == pytest.approx(power_over_two_sizes(rng, 1.0), abs=0.04)


def power_over_two_sizes(rng, correlation, studies=3000):
    """Studies of 11 people x 6 scenes x 2 sizes x 2 whose effects correlate so between sizes."""
    both = np.array([[1.0, correlation], [correlation, 1.0]])
    root = np.linalg.cholesky(both + 1e-12 * np.eye(2))
    person = rng.standard_normal((studies, 11, 2)) @ root.T
    scene = rng.standard_normal((studies, 6, 2)) @ root.T
    votes = np.zeros((studies, 11, 6))
    for size in range(2):
        logit = mean_logit(0.65, np.hypot(0.6, 0.4)) + 0.6 * person[:, :, None, size]
        votes += rng.binomial(2, expit(logit + 0.4 * scene[:, None, :, size]))
    return np.mean(two_way(votes, 4.0).p_value() < 0.05)


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_effects_correlate_between_sizes_as_stated(settings, rng, correlation):
    curve = curve_of(settings, rng, [11], rate=0.65, size_correlation=correlation, studies=3000)

    assert curve.primary[0] == pytest.approx(power_over_two_sizes(rng, correlation), abs=0.04)


def test_power_over_sizes_promises_least_where_people_are_alike_at_all_sizes(settings, rng):
    """Redrawn per size, people average out over sizes: a promise that no study keeps."""
    by_correlation = [
        curve_of(settings, rng, [11], rate=0.65, size_correlation=correlation, studies=3000)
        for correlation in (0.0, 0.5, 1.0)
    ]
    primary = [curve.primary[0] for curve in by_correlation]

    assert primary[0] - primary[1] > 0.03
    assert primary[1] - primary[2] > 0.03
    assert np.ptp([curve.each[0] for curve in by_correlation]) < 0.04  # one size at a time
    default = curve_of(settings, rng, [11], rate=0.65, studies=3000)
    assert default.primary[0] == pytest.approx(primary[2], abs=0.04)


def test_a_study_that_cannot_show_equivalence_is_told_so(settings, rng):
    few, many = (
        curve_of(
            settings.but(planned_participants=people, smallest_effect_rate=margin),
            rng,
            [people],
            rate=0.6,
            studies=300,
        )
        for people, margin in ((11, 0.1), (60, 0.3))
    )

    assert any(
        "equivalence within ±0.1 would be shown in 0." in note and "do not plan" in note
        for note in few.warnings
    )
    assert few.equivalence[0] < 0.5 < many.equivalence[0]
    assert not any("equivalence" in note for note in many.warnings)


def test_power_rises_with_participants_and_effect(settings, rng):
    small = curve_of(settings, rng, [6, 12, 24], rate=0.6, studies=600)
    large = curve_of(settings, rng, [6, 12, 24], rate=0.75, studies=600)

    assert small.primary[0] < small.primary[1] < small.primary[2]
    assert np.all(large.primary > small.primary)
    assert np.all(small.every <= small.each)
    assert np.all(small.each <= small.primary)  # one size, and corrected


def test_without_an_effect_power_is_alpha(settings, rng):
    curve = curve_of(
        settings, rng, [11, 20], rate=0.5, participant_sd=0.5, scene_sd=0.0, studies=3000
    )

    assert np.all(curve.primary < 0.065)
    assert np.all(curve.false_positives < 0.065)


def test_equivalence_needs_more_people_than_a_large_effect(settings, rng):
    curve = curve_of(
        settings, rng, [8, 40], rate=0.75, participant_sd=0.3, scene_sd=0.1, studies=500
    )

    assert curve.equivalence[0] < curve.primary[0]
    assert curve.equivalence[1] > curve.equivalence[0]


def test_needed_participants_reach_the_goal_on_the_curve(settings, rng):
    curve = curve_of(settings, rng, rate=0.7, studies=1000)
    needed = {(name, goal): people for name, goal, people in curve.needed}
    primary = dict(zip(curve.participants, curve.primary, strict=True))

    eighty, ninety = needed["primary", 0.8], needed["primary", 0.9]
    assert eighty is not None
    assert ninety is not None
    assert eighty <= ninety
    assert primary[eighty] >= 0.8 - 3 * np.sqrt(0.8 * 0.2 / curve.studies)


def test_population_rate_is_kept_whatever_the_spread(rng):
    logit = mean_logit(0.7, 1.2)

    assert expit(logit + rng.normal(0, 1.2, 400_000)).mean() == pytest.approx(0.7, abs=2e-3)
    assert mean_logit(0.7, 0.0) == pytest.approx(np.log(0.7 / 0.3))


def test_the_same_seed_gives_the_same_curve(settings):
    one, two = (
        curve_of(settings, np.random.default_rng(4), [8], rate=0.6, studies=200) for _ in range(2)
    )

    assert one.primary[0] == two.primary[0]


def test_few_scenes_are_flagged(demo_protocol, rng):
    curve = curve_of(preference_plan(demo_protocol), rng, [4], rate=0.6, studies=100)

    assert any("two scenes show hardly anything" in note for note in curve.warnings)


def test_a_design_whose_test_errs_too_often_is_not_to_be_planned_by(settings, rng):
    def notes(scenes: int) -> list[str]:
        entry = replace(settings.comparisons[0], scenes=tuple("abcdef"[:scenes]))
        curve = curve_of(settings.but(comparisons=(entry,)), rng, [8, 30], rate=0.7, studies=400)
        found = [note for note in curve.warnings if "errs too often" in note]
        assert (curve.needed == ()) == bool(found)  # no number of participants beside the note
        return found

    (note,) = notes(1)
    assert "of studies of 30 participants are significant all the same, at alpha 0.05" in note
    assert notes(6) == []


def test_impossible_assumptions_are_refused(settings, make_decisions, rng):
    with pytest.raises(ValueError, match=r"rate must lie between 0.01 and 0.99 \(got 1\)"):
        curve_of(settings, rng, rate=1.0)
    with pytest.raises(ValueError, match="participant_sd must lie between 0 and 5"):
        curve_of(settings, rng, participant_sd=-1.0)
    with pytest.raises(ValueError, match="size_correlation must lie between 0 and 1"):
        curve_of(settings, rng, size_correlation=1.5)
    with pytest.raises(ValueError, match="at least 2"):
        curve_of(settings, rng, [1])
    with pytest.raises(ValueError, match="declare comparisons"):
        curve_of(preference_plan_of_table(make_decisions(), "x", PreferenceTableSection()), rng)


def test_curves_reach_past_the_plan():
    assert max(default_participants(4)) == 40
    assert max(default_participants(60)) >= 120
    assert 61 in default_participants(61)


def pilot(rng, people, scenes, participant_sd, scene_sd, correlation):
    """Decisions of a pilot: two methods at two sizes, twice, with effects that correlate so."""
    person, scene, size, repeat = (
        axis.ravel()
        for axis in np.meshgrid(range(people), range(scenes), range(2), range(2), indexing="ij")
    )

    def effect(count, sd):
        common, own = rng.standard_normal((count, 1)), rng.standard_normal((count, 2))
        return sd * (np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own)

    logit = 0.4 + effect(people, participant_sd)[person, size]
    chose_b = rng.random(person.size) > expit(logit + effect(scenes, scene_sd)[scene, size])
    return pd.DataFrame(
        {
            "participant": [f"p{n}" for n in person],
            "scene": [f"s{n}" for n in scene],
            "size": [("small", "large")[n] for n in size],
            "first": np.where(repeat, "b", "a"),
            "second": np.where(repeat, "a", "b"),
            "chosen": np.where(chose_b, "b", "a"),
        }
    )


def test_deviations_of_a_pilot_are_those_it_was_made_with(rng):
    found = [preference_deviations(pilot(rng, 40, 16, 0.9, 0.5, 0.5)) for _ in range(4)]

    for name, true, near in (
        ("participant_sd", 0.9, 0.12),
        ("scene_sd", 0.5, 0.12),
        ("size_correlation", 0.5, 0.15),
    ):
        assert np.mean([values[name] for values, _ in found]) == pytest.approx(true, abs=near)
    assert found[0][1] == ()


def test_a_small_pilot_says_that_its_deviations_are_guesses(rng):
    table = pilot(rng, 6, 4, 0.9, 0.5, 0.5)

    _, notes = preference_deviations(table)
    assert [note.split(" in ")[0] for note in notes] == ["only 6 participants", "only 4 scenes"]
    one_size, _ = preference_deviations(table[table["size"] == "small"])
    assert one_size.keys() == {"participant_sd", "scene_sd"}
    with pytest.raises(StudyError, match="three participants"):
        preference_deviations(pilot(rng, 2, 4, 0.5, 0.5, 0.5))
    with pytest.raises(StudyError, match="no finite estimate"):
        preference_deviations(table.assign(chosen=np.where(table["participant"] < "p3", "a", "b")))
    with pytest.raises(StudyError, match="everyone answers alike in every comparison"):
        preference_deviations(table.assign(chosen="a"))


def test_a_comparison_in_which_all_answer_alike_does_not_keep_a_pilot_from_telling(rng):
    table = pilot(rng, 16, 12, 0.9, 0.5, 1.0)
    always = table.replace({"first": {"b": "c"}, "second": {"b": "c"}}).assign(chosen="a")

    found, _ = preference_deviations(pd.concat([table, always], ignore_index=True))
    alone, _ = preference_deviations(table)

    assert found["participant_sd"] == pytest.approx(alone["participant_sd"], rel=1e-6)


def test_power_over_scenes_and_repeats_rises_and_agrees_with_the_curve(settings, rng):
    curve = curve_of(settings, rng, [11], rate=0.65, studies=600, designs=True)
    power = {(one.scenes, one.repeats): one.primary for one in curve.designs}

    (own,) = {(len(entry.scenes), entry.repeats) for entry in settings.comparisons}
    assert power[own] == pytest.approx(curve.primary[0], abs=0.06)
    assert power[2, 1] < power[6, 1] - 0.1 < power[24, 1] - 0.2
    assert power[4, 1] <= power[4, 4] + 0.03
