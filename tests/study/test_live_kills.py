"""Killed at any step, a live session or log is whole, and all that it recorded is drawn again."""

import re
import signal

import pytest
from attack.live_kills import HEIGHT, WIDTH, chosen, killed, picture, renderer_of, steps_of

from pipeline.gl.context import describe
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_study, shipped
from study_app.cli.pictures.live_renderer import FoveatingStudio
from study_app.live.log import read_log
from study_app.live.redraw import TrialDrawer, redraw
from study_app.session_folders import SessionFolder
from study_app.verification import verify

pytestmark = pytest.mark.slow
KINDS = {"a flip", "capture", "draw", "flip", "journal", "sync", "t_s,"}
LINES = {"start", "choice", "saccade", "flip", "end"}
DISPLAY = """
name = "little"
width_px = 320
height_px = 240
width_mm = 96.0
height_mm = 72.0
distance_mm = 100.0
refresh_hz = 60.0
clip_memory_mib = 64
"""


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a short live study: two pictures of blur, shown for 0.1 s."""
    (tmp_path / "little.toml").write_text(DISPLAY)
    text = shipped("studies")["live-detection"].read_text(encoding="utf-8")
    dropped = r'^  \{ name = "(street|castle|colonnade|tunnel|thicket|notices|reference|ours)[^\n]*'
    text = re.sub(dropped, "", text, flags=re.M)
    text = text.replace("draws = 6", "draws = 1").replace('"balanced"', '"random"')
    text = text.replace('baseline = "ours"', 'baseline = "blur"')
    for key, value in {
        "display": f'"{tmp_path / "little.toml"}"', "width_px": WIDTH, "height_px": HEIGHT,
        "blocks": 1, "stimulus_s": 0.1, "live": 'true\nchange = "during-saccades"',
    }.items():  # fmt: skip
        text, count = re.subn(rf"^{key} = [^#\n]*", f"{key} = {value}", text, flags=re.M)
        assert count, key
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.timeout(1800)  # whole: 105 kills
def test_a_live_session_that_is_killed_at_any_step_is_whole_and_drawn_again(
    gl_context, folder, full, request
):
    steps = steps_of(folder, "session", folder / "whole")
    assert set(steps) == KINDS
    study, display = load_study(folder / "study.toml", None)
    here = describe(gl_context)
    drawer = TrialDrawer(
        gl_context, study, display, virtual_manifest(study, display), lambda _name: picture(),
        FoveatingStudio(gl_context), (here.name, here.version),
    )  # fmt: skip

    request.addfinalizer(drawer.release)

    def proven(root):
        """Hold what was recorded to its hashes, and draw it again; return the journal, if any."""
        there = root / study.study.name / "P01"
        if not (there / "journal.jsonl").exists():
            return None
        journal = read_journal(there / "journal.jsonl", lenient=True)
        assert journal.damaged == ()
        if not journal.events:
            return None
        assert verify(SessionFolder(there, journal), study).problems == ()
        again = drawer.redraw(SessionFolder(there, journal), {})
        assert again.problems == ()
        kept = [one for one in journal.attempts if one.live.ages_ms]
        assert again.drawn == again.equal == len(kept)
        return journal

    attempts = len(proven(folder / "whole").attempts)
    points = chosen(steps, 105 if full else len(KINDS), seed=2)
    died = 0
    for number, (point, part) in enumerate(points):
        root, saved = folder / f"{number // 3}", b""
        journal = root / study.study.name / "P01" / "journal.jsonl"
        if journal.exists():
            saved = journal.read_bytes()
            saved = saved[: saved.rfind(b"\n") + 1]
        status, said = killed(folder, "session", root, point, part)
        assert status in (0, -signal.SIGKILL) or "the session is over" in said, said
        died += status == -signal.SIGKILL
        proven(root)
        assert not saved or journal.read_bytes().startswith(saved)
        if number % 3 == 2 or number == len(points) - 1:
            status, said = killed(folder, "session", root, 0, 1.0)
            assert status == 0 or "the session is over" in said, said
            whole = proven(root)
            assert isinstance(whole.events[-1], SessionEnd)
            assert len([a for a in whole.attempts if a.outcome == "completed"]) == attempts
    assert died >= len(points) / 2  # the others had come to their end before


def test_a_live_log_that_is_killed_at_any_step_is_whole_and_drawn_again(gl_context, folder, full):
    steps = steps_of(folder, "log", folder / "whole.jsonl")
    assert set(steps) == {*LINES, "a flip", "capture", "draw"}
    renderer = renderer_of(gl_context)
    try:
        for number, (point, part) in enumerate(chosen(steps, 48 if full else 8, seed=3)):
            path = folder / f"{number}.jsonl"
            status, said = killed(folder, "log", path, point, part)
            assert status == -signal.SIGKILL, said
            if steps[point - 1] == "start" or "start" not in steps[: point - 1]:
                with pytest.raises(StudyError, match="was killed before its first line was whole"):
                    read_log(path)
                continue
            log = read_log(path)
            assert "was not closed" in log.notes[-1]
            flips, captures = (steps[: point - 1].count(one) for one in ("flip", "capture"))
            found = redraw(log, lambda _line: renderer, exactly=True)
            assert (found.flips, found.problems) == (flips, ())
            assert captures - 1 <= found.drawn == found.equal <= captures
    finally:
        renderer.release()
