"""A screen without a monitor, a study of a few small clips, and ways to run sessions on it."""

import csv
import hashlib
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from attack.captured_flips import CapturedPicture
from forked import METAMERLAB, Forked
from PIL import Image
from study_texts import shipped_study, with_values

from protocols.disk.hashing import sha256_file
from protocols.display import Display
from protocols.journal_file import Journal, read_journal
from protocols.load import load_display, load_protocol
from protocols.make_script import example_scripts
from protocols.manifest import Clip, Manifest, Renderer, read_manifest, write_manifest
from protocols.study_file.schema import StudyProtocol

WIDTH, HEIGHT = 640, 480
# Before any of these texts where an artificial observer sits: it reads and decides fast.
HASTY = """
from study_app.desktop import page_turner
from study_app.observers.observer_model import ArtificialObserver
thoughtful = ArtificialObserver.answer
ArtificialObserver.answer = lambda self, trial, attempt: (thoughtful(self, trial, attempt)[0], 0.12)
page_turner._SIMULATED_PAGE_S, page_turner.NOTICE_S = 0.05, 0.1
"""
# After each flip the presenter waits until the watcher has read it: the capture keeps up on a busy
# machine. A flip that never comes is waited for in vain, and noticed. The session's clock stands
# still for so long, and for what a busy machine takes from it between flips. What it told the
# journal meanwhile it does not take back.
PACED = """
import mmap, struct, sys, time
from study_app import presenter
from study_app.desktop import window
from study_app.cli import main

with open(sys.argv.pop(), "r+b") as file:
    read = mmap.mmap(file.fileno(), 8)
stood_s, flipped_s, told_s = 0.0, time.monotonic(), 0.0
window.Window.now = lambda self: time.monotonic() - stood_s
def told(self):
    global told_s
    told_s = max(told_s, self._window.now())
    return told_s
presenter.Presenter.now = told
presenters_flip = presenter.Presenter._flip
def paced(self, draw):
    global stood_s, flipped_s
    stood_s += max(0.0, time.monotonic() - flipped_s - 0.004)
    shown = presenters_flip(self, draw)
    began_s = time.monotonic()
    while struct.unpack("<q", read[:8])[0] < shown.number and time.monotonic() < began_s + 2.0:
        time.sleep(0.0005)
    flipped_s = time.monotonic()
    stood_s += flipped_s - began_s
    return shown
presenter.Presenter._flip = paced
"""
NEEDED = ("Xvfb", "openbox", "xdotool")

DISPLAY = f"""
name = "little"
width_px = {WIDTH}
height_px = {HEIGHT}
width_mm = 192.0
height_mm = 144.0
distance_mm = 600.0
refresh_hz = 60.0
clip_memory_mib = 64
"""


@dataclass(frozen=True)
class Study:
    """A protocol file, its display and its clips, below one folder."""

    folder: Path

    @property
    def path(self) -> Path:
        return self.folder / "study.toml"

    @property
    def stimuli(self) -> Path:
        return self.folder / "clips"

    @property
    def sessions(self) -> Path:
        return self.folder / "sessions"

    @property
    def protocol(self) -> StudyProtocol:
        return load_protocol(self.path)

    @property
    def display(self) -> Display:
        return load_display(str(self.folder / "little.toml"))

    @property
    def manifest(self) -> Manifest:
        return read_manifest(self.stimuli)

    @property
    def places(self) -> list[tuple[int, int]]:
        """Upper left corners of the stimuli on the screen, from left to right."""
        script, display = example_scripts(self.protocol, self.display)[0], self.display
        middle = display.width_px // 2, display.height_px // 2
        shown = [entry for entries in script.frames for entry in entries]
        crops = [entry.crop or (0, 0) for entry in shown]
        corners = [
            (entry.at[0] - crop[0] + middle[0], entry.at[1] - crop[1] + middle[1])
            for entry, crop in zip(shown, crops, strict=True)
        ]
        return sorted(set(corners))

    @property
    def rectangle(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of all that stimuli stand in, side by side."""
        width, height = self.protocol.stimuli.size_px(self.display)
        (left, top), (right, _) = self.places[0], self.places[-1]
        return left, top, right + width - left, height

    @cached_property
    def name(self) -> str:
        return self.protocol.study.name

    def session(self, code: str = "P01") -> Path:
        return self.sessions / self.name / code

    def journal(self, code: str = "P01") -> Journal:
        return read_journal(self.session(code) / "journal.jsonl")

    def flips(self, code: str = "P01") -> list[dict[str, str]]:
        """Every flip of a participant's attempts, in order."""
        rows: list[dict[str, str]] = []
        for attempt in self.journal(code).attempts:
            with (self.session(code) / attempt.flips_file.file).open() as file:
                rows += csv.DictReader(file)
        return rows

    def frame(self, clip: str, index: int) -> np.ndarray:
        """The pixels of a stored frame, (height, width, 3)."""
        with Image.open(self.stimuli / clip / f"{index:06d}.png") as image:
            return np.asarray(image.convert("RGB"))

    def halves(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """The left half of one picture and the right half of another, and a grey bar between."""
        middle, display = left.shape[1] // 2, self.display
        bar_rad = math.radians(self.protocol.task.bar_deg)
        reach = round(math.tan(bar_rad / 2) * display.distance_mm / display.pitch_x_mm)
        made = np.concatenate([left[:, :middle], right[:, middle:]], axis=1)
        made[:, middle - reach : middle + reach] = 128
        return made

    def logged(self, code: str = "P01") -> tuple[dict[int, str | None], dict[str, str]]:
        """Picture of each flip in the log, and the names of pictures by their pixels' hash.

        A picture's name is that of its frames, from left to right, as in ``name/3 + name/3``;
        None: no frame. Its pixels are composed from the stored files, on grey.
        """
        left, top, width, height = self.rectangle
        frames = {
            sha: (clip.name, index)
            for clip in self.manifest.clips
            for index, sha in enumerate(clip.frames_sha256)
        }
        by_flip: dict[int, str | None] = {}
        names: dict[str, str] = {}
        for row in self.flips(code):
            shown = [frames[sha] for sha in row["frame_sha256"].split()]
            name = " + ".join(f"{clip}/{index}" for clip, index in shown)
            by_flip[int(row["flip"])] = name or None
            if not shown or name in names.values():
                continue
            canvas = np.full((height, width, 3), 128, np.uint8)
            if len(shown) > len(self.places):  # halves of one place
                canvas[:] = self.halves(*(self.frame(clip, index) for clip, index in shown))
                names[hashlib.sha256(canvas.tobytes()).hexdigest()] = name
                continue
            for (clip, index), (x, y) in zip(shown, self.places, strict=True):
                pixels = self.frame(clip, index)
                high, wide, _ = pixels.shape
                canvas[y - top : y - top + high, x - left : x - left + wide] = pixels
            names[hashlib.sha256(canvas.tobytes()).hexdigest()] = name
        return by_flip, names


def empty_study(folder: Path) -> Study:
    """Write the little display, and nothing else yet."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "little.toml").write_text(DISPLAY, encoding="utf-8")
    return Study(folder)


def write_study(
    folder: Path, values: dict[str, str] | None = None, pixels: int = 1, *, questions: bool = False
) -> Study:
    """Write a short version of the demo study with clips of noise."""
    text = shipped_study("demo", {}, questions=questions)
    text = re.sub(r"^(practice|catch) = \{.*\n", "", text, flags=re.M)
    text = re.sub(
        r'\n\[\[stimuli\.scenes\]\]\nname = "colonnade".*?(?=\n\[\[)', "\n", text, flags=re.S
    )
    text = re.sub(r'\n\[\[stimuli\.sizes\]\]\nname = "large".*?(?=\n\[\[)', "\n", text, flags=re.S)
    text = with_values(
        text,
        {
            "display": '"little.toml"',
            "width_deg": "2.75",
            "height_deg": "1.9",
            "duration_s": "0.2",
            "blocks": "1",
            "break_s": "0.0",
            "fixation_s": "0.1",
            "fixation_timeout_s": "5.0",
            "gap_s": "0.1",
            "iti_s": "0.1",
            # A busy machine misses refreshes; what follows is tested on a virtual clock.
            "dropped_frames_max": "10000",
            "catch_min_share": "0.0",
        }
        | (values or {}),
    )
    study = empty_study(folder)
    study.path.write_text(text, encoding="utf-8")
    protocol, display = study.protocol, study.display
    recipe = protocol.warped
    width, height = recipe.size_px(display)
    clips = []
    for number, name in enumerate(protocol.shown()):
        rng = np.random.default_rng((pixels, number))
        clip_folder = study.stimuli / name
        clip_folder.mkdir(parents=True)
        hashes = []
        for index in range(recipe.frames):
            frame = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
            path = clip_folder / f"{index:06d}.png"
            Image.fromarray(frame).save(path)
            hashes.append(sha256_file(path))
        clips.append(
            Clip(
                name=name,
                condition=dict(zip(("scene", "size", "method"), name.split("__"), strict=True)),
                width_px=width,
                height_px=height,
                fps=recipe.frame_hz,
                bit_depth=8,
                seed=recipe.clips.seed,
                parameters={},
                hole_share=0.02,
                cache_key="0" * 64,
                frames_sha256=tuple(hashes),
            )
        )
    write_manifest(
        study.stimuli,
        Manifest(
            format=2,
            study=protocol.study.name,
            stimuli_sha256=protocol.stimuli_sha256,
            display=display.name,
            revision="test",
            renderer=Renderer(vendor="", renderer="noise", version=""),
            versions={},
            clips=tuple(clips),
        ),
    )
    return study


@pytest.fixture
def make_study(tmp_path: Path) -> Callable[..., Study]:
    """Give a function that writes a study with other values below the test's folder."""

    def make(
        values: dict[str, str] | None = None, name: str = "study", *, questions: bool = False
    ) -> Study:
        return write_study(tmp_path / name, values, questions=questions)

    return make


@pytest.fixture
def start_study(tmp_path: Path) -> Callable[..., Study]:
    """Give a function that makes a study's folder, with the little display alone."""
    return lambda name="study": empty_study(tmp_path / name)


def in_haste(code: str, arguments: Sequence[object], hasty: bool = True) -> str:
    """Put `HASTY` before a text that lets an artificial observer sit."""
    return HASTY + code if hasty and "--simulate" in arguments else code


@dataclass(frozen=True)
class Screen:
    """A monitor of an X server with a window manager; the server's picture may lie in a file."""

    name: str
    file: Path | None = None
    left: int = 0
    """Left edge of the monitor on the server's screen."""

    @property
    def env(self) -> dict[str, str]:
        return {**os.environ, "DISPLAY": self.name, "LIBGL_ALWAYS_SOFTWARE": "1"}

    def picture(self) -> np.ndarray:
        """Picture on the screen now, (height, width, 3)."""
        assert self.file is not None
        data = self.file.read_bytes()
        header = int.from_bytes(data[:4], "big")
        colours = int.from_bytes(data[76:80], "big")
        pixels = np.frombuffer(data, np.uint8, offset=header + 12 * colours)
        return pixels[: WIDTH * HEIGHT * 4].reshape(HEIGHT, WIDTH, 4)[..., 2::-1]

    def shows(self, image: np.ndarray, beside: tuple[int, int] | None = None) -> bool:
        """True if the screen is this RGBA image on the study's grey, left of and above `beside`.

        `beside` is where the mouse stands: its arrow hangs to the right and below.
        """
        alpha = image[..., 3:] / 255
        wanted = image[..., :3] * alpha + 128 * (1 - alpha)
        off = np.abs(self.picture() - wanted).max(axis=2) > 2
        if beside is not None:
            x, y = beside
            off[max(0, y - 8) : y + 32, max(0, x - 8) : x + 32] = False
        return not off.any()

    def point(self, x_px: int, y_px: int) -> None:
        """Move the mouse."""
        subprocess.run(["xdotool", "mousemove", str(x_px), str(y_px)], env=self.env, check=True)

    def type(self, text: str) -> None:
        """Type characters, as a keyboard does."""
        subprocess.run(["xdotool", "type", "--delay", "30", text], env=self.env, check=True)

    def keys(self, *names: str) -> None:
        """Let keys go down and up, as a keyboard does."""
        subprocess.run(["xdotool", "key", *names], env=self.env, check=True)

    def start(
        self, *arguments: object, code: str = METAMERLAB, hasty: bool = True, folder: Path = Path()
    ) -> Forked:
        """Start `metamerlab` on this screen, or other Python text.

        An artificial observer then reads and answers fast, unless not `hasty`.
        """
        text = in_haste(code, arguments, hasty)
        return Forked(*arguments, code=text, env=self.env, folder=folder)

    def run(
        self, *arguments: object, status: int | None = 0, **kwargs: object
    ) -> subprocess.CompletedProcess[str]:
        """Run `metamerlab` on this screen to its end, with a status (None: any)."""
        done = self._ended(self.start(*arguments, **kwargs), 240)
        assert status in (None, done.returncode), (done.returncode, done.stdout + done.stderr)
        return done

    def script(
        self, text: str, *arguments: object, timeout_s: float = 240
    ) -> subprocess.CompletedProcess[str]:
        """Run Python text on this screen; it must succeed."""
        done = self.try_script(text, *arguments, timeout_s=timeout_s)
        assert done.returncode == 0, done.stdout + done.stderr
        return done

    def try_script(
        self, text: str, *arguments: object, timeout_s: float = 240
    ) -> subprocess.CompletedProcess[str]:
        """Run Python text on this screen."""
        return self._ended(self.start(*arguments, code=text), timeout_s)

    def _ended(self, process: Forked, timeout_s: float) -> subprocess.CompletedProcess[str]:
        try:
            out, err = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            raise AssertionError(f"did not end:\n{out}\n{err}") from None
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def watch(
        self, study: Study, *more: object, also: str = "", code: str = "P01", timeout_s: float = 240
    ) -> list[CapturedPicture]:
        """Let an artificial observer do a study while another process watches the screen.

        Parameters
        ----------
        study : Study
            Its stimuli are there.
        more : object
            Further arguments of `session run`.
        also : str
            Python text that is run before the session.
        code : str
            The participant's.

        Returns
        -------
        list of CapturedPicture
            Every picture that the other process saw where stimuli stand.
        """
        read = study.folder / "read"  # how far the other process has read
        read.write_bytes(b"\xff" * 8)
        script = Path(__file__).with_name("screen_watcher.py")
        watcher = subprocess.Popen(
            [
                sys.executable, script, str(self.file or self.name), str(self.left),
                *map(str, study.rectangle), read,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        assert watcher.stdout is not None
        assert watcher.stdout.readline() == "ready\n"
        try:
            arguments = self.session("run", study, "--simulate", "--strip", *more, code=code)
            self.script(PACED + also + "main()\n", *arguments, read, timeout_s=timeout_s)
        finally:
            out, _ = watcher.communicate(input="stop\n", timeout=60)
        lines = (line.split() for line in out.splitlines())
        return [CapturedPicture(int(number), content) for number, content in lines]

    def session(self, verb: str, study: Study, *more: object, code: str = "P01") -> list[object]:
        """Arguments of `session run` or `session resume`."""
        return [
            "session", verb, study.path, "--stimuli", study.stimuli, "--out", study.sessions,
            "--participant", code, "--software-pacing", *more,
        ]  # fmt: skip


@pytest.fixture(scope="session")
def screen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Screen]:
    """Yield an Xvfb with openbox; without them skip, or fail where REQUIRE_GL=1."""
    missing = [name for name in NEEDED if shutil.which(name) is None]
    if missing:
        reason = f"no {', '.join(missing)} here"
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail(f"REQUIRE_GL=1, and there is {reason}")
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("screen")
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [
            "Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WIDTH}x{HEIGHT}x24",
            "-fbdir", str(folder), "-nolisten", "tcp",
        ],
        pass_fds=(writing,),
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    with os.fdopen(reading) as pipe:
        number = pipe.readline().strip()
    assert number, "Xvfb did not start"
    made = Screen(f":{number}", folder / "Xvfb_screen0")
    manager = subprocess.Popen(["openbox"], env=made.env, stderr=subprocess.DEVNULL)
    time.sleep(0.5)
    yield made
    for process in (manager, server):
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=10)


def wait_for(
    condition: Callable[[], object],
    what: str,
    timeout_s: float = 60.0,
    process: Forked | None = None,
) -> object:
    """Poll until a condition holds; give up at once if `process` ends before."""
    until_s = time.monotonic() + timeout_s
    while time.monotonic() < until_s:
        ended = process is not None and process.poll() is not None
        if value := condition():
            return value
        if ended:
            out, err = process.communicate()
            raise AssertionError(f"ended before {what}: {process.returncode}\n{out}\n{err}")
        time.sleep(0.02)
    raise AssertionError(f"waited in vain for {what}")


@pytest.fixture(scope="session")
def wait() -> Callable[..., object]:
    """Give `wait_for`."""
    return wait_for
