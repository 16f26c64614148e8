"""Right answers and arrangements are balanced within every condition, and cannot be foreseen."""

from collections import Counter
from pathlib import Path

import pytest
from study_texts import files_recipe, short_study

from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, protocol_of, read_toml
from protocols.plan import chosen, make_plan

DISPLAY = load_display("fhd27-60hz")


PAIRS = 'kind = "two-alternative"\nseparation_deg = 6.0\n'
ABX = 'kind = "abx"\nstandard = { method = "reference" }\n'


def study_of(
    tmp_path: Path,
    task: str,
    rows: list[tuple[str, dict]],
    repeats: int = 4,
    primary: tuple[str, str] = ("two", "one"),
    level: str = "",
):
    """Return a study of stills with this task, ABX or of pairs."""
    better, worse = primary
    preference = f'kind = "preference"\nprimary = {{ method = "{better}", against = "{worse}" }}'
    abx = task.startswith(ABX)
    text = short_study(
        stimuli=files_recipe(dict(rows)),
        task=f"stimulus_s = 0.5\n{task}",
        answers=("a", "b") if abx else ("left", "right"),
        analysis=f'kind = "abx"\n{level}' if abx else preference,
        design=f"repeats = {repeats}",
    )
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    return protocol_of(read_toml(path), path)


def abx_rows(methods=4, scenes=6):
    return [
        (
            f"s{scene}-m{method}",
            {"scene": f"s{scene}", "method": f"m{method}" if method else "reference"},
        )
        for scene in range(scenes)
        for method in range(methods + 1)
    ]


@pytest.mark.parametrize("repeats", [1, 2])
@pytest.mark.parametrize("slot", [0, 3])
def test_abx_has_each_right_answer_equally_often_in_every_condition(tmp_path, repeats, slot):
    study = study_of(tmp_path, ABX, abx_rows(), repeats)

    plan = make_plan(study, virtual_manifest(study, DISPLAY), "P1", slot)

    counts = Counter((trial.condition["method"], trial.correct) for trial in plan.trials)
    shown = Counter((trial.condition["method"], trial.condition["x"]) for trial in plan.trials)
    for method in ("m1", "m2", "m3", "m4"):
        assert counts[method, "a"] == counts[method, "b"] == 3 * repeats
        assert abs(shown[method, "standard"] - shown[method, "comparison"]) <= 2


def test_adaptive_abx_draws_the_right_answer_by_chance(tmp_path):
    rows = [
        (f"s{scene}-l{level}", {"scene": f"s{scene}", "method": "ours" if level else "reference",
                                "level": float(level)})
        for scene in range(4) for level in range(4)
    ]  # fmt: skip
    task = ABX + (
        'adaptive = { rule = "up-down", column = "level", trials = 24, start = 3.0,'
        " harder = [1.0], easier = [1.0] }\n"
    )
    study = study_of(tmp_path, task, rows, 1, level='level = "level"')
    manifest = virtual_manifest(study, DISPLAY)

    patterns = set()
    for code in ("P1", "P2", "P3", "P4"):
        plan = make_plan(study, manifest, code, 0)
        patterns.add("".join(str(chosen(study, plan, t, []).correct) for t in plan.trials))

    assert len(patterns) == 4
    assert all(6 <= pattern.count("a") <= 18 for pattern in patterns)


def test_a_stimulus_with_two_standards_or_none_is_refused(tmp_path):
    twice = [*abx_rows(1, 1), ("other", {"scene": "s0", "method": "reference"})]
    none = [*abx_rows(1, 1), ("alone", {"scene": "s9", "method": "m1"})]

    for rows, said in ((twice, "must be one standard"), (none, "must have a standard")):
        with pytest.raises(StudyError, match=said):
            study_of(tmp_path, ABX, rows)


def test_numbers_as_scenes_and_as_values_compared_are_planned(tmp_path):
    rows = [
        (f"s{scene}-v{value}", {"scene": scene, "seed": value})
        for scene in (1, 2) for value in (1, 2, 3)
    ]  # fmt: skip
    study = study_of(tmp_path, PAIRS + 'compare = "seed"\n', rows, primary=("1", "2"))

    plan = make_plan(study, virtual_manifest(study, DISPLAY), "P1", 0)

    assert len(plan.trials) == 2 * 3 * 4
    assert {trial.condition["left"] for trial in plan.trials} == {"1", "2", "3"}


def test_two_stimuli_of_one_condition_are_refused_where_one_is_to_be_shown(tmp_path):
    rows = [
        ("a", {"scene": "s", "method": "one"}),
        ("b", {"scene": "s", "method": "two"}),
        ("c", {"scene": "s", "method": "two"}),
    ]

    with pytest.raises(StudyError, match="no two stimuli may have one condition"):
        study_of(tmp_path, PAIRS, rows)


def test_participants_begin_active_pairs_with_different_pairs(tmp_path):
    rows = [(f"s-m{method}", {"scene": "s", "method": f"m{method}"}) for method in range(8)]
    task = PAIRS + 'sampling = { rule = "active-pairs", trials = 20 }\n'
    study = study_of(tmp_path, task, rows, 1, ("m1", "m2"))
    manifest = virtual_manifest(study, DISPLAY)

    firsts = set()
    for number in range(6):
        plan = make_plan(study, manifest, f"P{number}", number)
        firsts.add(frozenset(chosen(study, plan, plan.trials[0], []).stimuli))

    assert len(firsts) > 1
