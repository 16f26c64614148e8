"""Reaction times: lme4's mixed model."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import metamerlab

from analysis.models.contrasts import MOST_CONDITIONS, pairs_of
from analysis.models.mixed.arrow_matrix import MOST_LEVELS
from analysis.models.mixed.linear_mixed import fit_linear_mixed
from analysis.models.mixed.reaction_model import time_model
from analysis.report.write_report import report_decisions
from analysis.tasks import analysis_of
from analysis.tasks.note import write_note
from protocols.errors import StudyError

FOLDER = Path(__file__).parents[1] / "oracles"
ORACLE = json.loads((FOLDER / "oracle_times.json").read_text())


@pytest.fixture(scope="module")
def times() -> pd.DataFrame:
    return pd.read_csv(FOLDER / "times.csv")


def test_the_mixed_model_is_lme4s(times):
    crossed = time_model(times, ("cond",))
    nested = time_model(times.drop(columns="scene"), ("cond",))

    assert crossed.beta == pytest.approx(ORACLE["times_beta"], abs=1e-8)
    assert crossed.beta_se == pytest.approx(ORACLE["times_se"], rel=1e-4)
    found = (
        crossed.participant_sd, crossed.interaction_sd, crossed.scene_sd, crossed.residual_sd,
    )  # fmt: skip
    assert found == pytest.approx(ORACLE["times_sd"], rel=1e-3)
    assert crossed.log_likelihood == pytest.approx(ORACLE["times_loglik"][0], abs=1e-6)
    assert nested.beta_se == pytest.approx(ORACLE["nested_se"], rel=1e-4)
    found = (nested.participant_sd, nested.interaction_sd, nested.residual_sd)
    assert found == pytest.approx(ORACLE["nested_sd"], rel=1e-3)
    assert nested.scene_sd == 0.0


@pytest.mark.parametrize("noise", [1e-2, 1e-5, 0.0])
def test_people_who_differ_far_more_than_their_answers_break_nothing(noise):
    rng = np.random.default_rng(3)
    rows = pd.DataFrame(
        [(p, c) for p in range(6) for c in "ab" for _ in range(5)], columns=["participant", "cond"]
    )
    rows["rt_s"] = np.exp(rng.normal(0, 1, 6)[rows["participant"]] + 0.1 * (rows["cond"] == "b")
                          + noise * rng.standard_normal(len(rows)))  # fmt: skip
    (ratio,) = time_model(rows, ("cond",), reference="a").ratios

    assert ratio.ratio == pytest.approx(np.exp(0.1), abs=2 * noise + 1e-3)
    assert ratio.lower <= ratio.ratio <= ratio.upper


def test_ratios_are_of_typical_times_and_turn_with_the_baseline(times):
    model = time_model(times, ("cond",), reference="a")
    typical = {one.condition: one.median_s for one in model.times}

    assert [(one.first, one.second) for one in model.ratios] == [("b", "a"), ("c", "a")]
    for one in model.ratios:
        assert one.ratio == pytest.approx(typical[one.first] / typical["a"])
        assert one.lower < one.ratio < one.upper
        assert (one.lower > 1.0) == (one.p < 0.05)
        assert 5 < one.df <= 8  # between those of scenes and of participants


def test_a_condition_that_differs_by_scene_has_the_variance_of_scenes_in_its_ratio(rng):
    """Balanced: V(difference) = 2 (MS_pc + MS_sc - MS_psc) / (p s r), as in Clark's quasi-F."""
    people, scenes, repeats = 10, 6, 2
    rows = pd.DataFrame(
        [(p, s, c) for p in range(people) for s in range(scenes) for c in range(2)
         for _ in range(repeats)],
        columns=["participant", "scene", "cond"],
    )  # fmt: skip
    person, scene, cond = (rows[name].to_numpy() for name in rows)
    y = rng.normal(0, 0.3, people)[person] + rng.normal(0, 0.25, (people, 2))[person, cond]
    y += rng.normal(0, 0.2, scenes)[scene] + rng.normal(0, 0.25, (scenes, 2))[scene, cond]
    y += rng.normal(0, 0.2, y.size)
    asked = {"gap": {"0": 1.0, "1": -1.0}}
    model = time_model(rows.assign(rt_s=np.exp(y)), ("cond",), asked=asked)
    cells = y.reshape(people, scenes, 2, repeats).mean(axis=3)
    gap = cells[:, :, 1] - cells[:, :, 0]
    mean, by_person, by_scene = gap.mean(), gap.mean(axis=1), gap.mean(axis=0)
    rest = gap - by_person[:, None] - by_scene[None, :] + mean
    between_people = ((by_person - mean) ** 2).sum() / (people - 1) / people
    between_scenes = ((by_scene - mean) ** 2).sum() / (scenes - 1) / scenes
    # What people and scenes share in one condition is not in the model: its rest is of trials.
    parts = y.reshape(people, scenes, 2, repeats)
    trial = np.sum((parts - parts.mean(axis=3, keepdims=True)) ** 2)
    within = np.sum(rest**2) / 2 * repeats
    free = people * scenes * 2 * (repeats - 1) + (people - 1) * (scenes - 1)
    shared = 0.5 * sum(_rest_of_sums(cells)) * repeats
    free += (people - 1) * (scenes - 1)
    residual = (trial + within + shared) / free
    error = np.sqrt(between_people + between_scenes - 2 * residual / (people * scenes * repeats))
    (ratio,) = model.ratios
    found = model.margins.contrasts[0].standard_error

    assert found == pytest.approx(error, rel=0.01)
    assert model.scene_interaction_sd > 0.1
    assert 5 < ratio.df < 14


def _rest_of_sums(cells):
    """Squares of what is left of the conditions' sum beside people and scenes."""
    both = cells.sum(axis=2)
    rest = both - both.mean(axis=1, keepdims=True) - both.mean(axis=0, keepdims=True) + both.mean()
    return (rest**2).ravel()


@pytest.mark.full
def test_equal_conditions_are_called_different_as_rarely_as_said():
    runs, called = 400, 0
    rng = np.random.default_rng(8)
    for _ in range(runs):
        rows = pd.DataFrame(
            [(p, s, c) for p in range(8) for s in range(4) for c in "ab" for _ in range(2)],
            columns=["participant", "scene", "cond"],
        )
        own = rng.normal(0, 0.2, (8, 2))[rows["participant"], (rows["cond"] == "b").astype(int)]
        base = rng.normal(0, 0.3, 8)[rows["participant"]] + rng.normal(0, 0.1, 4)[rows["scene"]]
        rows["rt_s"] = np.exp(base + own + rng.normal(0, 0.3, len(rows)))
        called += time_model(rows, ("cond",)).ratios[0].p < 0.05

    assert called / runs < 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)


@pytest.mark.slow
def test_the_command_tells_and_writes_its_tables(times, tmp_path):
    file = tmp_path / "t.csv"
    times.rename(columns={"rt_s": "seconds"}).to_csv(file, index=False)
    out = tmp_path / "out"
    result = metamerlab("analysis", "reaction", str(file), "--by", "cond", "--baseline", "a",
         "--map", "rt_s=seconds", "--out", str(out), env={"COLUMNS": "200"})  # fmt: skip

    assert "405 reaction times of 9 participants" in result.output
    assert "Answers to c took 1.31 times as long as those to a" in result.output
    tables = out / "tables"
    assert [*pd.read_csv(tables / "ratios.csv")["first"]] == ["b", "c"]
    assert (out / "figures" / "reaction-2-column.svg").is_file()
    assert "Ratios of answer times" in result.output
    assert "Ratios of answer times" in (out / "report.html").read_text()


def test_a_baseline_that_is_none_is_refused(times, tmp_path):
    file = tmp_path / "t.csv"
    times.to_csv(file, index=False)
    result = metamerlab(
        "analysis", "reaction", str(file), "--by", "cond", "--baseline", "d", status=2
    )

    assert "must be a value of 'cond' (a, b, c)" in " ".join(result.output.split())


@pytest.mark.slow
@pytest.mark.parametrize("asked", ["summary", "models"])
def test_a_report_models_times_where_the_study_asks_for_it(times, tmp_path, asked):
    file = tmp_path / "times.csv"
    times.drop(columns="rating").to_csv(file, index=False)
    options = analysis_of("identification").options(by="cond", alternatives=2, reaction=asked)
    write_note(file, options)
    made = report_decisions(file, tmp_path / "r", figure_files="none")
    found = json.loads(made.json.read_text())["results"]["times"]

    page = made.html.read_text()
    assert ("log-normal mixed model" in page) == (asked == "models")
    if asked == "summary":
        assert found["model"] is None
        return
    wanted = time_model(times, ("cond",), reference="a")
    assert [one["ratio"] for one in found["model"]["ratios"]] == pytest.approx(
        [one.ratio for one in wanted.ratios], rel=1e-6
    )


def test_thousands_of_participants_take_little_memory_and_too_many_are_refused(rng):
    """Equations of 6,000 levels would take 288 MB each if they were dense; the truth comes out."""
    people, turns = 6_000, 4
    who = np.repeat(np.arange(people), turns)
    design = np.column_stack([np.ones(who.size), np.tile([0.0, 1.0], who.size // 2)])
    y = design @ [1.0, 0.3] + rng.normal(0, 0.5, people)[who] + rng.normal(0, 0.2, who.size)

    found = fit_linear_mixed(design, y, {"participant": who})

    assert found.beta == pytest.approx([1.0, 0.3], abs=0.03)
    assert found.sd["participant"] == pytest.approx(0.5, rel=0.05)
    assert found.residual_sd == pytest.approx(0.2, rel=0.05)
    many = np.arange(MOST_LEVELS + 1)
    with pytest.raises(StudyError, match=r"at most 50,000 participants.*there are 50,001"):
        fit_linear_mixed(np.ones((many.size, 1)), many * 1.0, {"participant": many})
    groups = {name: rng.permutation(many) % 4_500 for name in ("participant", "scene")}
    with pytest.raises(StudyError, match=r"at most 20,000,000 pairs.*there are 40,504,500"):
        fit_linear_mixed(np.ones((many.size, 1)), many * 1.0, groups)


def test_a_column_of_file_names_is_not_taken_for_conditions():
    names = [f"picture-{number}.png" for number in range(MOST_CONDITIONS + 1)]

    assert len(pairs_of(names[1:], None)) == 2 * MOST_CONDITIONS - 1
    with pytest.raises(StudyError, match=r"at most 200 conditions must be compared \(found 201\)"):
        pairs_of(names, None)


def test_one_time_of_each_condition_by_each_person_leaves_no_sd_of_it(rng):
    rows = pd.DataFrame(
        [(f"P{k}", name, np.exp(rng.normal())) for k in range(12) for name in "abc"],
        columns=["participant", "method", "rt_s"],
    )
    model = time_model(rows, ["method"])

    assert model.interaction_sd == 0.0
    assert model.residual_sd > 0.5
    assert [one.df for one in model.ratios] == pytest.approx([11.0] * 3)
