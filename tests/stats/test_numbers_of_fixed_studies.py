"""Numbers and sentences of fixed studies stay what they were while their code moves.

Where they are meant to change, `fixed_studies.py` writes them anew, and the commit says why.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from fixed_studies import COMMANDS, SESSIONS, STORED, TABLES, answer_of, leaves, report_of, told
from undrawn_reports import undrawn

QUICK = {"two-answers", "ratings", "command-reaction"}


def cases() -> list[Any]:
    """Return all studies; the commoner ones are quick."""
    return [
        name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
        for name in (*TABLES, *SESSIONS, *COMMANDS)
    ]


def same(stored: Any, found: Any) -> bool:
    """Return whether a value is the stored one, to the digits that machines share."""
    if isinstance(stored, float) and isinstance(found, float | int):
        return found == pytest.approx(stored, rel=2e-4, abs=1e-6)
    return bool(found == stored)


@pytest.mark.parametrize("name", cases())
def test_every_number_sentence_and_row_is_what_it_was(name, tmp_path, write_journals):
    stored = json.loads((STORED / f"{name}.json").read_text(encoding="utf-8"))
    with undrawn():
        if name in COMMANDS:
            found = answer_of(name, tmp_path)
        else:
            found = told(report_of(name, tmp_path, write_journals))

    for part in ("numbers", "tables"):
        before, after = dict(leaves(stored[part])), dict(leaves(found[part]))
        assert before.keys() <= after.keys(), sorted(before.keys() - after.keys())[:10]
        other = {
            path: (value, after[path])
            for path, value in before.items()
            if value is not None and not same(value, after[path])
        }
        assert not other
    for part in ("sentences", "rows", "notes"):
        assert [one for one in stored.get(part, ()) if one not in found[part]] == []


def test_a_number_that_moves_is_told_from_one_that_changes():
    assert same(0.123456, 0.12346)
    assert not same(0.123456, 0.1236)
    assert not same(3, 4)
    assert not same("a", "b")
    assert {Path(one).stem for one in STORED.glob("*.json")} == {*TABLES, *SESSIONS, *COMMANDS}
