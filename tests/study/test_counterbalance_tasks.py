"""Right answers and arrangements are balanced within every condition, and cannot be foreseen."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, protocol_of, read_toml
from protocols.plan import chosen, make_plan

DISPLAY = load_display("fhd27-60hz")


def study_of(tmp_path: Path, short_study, task: str, rows: list[tuple[str, dict]], **changes):
    """Return a study of stills with this task."""
    text = short_study(
        stimuli='kind = "files"\nwidth_px = 64\nheight_px = 64\nentries = [',
        task='kind = "side-by-side"\nseparation_deg = 6.0\nstimulus_s = 0.5',
        answers=("left", "right"),
        analysis='kind = "preference"\nprimary = { method = "two", against = "one" }',
        design="repeats = 4",
    )
    head, rest = text.split("entries = [")
    entries = "\n".join(
        "[[stimuli.entries]]\n"
        f'name = "{name}"\nfile = "{name}.png"\n'
        + "condition = { "
        + ", ".join(f"{k} = {v!r}".replace("'", '"') for k, v in condition.items())
        + " }\n"
        for name, condition in rows
    )
    rest = rest[rest.index("[task]") :]
    rest = rest.replace('kind = "side-by-side"\nseparation_deg = 6.0\n', task)
    for old, new in changes.items():
        rest = rest.replace(*new) if isinstance(new, tuple) else rest.replace(old, new)
    path = tmp_path / "study.toml"
    path.write_text(head + entries + "\n" + rest, encoding="utf-8")
    return protocol_of(read_toml(path), path)


ABX = 'kind = "abx"\nstandard = { method = "reference" }\n'
ABX_CHANGES = {
    "answers": ('{ left = "left", right = "right" }', '{ a = "A", b = "B" }'),
    "analysis": (
        'kind = "preference"\nprimary = { method = "two", against = "one" }',
        'kind = "abx"',
    ),
}


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
def test_abx_has_each_right_answer_equally_often_in_every_condition(
    tmp_path, short_study, repeats, slot
):
    study = study_of(
        tmp_path, short_study, ABX, abx_rows(),
        repeats=("repeats = 4", f"repeats = {repeats}"), **ABX_CHANGES,
    )  # fmt: skip

    plan = make_plan(study, virtual_manifest(study, DISPLAY), "P1", slot)

    counts = Counter((trial.condition["method"], trial.correct) for trial in plan.trials)
    shown = Counter((trial.condition["method"], trial.condition["x"]) for trial in plan.trials)
    for method in ("m1", "m2", "m3", "m4"):
        assert counts[method, "a"] == counts[method, "b"] == 3 * repeats
        assert abs(shown[method, "standard"] - shown[method, "comparison"]) <= 2


def test_adaptive_abx_draws_the_right_answer_by_chance(tmp_path, short_study):
    rows = [
        (f"s{scene}-l{level}", {"scene": f"s{scene}", "method": "ours" if level else "reference",
                                "level": float(level)})
        for scene in range(4) for level in range(4)
    ]  # fmt: skip
    task = ABX.replace('"reference" }', '"reference" }') + (
        'adaptive = { rule = "up-down", column = "level", trials = 24, start = 3.0,'
        " harder = [1.0], easier = [1.0] }\n"
    )
    old, new = ABX_CHANGES["analysis"]
    changes = ABX_CHANGES | {"analysis": (old, f'{new}\nlevel = "level"')}
    study = study_of(
        tmp_path, short_study, task, rows, repeats=("repeats = 4", "repeats = 1"), **changes
    )
    manifest = virtual_manifest(study, DISPLAY)

    patterns = set()
    for code in ("P1", "P2", "P3", "P4"):
        plan = make_plan(study, manifest, code, 0)
        patterns.add("".join(str(chosen(study, plan, t, []).correct) for t in plan.trials))

    assert len(patterns) == 4
    assert all(6 <= pattern.count("a") <= 18 for pattern in patterns)


def test_a_stimulus_with_two_standards_or_none_is_refused(tmp_path, short_study):
    twice = [*abx_rows(1, 1), ("other", {"scene": "s0", "method": "reference"})]
    none = [*abx_rows(1, 1), ("alone", {"scene": "s9", "method": "m1"})]

    for rows, said in ((twice, "must be one standard"), (none, "must have a standard")):
        with pytest.raises(StudyError, match=said):
            study_of(tmp_path, short_study, ABX, rows, **ABX_CHANGES)


def test_numbers_as_scenes_and_as_values_compared_are_planned(tmp_path, short_study):
    rows = [
        (f"s{scene}-v{value}", {"scene": scene, "seed": value})
        for scene in (1, 2) for value in (1, 2, 3)
    ]  # fmt: skip
    task = 'kind = "two-alternative"\nseparation_deg = 6.0\ncompare = "seed"\n'
    study = study_of(
        tmp_path, short_study, task, rows,
        primary=('method = "two", against = "one"', 'method = "1", against = "2"'),
    )  # fmt: skip

    plan = make_plan(study, virtual_manifest(study, DISPLAY), "P1", 0)

    assert len(plan.trials) == 2 * 3 * 4
    assert {trial.condition["left"] for trial in plan.trials} == {"1", "2", "3"}


def test_two_stimuli_of_one_condition_are_refused_where_one_is_to_be_shown(tmp_path, short_study):
    task = 'kind = "two-alternative"\nseparation_deg = 6.0\n'
    rows = [
        ("a", {"scene": "s", "method": "one"}),
        ("b", {"scene": "s", "method": "two"}),
        ("c", {"scene": "s", "method": "two"}),
    ]

    with pytest.raises(StudyError, match="no two stimuli may have one condition"):
        study_of(tmp_path, short_study, task, rows)


def test_participants_begin_active_pairs_with_different_pairs(tmp_path, short_study):
    rows = [(f"s-m{method}", {"scene": "s", "method": f"m{method}"}) for method in range(8)]
    task = (
        'kind = "two-alternative"\nseparation_deg = 6.0\n'
        'sampling = { rule = "active-pairs", trials = 20 }\n'
    )
    study = study_of(
        tmp_path, short_study, task, rows,
        repeats=("repeats = 4", "repeats = 1"),
        primary=('method = "two", against = "one"', 'method = "m1", against = "m2"'),
    )  # fmt: skip
    manifest = virtual_manifest(study, DISPLAY)

    firsts = set()
    for number in range(6):
        plan = make_plan(study, manifest, f"P{number}", number)
        firsts.add(frozenset(chosen(study, plan, plan.trials[0], []).stimuli))

    assert len(firsts) > 1
