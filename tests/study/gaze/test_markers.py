"""The markers of a session on the network: when phases begin, and nobody's code."""

import dataclasses
from types import SimpleNamespace

import pytest

from study_app import run
from study_app.gaze import lsl
from study_app.session_setup import SessionSetup

CODE = "P77"


class Streams:
    """Stands for pylsl; keeps what each stream told the network of itself, and its samples."""

    IRREGULAR_RATE = 0.0

    def __init__(self) -> None:
        self.told: list[tuple[object, ...]] = []
        self.sent: list[tuple[list[str], float]] = []

    def StreamInfo(self, *told: object) -> object:  # noqa: N802  (their name)
        self.told.append(told)
        return told

    def StreamOutlet(self, _info: object) -> object:  # noqa: N802
        return SimpleNamespace(push_sample=lambda row, t_s: self.sent.append((row, t_s)))

    def local_clock(self) -> float:
        return 100.0


@pytest.fixture
def streams(monkeypatch):
    made = Streams()
    monkeypatch.setattr(lsl, "load_pylsl", lambda: made)
    return made


class OpenedError(Exception):
    """The window would open now."""


@pytest.mark.parametrize(
    ("asked", "streams_of", "named"),
    [({}, 0, False), ({"markers": True}, 1, False), ({"markers_code": True}, 1, True)],
    ids=["none", "markers", "code"],
)
def test_the_network_sees_a_code_only_where_that_was_asked_for(
    streams, monkeypatch, asked, streams_of, named
):
    setup = dataclasses.replace(
        SessionSetup(*[None] * 4, participant=CODE),  # nothing else is looked at
        **asked,
    )

    def opened(*_: object) -> None:
        raise OpenedError

    monkeypatch.setattr(run, "_fit_to_open", lambda given, **_: given)
    monkeypatch.setattr(run, "_OpenSession", opened)
    with pytest.raises(OpenedError):
        run.run_session(setup)
    assert len(streams.told) == streams_of
    assert (CODE in str(streams.told)) == named


def test_streams_of_one_machine_have_one_identity_so_that_a_recorder_finds_them_again(streams):
    lsl.LslMarkers(clock=lambda: 40.0)("main-0001 attempt 1 first", 41.0)
    lsl.LslMarkers()
    assert streams.told[0] == streams.told[1]
    assert streams.told[0][-1].startswith("metamerlab ")
    assert streams.sent == [(["main-0001 attempt 1 first"], 101.0)]
