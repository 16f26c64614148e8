"""The presenter's parts that need no window."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from attack.captured_flips import CapturedPicture, compare
from hypothesis import given
from hypothesis import strategies as st

from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.journal import Attempt, Withdrawal
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from protocols.script import Dot, Words
from study_app.desktop.keys import key_name
from study_app.desktop.monitor import check_mode
from study_app.desktop.strip import BLOCK_PX, BLOCKS, code_of, crc8, read_both_strips, read_strip
from study_app.desktop.vsync import judge
from study_app.desktop.vsync import summarise_flips as summarise_stamps
from study_app.gaze.lsl import LslSpec
from study_app.gaze.simulated import SimulatedGaze
from study_app.gaze.source import CalibrationResult, GazeSample
from study_app.gaze.validation import (
    nine_points_px,
    point_quality,
    smallest_window_deg,
    summarise_targets,
    unfit_gaze,
    validate,
)
from study_app.operator_view import attempt_line, rows, standing
from study_app.pages import PageLayout, words_image
from study_app.paint import target_image
from study_app.session_folders import find_sessions, next_slot, withdraw
from study_app.stage import Page
from study_app.text_image import (
    UnwritableError,
    is_right_to_left,
    text_image,
    typeface_for,
    wrap,
    writable,
)
from study_app.virtual import VirtualClock

FHD = load_display("fhd27-60hz")
GAZE = load_protocol(Path("demo")).gaze


def drawn(number: int) -> np.ndarray:
    bits = "10" + f"{code_of(number):032b}"
    return np.repeat([255 * int(bit) for bit in bits], BLOCK_PX).astype(np.uint8)


def test_the_crc_is_the_published_one():
    assert crc8(b"123456789") == 0xF4  # CRC-8/SMBUS check value


@given(st.integers(0, 2**24 - 1), st.integers(0, 33))
def test_a_strip_reads_back_and_no_single_wrong_block_passes(number, wrong):
    row = drawn(number)
    assert read_strip(row) == number

    row[wrong * BLOCK_PX : (wrong + 1) * BLOCK_PX] ^= 255

    assert read_strip(row) is None
    assert len(row) == BLOCKS * BLOCK_PX


def test_both_strips_are_read_at_the_edges_and_must_agree():
    screen = np.full((40, BLOCKS * BLOCK_PX + 9), 128, np.uint8)
    strips = (screen[:BLOCK_PX, :-9], screen[-BLOCK_PX:, :-9])
    for upper, lower, read in ((7, 7, 7), (8, 7, None), (7, 8, None), (8, 8, 8)):
        for strip, number in zip(strips, (upper, lower), strict=True):
            strip[:] = drawn(number)
        assert read_both_strips(screen) == read

    strips[0][:] = 128
    assert read_both_strips(screen) is None


def test_comparing_names_every_flip_that_differs_and_no_other():
    names = {"a": "clip/0", "b": "clip/1", "c": "clip/2"}
    logged = {7: None, 8: "clip/0", 9: "clip/1", 10: "clip/2", 11: None}
    right = [
        CapturedPicture(7, "x"),
        CapturedPicture(8, "a"),
        CapturedPicture(9, "b"),
        CapturedPicture(10, "c"),
        CapturedPicture(11, "y"),
    ]

    assert compare(logged, right, names) == []
    assert [str(d) for d in compare(logged, [right[0], *right[2:]], names)] == [
        "flip 8: must show clip/0 (found no such flip)"
    ]
    swapped = [right[0], CapturedPicture(8, "b"), CapturedPicture(9, "a"), *right[3:]]
    assert [(d.number, d.found) for d in compare(logged, swapped, names)] == [
        (8, "clip/1"), (9, "clip/0")
    ]  # fmt: skip
    out_of_order = [right[0], right[2], right[1], *right[3:]]
    assert [(d.number, d.found) for d in compare(logged, out_of_order, names)] == [
        (9, "the flip after a later one")
    ]


def differences(logged, captured, **more):
    names = {"a": "clip/0", "b": "clip/1", "c": "clip/2"}
    return [(d.number, d.found) for d in compare(logged, captured, names, **more)]


def test_what_was_shown_besides_the_log_is_named():
    """5 and 6 are of a page, 7 to 11 of an attempt, 12 of the wait after it."""
    logged = {7: None, 8: "clip/0", 9: "clip/1", 10: "clip/2", 11: None}
    page = [CapturedPicture(5, "p"), CapturedPicture(6, "q")]
    right = [
        CapturedPicture(7, "x"),
        CapturedPicture(8, "a"),
        CapturedPicture(9, "b"),
        CapturedPicture(10, "c"),
        CapturedPicture(11, "y"),
    ]
    wait = [CapturedPicture(12, "p")]
    assert differences(logged, [*page, *right, *wait]) == []
    assert differences(logged, [*page, page[-1], *right, *wait]) == []  # seen twice at once

    # A flip that the log lacks: within the attempt, or with a clip frame anywhere.
    lacking = {number: frame for number, frame in logged.items() if number != 9}
    assert differences(lacking, [*page, *right, *wait]) == [(9, "clip/1")]
    blank_9 = [*right[:2], CapturedPicture(9, "grey"), *right[3:]]
    assert differences(lacking, [*page, *blank_9]) == []  # could have been a page's
    assert differences(lacking, [*page, *blank_9], attempts=[range(7, 12)]) == [
        (9, "a flip within an attempt")
    ]
    assert differences(logged, [*page, *right, CapturedPicture(12, "b")]) == [(12, "clip/1")]

    # A clip frame where the log says that no clip was shown, and a frame that is as grey as blank.
    leaked = [right[0]._replace(content="c"), *right[1:]]
    assert differences(logged, [*page, *leaked]) == [(7, "clip/2")]
    assert differences(logged, [*page, *leaked], blank={"c"}) == []

    # An old one again: in the attempt, after it, and while the next one is warmed up.
    for place in range(2, len(right) + 1):
        again = [*right[:place], right[0], *right[place:]]
        assert (7, f"the flip again, after {right[place - 1].number}") in differences(
            logged, [*page, *again, *wait]
        )
    warm = [*page, CapturedPicture(6, "a"), *right]  # drawn to warm up, and seen
    assert differences(logged, warm) == [(6, "the flip again, after 6")]
    assert differences(logged, [page[1], CapturedPicture(4, "p"), *right]) == [
        (4, "an earlier flip after 6")
    ]


def test_intervals_are_summed_up_and_vsync_is_judged():
    steady = [k / 59.94 for k in range(121)]
    measured = summarise_stamps(steady, 60.0)
    assert measured.refresh_hz == pytest.approx(59.94)
    assert (measured.missed, measured.doubled) == (0, 0)
    assert judge(measured, FHD, "fence") == "fence"

    gappy = [k / 60 for k in range(60)] + [k / 60 for k in range(62, 122)]
    assert summarise_stamps(gappy, 60.0).missed == 1
    assert summarise_stamps(gappy, 60.0).refresh_hz == pytest.approx(60.0)

    rng = np.random.default_rng(0)
    shaky = np.cumsum(rng.uniform(0.008, 0.025, 121)).tolist()
    assert judge(summarise_stamps(shaky, 60.0), FHD, "fence") == "unverified"
    with pytest.raises(StudyError, match="every swap must wait for the refresh at 60 Hz"):
        judge(summarise_stamps([k / 2400 for k in range(121)], 60.0), FHD, "fence")


def test_another_mode_is_refused_and_an_unstated_rate_is_not():
    check_mode(FHD, 1920, 1080, 60.0)
    check_mode(FHD, 1920, 1080, 59.0)  # 59.94 Hz, as some systems name it
    check_mode(FHD, 1920, 1080, 0.0)
    for width, height, rate in ((1280, 720, 60.0), (1920, 1080, 75.0), (1920, 1080, 50.0)):
        with pytest.raises(StudyError, match="must run at 1920x1080, 60 Hz"):
            check_mode(FHD, width, height, rate)


def test_the_target_is_bulls_eye_and_cross_hair():
    image = target_image(Dot(diameter_px=24.0, grey=128))
    size = len(image)
    middle = size // 2
    assert size % 2 == 0
    np.testing.assert_array_equal(image, image[::-1])
    np.testing.assert_array_equal(image, image.transpose(1, 0, 2))
    assert image[middle, middle].tolist() == [0, 0, 0, 255]  # inner disc, a third across
    assert image[middle, middle + 8].tolist() == [128, 128, 128, 255]  # the hair
    assert image[middle + 7, middle + 7].tolist() == [0, 0, 0, 255]  # the outer disc
    assert image[0, 0, 3] == 0
    covered = image[..., 3].sum() / 255
    assert covered == pytest.approx(math.pi * 12**2, rel=2e-3)


def test_validation_measures_accuracy_and_precision_in_degrees():
    viewing = Viewing.of(FHD)
    target = viewing.to_px(3.0, -2.0)
    # Gaze alternates 0.1 deg left and right of a place 0.5 deg below the target.
    samples = [
        GazeSample(k / 250, k, *viewing.to_px(3.0 + 0.1 * (-1) ** k, -1.5)) for k in range(50)
    ]
    quality = point_quality(viewing, target, samples)
    assert quality.accuracy_deg == pytest.approx(0.5, rel=0.01)
    assert quality.precision_deg == pytest.approx(0.2, rel=0.01)
    assert quality.samples == 50
    with pytest.raises(StudyError, match="the eye must be seen at every target"):
        summarise_targets([quality, point_quality(viewing, target, [])])


def test_nine_targets_are_shown_and_a_simulated_eye_is_measured_at_each():
    viewing, clock = Viewing.of(FHD), VirtualClock()
    eye = SimulatedGaze(clock, viewing, (0.0, 0.0))
    shown = []

    def look_at(place, duration_s, poll):
        shown.append(place)
        clock.move_to(clock() + duration_s)
        poll()
        return True

    points = validate(eye, viewing, look_at, lambda px: eye.look_at(viewing.to_deg(*px)))

    assert shown[::2] == nine_points_px(viewing)
    assert len(set(shown)) == 9
    assert shown[0] == (960, 540)
    result = summarise_targets(points)
    assert 0.03 < result.accuracy_deg < 0.4  # its jitter and drift
    assert 0.08 < result.precision_deg < 0.13  # sample to sample: 0.05 sqrt(2 axes) sqrt(2)
    assert unfit_gaze(GAZE, result) == ""


def test_a_window_smaller_than_the_accuracy_allows_is_refused():
    poor = CalibrationResult(0.9, 0.4, 9)
    assert smallest_window_deg(poor) == pytest.approx(1.7)
    assert "window_deg = 1.5 must be at least the mean error" in unfit_gaze(GAZE, poor)
    worse = CalibrationResult(1.2, 0.1, 9)
    assert "the mean error must be at most accuracy_max_deg = 1" in unfit_gaze(GAZE, worse)


def test_withdrawal_deletes_everything_but_a_stone_and_frees_the_slot(sample_sessions, tmp_path):
    import shutil

    root = tmp_path / "sessions"
    shutil.copytree(sample_sessions, root)
    assert next_slot(root, "demo") == 2
    folder = root / "demo" / "S001"
    assert len(list(folder.rglob("*"))) > 20

    withdraw(root, "S001", lambda: "2026-01-31T12:00:00Z")

    assert [path.name for path in folder.rglob("*")] == ["journal.jsonl"]
    (stone,) = read_journal(folder / "journal.jsonl").events
    assert isinstance(stone, Withdrawal)
    assert (stone.study, stone.slot) == ("demo", 0)
    assert "S001" not in (folder / "journal.jsonl").read_text()
    assert [s.state for s in find_sessions(root)] == ["withdrawn", "completed"]
    assert next_slot(root, "demo") == 0
    with pytest.raises(StudyError, match="withdrew before"):
        withdraw(root, "S001", lambda: "2026-01-31T12:00:00Z")
    with pytest.raises(StudyError, match="found none"):
        withdraw(root, "S999", lambda: "2026-01-31T12:00:00Z")
    # Killed after the stone and before the rest was gone: called again, it goes on.
    (folder / "gaze").mkdir()
    (folder / "gaze" / "0001.csv").write_text("left")
    assert withdraw(root, "S001", lambda: "2026-01-31T12:00:00Z") == 1
    assert [path.name for path in folder.rglob("*")] == ["journal.jsonl"]


def test_the_operator_sees_the_same_from_the_journal_alone(sample_sessions):
    journal = read_journal(sample_sessions / "demo" / "S001" / "journal.jsonl")
    now = standing(journal.events)
    assert (now.done, now.planned, now.ended) == (24, 24, "completed")
    table = dict(rows(journal.events))
    assert table["decisions"] == "24 of 24"
    assert "SIMULATED" in table["session"]
    last = [event for event in journal.events if isinstance(event, Attempt)][-1]
    assert attempt_line(last, journal.events).startswith("24/24")


def test_lines_fit_and_break_where_the_script_allows():
    face = typeface_for(["Some words of text"], 20)
    lines = wrap("Some words of text, long enough to need more than one line.\n\nEnd.", face, 200)
    from PIL import ImageFont

    font = ImageFont.truetype(face.path, 20)
    assert max(font.getlength(line) for line in lines) <= 200
    assert lines[-2:] == ["", "End."]
    assert " ".join(lines[:-2]) == "Some words of text, long enough to need more than one line."


@pytest.mark.parametrize(
    ("text", "right"), [("Привет", False), ("שלום לכולם", True), ("مرحبا بكم", True)]
)
def test_other_scripts_are_drawn_and_run_their_own_way(text, right):
    try:
        face = typeface_for([text], 32)
    except StudyError as error:
        pytest.skip(str(error))
    assert is_right_to_left(text) is right
    image = text_image([text], face, 600)
    columns = np.nonzero(image[..., 3].any(axis=0))[0]
    assert bool(columns.min() > 300) is right
    if text.startswith("م"):  # joined letters are narrower than letters one by one
        apart = text_image(["\u200c".join(text)], face, 600)
        assert not np.array_equal(image, apart)


def test_what_no_font_can_draw_is_shown_as_a_question_mark_and_no_other_character():
    assert writable("Edges, \U000131a3 2", "What?|") == "Edges, ? 2"
    assert writable("Edges, é 2", "What?|") == "Edges, é 2"


def test_choices_have_marks_in_fonts_without_circles(monkeypatch):
    from study_app import pages as module

    texts = load_protocol(Path("demo")).text.languages["en"]
    page = Page("question", texts.questions[1].text, (), choices=texts.questions[1].choices)
    made = PageLayout((640, 480), texts.key_names, 128)
    with_circles = made.question(page, "", 1).image()

    def no_circles(wanted, size_px):
        if "○" in "".join(wanted):
            raise UnwritableError("text: one font must hold every character")
        return typeface_for(wanted, size_px)

    monkeypatch.setattr(module, "typeface_for", no_circles)
    chosen, open_ = made.question(page, "", 1).image(), made.question(page, "", -1).image()
    assert not np.array_equal(chosen, with_circles)
    assert not np.array_equal(chosen, open_)


def test_short_pages_stand_in_the_middle_and_long_questions_above_the_answers():
    protocol = load_protocol(Path("demo"))
    texts = protocol.text.languages["en"].model_copy(update={"question": "Which one? " * 30})
    made = PageLayout((640, 480), texts.key_names, 128)
    columns = np.nonzero(made.page("Thank you.").image()[..., 3].any(axis=0))[0]
    assert columns.min() + columns.max() == pytest.approx(639, abs=4)

    words = Words(
        size_px=(640, 480), background=128, text=texts.question, labels=("a", "b"), keys=("←", "→")
    )
    answer = words_image(words)
    empty = ~answer[..., 3].any(axis=1)
    assert empty[round(0.47 * 480) + 1 : 240].all()  # between the question and the labels
    assert answer[: round(0.47 * 480), :, 3].any()


def test_keys_are_named_as_protocols_name_them():
    import glfw

    plain = SimpleNamespace(**{n: getattr(glfw, n) for n in dir(glfw) if n.startswith("KEY_")})
    plain.get_key_name = lambda key, _code: {glfw.KEY_Q: "a", glfw.KEY_SEMICOLON: "ö"}.get(key)
    assert key_name(plain, glfw.KEY_LEFT, 0) == "left"
    assert key_name(plain, glfw.KEY_KP_4, 0) == "kp_4"
    assert key_name(plain, glfw.KEY_F12, 0) == "f12"
    assert key_name(plain, glfw.KEY_Q, 0) == "a"  # a French keyboard
    assert key_name(plain, glfw.KEY_J, 0) == "j"  # no name known: the American one
    assert key_name(plain, glfw.KEY_SEMICOLON, 0) == ""


def test_a_gamepad_button_presses_once_until_it_is_released():
    import glfw

    from study_app.desktop.keys import Gamepad

    buttons = [0] * 15
    fake = SimpleNamespace(
        **{n: getattr(glfw, n) for n in dir(glfw) if n.startswith(("GAMEPAD_", "JOYSTICK_"))},
        joystick_is_gamepad=lambda _: True,
        get_gamepad_state=lambda _: SimpleNamespace(buttons=buttons),
    )
    pad, pressed = Gamepad(fake), []
    for down in (1, 1, 0, 1):
        buttons[glfw.GAMEPAD_BUTTON_A] = down
        pad.poll(pressed.append)
    assert pressed == ["pad_a", "pad_a"]


def test_a_stream_is_named_with_its_channels_or_refused():
    assert LslSpec.parse("") == LslSpec()
    assert LslSpec.parse("Tobii,x=3,y=gaze_y,unit=norm") == LslSpec("Tobii", "3", "gaze_y", "norm")
    with pytest.raises(StudyError, match="lsl:NAME,x=CHANNEL"):
        LslSpec.parse("Tobii,rate=3")


def test_flip_logs_name_the_frame_and_what_vouches_for_the_stamp(sample_sessions):
    import csv

    folder = sample_sessions / "demo" / "S001"
    journal = read_journal(folder / "journal.jsonl")
    with (folder / journal.attempts[0].flips_file.file).open() as file:
        flips = list(csv.DictReader(file))
    assert {row["evidence"] for row in flips} == {"virtual"}
    assert all((len(row["frame_sha256"]) == 64) == bool(row["clip_frame"]) for row in flips)
    assert [int(row["flip"]) for row in flips] == list(
        range(int(flips[0]["flip"]), int(flips[0]["flip"]) + len(flips))
    )
