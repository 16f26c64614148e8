"""One link is not one person: who shares one is named, and panels' codes stand in one file only."""

import csv
import json
import re
import zipfile

import pytest
from command_line import result_of
from task_cases import CASES, case_text
from web_kernel import running_kernel
from web_study import FHD, BuiltWebStudy, with_pixels

from protocols.journal_file import read_journal
from protocols.load import load_study
from study_app.web.export import WebBuild

WEB = '\n[web]\ngaze = "none"\ntolerance_s = 0.01\nidentifier = "PANEL_ID"\n'
CODES = {"W1": "=panel-one", "W2": "=panel-one", "W3": "panel-three", "W4": None}
SLOTS = {"W1": 0, "W2": 1, "W3": 0, "W4": 3}
metamerlab = result_of(terminal_width=200)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with a study, its stimuli, its export and an archive of four participants."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "study.toml").write_text(case_text(CASES["yes-no"]) + WEB, encoding="utf-8")
    study, _ = load_study(folder / "study.toml")
    manifest = with_pixels(study, folder / "clips")
    WebBuild(study, FHD, manifest).write(folder / "clips", folder / "web")
    of = BuiltWebStudy(study, FHD, manifest, folder / "clips", folder / "web")
    with running_kernel(folder) as kernel:
        sent = {
            who: [
                line.replace('"identifier":null', f'"identifier":{json.dumps(CODES[who])}')
                for line in of.session(kernel, who, slot=slot, luck=luck)["results"]
            ]
            for luck, (who, slot) in enumerate(SLOTS.items(), 1)
        }
    # W1 and W3 came by one worker of JATOS, W2 and W4 by one component result.
    results = [
        {"id": 11, "workerId": 7, "componentResults": [{"id": 21}]},
        {"id": 12, "workerId": 8, "componentResults": [{"id": 22}]},
        {"id": 13, "workerId": 7, "componentResults": [{"id": 23}]},
    ]
    places = {"W1": (11, 21), "W2": (12, 22), "W3": (13, 23), "W4": (12, 22)}
    texts: dict[str, str] = {}
    for who, (study_result, component) in places.items():
        name = f"study_result_{study_result}/comp-result_{component}/data.txt"
        texts[name] = texts.get(name, "") + "".join(sent[who])
    with zipfile.ZipFile(folder / "results.zip", "w") as archive:
        for name, text in texts.items():
            archive.writestr(name, text)
        archive.writestr("metadata.json", json.dumps({"data": [{"studyResults": results}]}))
        archive.writestr("other/metadata.json", "[")
    (folder / "plain.txt").write_text("".join("".join(lines) for lines in sent.values()))
    return folder


def imported(lab, results, *options):
    done = metamerlab(
        "session", "import-web", lab / results, "--protocol", lab / "study.toml",
        "--stimuli", lab / "clips", "--sessions", *options, status=None
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    rows = re.split(r"\n(?= ?\S)", done.output)  # a long message goes on further in
    return {
        words[0]: " ".join(words)
        for row in rows
        if (words := row.split())[:1] and words[0] in CODES
    }


SHARED = {
    "W1": ("share a panel code (W1, W2)", "share slot 0, a worker of JATOS (W1, W3)"),
    "W2": (
        "share a panel code (W1, W2)",
        "share a component result of JATOS, a study result of JATOS, a worker of JATOS (W2, W4)",
    ),
    "W3": ("share slot 0, a worker of JATOS (W1, W3)",),
    "W4": ("a study result of JATOS, a worker of JATOS (W2, W4)",),
}


def test_who_shares_a_link_is_named_by_import_and_report_whatever_came_when(lab, tmp_path):
    looked = imported(lab, "results.zip", tmp_path / "none", "--check")
    rows = imported(lab, "results.zip", tmp_path / "sessions")
    again = imported(lab, "plain.txt", tmp_path / "sessions")
    for told in (looked, rows, again):  # what JATOS told stands beside the journal
        for who, sentences in SHARED.items():
            for sentence in sentences:
                assert f"2 participants {sentence}" in told[who] or sentence in told[who], told[who]
            assert told[who].count("participants share") == len(sentences)
    assert "already there" in again["W1"]
    apart = imported(lab, "plain.txt", tmp_path / "plain")  # a text tells of no worker
    assert "2 participants share slot 0 (W1, W3)" in apart["W1"]
    assert "share" not in apart["W4"]
    metamerlab("session", "verify", tmp_path / "sessions", "--protocol", lab / "study.toml")

    metamerlab(
        "analysis", "report", tmp_path / "sessions", "--protocol", lab / "study.toml",
        "--out", tmp_path / "report",
    )  # fmt: skip
    (values,) = [
        json.loads(path.read_text()) for path in (tmp_path / "report").glob("results.json")
    ]
    said = " ".join(values["warnings"])
    for pair in ("W1, W2", "W1, W3", "W2, W4"):
        assert f"({pair}): one person may have taken part more than once" in said


def test_panels_codes_are_written_for_payment_and_nowhere_else(lab, tmp_path):
    sessions, study = tmp_path / "sessions", lab / "study.toml"
    imported(lab, "results.zip", sessions)
    outputs = [
        metamerlab("session", "list", sessions, "--identifiers", tmp_path / "paid.csv").output,
        metamerlab("session", "status", sessions / "short" / "W1").output,
        metamerlab(
            "analysis", "report", sessions, "--protocol", study, "--out", tmp_path / "out/report"
        ).output,
        metamerlab(
            "analysis", "tidy", sessions, "--protocol", study, "--out", tmp_path / "out/tidy"
        ).output,
        *(
            metamerlab(
                "analysis", "export", sessions, "--protocol", study, "--format", "bids",
                "--out", tmp_path / "out" / name, *options,
            ).output
            for name, options in (("bids", ()), ("public", ("--public",)))
        ),
    ]  # fmt: skip
    with (tmp_path / "paid.csv").open(newline="") as file:
        assert [*csv.DictReader(file)] == [
            {"study": "short", "participant": who, "identifier": code, "state": "completed"}
            for who, code in (("W1", "'=panel-one"), ("W2", "'=panel-one"), ("W3", "panel-three"))
        ]
    journal = read_journal(sessions / "short" / "W3" / "journal.jsonl")
    assert journal.start.remote.identifier == "panel-three"
    written = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert len(written) > 20
    for code in ("panel-one", "panel-three"):
        assert not any(code in output for output in outputs)
        assert [path for path in written if code.encode() in path.read_bytes()] == []
    again = metamerlab(
        "session", "list", sessions, "--identifiers", tmp_path / "paid.csv", status=2
    )
    assert "--identifiers: must be a new file" in again.output
