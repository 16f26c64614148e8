"""A study of format 1 is rewritten as what it says in format 2, comments and order kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from protocols.errors import StudyError
from protocols.load import load_protocol, shipped
from protocols.upgrade import upgraded_text

OLD = Path(__file__).parent / "format1"
STUDIES = ("demo", "inpainting-2afc", "showcase")


def comments(text: str) -> list[str]:
    """The text behind every `#` that begins a comment in our files, in order."""
    return [
        line.split("#", 1)[1].strip()
        for line in text.splitlines()
        if line.lstrip().startswith("#") or "  #" in line
    ]


@pytest.fixture
def upgraded(tmp_path):
    """Upgrade a text; return the new text and the study it says."""

    def upgrade(text: str):
        path = tmp_path / "old.toml"
        path.write_text(text, encoding="utf-8")
        made = tmp_path / "new.toml"
        made.write_text(upgraded_text(path), encoding="utf-8")
        return made.read_text(encoding="utf-8"), load_protocol(made)

    return upgrade


@pytest.fixture
def demo() -> str:
    return (OLD / "demo.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", STUDIES)
def test_each_old_study_becomes_what_the_shipped_one_says(upgraded, name):
    old = OLD / f"{name}.toml"
    text, study = upgraded(old.read_text(encoding="utf-8"))

    assert study.format == 2
    now = load_protocol(shipped("studies")[name])
    # The paper's study has shown the printed method since.
    methods = tuple(m.model_copy(update={"method": None}) for m in now.warped.methods)
    stimuli = now.warped.model_copy(update={"methods": methods})
    assert study == now.model_copy(update={"stimuli": stimuli})
    assert study.model_copy(update={"format": 1}) == load_protocol(old)
    assert text.endswith("\n")
    assert not text.endswith("\n\n")


@pytest.mark.parametrize("name", STUDIES)
def test_every_comment_is_kept_in_its_order(upgraded, name):
    old = (OLD / f"{name}.toml").read_text(encoding="utf-8")

    assert comments(upgraded(old)[0]) == comments(old)


def test_a_comment_stays_with_the_key_that_moves(upgraded, demo):
    text, _ = upgraded(
        demo.replace("gap_s = 0.5", "# long enough to forget\ngap_s = 0.5").replace(
            "[design]", "# what is shown how often\n[design]"
        )
    )

    assert "# long enough to forget\ngap_s = 0.5\n" in text.split("[task]")[1].split("[design]")[0]
    assert "# what is shown how often" in text


def test_what_format_1_left_out_is_said_where_format_2_needs_it(upgraded, demo):
    """Answer keys that were left out were `left` and `right`; they are still."""
    bare = "\n".join(
        line for line in demo.splitlines() if not line.startswith(("left_keys", "right_keys"))
    )
    text, study = upgraded(bare)

    assert study.response.keys == (("left",), ("right",))
    assert "left_keys" not in text


def test_keys_across_several_lines_stay_whole(upgraded, demo):
    text, study = upgraded(
        demo.replace(
            'pairings = "all"',
            'pairings = [\n  ["metameric", "push-pull"],  # the one that matters\n'
            '  ["metameric", "reference"],\n]',
        )
    )

    assert study.task.pairings == (("metameric", "push-pull"), ("metameric", "reference"))
    assert "# the one that matters" in text


def test_a_study_of_format_2_is_refused(tmp_path):
    with pytest.raises(StudyError, match=r"format: must be 1 to be upgraded \(got 2\)$"):
        upgraded_text(shipped("studies")["demo"])
    path = tmp_path / "none.toml"
    path.write_text('name = "no study"\n')
    with pytest.raises(StudyError, match=r"format: must be 1 to be upgraded \(got None\)$"):
        upgraded_text(path)


def test_a_study_with_mistakes_is_told_them_and_not_rewritten(tmp_path, demo):
    path = tmp_path / "old.toml"
    path.write_text(demo.replace("window_deg = 1.5", "window_deg = -1.5"), encoding="utf-8")

    with pytest.raises(StudyError, match=r"gaze.window_deg: must be at least 0.001 degrees"):
        upgraded_text(path)


def test_a_file_that_cannot_be_rewritten_line_by_line_is_refused_with_the_cure(tmp_path, demo):
    """The trial as an inline table is the same study; its gap has no line to be moved."""
    head, rest = demo.split("[trial]\n", 1)
    body, tail = rest.split("\n\n", 1)
    pairs = ", ".join(
        line.split("  #")[0] for line in body.splitlines() if not line.startswith("#")
    )
    path = tmp_path / "old.toml"
    path.write_text(
        head.replace("[study]", f"trial = {{ {pairs} }}\n\n[study]", 1) + tail, encoding="utf-8"
    )
    plain = tmp_path / "plain.toml"
    plain.write_text(demo, encoding="utf-8")
    assert load_protocol(path) == load_protocol(plain)

    with pytest.raises(StudyError) as caught:
        upgraded_text(path)

    assert str(caught.value) == (
        f"{path}: cannot be rewritten line by line; give each section its own [header] and each"
        " key its own line, then upgrade again (a file of format 1 works as it is)"
    )
