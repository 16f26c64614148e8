"""Bradley-Terry strengths: R's numbers, and limits as wide as votes are independent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fixed_studies import TABLES

from analysis.parts import computed
from analysis.parts.strengths import StrengthsPart
from analysis.plans.preference_plan import from_decisions

R = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_strengths.json").read_text())


def strengths_of(rows: pd.DataFrame):
    plan = from_decisions(rows, "x")
    found, notes = computed((StrengthsPart(),), rows, plan)
    return found.get("strengths"), notes


def decisions(rows: pd.DataFrame) -> pd.DataFrame:
    """Winners and losers of a table that says whether the first was chosen."""
    first = rows["chose_first"] == 1
    return rows.assign(
        chosen=rows["first"].where(first, rows["second"]),
        rejected=rows["second"].where(first, rows["first"]),
    )


def test_strengths_and_odds_are_those_of_logistic_regression_in_r():
    found, _ = strengths_of(decisions(TABLES["preference"][2]()))

    for size in ("large", "small"):
        fit, limits = found.sizes[size]
        assert fit.conditions == ("blur", "ours", "plain")
        np.testing.assert_allclose(fit.scores, R[size], atol=1e-6)
        assert fit.log_likelihood == pytest.approx(R[f"{size}_loglik"][0], abs=1e-6)
        odds = [one for one in found.odds if one.size == size]
        np.testing.assert_allclose([one.odds for one in odds], R[f"{size}_odds"], rtol=1e-6)
        assert all(one.lower < one.odds < one.upper for one in odds)
        # Limits leave out even odds exactly where p is small.
        assert all((one.lower <= 1 <= one.upper) == (one.p >= 0.05) for one in odds)
        assert np.all((limits.lower < fit.scores) & (fit.scores < limits.upper))


def test_where_people_are_alike_the_errors_are_those_of_independent_votes():
    """Thirty people compare each pair twice; votes are dealt out to them by chance."""
    rows = []
    for (first, second), won in zip(
        (("blur", "ours"), ("blur", "plain"), ("ours", "plain")), (36, 44, 39), strict=True
    ):
        votes = np.random.default_rng(len(rows)).permutation(np.arange(60) < won)
        rows += [(f"P{k // 2:02d}", first, second, int(vote)) for k, vote in enumerate(votes)]
    table = pd.DataFrame(rows, columns=["participant", "first", "second", "chose_first"])
    found, _ = strengths_of(decisions(table.assign(scene="a", size="all")))

    fit, limits = found.sizes["all"]
    np.testing.assert_allclose(fit.scores, R["independent"], atol=1e-6)
    np.testing.assert_allclose(limits.standard_error, R["independent_se"], rtol=0.2)


def test_two_methods_or_one_person_have_no_strengths_and_no_empty_section():
    rows = decisions(TABLES["preference"][2]())
    two = rows[~rows[["first", "second"]].eq("plain").any(axis=1)]
    assert strengths_of(two) == (None, ())
    assert strengths_of(rows[rows["participant"] == "P0"]) == (None, ())


def test_methods_that_nothing_links_have_no_strengths_and_the_reason_is_said():
    rows = decisions(TABLES["preference"][2]())
    pair = rows[~rows[["first", "second"]].eq("plain").any(axis=1)]
    named = {"blur": "x", "ours": "y"}
    apart = pair.replace(dict.fromkeys(("first", "second", "chosen", "rejected"), named))
    found, notes = strengths_of(pd.concat([pair, apart], ignore_index=True))

    assert found is None
    assert "2 separate groups" in notes[0]
