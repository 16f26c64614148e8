"""Reports print no more than there is: no adjustment of one comparison, no degrees of
freedom without a statistic, no limit beyond what can be, no length below 0.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fixed_studies import TABLES

from analysis.models.order_and_side import order_bias
from analysis.models.right_answers import rate_contrasts
from analysis.parts.learning import StepLearning
from analysis.parts.levels import PlacedThreshold, threshold_columns
from analysis.parts.shared import apa_p
from analysis.report.content import ReportContent, content_of
from analysis.report.report_source import from_question
from analysis.report.wording import t_number, t_text
from analysis.tables.table import Table
from analysis.tasks import analysis_of
from protocols.blocks import Box, TableBlock

CHOICES = ("preferences", "choice_models", "scale")


def content(name: str, folder: Path, rows: pd.DataFrame, *only: str, **said: Any) -> ReportContent:
    kind, options, _ = TABLES[name]
    rows.to_csv(folder / "rows.csv", index=False)
    analysis = analysis_of(kind)
    table = Table(folder / "rows.csv")
    return content_of(from_question(analysis, table, analysis.options(**options | said), only=only))


def ratings() -> pd.DataFrame:
    return TABLES["ratings"][2]()


@pytest.mark.parametrize(
    ("name", "where", "only", "options"),
    [
        ("ratings", "method != 'fill'", ("ratings",), {}),
        ("preference-plain", "first != 'plain' and second != 'plain'", CHOICES, {}),
        ("two-answers", "level > 0", ("rates", "sensitivity", "comparisons"), {}),
        ("detection-plain", "repeat > 0", ("rates", "sensitivity", "comparisons"), {}),
    ],
)
def test_one_comparison_is_not_adjusted_for_others(name, where, only, options, tmp_path):
    rows = TABLES[name][2]().assign(repeat=1).query(where)
    found = content(name, tmp_path, rows, *only, **options)

    boxes = [str(part) for one in found.lead if isinstance(one, Box) for part in vars(one).values()]
    captions = [
        one.caption
        for section in found.sections
        for one in section.blocks
        if isinstance(one, TableBlock)
    ]
    said = " ".join([found.methods, *found.sentences, *boxes, *captions])
    assert found.sentences
    assert "djusted over" not in said
    assert "-adjusted" not in said
    assert " 1 comparisons" not in said
    assert "1 of 1 " not in " ".join(boxes)


def test_several_comparisons_are_said_to_be_adjusted(tmp_path):
    found = content("ratings", tmp_path, ratings(), "ratings")

    assert "Holm-adjusted over 2 comparisons" in found.methods
    assert "Holm-adjusted; likelihood ratio, cumulative" in " ".join(found.sentences)
    assert apa_p(0.02, 0.04) == "p = .040 (Holm-adjusted)"
    assert apa_p(0.02, 0.02, "mixed model") == "p = .020 (mixed model)"


def test_no_degrees_of_freedom_stand_without_their_statistic(tmp_path):
    rows = ratings()
    rows["rating"] = rows["rating"].clip(upper=3).where(rows["method"] != "ours", 4)
    found = content("ratings", tmp_path, rows, "ratings")

    (table,) = [
        one
        for section in found.sections
        for one in section.blocks
        if isinstance(one, TableBlock) and one.caption.startswith("Comparisons")
    ]
    titles = [one.title for one in table.columns]
    cells = {str(row[0]): str(row[titles.index("t(df)")]) for row in table.rows}
    assert cells["ours - blur"] == "none"
    assert cells["fill - blur"].endswith(")")
    assert "none" not in found.methods
    assert math.isnan(found.tables["comparisons.csv"].set_index("first").loc["ours", "df"])
    assert t_text(math.nan, 5.5) == "no t"
    assert t_number(math.nan, 5.5) == t_number(None, None) == "none"
    assert t_number(2.31, 5.0) == "2.31 (5)"


def test_differences_of_shares_have_no_limits_beyond_one():
    rows = pd.DataFrame(
        [
            (who, scene, method, int(right))
            for who, rights in (("A", (1, 0)), ("B", (1, 1)), ("C", (0, 0)))
            for method, right in zip(("ours", "blur"), rights, strict=True)
            for scene in "ab"
        ],
        columns=["participant", "scene", "method", "correct"],
    ).query("participant != 'C' or scene == 'a'")
    (gap,) = rate_contrasts(rows, ["method"])

    assert gap.difference + 4.3 * gap.standard_error > 1.0
    assert -1.0 <= gap.lower <= gap.upper <= 1.0


def test_the_width_of_a_falling_curve_is_a_length():
    falling = PlacedThreshold(True, 9.0, (8.0, 10.0), -5.08)
    *_, width = threshold_columns(lambda one: one, "Limits", logarithmic=False)
    assert width.text(falling) == "5.08"


def test_one_person_is_one_participant():
    rows = pd.DataFrame(
        [(f"P{p}", f"S{k}", int(p == 0 or (k + p) % 2 == 0)) for p in range(6) for k in range(40)],
        columns=["participant", "scene", "chose_first"],
    )
    found = order_bias(rows)
    assert any(note.startswith("1 participant answers by") for note in found.warnings)


def test_drawn_ratings_begin_at_one(tmp_path):
    found = content("ratings", tmp_path, ratings(), "ratings", "learning")
    mean = ratings()["rating"].mean()
    (drawn,) = (one for one in found.figures if one.name == "learning")
    line = drawn.draw(width_in=6.0).axes[0].lines[-1].get_ydata()
    assert float(np.mean(line)) == pytest.approx(mean, abs=0.3)
    assert "lowest: 1" in StepLearning.axis
