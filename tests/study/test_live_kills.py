"""Killed at any step, a live session or log is whole, and all that it recorded is drawn again.

A step is a write (of which a part gets out), a sync, a frame that is drawn, a flip, and pixels that
are read back to be kept. Each session and log runs in a process of its own, by `main` below.
"""

import json
import os
import random
import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forked import Forked
from virtual_screen import VirtualScreen

from pipeline.foveation.geometry import Flat
from pipeline.gl.context import describe, lent_context
from pipeline.named_classes import Choice
from protocols.display import Display, Viewing
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_study, load_toml, shipped
from study_app.cli.pictures.live_renderer import FoveatingRenderer, FoveatingStudio, LiveSource
from study_app.conduct import conduct
from study_app.gaze.saccades import SaccadeWatch
from study_app.gaze.simulated import SimulatedGaze
from study_app.live import log as live_log
from study_app.live.log import FrameReadback, read_log
from study_app.live.loop import Latency, LiveLoop
from study_app.live.redraw import TrialDrawer, redraw
from study_app.live.renderer import LiveView
from study_app.observers import ArtificialObserver, default_model
from study_app.opening import begin, resume
from study_app.session_folders import SessionFolder, is_stillborn, session_folder
from study_app.session_setup import SessionSetup
from study_app.verification import verify
from study_app.virtual import VirtualClock, VirtualStage

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
HZ = 60.0
WIDTH, HEIGHT = 64, 48


def killed(folder: Path, what: str, to: Path, point: int, part: float) -> tuple[int, str]:
    """Run a session or a log up to a step; return the status and what was said.

    Parameters
    ----------
    folder : Path
        Holds the study and its display.
    what : str
        `session`, or `log`.
    to : Path
        Where it is recorded.
    point : int
        Number of the step at which it is killed, from 1; 0: it goes on to the end.
    part : float
        Share of a write that gets out.
    """
    here = Path(__file__).resolve()
    paths = [str(here.parents[0]), str(here.parents[1] / "helpers"), str(here.parents[2])]
    code = f"import sys; sys.path[:0] = {paths}; from test_live_kills import main; main()"
    process = Forked(folder, what, to, point, part, code=code)
    out, err = process.communicate(timeout=300)
    return process.wait(), out + err


def steps_of(folder: Path, what: str, to: Path) -> list[str]:
    """Return the kinds of all steps of an undisturbed run, in their order."""
    status, said = killed(folder, what, to, 0, 1.0)
    assert status == 0, said
    return json.loads(said.splitlines()[-1])


def chosen(steps: list[str], count: int, seed: int) -> list[tuple[int, float]]:
    """Return so many points with the share of a write that gets out: each kind in its turn."""
    rng = random.Random(seed)
    kinds = sorted(set(steps))
    found = []
    for number in range(count):
        kind = kinds[number % len(kinds)]
        places = [place for place, one in enumerate(steps, 1) if one == kind]
        found.append((rng.choice(places), rng.random()))
    return found


class _Steps:
    """Counts steps, and dies at one of them."""

    def __init__(self, point: int, part: float) -> None:
        self.kinds: list[str] = []
        self._point, self._part = point, part

    def step(self, kind: str, before_death: Callable[[float], object] = lambda _part: None) -> None:
        self.kinds.append(kind)
        if len(self.kinds) == self._point:
            before_death(self._part)
            os.kill(os.getpid(), signal.SIGKILL)

    def before(self, owner: Any, name: str, kind: str) -> None:
        """Make a call of a function a step."""
        real = getattr(owner, name)

        def counted(*given: Any, **more: Any) -> Any:
            self.step(kind)
            return real(*given, **more)

        setattr(owner, name, counted)

    def new_files(self) -> None:
        """Make writes into all files that are opened anew steps."""
        opens = Path.open

        def opened(path: Path, mode: str = "r", *given: Any, **more: Any) -> Any:
            file = opens(path, mode, *given, **more)
            return _Written(file, self) if mode == "xb" else file

        Path.open = opened  # type: ignore[method-assign, assignment]


class _Written:
    """A file whose writes are steps, of a kind that its first word tells."""

    def __init__(self, file: Any, steps: _Steps) -> None:
        self._file, self._steps = file, steps

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes) -> int:
        def some(part: float) -> None:
            self._file.write(data[: int(part * len(data))])
            self._file.flush()

        line = re.search(rb'"kind":"(\w+)"', data)
        self._steps.step((line[1] if line else data[:4]).decode(errors="replace"), some)
        return self._file.write(data)


def main() -> None:
    """Run what the arguments say."""
    folder, what, to, point, part = sys.argv[1:]
    steps = _Steps(int(point), float(part))

    steps.before(FrameReadback, "of", "capture")
    steps.before(FoveatingRenderer, "draw", "draw")
    steps.new_files()
    {"session": _session, "log": _log}[what](Path(folder), Path(to), steps)
    print(json.dumps(steps.kinds))


def picture() -> Any:
    """Return what is shown, (HEIGHT, WIDTH, 4)."""

    pixels = np.random.default_rng(1).integers(0, 256, (HEIGHT // 8, WIDTH // 8, 4), np.uint8)
    pixels = pixels.repeat(8, axis=0).repeat(8, axis=1)
    pixels[..., 3] = 255
    return pixels


def _session(folder: Path, root: Path, steps: _Steps) -> None:

    study, display = load_study(folder / "study.toml", None)
    manifest, clock = virtual_manifest(study, display), VirtualClock()
    observer = ArtificialObserver(default_model(study), study.response, 0, "P01")
    with lent_context() as ctx:
        here = describe(ctx)
        stage = VirtualStage(clock, HZ, observer)
        stage.show_live(display, manifest, FoveatingStudio(ctx), lambda _name: picture())
        gaze = SimulatedGaze(clock, Viewing.of(display), (0, 0))
        setup = SessionSetup(
            study, display, manifest, root, "P01", "en", wall_clock=clock.wall, simulated=True,
            late_most=sys.maxsize, timing_evidence="virtual",
            drawn_by={"renderer": here.name, "opengl": here.version},
        )  # fmt: skip
        steps.before(VirtualStage, "flip", "a flip")
        real_write = os.write

        def write(descriptor: int, data: bytes) -> int:
            steps.step(
                "journal", lambda part: real_write(descriptor, data[: int(part * len(data))])
            )
            return real_write(descriptor, data)

        os.write = write  # type: ignore[assignment]
        steps.before(os, "fsync", "sync")
        there = session_folder(root, study, "P01")
        if there.exists() and not is_stillborn(there):
            recorder, plan = resume(setup, stage, gaze)
        else:
            recorder, plan = begin(setup, stage, gaze)
        with recorder:
            conduct(setup, plan, recorder, stage, gaze)


def _log(_folder: Path, path: Path, steps: _Steps) -> None:

    live_log.EVERY = 4
    display = load_toml(_folder / "little.toml", Display)
    clock = VirtualClock()

    with lent_context() as ctx:
        here = describe(ctx)
        renderer = renderer_of(ctx)
        renderer.prepare(3)
        log = live_log.LiveLog(
            path, at="2026-01-01T00:00:00.000000Z", source="builtin",
            reading={"background": 0.5, "clip": False, "stops": 0.0, "encoded": False,
                     "exposed": False},
            gaze="made up", display=display.model_dump(mode="json"), renderer=here.name,
            driver=here.version, revision="0", refresh_hz=HZ,
        )  # fmt: skip
        screen = VirtualScreen(clock, HZ, 0.004)
        steps.before(VirtualScreen, "flip", "a flip")
        loop = LiveLoop(
            screen, _Jumps(clock), (0, 0), polled=False, watch=SaccadeWatch(display.width_px / 40)
        )
        for number in range(30):
            if number in (0, 15):
                log.choice(renderer.describe())
            log.flip(*loop.step(renderer, LiveView(), 3))
        log.end(flips=30, missed=0, left_out=0, latency=Latency().summary().model_dump(mode="json"))
        log.close()


def renderer_of(ctx: Any) -> Any:
    """Return what draws the picture of logs."""

    source = LiveSource([picture()], "0" * 64, panorama=False, notes=())
    geometry = Flat(width_deg=20).of(WIDTH, HEIGHT)
    return FoveatingRenderer(ctx, source, geometry, Choice("blur"))


class _Jumps:
    """Gaze at 500 Hz that jumps every 0.2 s."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._next = clock, 0

    def poll(self) -> list[Any]:
        from study_app.gaze.source import GazeSample

        first, self._next = self._next, int(500 * self._clock() + 1e-6) + 1
        rng = random.Random(4)
        return [
            GazeSample(n / 500, n / 500, 20 + 20 * (n // 100 % 2) + rng.gauss(0, 0.01), 20.0)
            for n in range(first, self._next)
        ]


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
