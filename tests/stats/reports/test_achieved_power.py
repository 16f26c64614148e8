"""The primary comparison in JOD, and its power with those who came or are planned."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from analysis.models.clustered import two_way
from analysis.models.preference import preference
from analysis.parts import computed
from analysis.parts.achieved_power import AchievedPowerPart, _power
from analysis.plans.preference_plan import preference_plan_of_table
from analysis.plans.table_sections import PreferenceTableSection


def decisions(rng, *, people=9, scenes=5, repeats=3, shares=None):
    rows = []
    for who in range(people):
        share = 0.7 if shares is None else shares[who]
        for scene in range(scenes):
            for turn in range(repeats):
                both = ("ours", "blur") if turn % 2 else ("blur", "ours")
                rows.append((f"P{who}", f"s{scene}", "all", *both,
                             "ours" if rng.random() < share else "blur"))  # fmt: skip
    return pd.DataFrame(rows, columns=["participant", "scene", "size", "first", "second", "chosen"])


def found_of(table, **options):
    plan = preference_plan_of_table(
        table, "made up", PreferenceTableSection(primary="ours/blur", **options)
    )
    found, notes = computed([AchievedPowerPart()], table, plan)
    assert notes == ()
    return found.get("achieved_power"), plan


def test_jod_are_normal_quantiles_and_power_is_that_of_t(rng):
    table = decisions(rng, people=12)
    found, plan = found_of(table, smallest_effect_rate=0.2)
    whole = preference(table, "ours", "blur").estimate
    quantiles = stats.norm.ppf([whole.share, whole.lower, whole.upper]) / stats.norm.ppf(0.75)

    assert (found.jod, found.jod_lower, found.jod_upper) == pytest.approx(tuple(quantiles))
    # One scene, twenty people whose shares vary by .15: the t test of one sample.
    own = rng.normal(0.5, 0.15, 20)
    chosen, shown = (1e4 * own[:, None]), np.full((20, 1), 1e4)
    power = _power(two_way(chosen, shown), plan, 1.0)
    ratio = 0.2 / (own.std(ddof=1) / np.sqrt(20))
    reach = stats.t.isf(0.025, 19)
    assert power == pytest.approx(
        stats.nct.sf(reach, 19, ratio) + stats.nct.cdf(-reach, 19, ratio), rel=1e-6
    )
    assert _power(two_way(chosen, shown), plan, 2.0) > power


def test_two_people_or_no_primary_comparison_have_no_power(rng):
    table = decisions(rng, people=2)
    assert found_of(table)[0] is None
    plan = preference_plan_of_table(table, "made up", PreferenceTableSection())
    assert computed([AchievedPowerPart()], decisions(rng), plan)[0] == {}
