"""A copy that any program made is proven as the study is; a secret is nobody else's to read."""

import os
import shutil
import stat

from command_line import metamerlab, result_of

from protocols.load import load_display, load_protocol
from study_app.cli import new_study_command
from study_app.simulate import SimulatedStudy, simulate_session

session = result_of("session", terminal_width=200)


def test_a_packed_copy_is_proven_like_the_study_and_what_changed_in_it_is_named(tmp_path):
    (tmp_path / "mine").mkdir()
    metamerlab("protocol", "copy", "demo", tmp_path / "mine/study.toml")
    study = load_protocol(tmp_path / "mine/study.toml")
    simulation = SimulatedStudy(study, load_display("fhd27-60hz"), gaze_rate_hz=60)
    simulate_session(simulation, tmp_path / "sessions", "S001")
    packed, copy = shutil.make_archive(str(tmp_path / "b"), "zip", tmp_path), tmp_path / "copy"
    shutil.unpack_archive(packed, copy)

    words = "verify", copy / "sessions", "--protocol", copy / "mine/study.toml"
    assert ": whole (completed" in session(*words).output
    next(copy.rglob("flips/*.csv")).write_text("x", encoding="utf-8")
    assert ".csv was changed" in session(*words, status=2).output
    told = session("verify", packed, status=2).output
    assert told.startswith(f"error: {packed}: must be a folder (it is a file); 'session archive' ")


def test_a_secret_is_nobody_else_s_to_read_from_its_first_byte(tmp_path, monkeypatch):
    """Before, it was written for everybody to read, and closed a moment later."""
    modes = []
    open_new = new_study_command.open_new

    def seen(path: str, flags: int) -> int:
        descriptor = open_new(path, flags)
        if path.endswith(".secret"):
            modes.append(stat.S_IMODE(os.fstat(descriptor).st_mode))
        return descriptor

    monkeypatch.setattr(new_study_command, "open_new", seen)
    metamerlab("new-study", str(tmp_path / "mine"))

    assert modes == [0o600]
    assert stat.S_IMODE((tmp_path / "mine/study.secret").stat().st_mode) == 0o600
