"""Signals that end a command, the home folder in an option, sessions in a batch of clips."""

import signal
import subprocess
import sys

import pytest
from command_line import refusal_of, result_of

from protocols.feasibility import virtual_manifest
from protocols.load import load_study
from protocols.manifest import write_manifest
from study_app import cli
from study_app.session_folders import require_no_batch

_STOPPED = """
import os, signal, sys
from study_app.cli import main

times, number, keeps = (int(sys.argv.pop()) for _ in range(3))
# Who runs the tests may ignore signals, as nohup and a shell in the background do.
ends = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
signal.signal(number, signal.SIG_IGN if keeps else ends)

def stopped(_):
    for _ in range(times):
        os.kill(os.getpid(), number)

os.fsync = stopped
main()
"""


def stopped(out, number, times, keeps=False):
    """Return what becomes of a command that gets signals while it writes `out`."""
    words = ("protocol", "preregister", "demo", "--out", out, int(keeps), int(number), times)
    command = [sys.executable, "-c", _STOPPED, *map(str, words)]
    return subprocess.run(command, capture_output=True, timeout=120, check=False)


@pytest.mark.parametrize(("name", "times"), [("SIGINT", 1), ("SIGTERM", 1), ("SIGHUP", 3)])
def test_a_signal_stops_a_command_as_ctrl_c_does_and_leaves_no_part(tmp_path, name, times):
    done = stopped(tmp_path / "plan.md", getattr(signal, name), times)
    assert (done.returncode, done.stdout) == (130, b""), done.stderr
    assert b"Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_who_starts_a_command_may_keep_a_signal_from_it(tmp_path):
    done = stopped(tmp_path / "plan.md", signal.SIGHUP, 1, keeps=True)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["plan.md"]


@pytest.mark.parametrize("option", [("--out=~/plan.md",), ("--out", "~/plan.md")])
def test_an_option_may_begin_with_the_home_folder(tmp_path, monkeypatch, option):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    monkeypatch.chdir(tmp_path)
    result_of("protocol", "preregister", "demo")(*option)
    assert [path.name for path in tmp_path.iterdir()] == ["home"]
    assert (tmp_path / "home/plan.md").is_file()


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ("~", "HOME"),
        ("~/a", "HOME/a"),
        ("--methods=telea,onnx:~/n.onnx", "--methods=telea,onnx:HOME/n.onnx"),
        ("frames:~/a,frames:~/b", "frames:HOME/a,frames:HOME/b"),
        ("depth=~/d.exr", "depth=HOME/d.exr"),
        ("a~/b", "a~/b"),
        ("y ~ x", "y ~ x"),
        ("rt~method", "rt~method"),
        ("./~/a", "./~/a"),
        ("~2", "~2"),
    ],
)
def test_the_home_is_read_where_a_path_begins_and_nowhere_else(given, read):
    assert cli._HOME.sub("HOME", given) == read


@pytest.fixture
def batch(tmp_path):
    """Return a batch of the study ``demo``, of which only the manifest is there."""
    write_manifest(tmp_path, virtual_manifest(*load_study("demo")))
    return tmp_path


@pytest.mark.parametrize("below", ["", "sessions"])
def test_sessions_are_not_written_into_a_batch_of_clips(batch, below):
    out = batch / below
    said = refusal_of("session")("simulate", "demo", "--participants", 1, "--out", out)
    assert f"must not lie in a batch of clips (this is one: {batch})" in said
    lines = batch.parent / "lines.txt"
    lines.write_text("{}\n")
    words = ("--protocol", "demo", "--stimuli", batch, "--out", out)
    assert "in a batch of clips" in refusal_of("session", "import-web")(lines, *words)
    assert "in a batch of clips" in refusal_of("session")("check-display", "a", "--out", out)
    assert [path.name for path in batch.iterdir()] == ["manifest.json"]


def test_a_manifest_of_another_program_is_no_batch(tmp_path):
    (tmp_path / "manifest.json").write_text('{"name": "an app", "icons": []}')
    require_no_batch(tmp_path / "sessions")
