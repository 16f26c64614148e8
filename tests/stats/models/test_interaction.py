"""Interaction of a preference, or a difference of right answers, with a second factor."""

import json
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import result_of
from scipy import stats
from undrawn_reports import undrawn

from analysis.models.cells import checked, grid
from analysis.models.clustered import two_way_difference
from analysis.models.contrasts import Difference
from analysis.models.right_answers import share_interactions
from analysis.parts.interaction import Interaction, Interactions, PreferenceInteraction
from analysis.parts.preferences import PreferencesPart
from analysis.plans.table_sections import PreferenceTableSection
from analysis.report.write_report import report_decisions
from analysis.tasks import analysis_of
from protocols.errors import StudyError
from protocols.load import load_protocol


def pairs(rng, *, people=10, scenes=6, repeats=2, apart=False, large=1.0, own=0.5):
    """Return decisions between ours and blur at two sizes; `apart`: each scene at one of them."""
    rows = []
    taste, liked = rng.normal(0, own, (people, 2)), rng.normal(0, own, (scenes, 2))
    for who in range(people):
        for scene in range(scenes):
            for at, size in enumerate(("small", "large")):
                if apart and scene % 2 != at:
                    continue
                for turn in range(repeats):
                    logit = large * at + taste[who, at] + liked[scene, at]
                    chosen = rng.random() < 1 / (1 + np.exp(-logit))
                    both = ("ours", "blur") if turn % 2 else ("blur", "ours")
                    rows.append((f"P{who}", f"s{scene}", size, *both,
                                 "ours" if chosen else "blur"))  # fmt: skip
    return pd.DataFrame(rows, columns=["participant", "scene", "size", "first", "second", "chosen"])


def decided(table):
    other = table["first"].where(table["chosen"] == table["second"], table["second"])
    return table.assign(rejected=other)


def events(table):
    rows = checked(table, ())
    chose = (rows["chosen"] == "ours").astype(int)
    return grid(rows), {size: {"ours": chose[rows["size"] == size]} for size in ("small", "large")}


def test_with_one_scene_it_is_the_paired_t_test(rng):
    table = pairs(rng, scenes=1, repeats=12)
    places, happened = events(table)
    (one,) = share_interactions(happened, places, "share", 0.95)
    own = table.assign(c=table["chosen"] == "ours").pivot_table("c", "participant", "size")
    known = stats.ttest_rel(own["small"], own["large"])

    assert one.difference == pytest.approx(float((own["small"] - own["large"]).mean()))
    assert one.p == pytest.approx(known.pvalue)
    assert one.df == pytest.approx(9)
    assert (one.lower, one.upper) == pytest.approx(tuple(known.confidence_interval(0.95)))


def test_scenes_of_one_size_each_are_two_samples(rng):
    """The variance between scenes is Welch's: each size about its own mean, with 2 + 2 degrees."""
    people, per_size = 40, 3
    shown = np.zeros((2, people, 2 * per_size))
    shown[0, :, :per_size] = shown[1, :, per_size:] = 1.0
    scene = rng.normal(0, 1.0, 2 * per_size)
    values = np.tile(scene, (people, 1)) + 1e-6 * rng.standard_normal((people, 2 * per_size))
    moved = []
    for one in shown:
        mean = float((values * one).sum() / one.sum())
        moved.append((values - mean) * one / one.sum())
    found = two_way_difference(0.5, (moved[0], moved[1]), (shown[0], shown[1]))
    groups = scene[:per_size], scene[per_size:]
    parts = [group.var(ddof=1) / per_size for group in groups]

    assert float(found.standard_error) == pytest.approx(np.sqrt(sum(parts)), rel=1e-3)
    welch = sum(parts) ** 2 / sum(part**2 / (per_size - 1) for part in parts)
    assert float(found.df) == pytest.approx(welch, rel=1e-3)


@pytest.mark.parametrize("alone", [2, 3])
def test_two_people_against_many_have_one_degree_of_freedom(alone, rng):
    """Welch's degrees would grow with the many where the two happen to agree."""
    shown = np.zeros((2, alone + 20, 1))
    shown[0, :alone] = shown[1, alone:] = 1.0
    person = np.concatenate([0.1 * np.arange(alone), rng.normal(0.0, 1.0, 20)])[:, None]
    moved = [(person - person[one > 0].mean()) * one / one.sum() for one in shown]
    found = two_way_difference(0.5, (moved[0], moved[1]), (shown[0], shown[1]))
    groups = person[:alone, 0], person[alone:, 0]
    welch = stats.ttest_ind(*groups, equal_var=False).df

    assert welch > 3.0
    assert float(found.df) == pytest.approx(1.0 if alone == 2 else welch)


@pytest.mark.parametrize("apart", [False, True])
def test_where_nothing_changes_it_is_seldom_found(rng, apart):
    """As the benchmark counts; at .08 of so few studies it would have grown by half."""
    found = []
    for _ in range(60):
        places, happened = events(pairs(rng, scenes=4, repeats=1, apart=apart, large=0.0))
        found.append(share_interactions(happened, places, "share", 0.95)[0].p)

    assert np.mean(np.array(found) < 0.05) <= 0.1


run = result_of(env={"COLUMNS": "300"})


def imported(table, folder, *options):
    table.to_csv(folder / "table.csv", index=False)
    told = [part for one in options for part in ("--set", one)]
    task = ["--task", "identification"] if "correct" in table else []
    made = run(
        "analysis",
        "import",
        folder / "table.csv",
        *task,
        *told,
        "--out",
        folder / "in",
        status=None,
    )
    if made.exit_code:
        return made, {}, ""
    with undrawn():
        report = report_decisions(folder / "in" / "decisions.csv", folder / "out",
                                  figure_files="none")  # fmt: skip
    return made, json.loads(report.json.read_text())["results"], report.html.read_text()


def test_a_table_of_preferences_has_it_where_it_is_asked_for(rng, tmp_path):
    table = pairs(rng, people=14, large=2.0)
    for name in "ab":
        (tmp_path / name).mkdir()
    _, without, _ = imported(table, tmp_path / "a")
    _, found, page = imported(table, tmp_path / "b", "interaction=size", "primary=ours/blur")

    assert "interaction" not in without
    (share,) = found["interaction"]["shares"]
    assert share["gap"]["p"] < 0.05
    assert share["gap"]["difference"] == pytest.approx(
        found["preferences"]["table"]["cells"][0]["share"]
        - found["preferences"]["table"]["cells"][1]["share"]
    )
    assert "Interaction with size" in page
    assert "large minus small" in page


def test_right_answers_are_compared_between_a_property_of_scenes(rng, tmp_path):
    rows = [
        (f"P{who}", f"s{scene}", method, "wide" if scene < 4 else "narrow",
         int(rng.random() < (0.95 if method == "ours" and scene < 4 else 0.6)))
        for who in range(12) for scene in range(8) for method in ("ours", "blur") for _ in "ab"
    ]  # fmt: skip
    table = pd.DataFrame(rows, columns=["participant", "scene", "method", "gap", "correct"])
    _, found, page = imported(table, tmp_path, "alternatives=2", "by=method", "baseline=blur",
                              "interaction=gap")  # fmt: skip
    (one,) = found["interaction"]["planned"]
    own = table.pivot_table("correct", "method", "gap")
    change = (own.loc["ours", "narrow"] - own.loc["blur", "narrow"]) - (
        own.loc["ours", "wide"] - own.loc["blur", "wide"]
    )

    assert one["gap"]["difference"] == pytest.approx(change)
    assert one["gap"]["p"] < 0.05
    assert one["gap"]["df"] < 11
    assert "narrow minus wide" in page
    (tmp_path / "b").mkdir()
    refused, *_ = imported(table, tmp_path / "b", "alternatives=2", "interaction=gpa")
    assert refused.exit_code == 2
    assert "must have the columns gpa" in refused.output


def test_few_people_and_many_values_are_said_to_show_no_change(rng):
    """Six changes of six people: the least p of one is .031, and Holm multiplies it by six."""
    rows = pd.DataFrame(product(range(6), range(4), "wxyz", "ab"),
                        columns=["participant", "scene", "gap", "repeat"])  # fmt: skip
    rows["correct"] = rng.integers(0, 2, len(rows))
    analysis = analysis_of("identification")
    for people, said in ((6, True), (12, False)):
        more = rows.assign(participant=rows["participant"] + 6)
        table = pd.concat([rows, more][: people // 6], ignore_index=True)
        told = analysis.options(alternatives=2, interaction="gap")
        plan = analysis.plan_of_table(table, "table", told)
        (part,) = (one for one in analysis.parts if one.name == "interaction")
        notes = part.compute(analysis.table(table, plan), plan, {}, rng).notes
        assert any("none of 6 changes with gap can be significant" in one for one in notes) == said


def test_a_study_plans_it_and_preregisters_it(tmp_path):
    shipped = (Path(__file__).parents[3] / "protocols" / "studies" / "demo.toml").read_text()
    file = tmp_path / "study.toml"
    file.write_text(shipped.replace('\nkind = "preference"\n',
                                    '\nkind = "preference"\ninteraction = "size"\n'))  # fmt: skip
    study = load_protocol(file)

    assert study.sha256 != load_protocol(Path("demo")).sha256
    assert analysis_of("preference").plan(study).interaction == "size"
    said = " ".join(study.analysis.plain_sentences(study.task, study.pool))
    assert "whether the preference of metameric over push-pull differs between sizes" in said
    file.write_text(shipped.replace('\nkind = "preference"\n',
                                    '\nkind = "preference"\ninteraction = "scene"\n'))  # fmt: skip
    with pytest.raises(StudyError, match=r"analysis\.interaction"):
        load_protocol(file)


def test_a_box_that_leaves_planned_changes_out_says_how_many():
    rows = pd.DataFrame(
        [("P1", "s", size, "ours", "blur", "ours") for size in "abcd"],
        columns=["participant", "scene", "size", "first", "second", "chosen"],
    )
    plan = analysis_of("preference").plan_of_table(
        rows, "rows", PreferenceTableSection(interaction="size")
    )
    changes = tuple(
        Interaction(
            "ours",
            other,
            Difference("share of choices", *pair, 0.1, 0.1, -0.1, 0.3, 0.95, 5.0, 0.3, 0.3),
        )
        for other in ("blur", "plain")
        for pair in combinations("abcd", 2)
    )
    found = Interactions("size", 0.5, (), changes, changes, ())
    (box,) = PreferenceInteraction().show(found, plan).lead

    assert str(box).count("ours / blur: ") == 6
    assert "6 more are below." in str(box)


def test_planned_changes_are_adjusted_by_themselves_in_table_and_sentences_too(rng):
    """The preregistration says so, and the box: a second p of the same change contradicts it."""
    rows = [pairs(rng, people=7, scenes=3)]
    rows += [rows[0].replace("blur", name) for name in ("none", "most")]
    table = pd.concat(rows, ignore_index=True)
    settings = PreferenceTableSection(interaction="size", primary="ours/blur")
    plan = analysis_of("preference").plan_of_table(table, "rows", settings)
    found = PreferenceInteraction().compute(decided(table), plan, {}, np.random.default_rng(0))
    planned, *others = found.shares

    assert (planned.first, planned.second) == ("ours", "blur")
    assert planned.gap.p_adjusted == planned.gap.p
    assert [one.gap for one in found.planned] == [planned.gap]
    assert len(others) == 2
    assert all(one.gap.p_adjusted == pytest.approx(min(1, 2 * one.gap.p)) for one in others)
    sentence, *_ = PreferenceInteraction().show(found, plan).sentences
    assert "Holm" not in sentence


def test_groups_of_people_at_one_size_each_are_counted_together(rng):
    """Five people a size are ten of whom primary and change tell, whose p are held at 2/2^10."""
    table = decided(pairs(rng, people=10, large=4.0))
    late = table["participant"] >= "P5"
    table = table[late == (table["size"] == "large")].reset_index(drop=True)
    plan = analysis_of("preference").plan_of_table(
        table, "rows", PreferenceTableSection(interaction="size", primary="ours/blur")
    )
    found = PreferenceInteraction().compute(table, plan, {}, np.random.default_rng(0))
    shares = PreferencesPart().of(table, plan)

    assert found.planned[0].gap.p < 0.05
    assert shares.primary.participants == 10
    assert not [note for note in (*found.notes, *shares.notes) if "cannot be significant" in note]
    assert any("none of 2 comparisons can be significant" in note for note in shares.notes)
