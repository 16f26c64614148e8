"""Recordings of gaze are in the coordinates that their header names, of an eye that was found."""

import math
from pathlib import Path

import numpy as np
import pytest

from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import load_display
from study_app.gaze.open_source import open_gaze
from study_app.gaze.recording import load_recording
from study_app.gaze.source import TrackerContext

WIDE, HIGH = 1280, 1024


def asc(
    folder: Path,
    *messages: str,
    samples: str = "SAMPLES\tGAZE\tLEFT\tRATE\t 500.00",
    left: tuple[float, float] | None = (640.0, 500.0),
    right: tuple[float, float] | None = None,
    lost_from: int = 200,
    name: str = "r.asc",
) -> Path:
    """200 samples of 2 ms; the left eye is lost from one on."""

    def cells(place: tuple[float, float] | None, at: int) -> str:
        if place is None or (place is left and at >= lost_from):
            return ".\t.\t0.0"
        return f"{place[0] + at % 3:.1f}\t{place[1] + at % 5:.1f}\t834.0"

    both = "LEFT" in samples and "RIGHT" in samples
    lines = [
        f"{1000 + 2 * at}\t{cells(left, at)}{chr(9) + cells(right, at) if both else ''}\t..."
        for at in range(200)
    ]
    head = ["START\t1000 \tLEFT\tSAMPLES\tEVENTS", *(f"MSG\t1000 {text}" for text in messages)]
    (folder / name).write_text("\n".join([*head, samples, *lines, "END\t3400"]) + "\n")
    return folder / name


BOTH = "SAMPLES\tGAZE\tLEFT\tRIGHT\tRATE\t 500.00"


def test_one_more_than_the_display_from_0_on_is_taken_with_a_note(tmp_path):
    recording = load_recording(asc(tmp_path, "GAZE_COORDS 0.00 0.00 1280.00 1024.00"))
    placed = recording.on_screen(WIDE, HIGH)

    assert (placed.x_px[0], placed.y_px[0]) == (640, 500)
    assert len(placed.notes) == 1
    assert "one more than the last pixel" in placed.notes[0]
    exact = load_recording(asc(tmp_path, "GAZE_COORDS 0.00 0.00 1279.00 1023.00"))
    assert exact.on_screen(WIDE, HIGH).notes == ()


@pytest.mark.parametrize(
    "box", ["0 0 1280 1023", "0 0 1279 1024", "1 1 1281 1025", "0 0 1281 1025", "0 0 1023 767"]
)
def test_coordinates_of_another_screen_are_refused(tmp_path, box):
    recording = load_recording(asc(tmp_path, f"GAZE_COORDS {box}"))

    with pytest.raises(StudyError, match=r"screen of 1280x1024 pixels.*--display"):
        recording.on_screen(WIDE, HIGH)


@pytest.mark.parametrize(
    ("box", "written"),
    [
        ("-640 -512 639 511", (0.0, -12.0)),
        ("1 1 1280 1024", (641.0, 501.0)),
        ("1920 0 3199 1023", (2560.0, 500.0)),
        ("0 1023 1279 0", (640.0, 523.0)),  # y upwards
    ],
)
def test_coordinates_that_begin_elsewhere_are_honoured(tmp_path, box, written):
    recording = load_recording(asc(tmp_path, f"GAZE_COORDS {box}", left=written))
    placed = recording.on_screen(WIDE, HIGH)

    assert (placed.x_px[0], placed.y_px[0]) == (640.0, 500.0)
    step = -1 if box.startswith("0 1023") else 1
    assert placed.y_px[1] - placed.y_px[0] == step


def test_the_coordinates_of_gaze_go_before_those_of_the_display(tmp_path):
    boxes = ("GAZE_COORDS -640 -512 639 511", "DISPLAY_COORDS 0 0 1279 1023")
    for messages in (boxes, boxes[::-1]):
        recording = load_recording(asc(tmp_path, *messages, left=(0.0, 0.0)))
        assert (recording.x_px[0], recording.y_px[0]) == (640, 512)


def test_coordinates_that_change_within_a_file_are_refused(tmp_path):
    file = asc(tmp_path, "GAZE_COORDS 0 0 1279 1023", "GAZE_COORDS 0 0 1023 767")

    with pytest.raises(StudyError, match=r"keep its coordinates .*0 0 1279 1023.*0 0 1023 767"):
        load_recording(file)


@pytest.mark.parametrize("kind", ["HREF", "PUPIL", "RAW"])
def test_samples_that_are_no_gaze_are_refused_with_the_cure(tmp_path, kind):
    file = asc(tmp_path, samples=f"SAMPLES\t{kind}\tLEFT\tRATE\t 500.00")

    with pytest.raises(StudyError, match=rf"SAMPLES GAZE; got SAMPLES {kind}.*edf2asc -sg"):
        load_recording(file)


def test_an_eye_that_is_never_found_leaves_the_other_which_is_said(tmp_path):
    recording = load_recording(asc(tmp_path, samples=BOTH, left=None, right=(600.0, 400.0)))

    assert (recording.x_px[0], recording.y_px[0]) == (600.0, 400.0)
    assert "left eye was lost in 100 %" in recording.notes[0]
    assert "the right one is replayed" in recording.notes[0]


@pytest.mark.parametrize(("lost_from", "eye"), [(200, "left"), (185, "left"), (170, "right")])
def test_an_eye_that_is_lost_far_more_often_is_not_replayed(tmp_path, lost_from, eye):
    file = asc(tmp_path, samples=BOTH, right=(600.0, 400.0), lost_from=lost_from)
    recording = load_recording(file)

    assert recording.x_px[0] == {"left": 640.0, "right": 600.0}[eye]
    assert len(recording.notes) == (eye == "right")


@pytest.mark.parametrize("eye", ["left", "right"])
def test_the_eye_can_be_chosen_and_the_choice_is_noted(tmp_path, eye):
    file = asc(tmp_path, samples=BOTH, right=(600.0, 400.0), lost_from=10)
    source = open_gaze(f"replay:{file},eye={eye}", desk())

    assert source.poll()[0].x_px == {"left": 640.0, "right": 600.0}[eye]
    assert source.info().notes == (f"r.asc: its {eye} eye is replayed",)


def test_an_eye_that_is_not_in_the_file_is_refused(tmp_path):
    file = asc(tmp_path)

    with pytest.raises(StudyError, match=r"must hold the right eye .has the left one."):
        load_recording(file, "right")
    with pytest.raises(StudyError, match=r"eye=left\|right"):
        open_gaze(f"replay:{file},eye=both", desk())


def test_a_file_of_the_right_eye_alone_and_numbers_for_lost_eyes_are_read(tmp_path):
    file = asc(tmp_path, samples="SAMPLES\tGAZE\tRIGHT\tRATE\t 500.00", lost_from=100)
    file.write_text(file.read_text().replace(".\t.\t0.0", "-32768.0\t-32768.0\t0.0"))
    recording = load_recording(file).on_screen(WIDE, HIGH)

    assert recording.x_px[0] == 640
    assert math.isnan(recording.x_px[100])


@pytest.mark.parametrize(
    ("x", "y", "right"),
    [
        ((600.0, 700.0), (400.0, 600.0), True),
        ((0.0, 10.0), (0.0, 1024.0), True),  # along an edge
        ((0.2, 0.8), (0.3, 0.7), False),  # shares of the screen
        ((-1.0, 1.0), (-0.9, 0.9), False),
        ((-14.0, 14.0), (-11.0, 11.0), False),  # degrees
        ((-600.0, 600.0), (-400.0, 400.0), False),  # from the middle
        ((4000.0, 9000.0), (2000.0, 6000.0), False),  # HREF, raw
        ((math.nan, math.nan), (math.nan, math.nan), False),
    ],
)
@pytest.mark.parametrize("kind", ["asc", "csv"])
def test_numbers_that_are_no_pixels_of_the_display_are_refused(tmp_path, kind, x, y, right):
    places = np.column_stack([np.linspace(*x, 50), np.roll(np.linspace(*y, 50), 17)])
    file = tmp_path / f"g.{kind}"
    if kind == "csv":
        rows = [f"{at / 500:.4f},{px},{py}" for at, (px, py) in enumerate(places)]
        file.write_text("\n".join(["t_s,x_px,y_px", *rows]).replace("nan", ""))
    else:
        rows = [f"{1000 + 2 * at} {px} {py} 800" for at, (px, py) in enumerate(places)]
        file.write_text("\n".join(["START 1000", *rows, "END 3000"]))
    recording = load_recording(file)

    if right:
        assert recording.on_screen(WIDE, HIGH).notes == ()
        return
    with pytest.raises(StudyError, match=r"from the upper left corner|lost in every sample"):
        recording.on_screen(WIDE, HIGH)


def test_real_recordings_are_of_their_own_display_without_a_note(shared_data):
    for name, size in (
        ("eyelink_mono500", (1024, 768)),
        ("eyelink_bino500", (1024, 768)),
        ("eyeris_memory_1000hz", (1920, 1080)),
    ):
        recording = load_recording(shared_data / "gaze" / f"{name}.asc.gz")
        assert recording.on_screen(*size).notes == ()
    bino = shared_data / "gaze" / "eyelink_bino500.asc.gz"
    left, right = load_recording(bino, "left"), load_recording(bino, "right")
    assert (left.x_px[0], left.y_px[0]) == (504.5, 367.1)
    assert (right.x_px[0], right.y_px[0]) == (508.0, 399.5)


def desk() -> TrackerContext:
    display: Display = load_display("fhd27-60hz").model_copy(
        update={"width_px": WIDE, "height_px": HIGH}
    )
    return TrackerContext(display, lambda: 0.0, lambda: (0.0, 0.0), 60.0)
