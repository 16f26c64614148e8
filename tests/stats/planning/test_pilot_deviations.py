"""Pilots of tasks with right answers: deviations taken from them are those they were made with."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtr, ndtri

from analysis.pilot import sensitivity_deviations, threshold_deviations
from analysis.tasks import analysis_of
from protocols.answer_rules import Alternatives, answer_rule
from protocols.errors import StudyError

CONDITIONS = ("blur", "ours")


def effects(rng, count, sd):
    """Deviations in two conditions that have half their variance in common."""
    return sd * np.sqrt(0.5) * (rng.standard_normal((count, 1)) + rng.standard_normal((count, 2)))


def made_up(rng, *, people=40, scenes=16, repeats=4, sd=0.6, scene_sd=0.4, criterion_sd=0.5):
    """Rows of a pilot: who, where, which condition, d' and criterion of each trial."""
    person, scene, condition, repeat = np.indices((people, scenes, 2, repeats)).reshape(4, -1)
    d = 1.6 + effects(rng, people, sd)[person, condition]
    d = d + effects(rng, scenes, scene_sd)[scene, condition]
    rows = pd.DataFrame(
        {
            "participant": np.char.add("p", person.astype(str)),
            "scene": np.char.add("s", scene.astype(str)),
            "method": np.array(CONDITIONS)[condition],
            "order": np.arange(person.size),
        }
    )
    return rows, d, effects(rng, people, criterion_sd)[person, condition], repeat % 2 == 0


def deviations(kind, rows, **options):
    analysis = analysis_of(kind)
    given = analysis.options(by="method", **options)
    settings = analysis.plan_of_table(rows, "pilot", given)
    share = None if kind == "detection" else settings.answer_rule.share
    return sensitivity_deviations(rows, settings, share)


def test_yes_and_no_tell_how_d_prime_and_criterion_differ(rng):
    rows, d, criterion, there = made_up(rng)
    seen = rng.random(len(d)) < ndtr(np.where(there, 0.5, -0.5) * d - criterion)
    for name, said in (("expected", there), ("answer", seen)):
        rows[name] = np.where(said, "yes", "no")
    rows["correct"] = (there == seen).astype(int)

    values, notes = deviations("detection", rows, signal="yes")

    assert values["participant_sd"] == pytest.approx(0.6, abs=0.17)
    assert values["scene_sd"] == pytest.approx(0.4, abs=0.17)
    assert values["criterion_sd"] == pytest.approx(0.5, abs=0.12)
    assert notes == ()


@pytest.mark.parametrize(
    ("kind", "share", "options"),
    [
        ("identification", lambda d: Alternatives(4).share(d), {"alternatives": 4}),
        ("abx", lambda d: answer_rule("differencing").share(d), {}),
    ],
)
def test_right_answers_tell_how_d_prime_differs(rng, kind, share, options):
    rows, d, _, _ = made_up(rng, repeats=6)
    grid = np.linspace(0.0, 8.0, 801)
    chance = np.interp(np.maximum(d, 0.0), grid, share(grid))
    rows["correct"] = (rng.random(len(d)) < chance).astype(int)

    values, _ = deviations(kind, rows, **options)

    assert values["participant_sd"] == pytest.approx(0.6, abs=0.2)
    assert values["scene_sd"] == pytest.approx(0.4, abs=0.2)
    assert set(values) == {"participant_sd", "scene_sd"}


def test_thresholds_differ_as_shares_of_the_range_of_levels(rng):
    """Levels 0 to 10: thresholds of people deviate by 1.5, of a person's condition by .8."""
    person, condition, level, _ = np.indices((30, 2, 11, 24)).reshape(4, -1)
    own = 5.0 + rng.normal(0, 1.5, (30, 1)) + rng.normal(0, 0.8, (30, 2))
    right = 0.5 + 0.5 * ndtr((level - own[person, condition]) / 1.2)
    rows = pd.DataFrame(
        {
            "participant": np.char.add("p", person.astype(str)),
            "method": np.array(CONDITIONS)[condition],
            "level": level.astype(float),
            "order": np.arange(person.size),
            "correct": (rng.random(person.size) < right).astype(int),
        }
    )
    analysis = analysis_of("identification")
    options = analysis.options(by="method", level="level", alternatives=2)
    settings = analysis.plan_of_table(rows, "pilot", options)

    values, notes = threshold_deviations(rows, settings, span=10.0)
    sigmas = (ndtri(0.95) - ndtri(0.05)) * 1.2 / 10.0  # from 5 to 95 % of the rise

    assert values["participant_sd"] == pytest.approx(0.15, abs=0.06)
    assert values["interaction_sd"] == pytest.approx(0.08, abs=0.04)
    assert values["width"] == pytest.approx(sigmas, rel=0.2)
    assert notes == ()


def test_a_pilot_that_cannot_tell_says_so(rng):
    guessed = made_up(rng)[0]
    guessed["correct"] = (rng.random(len(guessed)) < 0.27).astype(int)
    with pytest.raises(StudyError, match="between chance and always"):
        deviations("identification", guessed, alternatives=4)

    rows = made_up(rng, people=5, scenes=3)[0]
    rows["correct"] = (rng.random(len(rows)) < 0.6).astype(int)
    with pytest.raises(StudyError, match="nearly everyone always answers alike"):
        deviations("identification", rows.assign(correct=1), alternatives=4)
    with pytest.raises(StudyError, match=r"three participants at least \(found 2\)"):
        deviations("identification", rows[rows["participant"] < "p2"], alternatives=2)
    notes = deviations("identification", rows, alternatives=4)[1]
    assert [note.split(" in ")[0] for note in notes] == ["only 5 participants", "only 3 scenes"]
