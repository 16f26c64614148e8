"""Up-down tracks: by hand, against SweetSpot and psychopy, and what must hold."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from adaptive_recovery import of_reversals
from hypothesis import given
from hypothesis import strategies as st
from up_down_rules import performance, transformed, weighted

from protocols.adaptive.up_down import UpDown, next_level, track
from protocols.errors import StudyError

ORACLE = json.loads(
    (Path(__file__).parents[1] / "oracles" / "adaptive.json").read_text(encoding="utf-8")
)["up_down"]

LEVELS = tuple(float(level) for level in range(11))
QUARTERS = weighted(LEVELS, start=8.0, target=0.75, harder=(1.0,))
TWO = transformed(LEVELS, start=8.0, in_a_row=2, steps=(2.0, 1.0))

answers = st.lists(st.booleans(), max_size=60)


def walk(settings, corrects):
    """Give these answers at the levels that the rule asks for."""
    history = []
    for correct in corrects:
        history.append((next_level(history, settings), correct))
    return history


def shown(settings, corrects):
    """Return the level of each trial, and of the one after the last."""
    history = walk(settings, corrects)
    return [*(level for level, _ in history), next_level(history, settings)]


def test_a_weighted_track_by_hand():
    """For .75: one down after a correct answer, three up after a wrong one."""
    assert QUARTERS.easier == (3.0,)
    assert shown(QUARTERS, [True, True, False, True, False]) == [8, 7, 6, 9, 8, 10]


def test_a_transformed_track_by_hand():
    """One correct answer is enough until the first reversal, which halves the step."""
    corrects = [True, True, False, True, True, True, False, True]

    assert shown(TWO, corrects) == [8, 6, 4, 5, 5, 4, 4, 5, 5]
    assert track(walk(TWO, corrects), TWO).reversals == (2, 4, 6)


def test_without_the_rule_for_the_start_it_takes_two_from_the_first_trial():
    assert shown(replace(TWO, one_at_first=False), [True, True, True, False]) == [8, 8, 6, 6, 7]


@pytest.mark.parametrize(
    ("settings", "share"),
    [
        (QUARTERS, 0.75),
        (weighted(LEVELS, start=8.0, target=0.5, harder=(2.0,)), 0.5),
        (TWO, 0.70711),
        (replace(TWO, in_a_row=3), 0.79370),
        (replace(TWO, harder=(1.0,), easier=(3.0,)), 0.86603),
    ],
)
def test_the_performance_it_converges_to_by_hand(settings, share):
    assert performance(settings) == pytest.approx(share, abs=1e-5)


def test_an_estimate_by_hand():
    """Reversals at 6, 9, 8, 10, 7, 10: one is the start, one more makes them odd."""
    corrects = [True, True, False, True, False, True, True, True, False, True]
    history = walk(QUARTERS, corrects)
    assert [level for level, _ in history] == [8, 7, 6, 9, 8, 10, 9, 8, 7, 10]
    assert track(history, QUARTERS).reversals == (2, 3, 4, 5, 8, 9)

    found = of_reversals(history, QUARTERS)

    # 8, 10, 7 and 10: deviations -.75, 1.25, -1.75, 1.25, whose squares sum to 6.75.
    assert (found.reversals, found.used) == (6, 4)
    assert found.level == pytest.approx(8.75)
    assert found.sd == pytest.approx(1.5)
    assert found.performance == 0.75
    assert of_reversals(history, QUARTERS, discard=0).used == 6


def test_without_two_reversals_there_is_no_estimate():
    found = of_reversals(walk(QUARTERS, [True, False]), QUARTERS)

    assert (found.level, found.sd, found.reversals, found.used) == (None, None, 1, 0)


def test_where_performance_falls_harder_is_higher():
    falling = replace(QUARTERS, start=2.0, falling=True)

    assert shown(falling, [True, True, False, True]) == [2, 3, 4, 1, 2]


def test_between_levels_the_nearest_is_shown_and_the_track_keeps_its_place():
    """By hand: .4 down each; 7.6, 7.2, 6.8, 6.4 show as 8, 7, 7, 6."""
    fine = UpDown(LEVELS, 8.0, (0.4,), (0.4,))

    assert shown(fine, [True] * 4) == [8, 8, 7, 7, 6]


@given(answers, st.sampled_from([QUARTERS, TWO, replace(TWO, falling=True)]))
def test_it_never_leaves_the_levels(corrects, settings):
    assert set(shown(settings, corrects)) <= set(LEVELS)


@given(answers)
def test_a_correct_answer_never_makes_it_easier_nor_a_wrong_one_harder(corrects):
    levels = shown(TWO, corrects)

    for before, after, correct in zip(levels, levels[1:], corrects, strict=False):
        assert after <= before if correct else after >= before


@given(answers, st.integers(0, 59))
def test_what_comes_later_changes_nothing_before(corrects, cut):
    assert shown(QUARTERS, corrects)[: cut + 1] == shown(QUARTERS, corrects[:cut])[: cut + 1]


def test_at_an_end_it_stays_there():
    assert shown(QUARTERS, [True] * 12)[-3:] == [0, 0, 0]
    assert shown(QUARTERS, [False] * 4)[-3:] == [10, 10, 10]


@pytest.mark.parametrize("case", ORACLE, ids=lambda case: case["name"])
def test_the_track_is_that_of_the_package(case):
    settings = UpDown(
        tuple(case["levels"]),
        case["start"],
        tuple(case["harder"]),
        tuple(case["easier"]),
        in_a_row=case["in_a_row"],
        one_at_first=case["one_at_first"],
    )
    history = [(level, correct) for level, correct in case["history"]]
    assert len(history) == 60

    found = track(history, settings)  # refuses any level but its own

    assert found.shown == tuple(level for level, _ in history)
    assert found.next_level == case["next_level"]
    assert [found.shown[trial] for trial in found.reversals] == case["reversal_levels"]
    assert len(found.reversals) > 5


def test_levels_of_another_track_are_refused():
    history = [(8.0, True), (6.0, True)]

    with pytest.raises(StudyError, match=r"history\[1\]: the level must be 7, which this track"):
        next_level(history, QUARTERS)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"levels": (0.0, 8.0, 5.0)}, "levels[2]: must be above the one before it, 8 (got 5)"),
        ({"start": 12.0}, "start: must be one of the levels, which go from 0 to 10 (got 12)"),
        ({"start": 7.5}, "start: must be one of the levels, which go from 0 to 10 (got 7.5)"),
        ({"harder": ()}, "harder, easier: must be equally many step sizes, one or more (got 0 and"),
        ({"harder": (2.0, 1.0)}, "one or more (got 2 and 1)"),
        ({"harder": (0.0,)}, "harder[0]: a step must be greater than 0 and no longer than"),
        ({"easier": (11.0,)}, "easier[0]: a step must be greater than 0 and no longer than the"),
        ({"in_a_row": 0}, "in_a_row: must be at least 1 (got 0)"),
    ],
)
def test_a_rule_that_cannot_be_is_refused(change, told):
    with pytest.raises(StudyError) as raised:
        replace(QUARTERS, **change)

    assert told in str(raised.value)


def test_a_negative_number_of_reversals_to_discard_is_refused():
    with pytest.raises(StudyError, match=r"discard: must be at least 0 \(got -1\)"):
        of_reversals([], QUARTERS, discard=-1)
