"""`doctor --gaze` opens a tracker and listens; `protocol check --gaze` knows what may be named."""

from __future__ import annotations

import threading
import time

import pytest
from gazepoint_server import GazepointServer
from typer.testing import CliRunner

from protocols.errors import StudyError
from protocols.load import load_display
from study_app.cli import app
from study_app.doctor.findings import Status
from study_app.doctor.tracker import check_tracker

FHD = load_display("fhd27-60hz")


class Eye:
    """Seen, or not."""

    def __init__(self, seen: bool) -> None:
        self.seen = seen

    def now(self, _t_s):
        return ""

    def place(self, _t_s):
        return (960.0, 540.0) if self.seen else None


@pytest.mark.parametrize("seen", [True, False])
def test_a_tracker_that_sees_nobody_is_a_warning(monkeypatch, seen):
    monkeypatch.setattr("study_app.doctor.tracker.LISTEN_S", 0.3)
    server, stop, began_s = GazepointServer(Eye(seen)), threading.Event(), time.monotonic()

    def send():
        while not stop.wait(0.005):
            if server._wants.is_set():
                server.advance(time.monotonic() - began_s)

    sender = threading.Thread(target=send)
    sender.start()
    try:
        found = check_tracker(f"gazepoint:127.0.0.1:{server.port}", FHD)
    finally:
        stop.set()
        sender.join()
        server.close()

    # Few samples are a warning as well, on a machine that is busy.
    assert found.status is Status.WARN or seen
    assert "gazepoint Gazepoint GP3HD" in found.found
    assert f"{100 * seen} % of them with an eye" in found.found


def test_what_cannot_be_reached_fails_and_what_is_no_kind_is_refused():
    found = check_tracker("gazepoint:127.0.0.1:1", FHD)

    assert found.status is Status.FAIL
    assert "must be reachable" in found.found
    with pytest.raises(StudyError, match="did you mean 'gazepoint'"):
        check_tracker("gazepiont", FHD)


@pytest.mark.parametrize(
    ("given", "said"), [("eyelnk", "did you mean 'eyelink'"), ("eyelink", "watches no gaze")]
)
def test_check_refuses_a_source_that_is_none_or_that_the_study_does_not_watch(given, said):
    done = CliRunner().invoke(app, ["protocol", "check", "demo", "--gaze", given])

    assert done.exit_code == 2
    assert said in done.stderr.replace("\n       ", " ")
