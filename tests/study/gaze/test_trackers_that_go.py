"""Trackers that go while they are calibrated, checked or validated: for good, or for a while."""

import pytest
from fake_pylink import FakePylink
from fake_pylsl import FakePylsl
from tracker_session import FOREVER, Eye, pumped, sit

from protocols.errors import StudyError
from protocols.journal import Note, SessionEnd
from protocols.journal_file import check_side_files, read_journal
from study_app.gaze.eyelink import EyelinkGaze
from study_app.gaze.lsl import LslGaze, LslSpec
from study_app.virtual import VirtualClock

OWN_TARGETS = {"eyelink": 3, "lsl": 0}
"""Of the tracker's calibration; the validation has nine after them."""


@pytest.fixture
def make_of(monkeypatch):
    """Return what makes an adapter of a desk, for a tracker, an eye and a clock."""

    def make(kind, eye, clock):
        if kind == "eyelink":
            fake = FakePylink(eye, clock)
            return lambda desk: pumped(EyelinkGaze, fake, eye, clock)("", desk, fake)
        stream = FakePylsl(eye, clock)
        monkeypatch.setattr("study_app.gaze.lsl.load_pylsl", lambda: stream)
        adapter = pumped(LslGaze, stream, eye, clock)
        return lambda desk: adapter(LslSpec(), desk.display, clock)

    return make


def notes_of(journal) -> list[str]:
    return [event.text for event in journal.events if isinstance(event, Note)]


@pytest.mark.parametrize("kind", OWN_TARGETS)
@pytest.mark.parametrize("within", ["calibration", "validation"])
def test_a_tracker_that_dies_before_the_first_trial_is_one_message_and_a_whole_journal(
    tmp_path, make_of, kind, within
):
    own = OWN_TARGETS[kind]
    first = 2 if within == "calibration" else own + 4
    eye, clock = Eye(gone=range(first, FOREVER)), VirtualClock()
    with pytest.raises(StudyError, match=r"^gaze: .*;"):
        sit(tmp_path, make_of(kind, eye, clock), eye, clock)

    (path,) = tmp_path.rglob("journal.jsonl")
    journal = read_journal(path)
    assert journal.damaged == ()
    last = journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "error"
    assert last.message.startswith("gaze: ")
    assert not journal.attempts
    assert check_side_files(journal).wrong == ()
    gone = {"eyelink": "the link to the EyeLink broke", "lsl": "must send samples"}[kind]
    told = [*notes_of(journal), last.message]
    assert any(gone in text for text in told), told


@pytest.mark.parametrize("kind", OWN_TARGETS)
def test_a_tracker_that_is_back_is_calibrated_again_and_the_session_goes_on(
    tmp_path, make_of, kind
):
    first = OWN_TARGETS[kind] + 4
    eye, clock = Eye(("", "death"), gone=range(first, first + 1)), VirtualClock()
    sat = sit(tmp_path, make_of(kind, eye, clock), eye, clock)

    assert [attempt.void_reason for attempt in sat.journal.attempts] == [None, "data-loss"]
    told = notes_of(sat.journal)
    assert any("must send samples" in text or "must be seen" in text for text in told)
    calibrated = sum("own calibration" in text for text in told)
    assert calibrated == (0 if kind == "lsl" else 2)
    assert check_side_files(sat.journal).wrong == ()


def test_a_session_over_lsl_outlives_blinks_loss_and_a_break_and_ends_where_the_stream_does(
    tmp_path, make_of
):
    eye, clock = Eye(("blink", "loss", "break", "", "death")), VirtualClock()
    sat = sit(tmp_path, make_of("lsl", eye, clock), eye, clock)

    assert sat.journal.damaged == ()
    reasons = [attempt.void_reason for attempt in sat.journal.attempts]
    assert reasons == [None, "data-loss", "data-loss", None, "data-loss"]
    assert sat.journal.attempts[0].gaze.blinks == 1
    assert sat.journal.events[-1].reason == "tracker-lost"
    assert check_side_files(sat.journal).wrong == ()
