"""A tracker in a process of its own: sends gaze over LSL, and does what is planned per attempt.

Arguments: stream name, rate, log file, centre x, centre y, then one plan per attempt: away, blink,
loss, death or steady. It listens to the session's markers; 0.1 s after the onset of interval 1 it
begins what is planned. The log says what was sent when, on LSL's clock.
"""

import json
import math
import sys
import time
from pathlib import Path

import pylsl

DURATIONS_S = {"away": 0.3, "blink": 0.11, "loss": 0.4, "death": math.inf, "steady": 0.0}


def main() -> None:
    name, rate_hz, log = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3])
    centre = float(sys.argv[4]), float(sys.argv[5])
    plans = sys.argv[6:]
    info = pylsl.StreamInfo(name, "Gaze", 2, rate_hz, "float32", name)
    channels = info.desc().append_child("channels")
    for label in ("gaze_x", "gaze_y"):
        channel = channels.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", "px")
    outlet = pylsl.StreamOutlet(info)
    print("ready", flush=True)
    markers = None
    start_s = pylsl.local_clock()
    number, attempt, event_s, resolved_s = 0, -1, math.inf, 0.0
    sent: list[dict[str, object]] = []
    resolver = pylsl.ContinuousResolver(prop="name", value="metamerlab")
    kind = "steady"
    dead = False
    while not dead:
        now_s = pylsl.local_clock()
        if markers is None and now_s - resolved_s > 0.2:
            resolved_s = now_s
            if found := resolver.results():
                markers = pylsl.StreamInlet(found[0])
                markers.open_stream(timeout=2.0)
        if markers is not None:
            text, stamp = markers.pull_sample(timeout=0.0)
            if text and text[0].endswith(" first"):
                attempt += 1
                kind = plans[min(attempt, len(plans) - 1)]
                event_s = stamp + 0.1
        while (due_s := start_s + number / rate_hz) <= now_s:
            inside = 0.0 <= due_s - event_s < DURATIONS_S[kind]
            if inside and kind == "death":
                dead = True
                break
            lost = inside and kind in ("blink", "loss")
            x = math.nan if lost else centre[0] + (200.0 if inside else 0.0)
            y = math.nan if lost else centre[1]
            outlet.push_sample([x, y], due_s)
            if attempt >= 0:
                sent.append(
                    {"attempt": attempt, "kind": kind, "inside": inside, "stamp": due_s,
                     "pushed": pylsl.local_clock()}
                )  # fmt: skip
            number += 1
        wait_s = start_s + number / rate_hz - pylsl.local_clock()
        if wait_s > 0:
            time.sleep(min(wait_s, 0.004))
    log.write_text(json.dumps(sent))
    del outlet  # the stream is gone


main()
