"""Every mistake before and during a windowed session: one message, status 2, nothing lost."""

import os
import re

import forked
import pytest

from protocols.journal import SessionEnd


def error_of(done) -> str:
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    (message,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return message


def test_a_missing_frame_is_told_before_a_window_opens(screen, make_study):
    study = make_study()
    (study.stimuli / "garden__small__metameric" / "000003.png").unlink()

    message = error_of(screen.run(*screen.session("run", study, "--simulate"), status=None))

    assert "missing 1: garden__small__metameric/000003.png" in message
    assert not study.sessions.exists()


def test_a_changed_frame_stops_the_session_cleanly_and_it_goes_on_when_restored(screen, make_study):
    study = make_study({"pairings": '[["metameric", "push-pull"]]', "repeats": "1"})
    frame = study.stimuli / "garden__small__metameric" / "000003.png"
    kept = frame.read_bytes()
    frame.write_bytes(kept[:-1] + b"\0")

    message = error_of(screen.run(*screen.session("run", study, "--simulate"), status=None))

    assert f"{frame}: must be the frame that was hashed" in message
    last = study.journal().events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "error"
    assert "must be the frame that was hashed" in last.message

    frame.write_bytes(kept)
    screen.run(*screen.session("resume", study, "--simulate"))
    assert [a.outcome for a in study.journal().attempts] == ["completed"]


def test_what_cannot_be_shown_or_watched_is_refused_with_its_cure(screen, make_study):
    study = make_study()
    little = study.folder / "little.toml"
    good = little.read_text()

    little.write_text(good + 'monitor = "DP-9"\n')
    message = error_of(screen.run(*screen.session("run", study, "--simulate"), status=None))
    assert "monitor 'DP-9' must be connected (found screen)" in message

    little.write_text(good.replace("= 640", "= 800").replace("= 192.0", "= 240.0"))
    message = error_of(screen.run(*screen.session("run", study, "--simulate"), status=None))
    assert "must run at 800x480, 60 Hz, not scaled (found 640x480" in message
    little.write_text(good)

    arguments = screen.session("run", study, "--simulate")
    arguments.remove("--software-pacing")
    message = error_of(screen.run(*arguments, status=None))
    assert "every swap must wait for the refresh at 60 Hz (found" in message
    assert "--software-pacing" in message

    message = error_of(screen.run(*screen.session("run", study, "--gaze", "mouse"), status=None))
    assert "gaze.mode = 'none'" in message
    assert not (study.sessions / "demo").exists()


def test_no_language_and_a_text_that_is_too_long_are_refused_before_a_window_opens(
    screen, make_study
):
    study = make_study()
    message = error_of(
        screen.run(*screen.session("run", study, "--simulate", "--language", ""), status=None)
    )
    assert "language: must be one of en" in message
    assert "(got '')" in message

    text = study.path.read_text()
    study.path.write_text(re.sub(r'^thanks = "', 'thanks = "' + "word " * 2000, text, flags=re.M))
    done = screen.run(*screen.session("run", study, "--simulate"), status=None)
    error_of(done)
    assert "text.languages.en.thanks: must fit on 640x480 pixels" in " ".join(done.stderr.split())
    assert not study.sessions.exists()


# What a window manager does that shows a title bar first, and what a desktop does that scales.
FRAMED = """
import sys
from study_app.desktop import window
from study_app.cli import main
answers = [(638, 455)] * (10**6 if "scaled" in sys.argv else 5)
size = window.glfw.get_framebuffer_size
window.glfw.get_framebuffer_size = lambda handle: answers.pop() if answers else size(handle)
window._SETTLE_S = 0.5
sys.argv = [entry for entry in sys.argv if entry != "scaled"]
main()
"""


def test_a_window_is_given_time_to_cover_the_screen(screen, make_study):
    study = make_study({"pairings": '[["metameric", "push-pull"]]', "repeats": "1"})
    arguments = screen.session("run", study, "--simulate")

    scaled = screen.try_script(FRAMED, *arguments, "scaled")
    screen.script(FRAMED, *arguments)

    assert "must have 640x480 pixels (got 638x455)" in error_of(scaled)
    assert [attempt.outcome for attempt in study.journal().attempts] == ["completed"]


def test_no_screen_is_one_message(make_study, screen):
    study = make_study()
    blind = {**os.environ, "DISPLAY": ":987"}
    blind.pop("WAYLAND_DISPLAY", None)

    done = forked.run(*screen.session("run", study), env=blind, timeout=60)

    assert "the window needs a screen (found none: DISPLAY=':987')" in error_of(done)


@pytest.mark.parametrize("source", ["lsl:nobody-sends-this"])
def test_an_absent_tracker_is_refused_before_anything_is_written(screen, make_study, source):
    pytest.importorskip("pylsl", reason="pylsl is not installed (extra lsl)")
    study = make_study({"mode": '"enforce"'})

    assert "--gaze: this protocol needs a gaze source" in error_of(
        screen.run(*screen.session("run", study), status=None)
    )
    message = error_of(screen.run(*screen.session("run", study, "--gaze", source), status=None))
    assert "a stream with name 'nobody-sends-this' must be on the network" in message
    assert not (study.sessions / "demo").exists()


MEMORY = """
import sys
from study_app import clips
from study_app.cli import main
class Free:
    available = 100_000
clips.psutil.virtual_memory = lambda: Free
main()
"""


def test_too_little_memory_for_two_pairs_is_refused(screen, make_study):
    study = make_study()

    done = screen.run(*screen.session("run", study, "--simulate"), code=MEMORY, status=None)

    assert "graphics memory must hold the stimuli of two trials" in error_of(done)
    assert not (study.sessions / "demo").exists()


def test_the_frame_strip_and_patch_are_refused_where_they_would_cover_a_clip(screen, make_study):
    study = make_study({"width_deg": "18.0", "height_deg": "13.6"})

    assert "--strip: the frame strip needs 272x8 pixels" in error_of(
        screen.run(*screen.session("run", study, "--strip"), status=None)
    )
    assert "--photodiode: the patch needs 48 pixels" in error_of(
        screen.run(*screen.session("run", study, "--photodiode"), status=None)
    )


def test_a_text_that_no_font_can_write_names_the_characters(screen, make_study):
    study = make_study()
    text = study.path.read_text().replace("Now the real trials begin.", "\U000131a3 and so on")
    study.path.write_text(text)

    # Texts are no part of what decides the pixels, so the clips still fit.
    done = screen.run(*screen.session("run", study, "--simulate"), status=None)

    assert "one font must hold every character" in error_of(done)
    assert not study.sessions.exists()  # told before anything was shown
