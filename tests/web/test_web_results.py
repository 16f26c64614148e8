"""Results as servers, mails and participants hand them over: what is whole is kept."""

import codecs
import io
import json
import os
import socket
import struct
import tracemalloc
import zipfile

import pytest
from pydantic import ValidationError

from protocols.browser.web_lines import LINE
from protocols.errors import StudyError
from study_app.web.histories import histories
from study_app.web.read_results import (
    BrowserResults,
    ContradictionError,
    read_web_results,
    whole_lines,
)


def said(participant: str, n: int, text: str = "täglich") -> str:
    """Return a line as the page sends it."""
    line = {
        "study": "s", "participant": participant, "run": 0, "n": n, "t_s": 1.5 + n,
        "at": "2026-01-31T12:00:00Z", "kind": "answer", "question": "why", "text": text,
    }  # fmt: skip
    return json.dumps(line, ensure_ascii=False, separators=(",", ":")) + "\n"


def read(*texts: bytes) -> BrowserResults:
    inbox = BrowserResults()
    for text in texts:
        inbox.read("home.txt", text)
    return inbox


def held(inbox: BrowserResults) -> dict[str, list[str]]:
    """Return what was typed, by participant."""
    return {
        who: [line.text for line in whole_lines(histories(lines.told)[0].history)]
        for (_, who), lines in inbox.found.items()
    }


ONE, TWO = said("A1", 0) + said("A1", 1, "zwei"), said("B2", 0) + said("B2", 1, "2")
BOTH = {"A1": ["täglich", "zwei"], "B2": ["täglich", "2"]}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", ""])
@pytest.mark.parametrize(
    ("code", "mark"),
    [
        ("utf-8", b""),
        ("utf-8", codecs.BOM_UTF8),
        ("utf-16-le", codecs.BOM_UTF16_LE),
        ("utf-16-be", codecs.BOM_UTF16_BE),
        ("utf-16-le", b""),
        ("utf-16-be", b""),
        ("cp1252", b""),
    ],
)
def test_a_text_is_read_however_it_is_encoded_and_joined(code, mark, end):
    texts = [mark + each.replace("\n", end).encode(code) for each in (ONE, TWO)]
    for inbox in (read(b"".join(texts)), read(*texts)):
        assert held(inbox) == BOTH
        assert not inbox.damages


def test_texts_of_several_encodings_are_joined():
    inbox = read(
        ONE.encode()
        + TWO.encode("utf-16")  # with its mark
        + said("C3", 0).encode()
        + codecs.BOM_UTF8
        + said("C3", 1, "ü").encode()
    )
    assert held(inbox) == BOTH | {"C3": ["täglich", "ü"]}
    assert inbox.notes == ["home.txt: read as UTF-16"]
    assert not inbox.damages


def test_a_line_that_is_no_utf_8_costs_no_other_its_letters():
    inbox = read(said("A1", 0).encode() + said("B2", 0).encode("cp1252"))
    assert held(inbox) == {"A1": ["täglich"], "B2": ["täglich"]}
    assert "Windows' Latin-1" in inbox.notes[0]


@pytest.mark.parametrize(
    ("text", "damages"),
    [
        (ONE[:-40] + TWO, 1),  # the end is lost
        (ONE[40:] + TWO, 1),  # the beginning
        (ONE[:-1] + TWO[40:], 1),  # behind a whole line, the end of another
        (ONE[:-1] + "\0" * 500 + TWO, 0),  # what a full disk leaves
        ('[1, {"a":' + ONE + "]}" + TWO, 2),
        ("[" * 100_000 + "\n" + ONE + TWO, 1),
    ],
)
def test_what_is_whole_is_kept_wherever_a_text_was_cut(text, damages):
    inbox = read(text.encode())
    found = {(who, n) for (_, who), lines in inbox.found.items() for n in lines.told}
    lost = {
        (who, n) for who in ("A1", "B2") for n in (0, 1) if json_of(who, n) not in text
    }  # the test's own count
    assert found == {(who, n) for who in ("A1", "B2") for n in (0, 1)} - lost
    assert inbox.damages == damages


def json_of(who: str, n: int) -> str:
    return (ONE if who == "A1" else TWO).splitlines()[n]


def test_lines_that_have_not_come_are_counted_and_not_listed():
    lines = read((ONE + said("A1", 10**9)).encode()).found["s", "A1"]
    tracemalloc.start()
    with pytest.raises(ContradictionError) as refused:
        whole_lines(histories(lines.told)[0].history)
    assert "999,999,998 of 1,000,000,001 lines have not come (numbers 2 to 999999999)" in str(
        refused.value
    )
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    "harm",
    [
        {"kind": "x" * 10**6},
        {"kind": "attempt", "flips_us": ["a"] * 10**5},
        {"k" * 10**6: 1},
        {f"k{n}": 1 for n in range(10**5)},
        {"text": "\u001b[2J\u202e\n" * 1000 + "a" * 20_000},
        {"n": -1},
        {"n": 1e400},
        {"text": "\ud800"},
        {"study": "\u001b]0;a\u0007"},
    ],
    ids=range(9),
)
def test_what_is_no_line_is_named_in_one_short_line(harm):
    inbox = read((json.dumps(json.loads(said("A1", 0)) | harm) + "\n" + TWO).encode())
    assert held(inbox) == {"B2": BOTH["B2"]}
    (told,) = inbox.damaged
    assert told.startswith("home.txt: line 1: ")
    assert told.isprintable()
    assert len(told) < 300


def test_damaged_lines_without_end_are_counted():
    inbox = read(b'{"study":' * 10_000)
    assert (inbox.damages, len(inbox.damaged)) == (10_000, 20)


# --- archives and folders ------------------------------------------------------------------------


def archive(*texts: bytes, packing: int = zipfile.ZIP_DEFLATED, name: str = "data.txt") -> bytes:
    """Return an archive as JATOS writes it, each text the result of another participant."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", packing) as whole:
        for number, text in enumerate(texts):
            whole.writestr(f"study_result_{number}/comp-result_{number}/{name}", text)
    return made.getvalue()


def spoilt(data: bytes, text: bytes) -> bytes:
    """Return an archive with other bytes in the middle of one entry's packed text."""
    place = data.index(b"comp-result_0/data.txt") + len("comp-result_0/data.txt") + 20
    return data[:place] + text + data[place + len(text) :]


def encrypted(data: bytes) -> bytes:
    """Return an archive whose first entry says that it is encrypted."""
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = data.index(mark) + place
        data = data[:at] + struct.pack("<H", 1) + data[at + 2 :]
    return data


A, B = ONE.encode(), TWO.encode()
LONG = A + b" " * 5000 + os.urandom(2000)


@pytest.mark.parametrize(
    ("data", "found", "told"),
    [
        (spoilt(archive(LONG, B), b"\xff" * 60), {"B2"}, "must be a whole text"),
        (encrypted(archive(A, B)), {"B2"}, "must be deflated, and not encrypted"),
        (archive(A, B, packing=zipfile.ZIP_BZIP2), set(), "unpack the archive, and name"),
        (spoilt(archive(LONG, packing=zipfile.ZIP_BZIP2), b"\xff" * 60), set(), "must be deflated"),
        (spoilt(archive(LONG, packing=zipfile.ZIP_LZMA), b"\xff" * 60), set(), "must be deflated"),
        (archive(archive(A), name="more.ZIP"), set(), "it is an archive"),
        (archive(A, B)[:-30], set(), "must be an archive that can be read"),
        (archive(A, b" " * 3_000_000 + B, B), {"A1", "B2"}, "must unpack to at most 1,000,000"),
    ],
    ids=["deflate", "encrypted", "bzip2", "damaged-bzip2", "damaged-lzma", "nested", "cut", "bomb"],
)  # fmt: skip
def test_a_part_of_an_archive_that_cannot_be_read_costs_no_other(
    monkeypatch, tmp_path, data, found, told
):
    monkeypatch.setenv("METAMERLAB_LIMITS", "table=1000000")
    (tmp_path / "results.zip").write_bytes(data)
    if not found:
        with pytest.raises(StudyError, match=told):
            read_web_results([tmp_path / "results.zip"])
    (tmp_path / "more.txt").write_bytes(said("C3", 0).encode())
    inbox = read_web_results([tmp_path])  # a folder
    assert {who for _, who in inbox.found} == {"C3", *found}
    assert told in inbox.unread[0]
    assert inbox.unread[0].startswith(str(tmp_path / "results.zip"))


@pytest.mark.parametrize("packed", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2])
def test_an_entry_that_unpacks_to_more_than_it_says_is_unpacked_no_further(tmp_path, packed):
    data = archive(b" " * (1 << 25) + A, packing=packed)
    assert len(data) < 1 << 20
    size = struct.pack("<I", (1 << 25) + len(A))
    (tmp_path / "results.zip").write_bytes(data.replace(size, struct.pack("<I", 1000)))
    tracemalloc.start()
    with pytest.raises(StudyError, match="must be"):
        read_web_results([tmp_path / "results.zip"])
    assert tracemalloc.get_traced_memory()[1] < 1 << 24
    tracemalloc.stop()


def test_what_is_no_file_in_a_folder_is_named_and_costs_no_other(tmp_path):
    (tmp_path / "data.txt").write_bytes(A)
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "data.txt").write_bytes(B)
    (tmp_path / "link").symlink_to(tmp_path / "more")
    (tmp_path / "circle").symlink_to("circle")
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as opened:
        opened.bind(str(tmp_path / "socket"))
        inbox = read_web_results([tmp_path, tmp_path / "nowhere.txt"])
    assert held(inbox) == BOTH
    assert [line.split(":")[0].rpartition("/")[2] for line in inbox.unread] == [
        "circle", "link", "pipe", "socket", "nowhere.txt",
    ]  # fmt: skip


def test_one_entry_that_floods_costs_no_other_of_its_archive(tmp_path, monkeypatch):
    monkeypatch.setenv("METAMERLAB_LIMITS", "events=1000")
    (tmp_path / "a.zip").write_bytes(archive(b"\n" * 5000, *[b"\n" * 900] * 30, A, B))
    inbox = read_web_results([tmp_path])
    assert held(inbox) == BOTH
    assert "must have at most 1,000 lines" in inbox.unread[0]
    assert inbox.unread[-1].endswith("more parts were not read")
    assert len(inbox.unread) == 21


@pytest.mark.parametrize("mark", ['{"study":', '{"'])
@pytest.mark.parametrize("code", ["utf-16", "utf-8-sig"])
def test_beginnings_are_counted_however_they_are_encoded(code, mark, monkeypatch):
    monkeypatch.setenv("METAMERLAB_LIMITS", "events=1000")
    with pytest.raises(StudyError, match="at most 1,000 lines"):
        read(mark.encode(code) * 2000)


@pytest.mark.parametrize("field", ["flips_us", "presses"])
def test_of_a_list_full_of_faults_the_first_is_told(field):
    """Each fault took half a kilobyte: a line of 16 MB took seven gigabytes."""
    one = json.loads(said("A1", 0)) | {"kind": "attempt", field: [{}] * 5000}
    with pytest.raises(ValidationError) as refused:
        LINE.validate_json(json.dumps(one))
    assert refused.value.error_count() < 50


def test_metadata_is_believed_of_jatos_alone(tmp_path):
    """A participant may send files of any name."""
    told = {"data": [{"studyResults": [{"id": 1, "workerId": 7, "componentResults": []}]}]}
    for number, name in enumerate(
        ["metadata.json", "study_result_2/comp-result_2/files/metadata.json"]
    ):
        path = tmp_path / f"{number}.zip"
        with zipfile.ZipFile(path, "w") as made:
            made.writestr("study_result_1/comp-result_1/data.txt", A)
            made.writestr(name, json.dumps(told))
        inbox = read_web_results([path])
        marks = inbox.marks(inbox.found["s", "A1"])
        assert (("worker of JATOS", "7") in marks) == (number == 0)


def test_lines_are_kept_small():
    """A hundred megabytes of results must not take a gigabyte."""
    one = json.loads(said("A1", 0)) | {
        "kind": "attempt", "trial": "main-0001", "attempt": 1, "position": 0, "outcome": "void",
        "void_reason": "paused", "answer": None, "flips_us": [16667] * 2000, "presses": [],
        "disturbed": None,
    }  # fmt: skip
    del one["question"], one["text"]
    inbox = BrowserResults()
    text = "".join(json.dumps(one | {"n": n}) + "\n" for n in range(30)).encode()
    tracemalloc.start()
    inbox.read("a", text)
    assert tracemalloc.get_traced_memory()[0] < len(text) / 4
    tracemalloc.stop()
    lines = inbox.found["s", "A1"]
    assert len(list(whole_lines(histories(lines.told)[0].history))) == 30
