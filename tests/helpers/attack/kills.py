"""Kills sessions, and fills their disk, at any write or sync; then lets them go on to the end."""

import errno
import os
import random
import re
import signal
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from protocols.disk.hashing import sha256_file
from protocols.display import Display
from protocols.journal import Attempt, SessionEnd
from protocols.journal_file import Journal, read_journal
from protocols.load import load_display, load_protocol
from protocols.phases import STUDY_QUESTION, Phase, Question, QuestionText
from protocols.recipes.base import Pool
from protocols.study_file.new_study import study_files
from protocols.tasks.base import Task
from protocols.tasks.task_kinds import TASKS
from protocols.tasks.yes_no import YesNo
from study_app.gaze.simulated import GazeBehaviour
from study_app.observers import default_model
from study_app.recorder import DiskError
from study_app.session_folders import SessionFolder
from study_app.simulate import SimulatedStudy, simulate_session, simulate_study
from study_app.verification import verify

RESTLESS = GazeBehaviour(away_per_s=0.4, blink_per_s=0.3, loss_per_s=0.1)
QUEST_PLUS = ("# [task.adaptive]", "# falling = false")
UP_DOWN = ('# [task.adaptive]\n# rule = "up-down"', "# falling = false")
ACTIVE = ("# [task.sampling]", "# trials = 60")
CONFIDENCE = ("# [task.confidence]", "# keys = ")


@dataclass(frozen=True)
class Case:
    task: str
    adaptive: tuple[str, str] | None = None
    """First and last line of the template's example that is set."""
    confidence: bool = False
    """True if the template's example of it is set."""
    asks: type[Task] | None = None
    """A task of the same keys that asks more."""


class AskedThrice(YesNo):
    """An answer ends the stimulus; it is shown again; two questions follow."""

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        (shown,) = super().phases(pool, display)
        seen = asked("seen", "clearly", "barely", "not-at-all")
        return (
            replace(shown, name="speeded", asks=STUDY_QUESTION, frames=None, timeout_frames=120),
            replace(shown, name="again"),
            Phase("seen", None, (QuestionText(),), asks=seen, timeout_frames=120),
        )

    def phases_after(self, _pool: Pool, _display: Display) -> tuple[Phase, ...]:
        return (Phase("sure", None, (QuestionText(),), asks=asked("sure", "yes", "no")),)


def asked(name: str, *answers: str) -> Question:
    """Return a question with keys 1, 2, ... and labels in English."""
    keys = tuple((str(key),) for key in range(1, len(answers) + 1))
    return Question(name, answers, keys, {"en": f"{name}?"}, {"en": answers})


CASES = {
    **{name: Case(name) for name, kind in TASKS.items() if kind.task.decides},
    "yes-no by QUEST+": Case("yes-no", QUEST_PLUS),
    "identification by up-down": Case("identification", UP_DOWN),
    "abx by QUEST+": Case("abx", QUEST_PLUS),
    "active pairs": Case("two-interval", ACTIVE),
    "two-interval with confidence": Case("two-interval", confidence=True),
    "yes-no by QUEST+ with confidence": Case("yes-no", QUEST_PLUS, confidence=True),
}
THRICE = Case("yes-no", asks=AskedThrice)
ROWS = {
    # Few enough for a short session.
    "gratings_in_noise": [
        ("one", "fine", pattern, contrast)
        for pattern in ("grating", "none")
        for contrast in (0.04, 0.08, 0.12, 0.16, 0.2)
    ],
    "rings": [
        ("thick", gap, contrast)
        for gap in ("left", "up", "down", "right")
        for contrast in (0.04, 0.2)
    ],
    "blurred_textures": [
        (scene, "fine", blur) for scene in ("one", "two") for blur in (0.0, 0.5, 1.0, 1.5, 2.0)
    ],
}
COLUMNS = {
    "gratings_in_noise": "scene,noise,pattern,contrast",
    "rings": "stroke,gap,contrast",
    "blurred_textures": "scene,texture,blur_px",
}


@dataclass(frozen=True)
class Kills:
    """Result of the kills of one task's sessions; nothing was lost, or it would have raised."""

    kills: int
    """Processes that were to die or to find their disk full."""
    died: int
    """Those that did; the others had come to their end before."""
    sessions: int


def with_example(text: str, first_line: str, last_line: str) -> str:
    """Return a study with the template's example between these lines set."""
    before, first, rest = text.partition(first_line)
    block, last, after = (first + rest).partition(last_line)
    lines = [
        line.removeprefix("# ") if re.match(r"# (\[|\w+ = )", line) else line
        for line in (block + last).splitlines()
    ]
    return before + "\n".join(lines) + after


def write_study(folder: Path, case: Case) -> SimulatedStudy:
    """Write a short new study of a task; return what simulates it."""
    display = load_display("fhd27-60hz").model_copy(update={"name": "my-display"})
    files = study_files("killed", "Killed", display, case.task)
    text = files["study.toml"]
    if case.confidence:
        text = with_example(text, *CONFIDENCE)
    if case.adaptive is not None:
        text = with_example(text, *case.adaptive)
        text = re.sub(r"^trials = \d\d$", "trials = 12", text, count=1, flags=re.M)
    if case.adaptive == ACTIVE:
        text = text.replace('pairings = "all"\n', "")
    for old, new in (
        ("repeats = 2", "repeats = 1"),
        ("break_s = 30.0", "break_s = 1.0"),
        ("duration_s = 1.0", "duration_s = 0.2"),
        ("stimulus_s = 0.5", "stimulus_s = 0.1"),
        ("gap_s = 0.5", "gap_s = 0.1"),
        ("fixation_s = 0.5", "fixation_s = 0.2"),
        ("iti_s = 0.5", "iti_s = 0.1"),
        ("feedback_s = 1.0", "feedback_s = 0.1"),
    ):
        text = text.replace(old, new)
    if case.task == "identification":
        text = text.replace("0.06, 0.08, 0.1, 0.12, 0.16]", "0.12]")
        text = text.replace("easier = [0.12]", "easier = [0.16]")
        text = text.replace("harder = [0.04]", "harder = [0.16]")
    pictures = TASKS[case.task].example.rpartition(":")[2]
    if pictures in ROWS:
        rows = [
            f"s{index},s{index}.png," + ",".join(map(str, row))
            for index, row in enumerate(ROWS[pictures])
        ]
        header = f"stimulus,file,{COLUMNS[pictures]}"
        (folder / "stimuli.csv").write_text("\n".join([header, *rows]) + "\n")
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    protocol = load_protocol(path)
    if case.asks is not None:
        task = case.asks.model_construct(**dict(protocol.task))
        protocol = protocol.model_copy(update={"task": task})
    # What is cut off are writes: answers come fast, and little gaze lies between them.
    fast = replace(default_model(protocol), rt_median_s=0.2, rt_hard_s=0.1)
    return SimulatedStudy(protocol, display, seed=5, model=fast, gaze=RESTLESS, gaze_rate_hz=60.0)


def journal_of(root: Path) -> Journal:
    return read_journal(root / "killed" / "S001" / "journal.jsonl")


def told(attempts: tuple[Attempt, ...]) -> list[tuple[object, ...]]:
    """Return what must not change: order, what was shown at which level, what was answered."""
    return [
        (
            a.trial, a.role, a.block, a.attempt, a.position, dict(a.condition), a.track,
            tuple(s.name for s in a.stimuli), a.answers, a.expected, a.outcome, a.void_reason,
            a.answer, a.correct, tuple((f.question, f.answer, f.key) for f in a.further),
        )
        for a in attempts
    ]  # fmt: skip


def in_a_child(work: Callable[[], object]) -> int:
    """Do `work` in a forked process; return its status."""
    child = os.fork()
    if child == 0:
        status = 0
        try:
            work()
        except DiskError:
            status = FULL
        except BaseException:
            status = 1
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


FULL = 71
"""Exit status of a child whose disk was full, and said so as it should."""


def disturbed_at_write(point: int, part: float, full: bool = False) -> None:
    """From now on, die at the `point`-th write or sync, or find the disk full from there on.

    A write gets `part` of its bytes out.
    """
    real_write, real_sync, calls = os.write, os.fsync, [0]

    def write(descriptor: int, data: bytes) -> int:
        calls[0] += 1
        if calls[0] == point:
            real_write(descriptor, bytes(data)[: int(part * len(data))])
            disturb()
        elif full and calls[0] > point:
            disturb()
        return real_write(descriptor, data)

    def sync(descriptor: int) -> None:
        calls[0] += 1
        if calls[0] == point:
            disturb()
        real_sync(descriptor)

    def disturb() -> None:
        if full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.kill(os.getpid(), signal.SIGKILL)

    os.write, os.fsync = write, sync  # type: ignore[assignment]


def writes_of(simulation: SimulatedStudy, root: Path) -> int:
    """Return how often an undisturbed session writes or syncs."""
    calls = [0]
    real_write, real_sync = os.write, os.fsync

    def write(descriptor: int, data: bytes) -> int:
        calls[0] += 1
        return real_write(descriptor, data)

    def sync(descriptor: int) -> None:
        calls[0] += 1
        real_sync(descriptor)

    os.write, os.fsync = write, sync  # type: ignore[assignment]
    try:
        simulate_session(simulation, root, "S001")
    finally:
        os.write, os.fsync = real_write, real_sync
    return calls[0]


def kill_sessions(
    name: str,
    folder: Path,
    points: int,
    *,
    seed: int = 0,
    full: bool = False,
    on_kill: Callable[[], None] = lambda: None,
) -> Kills:
    """Kill sessions of one task, several times each, at writes spread over all of it.

    Parameters
    ----------
    name : str
        One of `CASES`, or "asked thrice".
    full : bool
        Fill the disk in place of the kill.

    Raises
    ------
    AssertionError
        If anything was lost, doubled, or came in another order than in an undisturbed session.
    """
    simulation = write_study(folder, THRICE if name == "asked thrice" else CASES[name])
    writes = writes_of(simulation, folder / "whole")
    undisturbed = journal_of(folder / "whole")
    wanted = told(undisturbed.attempts)
    assert any(a.outcome == "void" for a in undisturbed.attempts)
    chance = random.Random(f"{name} {seed}")
    kills, sessions, died = 0, 0, 0
    while kills < points:
        root = folder / f"killed-{sessions}"
        sessions += 1
        saved = b""
        for _ in range(min(4, points - kills)):
            # Early, middle and late alike: each run goes on from the last, so a quarter is far.
            kills += 1
            point = 1 + (kills * writes // points + chance.randrange(writes)) % (writes // 2)
            part = chance.random()

            def work(root: Path = root, point: int = point, part: float = part) -> None:
                disturbed_at_write(point, part, full)
                simulate_study(simulation, root, 1)  # keeps what is complete

            status = in_a_child(work)
            on_kill()
            wanted_status = FULL if full else -signal.SIGKILL
            assert status in (0, wanted_status), f"{point} of {writes}: status {status}"
            died += status != 0
            path = root / "killed" / "S001" / "journal.jsonl"
            if not path.exists():
                continue
            written = path.read_bytes()
            assert written.startswith(saved), "what was saved is lost"
            saved = written[: written.rfind(b"\n") + 1]
        simulate_study(simulation, root, 1)
        _check_whole(journal_of(root), undisturbed, wanted, saved, simulation)
    return Kills(kills, died, sessions)


def _check_whole(
    journal: Journal,
    undisturbed: Journal,
    wanted: list[tuple[object, ...]],
    saved: bytes,
    simulation: SimulatedStudy,
) -> None:
    assert journal.path.read_bytes().startswith(saved), "what was saved is lost"
    assert told(journal.attempts) == wanted
    assert journal.start.plan_sha256 == undisturbed.start.plan_sha256
    assert [event.n for event in journal.events] == list(range(len(journal.events)))
    assert isinstance(journal.events[-1], SessionEnd)
    done = Counter(a.trial for a in journal.attempts if a.outcome == "completed")
    assert set(done.values()) == {1}
    for attempt in journal.attempts:
        for side in (attempt.gaze_file, attempt.flips_file):
            assert side is None or sha256_file(journal.path.parent / side.file) == side.sha256
    found = verify(SessionFolder(journal.path.parent, journal), simulation.study)
    assert (found.problems, found.notes) == ((), ())
