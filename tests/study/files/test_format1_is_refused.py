"""A file of format 1 gets one message, which names the revision that reads it."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import metamerlab

from protocols.errors import LAST_WITH_FORMAT_1
from protocols.feasibility import virtual_manifest
from protocols.load import load_study, shipped
from protocols.manifest import write_manifest

SAID = f"format: must be 2 (got 1); revision {LAST_WITH_FORMAT_1} of metamerlab is the last"


@pytest.fixture
def refused(tmp_path, monkeypatch):
    """Give a function that runs a command, and holds that it said this once and wrote nothing."""
    monkeypatch.chdir(tmp_path)

    def tree() -> dict[Path, bytes]:
        # Locks are no results: "claimed" leaves one beside the sessions.
        found = (path for path in tmp_path.rglob("*") if path.is_file())
        return {path: path.read_bytes() for path in found if not path.name.startswith(".")}

    def run(path: str, words: str) -> None:
        before = tree()
        done = metamerlab(*words.split(), terminal_width=100, status=2)
        message = " ".join(done.output.split())
        assert f"{path}: {SAID}" in message
        assert message.count("must") == 1
        assert tree() == before

    return run


@pytest.mark.parametrize(
    "words", ["check old.toml", "show old.toml", "preregister old.toml --out p.html"]
)
def test_a_study_of_format_1_is_refused_in_one_message_whatever_else_is_wrong(refused, words):
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    old = re.sub(r"^format = 2$", "format = 1", text, flags=re.MULTILINE)
    assert old != text
    Path("old.toml").write_text(old.replace("repeats = ", "repeat = "), encoding="utf-8")

    refused("old.toml", f"protocol {words}")


@pytest.mark.parametrize(
    "words",
    [
        "session verify sessions",
        "session list sessions",
        "session status sessions/demo/S001",
        "session withdraw S001 --out sessions --yes",
        "session simulate demo --participants 3 --out sessions",
        "analysis tidy sessions --protocol demo --out tables",
        "analysis report sessions --protocol demo --out report",
        "analysis export sessions --protocol demo --format bids --out bids",
    ],
)
def test_a_journal_of_format_1_is_refused_in_one_message(refused, sample_sessions, words):
    shutil.copytree(sample_sessions, "sessions")
    path = Path("sessions/demo/S001/journal.jsonl")
    first, *rest = path.read_text(encoding="utf-8").splitlines(keepends=True)
    header = json.loads(first) | {"format": 1}
    del header["task"], header["chain"]  # the old code wrote none
    path.write_text(json.dumps(header) + "\n" + "".join(rest), encoding="utf-8")

    refused(str(path), words)


@pytest.mark.parametrize(
    "words",
    ["stimuli check clips", "protocol check demo --stimuli clips", "stimuli check clips --flicker"],
)
def test_a_manifest_of_format_1_is_refused_in_one_message(refused, words):
    Path("clips").mkdir()
    path = write_manifest(Path("clips"), virtual_manifest(*load_study(Path("demo"))))
    raw = json.loads(path.read_text(encoding="utf-8")) | {"format": 1}
    for clip in raw["clips"]:
        clip |= clip.pop("condition")  # as the old code wrote it
        del clip["name"]
    path.write_text(json.dumps(raw), encoding="utf-8")

    refused("clips/manifest.json", words)


def test_the_revision_that_is_named_reads_format_1(repository):
    git = ["git", "-C", str(repository), "cat-file", "-e"]
    if (
        not shutil.which("git")
        or subprocess.run([*git, LAST_WITH_FORMAT_1], capture_output=True).returncode
    ):
        pytest.skip("needs git and the history of the repository")

    reader = f"{LAST_WITH_FORMAT_1}:protocols/format1.py"
    assert subprocess.run([*git, reader], capture_output=True).returncode == 0
