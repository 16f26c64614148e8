"""Text from outside is text in every file that we write, and codes are matched in bounded time."""

import json

import pandas as pd
import pytest
from pydantic import ValidationError

from analysis.tables.table import Table as AnyTable
from analysis.tables.table_files import write_table
from protocols.blocks import Section, TableBlock
from protocols.outside import json_bytes, markdown, page_bytes, visible
from protocols.study_file.preregister import to_markdown
from protocols.study_file.session_schema import Privacy

HOSTILE = "a\x1b[31m\udcff\x00\ufffe"


def test_a_page_holds_nothing_that_xml_cannot():
    assert page_bytes(HOSTILE + "\n\tb") == rb"a\x1b[31m\udcff\x00\ufffe" + b"\n\tb"


def test_marks_of_direction_stay_on_pages_and_are_spelt_out_on_terminals():
    assert page_bytes("\u200f").decode() == "\u200f"
    assert visible("\u200f\u202e") == r"\u200f\u202e"


def test_json_with_half_characters_reads_back():
    text = json.dumps({"name": HOSTILE}, ensure_ascii=False)
    assert json.loads(json_bytes(text)) == {"name": HOSTILE}


@pytest.mark.parametrize(
    ("text", "there"),
    [
        ("<img src=x>", r"\<img src=x>"),
        ("![x](http://y)", r"![x\](http://y)"),
        ("[x]: http://y", r"[x\]: http://y"),
        ("a|b", r"a\|b"),
        ("p < 0.05, [0.4, 0.6]", "p < 0.05, [0.4, 0.6]"),
    ],
)
def test_markdown_shows_a_text_as_it_is(text, there):
    assert markdown(text) == there
    section = Section.of("t", text, [text], TableBlock.of("", [(text, "")], [(text,)]))
    assert to_markdown("t", [section]).count(there) == 4


def test_a_table_with_control_characters_reads_back(tmp_path):
    table = pd.DataFrame({"text": ["a\x1b[2Jb", "\x07", "\udcff", "=1"]})
    write_table(table, tmp_path / "t.csv")
    read = AnyTable(tmp_path / "t.csv").rows["text"].tolist()
    assert read == [r"a\x1b[2Jb", r"\x07", r"\udcff", "=1"]


def test_a_pattern_that_python_would_never_finish_is_matched_at_once():
    assert not Privacy(code_pattern="(a+)+b").accepts("a" * 32)


@pytest.mark.parametrize("pattern", [r"(?=a)b", r"(a)\1", "(", "a)|(b", "(?:a{1,1000}){1,1000}"])
def test_a_pattern_that_has_no_bound_is_refused(pattern):
    with pytest.raises(ValidationError, match="must be a regular expression without look-around"):
        Privacy(code_pattern=pattern)


def test_a_code_is_matched_whole():
    assert [Privacy(code_pattern="a|b").accepts(code) for code in ("a", "b", "ab", "a\n")] == [
        True, True, False, False,
    ]  # fmt: skip
