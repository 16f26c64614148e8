"""One observer before a real window: `metamerlab session run`, in a process of its own."""

from __future__ import annotations

import csv
import hashlib
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from PIL import Image as PillowImage

from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import Attempt
from protocols.journal_file import JOURNAL_NAME, read_journal
from protocols.manifest import Manifest
from protocols.schema import StudyProtocol
from protocols.script import example_scripts
from study_app.cli.demo.watcher import Image, Place, Watcher
from study_app.sittings import is_stillborn
from study_app.strip import Seen, compare

PARTICIPANT = "W001"
_SILENCE_S = 180.0
"""A session that ends no trial for so long has hung."""

OnAttempt = Callable[[Attempt], None]


@dataclass(frozen=True)
class SittingPlan:
    """What the session needs."""

    protocol: StudyProtocol
    protocol_file: Path
    display: Display
    display_name: str
    """As `--display` takes it."""
    clips: Path
    sessions: Path
    seed: int

    @property
    def folder(self) -> Path:
        """Where its journal lies."""
        return self.sessions / self.protocol.study.name / PARTICIPANT

    def command(self, *, own_screen: bool) -> list[str]:
        """Return the arguments of `metamerlab`; a session that stopped is gone on with."""
        verb = "run" if is_stillborn(self.folder) or not self.folder.exists() else "resume"
        words = [
            "session", verb, str(self.protocol_file), "--stimuli", str(self.clips),
            "--participant", PARTICIPANT, "--out", str(self.sessions),
            "--display", self.display_name, "--simulate", "--skip-validation",
            "--seed", str(self.seed),
        ]  # fmt: skip
        return words if own_screen else [*words, "--software-pacing", "--strip"]


@dataclass(frozen=True)
class Flip:
    """One flip of an attempt, as the journal's side file says."""

    number: int
    t_s: float
    refreshes: int
    phase: str
    frame: str
    """SHA-256 of the clip frame's file; empty where no clip is shown."""


def attempts_of(folder: Path) -> list[Attempt]:
    """Return every attempt of a session so far."""
    path = folder / JOURNAL_NAME
    return list(read_journal(path, lenient=True).attempts) if path.exists() else []


def flips_of(folder: Path, attempt: Attempt) -> list[Flip]:
    """Return every flip of an attempt."""
    if attempt.flips_file is None:
        return []
    with (folder / attempt.flips_file.file).open(encoding="utf-8", newline="") as file:
        return [
            Flip(
                int(row["flip"]),
                float(row["t_s"]),
                int(row["refreshes"]),
                row["phase"],
                row["frame_sha256"],
            )
            for row in csv.DictReader(file)
        ]


def run_in_window(
    plan: SittingPlan,
    env: dict[str, str] | None,
    on_attempt: OnAttempt,
    watcher: Watcher | None = None,
    on_pictures: Callable[[Attempt, dict[int, Image]], None] | None = None,
) -> None:
    """Run the session to its end.

    Parameters
    ----------
    env : dict, optional
        Environment with the screen to use; left out, this program's own.
    on_attempt : callable
        Told every attempt that is on the disk.
    watcher, on_pictures : optional
        Told also what the screen showed at the attempt's flips.

    Raises
    ------
    StudyError
        With what the command said, if it failed, or hung.
    """
    command = plan.command(own_screen=env is None)
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "metamerlab", *command],
        env=env or dict(os.environ),
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    said: list[str] = []
    lines: queue.Queue[str | None] = queue.Queue()
    assert process.stdout is not None
    reader = threading.Thread(target=_read, args=(process.stdout, lines), daemon=True)
    reader.start()
    known = len(attempts_of(plan.folder))
    try:
        while (line := lines.get(timeout=_SILENCE_S)) is not None:
            said.append(line)
            # Each line of an attempt comes after the attempt is on the disk.
            attempts = attempts_of(plan.folder)
            for attempt in attempts[known:]:
                if watcher is not None and on_pictures is not None:
                    numbers = [flip.number for flip in flips_of(plan.folder, attempt)]
                    on_pictures(attempt, watcher.take(numbers))
                on_attempt(attempt)
            known = len(attempts)
    except queue.Empty:
        raise StudyError(
            f"the session in the window ended no trial for {_SILENCE_S:.0f} s; run this again, or"
            " leave the window out with --no-window"
        ) from None
    finally:
        if process.poll() is None and reader.is_alive():
            process.terminate()
        process.wait()
        reader.join()
        process.stdout.close()
    if process.returncode != 0:
        last = "\n".join(line for line in said[-12:] if line)
        raise StudyError(
            f"the session in the window must end well (status {process.returncode}):\n{last}\n"
            "run this again, or leave the window out with --no-window"
        )


@dataclass(frozen=True)
class Comparison:
    """What another program saw on the screen, against the journal."""

    flips: int
    """Flips in the log that showed a clip frame."""
    seen: int
    """How many of them were seen whole."""
    wrong: tuple[str, ...]
    """Those that showed something else, or came out of order."""


def compare_with_log(
    plan: SittingPlan, manifest: Manifest, attempts: list[Attempt], seen: list[Seen]
) -> Comparison:
    """Check, pixel by pixel, that the screen showed the frames that the log names."""
    pixels_of, name_of = _pixels(plan.clips, manifest)
    logged = {
        flip.number: name_of[pixels_of[flip.frame]]
        for attempt in attempts
        for flip in flips_of(plan.folder, attempt)
        if flip.frame
    }
    found = {entry.number for entry in seen}
    checked: dict[int, str | None] = {
        number: name for number, name in logged.items() if number in found
    }
    wrong = compare(checked, seen, name_of)
    return Comparison(len(logged), len(checked), tuple(map(str, wrong)))


def _pixels(clips: Path, manifest: Manifest) -> tuple[dict[str, str], dict[str, str]]:
    """Return SHA-256 of a frame's file -> of its pixels, and of its pixels -> the frame's name.

    Frames of several methods can be equal; they then go by the name of the first.
    """
    pixels_of: dict[str, str] = {}
    name_of: dict[str, str] = {}
    for clip in manifest.clips:
        for index, sha in enumerate(clip.frames_sha256):
            if sha not in pixels_of:
                with PillowImage.open(clips / clip.frame_path(index)) as image:
                    pixels = np.asarray(image.convert("RGB")).tobytes()
                pixels_of[sha] = hashlib.sha256(pixels).hexdigest()
            name_of.setdefault(pixels_of[sha], f"{clip.name}/{index}")
    return pixels_of, name_of


def clip_place(display: Display, protocol: StudyProtocol) -> Place:
    """Return where the first stimulus of a trial stands."""
    script = example_scripts(protocol, display)[0]
    x, y = next(entry.at for shown in script.frames for entry in shown)
    return Place(x + display.width_px // 2, y + display.height_px // 2, *script.stimulus_px)


def _read(stream: IO[str], lines: queue.Queue[str | None]) -> None:
    for line in stream:
        lines.put(line.rstrip())
    lines.put(None)
