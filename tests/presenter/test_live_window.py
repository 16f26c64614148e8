"""`metamerlab live` in a real window on a virtual screen."""

import signal
import threading

import numpy as np
import pytest
from PIL import Image
from skimage import data

from study_app.live.log import LiveChoice, LiveEnd, LiveFlip, read_log

pytestmark = pytest.mark.slow
EDGE = 128


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "picture.png"
    Image.fromarray(np.ascontiguousarray(data.astronaut()[:EDGE, 128 : 128 + EDGE])).save(path)
    return path


@pytest.fixture
def display(start_study):
    return start_study().folder / "little.toml"


def arguments(picture, display, log, *more):
    return ["live", picture, "--display", display, "--software-pacing", "--record", log, *more]


def lines(log):
    return read_log(log).lines if log.exists() and log.stat().st_size else ()


def test_keys_change_what_is_shown_and_the_log_draws_it_again(screen, picture, display, wait):
    log = picture.with_name("seen.jsonl")
    screen.point(320, 240)
    process = screen.start(*arguments(picture, display, log, "-m", "blur", "-m", "metamer"))

    def choices():
        return [line for line in lines(log) if isinstance(line, LiveChoice)]

    def seeds():
        return {line.seed for line in lines(log) if isinstance(line, LiveFlip)}

    def gazes():
        return {line.gaze_px for line in lines(log) if isinstance(line, LiveFlip)}

    wait(lambda: 0 in seeds(), "the first frame", process=process)
    screen.point(330, 250)
    there = 330 - (640 - EDGE) / 2, 250 - (480 - EDGE) / 2
    wait(lambda: there in gazes(), "the gaze where the mouse is", process=process)
    screen.keys("m")
    wait(lambda: len(choices()) == 2, "another method", process=process)
    screen.keys("l")
    wait(lambda: len(choices()) == 3, "another law", process=process)
    screen.keys("s", "o")
    wait(lambda: 1 in seeds(), "another seed", process=process)
    screen.keys("Escape")
    out, err = process.communicate(timeout=60)

    assert process.returncode == 0, out + err
    assert [(c.described.method, c.described.parameters) for c in choices()] == [
        ("blur", {}), ("metamer", {}), ("metamer", {"law": "v2"})
    ]  # fmt: skip
    end = lines(log)[-1]
    assert isinstance(end, LiveEnd)
    assert end.latency.words() in out
    assert end.latency.frames == end.flips > 0

    done = screen.run("live", picture, "--verify", log)
    drawn = sum(line.pixels is not None for line in lines(log) if isinstance(line, LiveFlip))
    assert f"{end.flips} flips, {drawn} drawn again: {drawn} bit-equal" in done.stdout
    assert drawn >= 3

    with Image.open(picture) as image:
        image.transpose(Image.Transpose.FLIP_LEFT_RIGHT).save(picture)
    done = screen.run("live", picture, "--verify", log, status=2)
    assert "must be the source of" in done.stderr


def test_a_killed_program_leaves_a_log_that_is_whole_and_the_screen_had_the_picture(
    screen, picture, display, wait
):
    log = picture.with_name("killed.jsonl")
    process = screen.start(*arguments(picture, display, log, "-m", "reference"))
    wait(lambda: len(lines(log)) > 5, "frames", process=process)
    left, top = (640 - EDGE) // 2, (480 - EDGE) // 2
    with Image.open(picture) as image:
        wanted = np.asarray(image)
    wait(
        lambda: (
            np.array_equal(screen.picture()[top : top + EDGE, left : left + EDGE], wanted)
            or np.abs(screen.picture()[top : top + EDGE, left : left + EDGE] - wanted).mean() < 3
        ),
        "the picture on the screen",
        process=process,
    )
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=30)

    assert "was not closed" in read_log(log).notes[-1]
    done = screen.run("live", picture, "--verify", log)
    assert "note: the log was not closed: the program was killed" in done.stdout


def test_the_overlay_draws_rings_around_the_gaze_and_goes_again(screen, picture, display, wait):
    log = picture.with_name("rings.jsonl")
    screen.point(300, 230)
    process = screen.start(*arguments(picture, display, log, "-m", "reference", "--overlay"))

    def yellow():
        pixels = screen.picture().astype(int)
        return int((pixels[..., 0] - pixels[..., 2] > 120).sum())

    wait(lambda: len(lines(log)) > 5 and yellow() > 200, "rings", process=process)
    before = yellow()
    screen.keys("o")
    wait(lambda: yellow() < before - 150, "no rings", process=process)
    screen.keys("Escape")
    process.communicate(timeout=60)

    assert process.returncode == 0


def test_mistakes_get_one_message_before_a_window_opens(screen, picture, display, tmp_path):
    (tmp_path / "there.jsonl").write_text("kept")
    for more, message in (
        (("--record", tmp_path / "there.jsonl"), "must be a new file"),
        (("--record", tmp_path / "log.csv"), "must end in .jsonl"),
        (("-m", "noise-enhanced"), "must be one of reference, blur, metamer"),
        (("--gaze", "mous"), "did you mean 'mouse'"),
        (("--change", "in-saccades"), "must be one of always, during-saccades"),
        (("--panorama",), "must be twice as wide as high"),
        (("--head", "lsl"), "add --panorama, or leave --head out"),
        (("--head", "tobii"), "--head: must be one of lsl"),
        (("--fps", "25"), "is for a folder of frames or a video"),
        (("--verify", "x.jsonl"), "leave other options out"),
    ):
        done = screen.run(
            "live", picture, "--display", display, "--software-pacing", *more, status=2
        )
        assert message in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr
    assert (tmp_path / "there.jsonl").read_text() == "kept"


def test_gaze_that_is_too_slow_for_saccades_is_refused_and_no_log_begun(screen, picture, display):
    tape, log = picture.with_name("slow.csv"), picture.with_name("log.jsonl")
    tape.write_text("t_s,x_px,y_px\n" + "".join(f"{k / 10},100,100\n" for k in range(20)))

    done = screen.run(
        *arguments(picture, display, log, "--gaze", f"replay:{tape}"),
        "--change", "during-saccades", status=2
    )  # fmt: skip

    assert "needs gaze of at least 20 Hz (got 10 Hz)" in " ".join(done.stderr.split())
    assert not log.exists()


def test_a_head_over_lsl_turns_a_panorama_and_its_log_is_drawn_again(
    screen, picture, display, wait
):
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed (extra lsl)")
    Image.fromarray(np.ascontiguousarray(data.astronaut()[:64, :128])).save(picture)
    log, name = picture.with_name("head.jsonl"), f"head-{picture.parent.name}"
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo(name, "Mocap", 3, 0, "float32", name))
    stop, yaw_deg = threading.Event(), [10.0]

    def send() -> None:
        while not stop.wait(0.01):
            outlet.push_sample([yaw_deg[0], 0.0, 0.0])

    sender = threading.Thread(target=send)
    sender.start()

    def turns():
        return [line.turned_deg for line in lines(log) if isinstance(line, LiveFlip)]

    try:
        process = screen.start(
            *arguments(picture, display, log, "-m", "reference"),
            "--panorama", "--head", f"lsl:{name}",
        )  # fmt: skip
        wait(lambda: (0.0, 0.0) in turns(), "the first pose", process=process)
        yaw_deg[0] = 40.0
        wait(lambda: (30.0, 0.0) in turns(), "the panorama turned", process=process)
        screen.keys("Escape")
        out, err = process.communicate(timeout=60)
    finally:
        stop.set()
        sender.join()
    assert process.returncode == 0, out + err
    last = [line for line in lines(log) if isinstance(line, LiveFlip)][-1]
    assert 0 < last.head_age_s < 5
    assert lines(log)[0].head == f"lsl:{name}"
    screen.run("live", picture, "--verify", log)
