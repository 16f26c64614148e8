"""Mixed models in a report: t is called t, what stands in is named."""

import numpy as np
import pandas as pd
import pytest

from analysis.parts import computed
from analysis.parts.choice_models import ChoiceModels, ChoiceModelsPart
from analysis.parts.preferences import PreferencesPart
from analysis.plans.preference_plan import preference_plan_of_table
from analysis.plans.table_sections import PreferenceTableSection
from protocols.blocks import TableBlock


@pytest.fixture(scope="module")
def analysed(make_decisions) -> tuple[ChoiceModels, list[TableBlock]]:
    """Nine people; the reference always wins, and two methods divide people for good."""
    table = make_decisions(people=9, scenes=3, sizes=("small",))
    pair = (table["first"] != "reference") & (table["second"] != "reference")
    fans = table["participant"] < "P05"
    chosen = np.where(pair, np.where(fans, "metameric", "push-pull"), "reference")
    divided = table.assign(size="large", chosen=chosen)
    rows = pd.concat([table, divided], ignore_index=True)
    rows["rejected"] = np.where(rows["chosen"] == rows["first"], rows["second"], rows["first"])
    rows["chose_first"] = (rows["chosen"] == rows["first"]).astype(int)
    settings = preference_plan_of_table(rows, "odd", PreferenceTableSection())
    part = ChoiceModelsPart()
    found, _ = computed((PreferencesPart(), part), rows, settings)
    models = found[part.name]
    blocks = part.show(models, settings).blocks
    return models, [block for block in blocks if isinstance(block, TableBlock)]


def test_a_statistic_is_named_as_what_it_is(analysed):
    results, (single,) = analysed
    text = " ".join(str(row) for row in single.rows)

    stands_in = [one.fit for one in results.pairs if "clustered" in one.fit.method]
    assert stands_in, "people who are divided for good leave no mixed model"
    assert f"t({stands_in[0].coefficients[0].df:g}) = " in text
    assert "z = " in text


def test_a_row_of_firths_penalty_has_finite_profile_limits_and_says_what_it_takes(analysed):
    results, _ = analysed
    separated = [one.fit for one in results.pairs if "Firth" in one.fit.method]

    assert separated
    for fit in separated:
        assert any("takes trials as independent" in note for note in fit.warnings)
        row = fit["Intercept"]
        # The profile is lopsided where answers are separated; limits of z are not.
        assert abs(row.upper - row.estimate) != pytest.approx(abs(row.estimate - row.lower), 0.05)
