"""The three studies of Beyond Blur as they are shipped: counts, balance, angles, what is cut."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import metamerlab
from scipy import stats

from protocols.feasibility import check_feasible, virtual_manifest
from protocols.load import load_display, load_study, protocol_of, read_toml, shipped
from protocols.plan import Plan, make_plan
from protocols.recipes.foveated_images import FoveatedImages, Rings
from protocols.study_file.schema import StudyProtocol

STUDIES = {"beyond-blur-task": 300, "beyond-blur-preference": 252, "beyond-blur-detection": 294}
SLOTS = (0, 1, 2, 5)
EXTRA = "metamerlab[metamers]"


def study_of(name: str) -> StudyProtocol:
    study, display = load_study(Path(name), None)
    assert not check_feasible(study, display)
    return study


def plans_of(name: str) -> list[Plan]:
    study, display = load_study(Path(name), None)
    manifest = virtual_manifest(study, display)
    return [make_plan(study, manifest, f"P{slot:02d}", slot) for slot in SLOTS]


@pytest.fixture(scope="module")
def plans() -> dict[str, list[Plan]]:
    return {name: plans_of(name) for name in STUDIES}


@pytest.mark.parametrize("name", STUDIES)
def test_everyone_decides_as_often_as_the_paper_says(plans, name):
    for plan in plans[name]:
        assert len(plan.trials) == plan.main_trials == STUDIES[name]


@pytest.mark.parametrize("name", STUDIES)
def test_no_two_trials_in_a_row_show_one_scene(plans, name):
    """Scenes that differ are pictures that differ, also where two names show the same pixels."""
    for plan in plans[name]:
        for before, after in pairwise(plan.trials):
            assert before.condition["scene"] != after.condition["scene"]


def test_the_task_shows_each_combination_once_and_each_scene_all_of_them(plans):
    columns = ("scene", "method", "eccentricity_deg", "symbol")
    for plan in plans["beyond-blur-task"]:
        seen = Counter(tuple(trial.condition[name] for name in columns) for trial in plan.trials)
        assert len(seen) == 5 * 6 * 5 * 2
        assert set(seen.values()) == {1}
        assert Counter(trial.correct for trial in plan.trials) == {"open": 150, "closed": 150}


def test_preferences_show_each_pair_six_times_a_scene_in_both_orders_alike(plans):
    for plan in plans["beyond-blur-preference"]:
        seen = Counter(
            (trial.condition["scene"], trial.condition["first"], trial.condition["second"])
            for trial in plan.trials
        )
        assert len(seen) == 7 * 6 * 2
        assert set(seen.values()) == {3}


def test_detection_shows_six_of_each_kind_and_six_references_a_scene(plans):
    for plan in plans["beyond-blur-detection"]:
        seen = Counter(
            (trial.condition["scene"], trial.condition["method"], trial.condition["cut"])
            for trial in plan.trials
        )
        assert len(seen) == 7 * (3 * 2 + 1)
        assert set(seen.values()) == {6}
        right = {(trial.condition["cut"], trial.correct) for trial in plan.trials}
        assert right == {("consistent", "no"), ("inconsistent", "yes")}


# --- polar angles ------------------------------------------------------------------------


def angles(recipe: FoveatedImages) -> dict[str, dict[tuple[float, str, int], float]]:
    """Polar angles by method, then by ring."""
    found: dict[str, dict[tuple[float, str, int], float]] = {}
    for one in recipe.stimuli():
        ring = one.condition["eccentricity_deg"], one.condition["symbol"], one.condition["place"]
        found.setdefault(one.shown.name, {})[ring] = one.polar_deg
    return found


@pytest.fixture(scope="module")
def task_recipe() -> FoveatedImages:
    recipe = study_of("beyond-blur-task").stimuli
    assert isinstance(recipe, FoveatedImages)
    return recipe


def by_one(recipe: FoveatedImages, seed: int) -> dict[tuple[float, str, int], float]:
    """Polar angles by one method, drawn by another seed."""
    short = {"methods": recipe.methods[-1:], "texture_seed": seed}
    return angles(recipe.model_copy(update=short))["ours"]


def test_all_methods_have_the_same_angles_one_in_each_sector(task_recipe):
    by_method = angles(task_recipe)

    assert len(by_method) == 6
    reference = by_method["reference"]
    assert all(found == reference for found in by_method.values())
    assert len(reference) == 50
    for (_, _, place), polar in reference.items():
        assert place * 72 <= polar < (place + 1) * 72


def test_over_seeds_angles_are_uniform_at_every_eccentricity(task_recipe, proof_count):
    seeds = proof_count(400)
    found: dict[float, list[float]] = {}
    for seed in range(seeds):
        for (eccentricity, _, _), polar in by_one(task_recipe, seed).items():
            found.setdefault(eccentricity, []).append(polar)

    assert sorted(found) == [5, 10, 15, 20, 25]
    for polar in found.values():
        within = np.mod(polar, 72) / 72  # sectors are filled evenly by design: test within
        assert stats.kstest(within, "uniform").pvalue > 1e-4
        assert Counter(int(value // 72) for value in polar) == dict.fromkeys(range(5), 2 * seeds)


def test_where_the_field_cuts_circles_angles_are_uniform_on_the_arcs_that_fit(
    task_recipe, proof_count
):
    """By hand: a ring fits where its middle is its radius away from the plane of every edge."""
    rings = Rings(eccentricities_deg=(15.0,), field_deg=(46.0, 27.0), places=4)
    recipe = task_recipe.model_copy(update={"rings": rings})
    found = np.array(
        [polar for seed in range(proof_count(1000)) for polar in by_one(recipe, seed).values()]
    )

    turn, away = np.radians(found), np.radians(15)
    ray = np.stack([np.sin(away) * np.cos(turn), np.sin(away) * np.sin(turn)])
    edges = np.radians([23, 13.5])[:, None]
    clear = np.degrees(np.arcsin(np.cos(away) * np.sin(edges) - abs(ray) * np.cos(edges)))
    assert clear.min() >= 0.625 - 0.001
    assert clear.min() < 0.7  # no more is left out than must be
    first, last = rings.arcs(15.0)
    assert first == 0
    quarter = np.floor(found / 90)
    off = np.where(quarter % 2 == 0, found % 90, 90 - found % 90)
    assert stats.kstest(off, "uniform", args=(first, last)).pvalue > 1e-4
    assert set(Counter(quarter).values()) == {len(found) // 4}


def test_narrow_and_high_fields_leave_the_arcs_above_and_below():
    rings = Rings(eccentricities_deg=(20.0,), field_deg=(20.0, 60.0))
    first, last = rings.arcs(20.0)

    assert last == 90
    assert 60 < first < 90
    shares = np.linspace(0, 0.999, 400)
    off = [rings.polar_deg(20.0, share) % 180 for share in shares]
    assert min(off) == pytest.approx(first, abs=0.2)
    assert max(off) == pytest.approx(180 - first, abs=0.2)


def test_an_eccentricity_that_fits_nowhere_is_refused(task_recipe):
    rings = {**task_recipe.rings.model_dump(), "field_deg": (40.0, 27.0)}
    with pytest.raises(ValueError, match="25 degrees from the gaze must fit somewhere"):
        FoveatedImages.model_validate({**task_recipe.model_dump(), "rings": rings})


# --- displays ----------------------------------------------------------------------------


@pytest.fixture
def smaller(tmp_path):
    """The task on a 27-inch Full HD monitor, its field as given."""

    def write(field: str) -> Path:
        text = shipped("studies")["beyond-blur-task"].read_text(encoding="utf-8")
        for old, new in (
            ("[5.0, 10.0, 15.0, 20.0, 25.0]", "[5.0, 10.0, 15.0]"),
            ("field_deg = [85.0, 54.0]", field),
            ("3840", "1920"),
            ("2160", "1080"),
            ("uhd55", "fhd27"),
        ):
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "smaller.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_check_and_show_say_what_a_smaller_display_cuts_away(smaller):
    path = smaller("field_deg = [46.2, 27.0]")

    checked = metamerlab("protocol", "check", str(path))
    assert "180 decisions" in checked.output
    assert "note: at 15 deg rings lie on 65% of the circle" in checked.output
    assert "at 10 deg" not in checked.output
    shown = metamerlab("protocol", "show", str(path), terminal_width=200, status=None)
    assert "cut away" in shown.output


def test_rings_off_the_display_are_refused_with_the_field_that_fits(smaller):
    study = protocol_of(read_toml(path := smaller("field_deg = [85.0, 54.0]")), path)
    problems = check_feasible(study, load_display(Path("fhd27-60hz")))

    assert [problem.place for problem in problems] == ["stimuli.rings.field_deg"]
    assert "write field_deg = [46.2, 27.0]" in problems[0].message
    assert "arcs that fit (65% at 15 deg of the circle)" in problems[0].message


def test_a_display_smaller_than_the_study_is_told_what_it_would_cut_away():
    study, _ = load_study(Path("beyond-blur-task"), None)
    problems = check_feasible(study, load_display(Path("fhd27-60hz")))

    places = ["stimuli.width_px", "stimuli.height_px", "stimuli.rings.field_deg"]
    assert [problem.place for problem in problems] == places
    said = problems[-1].message
    assert "46.2 x 27.0 deg on this display" in said
    assert "(65% at 15 deg, 43% at 20 deg, 2% at 25 deg of the circle)" in said


@pytest.mark.parametrize("name", ["beyond-blur-preference", "beyond-blur-detection"])
def test_without_the_extra_the_study_is_in_order_and_a_build_names_it(name, tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.foveation.energy.find_spec", lambda _: None)

    checked = metamerlab("protocol", "check", name)
    assert EXTRA not in checked.output.splitlines()[0]
    built = metamerlab("stimuli", "build", name, "--out", str(tmp_path / "clips"), status=2)
    assert EXTRA in built.stderr
    assert "leave 'energy-metamer' out" in built.stderr


def test_turns_are_balanced_for_any_number_of_scenes(task_recipe):
    fewer = task_recipe.model_copy(update={"pictures": task_recipe.pictures[:3]})
    count = Counter(one.picture.name for one in fewer.stimuli())

    assert sum(count.values()) == 300
    assert max(count.values()) - min(count.values()) <= 6


def test_a_field_is_for_a_gaze_in_the_middle(task_recipe):
    with pytest.raises(ValueError, match="leave gazes out"):
        FoveatedImages.model_validate(
            {**task_recipe.model_dump(), "gazes": ({"name": "left", "x_deg": -3.0},)}
        )


def test_unknown_pictures_are_refused_with_the_nearest(tmp_path):
    text = shipped("studies")["beyond-blur-task"].read_text(encoding="utf-8")
    path = tmp_path / "study.toml"
    path.write_text(text.replace("builtin:garden", "builtin:gardn"), encoding="utf-8")

    checked = metamerlab("protocol", "check", str(path), status=2)
    assert "did you mean 'garden'?" in checked.stderr


# --- what a lab changes ------------------------------------------------------------------


def test_a_labs_own_picture_takes_one_line(tmp_path):
    text = shipped("studies")["beyond-blur-detection"].read_text(encoding="utf-8")
    line = '{ name = "garden", file = "builtin:garden" }'
    assert text.count(line) == 1
    (tmp_path / "harbour.png").touch()
    path = tmp_path / "study.toml"
    path.write_text(text.replace(line, '{ name = "harbour", file = "harbour.png" }'))

    recipe = protocol_of(read_toml(path), path).stimuli
    assert isinstance(recipe, FoveatedImages)
    assert recipe.pictures[0].file == "harbour.png"
    assert not recipe.problems(tmp_path)
    assert {one.picture.name for one in recipe.stimuli()} >= {"harbour", "street"}


def test_a_methods_columns_are_columns_of_its_stimuli_and_of_no_others(task_recipe):
    shown = task_recipe.methods[-1].model_copy(update={"columns": {"scaling": 0.25, "kind": "n"}})
    recipe = task_recipe.model_copy(update={"methods": (task_recipe.methods[0], shown)})

    assert {"scaling", "kind"} <= set(recipe.columns())
    assert recipe.values("scaling") == (0.25,)
    for stimulus in recipe.pool():
        told = {name: stimulus.condition.get(name) for name in ("scaling", "kind")}
        ours = stimulus.condition["method"] == shown.name
        assert told == ({"scaling": 0.25, "kind": "n"} if ours else dict.fromkeys(told))
