"""A public export lets nothing through that tells who took part, where, and when."""

import gzip
import json
import re
from pathlib import Path

import pandas as pd
import pytest

from analysis.export.public import scrub, system
from protocols.disk.hashing import sha256_bytes, sha256_json
from protocols.journal import EVENT
from protocols.load import load_display

# A word of each kind, each to be found again by itself.
SECRET = (
    "Anna-Geheim C:\\Users\\anna\\x /home/anna/study /Volumes/anna/x lab-pc-17 SN-0815-4711"
    " anna@uni.example"
)
TRACES = re.compile(
    r"geheim|anna|lab-?pc|0815|uni\.example|/home|/users|\\\\users|/volumes|2000-01-01|2026-01-",
    re.IGNORECASE,
)
KNOWN_NAMES = {"attempt.stimuli.name", "attempt.condition.first", "attempt.condition.second"}
"""An attempt with names that the study does not have is damage, and left out of every export."""
FORMS = ("bids", "pwcmp")


def plant(event: dict[str, object]) -> tuple[dict[str, object], set[str]]:
    """Put the secret into every text of an event that a journal may hold; say where."""
    places: set[str] = set()

    def valid() -> bool:
        try:
            EVENT.validate_json(json.dumps(event), strict=True)
        except ValueError:
            return False
        return True

    def visit(node: object, place: str) -> None:
        if isinstance(node, dict):
            keys: list[object] = list(node)
        elif isinstance(node, list):
            keys = list(range(len(node)))
        else:
            return
        for key in keys:
            value = node[key]
            here = place if isinstance(key, int) else f"{place}.{key}"
            visit(value, here)
            if not (isinstance(value, str) or value is None):
                continue
            if key in ("kind", "at") or here.endswith("gaze_file.file"):
                continue
            if here in KNOWN_NAMES:
                continue
            node[key] = SECRET
            if valid():
                places.add(here)
            else:
                node[key] = value
        if place.endswith(".versions") and isinstance(node, dict):
            node[SECRET] = SECRET

    visit(event, str(event["kind"]))
    return event, places


@pytest.fixture
def planted(recorded, reseal):
    """Sessions with the secret wherever a journal, the display or the protocol takes text."""
    study = recorded
    (study.folder / "desk.toml").write_text(
        (study.folder / "desk.toml").read_text()
        + f"description = {json.dumps(SECRET)}\nmonitor = {json.dumps(SECRET)}\n"
    )
    text = study.path.read_text(encoding="utf-8")
    for key in ("description", "source", "contact"):
        text = re.sub(
            rf"^{key} = .*$",
            lambda _, key=key: f"{key} = {json.dumps('see /home/anna/x or anna@uni.example')}",
            text,
            flags=re.M,
        )
    study.path.write_text(text, encoding="utf-8")
    display = sha256_json(load_display("desk.toml", beside=study.path))
    places: set[str] = set()
    for number, folder in enumerate(sorted(study.session("S001").parent.iterdir())):
        journal = folder / "journal.jsonl"
        if b'"withdrawal"' in journal.read_bytes():
            continue
        lines = []
        for line in journal.read_bytes().split(b"\n"):
            try:
                event = json.loads(line)
            except json.JSONDecodeError:
                lines.append(line + SECRET.encode())  # the torn line
                continue
            event, found = plant(event)
            places |= found
            if event["kind"] == "session-start":
                event["protocol_sha256"] = study.protocol.sha256
                event["display_sha256"] = display
                event["participant"] = f"Anna-Geheim-{number}"
            lines.append(json.dumps(event).encode())
            if event["kind"] == "session-start":
                lines.append(json.dumps({"kind": "note", "text": SECRET}).encode())  # damaged
        journal.write_bytes(b"\n".join(lines))
        for gaze in sorted((folder / "gaze").glob("*.csv"))[:1]:
            plant_in_gaze(journal, gaze)
        reseal(journal)
        folder.rename(folder.with_name(f"Anna-Geheim-{number}"))
    study.sessions.rename(study.folder / "lab-pc-17")
    return study, places


def plant_in_gaze(journal: Path, gaze: Path) -> None:
    """Put the secret into a gaze file, and its new hash into the journal."""
    before = sha256_bytes(gaze.read_bytes())
    gaze.write_text(gaze.read_text() + f'0.0,0.0,"{SECRET}",1.0\n')
    after = sha256_bytes(gaze.read_bytes())
    content = journal.read_bytes()
    assert before.encode() in content
    journal.write_bytes(content.replace(before.encode(), after.encode()))


def traces(folder: Path) -> list[str]:
    """Every trace in names and contents of a folder's files, packed ones too."""
    found = []
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        text = ""
        if path.is_file():
            data = path.read_bytes()
            text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")
        found += [f"{name}: {match.group()}" for match in TRACES.finditer(name + "\n" + text)]
    return found


def test_secrets_are_planted_wherever_journals_take_text(planted):
    _, places = planted

    # Should journals gain a text, it is planted by itself; these are the ones known to be there.
    assert places >= {
        "answer.text",
        "attempt.condition.scene",
        "attempt.track",
        "attempt.flips_file.file",
        "attempt.key",
        "session-end.message",
        "session-resume.torn_file",
        "session-resume.revision",
        "session-start.gaze.description",
        "session-start.gaze.source",
        "session-start.platform",
        "session-start.revision",
        "session-start.timing_evidence",
        "session-start.versions.python",
    }


@pytest.mark.parametrize("form", FORMS)
def test_nothing_gets_through(metamerlab, planted, tmp_path, form):
    study, _ = planted
    sessions = study.folder / "lab-pc-17"

    def run(out: Path, *more: str) -> None:
        metamerlab(
            "analysis", "export", sessions, "--protocol", study.path,
            "--format", form, "--out", out, *more,
        )  # fmt: skip

    run(tmp_path / "whole")
    run(tmp_path / "public", "--public")

    assert traces(tmp_path / "public") == []
    # The search would have found them.
    assert traces(tmp_path / "whole") != []


def test_a_public_export_still_holds_the_data(metamerlab, planted, tmp_path):
    study, _ = planted
    metamerlab(
        "analysis", "export", study.folder / "lab-pc-17", "--protocol", study.path,
        "--format", "bids", "--out", tmp_path / "out", "--public",
    )  # fmt: skip

    people = sorted(path.name for path in (tmp_path / "out").glob("sub-*"))
    assert people == ["sub-P001", "sub-P002", "sub-P003"]  # the fourth was cut short
    for person in people:
        events = next((tmp_path / "out" / person / "beh").glob("*_events.tsv")).read_text()
        assert events.count("\trespond\t") >= 4
        gaze = next((tmp_path / "out" / person / "beh").glob("*_physio.tsv.gz"))
        assert len(gzip.decompress(gaze.read_bytes()).splitlines()) > 100


def test_chosen_answers_stay_and_typed_ones_go(metamerlab, recorded, reseal, tmp_path):
    journal = recorded.session("S001") / "journal.jsonl"
    text = journal.read_text(encoding="utf-8")
    answers = re.findall(r'"question":"(\w+)","t_s":[\d.]+,"text":"([^"]*)"', text)
    assert [question for question, _ in answers] == ["strategy", "vision"]
    text = text.replace(f'"text":"{answers[0][1]}"', '"text":"I looked at edges"')
    text = text.replace(f'"text":"{answers[1][1]}"', '"text":"glasses"')
    journal.write_text(text, encoding="utf-8")
    reseal(journal)

    metamerlab(
        "analysis", "export", recorded.sessions, "--protocol", recorded.path,
        "--format", "bids", "--out", tmp_path / "out", "--public",
    )  # fmt: skip

    said = (tmp_path / "out" / "phenotype" / "closing_questions.tsv").read_text()
    assert "glasses" in said
    assert "edges" not in said


def test_nobody_sees_who_came_before_an_update(metamerlab, recorded, reseal, tmp_path):
    for number, code in enumerate(("S001", "S005")):
        journal = recorded.session(code) / "journal.jsonl"
        text = journal.read_text(encoding="utf-8")
        old = json.loads(text.splitlines()[0])["revision"]
        journal.write_text(text.replace(old, f"1.{number} {'ab' * 20}"), encoding="utf-8")
        reseal(journal)

    metamerlab(
        "analysis", "export", recorded.sessions, "--protocol", recorded.path,
        "--format", "bids", "--out", tmp_path / "out", "--public",
    )  # fmt: skip

    sessions = pd.read_csv(tmp_path / "out" / "participants.tsv", sep="\t")
    said = {json.loads(p.read_text())["StimulusPresentation"]["SoftwareVersion"]
            for p in (tmp_path / "out").rglob("*beh/*_events.json")}  # fmt: skip

    assert set(sessions["revision"]) == said
    assert len(sessions) > len(said) == 1
    assert {"1.0", "1.1"} < {word for text in said for word in text.split()}
    assert not {"unchecked_lines", "slot"} & set(sessions)


@pytest.mark.parametrize(
    "text",
    [
        "C:\\Users\\anna\\a.csv",
        "\\\\server\\share\\x",
        "in /home/anna/x.",
        "/" + "root/x",
        "anna.x@uni-y.example",
        "C:/" + "Users/anna/a.csv",
        "see file:/" + "//x/a.csv",
        "smb://server/anna/x",
        "~/study/a.csv",
        "~anna/x",
        "//nas/anna/x",
        "/export/anna/x",
        "on 192.168.3.17.",
    ],
)
def test_folders_and_addresses_are_scrubbed_from_the_studys_own_texts(text):
    assert "left out" in scrub(f"A study, {text}", public=True)
    assert scrub(f"A study, {text}", public=False) == f"A study, {text}"


@pytest.mark.parametrize(
    "text",
    [
        "push/pull and/or metameric",
        "https://example.org/data/x",
        "3 s / 60 Hz",
        "a: b",
        "about ~5/6 of it",
        "version 1.11.1",
        "http://example.org//a/b",
        "left//right",
    ],
)
def test_other_texts_stay_as_they_are(text):
    assert scrub(text, public=True) == text


def test_only_the_family_of_a_system_is_public():
    assert system("Linux-6.1.0-lab-pc-17-x86_64", public=True) == "Linux"
    assert system("lab-pc-17", public=True) == "other"
