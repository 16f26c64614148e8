"""Artificial observers through an exported folder, in Chromium without a window.

The page is the one that participants get; time is virtual. What the page would save as a file comes
home as any results do.
"""

from __future__ import annotations

import itertools
import json
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError

from protocols.browser.web_lines import LINE
from protocols.browser.web_study import WebStudy
from protocols.disk.read_file import read_bytes
from protocols.errors import StudyError
from protocols.journal import Attempt
from protocols.journal_file import JOURNAL_NAME, read_journal
from protocols.study_file.problems import in_words
from study_app.observers import ArtificialObserver, default_model, rng_of
from study_app.recorder import Recorder
from study_app.session import RunTrial
from study_app.session_folders import SessionFolder, find_sessions
from study_app.simulate import SimulatedStudy, participant_code
from study_app.virtual import AskedQuestions
from study_app.web.chromium import Chromium, running_chromium
from study_app.web.export import STUDY_FILE
from study_app.web.import_lines import BrowserResults, RebuiltSession, import_results
from study_app.web.serve import FolderHandler, served

_SCRIPTS = files("study_app").joinpath("web/driven")
CLOCK, OBSERVER = (_SCRIPTS.joinpath(f"{one}.js").read_text() for one in ("clock", "observer"))
"""Scripts for a page: a virtual display, and an observer who does what `observer.answer` says."""
_DRIVES = """
clock.hz = hz;
crypto.getRandomValues = (array) => { array.set(drawn.slice(0, array.length)); return array; };
let state = drawn[0];
observer.each = (frames) => {
  if (frames) state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  if (frames && state < misses * 2 ** 32) clock.drop.add(clock.frame + 1);
};
observer.answer = (phase) => {
  const name = Object.keys(localStorage).find((one) => one.endsWith(":lines"));
  const request = new XMLHttpRequest();
  request.open("POST", "observer", false);
  request.send(JSON.stringify({ phase, lines: localStorage.getItem(name) }));
  return JSON.parse(request.responseText);
};
"""
"""Gives chance from outside (`drawn`), misses refreshes, and asks the observer in Python."""
_STILL_S = 120.0
"""A page that neither asks nor ends for so long stands still."""


class BrowserObserver:
    """Observer before the page: follows its lines, and answers as it is asked.

    Parameters
    ----------
    simulation : SimulatedStudy
        The study and its observers.
    number : int
        Of the observer, from 0.
    on_attempt : callable
        Told each attempt.
    """

    def __init__(
        self, simulation: SimulatedStudy, number: int, on_attempt: Callable[[Attempt], None]
    ) -> None:
        model = simulation.model or default_model(simulation.protocol)
        self.simulation, self.on_attempt = simulation, on_attempt
        self.observer = ArtificialObserver(
            model, simulation.protocol.response, simulation.seed, participant_code(number)
        )
        self.asked_s = time.monotonic()
        """Time at which the page last asked."""
        self.problem: StudyError | None = None
        """Reason why it answers no more."""
        self._open: tuple[RebuiltSession, Recorder] | None = None
        self._taken = 0
        self._asked: AskedQuestions | None = None
        self._ends = ExitStack()

    def __enter__(self) -> BrowserObserver:
        self._folder = self._ends.enter_context(
            tempfile.TemporaryDirectory(prefix="metamerlab-browser-")
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def answer(self, phase: str, lines: str) -> tuple[str, float] | None:
        """Return the key to press and after how many milliseconds; None where nothing is asked.

        Parameters
        ----------
        phase : str
            Name of the phase that is now shown for the first time.
        lines : str
            All that the page has said so far.

        Raises
        ------
        StudyError
            If the page does not do what comes next.
        """
        self.asked_s = time.monotonic()
        session, recorder = self._follow(lines)
        step = session.next_step(recorder)
        if not isinstance(step, RunTrial):
            raise StudyError(f"the page must do what comes next, {step} (it shows {phase})")
        trial, attempt, asked = step.trial, step.attempt, self._asked
        if asked is None or (asked.trial.id, asked.attempt) != (trial.id, attempt):
            asked = self._asked = AskedQuestions(self.observer, trial, attempt)
        phases = session.scripts.of(trial).phases
        question = next((one.question for one in phases if one.name == phase), None)
        press = question and asked.press(question, 0.0)
        return (press.key, 1000 * press.t_s) if press else None

    def _follow(self, lines: str) -> tuple[RebuiltSession, Recorder]:
        """Take the lines that are new; return the session and its journal so far."""
        first, *rest = lines.split("\n")[:-1]
        if self._open is None:
            of, begun = self.simulation, LINE.validate_json(first)
            session = RebuiltSession(of.protocol, of.display, of.shown, [begun])
            recorder = self._ends.enter_context(session.begin(Path(self._folder) / "session"))
            self._open = session, recorder
        session, recorder = self._open
        for text in rest[self._taken :]:
            session.take(LINE.validate_json(text), recorder)
            self._taken += 1
            if isinstance(event := recorder.events[-1], Attempt):
                self.on_attempt(event)
        return session, recorder


class _Handler(FolderHandler):
    """Answers the page's questions in place of a participant."""

    desk: BrowserObserver

    def do_POST(self) -> None:  # noqa: N802
        said = json.loads(self.body())
        try:
            told = self.desk.answer(said["phase"], said["lines"])
        except StudyError as error:
            self.desk.problem = error
            told = None
        self.answer(200, json.dumps(told).encode())


def simulate_in_browser(
    simulation: SimulatedStudy,
    folder: Path,
    root: Path,
    participants: int,
    *,
    on_attempt: Callable[[str, Attempt], None] = lambda _p, _a: None,
) -> dict[str, int]:
    """Run observers through an exported folder; those whose session is complete are left out.

    Parameters
    ----------
    simulation : SimulatedStudy
        The study that was exported, with its stimuli, and its observers.
    folder : Path
        As ``session export-web`` wrote it.
    root : Path
        Folder of sessions.
    participants : int
        How many observers.
    on_attempt : callable
        Told each participant and attempt, for a progress bar.

    Returns
    -------
    dict
        Main trials decided, by the code that the page gave.

    Raises
    ------
    StudyError
        If the folder holds another study, there is no Chromium, or the page does not run the study.
    """
    study = simulation.protocol
    rate_hz, window_px = _checked(folder, simulation)
    sessions = find_sessions(root, study.study.name) if root.is_dir() else []
    there = {one.journal.start.seed for one in sessions if one.state == "completed"}
    taken = {one.journal.start.slot for one in sessions if one.journal.has_lines}
    free = (slot for slot in itertools.count() if slot not in taken)
    draws = [
        rng_of(simulation.seed, "browser", number).integers(2**32, size=5).tolist()
        for number in range(participants)
    ]
    # As the page makes its seed.
    seeds = [(one[0] % 2**21) * 2**32 + one[1] for one in draws]
    left = [number for number, seed in enumerate(seeds) if seed not in there]
    done: dict[str, int] = {}
    if not left:
        return done
    misses = simulation.missed_per_flip
    with running_chromium() as browser:
        for number in left:
            desk = BrowserObserver(
                simulation, number, partial(on_attempt, participant_code(number))
            )
            link = f"simulated&slot={next(free)}&language={study.text.default_language}"
            chance = f"const drawn = {draws[number]}, hz = {rate_hz:g}, misses = {misses};"
            with (
                desk,
                served(type("Handler", (_Handler,), {"folder": folder, "desk": desk})) as url,
            ):
                scripts = CLOCK, OBSERVER, f"{{{chance}{_DRIVES}}}"
                browser.open(f"{url}index.html?{link}", *scripts, size=window_px)
                lines = _lines_of(browser, desk)
            inbox = BrowserResults()
            inbox.read("the page", lines.encode())
            (one,) = import_results(inbox, study, simulation.display, simulation.shown, root)
            if one.state != "imported":
                raise StudyError(f"{folder}: its page must run the study ({one.message})")
            journal = read_journal(root / study.study.name / one.participant / JOURNAL_NAME)
            done[one.participant] = SessionFolder(journal.path.parent, journal).main_done
    return done


def _checked(folder: Path, simulation: SimulatedStudy) -> tuple[float, tuple[int, int]]:
    """Return the refresh rate and the window for an export; it must be one of the study.

    Raises
    ------
    StudyError
    """
    path, cure = folder / STUDY_FILE, "export the study again: 'metamerlab session export-web'"
    if not path.exists():
        raise StudyError(
            f"--web {folder}: must be a folder that 'metamerlab session export-web' wrote (there is"
            f" no {STUDY_FILE}); name that folder, or {cure}"
        )
    try:
        exported = WebStudy.model_validate_json(read_bytes(path, "an exported study"))
    except ValidationError as error:
        raise StudyError(
            f"{path}: must be as this version exports it ({in_words(error.errors()[0])}); {cure}"
        ) from None
    for what, ours, theirs in (
        ("study file", simulation.protocol.sha256, exported.protocol_sha256),
        ("manifest of the stimuli", simulation.shown.sha256, exported.manifest_sha256),
    ):
        if ours != theirs:
            raise StudyError(
                f"{path}: the {what} must be the one that was exported (hash {theirs[:12]}, got"
                f" {ours[:12]}); give that one, or {cure}"
            )
    rates = [rate.refresh_hz for rate in exported.rates]
    own = simulation.display.refresh_hz
    return own if own in rates else rates[0], exported.window_px


def _lines_of(browser: Chromium, desk: BrowserObserver) -> str:
    """Wait until the page is over; return what it would save as a file.

    Raises
    ------
    StudyError
        If it stands still, does not do what comes next, or ends early.
    """
    while browser.evaluate("document.querySelector('main')?.dataset.page") != "over":
        if desk.problem:
            raise desk.problem
        if time.monotonic() - desk.asked_s > _STILL_S:
            raise StudyError(
                f"the page must go on within {_STILL_S:.0f} s (it says: {browser.text()!r}); close"
                " other programs, and run the command again"
            )
        time.sleep(0.05)
    lines = str(
        browser.evaluate(
            "fetch(document.querySelector('main a[download]').href).then((file) => file.text())"
            ".catch(() => '')"
        )
    )
    if '"kind":"end","reason":"completed"' not in lines:
        raise StudyError(f"the page must run the study to its end (it says: {browser.text()!r})")
    return lines
