"""A table of results is declared once: the page's rows and the CSV file come from its columns."""

import math
from dataclasses import dataclass
from operator import attrgetter

from analysis.report.result_table import (
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    estimated,
    limits,
    p_value,
    within,
)
from analysis.report.values import frame_of


@dataclass(frozen=True)
class Part:
    value: float
    lower: float
    upper: float
    p: float


@dataclass(frozen=True)
class Row:
    name: str
    part: Part
    warnings: tuple[str, ...] = ()


ROWS = [Row("ours", Part(1.234, 1.0, 1.5, 0.0004)), Row("blur", Part(0.1, -math.inf, 2.0, 0.5))]
TABLE = ResultTable.of(
    "Differences",
    ROWS,
    attribute("Name", "name", str.upper, "l"),
    *within(attrgetter("part"), (estimated("Value", "value"), limits(), deciding())),
    p_value("Exact p", "part.p"),
    ResultColumn("", "", None, lambda row: {"notes": len(row.warnings)}),
)


def test_page_and_file_have_the_same_rows_in_the_order_of_the_columns():
    block, frame = TABLE.block(), TABLE.frame()

    assert [one.title for one in block.columns] == ["Name", "Value", "Limits", "Deciding p"]
    assert block.rows[0] == ("OURS", "1.23", "[1.00, 1.50]", "< .001")
    assert list(frame.columns) == ["name", "value", "lower", "upper", "p", "notes", "decides"]
    assert frame.iloc[0].tolist() == ["ours", 1.234, 1.0, 1.5, 0.0004, 0, "p"]


def test_a_file_of_all_fields_names_those_of_nested_results_by_both():
    every = TABLE.every_field("warnings")

    assert list(every.columns) == ["name", "part", "part_lower", "part_upper", "part_p", "decides"]
    assert every["part_lower"].isna().tolist() == [False, True]
    assert list(frame_of([], Row).columns) == ["name", "part", "warnings"]


def test_other_analyses_of_the_same_rows_stand_apart_with_their_reason():
    fold = TABLE.folded("Exact test", "Papers print it.")

    (table,) = fold.blocks
    assert [one.title for one in table.columns] == ["Name", "Exact p"]
    assert fold.why == "Papers print it."
