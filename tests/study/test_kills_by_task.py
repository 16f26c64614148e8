"""Killed at any point, a sitting of any task loses nothing, doubles nothing, and keeps order and
levels."""

from __future__ import annotations

import os
import random
import re
import signal
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from protocols.hashing import sha256_file
from protocols.journal import Attempt, SessionEnd
from protocols.journal_file import Journal, read_journal
from protocols.load import load_display, load_protocol
from protocols.new_study import study_files
from study_app.gaze.simulated import GazeBehaviour
from study_app.simulate import Simulation, simulate_sitting, simulate_study
from study_app.sittings import Sitting
from study_app.verification import verify

RESTLESS = GazeBehaviour(away_per_s=0.4, blink_per_s=0.3, loss_per_s=0.1)
QUEST_PLUS = ("# [task.adaptive]", "# falling = false")
UP_DOWN = ('# [task.adaptive]\n# rule = "up-down"', "# falling = false")
ACTIVE = ("# [task.sampling]", "# trials = 60")


@dataclass(frozen=True)
class Case:
    task: str
    adaptive: tuple[str, str] | None = None
    """First and last line of the template's example that is set."""


CASES = {
    "two-interval": Case("two-interval"),
    "two-alternative": Case("two-alternative"),
    "yes-no": Case("yes-no"),
    "identification": Case("identification"),
    "abx": Case("abx"),
    "which-half": Case("which-half"),
    "yes-no by QUEST+": Case("yes-no", QUEST_PLUS),
    "identification by up-down": Case("identification", UP_DOWN),
    "abx by QUEST+": Case("abx", QUEST_PLUS),
    "active pairs": Case("two-interval", ACTIVE),
}
ROWS = {
    # Few enough for a short sitting.
    "yes-no": [
        ("one", "fine", pattern, contrast)
        for pattern in ("grating", "none")
        for contrast in (0.04, 0.08, 0.12, 0.16, 0.2)
    ],
    "identification": [
        ("thick", gap, contrast)
        for gap in ("left", "up", "down", "right")
        for contrast in (0.04, 0.2)
    ],
    "abx": [
        (scene, "fine", blur) for scene in ("one", "two") for blur in (0.0, 0.5, 1.0, 1.5, 2.0)
    ],
}
ROWS["which-half"] = ROWS["abx"]
COLUMNS = {
    "yes-no": "scene,noise,pattern,contrast",
    "identification": "stroke,gap,contrast",
    "abx": "scene,texture,blur_px",
    "which-half": "scene,texture,blur_px",
}


def write_study(folder: Path, case: Case) -> Simulation:
    """Write a short new study of a task; return what simulates it."""
    display = load_display("fhd27-60hz").model_copy(update={"name": "my-display"})
    files = study_files("killed", "Killed", display, case.task)
    text = files["study.toml"]
    if case.adaptive is not None:
        before, first, rest = text.partition(case.adaptive[0])
        block, last, after = (first + rest).partition(case.adaptive[1])
        lines = [
            line.removeprefix("# ") if re.match(r"# (\[|\w+ = )", line) else line
            for line in (block + last).splitlines()
        ]
        text = before + "\n".join(lines) + after
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
    ):
        text = text.replace(old, new)
    if case.task == "identification":
        text = text.replace("0.06, 0.08, 0.1, 0.12, 0.16]", "0.12]")
        text = text.replace("easier = [0.12]", "easier = [0.16]")
        text = text.replace("harder = [0.04]", "harder = [0.16]")
    if case.task in ROWS:
        rows = [
            f"s{index},s{index}.png," + ",".join(map(str, row))
            for index, row in enumerate(ROWS[case.task])
        ]
        header = f"stimulus,file,{COLUMNS[case.task]}"
        (folder / "stimuli.csv").write_text("\n".join([header, *rows]) + "\n")
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return Simulation(load_protocol(path), display, seed=5, gaze=RESTLESS)


def journal_of(root: Path) -> Journal:
    return read_journal(root / "killed" / "S001" / "journal.jsonl")


def told(attempts: tuple[Attempt, ...]) -> list[tuple[object, ...]]:
    """Return what must not change: order, what was shown at which level, what was answered."""
    return [
        (
            a.trial, a.role, a.block, a.attempt, a.position, dict(a.condition), a.track,
            tuple(s.name for s in a.stimuli), a.answers, a.expected, a.outcome, a.void_reason,
            a.answer, a.correct,
        )
        for a in attempts
    ]  # fmt: skip


def in_a_child(work) -> bool:
    """Do `work` in a forked process; return whether it was killed."""
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def killed_at_write(point: int, part: float) -> None:
    """From now on, die at the `point`-th write or sync; a write gets `part` of its bytes out."""
    real_write, real_sync, calls = os.write, os.fsync, [0]

    def write(descriptor, data):
        calls[0] += 1
        if calls[0] == point:
            real_write(descriptor, bytes(data)[: int(part * len(data))])
            os.kill(os.getpid(), signal.SIGKILL)
        return real_write(descriptor, data)

    def sync(descriptor):
        calls[0] += 1
        if calls[0] == point:
            os.kill(os.getpid(), signal.SIGKILL)
        real_sync(descriptor)

    os.write, os.fsync = write, sync


def writes_of(simulation: Simulation, root: Path) -> int:
    """Return how often an undisturbed sitting writes or syncs."""
    calls = [0]
    real_write, real_sync = os.write, os.fsync

    def write(descriptor, data):
        calls[0] += 1
        return real_write(descriptor, data)

    def sync(descriptor):
        calls[0] += 1
        real_sync(descriptor)

    os.write, os.fsync = write, sync
    try:
        simulate_sitting(simulation, root, "S001")
    finally:
        os.write, os.fsync = real_write, real_sync
    return calls[0]


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("name", CASES)
def test_killed_anywhere_it_goes_on_as_it_would_have(tmp_path, name, proof_count):
    """SIGKILL at writes spread over the whole sitting, several in each; then to the end."""
    simulation = write_study(tmp_path, CASES[name])
    writes = writes_of(simulation, tmp_path / "whole")
    undisturbed = journal_of(tmp_path / "whole")
    wanted = told(undisturbed.attempts)
    assert any(a.outcome == "void" for a in undisturbed.attempts)
    chance = random.Random(name)
    points = proof_count(200)
    kills, sittings, died = 0, 0, 0
    while kills < points:
        root = tmp_path / f"killed-{sittings}"
        sittings += 1
        saved = b""
        for _ in range(4):
            # Early, middle and late alike: each run goes on from the last, so a quarter is far.
            kills += 1
            point = 1 + (kills * writes // points + chance.randrange(writes)) % (writes // 2)
            part = chance.random()

            def work(root=root, point=point, part=part):
                killed_at_write(point, part)
                simulate_sitting(simulation, root, "S001")

            died += in_a_child(work)
            path = root / "killed" / "S001" / "journal.jsonl"
            if not path.exists():
                continue
            written = path.read_bytes()
            assert written.startswith(saved)  # nothing that was saved is lost
            saved = written[: written.rfind(b"\n") + 1]
        simulate_study(simulation, root, 1)
        journal = journal_of(root)
        assert journal.path.read_bytes().startswith(saved)
        assert told(journal.attempts) == wanted
        assert journal.start.plan_sha256 == undisturbed.start.plan_sha256
        assert [event.n for event in journal.events] == list(range(len(journal.events)))
        assert isinstance(journal.events[-1], SessionEnd)
        done = Counter(a.trial for a in journal.attempts if a.outcome == "completed")
        assert set(done.values()) == {1}
        for attempt in journal.attempts:
            for side in (attempt.gaze_file, attempt.flips_file):
                assert side is None or sha256_file(journal.path.parent / side.file) == side.sha256
        found = verify(Sitting(journal.path.parent, journal), simulation.protocol)
        assert (found.problems, found.notes) == ((), ())
    assert died >= points // 2  # the others had come to their end before


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.adaptive])
def test_levels_and_pairs_follow_the_answers(tmp_path, name):
    """Another observer's answers lead to other levels or pairs: nothing was planned beforehand."""
    simulation = write_study(tmp_path, CASES[name])
    column = getattr(simulation.protocol.task.adaptation, "column", None)

    def shown(seed: int) -> list[object]:
        root = tmp_path / f"seed-{seed}"
        sim = Simulation(simulation.protocol, simulation.display, seed=seed, gaze=RESTLESS)
        simulate_sitting(sim, root, "S001")
        main = [a for a in journal_of(root).attempts if a.role == "main"]
        return [
            a.condition[column] if column else frozenset(s.name for s in a.stimuli)
            for a in main
            if a.outcome == "completed"
        ]

    found = [shown(seed) for seed in range(3)]
    assert len({tuple(entry) for entry in found}) > 1
    assert all(len(set(entry)) > 1 for entry in found)
