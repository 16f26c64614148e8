"""Screen as a process of its own sees it, against what the session's log says."""

from itertools import pairwise

import numpy as np
import pytest
from attack.captured_flips import compare

from protocols.display import Viewing
from protocols.plan import make_plan

ONE_TRIAL = {
    "pairings": '[["metameric", "push-pull"]]',
    "repeats": "1",
    "primary": '{ method = "metameric", against = "push-pull" }',
}


def clip_rectangle(study) -> tuple[int, int, int, int]:
    width, height = study.display.centred_size_px(2.75, 1.9)
    return (640 - width) // 2, (480 - height) // 2, width, height


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_another_process_sees_every_logged_flip_in_order_with_the_right_frame(
    screen, make_study, full
):
    study = make_study({"repeats": "16" if full else "2"})

    seen = screen.watch(study, "--photodiode")

    rows = study.flips()
    logged, names = study.logged()
    assert len(logged) >= (1500 if full else 150)
    assert sum(frame is not None for frame in logged.values()) >= (900 if full else 90)
    assert compare(logged, seen, names) == []
    # Pages and waits too: what the camera saw is every flip of the window, without a gap.
    numbers = [entry.number for entry in seen if entry.number >= min(logged)]
    assert numbers[: len(logged)] == sorted(numbers[: len(logged)])
    assert {row["evidence"] for row in rows} == {"software timer"}
    for early, late in pairwise(rows):
        if late["interval_s"]:
            gap = float(late["t_s"]) - float(early["t_s"])
            assert float(late["interval_s"]) == pytest.approx(gap, abs=2e-6)


SABOTAGE = """
from study_app import clips
from study_app.desktop import draw, window

read_frame = clips.read_frame
def swapped_and_mirrored(folder, clip, index):
    wanted = {3: 4, 4: 3}.get(index, index) if clip.column("method") == "metameric" else index
    frame = read_frame(folder, clip, wanted)
    return frame[:, ::-1].copy() if clip.column("method") == "push-pull" and index == 2 else frame
clips.read_frame = swapped_and_mirrored

missing = []
frames = draw.Painter.clip_frame
def clip_frame(self, clip, layer, place, crop):
    missing.append(layer)
    frames(self, clip, layer, place, crop)
draw.Painter.clip_frame = clip_frame
swap = window.glfw.swap_buffers
drawn = []
def swap_buffers(handle):
    new = missing[:]
    missing.clear()
    if new == [1]:
        drawn.append(1)
        if len(drawn) == 1:  # the first flip of clip frame 1 in interval 1
            return
    swap(handle)
window.glfw.swap_buffers = swap_buffers
"""


def test_a_frame_that_is_swapped_mirrored_or_missing_is_named_exactly(screen, make_study):
    # Each frame stands for six refreshes: one that is missed leaves none of them out.
    study = make_study(ONE_TRIAL | {"fps": "10.0", "duration_s": "0.6"})

    seen = screen.watch(study, "--seed", 1, also=SABOTAGE)

    logged, names = study.logged()
    found = compare(logged, seen, names)
    metameric = "garden__small__metameric"
    expected = []
    first_of_frame_1 = next(
        number for number, frame in logged.items() if frame and frame[-2:] == "/1"
    )
    for number, frame in logged.items():
        if number == first_of_frame_1:
            expected.append((number, frame, "no such flip"))
        elif frame in (f"{metameric}/3", f"{metameric}/4"):
            other = {"3": "4", "4": "3"}[frame[-1]]
            expected.append((number, frame, f"{metameric}/{other}"))
        elif frame == "garden__small__push-pull/2":
            expected.append((number, frame, "pixels of no clip frame"))
    assert [(d.number, d.expected, d.found) for d in found] == expected
    assert len(expected) >= 3  # at least one of each kind


PIXELS = """
import sys
import numpy as np
from pathlib import Path
from protocols.load import load_display, load_protocol
from protocols.manifest import read_manifest
from protocols.feasibility import virtual_manifest
from protocols.plan import make_plan
from study_app.desktop.strip import FlipMarks
from study_app.presenter import Presenter
from study_app.session_setup import SessionSetup
from study_app.stage import FlipPicture
from protocols.make_script import Scripts
from study_app.desktop.window import Window

folder, buffer, out = map(Path, sys.argv[1:4])
protocol = load_protocol(folder / "study.toml")
display = load_display(str(folder / "little.toml"))
manifest = read_manifest(folder / "clips")
plan = make_plan(protocol, manifest, "P01", 0)

def picture():
    data = buffer.read_bytes()
    start = int.from_bytes(data[:4], "big") + 12 * int.from_bytes(data[76:80], "big")
    return np.frombuffer(data, np.uint8, 640 * 480 * 4, start).reshape(480, 640, 4)[..., 2::-1]

script = Scripts(protocol, display, "en", manifest).of(plan.trials[0])
phase = {phase.name: phase for phase in script.phases}
per_frame = round(60.0 / protocol.stimuli.frame_hz)
shots = {}
with Window(display, pacing="software") as window:
    setup = SessionSetup(protocol, display, manifest, folder, "P01", "en", folder / "clips",
                         marks=FlipMarks(photodiode="patch" in sys.argv))
    with Presenter(window, setup, 60.0) as presenter:
        presenter.prepare(plan.trials[0], script, 1)
        for name, shown in {
            "fixate": FlipPicture(phase["fixate"]),
            "first": FlipPicture(phase["first"], 2 * per_frame),
            "odd": FlipPicture(phase["first"], 3 * per_frame),
            "second": FlipPicture(phase["second"], 5 * per_frame),
            "answer": FlipPicture(phase["respond"]),
        }.items():
            presenter.show(shown)
            presenter.show(shown)
            shots[name] = picture()
np.savez(out, **shots)
"""


@pytest.mark.parametrize("dot_over_clips", [False, True])
def test_shown_pixels_equal_the_stored_frame_at_its_place_and_size(
    screen, make_study, tmp_path, dot_over_clips
):
    study = make_study(
        {"dot_deg": "0.6\ndot_over_clips = " + ("true" if dot_over_clips else "false")}
    )
    screen.script(PIXELS, study.folder, screen.file, tmp_path / "shots.npz", "patch")
    shots = np.load(tmp_path / "shots.npz")
    trial = make_plan(study.protocol, study.manifest, "P01", 0).trials[0]
    x, y, width, height = clip_rectangle(study)
    viewing = Viewing.of(study.display)
    # Degrees as the protocol declares them, to the nearest even pixel, around the centre.
    left, top = viewing.to_deg(x, y)
    right, bottom = viewing.to_deg(x + width, y + height)
    pixel_deg = 1 / 34
    assert right - left == pytest.approx(2.75, abs=pixel_deg)
    assert bottom - top == pytest.approx(1.9, abs=pixel_deg)
    assert (left + right, top + bottom) == pytest.approx((0, 0), abs=1e-9)

    dot = np.zeros((480, 640), bool)
    reach = 12  # 0.6 deg are 21 pixels
    dot[240 - reach : 240 + reach, 320 - reach : 320 + reach] = True
    for name, clip, index, patch in (
        ("first", 0, 2, 255), ("odd", 0, 3, 0), ("second", 1, 5, 0)
    ):  # fmt: skip
        expected = np.full((480, 640, 3), 128, np.uint8)
        expected[y : y + height, x : x + width] = study.frame(trial.stimuli[clip], index)
        expected[480 - 56 : 480 - 8, 640 - 48 :] = patch
        differs = (shots[name] != expected).any(axis=2)
        if dot_over_clips:
            assert differs[dot].any()
            differs[dot] = False
        assert not differs.any(), name

    fixate = shots["fixate"][:, :, 0].copy()
    fixate[480 - 56 : 480 - 8, 640 - 48 :] = 128
    rows, columns = np.nonzero(fixate != 128)
    across_deg = 2 * viewing.to_deg(columns.max() + 1, 240)[0]
    assert across_deg == pytest.approx(0.6, abs=2 * pixel_deg)
    assert (columns.min() + columns.max(), rows.min() + rows.max()) == (639, 479)  # centred
    assert fixate[239:241, 319:321].max() == 0  # the dot
    assert fixate[239, 312] == 128  # the cross hair's arm
    assert (shots["answer"][:, :320, 0] != 128).any()
    assert (shots["answer"][:, 320:, 0] != 128).any()
