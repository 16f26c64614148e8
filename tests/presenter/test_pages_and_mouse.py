"""Every page as it stands on the screen, turned by real keys, in a session watched by the mouse."""

import csv

import pytest
from PIL import Image

from protocols.journal import Answer, Break, Calibration, Note, Pause, SessionEnd
from protocols.make_script import example_scripts, text_picture
from protocols.study_file.session_schema import filled_text
from study_app.pages import PageLayout
from study_app.paint import drawn
from study_app.stage import Page

CENTRE, ASIDE = (320, 240), (60, 400)
# No frame can be read before a file is there: so long the preparing page stands.
HELD_DISK = """
import time
from pathlib import Path
from study_app import clips
from study_app.cli import main
read_frame = clips.read_frame
def when_let(*arguments):
    while not Path({gate!r}).exists():
        time.sleep(0.01)
    return read_frame(*arguments)
clips.read_frame = when_let
main()
"""


@pytest.fixture
def study(make_study):
    return make_study(
        {
            "pairings": '[["metameric", "push-pull"], ["metameric", "reference"]]',
            "repeats": "1",
            "blocks": "2",
            "break_s": "0.6",
            "duration_s": "0.5",
            "fixation_timeout_s": "30.0",
            "timeout_s": "30.0",
            "mode": '"enforce"',
            # The cursor is read once per flip: a busy machine leaves gaps.
            "silence_s": "5.0",
            "loss_max_share": "1.0",
            "max_attempts": "9",
        },
        questions=True,
    )


def events(study, kind):
    return [event for event in study.journal().events if isinstance(event, kind)]


@pytest.mark.slow
def test_each_page_is_seen_and_turned_and_gaze_by_mouse_decides(screen, study, wait, tmp_path):
    texts, response = study.protocol.text.languages["en"], study.protocol.response
    pages = PageLayout((640, 480), texts.key_names, 128)
    script, other = example_scripts(study.protocol, study.display, "en")
    by_name = {phase.name: phase for phase in script.phases}
    fixed = {
        "preparing": drawn(text_picture(study.protocol, study.display, texts.preparing).of, {}),
        "gaze-lost": drawn(by_name["iti"].follows["gaze-break"].of, {}),
    }
    asked = ("answer-first-second", "answer-second-first")
    for name, phases in zip(asked, (script.phases, other.phases), strict=True):
        (shown,) = next(phase for phase in phases if phase.question).show
        fixed[name] = drawn(shown.of, {})
    strategy, vision = texts.questions
    mouse = CENTRE

    def see(image, what):
        assert image[..., 3].any()
        try:
            wait(lambda: screen.shows(image, mouse), f"the page: {what}", process=process)
        except AssertionError:
            Image.fromarray(screen.picture()).save(tmp_path / "seen.png")
            Image.fromarray(image).save(tmp_path / "wanted.png")
            raise

    def turn(image, what, key="space"):
        see(image, what)
        screen.keys(key)

    def clip_is_seen():  # noise; text and the fixation target vary less
        return screen.picture()[210:270, 280:360].std() > 60

    screen.point(*CENTRE)
    gate = tmp_path / "gate"
    process = screen.start(
        *screen.session("run", study, "--gaze", "mouse", "--skip-validation"),
        code=HELD_DISK.format(gate=str(gate)),
    )
    try:
        turn(pages.page(texts.consent, "space").image(), "consent")
        for text in texts.instructions:
            turn(pages.page(text, "space").image(), "instructions")
        turn(pages.page(texts.start, "space").image(), "start")
        see(fixed["preparing"], "preparing")
        gate.touch()

        # Looking away voids the attempt, and the participant is told.
        wait(clip_is_seen, "the first clip")
        mouse = ASIDE
        screen.point(*ASIDE)
        see(fixed["gaze-lost"], "gaze was lost")
        # The line is written right after the flip that was seen.
        (void,) = wait(lambda: study.journal().attempts, "the void attempt's line")
        assert (void.outcome, void.void_reason) == ("void", "gaze-break")
        # The operator follows from another process.
        follower = screen.run(
            "session", "watch", study.sessions / "demo" / "P01", "--once", status=None
        )
        assert "0 of 2" in follower.stdout
        assert "gaze-break" in follower.stdout

        # Without gaze on the dot nothing begins; with it the attempt is decided.
        mouse = CENTRE
        screen.point(*CENTRE)
        wait(lambda: any(screen.shows(fixed[name], mouse) for name in asked), "the answer screen")
        leftmost = "first" if screen.shows(fixed["answer-first-second"], mouse) else "second"
        screen.keys("Left")

        # The break names its key only when the key does something.
        rest = filled_text(texts.break_page, response, done=1, total=2)
        turn(pages.page(rest, "", 1 / 2).image(), "the break, not yet over")
        turn(pages.page(rest, "space", 1 / 2).image(), "the break, over")

        wait(clip_is_seen, "a clip of block 2")
        screen.keys("p")
        turn(pages.page(texts.paused, "space").image(), "pause")
        wait(
            lambda: any(screen.shows(fixed[name], mouse) for name in asked),
            "the second answer screen",
        )
        screen.keys("j")

        question = Page("question", strategy.text, ())
        see(pages.question(question, "", -1).image(), "the typed question")
        screen.type("Edges, 2x")
        screen.keys("BackSpace")
        see(pages.question(question, "Edges, 2", -1).image(), "what was typed")
        screen.keys("Escape")
        turn(pages.page(texts.quit_question).image(), "the question whether to stop")
        turn(
            pages.question(question, "Edges, 2", -1).image(),
            "what was typed, still there",
            "Return",
        )
        choice = Page("question", vision.text, (), choices=vision.choices)
        turn(
            pages.question(choice, "", -1).image(), "the choices", "Return"
        )  # nothing is chosen yet
        screen.keys("Down", "3", "Up")
        turn(pages.question(choice, "", 1).image(), "the choice", "Return")
        see(pages.page(texts.thanks).image(), "thanks")
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()

    assert process.returncode == 0, err
    journal = study.journal()
    assert journal.start.gaze.source == "mouse"
    reasons = [(attempt.void_reason, attempt.key) for attempt in journal.attempts]
    assert reasons == [("gaze-break", None), (None, "left"), ("paused", None), (None, "j")]
    decided = journal.attempts[1]
    assert decided.answers[0] == decided.answer == leftmost
    assert decided.gaze.mean_deg < 0.1
    for attempt, place in ((journal.attempts[0], ASIDE), (decided, CENTRE)):
        with (study.sessions / "demo" / "P01" / attempt.gaze_file.file).open() as file:
            rows = list(csv.DictReader(file))
        assert (float(rows[-1]["x_px"]), float(rows[-1]["y_px"])) == place
    assert {e.question: e.text for e in events(study, Answer)} == {
        "strategy": "Edges, 2", "vision": "glasses"
    }  # fmt: skip
    (rested,) = events(study, Break)
    assert rested.duration_s >= 0.6
    assert len(events(study, Pause)) == 1
    assert not events(study, Calibration)
    assert [e.reason for e in events(study, SessionEnd)] == ["completed"]
    assert "gaze-break" in out
    # Left to follow on, the view ends with the session.
    follower = screen.run("session", "watch", study.sessions / "demo" / "P01")
    assert "2 of 2" in follower.stdout


@pytest.mark.slow
def test_a_recording_is_replayed_into_a_session(screen, make_study, tmp_path):
    study = make_study(
        {
            "pairings": '[["metameric", "push-pull"]]',
            "repeats": "1",
            "fixation_timeout_s": "30.0",
            "mode": '"enforce"',
            "max_attempts": "99",
        }
    )
    # At first the eye leaves the dot too soon for any trial (0.5 s), then it stays.
    until_s, rate_hz = 9.0, 250
    tape = tmp_path / "eye.csv"
    lines = ["t_s,x_px,y_px"]
    for number in range(60 * rate_hz):
        t_s = number / rate_hz
        away = t_s < until_s and t_s % 0.7 > 0.35
        lines.append(f"{t_s:.3f},{320 + 150 * away + number % 3},{240 - number % 2}")
    tape.write_text("\n".join(lines) + "\n", encoding="utf-8")
    replay = ["--gaze", f"replay:{tape}", "--skip-validation"]

    refused = screen.run(*screen.session("run", study, *replay), status=None)
    assert (refused.returncode, "replay needs --simulate" in refused.stderr) == (2, True)
    screen.run(*screen.session("run", study, "--simulate", *replay))

    journal = study.journal()
    assert journal.start.gaze.source == "replay"
    assert journal.start.gaze.rate_hz == pytest.approx(rate_hz)
    *voids, decided = journal.attempts
    assert voids
    assert {attempt.void_reason for attempt in voids} == {"gaze-break"}
    assert decided.answer in ("first", "second")
    stored = [line.split(",") for line in lines[1:]]
    for attempt in journal.attempts:
        with (study.sessions / "demo" / "P01" / attempt.gaze_file.file).open() as file:
            rows = list(csv.DictReader(file))
        assert rows
        first = round(float(rows[0]["raw_t"]) * rate_hz)
        for number, row in enumerate(rows, start=first):  # every sample, in order
            t_s, x_px, y_px = map(float, stored[number])
            assert float(row["raw_t"]) == pytest.approx(t_s, abs=1e-9)
            assert (float(row["x_px"]), float(row["y_px"])) == (x_px, y_px)


@pytest.mark.slow
def test_what_was_assumed_of_a_recording_is_said_and_kept(screen, make_study, tmp_path):
    """As PyGaze writes it: the size of the screen in place of its last pixel; the left eye lost."""
    study = make_study(
        {"pairings": '[["metameric", "push-pull"]]', "repeats": "1", "mode": '"monitor"'}
    )
    tape = tmp_path / "eye.asc"
    both = "\tGAZE\tLEFT\tRIGHT\tRATE\t250.00"
    rows = [f"{4 * at}\t.\t.\t0.0\t{320 + at % 3}.0\t240.0\t800.0\t....." for at in range(15_000)]
    head = ["MSG\t0 GAZE_COORDS 0.00 0.00 640.00 480.00", "START\t0\tLEFT\tRIGHT\tSAMPLES"]
    tape.write_text("\n".join([*head, f"SAMPLES{both}", *rows, "END\t60000"]), encoding="ascii")
    done = screen.run(
        *screen.session("run", study, "--simulate", "--gaze", f"replay:{tape}", "--skip-validation")
    )
    notes = [event.text for event in events(study, Note)]

    for said in ("one more than the last pixel", "the right one is replayed"):
        assert said in " ".join(done.stdout.split() + done.stderr.split())
        assert any(said in note for note in notes)
    assert all(attempt.gaze.lost_share == 0 for attempt in study.journal().attempts)
