"""`metamerlab foveate` on a folder of frames: noise on the screen, and carried along."""

import numpy as np
import pytest
from command_line import refusal_of, result_of
from number_files import write_flo

from pipeline.foveation.conditions import foveate
from pipeline.foveation.steady_gaze import carried
from pipeline.pictures.colour_file import save_colour
from pipeline.pictures.decode import read_pixels
from stimuli.media.gaze_and_display import StatedViewing

HEIGHT, WIDTH = 40, 56
run = result_of("foveate", "--numpy", catch_exceptions=False)
refusal = refusal_of("foveate", "--numpy")


@pytest.fixture
def colours(rng):
    """A texture that moves by 3 px to the right from frame to frame."""
    wide = (rng.integers(60, 200, (HEIGHT, WIDTH + 9, 3)) / np.float32(255)).astype(np.float32)
    return [np.ascontiguousarray(wide[:, 9 - 3 * k : 9 - 3 * k + WIDTH]) for k in range(3)]


@pytest.fixture
def frames(tmp_path, colours):
    (tmp_path / "frames").mkdir()
    for index, colour in enumerate(colours):
        save_colour(tmp_path / "frames" / f"f{index}.png", colour)
    return tmp_path / "frames"


@pytest.fixture
def flow(tmp_path):
    (tmp_path / "flow").mkdir()
    moved = np.broadcast_to(np.float32([3, 0]), (HEIGHT, WIDTH, 2))
    for index in (1, 2):
        write_flo(tmp_path / "flow" / f"f{index}.flo", moved)
    return tmp_path / "flow"


def shown(folder):
    return [read_pixels(path).data / 255 for path in sorted(folder.iterdir())]


def test_frames_without_flow_share_the_noise_of_the_screen(frames, tmp_path, colours):
    result = run(frames, tmp_path / "out", "--seed", 4)

    assert "3 frames, 56 x 40 px" in result.stdout
    assert "noise lies on the screen" in result.stdout
    for found, colour in zip(shown(tmp_path / "out"), colours, strict=True):
        wanted = foveate(colour, (28, 20), seed=4)
        np.testing.assert_allclose(found, wanted, atol=0.51 / 255)


def test_a_video_is_never_written_over_itself(frames, tmp_path):
    video = tmp_path / "walk.avi"
    run(frames, tmp_path / "one", "--video", video)
    before = video.read_bytes()

    assert "is read by this command" in refusal(video, tmp_path / "two", "--video", video)
    assert video.read_bytes() == before


def test_frames_never_join_others(frames, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "f1.png").write_bytes(b"somebody's")

    assert "must be empty or new" in refusal(frames, tmp_path / "out")
    assert [path.read_bytes() for path in (tmp_path / "out").iterdir()] == [b"somebody's"]


def test_a_clip_is_written_whole_or_not_at_all(frames, tmp_path):
    (frames / "f2.png").write_bytes((frames / "f2.png").read_bytes()[:-90])
    (tmp_path / "there").mkdir()

    for folder in ("there", "new"):
        assert "f2.png: must be a" in refusal(frames, tmp_path / folder)
    assert not list((tmp_path / "there").iterdir())
    assert not (tmp_path / "new").exists()


def test_a_video_that_cannot_be_written_is_refused_before_the_work(tmp_path, colours):
    (tmp_path / "odd").mkdir()
    save_colour(tmp_path / "odd" / "f0.png", colours[0][:-1])

    error = refusal(tmp_path / "odd", tmp_path / "out", "--video", tmp_path / "odd.mp4")
    assert "needs even edges" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("method", ["metamer", "eidolon"])
def test_noise_goes_along_the_flow(frames, flow, tmp_path, colours, method):
    result = run(frames, tmp_path / "out", "--flow", flow, "-m", method)

    assert "noise is carried along the flow" in result.stdout
    shift = None
    found = shown(tmp_path / "out")
    for index, (picture, colour) in enumerate(zip(found, colours, strict=True)):
        if index:
            shift = carried(shift, np.broadcast_to([3.0, 0.0], (HEIGHT, WIDTH, 2)))
        wanted = foveate(colour, (28, 20), noise_shift_px=shift, method=method)
        np.testing.assert_allclose(picture, wanted, atol=0.51 / 255)
    assert (shift[..., 0] == 6).all()


def test_what_is_no_clip_is_refused(frames, flow, tmp_path, colours):
    (tmp_path / "empty").mkdir()
    assert "must hold frames" in refusal(tmp_path / "empty", tmp_path / "o")
    (tmp_path / "empty" / "IMG_1.HEIC").write_bytes(b"")
    (tmp_path / "empty" / "f0.png").write_bytes(b"")
    assert "no HEIC pictures" in refusal(tmp_path / "empty", tmp_path / "o")
    assert "the frames themselves" in refusal(frames, frames)
    assert "OUT must be a folder" in refusal(frames, tmp_path / "o.png")
    assert "--compare takes one picture" in refusal(frames, "--compare", tmp_path / "s.png")
    assert "folder of frames" in refusal(frames / "f0.png", tmp_path / "o.png", "--flow", flow)
    (flow / "f1.flo").unlink()
    assert "1 of 2 missing, the first is f1.flo" in refusal(frames, tmp_path / "o", "--flow", flow)
    assert not (tmp_path / "o").exists()
    save_colour(frames / "f1.png", colours[0][:20])
    assert "f1.png: must be as large as the first frame, 56 x 40 px" in refusal(
        frames, tmp_path / "o"
    )


def test_flow_of_another_size_is_refused(frames, flow, tmp_path):
    write_flo(flow / "f2.flo", np.zeros((8, 9, 2), np.float32))
    assert "f2.flo: must be 56 x 40 px" in refusal(frames, tmp_path / "o", "--flow", flow)


def test_a_table_moves_the_gaze_from_frame_to_frame_and_the_field_rests(frames, tmp_path, colours):
    table = tmp_path / "gaze.csv"
    table.write_text("x_px,y_px\n10,10\n,\n10.5,10\n")
    result = run(frames, tmp_path / "out", "--gaze", table, "-m", "eidolon", status=None)

    assert "a gaze per frame, held in 1 in which the eye was lost" in result.stdout
    gazes = [(10, 10), (10, 10), (10.5, 10)]
    for picture, colour, gaze in zip(shown(tmp_path / "out"), colours, gazes, strict=True):
        wanted = foveate(colour, gaze, method="eidolon", field_gaze_px=(10, 10))
        np.testing.assert_allclose(picture, wanted, atol=0.51 / 255)


def test_a_recording_is_replayed_as_a_screen_shows_the_frames(frames, tmp_path, colours):
    tape = tmp_path / "eye.csv"
    samples = ("0,942,530", "0.02,950,540", "0.05,nan,nan", "0.06,960,550")
    tape.write_text("\n".join(("t_s,x_px,y_px", *samples)))
    asked = ("--gaze", f"replay:{tape}", "--display", "fhd27-60hz")
    result = run(frames, tmp_path / "out", *asked, "-m", "blur")

    assert "its last gaze is held" not in result.stdout
    viewing = StatedViewing(display="fhd27-60hz").of((HEIGHT, WIDTH)).viewing
    gazes = [(10, 10), (18, 20), (28, 30)]
    for picture, colour, gaze in zip(shown(tmp_path / "out"), colours, gazes, strict=True):
        wanted = foveate(colour, gaze, method="blur", viewing=viewing)
        np.testing.assert_allclose(picture, wanted, atol=0.51 / 255)
    assert (
        "its last gaze is held"
        in run(frames, tmp_path / "slow", *asked, "--fps", 10, status=None).stdout
    )


def test_the_middle_is_said_where_the_eye_was_not_found_yet(frames, tmp_path, colours):
    table = tmp_path / "gaze.csv"
    table.write_text("x_px,y_px\n,\n,\n10,10\n")
    result = run(frames, tmp_path / "out", "--gaze", table, "-m", "blur", status=None)

    assert "held in 2 in which the eye was lost; in the middle until it was" in result.stdout
    wanted = foveate(colours[0], (WIDTH / 2, HEIGHT / 2), method="blur")
    np.testing.assert_allclose(shown(tmp_path / "out")[0], wanted, atol=0.51 / 255)


def test_gazes_that_do_not_fit_the_frames_are_refused(frames, tmp_path):
    table, out = tmp_path / "gaze.csv", tmp_path / "o"
    table.write_text("x_px,y_px\n1,2\n")
    error = refusal(frames, out, "--gaze", table)
    assert "one line per frame (3 frames, got 1 lines)" in error
    assert f"--gaze replay:{table}" in " ".join(error.split())
    table.write_text("x_px,y_px\n1,2\n1,left\n1,2\n")
    assert "line 3: must be two numbers" in refusal(frames, out, "--gaze", table)
    for half in ("1,", ",1", "1,nan", "1"):
        table.write_text(f"x_px,y_px\n1,2\n{half}\n1,2\n")
        error = " ".join(refusal(frames, out, "--gaze", table).split())
        assert "line 3: must be two numbers" in error
        assert "two empty cells where the eye was lost" in error
    table.write_text("x_px,y_px,x_px\n1,2,3\n1,2,3\n1,2,3\n")
    assert "each once" in refusal(frames, out, "--gaze", table)
    table.write_text("x_px,y_px\n")
    assert "got no line below its header" in " ".join(refusal(frames, out, "--gaze", table).split())
    assert "replay needs a file" in refusal(frames, out, "--gaze", "replay:")
    assert "is for a folder of frames" in refusal(frames / "f0.png", "--gaze", table)
    assert not out.exists()
