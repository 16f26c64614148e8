"""Numbers and sentences of fixed studies stay what they were while their code moves.

`RENAMED` says what a stored number is called today.
"""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from fixed_studies import COMMANDS, SESSIONS, STORED, TABLES, answer_of, leaves, report_of, told
from undrawn_reports import undrawn

from analysis.models.curves.psychometric_posterior import WIDTH_OF_LEVELS

RENAMED = (
    (r"results\.reaction\.(.*)", r"results.times.summary.\1"),
    (r"results\.times\.(.*)", r"results.times.model.\1"),
    (r"results\.learning\.\d+\.1\.outcome", ""),  # was the name of a column
    (r"results\.learning\.(\d+)\.0", r"results.learning.trends.\1.outcome"),
    (r"results\.learning\.(\d+)\.1\.(.*)", r"results.learning.trends.\1.\2"),
    (r"results\.(model|levels)\.(.*)", r"results.ratings.\1.\2"),
    (r"results\.((?:primary|table)\..*)", r"results.preferences.\1"),
    (r"results\.((?:participant|scene)_shares\..* / .* / .*)", r"results.preferences.\1"),
    (r"results\.models\.(\d+)\.0", r"results.choice_models.pairs.\1.method"),
    (r"results\.models\.(\d+)\.1", r"results.choice_models.pairs.\1.against"),
    (r"results\.models\.(\d+)\.2", r"results.choice_models.pairs.\1.size"),
    (r"results\.models\.(\d+)\.3\.(.*)", r"results.choice_models.pairs.\1.fit.\2"),
    (r"results\.paired\.(\d+)\.0", r"results.choice_models.together.\1.size"),
    (r"results\.paired\.(\d+)\.1\.(.*)", r"results.choice_models.together.\1.model.\2"),
    (r"results\.scales\.(.*)", r"results.scale.sizes.\1"),
    (r"results\.((?:order|side)\..*)", r"results.bias.\1"),
    (r"results\.(rates)\.(\d.*)", r"results.\1.conditions.\2"),
    (r"results\.warnings\.\d+", ""),  # are among those of the report
    (r"results\.answered\.(.*)", r"results.sensitivity.answered.\1"),
    (r"results\.(answers|confusion)\.(.*)", r"results.rates.\1.\2"),
    (r"results\.comparisons\.(.*)", r"results.comparisons.differences.\1"),
    (r"results\.typical\.(.*)", r"results.typical.fits.\1"),
    (r"results\.(counts|curves)\.(.*)", r"results.curves.\1.\2"),
    (r"results\.critical\.(.*)", r"results.critical.fits.\1"),
    (r"results\.critical_contrasts\.(.*)", r"results.critical.contrasts.\1"),
    (r"results\.(participant|scene)_shares\.([^/]*)", r"results.people.\1s.\2"),
    (r"result\.((?:summary|model)\..*)", r"results.times.\1"),
    (r"result\.(sensitivity\..*)", r"results.\1"),
    (r"result\.(people|within|between)(.*)", r"results.psychometric.\1\2"),
    (r"result\.population\.(.*)", r"results.thresholds.\1"),
    (r"result\.(?!sensitivity|people|population|within|between)(.*)", r"results.ratings.model.\1"),
)
"""Stored name (a pattern of the whole path) and today's, in the order in which they are tried."""
REWORDED = (
    ("participants show no p below", "participants can show no p below"),
    ("last trial right changed", "last trial right answers changed"),
    ("last trial log_rt changed", "last trial logarithm of the reaction time changed"),
    (r"\((\d+)\.0\)", r"(\1)"),  # degrees of freedom that are whole, t(5.0)
    (r"= -0\.00\b", "= 0.00"),
    (r" \| (\d+)\.0 \| (?!\[)", r" | \1 | "),  # not of values, which limits follow
    (f"(; )?{WIDTH_OF_LEVELS}", ""),  # is said of fewer curves
    (
        r"rated -(\S+) SD above (\S+), (95% CI \[.*?\])",
        r"rated \1 SD below \2 (difference -\1, \3)",
    ),
    (
        r"rated (\d\S+) SD above (\S+), (95% CI \[.*?\])",
        r"rated \1 SD above \2 (difference \1, \3)",
    ),
    (
        r"had -(\S+) JOD more than the other( .*?)?,",
        r"had \1 JOD less than the other\2: difference -\1,",
    ),
    (
        r"had (\d\S+) JOD more than the other( .*?)?,",
        r"had \1 JOD more than the other\2: difference \1,",
    ),
)
"""Patterns of what was said otherwise in sentences and notes, and of what is said today."""
_COLUMNS = [*enumerate((0, 1, 2, 3, 4, 5, 8, 9, 11, 12, 15, 16, 18, 22, 35))]
ALIKE = ((r"comparisons\.(.*)", r"sensitivity_differences.\1"),)
RIGHT = {name for name, (kind, *_) in TABLES.items() if kind not in ("preference", "ratings")}
RENAMED_FILES = {
    "adaptive": ((r"comparisons\.(.*)", r"threshold_differences.\1"),),
    "command-detection": (
        *((rf"conditions\.(\d)\.{old}", rf"sensitivity.\1.{new}") for old, new in _COLUMNS),
        *ALIKE,
    ),
    "command-psychometric": ((r"comparisons\.(.*)", r"threshold_differences.\1"),),
}
"""Tables that had other names."""
QUICK = {"two-answers", "ratings", "command-reaction"}


def cases() -> list[Any]:
    """Return all studies; the commoner ones are quick."""
    return [
        name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
        for name in (*TABLES, *SESSIONS, *COMMANDS)
    ]


def today(path: str, study: str) -> str:
    """Return what a stored number of a study is called today."""
    files = RENAMED_FILES.get(study, ALIKE if study in RIGHT else ())
    for pattern, name in (*files, *RENAMED):
        if re.fullmatch(pattern, path):
            return re.sub(pattern, name, path)
    return path


def reworded(text: str) -> str:
    """Return how a stored sentence reads today."""
    for before, after in REWORDED:
        text = re.sub(before, after, text)
    return text


def unsaid(text: str) -> str:
    """Return a sentence or row of today without t, which some gave no value of."""
    return re.sub(r"(t\([\d.]+\)) = -?[\d.]+", r"\1", re.sub(r"\| -?[\d.]+ \(", "| (", text))


def same(stored: Any, found: Any) -> bool:
    """Return whether a value is the stored one, to the digits that machines share."""
    if isinstance(stored, float) and isinstance(found, float | int):
        return found == pytest.approx(stored, rel=2e-4, abs=1e-6)
    return bool(found in (stored, reworded(stored)) if isinstance(stored, str) else found == stored)


@pytest.mark.parametrize("name", cases())
def test_every_number_sentence_and_row_is_what_it_was(name, tmp_path, write_journals):
    stored = json.loads((STORED / f"{name}.json").read_text(encoding="utf-8"))
    with undrawn():
        if name in COMMANDS:
            found = answer_of(name, tmp_path)
        else:
            found = told(report_of(name, tmp_path, write_journals))

    before, after = (
        [
            *one["numbers"].pop("warnings", ()),
            *one["numbers"].pop("notes", ()),
            *one.get("notes", ()),
        ]
        for one in (stored, found)
    )
    assert [note for note in before if reworded(note) not in {*after, ""}] == []
    for part in ("numbers", "tables"):
        before, after = dict(leaves(stored[part])), dict(leaves(found[part]))
        # What could not be had may have come, or go; what was there stays.
        moved = {today(path, name): value for path, value in before.items() if value is not None}
        moved = {path: value for path, value in moved.items() if reworded(str(value))}
        moved.pop("", None)
        assert moved.keys() <= after.keys(), sorted(moved.keys() - after.keys())[:10]
        other = {
            path: (value, after[path])
            for path, value in moved.items()
            if not same(value, after[path])
        }
        assert not other
    for part in ("sentences", "rows"):
        known = {*found[part], *map(unsaid, found[part])}
        lost = [one for one in stored[part] if reworded(one) not in known]
        assert not lost


def test_a_number_that_moves_is_told_from_one_that_changes():
    assert same(0.123456, 0.12346)
    assert not same(0.123456, 0.1236)
    assert not same(3, 4)
    assert not same("a", "b")
    assert {Path(one).stem for one in STORED.glob("*.json")} == {*TABLES, *SESSIONS, *COMMANDS}
