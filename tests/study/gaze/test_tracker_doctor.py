"""`doctor --gaze` opens a tracker and listens; `protocol check --gaze` knows what may be named."""

import time
from types import SimpleNamespace

import pytest
from command_line import metamerlab
from fake_pylink import FakePylink

from protocols.errors import StudyError
from protocols.load import load_display
from study_app.cli.doctor import check_tracker
from study_app.doctor import Status
from study_app.virtual import VirtualClock

FHD = load_display("fhd27-60hz")


class Eye:
    """Seen, or not."""

    def __init__(self, seen: bool) -> None:
        self.seen = seen

    def now(self, _t_s):
        return ""

    def place(self, _t_s):
        return (960.0, 540.0) if self.seen else None


@pytest.fixture
def host_of(monkeypatch):
    """Return what puts a Host PC that sees an eye, or none, in the place of SR Research's."""

    def make(seen: bool) -> FakePylink:
        clock = VirtualClock()
        host = FakePylink(Eye(seen), clock)
        monkeypatch.setattr("study_app.gaze.eyelink.load_pylink", lambda: host)

        def wait(seconds: float) -> None:
            clock.move_to(clock() + seconds)
            host.advance(clock())

        for module in ("cli.doctor", "gaze.source", "gaze.eyelink"):
            ours = SimpleNamespace(monotonic=clock, sleep=wait, time=time.time)
            monkeypatch.setattr(f"study_app.{module}.time", ours)
        return host

    return make


@pytest.mark.parametrize("seen", [True, False])
def test_a_tracker_that_sees_nobody_is_a_warning(host_of, seen):
    host_of(seen)
    found = check_tracker("eyelink", FHD)

    assert found.status is (Status.PASS if seen else Status.WARN)
    assert "eyelink EYELINK CL 5.15" in found.found
    assert f"{100 * seen} % of them with an eye" in found.found


def test_what_cannot_be_reached_fails_and_what_is_no_kind_is_refused(host_of):
    host_of(True).refuses = True
    found = check_tracker("eyelink", FHD)

    assert found.status is Status.FAIL
    assert "must be reachable" in found.found
    with pytest.raises(StudyError, match="did you mean 'eyelink'"):
        check_tracker("eyelnik", FHD)


@pytest.mark.parametrize("kind", ["gazepoint", "pupil:neon.local", "tobii"])
def test_a_tracker_that_was_removed_is_told_with_its_bridge(kind):
    with pytest.raises(StudyError, match=r"was removed: .* --gaze lsl:.*docs/trackers\.md"):
        check_tracker(kind, FHD)


@pytest.mark.parametrize(
    ("given", "said"), [("eyelnk", "did you mean 'eyelink'"), ("eyelink", "watches no gaze")]
)
def test_check_refuses_a_source_that_is_none_or_that_the_study_does_not_watch(given, said):
    done = metamerlab("protocol", "check", "demo", "--gaze", given, status=2)

    assert said in done.stderr.replace("\n       ", " ")
