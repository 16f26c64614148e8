"""Between the flips of a trial nothing is read, decoded or piled up."""

import json

SPY = """
import gc, json, os, sys, threading
from pathlib import Path

from study_app import clips, presenter
from study_app.cli import main

out = Path(sys.argv.pop())
opened, decoded, trials = [], [], []
moving = [False]

def hook(event, arguments):
    if moving[0] and event in ("open", "os.listdir", "os.scandir", "os.remove", "os.rename"):
        opened.append((event, str(arguments[0])))
sys.addaudithook(hook)

read_frame = clips.read_frame
def spied(folder, clip, index):
    if moving[0]:
        decoded.append(index)
    return read_frame(folder, clip, index)
clips.read_frame = spied

def disk():
    fields = dict(line.split(": ") for line in open("/proc/self/io").read().splitlines())
    return int(fields["read_bytes"]), int(fields["write_bytes"])

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

show = presenter.Presenter.show
start = []
def spy(self, picture):
    inside = picture.phase.watched
    if inside and not start:
        start.append((resident(), disk(), gc.isenabled(), sys.getallocatedblocks()))
    if not inside and start:
        moving[0] = False
        before = start.pop()
        trials.append({
            "bytes": resident() - before[0],
            "disk": [late - early for early, late in zip(before[1], disk())],
            "gc": before[2] or gc.isenabled(),
            "blocks": sys.getallocatedblocks() - before[3],
        })
    moving[0] = inside
    return show(self, picture)
presenter.Presenter.show = spy
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
out.write_text(json.dumps({"opened": opened, "decoded": decoded, "trials": trials}))
"""


def test_no_file_is_touched_nothing_decoded_and_memory_stands_still_during_a_trial(
    screen, make_study, tmp_path
):
    study = make_study({"duration_s": "0.5", "repeats": "1"})
    report = tmp_path / "spied.json"

    screen.script(SPY, *screen.session("run", study, "--simulate"), report)

    spied = json.loads(report.read_text())
    assert len(spied["trials"]) == 3
    assert spied["opened"] == []
    assert spied["decoded"] == []
    assert [trial["disk"] for trial in spied["trials"]] == [[0, 0]] * 3
    assert not any(trial["gc"] for trial in spied["trials"])
    # The log of some 66 flips is all that grows: a few objects per flip, no frame (37 kB each).
    assert max(trial["blocks"] for trial in spied["trials"]) < 66 * 12
    assert sorted(trial["bytes"] for trial in spied["trials"])[-2] < 2**19
