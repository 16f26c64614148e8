"""What the data do not identify has no number: in text, tables, JSON and CSV. A declared scale
keeps its numbers."""

from __future__ import annotations

import json
import math
import re
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from analysis.ordinal import paired_ratings, rating_model
from analysis.tasks.ratings.settings import RatingsOptions, settings_of
from analysis.tasks.ratings.study import analyse
from study_app.cli import app

SCALE = ["bad", "poor", "fair", "good", "excellent"]
STEPS = ",".join(SCALE)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["analysis", *map(str, arguments)], env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def words() -> pd.DataFrame:
    """A five-point scale whose middle nobody used; R's clmm places plain 0.992 below ours."""
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
    result = run("import", folder / "table.csv", "--task", task, *sets, "--out", folder / "in")
    assert result.exit_code == 0, result.output
    result = run("report", folder / "in" / "decisions.csv", "--out", folder / "out", "--no-figures")
    assert result.exit_code == 0, result.output
    return folder / "out"


def text_of(page: Path) -> str:
    """What a reader sees of a report, without its figures."""
    return re.sub(r"(?s)<svg.*?</svg>|<style.*?</style>|<[^>]+>", " ", page.read_text())


@pytest.mark.parametrize("rating", ["words", "numbers"])
def test_a_step_that_nobody_used_keeps_its_number(words, tmp_path, rating):
    if rating == "numbers":
        words = words.assign(rating=words["rating"].map(SCALE.index) + 1)
    words.to_csv(tmp_path / "ratings.csv", index=False)
    scale = ",".join(SCALE) if rating == "words" else "1,2,3,4,5"
    result = run("ratings", tmp_path / "ratings.csv", "--by", "method", "--scale", scale,
                 "--out", tmp_path / "out")  # fmt: skip
    written = pd.read_csv(tmp_path / "out" / "ratings.csv")

    assert result.exit_code == 0, result.output
    assert re.search(r"ours +70 +3\.64", result.output)
    assert re.search(r"plain +70 +2\.60 +-0\.992", result.output)
    assert written["mean_rating"].tolist() == pytest.approx([3.642857, 2.6], abs=1e-5)
    assert (written[f"share_{scale.split(',')[2]}"] == 0).all()


def test_change_over_the_session_counts_steps_of_the_declared_scale(words):
    numbers = words.assign(rating=[4 if place % 10 > 4 else 2 for place in range(len(words))])
    numbers.loc[[0, 11], "rating"] = [1, 5]
    changes = []
    for rows, scale in ((numbers, None), (numbers.replace(dict(enumerate(SCALE, 1))), STEPS)):
        rows = rows.assign(order=rows.groupby("participant").cumcount() + 1, rt_s=np.nan)
        settings = settings_of(rows, "table", RatingsOptions(by="method", scale=scale))
        changes.append(analyse(rows, settings, lambda _: None).learning[0][1].change)

    assert changes[0] == pytest.approx(changes[1])
    assert changes[0] > 1.5  # from the second step to the fourth, not to the next one in use


def test_ratings_all_at_the_top_have_a_mean_and_no_distance(top, tmp_path):
    top.to_csv(tmp_path / "top.csv", index=False)
    result = run("ratings", tmp_path / "top.csv", "--by", "method", "--scale", ",".join(SCALE),
                 "--out", tmp_path / "out")  # fmt: skip
    out = tmp_path / "out"
    gap = pd.read_csv(out / "comparisons.csv").iloc[0]
    numbers = json.loads((out / "results.json").read_text())["result"]

    assert result.exit_code == 0, result.output
    assert re.search(r"ours +70 +5\.00 +0 ", result.output)
    assert re.search(r"plain +70 +2\.60 +none +none", result.output)
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
