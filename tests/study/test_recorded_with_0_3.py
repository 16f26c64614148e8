"""Data that 0.3.0 recorded are still proven, tabulated, reported, exported and archived.

`tests/recorded/v0_3/README.md` says what they are, and by which commands they were made.
"""

from __future__ import annotations

import json
import shutil
import tarfile
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from pathlib import Path

import pytest
from fixed_studies import leaves, rounded
from typer.testing import CliRunner
from undrawn_reports import undrawn

from protocols.gone import gone, without_gone
from protocols.load import read_toml
from protocols.tasks.pairs import PreferenceAnalysis
from study_app.cli import app

RECORDED = Path(__file__).parents[1] / "recorded" / "v0_3" / "recorded.tar.xz"
STUDIES = (
    "abx", "active-pairs", "all-that-goes", "bayes", "confidence", "confidence-of-preferences",
    "gaze", "identification", "interaction", "quest-plus", "rating", "reaction-models",
    "reaction-models-of-answers", "sequential-bayes-factor", "sequential-obrien-fleming",
    "sequential-of-detection", "sequential-pocock", "tracker-eyelink", "tracker-gazepoint",
    "tracker-lsl", "tracker-pupil", "tracker-tobii", "two-alternative", "two-interval", "up-down",
    "which-half", "yes-no", "yes-no-up-down",
)  # fmt: skip
WEB = ("rating", "two-interval", "yes-no", "yes-no-by-up-down", "yes-no-with-confidence")
TABLES = (
    "abx", "adaptive", "confidence", "detection", "graded-pairs", "preference",
    "preference-confidence", "ratings", "two-answers",
)  # fmt: skip
ALL = (*(f"studies/{name}" for name in STUDIES), *(f"web/{name}" for name in WEB))
MIDDLE = "studies/sequential-of-detection"
"""One that is fast, and names what may be gone."""
COMPARED = ("preferences", "rates", "ratings", "sensitivity", "times")
"""Parts of `results.json` whose counts, shares and means stay."""
PLAIN = (
    "share", "count", "trials", "decisions", "participants", "median", "mean", "n", "chosen",
    "hits", "false_alarms", "correct", "wins", "losses",
)  # fmt: skip
"""Keys whose values are counted or averaged: no search and no draws are in them."""


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
    done = CliRunner().invoke(app, [str(word) for word in words], terminal_width=200)
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


def tabulated(folder: Path, out: Path) -> None:
    words = "analysis", "tidy", folder / "sessions", "--protocol", folder / "study.toml"
    check_notes(folder / "study.toml", said(*words, "--out", out))
    before = {path.name: path.read_bytes() for path in (folder / "tables").iterdir()}
    after = {path.name: path.read_bytes() for path in out.iterdir() if path.name[0] != "."}
    assert told_by(after.pop("decisions.json")) == told_by(before.pop("decisions.json"))
    assert after == before


def stays(results: Path) -> Iterator[tuple[str, object]]:
    """Yield what neither a search nor draws decide, by its path."""
    numbers = rounded(json.loads(results.read_text(encoding="utf-8")))
    yield from leaves({part: numbers[part] for part in ("flow", "participants")})
    for part in COMPARED:
        for place, value in leaves(numbers["results"].get(part, {}), part):
            if place.rpartition(".")[2] in PLAIN and not place.startswith("times.diffusion."):
                yield place, value


def check_numbers(before: Path, after: Path) -> None:
    was, is_now = dict(stays(before)), dict(stays(after))
    assert {place: is_now.get(place) for place in was} == was
    assert len(was) > 10


def reported(folder: Path, out: Path) -> None:
    words = "analysis", "report", folder / "sessions", "--protocol", folder / "study.toml"
    with undrawn():
        told = said(*words, "--out", out, "--no-figures")
    check_notes(folder / "study.toml", told)
    check_numbers(folder / "results.json", out / "results.json")


def sampled(study: Path) -> bool:
    """Return True where a report still samples posteriors, which takes an extra and a minute."""
    analysis = read_toml(study)["analysis"]
    return "bayes" in PreferenceAnalysis.model_fields and "bayes" in analysis


def passed_on(folder: Path, out: Path) -> None:
    sessions, study = folder / "sessions", folder / "study.toml"
    words = "analysis", "export", sessions, "--protocol", study, "--format", "bids"
    said(*words, "--out", out / "bids")
    assert len([*(out / "bids").glob("sub-*")]) == len([*sessions.rglob("journal.jsonl")])
    said("session", "archive", study, "--sessions", sessions, "--out", out / "again.zip")
    said("session", "verify", out / "again.zip")


def test_sessions_of_0_3_are_whole_and_give_the_same_tables(recorded, tmp_path):
    proven(recorded(MIDDLE))
    tabulated(recorded(MIDDLE), tmp_path / "tables")


@pytest.mark.slow
@pytest.mark.parametrize("place", ALL)
def test_every_recorded_study_is_proven_tabulated_exported_and_archived(recorded, tmp_path, place):
    proven(recorded(place))
    tabulated(recorded(place), tmp_path / "tables")
    passed_on(recorded(place), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("place", ALL)
def test_every_recorded_study_is_reported_with_the_same_numbers(recorded, tmp_path, place):
    if sampled(recorded(place) / "study.toml"):
        pytest.skip("posteriors are still there")
    reported(recorded(place), tmp_path / "report")


@pytest.mark.parametrize(
    "name", ["yes-no", *(pytest.param(name, marks=pytest.mark.slow) for name in WEB[:2])]
)
def test_lines_of_browsers_become_the_same_sessions_and_tables(recorded, tmp_path, name):
    folder = recorded(f"web/{name}")
    words = "session", "import-web", folder / "lines", folder / "jatos.jrzip", "--protocol"
    more = "--stimuli", folder / "clips", "--out", tmp_path / "sessions"
    said(*words, folder / "study.toml", *more)

    again = tmp_path / "again"
    shutil.copytree(folder, again, ignore=shutil.ignore_patterns("sessions"))
    shutil.move(tmp_path / "sessions", again / "sessions")
    proven(again)
    tabulated(again, tmp_path / "tables")
