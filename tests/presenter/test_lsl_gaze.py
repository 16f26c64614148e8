"""Gaze over the lab streaming layer from another process, through the real window."""

import csv
import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from gaze_persistence import persistence_s

from protocols.journal import Note, SessionEnd

pytest.importorskip("pylsl", reason="pylsl is not installed (extra lsl)")

ENFORCED = {
    "pairings": '[["metameric", "push-pull"], ["reference", "push-pull"]]',
    "repeats": "1",
    "duration_s": "0.4",
    "fixation_s": "0.2",
    "mode": '"enforce"',
    "timeout_s": "5.0",
    "max_attempts": "9",
}
# Trials begin once somebody listens to the markers, however long a busy machine takes to find them.
HEARD = """
from study_app import run
from study_app.cli import main
class Heard(run.LslMarkers):
    def __init__(self, participant=""):
        super().__init__(participant)
        assert self._outlet.wait_for_consumers(60)
run.LslMarkers = Heard
main()
"""
PLAN = ("away", "blink", "loss", "death")


def side_rows(study, attempt, name):
    path = study.sessions / "demo" / "P01" / getattr(attempt, name).file
    with path.open() as file:
        return list(csv.DictReader(file))


# Each rate is a whole session in real time; without --full the fastest stands for all.
@pytest.mark.slow
@pytest.mark.parametrize(
    "rate_hz",
    [pytest.param(60, marks=pytest.mark.full), pytest.param(250, marks=pytest.mark.full), 1000],
)
def test_decisions_fall_within_one_frame_and_one_sample_of_the_rule(
    screen, make_study, tmp_path, rate_hz
):
    study = make_study(ENFORCED)
    rules = study.protocol.gaze
    name = f"eye-{rate_hz}-{tmp_path.name}"
    log = tmp_path / "sent.json"
    outlet = subprocess.Popen(
        [sys.executable, Path(__file__).with_name("gaze_outlet.py"), name, str(rate_hz), log,
         "320", "240", *PLAN],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert outlet.stdout is not None
        assert outlet.stdout.readline() == "ready\n"
        done = screen.run(
            *screen.session("run", study, "--simulate", "--gaze", f"lsl:{name}", "--markers"),
            "--skip-validation",
            code=HEARD,
            hasty=False,
            status=None,
        )
        outlet.wait(timeout=30)
    finally:
        outlet.kill()
        outlet.communicate()

    # The outlet died: one message, exit status 2, and a journal that says so.
    assert done.returncode == 2, done.stdout + done.stderr
    # liblsl logs on stderr as well, each line with its time.
    (message,) = [line for line in done.stderr.splitlines() if not line.startswith("20")]
    assert message.startswith("error: the gaze source must keep sending")
    journal = study.journal()
    last = journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "tracker-lost"
    assert "gaze was not validated" in [e.text for e in journal.events if isinstance(e, Note)]
    info = journal.start.gaze
    assert (info.source, info.rate_hz) == ("lsl", float(rate_hz))
    assert abs(info.clock_offset_s) < 0.1  # one machine, one clock

    reasons = [attempt.void_reason for attempt in journal.attempts]
    assert reasons == ["gaze-break", None, "data-loss", "data-loss"]
    assert journal.attempts[1].gaze.blinks >= 1  # seen, and pardoned

    sent = json.loads(log.read_text())
    frame_s = 1 / 60
    for number, (kind, length_s) in enumerate(
        (("away", persistence_s(rules, rate_hz)), ("blink", None), ("loss", rules.blink_s),
         ("death", rules.silence_s))
    ):  # fmt: skip
        attempt = journal.attempts[number]
        samples = side_rows(study, attempt, "gaze_file")
        # Raw stamps are kept as they came; the offset is a column of its own, one per attempt.
        offsets = [float(row["t_s"]) - float(row["raw_t"]) for row in samples]
        assert max(offsets) - min(offsets) < 1e-5
        own = [entry for entry in sent if entry["attempt"] == number and entry["kind"] == kind]
        raw = {round(float(row["raw_t"]), 6) for row in samples}
        due = {round(entry["stamp"], 6) for entry in own if entry["stamp"] <= max(raw)}
        assert due
        assert due <= raw  # none was lost
        flips = side_rows(study, attempt, "flips_file")
        if length_s is None:
            assert flips[-1]["phase"] == "iti"
            continue
        # The decision is made after the last flip before the inter-trial interval's first.
        decided, before = next(
            (float(late["t_s"]), float(early["t_s"]))
            for early, late, after in zip(flips, flips[1:], flips[2:], strict=False)
            if after["phase"] == "iti"
        )
        if kind == "death":
            due_s = max(entry["stamp"] for entry in own) + offsets[0] + length_s
        else:
            inside = [entry for entry in own if entry["inside"]]
            first_s = inside[0]["stamp"]
            # The first sample that completes the rule, and when it really left the tracker.
            completing = next(e for e in inside if e["stamp"] - first_s >= length_s - 1e-6)
            assert completing["stamp"] - first_s <= length_s + 1 / rate_hz + 1e-6
            due_s = max(completing["stamp"], completing["pushed"]) + offsets[0]
            assert decided >= first_s + offsets[0] + length_s - frame_s
        # One frame: the one that was on the screen (it may have stood longer than planned).
        assert decided - due_s <= max(decided - before, frame_s) + 1 / rate_hz


def test_phases_are_marked_at_the_stamps_of_their_flips(screen, make_study):
    import threading

    import pylsl

    study = make_study({"pairings": '[["metameric", "push-pull"]]', "repeats": "1"})
    got: list[tuple[str, float]] = []
    stop = threading.Event()

    def listen():
        found = []
        while not found and not stop.is_set():
            found = pylsl.resolve_byprop("source_id", "metamerlab P77", 1, 0.5)
        if not found:
            return
        inlet = pylsl.StreamInlet(found[0])
        while not stop.is_set():
            text, stamp = inlet.pull_sample(timeout=0.2)
            if text:
                got.append((text[0], stamp))
        inlet.close_stream()

    listener = threading.Thread(target=listen)
    listener.start()
    screen.run(
        *screen.session("run", study, "--simulate", "--markers-code", code="P77"), code=HEARD
    )
    stop.set()
    listener.join(timeout=10)

    attempt = study.journal("P77").attempts[0]
    marked = [(text.split()[-1], stamp) for text, stamp in got if text.startswith(attempt.trial)]
    assert [name for name, _ in marked] == ["fixate", "first", "gap", "second", "respond", "iti"]
    for (_, one), (_, two), first, second in zip(
        marked, marked[1:], attempt.phases, attempt.phases[1:], strict=False
    ):
        assert two - one == pytest.approx(second.onset_s - first.onset_s, abs=1e-4)
    assert all(late > early for (_, early), (_, late) in pairwise(marked))
