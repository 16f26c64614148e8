"""Each rule of Psych-DS is found broken where it is, and only there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from psychds_rules import broken_rules

STEM = "study-demo_description-trials_data"


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A small valid data set."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / f"{STEM}.csv").write_text('row_id,answer\n1,"a, b"\n2,b\n')
    describe(tmp_path)
    return tmp_path


def describe(folder: Path, **values: object) -> None:
    content = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": "Demo",
        "description": "A demonstration",
        "variableMeasured": ["row_id", {"@type": "PropertyValue", "name": "answer"}],
    } | values
    content = {key: value for key, value in content.items() if value is not None}
    (folder / "dataset_description.json").write_text(json.dumps(content))


def rows(text: str):
    return lambda folder: (folder / "data" / f"{STEM}.csv").write_bytes(text.encode())


def renamed(name: str):
    return lambda folder: (folder / "data" / f"{STEM}.csv").rename(folder / "data" / name)


def sidecar(text: str):
    return lambda folder: (folder / "data" / f"{STEM}.json").write_text(text)


def described(**values: object):
    return lambda folder: describe(folder, **values)


def overall(data: bytes):
    return lambda folder: (folder / "dataset_description.json").write_bytes(data)


SPOILT = {
    "no description": (
        lambda folder: (folder / "dataset_description.json").unlink(),
        {"MISSING_DATASET_DESCRIPTION", "CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "no data folder": (
        lambda folder: (folder / "data").rename(folder / "tables"),
        {"MISSING_DATA_DIRECTORY"},
    ),
    "no data file": (
        lambda folder: (folder / "data" / f"{STEM}.csv").unlink(),
        {"MISSING_DATAFILE"},
    ),
    "another suffix": (renamed("study-demo_table.csv"), {"MISSING_DATAFILE"}),
    "a key with a digit": (
        renamed("study1-demo_data.csv"),
        {"FILENAME_KEYWORD_FORMATTING_ERROR", "MISSING_DATAFILE"},
    ),
    "a value with a dash": (
        renamed("study-de-mo_data.csv"),
        {"FILENAME_KEYWORD_FORMATTING_ERROR", "MISSING_DATAFILE"},
    ),
    "a key without value": (
        renamed("study_data.csv"),
        {"FILENAME_KEYWORD_FORMATTING_ERROR", "MISSING_DATAFILE"},
    ),
    "broken JSON": (
        overall(b"{"),
        {"INVALID_JSON_FORMATTING", "CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "JSON not in UTF-8": (
        overall('{"name": "Bücher"}'.encode("latin-1")),
        {"INVALID_JSON_ENCODING", "CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "JSON that is a list": (
        overall(b"[]"),
        {"INVALID_JSONLD_FORMATTING", "CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "no name": (described(name=None), {"JSON_KEY_REQUIRED"}),
    "no explanation": (described(description=None), {"JSON_KEY_REQUIRED"}),
    "no variables": (
        described(variableMeasured=None),
        {"JSON_KEY_REQUIRED", "CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "another namespace": (
        described(**{"@context": "https://example.org/"}),
        {"JSON_KEY_REQUIRED", "INCORRECT_DATASET_TYPE"},
    ),
    "no type": (described(**{"@type": None}), {"MISSING_DATASET_TYPE"}),
    "another type": (described(**{"@type": "Person"}), {"INCORRECT_DATASET_TYPE"}),
    "a column nobody explains": (
        described(variableMeasured=["row_id"]),
        {"CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "a variable of another type": (
        described(variableMeasured=["row_id", {"@type": "Person", "name": "answer"}]),
        {"CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "a sidecar that takes a variable away": (
        sidecar('{"variableMeasured": ["row_id"]}'),
        {"CSV_COLUMN_MISSING_FROM_METADATA"},
    ),
    "a broken sidecar": (sidecar("{"), {"INVALID_JSON_FORMATTING"}),
    "an empty table": (rows(""), {"EMPTY_FILE"}),
    "no header": (rows(",\n1,a\n"), {"CSV_HEADER_MISSING"}),
    "a header twice": (rows("answer,answer\n1,a\n"), {"CSV_HEADER_REPEATED"}),
    "a row too short": (rows("row_id,answer\n1\n"), {"CSV_HEADER_LENGTH_MISMATCH"}),
    "a comma without quotes": (rows("row_id,answer\n1,a, b\n"), {"CSV_HEADER_LENGTH_MISMATCH"}),
    "an open quote": (rows('row_id,answer\n1,"a\n'), {"CSV_FORMATTING_ERROR"}),
    "a row_id twice": (rows("row_id,answer\n1,a\n1,b\n"), {"ROWID_VALUES_NOT_UNIQUE"}),
}


def test_a_valid_dataset_breaks_no_rule(dataset):
    assert broken_rules(dataset) == []


@pytest.mark.parametrize("name", SPOILT)
def test_a_broken_rule_is_found_by_its_code(dataset, name):
    spoil, codes = SPOILT[name]
    spoil(dataset)

    assert {broken.code for broken in broken_rules(dataset)} == codes


def test_terms_may_be_written_out_with_their_namespace(dataset):
    (dataset / "dataset_description.json").write_text(
        json.dumps(
            {
                "@type": "https://schema.org/Dataset",
                "https://schema.org/name": "Demo",
                "https://schema.org/description": "A demonstration",
                "https://schema.org/variableMeasured": ["row_id", "answer"],
            }
        )
    )

    assert broken_rules(dataset) == []


def test_a_table_is_found_however_deep_and_may_explain_itself(dataset):
    deep = dataset / "data" / "a" / "b"
    deep.mkdir(parents=True)
    (deep / "study-demo_data.csv").write_text("other\n1\n")
    assert {broken.code for broken in broken_rules(dataset)} == {"CSV_COLUMN_MISSING_FROM_METADATA"}

    (dataset / "data" / "a" / "directory_metadata.json").write_text(
        '{"variableMeasured": ["other"]}'
    )
    assert broken_rules(dataset) == []


@pytest.mark.parametrize("public", [False, True])
def test_an_export_breaks_no_rule_and_explains_every_column(
    metamerlab, recorded_once, tmp_path, public
):
    out = tmp_path / "out"
    done = metamerlab(
        "analysis", "export", recorded_once.sessions, "--protocol", recorded_once.path,
        "--format", "psych-ds", "--out", out, *(["--public"] if public else []),
    )  # fmt: skip
    assert done.exit_code == 0, done.output

    assert broken_rules(out) == []
    tables = sorted(path.name.split("-")[-1] for path in out.glob("data/*.csv"))
    assert tables == [
        "answers_data.csv", "attempts_data.csv", "decisions_data.csv", "sittings_data.csv",
    ]  # fmt: skip
    explained = json.loads((out / "dataset_description.json").read_text())["variableMeasured"]
    units = {entry["name"]: entry.get("unitText") for entry in explained}
    assert units["rt_s"] == "s"
    assert all(entry["description"] for entry in explained)
