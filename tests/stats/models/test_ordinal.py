"""Ordered ratings: package ordinal's models, ties of pairs, what a user sees."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import result_of
from scipy import integrate, stats

from analysis.models.ordinal import (
    RandomFactor,
    fit_cumulative,
    paired_ratings,
    rating_model,
    superiority,
)

FOLDER = Path(__file__).parents[1] / "oracles"
ORACLE = json.loads((FOLDER / "oracle_times.json").read_text())


@pytest.fixture(scope="module")
def rated() -> pd.DataFrame:
    return pd.read_csv(FOLDER / "times.csv")


def indicator(column: pd.Series) -> np.ndarray:
    return pd.get_dummies(column).to_numpy(dtype=float)


def test_without_random_effects_it_is_clm(rated):
    y = rated["rating"].to_numpy() - 1
    fit = fit_cumulative(indicator(rated["cond"])[:, 1:], y, {}, link="logit")

    assert [*fit.theta, *fit.beta] == pytest.approx(ORACLE["clm"], abs=1e-4)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(ORACLE["clm_se"], rel=1e-4)
    assert fit.log_likelihood == pytest.approx(ORACLE["clm_loglik"][0], abs=1e-6)


@pytest.mark.parametrize("link", ["logit", "probit"])
def test_with_crossed_effects_it_is_clmm(rated, link):
    y = rated["rating"].to_numpy() - 1
    effects = {
        name: RandomFactor(pd.factorize(rated[name])[0]) for name in ("participant", "scene")
    }
    fit = fit_cumulative(indicator(rated["cond"])[:, 1:], y, effects, link=link)

    assert fit.converged
    assert [*fit.theta, *fit.beta] == pytest.approx(ORACLE[f"clmm_{link}"], abs=2e-4)
    error = np.sqrt(np.diag(fit.covariance))[:6]
    assert error == pytest.approx(ORACLE[f"clmm_{link}_se"], rel=1e-3)
    assert list(fit.sd.values()) == pytest.approx(ORACLE[f"clmm_{link}_sd"], rel=1e-3)
    assert fit.log_likelihood == pytest.approx(ORACLE[f"clmm_{link}_loglik"][0], abs=1e-5)


def test_ratings_that_are_mirrored_mirror_the_model(rated):
    plain = rating_model(rated, ("cond",), reference="a")
    turned = rating_model(rated.assign(rating=6 - rated["rating"]), ("cond",), reference="a")

    for one, other in zip(plain.contrasts, turned.contrasts, strict=True):
        assert other.difference == pytest.approx(-one.difference, abs=1e-3)
        assert other.p == pytest.approx(one.p, rel=0.02)
        assert one.superiority == pytest.approx(1 - other.superiority, abs=1e-3)
    assert plain.thresholds == pytest.approx([-t for t in turned.thresholds[::-1]], abs=1e-3)


def test_names_in_order_are_as_good_as_numbers(rated):
    words = ["bad", "poor", "fair", "good", "best"]
    named = rated.assign(rating=[words[k - 1] for k in rated["rating"]])
    numbers = rating_model(rated, ("cond",))
    named_model = rating_model(named, ("cond",), categories=words)

    assert named_model.categories == tuple(words)
    assert named_model.contrasts == numbers.contrasts
    with pytest.raises(ValueError, match="must hold one of"):
        rating_model(named, ("cond",), categories=words[:4])
    with pytest.raises(ValueError, match="from the lowest on"):
        rating_model(named, ("cond",))


def test_shares_and_means_are_those_of_the_table(rated):
    model = rating_model(rated, ("cond",))
    own = rated.query("cond == 'b'")["rating"]

    assert model.conditions[1].shares == pytest.approx([np.mean(own == k) for k in range(1, 6)])
    assert model.conditions[1].mean_rating == pytest.approx(own.mean())
    assert model.conditions[0].place == 0.0


@pytest.mark.parametrize(("link", "law"), [("probit", stats.norm), ("logit", stats.logistic)])
@pytest.mark.parametrize("gap", [-2.0, 0.0, 0.3, 1.5])
def test_superiority_is_the_chance_that_one_draw_exceeds_another(link, law, gap):
    chance = integrate.quad(lambda x: law.pdf(x - gap) * law.cdf(x), -40, 40, points=[gap])[0]

    assert superiority(gap, link) == pytest.approx(chance, abs=1e-8)


def graded(rng: np.random.Generator, people: int = 12, bias: float = 0.0) -> pd.DataFrame:
    """Comparisons with ties of three methods at 0, 0.5 and 1.5."""
    place = {"a": 0.0, "b": 0.5, "c": 1.5}
    rows = []
    for who in range(people):
        taste = {name: rng.normal(0, 0.2) for name in place}
        for first in place:
            for second in place:
                for _ in range(4 if first != second else 0):
                    gap = place[first] + taste[first] - place[second] - taste[second]
                    latent = gap + bias + rng.standard_normal()
                    rating = int(latent > 0.4) - int(latent < -0.4)
                    rows.append((f"P{who}", first, second, rating))
    return pd.DataFrame(rows, columns=["participant", "first", "second", "rating"])


def test_pairs_with_ties_give_back_the_places():
    model = paired_ratings(graded(np.random.default_rng(3)), reference="a")
    places = {one.condition: one for one in model.conditions}

    for name, truth in (("b", 0.5), ("c", 1.5)):
        assert places[name].lower < truth < places[name].upper
        assert places[name].upper - places[name].lower < 1.0
    assert model.categories == ("-1", "0", "1")
    assert model.margins.means == (), "pairs tell differences alone"
    assert model.thresholds == pytest.approx((-0.4, 0.4), abs=0.12)


def test_a_bias_to_the_first_shifts_thresholds_and_not_places():
    model = paired_ratings(graded(np.random.default_rng(3), bias=0.5))

    assert model.thresholds == pytest.approx((-0.9, -0.1), abs=0.15)
    assert model.conditions[2].place == pytest.approx(1.5, abs=0.4)


@pytest.mark.full
def test_equal_conditions_are_called_different_as_rarely_as_said():
    runs, called = 100, 0
    rng = np.random.default_rng(6)
    for _ in range(runs):
        rows = pd.DataFrame(
            [(p, s, c) for p in range(10) for s in range(4) for c in "ab" for _ in range(2)],
            columns=["participant", "scene", "method"],
        )
        own = rng.normal(0, 0.4, (10, 2))[rows["participant"], (rows["method"] == "b").astype(int)]
        base = rng.normal(0, 0.5, 10)[rows["participant"]] + rng.normal(0, 0.2, 4)[rows["scene"]]
        latent = base + own + rng.standard_normal(len(rows))
        rows["rating"] = np.digitize(latent, [-1, -0.3, 0.3, 1])
        called += rating_model(rows, ("method",)).contrasts[0].p < 0.05

    assert called / runs < 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)


def test_conditions_that_share_no_rating_are_said_to_have_no_limits():
    rows = pd.DataFrame([(p, m) for p in range(6) for m in "ab" for _ in range(10)],
                        columns=["participant", "method"])  # fmt: skip
    rows["rating"] = np.where(rows["method"] == "a", 5, 1)

    model = rating_model(rows, ("method",))
    assert any("no proper maximum" in note for note in model.warnings)
    assert np.isnan([model.contrasts[0].difference, model.contrasts[0].p, *model.thresholds]).all()


def test_more_than_a_shift_is_noted():
    """One condition's ratings lie at the ends, the other's in the middle."""
    rng = np.random.default_rng(1)
    rows = pd.DataFrame([(p, m) for p in range(8) for m in "ab" for _ in range(20)],
                        columns=["participant", "method"])  # fmt: skip
    wide = np.where(rows["method"] == "a", 3.0, 0.7)
    rows["rating"] = np.digitize(wide * rng.standard_normal(len(rows)), [-1.5, -0.5, 0.5, 1.5])

    assert any("more than a shift" in note for note in rating_model(rows, ("method",)).warnings)


run = result_of("analysis", env={"COLUMNS": "200"})


@pytest.mark.slow
def test_the_command_tells_and_writes(rated, tmp_path):
    file, out = tmp_path / "votes.csv", tmp_path / "out"
    words = ["bad", "poor", "fair", "good", "best"]
    rated.assign(rating=[words[k - 1] for k in rated["rating"]]).to_csv(file, index=False)
    result = run("ratings", file, "--by", "cond", "--baseline", "a", "--out", out,
                 "--scale", ",".join(words))  # fmt: skip

    assert "405 ratings of 9 participants" in result.output
    assert "c was rated 0.94 SD above a (difference 0.94, 95% CI [" in result.output
    assert list(pd.read_csv(out / "tables" / "ratings.csv")["condition"]) == ["a", "b", "c"]
    assert (out / "figures" / "ratings-2-column.svg").is_file()


def test_the_command_takes_pairs(tmp_path):
    file, out = tmp_path / "pairs.csv", tmp_path / "out"
    graded(np.random.default_rng(4), people=4).to_csv(file, index=False)
    result = run("ratings", file, "--out", out)

    assert "96 ratings of 4 participants · pairs, graded" in result.output
    assert "share_0" not in pd.read_csv(out / "tables" / "ratings.csv")


@pytest.mark.parametrize(
    ("change", "arguments", "said"),
    [
        ({}, (), "must have the columns first, second (or name the column"),
        ({"rating": "good"}, ("--by", "cond"), "line 2: rating must be a number"),
        ({"rating": "goood"}, ("--by", "cond", "--scale", "bad,good"), "did you mean 'good'"),
        ({}, ("--by", "cond", "--scale", "bad"), "two different ratings"),
        ({}, ("--by", "cond", "--baseline", "d"), "--baseline d: must be one of"),
        ({"participant": "P1"}, ("--by", "cond"), "two participants"),
        ({"first": "a", "second": "a"}, (), "line 2: first and second must differ"),
        ({}, ("--by", "cond", "--link", "logt"), "did you mean 'logit'"),
    ],
)
def test_mistakes_get_one_message(rated, tmp_path, change, arguments, said):
    file = tmp_path / "votes.csv"
    rated.assign(**change).to_csv(file, index=False)
    result = run("ratings", file, *arguments, status=2)

    assert said in " ".join(result.output.split())


@pytest.mark.parametrize("kind", ["ratings", "pairs"])
def test_a_condition_that_differs_by_scene_is_judged_by_scenes(rng, kind):
    """b is liked in three scenes of four: so are all answers of people, but no further scene's."""
    rows = pd.DataFrame(
        [(p, s, c) for p in range(12) for s in range(4) for c in "ab" for _ in range(3)],
        columns=["participant", "scene", "cond"],
    )
    liked = np.array([2.0, 1.2, 0.4, -0.9])[rows["scene"]] * (rows["cond"] == "b")
    sign = 1
    if kind == "pairs":
        sign = np.where(rows["cond"] == "b", 1, -1)
        liked = np.array([2.0, 1.2, 0.4, -0.9])[rows["scene"]]
        other = rows["cond"].map({"a": "b", "b": "a"})
        rows = rows.assign(first=rows["cond"], second=other)
    latent = sign * liked + rng.standard_normal(len(rows))
    rows["rating"] = np.digitize(latent, [-1.0, -0.3, 0.3, 1.0]) - 2

    def fitted(table):
        if kind == "pairs":
            return paired_ratings(table).contrasts[0], paired_ratings(table).sd
        model = rating_model(table, ("cond",))
        return model.contrasts[0], model.sd

    (one, sd), (without, _) = fitted(rows), fitted(rows.drop(columns="scene"))

    assert sd["scene x condition"] > 0.3
    assert without.df == pytest.approx(11)
    assert without.p < 0.02
    assert one.df < 5
    assert one.p > 0.1


def test_one_rating_of_each_condition_by_each_person_stretches_no_distance():
    """Ten people, one scene: departures of a person in a condition cannot be told from chance."""
    shown = {"blur": "3233133221", "none": "3123231123", "ours": "4325543213"}
    rows = [(f"P{k}", name, int(said)) for name in shown for k, said in enumerate(shown[name])]
    model = rating_model(pd.DataFrame(rows, columns=["participant", "by", "rating"]), ["by"])

    assert set(model.sd) == {"participant"}
    assert max(abs(one.difference) for one in model.contrasts) < 3.0
    assert any("one rating of a condition" in note for note in model.warnings)
