"""Tables of ratings: imported by name, reported by a cumulative-link mixed model."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import result_of

from analysis.models.ordinal import paired_ratings, rating_model
from analysis.parts.ratings import RatingsPart
from analysis.plans.table_sections import RatingTableSection
from analysis.tables.table import Table
from analysis.tasks import analysis_of
from analysis.tasks.note import options_from
from protocols.errors import StudyError

SCALE = ("bad", "fair", "good", "best")
SHIFT = {"ours": 1.2, "blur": 0.0, "fill": 0.5}
run = result_of("analysis", env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def votes() -> pd.DataFrame:
    """Eight people rate three methods in four scenes, thrice."""
    rng = np.random.default_rng(4)
    rows = pd.DataFrame(
        product(range(8), "abcd", SHIFT, range(3)), columns=["who", "scene", "method", "time"]
    )
    taste = rows["who"].map(dict(enumerate(rng.normal(0, 0.7, 8))))
    latent = rows["method"].map(SHIFT) + taste + rng.standard_normal(len(rows))
    rows["vote"] = np.array(SCALE)[np.digitize(latent, (-0.5, 0.6, 1.6))]
    rows["rt_s"] = np.exp(rng.normal(0, 0.3, len(rows))).round(3)
    return rows.drop(columns="time")


@pytest.fixture(scope="module")
def imported(votes, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("ratings")
    votes.to_csv(folder / "votes.csv", index=False)
    run(
        "import", folder / "votes.csv", "--task", "ratings", "--map", "participant=who",
        "--map", "rating=vote", "--set", "by=method", "--set", "baseline=blur",
        "--set", f"scale={','.join(SCALE)}", "--out", folder / "in",
    )  # fmt: skip
    run("report", folder / "in" / "decisions.csv", "--out", folder / "out", "--no-figures")
    return folder


@pytest.mark.slow
def test_a_report_of_imported_ratings_holds_the_model_of_the_original_table(votes, imported):
    numbers = json.loads((imported / "out" / "results.json").read_text())
    rows = votes.rename(columns={"who": "participant", "vote": "rating"})
    wanted = rating_model(rows, ("method",), categories=SCALE, reference="blur")

    found = numbers["results"]["ratings"]["model"]
    assert found["categories"] == list(SCALE)
    assert found["ratings"] == len(votes)
    for one, other in zip(found["contrasts"], wanted.contrasts, strict=True):
        assert (one["first"], one["second"]) == (other.first, "blur")
        assert one["difference"] == pytest.approx(other.difference, abs=1e-6)
        assert one["p"] == pytest.approx(other.p, rel=1e-4)
    assert wanted.contrasts[-1].difference == pytest.approx(1.2, abs=0.4)


def test_the_page_shows_places_comparisons_people_and_times(votes, imported):
    page = (imported / "out" / "report.html").read_text()
    counted = pd.crosstab(votes["who"], votes["vote"]).loc[3]

    for text in ("Places on the latent axis", "ours - blur", "log-normal mixed model", "Clearest"):
        assert text in page
    levels = json.loads((imported / "out" / "results.json").read_text())["results"]["ratings"][
        "levels"
    ]
    assert levels["3"] == [int(counted.get(name, 0)) for name in SCALE]
    assert list(pd.read_csv(imported / "out" / "tables" / "ratings.csv")["condition"]) == [
        "blur", "fill", "ours",
    ]  # fmt: skip


def test_the_clearest_comparison_stands_first_and_holms_p_decides(votes, rng):
    """Of the clearest comparison, how many differ, the main numbers and the planned test."""
    rows = votes.rename(columns={"who": "participant", "vote": "rating"})
    plan = analysis_of("ratings").plan_of_table(
        rows, "table", RatingTableSection(by="method", scale=SCALE, baseline="blur")
    )
    part = RatingsPart()
    found = part.compute(rows, plan, {}, rng)
    fill, ours = found.model.contrasts
    fill = replace(fill, p=0.01, p_adjusted=0.02)
    ours = replace(ours, p=0.2, p_adjusted=0.2)
    found = replace(found, model=replace(found.model, contrasts=(ours, fill)))

    assert part.planned_p(found, plan) == 0.02
    assert [one.p for one in part.estimates(found, plan)] == [0.2, 0.02]
    (box,) = part.show(found, plan).lead
    assert box.lead.startswith("fill was rated")
    assert "1 of 2 comparisons differ, two-sided, Holm-adjusted over 2, by" in box.text


def test_graded_pairs_with_ties_become_a_report_too(tmp_path):
    rng = np.random.default_rng(2)
    rows = []
    for person, (one, other), _ in product(
        range(7), (("a", "b"), ("b", "c"), ("c", "a")), range(6)
    ):
        place = {"a": 0.0, "b": 0.8, "c": 0.2}
        gap = place[one] - place[other] + rng.standard_normal()
        rows.append((f"P{person}", one, other, int(np.digitize(gap, (-0.5, 0.5))) - 1))
    table = pd.DataFrame(rows, columns=["participant", "first", "second", "rating"])
    table.to_csv(tmp_path / "pairs.csv", index=False)
    made = run(
        "import", tmp_path / "pairs.csv", "--task", "ratings", "--set", "baseline=a",
        "--out", tmp_path / "in", status=None
    )  # fmt: skip
    shown = run(
        "report",
        tmp_path / "in" / "decisions.csv",
        "--out",
        tmp_path / "out",
        "--no-figures",
        status=None,
    )

    assert (made.exit_code, shown.exit_code) == (0, 0), made.output + shown.output
    model = json.loads((tmp_path / "out" / "results.json").read_text())["results"]["ratings"][
        "model"
    ]
    assert model["categories"] == ["-1", "0", "1"]
    wanted = paired_ratings(table, reference="a").contrasts[0].difference
    assert model["contrasts"][0]["difference"] == pytest.approx(wanted, abs=1e-6)
    assert "graded comparisons of pairs" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("change", "options", "wanted"),
    [
        ({}, {}, "line 2: rating must be a number, or .* --set scale=bad,fair,good"),
        ({}, {"scale": "bad,fair,good"}, "rating must be one of bad, fair, good"),
        ({}, {"scale": "bad"}, "--set scale: must name two different ratings"),
        ({"vote": "rate"}, {}, "must have the columns rating"),
        ({"method": "which"}, {"scale": ",".join(SCALE)}, "must have the columns method"),
    ],
)
def test_tables_that_hold_no_ratings_are_refused_with_the_cure(
    votes, tmp_path, change, options, wanted
):
    file = tmp_path / "votes.csv"
    votes.rename(columns={"who": "participant", "vote": "rating"} | change).to_csv(
        file, index=False
    )
    analysis = analysis_of("ratings")
    mapping = {} if "vote" not in change else {"rating": "nothing"}

    with pytest.raises(StudyError, match=wanted if not mapping else "nothing"):
        analysis.read(Table(file, mapping), options_from("ratings", {"by": "method", **options}))


def test_a_baseline_that_nobody_rated_is_named(votes, tmp_path):
    file = tmp_path / "votes.csv"
    votes.rename(columns={"who": "participant", "vote": "rating"}).to_csv(file, index=False)
    analysis = analysis_of("ratings")
    options = analysis.options(by="method", baseline="blurr", scale=",".join(SCALE))

    with pytest.raises(StudyError, match=r"baseline=blurr.*did you mean 'blur'"):
        analysis.plan_of_table(analysis.read(file, options), "votes", options)


@pytest.mark.slow
def test_ratings_of_one_person_are_refused_with_a_cure_that_import_names_too(votes, tmp_path):
    cure = "add those of another participant"
    for people, status in ((1, 2), (2, 0)):
        rows = votes.query("who < @people").rename(columns={"who": "participant", "vote": "rating"})
        rows.to_csv(tmp_path / "votes.csv", index=False)
        done = run(
            "import", tmp_path / "votes.csv", "--task", "ratings", "--set", "by=method",
            "--set", f"scale={','.join(SCALE)}", "--out", tmp_path / f"in{people}",
        )  # fmt: skip
        assert ("no report yet" in done.output and cure in done.output) == (people == 1)
        assert ("next: metamerlab analysis report" in done.output) == (people == 2)
        decisions = tmp_path / f"in{people}" / "decisions.csv"
        made = run(
            "report", decisions, "--out", tmp_path / f"out{people}", "--no-figures", status=None
        )
        assert made.exit_code == status, made.output
        assert (cure in " ".join(made.output.split())) == (people == 1)


@pytest.mark.slow
def test_a_slider_is_told_by_quartiles_and_drawn_whole():
    rng = np.random.default_rng(2)
    rows = pd.DataFrame(product(range(6), "AB", range(6)), columns=["participant", "method", "n"])
    rows["rating"] = rng.permutation(100)[: len(rows)]
    plan = analysis_of("ratings").plan_of_table(rows, "rows", RatingTableSection(by="method"))
    shown = RatingsPart().show(RatingsPart().of(rows, plan), plan)
    (places,) = (one for one in shown.blocks if "Places" in getattr(one, "caption", ""))
    people = shown.further[0].blocks[0]
    own = rows.loc[rows["participant"] == 0, "rating"]
    quartiles = np.percentile(own, (0, 25, 50, 75, 100), method="inverted_cdf")

    assert places.columns[-5:] == people.columns[1:]
    assert list(people.rows[0][1:]) == [str(one) for one in quartiles]
    for width_in in (3.33, 7.0):
        figure = shown.figures[0].draw(width_in=width_in)
        figure.draw_without_rendering()
        (legend,) = figure.legends
        box = legend.get_window_extent()
        assert len(legend.get_texts()) <= 14
        assert box.x0 >= 0.0
        assert box.x1 <= figure.bbox.x1
        assert box.y1 <= figure.axes[0].get_window_extent().y0
