"""The studies of critical scaling as they are shipped: what is compared how often, by both tasks;
and observers with a known critical scaling, which comes back."""

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import metamerlab

from analysis.models.critical_scaling import critical_scaling
from protocols.answer_rules import answer_rule
from protocols.errors import StudyError
from protocols.feasibility import check_feasible, virtual_manifest
from protocols.load import load_study, protocol_of, read_toml, shipped
from protocols.phases import Bar, Image
from protocols.plan import Plan, chosen, make_plan
from protocols.tasks.compared import ANOTHER, STANDARD
from study_app.observers import default_model, rng_of

STUDIES = ("critical-scaling", "critical-scaling-halves")
SCALINGS = (0.063, 0.088, 0.125, 0.177, 0.25, 0.354, 0.5, 0.707)
CONDITIONS = ("noise, standard", "warped, standard", "noise, another", "warped, another")


def plan_of(study, slot: int, display) -> Plan:
    return make_plan(study, virtual_manifest(study, display), f"P{slot:02d}", slot)


@pytest.fixture(scope="module", params=STUDIES)
def planned(request):
    """A shipped study, its display, and the plans of four slots."""
    study, display = load_study(Path(request.param), None)
    assert not check_feasible(study, display)
    return study, display, [plan_of(study, slot, display) for slot in range(4)]


def test_every_pair_comes_twice_and_each_answer_is_right_as_often(planned):
    _, _, plans = planned
    columns = ("scene", "metamer", "against", "scaling")
    for plan in plans:
        main = [trial for trial in plan.trials if trial.role == "main"]
        assert len(main) == plan.main_trials == 448
        seen = Counter(tuple(trial.condition[name] for name in columns) for trial in main)
        assert len(seen) == 7 * 2 * 2 * 8
        assert set(seen.values()) == {2}
        right = Counter(
            (*(trial.condition[n] for n in columns[1:]), trial.correct) for trial in main
        )
        assert set(right.values()) == {7}


def test_original_and_synthesised_are_told_apart_or_two_syntheses_of_one_picture(planned):
    _, _, plans = planned
    taken = Counter()
    for trial in (t for plan in plans for t in plan.trials):
        shown = sorted(set(trial.stimuli))
        assert len(shown) == 2
        scene, scaling = trial.condition["scene"], f"{round(trial.condition['scaling'] * 1000):03d}"
        named = f"{scene}__{trial.condition['metamer']}-{scaling}"
        if trial.condition["against"] == ANOTHER:
            assert shown == [f"{named}__d0", f"{named}__d1"]
        else:
            assert f"{scene}__reference" in shown
            (other,) = set(shown) - {f"{scene}__reference"}
            assert other in (f"{named}__d0", f"{named}__d1")
            taken[other[-2:]] += 1
    assert taken["d0"] == pytest.approx(taken["d1"], rel=0.05)


def test_which_half_changes_is_the_right_answer_and_nothing_else_changes():
    study, display = load_study(Path("critical-scaling-halves"), None)
    for trial in plan_of(study, 1, display).trials:
        first_left, first_right, left, right = trial.stimuli
        assert first_left == first_right
        assert trial.correct == ("left" if left != first_left else "right")
        assert (left == first_left) != (right == first_right)
    first, gap, second = study.task.phases(study.pool, display)
    assert [(e.stimulus, e.half) for e in first.show if isinstance(e, Image)] == [
        (0, "left"), (1, "right"),
    ]  # fmt: skip
    assert [(e.stimulus, e.half) for e in second.show if isinstance(e, Image)] == [
        (2, "left"), (3, "right"),
    ]  # fmt: skip
    assert Bar(2.0) in first.show
    assert Bar(2.0) in second.show
    assert [phase.frames for phase in (first, gap, second)] == [12, 30, 12]


def test_abx_shows_for_200_ms_with_blanks_of_500():
    study, display = load_study(Path("critical-scaling"), None)
    assert [p.frames for p in study.task.phases(study.pool, display)] == [12, 30, 12, 30, 12]


@pytest.mark.parametrize("name", STUDIES)
def test_levels_adapt_as_the_comment_in_the_file_says(name, tmp_path):
    text = shipped("studies")[name].read_text(encoding="utf-8")
    comment = re.search(r"^#   \[task\.adaptive\]$.*?^#   shape.*?$", text, re.M | re.S).group()
    section = "\n".join(line.removeprefix("#   ") for line in comment.splitlines())
    text = text.replace("repeats = 2", "repeats = 1", 1).replace(
        "[design]", section + "\n\n[design]", 1
    )
    path = tmp_path / "adaptive.toml"
    path.write_text(text, encoding="utf-8")
    study, display = load_study(path, None)

    plan = plan_of(study, 0, display)
    main = [trial for trial in plan.trials if trial.role == "main"]
    assert Counter(trial.track for trial in main) == {
        f"metamer={metamer},against={against}": 80
        for metamer in ("noise", "warped") for against in (STANDARD, ANOTHER)
    }  # fmt: skip
    first = chosen(study, plan, main[0], [])
    assert first.condition["scaling"] in SCALINGS
    assert {k: first.condition[k] for k in ("metamer", "against")} == dict(main[0].condition)


def test_unknown_columns_of_by_are_refused(tmp_path):
    path = tmp_path / "study.toml"
    text = shipped("studies")["critical-scaling"].read_text(encoding="utf-8")
    path.write_text(
        text.replace('by = ["metamer", "against"]\nbase', 'by = ["metamer", "agaist"]\nbase')
    )
    with pytest.raises(StudyError, match=r"analysis\.by: must name a column"):
        protocol_of(read_toml(path), path)
    path.write_text(text.replace('baseline = "noise, standard"', 'baseline = "noise"'))
    with pytest.raises(StudyError, match=r"'metamer, against'.*noise, standard"):
        protocol_of(read_toml(path), path)


# --- observers ---------------------------------------------------------------------------


def test_dual_pairs_are_told_apart_as_often_as_noise_lets_them(rng):
    """By drawing: the half whose two showings differ more is taken."""
    for d_prime in (0.5, 1.5, 3.0):
        changed = abs(rng.normal(d_prime, 1, 200_000) - rng.normal(0, 1, 200_000))
        same = abs(rng.normal(0, 1, 200_000) - rng.normal(0, 1, 200_000))
        assert answer_rule("dual-pair").share(d_prime) == pytest.approx(
            (changed > same).mean(), abs=0.005
        )
        assert answer_rule("dual-pair").d_prime(
            answer_rule("dual-pair").share(d_prime)
        ) == pytest.approx(d_prime)


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_known_critical_scalings_come_back(name, proof_count, full):
    """The default observers answer the study's own plan; by default two of the four conditions."""
    study, display = load_study(Path(name), None)
    model = default_model(study)
    plans = [plan_of(study, slot, display) for slot in range(10)]
    conditions = CONDITIONS if full else CONDITIONS[1:3]
    found, inside = [], []
    for seed in range(proof_count(20)):
        rows = []
        for plan in plans:
            for trial in plan.trials:
                condition = f"{trial.condition['metamer']}, {trial.condition['against']}"
                if trial.role == "main" and condition in conditions:
                    rng = rng_of(seed, plan.participant, trial.id)
                    said = model.decide(trial, seed, plan.participant, rng).answer
                    rows.append(
                        (plan.participant, condition, trial.condition["scaling"],
                         int(said == trial.correct))
                    )  # fmt: skip
        table = pd.DataFrame(rows, columns=["participant", "condition", "scaling", "correct"])
        for condition, part in table.groupby("condition"):
            fit = critical_scaling(part, rule=study.analysis.rule)
            found.append(np.log(fit.critical / model.critical[condition]))
            low, high = fit.critical_limits
            inside.append(low < model.critical[condition] < high)
    # Participants differ by .25, of which a study has ten; scenes, by .1, are not in the model.
    assert abs(np.mean(found)) < 0.1 + 4 * 0.12 / np.sqrt(len(found))
    assert np.mean(inside) >= (0.8 if full else 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_it_is_simulated_and_reported_by_the_same_commands(name, tmp_path, monkeypatch, full):
    """Two scenes and three scalings of it: the report says whose critical scaling is which."""
    if name == "critical-scaling" and not full:
        pytest.skip("ABX is reported elsewhere too; here with --full")
    monkeypatch.setattr("analysis.report.write_report._draw", lambda *_, **__: [])
    text = shipped("studies")[name].read_text(encoding="utf-8")
    for line in text.splitlines():
        if line.startswith("  { name = ") and not re.search(
            r"garden|notices|reference|-125|-250|-500", line
        ):
            text = text.replace(line + "\n", "")
    text = text.replace("blocks = 8", "blocks = 2").replace("repeats = 2", "repeats = 4")
    path = tmp_path / "little.toml"
    path.write_text(text, encoding="utf-8")

    def run(*words: object):
        done = metamerlab(*words)
        return done.output

    given = [f"--critical={condition}=0.2" for condition in CONDITIONS]
    said = run("session", "simulate", path, "--out", tmp_path / "s", "--participants", 3,
               "--steady-gaze", "--gaze-hz", 60, *given)  # fmt: skip
    assert "288 decisions" in said
    run("analysis", "report", tmp_path / "s", "--protocol", path, "--out", tmp_path / "r",
        "--no-figures")  # fmt: skip
    results = json.loads((tmp_path / "r" / "results.json").read_text())["results"]
    assert [one["condition"] for one in results["critical"]["fits"]] == list(CONDITIONS)
    assert all(len(one["scenes"]) == 2 for one in results["critical"]["fits"])
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    assert "noise, against the standard" in page
    assert "It takes trials as independent, which they are not" in page
    assert (
        "Participants&#39; critical scalings" in page or "Participants' critical scalings" in page
    )
