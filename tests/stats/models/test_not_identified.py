"""Numbers that the data do not identify are nowhere: text, tables, JSON and CSV. A declared scale
keeps its numbers.
"""

import json
import math
import re
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import result_of

from analysis.models import scaling
from analysis.models.logistic import glm_logit, models_beside
from analysis.models.ordinal import paired_ratings, rating_model
from analysis.models.reaction import reaction_times
from analysis.models.trends import trend
from analysis.parts import computed
from analysis.parts.learning import Learning, StepLearning, apa_trend
from analysis.parts.ratings import RatingsPart
from analysis.plans.table_sections import RatingTableSection
from analysis.plots import reaction_plot
from analysis.tasks import analysis_of

SCALE = ["bad", "poor", "fair", "good", "excellent"]
STEPS = ",".join(SCALE)
run = result_of("analysis", env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def words() -> pd.DataFrame:
    """A five-point scale whose middle nobody used; plain is placed 1.008 below ours.

    R's clmm gives 0.992 with scenes, and without what a method gains in a scene.
    """
    g = np.random.default_rng(9)
    rows = []
    for person in range(14):
        taste = g.normal(0, 0.6)
        for scene in range(5):
            for method, better in (("plain", 0.0), ("ours", 0.9)):
                latent = better + taste + g.standard_normal()
                step = int(np.searchsorted([-0.9, 0.1, 0.1001, 1.2], latent))
                rows.append((f"P{person:02}", f"S{scene}", method, SCALE[step]))
    return pd.DataFrame(rows, columns=["participant", "scene", "method", "rating"])


@pytest.fixture(scope="module")
def top(words) -> pd.DataFrame:
    return words.assign(rating=words["rating"].where(words["method"] != "ours", "excellent"))


def report_of(table: pd.DataFrame, folder: Path, *options: str, task: str = "ratings") -> Path:
    """The report of an imported table."""
    table.to_csv(folder / "table.csv", index=False)
    sets = [part for option in options for part in ("--set", option)]
    run("import", folder / "table.csv", "--task", task, *sets, "--out", folder / "in")
    run("report", folder / "in" / "decisions.csv", "--out", folder / "out", "--no-figures")
    return folder / "out"


def text_of(page: Path) -> str:
    """Text that a reader sees of a report, without its figures."""
    return re.sub(r"(?s)<svg.*?</svg>|<style.*?</style>|<[^>]+>", " ", page.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("rating", ["words", "numbers"])
def test_a_step_that_nobody_used_keeps_its_number(words, tmp_path, rating):
    if rating == "numbers":
        words = words.assign(rating=words["rating"].map(SCALE.index) + 1)
    words.to_csv(tmp_path / "ratings.csv", index=False)
    scale = ",".join(SCALE) if rating == "words" else "1,2,3,4,5"
    result = run("ratings", tmp_path / "ratings.csv", "--by", "method", "--scale", scale,
                 "--out", tmp_path / "out")  # fmt: skip
    written = pd.read_csv(tmp_path / "out" / "tables" / "ratings.csv")

    assert re.search(r"ours +70 .* 3\.64 ", result.output)
    assert re.search(r"plain +70 +-1\.01 .* 2\.60 ", result.output)
    assert written["mean_rating"].tolist() == pytest.approx([3.642857, 2.6], abs=1e-5)
    assert (written[f"share_{scale.split(',')[2]}"] == 0).all()


@pytest.mark.slow
def test_change_over_the_session_counts_steps_of_the_declared_scale(words):
    numbers = words.assign(rating=[4 if place % 10 > 4 else 2 for place in range(len(words))])
    numbers.loc[[0, 11], "rating"] = [1, 5]
    changes = []
    for rows, scale in ((numbers, ()), (numbers.replace(dict(enumerate(SCALE, 1))), STEPS)):
        rows = rows.assign(order=rows.groupby("participant").cumcount() + 1, rt_s=np.nan)
        section = RatingTableSection(by="method", scale=scale)
        settings = analysis_of("ratings").plan_of_table(rows, "table", section)
        found, _ = computed((RatingsPart(), StepLearning()), rows, settings)
        changes.append(found["learning"].trends[0].change)

    assert changes[0] == pytest.approx(changes[1])
    assert changes[0] > 1.5  # from the second step to the fourth, not to the next one in use


def test_ratings_all_at_the_top_have_a_mean_and_no_distance(top, tmp_path):
    top.to_csv(tmp_path / "top.csv", index=False)
    result = run("ratings", tmp_path / "top.csv", "--by", "method", "--scale", ",".join(SCALE),
                 "--out", tmp_path / "out")  # fmt: skip
    out = tmp_path / "out"
    gap = pd.read_csv(out / "tables" / "comparisons.csv").iloc[0]
    numbers = json.loads((out / "results.json").read_text())["results"]["ratings"]["model"]

    assert re.search(r"ours +70 +0\.00 .* 5\.00 ", result.output)
    assert re.search(r"plain +70 +none +none +2\.60 ", result.output)
    assert "not identified by these data" in result.output
    assert "p <" not in result.output
    assert "7.4" not in result.output
    assert gap[["difference", "lower", "upper", "p", "p_adjusted", "superiority"]].isna().all()
    assert numbers["contrasts"][0]["difference"] is None
    assert numbers["conditions"][1]["place"] is None
    assert numbers["thresholds"] == [None] * 3


def test_a_report_of_separated_ratings_prints_no_distance(top, tmp_path):
    out = report_of(top, tmp_path, "by=method", f"scale={STEPS}")
    page = text_of(out / "report.html")

    assert "is not identified by these data" in page
    assert "5.00" in page
    assert "7.4" not in page
    assert not re.search(r"\bnan\b", page)
    assert pd.read_csv(out / "tables" / "comparisons.csv")["p"].isna().all()


@pytest.mark.parametrize("extreme", ["abc", "zzz"])
@pytest.mark.parametrize("link", ["probit", "logit"])
def test_a_method_at_the_top_leaves_the_distance_of_the_others(words, link, extreme):
    others = rating_model(words, ("method",), categories=SCALE, link=link).contrasts[0]
    high = words[words["method"] == "plain"].assign(method=extreme, rating="excellent")
    rows = pd.concat([words, high], ignore_index=True)
    model = rating_model(rows, ("method",), categories=SCALE, link=link)
    (told,) = [one for one in model.contrasts if not math.isnan(one.p)]

    assert {told.first, told.second} == {"ours", "plain"}
    assert told.difference == pytest.approx(others.difference, abs=0.03)
    assert told.upper - told.lower == pytest.approx(others.upper - others.lower, rel=0.05)


def test_a_method_that_always_wins_is_not_placed():
    rng = np.random.default_rng(5)
    rows = []
    for person, turn, (first, second) in product(range(6), range(8), combinations("abz", 2)):
        sides = (first, second) if turn % 2 else (second, first)
        won = 1 if sides[0] == "z" else -1
        rows.append((f"p{person}", *sides, 2 * won if second == "z" else rng.choice([-1, 0, 1])))
    table = pd.DataFrame(rows, columns=["participant", "first", "second", "rating"])
    found = {(one.first, one.second): one for one in paired_ratings(table).contrasts}

    assert math.isfinite(found["a", "b"].p)
    assert math.isnan(found["a", "z"].difference)
    assert math.isnan(found["b", "z"].p)


def levels_table(folder: Path, right) -> Path:
    """Six people, five levels; `right` says whether trial t at level x is."""
    rows = [(f"P{p}", 1 + t % 5, int(right(1 + t % 5, t + p))) for p in range(6) for t in range(60)]
    table = pd.DataFrame(rows, columns=["participant", "level", "correct"])
    table.to_csv(folder / "levels.csv", index=False)
    return folder / "levels.csv"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answers", "right"),
    [("all right", lambda _x, _t: True), ("at chance", lambda _x, t: (t // 5) % 2)],
)
def test_thresholds_that_no_answer_places_have_no_number_anywhere(tmp_path, answers, right):
    del answers
    file = levels_table(tmp_path, right)
    result = run("psychometric", file, "--level", "level", "--out", tmp_path / "out")
    out = tmp_path / "out"
    population = pd.read_csv(out / "tables" / "thresholds.csv").iloc[0]
    person = pd.read_csv(out / "tables" / "people.csv").iloc[0]
    numbers = json.loads((out / "results.json").read_text())["results"]

    assert re.search(r"all +not identified by these data +none +none", result.output)
    assert re.search(r"P0 +all +not identified by these data +none +none", result.output)
    assert "not identified by these data" in result.output
    assert population[["threshold", "lower", "upper", "width"]].isna().all()
    assert person[["threshold", "threshold_lower", "threshold_upper", "width"]].isna().all()
    assert numbers["thresholds"]["thresholds"][0]["value"] is None
    assert numbers["thresholds"]["participant_sd"] is None
    assert numbers["psychometric"]["people"][0]["fit"]["threshold"] is None
    assert not pd.read_csv(out / "tables" / "comparisons_of_people.csv").size


def coin(rng: np.random.Generator, **columns: object) -> pd.DataFrame:
    count = 200
    people = {"participant": [f"p{k % 8}" for k in range(count)], "scene": ["s", "t"] * 100}
    return pd.DataFrame(people | {"correct": (rng.random(count) < 0.7).astype(int)} | columns)


def test_terms_that_cannot_be_told_apart_have_no_numbers():
    """Each method was shown at a level of its own; what is beside them is told."""
    rng = np.random.default_rng(0)
    method = np.array(["a", "b"] * 100)
    rows = coin(rng, method=method, level=np.where(method == "a", 1.0, 2.0), z=rng.random(200))
    beside = models_beside("logit(correct) ~ 1 + level + method + z", rows)
    alone = glm_logit("logit(correct) ~ 1 + method + z", rows)

    for fit in (beside.independent, beside.clustered, beside.mixed):
        for term in ("Intercept", "level", "method[T.b]"):
            assert np.isnan([fit[term].estimate, fit[term].standard_error, fit[term].p]).all()
        assert fit["z"].estimate == pytest.approx(alone["z"].estimate, rel=1e-3)
        assert any("cannot be told apart" in note for note in fit.warnings)


def test_a_trend_without_a_test_has_no_p():
    one = pd.DataFrame({"participant": "p", "order": range(6), "right": [0, 1, 0, 1, 1, 1]})
    same = pd.DataFrame({"participant": ["p", "q"], "order": [1, 1], "right": [1, 1]})
    lone, flat = trend(one, "right"), trend(same, "right")

    assert lone.change > 0  # of the one person
    assert np.isnan([lone.lower, lone.upper, lone.p, lone.sign_flip_p]).all()
    assert np.isnan([flat.change, flat.p, flat.spearman_rho, flat.spearman_p]).all()
    for found in (lone, flat):
        assert apa_trend(found) == (
            "Whether right changed over the session is not identified by these data."
        )
    shown = StepLearning().show(Learning((flat,), None), None)
    (table,) = [part for part in shown.blocks if hasattr(part, "rows")]
    assert {cell for row in table.rows for cell in row[1:]} == {"none"}


def test_times_of_one_person_have_no_limits():
    rng = np.random.default_rng(2)
    rows = pd.DataFrame(
        {"participant": "p", "rt_s": rng.gamma(4, 0.1, 80) + 0.3, "correct": [1, 1, 1, 0] * 20}
    )
    (times,) = reaction_times(rows, ())

    assert times.mean_of_medians > 0
    assert np.isnan([times.lower, times.upper]).all()
    reaction_plot([times], {"all trials": [0.6]})


def test_a_scale_whose_fit_does_not_converge_has_no_scores(monkeypatch):
    votes = np.array([[0, 6.0, 8], [4, 0, 7], [2, 3, 0]])
    right = scaling.solve_pairs
    monkeypatch.setattr(
        scaling, "solve_pairs", lambda *given: replace(right(*given), converged=np.bool_(False))
    )
    found = scaling.scale(votes, ["a", "b", "c"])

    assert np.isnan(found.scores).all()
    assert any("left out" in note for note in found.warnings)
