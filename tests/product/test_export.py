"""Exports hold what was recorded, in the form that was asked for; journals stay as they are."""

import csv
import gzip
import json
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from analysis.tidy import read_sessions
from protocols.disk.hashing import sha256_file
from protocols.journal import Attempt, SessionResume
from protocols.journal_file import read_journal

VALIDATOR = Path(sys.executable).parent / "bids-validator-deno"


def files(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): sha256_file(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def export(metamerlab, study, form: str, out: Path, *more: object) -> Path:
    metamerlab(
        "analysis", "export", study.sessions, "--protocol", study.path,
        "--format", form, "--out", out, *more,
    )  # fmt: skip
    return out


def table(path: Path) -> list[dict[str, str]]:
    separator = "\t" if path.suffix == ".tsv" else ","
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter=separator))


def validate(folder: Path) -> tuple[int, list[dict[str, object]]]:
    """Return the validator's status and its errors; it brings its own schema, so runs offline."""
    if not VALIDATOR.is_file():
        pytest.skip("bids-validator-deno is not installed (it is in the extra `dev`)")
    done = subprocess.run(
        [VALIDATOR, "--format", "json", "--max-rows", "-1", folder],
        capture_output=True,
        text=True,
        timeout=200,
    )
    issues = json.loads(done.stdout)["issues"]["issues"]
    return done.returncode, [issue for issue in issues if issue["severity"] == "error"]


@pytest.fixture(scope="module")
def exported(recorded_once, tmp_path_factory):
    """Give a function that makes an export once for all tests of this file."""
    from typer.testing import CliRunner

    from study_app.cli import app

    made: dict[tuple[str, ...], Path] = {}

    def make(form: str, *more: str) -> Path:
        if (form, *more) not in made:
            out = tmp_path_factory.mktemp("exports") / "out"
            done = CliRunner().invoke(
                app,
                [
                    "analysis", "export", str(recorded_once.sessions), "--protocol",
                    str(recorded_once.path), "--format", form, "--out", str(out), *more,
                ],
            )  # fmt: skip
            assert done.exit_code == 0, done.output
            made[form, *more] = out
        return made[form, *more]

    return make


# --- all forms -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("form", ["bids", "pwcmp"])
@pytest.mark.parametrize("public", [False, True])
def test_equal_sessions_give_equal_bytes_and_journals_stay(
    metamerlab, recorded, tmp_path, form, public
):
    before = files(recorded.folder)
    more = ["--public"] if public else []

    first = export(metamerlab, recorded, form, tmp_path / "a", *more)
    second = export(metamerlab, recorded, form, tmp_path / "b", *more)

    assert files(first) == files(second)
    assert files(recorded.folder) == before
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize("form", ["bids", "pwcmp"])
def test_who_withdrew_is_nowhere(exported, form):
    everything = everything_in(exported(form))

    assert "S005" in everything
    # The exclusion rules leave the session that was cut short out of the table for pwcmp.
    assert ("S003" in everything) is (form != "pwcmp")
    # BIDS has a list of what is odd in its README; it says that somebody withdrew, no more.
    everything = everything.replace("demo/S004: the participant withdrew", "")
    assert "S004" not in everything


def everything_in(folder: Path) -> str:
    """Names and contents of all files, unpacked."""
    found = []
    for path in folder.rglob("*"):
        found.append(str(path.relative_to(folder)))
        if path.is_file():
            data = path.read_bytes()
            found.append((gzip.decompress(data) if path.suffix == ".gz" else data).decode())
    return "\n".join(found)


@pytest.mark.parametrize("consent", ["refused", "missing"])
def test_who_did_not_consent_is_left_out(metamerlab, recorded, tmp_path, consent):
    journal = recorded.session("S005") / "journal.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if '"kind":"consent"' in line)
    if consent == "refused":
        lines[at] = lines[at].replace('"agreed":true', '"agreed":false')
    else:
        lines = lines[:at]
    journal.write_text("".join(lines), encoding="utf-8")

    out = export(metamerlab, recorded, "bids", tmp_path / "out")

    people = {row["code"] for row in table(out / "participants.tsv")}
    assert people == {"S001", "S002", "S003"}


def test_nobody_left_is_refused(metamerlab, recorded, tmp_path):
    for code in ("S001", "S002", "S003", "S005"):
        done = metamerlab("session", "withdraw", code, "--out", recorded.sessions, "--yes")

    done = metamerlab(
        "analysis", "export", recorded.sessions, "--protocol", recorded.path,
        "--format", "bids", "--out", tmp_path / "out", status=2
    )  # fmt: skip

    assert "withdrew" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--format", "bidz"], "--format: must be one of bids, pwcmp (got 'bidz')"),
        (["--format", "psych-ds"], "--format psych-ds was removed: export with --format bids"),
        (["--format", "bids", "--recorded-eye", "third"], "must be one of left, right, cyclopean"),
        (["--format", "bids", "--display", "fhd27-60hz"], "as it was then, with --display"),
        (["--format", "bids", "--author", "anna@uni.example", "--public"], "change --author"),
    ],
)
def test_mistakes_are_told_and_leave_nothing(metamerlab, recorded, tmp_path, more, message):
    done = metamerlab(
        "analysis", "export", recorded.sessions, "--protocol", recorded.path,
        "--out", tmp_path / "out", *more, status=2
    )  # fmt: skip

    assert message in " ".join(done.stderr.split())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recorded"]


def test_links_in_a_circle_are_refused(metamerlab, recorded, tmp_path):
    (tmp_path / "circle").symlink_to("circle")
    for sessions, out in (
        (recorded.sessions, tmp_path / "circle" / "out"),
        (tmp_path / "circle", tmp_path / "out"),
    ):
        done = metamerlab(
            "analysis", "export", sessions, "--protocol", recorded.path, "--format", "bids",
            "--out", out, status=2
        )  # fmt: skip
        assert "circle" in done.stderr
        assert "lead in a circle" in " ".join(done.stderr.split())


def test_a_folder_with_files_and_one_among_the_sessions_are_refused(metamerlab, recorded, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "dataset_description.json").write_text("{}")
    for out, message in (
        (tmp_path / "full", "must be empty or new"),
        (recorded.sessions / "bids", "must lie outside the folder of sessions"),
        (recorded.sessions, "must lie outside the folder of sessions"),
    ):
        done = metamerlab(
            "analysis", "export", recorded.sessions, "--protocol", recorded.path,
            "--format", "bids", "--out", out, status=2
        )  # fmt: skip
        assert message in " ".join(done.stderr.split())
        assert "--replace" not in done.stderr
    assert files(tmp_path / "full") == {
        "dataset_description.json": sha256_file(tmp_path / "full" / "dataset_description.json")
    }


# --- BIDS ------------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [(), ("--public",)], ids=["whole", "public"])
def test_bids_passes_the_validator(exported, more):
    status, errors = validate(exported("bids", *more))

    assert errors == []
    assert status == 0


def test_the_validator_finds_what_is_wrong(metamerlab, recorded, tmp_path):
    out = export(metamerlab, recorded, "bids", tmp_path / "out")
    sidecar = next(out.glob("sub-S001/beh/*_physio.json"))
    content = json.loads(sidecar.read_text())
    del content["RecordedEye"]
    sidecar.write_text(json.dumps(content))

    status, errors = validate(out)

    assert status != 0
    assert [error["subCode"] for error in errors] == ["RecordedEye"]


def test_bids_lists_everyone_as_they_are(exported):
    people = {row["participant_id"]: row for row in table(exported("bids") / "participants.tsv")}

    assert list(people) == ["sub-S001", "sub-S002", "sub-S003", "sub-S005"]
    assert [row["status"] for row in people.values()] == [
        "completed", "completed", "unfinished", "completed",
    ]  # fmt: skip
    assert [row["runs"] for row in people.values()] == ["1", "2", "1", "1"]
    assert {row["simulated"] for row in people.values()} == {"1"}
    assert {row["gaze_source"] for row in people.values()} == {"simulated"}


def test_a_resumed_session_is_two_runs_with_clocks_of_their_own(recorded_once, exported):
    journal = read_journal(recorded_once.session("S002") / "journal.jsonl")
    at = next(i for i, e in enumerate(journal.events) if isinstance(e, SessionResume))
    parts = (journal.events[:at], journal.events[at:])
    beh = exported("bids") / "sub-S002" / "beh"

    for number, events in enumerate(parts, start=1):
        attempts = [event for event in events if isinstance(event, Attempt)]
        rows = table(beh / f"sub-S002_task-demo_run-{number}_beh.tsv")
        assert [(row["trial"], row["position"]) for row in rows] == [
            (attempt.trial, str(attempt.position)) for attempt in attempts
        ]
        shown = table(beh / f"sub-S002_task-demo_run-{number}_events.tsv")
        onsets = [float(row["onset"]) for row in shown]
        assert onsets == sorted(onsets)
        assert onsets[0] == pytest.approx(0.0, abs=1.0)
        firsts = [float(row["onset"]) for row in shown if row["trial_type"] == "first"]
        assert firsts == [a.phases[1].onset_s for a in attempts if len(a.phases) > 1]


def test_every_answer_and_reaction_time_is_in_the_events(recorded_once, exported):
    journal = read_journal(recorded_once.session("S001") / "journal.jsonl")
    rows = table(exported("bids") / "sub-S001/beh/sub-S001_task-demo_run-1_events.tsv")

    times = [row["response_time"] for row in rows if row["trial_type"] == "respond"]
    wanted = [
        "n/a" if attempt.rt_s is None else str(attempt.rt_s)
        for attempt in journal.attempts
        if any(phase.phase == "respond" for phase in attempt.phases)
    ]
    assert times == wanted
    shown = [row["stimulus"] for row in rows if row["trial_type"] == "second"]
    assert shown == [a.stimuli[1].name for a in journal.attempts if len(a.phases) > 3]


def test_every_gaze_sample_is_in_the_recording(recorded_once, exported):
    folder = recorded_once.session("S001")
    journal = read_journal(folder / "journal.jsonl")
    stem = exported("bids") / "sub-S001/beh/sub-S001_task-demo_run-1_recording-eye1_physio"
    sidecar = json.loads(stem.with_name(stem.name + ".json").read_text())
    rows = gzip.decompress(stem.with_name(stem.name + ".tsv.gz").read_bytes()).decode()

    wanted = [
        [
            float(sample["t_s"]),
            sample["x_px"] or "n/a",
            sample["y_px"] or "n/a",
            float(sample["raw_t"]),
        ]
        for attempt in journal.attempts
        for sample in table(folder / attempt.gaze_file.file)
    ]
    got = [line.split("\t") for line in rows.splitlines()]

    assert sidecar["Columns"] == [
        "timestamp", "x_coordinate", "y_coordinate", "tracker_timestamp",
    ]  # fmt: skip
    assert [[float(t), x, y, float(raw)] for t, x, y, raw in got] == wanted
    assert sidecar["StartTime"] == wanted[0][0]
    assert sidecar["SamplingFrequency"] == 120.0


def test_gaze_that_is_not_what_was_recorded_is_left_out_and_said_so(metamerlab, recorded, tmp_path):
    journal = read_journal(recorded.session("S001") / "journal.jsonl")
    first, second = (attempt.gaze_file.file for attempt in journal.attempts[:2])
    (recorded.session("S001") / first).unlink()
    with (recorded.session("S001") / second).open("a") as file:
        file.write("9.0,9.0,1.00,1.00\n")

    out = tmp_path / "out"
    done = metamerlab(
        "analysis", "export", recorded.sessions, "--protocol", recorded.path,
        "--format", "bids", "--out", out
    )  # fmt: skip

    said = " ".join(done.stdout.split())
    assert first in said
    assert f"{second}: must be as it was recorded" in said
    gaze = next(out.glob("sub-S001/beh/*_physio.tsv.gz"))
    start_s = float(gzip.decompress(gaze.read_bytes()).decode().split("\t")[0])
    third = recorded.session("S001") / journal.attempts[2].gaze_file.file
    assert start_s == float(table(third)[0]["t_s"])
    assert validate(out)[1] == []


def test_a_gaze_file_outside_the_session_is_never_read(tmp_path):
    from analysis.export.bids_gaze import read_samples
    from protocols.errors import StudyError
    from protocols.journal import SideFile

    (tmp_path / "elsewhere.csv").write_text("t_s,raw_t,x_px,y_px\n")
    (tmp_path / "session").mkdir()
    digest = sha256_file(tmp_path / "elsewhere.csv")

    for name in ("../elsewhere.csv", str(tmp_path / "elsewhere.csv")):
        with pytest.raises(StudyError, match="must lie in the folder of its journal"):
            read_samples(tmp_path / "session", SideFile(file=name, sha256=digest))


def test_codes_stay_apart_when_they_become_labels():
    from analysis.export.bids import subject
    from analysis.export.export_content import Person

    labels = {subject(Person(code, None, ())) for code in ("a-b", "a_b", "ab")}

    assert labels == {"sub-a+b", "sub-a++b", "sub-ab"}


# --- pwcmp -----------------------------------------------------------------------------------


def test_pwcmp_comes_back_through_import(metamerlab, recorded_once, exported, tmp_path):
    metamerlab(
        "analysis", "import", exported("pwcmp") / "pwcmp.csv",
        "--map", "participant=observer", "--map", "first=condition_A",
        "--map", "second=condition_B", "--map", "chose_first=is_A_selected",
        "--map", "scene=scene_name", "--out", tmp_path / "imported",
    )  # fmt: skip
    ours = read_sessions(recorded_once.sessions, recorded_once.protocol).analysed
    back = pd.read_csv(tmp_path / "imported" / "decisions.csv")

    # Scenes are not told apart by size: else inference would count each of them twice.
    columns = ["participant", "scene", "size", "first", "second", "chosen"]
    assert back[columns].to_numpy().tolist() == ours[columns].to_numpy().tolist()
    theirs = pd.read_csv(exported("pwcmp") / "pwcmp.csv")
    assert theirs["scene"].tolist() == (ours["scene"] + "__" + ours["size"]).tolist()
    assert len(back) > 30


def test_the_readme_of_pwcmp_names_no_column_that_is_not_there(exported):
    text = (exported("pwcmp") / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+)`", text))
    columns = set(pd.read_csv(exported("pwcmp") / "pwcmp.csv").columns)
    assert {"observer", "scene_name", "size"} <= named
    assert not {"status", "journal_sha256"} & named
    assert {name for name in named if "_" in name} <= columns
