"""Columns of conditions and columns of tables never share a name."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis.columns import attempt_columns, decision_columns
from protocols.columns import RESERVED
from protocols.errors import StudyError
from protocols.load import load_protocol, protocol_of, read_toml

DEMO = load_protocol(Path("demo"))


def test_every_column_that_is_no_condition_is_reserved():
    conditions = {"scene", "size"}
    for columns in (attempt_columns(DEMO), decision_columns(DEMO)):
        assert {column.name for column in columns} - conditions <= RESERVED


@pytest.mark.parametrize("name", ["order", "answer", "block"])
def test_a_condition_called_as_a_column_of_tables_is_refused(tmp_path, repository, name):
    text = (repository / "tests" / "test_worked_example.py").read_text(encoding="utf-8")
    study = text.split('STUDY = """')[1].split('"""')[0]
    study = study.replace('kind = "side-by-side"', 'kind = "two-alternative"')
    path = tmp_path / "study.toml"
    path.write_text(study.replace("method = ", f"{name} = 1, method = "), encoding="utf-8")

    with pytest.raises(StudyError, match=f"must not be called {name!r}"):
        protocol_of(read_toml(path), path)
