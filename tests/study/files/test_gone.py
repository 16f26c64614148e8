"""Removed parts: one message to who begins anew, a note to who has recorded with them."""

import json
from pathlib import Path

import pytest

from analysis.tasks.note import options_from, read_note
from protocols import gone
from protocols.errors import StudyError
from protocols.load import load_protocol, read_toml, shipped


@pytest.fixture
def removed(monkeypatch, tmp_path):
    """Give a study with a key that was removed, as that of a version which had it."""
    told = {
        "analysis.oracle": "ask an oracle",
        **dict.fromkeys(("analysis divine", "study --oracle"), "ask an oracle"),
    }
    monkeypatch.setattr(gone, "INSTEAD", told)
    path = tmp_path / "old.toml"
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    path.write_text(text.replace("[analysis]\n", "[analysis]\noracle = 3\n"), encoding="utf-8")
    assert "oracle" in str(read_toml(path))
    return path


def test_a_new_study_with_a_removed_key_is_refused_with_the_cure(removed):
    with pytest.raises(StudyError) as caught:
        load_protocol(removed)

    message = f"{removed}: analysis.oracle: was removed: ask an oracle; revision 5076b993"
    assert str(caught.value).startswith(message)
    assert str(caught.value).endswith("Delete it")


def test_a_recorded_study_keeps_its_hash_and_says_what_is_ignored(removed):
    study, plain = load_protocol(removed, recorded=True), load_protocol(Path("demo"))

    (note,) = study.gone_notes
    assert note.startswith("analysis.oracle is ignored: it was removed: ask an oracle")
    assert study.sha256 != plain.sha256  # it had another when it was recorded
    assert study.with_secret("x").sha256 == study.sha256
    assert study.with_gone({}).sha256 == plain.sha256
    assert plain.gone_notes == []


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["analysis", "divine"], "analysis divine was removed"),
        (["analysis", "divine", "a.csv", "--help"], "analysis divine was removed"),
        (["analysis", "report", "divine"], None),
        (["divine"], None),
        (["study", "--oracle=3"], "study --oracle was removed"),
        (["study", "x", "--", "--oracle"], None),
    ],
)
@pytest.mark.usefixtures("removed")
def test_a_removed_command_is_named_with_its_cure(words, named):
    message = gone.gone_from_command(words)

    assert message is None if named is None else message.startswith(named)


def test_every_removed_part_says_what_to_do_instead():
    for words, instead in gone.INSTEAD.items():
        assert instead[0].islower(), words
        assert instead[-1] not in ".;", words


def test_a_key_told_of_a_table_before_it_was_removed_is_ignored_with_a_note(tmp_path):
    told = {"format": 2, "table": "t.csv", "analysis": {"kind": "preference", "bayes": True}}
    (tmp_path / "t.json").write_text(json.dumps(told), encoding="utf-8")
    notes: list[str] = []

    assert read_note(tmp_path / "t.csv", notes).kind == "preference"
    (note,) = notes
    assert note.startswith("t.json: analysis.bayes is ignored: it was removed: fit decisions.csv")
    with pytest.raises(StudyError, match=r"--set bayes: was removed: .* has it\. Leave it out"):
        options_from("preference", {"bayes": "true"})
