"""Data that 0.3.0 recorded are still proven, tabulated, reported and exported.

`tests/recorded/v0_3/README.md` says what they are, and by which commands they were made.
"""

import csv
import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from pathlib import Path

import pytest
from command_line import metamerlab
from fixed_studies import leaves, rounded
from study_texts import short_study
from undrawn_reports import undrawn

from protocols.gone import gone, without_gone
from protocols.load import read_toml
from protocols.manifest import read_manifest
from study_app.web.read_results import ParticipantLines

RECORDED = Path(__file__).parents[1] / "recorded" / "v0_3" / "recorded.tar.xz"
STUDIES = (
    "abx", "active-pairs", "all-that-goes", "bayes", "confidence", "confidence-of-preferences",
    "gaze", "identification", "interaction", "quest-plus", "rating", "reaction-models",
    "reaction-models-of-answers", "sequential-bayes-factor", "sequential-obrien-fleming",
    "sequential-of-detection", "sequential-pocock", "threshold-at", "tracker-eyelink",
    "tracker-gazepoint", "tracker-lsl", "tracker-pupil", "tracker-tobii", "two-alternative",
    "two-interval", "up-down", "which-half", "yes-no", "yes-no-up-down",
)  # fmt: skip
WEB = ("rating", "two-interval", "yes-no", "yes-no-by-up-down", "yes-no-with-confidence")
TABLES = (
    "abx", "adaptive", "confidence", "detection", "graded-pairs", "preference",
    "preference-confidence", "ratings", "two-answers",
)  # fmt: skip
ALL = (
    *(f"studies/{name}" for name in STUDIES), *(f"web/{name}" for name in WEB), "batches/mesh",
)  # fmt: skip
BATCHES = {"files": 12, "mesh": 6}
"""Frames by name."""
MIDDLE = "studies/sequential-of-detection"
"""One that is fast, and names what may be gone."""
COMPARED = ("bias", "preferences", "rates", "ratings", "sensitivity", "times")
"""Parts of `results.json` that stay."""
PLAIN = (
    "answers", "chosen", "condition", "correct_rejections", "d_prime", "false_alarms", "hits",
    "mean_of_medians", "mean_rating", "median", "misses", "participants", "quartile_high",
    "quartile_low", "ratings", "scenes", "share", "trials", "trimmed_mean",
)  # fmt: skip
"""Keys whose values are counted or averaged: no search and no draws are in them."""
LATER = ("refresh_changes", "headset", "head_turn_deg")
"""Columns of sessions that came later; the first, after `refresh_hz`, made its meaning narrower."""


@lru_cache(maxsize=1)
def contents() -> dict[str, bytes]:
    """Return every recorded file by its path."""
    with tarfile.open(RECORDED) as archive:
        files = {one.name: archive.extractfile(one) for one in archive if one.isfile()}
        return {name: file.read() for name, file in files.items() if file}


def unpack(place: str, folder: Path) -> Path:
    """Write what lies below a place into a folder; return that."""
    for name, data in contents().items():
        if name.startswith(f"{place}/"):
            path = folder / name.removeprefix(f"{place}/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    return folder


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Callable[[str], Path]:
    """Give a function that returns the folder of a recorded study; no test may change it."""

    @cache
    def of(place: str) -> Path:
        return unpack(place, tmp_path_factory.mktemp("recorded"))

    return of


def said(*words: object, status: int = 0) -> str:
    """Run a command; return all that it says, in one line."""
    done = metamerlab(*words, terminal_width=200, status=None)
    assert done.exit_code == status, (done.output, done.exception)
    return " ".join(done.output.split())


def removed(study: Path) -> list[str]:
    """Return the keys of a study file that were removed since."""
    return list(without_gone(read_toml(study))[1])


def check_notes(study: Path, told: str) -> None:
    for key in removed(study):
        assert f"{key} is ignored: it {gone(key)}" in told


def proven(folder: Path) -> None:
    sessions, study = folder / "sessions", folder / "study.toml"
    alone = said("session", "verify", sessions)
    whole = said("session", "verify", sessions, "--protocol", study)
    people = len([*sessions.rglob("journal.jsonl")])
    assert alone.count(": whole (") == whole.count(": whole (") == people
    check_notes(study, whole)


def told_by(table: bytes) -> dict[str, object]:
    """Return the note of a table without keys that were removed since."""
    note = json.loads(table)
    return note | {"analysis": without_gone({"analysis": note["analysis"]})[0]["analysis"]}


def as_before(tables: dict[str, bytes]) -> dict[str, object]:
    """Return tables without the columns that came later, which must say nothing."""
    texts = {name: data.decode() for name, data in tables.items()}
    rows = [*csv.reader(texts["sessions.csv"].splitlines())]
    words = [*csv.reader(texts["dictionary.csv"].splitlines())]
    for later in {*LATER} & {*rows[0]}:
        place = rows[0].index(later)
        assert {row.pop(place) for row in rows} == {later, ""}
        words = [word for word in words if word[1] != later]
    for word in words:
        if word[1] == "refresh_hz":
            word[-1] = word[-1].removesuffix(", at the session's beginning")
    return texts | {"sessions.csv": rows, "dictionary.csv": words}


def tabulated(folder: Path, out: Path) -> None:
    words = "analysis", "tidy", folder / "sessions", "--protocol", folder / "study.toml"
    check_notes(folder / "study.toml", said(*words, "--out", out))
    before = {path.name: path.read_bytes() for path in (folder / "tables").iterdir()}
    after = {path.name: path.read_bytes() for path in out.iterdir() if path.name[0] != "."}
    assert told_by(after.pop("decisions.json")) == told_by(before.pop("decisions.json"))
    assert as_before(after) == as_before(before)


def stays(results: Path) -> Iterator[tuple[str, object]]:
    """Yield what neither a search nor draws decide, by its path."""
    numbers = rounded(json.loads(results.read_text(encoding="utf-8")))
    yield from leaves({part: numbers[part] for part in ("flow", "participants")})
    for part in COMPARED:
        for place, value in leaves(numbers["results"].get(part, {}), part):
            # Typical times stand in the order of the other tables now.
            moved = place.startswith(("times.diffusion.", "times.model.times."))
            if place.rpartition(".")[2] in PLAIN and not moved:
                yield place, value


def check_numbers(before: Path, after: Path) -> None:
    was, is_now = dict(stays(before)), dict(stays(after))
    assert {place: is_now.get(place) for place in was} == was
    assert len(was) > 9


def reported(folder: Path, out: Path) -> None:
    words = "analysis", "report", folder / "sessions", "--protocol", folder / "study.toml"
    with undrawn():
        told = said(*words, "--out", out, "--no-figures")
    check_notes(folder / "study.toml", told)
    check_numbers(folder / "results.json", out / "results.json")


def passed_on(folder: Path, out: Path) -> None:
    sessions, study = folder / "sessions", folder / "study.toml"
    words = "analysis", "export", sessions, "--protocol", study, "--format", "bids"
    said(*words, "--out", out / "bids")
    assert len([*(out / "bids").glob("sub-*")]) == len([*sessions.rglob("journal.jsonl")])


def test_sessions_of_0_3_are_whole_and_give_the_same_tables(recorded, tmp_path):
    proven(recorded(MIDDLE))
    tabulated(recorded(MIDDLE), tmp_path / "tables")


@pytest.mark.slow
@pytest.mark.parametrize("place", ALL)
def test_every_recorded_study_is_proven_tabulated_and_exported(recorded, tmp_path, place):
    proven(recorded(place))
    tabulated(recorded(place), tmp_path / "tables")
    passed_on(recorded(place), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("place", ALL)
def test_every_recorded_study_is_reported_with_the_same_numbers(recorded, tmp_path, place):
    reported(recorded(place), tmp_path / "report")


@pytest.mark.parametrize(
    "name", ["yes-no", *(pytest.param(name, marks=pytest.mark.slow) for name in WEB[:2])]
)
def test_lines_of_browsers_become_the_same_sessions_and_tables(
    monkeypatch, recorded, tmp_path, name
):
    """The lines say that nobody took part: set aside today, they are those of people but for it."""
    folder = recorded(f"web/{name}")
    words = "session", "import-web", folder / "lines", folder / "jatos.jrzip", "--protocol"
    more = "--stimuli", folder / "clips", "--out", tmp_path / "sessions"
    assert "simulated: nobody took part" in said(*words, folder / "study.toml", *more)
    assert not (tmp_path / "sessions").exists()

    nobody = property(lambda _: False, lambda *_: None)
    monkeypatch.setattr(ParticipantLines, "simulated", nobody)
    said(*words, folder / "study.toml", *more)

    again = tmp_path / "again"
    shutil.copytree(folder, again, ignore=shutil.ignore_patterns("sessions"))
    shutil.move(tmp_path / "sessions", again / "sessions")
    proven(again)
    tabulated(again, tmp_path / "tables")


@pytest.mark.parametrize("name", BATCHES)
def test_the_frames_of_a_batch_are_those_that_were_built(recorded, name):
    told = said("stimuli", "check", recorded(f"batches/{name}") / "clips")
    assert f"in order. {BATCHES[name] // (2 if name == 'mesh' else 1)} clips" in told
    assert f"{BATCHES[name]} frames" in told


def test_a_batch_of_pictures_is_built_again_with_the_same_frames(recorded, tmp_path):
    folder = recorded("batches/files")
    said("stimuli", "build", folder / "study.toml", "--out", tmp_path / "clips", "--workers", 1)
    before, after = (
        {clip.name: clip.frames_sha256 for clip in read_manifest(clips).clips}
        for clips in (folder / "clips", tmp_path / "clips")
    )
    assert after == before


@pytest.mark.parametrize("name", ["plain", "with-clips", "decrypted"])
def test_archives_are_proven_where_they_were_unzipped(recorded, tmp_path, name):
    with zipfile.ZipFile(recorded("archives") / f"{name}.zip") as archive:
        archive.extractall(tmp_path)
    (study,) = (tmp_path / "study").glob("*.toml")
    told = said("session", "verify", tmp_path / "sessions", "--protocol", study)
    assert ": whole (" in told
    if name == "with-clips":
        told = said("stimuli", "check", tmp_path / "clips", status=1)
        assert "(1 missing, 0 changed, 0 extra)" in told  # the contact sheet was left out


@pytest.mark.parametrize("name", ["plain.zip", "passphrase.zip.age", "recipient.zip.age"])
def test_an_archive_that_is_packed_is_refused_with_the_cure(recorded, name):
    path = recorded("archives") / name
    told = said("session", "verify", path, status=2)
    assert f"error: {path}: must be a folder (it is a file); 'session archive' was removed" in told
    assert "an archive of before is unzipped, after 'age --decrypt' where it is encrypted" in told


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name != "detection")) for name in TABLES],
)
def test_a_table_is_reported_with_the_same_numbers(recorded, tmp_path, name):
    folder = recorded(f"tables/{name}")
    table = folder / "decisions.csv"
    with undrawn():
        told = said("analysis", "report", table, "--out", tmp_path / "report", "--no-figures")
    check_numbers(folder / "results.json", tmp_path / "report" / "results.json")
    settings = {"analysis": json.loads((folder / "decisions.json").read_text())["analysis"]}
    for key in without_gone(settings)[1]:
        assert f"{key} is ignored: it {gone(key)}" in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("two-answers", ("psychometric", "--level", "level", "--by", "method", "--falling")),
        ("detection", ("detection", "--signal", "inconsistent", "--by", "method")),
        ("ratings", ("ratings", "--by", "method")),
        ("graded-pairs", ("ratings",)),
        ("two-answers", ("reaction", "--by", "method")),
    ],
)
def test_a_table_is_taken_by_the_command_of_its_kind(recorded, tmp_path, name, words):
    command, *options = words
    table = recorded(f"tables/{name}") / "decisions.csv"
    said("analysis", command, table, *options, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "results.json").is_file()


LAB = {
    "stimuli": 'kind = "lab-ramps"\nfills = { mean = "lab-mean" }\nedge_px = 32',
    "task": 'kind = "lab-above"\nseparation_deg = 3.0\nstimulus_s = 0.1',
    "analysis": 'kind = "lab-choice"\nprimary = { method = "whole", against = "mean" }',
    "trial": "fixation_s = 0.1\niti_s = 0.1",
}
USE_TRACKER = """
import sys
from types import SimpleNamespace
from study_app.gaze.open_source import open_gaze
gaze = open_gaze("steady:3,4", SimpleNamespace(clock=lambda: 1.0))
gaze.open()
print(gaze.info().source)
"""


@pytest.mark.slow
def test_plug_ins_of_every_kind_written_for_0_3_run(recorded, with_packages, tmp_path):
    site = recorded("lab")
    text = short_study(name="lab", answers=("upper", "lower"), design="repeats = 1", **LAB)
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    stills = tmp_path / "clips/a-mean/000000.png", tmp_path / "clips/a-whole/000000.png"
    done = with_packages(
        site,
        ("warp", "--list"),
        ("protocol", "check", "study.toml"),
        ("stimuli", "build", "study.toml", "--out", "clips", "--workers", 1),
        ("stimuli", "score", *stills, "--metrics", "lab-error", "--out", "scores"),
        ("session", "simulate", "study.toml", "--stimuli", "clips", "--out", "sessions",
         "--participants", 3),
        ("analysis", "report", "sessions", "--protocol", "study.toml", "--out", "report",
         "--no-figures"),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "lab-settling" in done.stdout
    results = json.loads((tmp_path / "report/results.json").read_text())["results"]
    assert {"lab_fast", "lab_sides", "preferences"} <= set(results)
    assert "lab-error" in (tmp_path / "scores/scores.csv").read_text()
    opened = subprocess.run(
        [sys.executable, "-c", USE_TRACKER], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), *sys.path])},
    )  # fmt: skip
    assert opened.stdout.strip() == "steady", opened.stderr
