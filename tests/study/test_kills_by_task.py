"""Killed at any point, a session of any task loses nothing, doubles nothing, and keeps order and
levels."""

import pytest
from attack.kills import CASES, RESTLESS, journal_of, kill_sessions, write_study

from study_app.simulate import SimulatedStudy, simulate_session

SOON = ("two-alternative", "identification by up-down")
"""Cases that are no slow tests."""


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("disk_full", [False, True], ids=["killed", "disk full"])
@pytest.mark.parametrize(
    "name", [one if one in SOON else pytest.param(one, marks=pytest.mark.slow) for one in CASES]
)
def test_disturbed_anywhere_it_goes_on_as_it_would_have(tmp_path, name, disk_full, full):
    """SIGKILL, or a full disk, at writes spread over the whole session, several in each."""
    fewest = 20 if CASES[name].confidence else 12
    points = (40 if full else 4) if disk_full else (200 if full else fewest)
    found = kill_sessions(name, tmp_path, points, full=disk_full)

    assert found.died >= found.kills // 2  # the others had come to their end before
    asked = ("confidence",) if CASES[name].confidence else ()
    for attempt in journal_of(tmp_path / "whole").attempts:
        given = tuple(one.question for one in attempt.further)
        assert given == (asked if attempt.outcome == "completed" else ())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_killed_in_a_trial_of_three_questions_it_loses_and_doubles_none(tmp_path, full):
    found = kill_sessions("asked thrice", tmp_path, 200 if full else 20)

    assert found.died >= found.kills // 2
    attempts = journal_of(tmp_path / "whole").attempts
    completed = [a for a in attempts if a.outcome == "completed"]
    assert {tuple(one.question for one in a.further) for a in completed} == {("seen", "sure")}
    assert {one.answer for a in completed for one in a.further[:1]} == {
        "clearly", "barely", "not-at-all",
    }  # fmt: skip
    assert [a.further for a in attempts if a.outcome == "void"] == [()] * (
        len(attempts) - len(completed)
    )


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.adaptive])
def test_levels_and_pairs_follow_the_answers(tmp_path, name):
    """Another observer's answers lead to other levels or pairs: nothing was planned beforehand."""
    simulation = write_study(tmp_path, CASES[name])
    column = getattr(simulation.study.task.adaptation, "column", None)

    def shown(seed: int) -> list[object]:
        root = tmp_path / f"seed-{seed}"
        sim = SimulatedStudy(simulation.study, simulation.display, seed=seed, gaze=RESTLESS)
        simulate_session(sim, root, "S001")
        main = [a for a in journal_of(root).attempts if a.role == "main"]
        return [
            a.condition[column] if column else frozenset(s.name for s in a.stimuli)
            for a in main
            if a.outcome == "completed"
        ]

    found = [shown(seed) for seed in range(3)]
    assert len({tuple(entry) for entry in found}) > 1
    assert all(len(set(entry)) > 1 for entry in found)
