"""The simulated observers: one before a real window, the others on a virtual display."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from protocols.display import Display
from protocols.errors import StudyError
from protocols.hashing import sha256_json
from protocols.journal import Attempt
from protocols.journal_file import JOURNAL_NAME
from protocols.manifest import Manifest
from protocols.plan import make_plan
from protocols.schema import StudyProtocol
from study_app.cli.demo import filmstrip
from study_app.cli.demo.layout import Layout, Record
from study_app.cli.demo.screen import virtual_screen
from study_app.cli.demo.sitting import (
    PARTICIPANT,
    Flip,
    SittingPlan,
    attempts_of,
    clip_place,
    compare_with_log,
    flips_of,
    run_in_window,
)
from study_app.cli.demo.steps import Step
from study_app.cli.demo.watcher import Image, Watcher
from study_app.simulate import Simulation, participant_code, simulate_study
from study_app.sittings import find_sittings

STUDY = "showcase"


@dataclass(frozen=True)
class Options:
    """What `metamerlab demo` is asked for."""

    out: Path
    study: Path = Path(STUDY)
    observers: int = 12
    window: bool = True
    """Whether one of them sits before a real window."""
    display: str | None = None
    """The user's own screen; None: a screen without a monitor."""
    seed: int = 0
    figures: bool = True
    studies: bool = True
    """Whether the studies on foveated pictures are shown too."""


@dataclass(frozen=True)
class Observers:
    """All sessions of a demonstration, with the clips that were built."""

    options: Options
    layout: Layout
    record: Record
    protocol: StudyProtocol
    display: Display
    display_name: str
    manifest: Manifest
    console: Console

    @property
    def folder(self) -> Path:
        """Where the sessions lie."""
        return self.layout.sessions / self.protocol.study.name

    @property
    def _sessions_key(self) -> str:
        return sha256_json(
            [
                self.protocol.sha256, self.manifest.sha256, self.options.seed,
                self.options.observers, self.options.window, self.options.display,
                self.display.model_dump(mode="json"),
            ]
        )  # fmt: skip

    def drop_stale(self) -> None:
        """Sessions with other clips cannot be analysed with these: simulate them again."""
        layout, key = self.layout, self._sessions_key
        if self.record.matches("sessions", key):
            return
        if layout.sessions.exists():
            real = [
                sitting.participant
                for sitting in find_sittings(layout.sessions)
                # A damaged journal may be a person's as well.
                if sitting.state == "damaged"
                or (
                    sitting.state not in {"stillborn", "withdrawn"}
                    and not sitting.journal.start.simulated
                )
            ]
            if real:
                raise StudyError(
                    f"{layout.sessions}: must hold simulated sessions alone (it holds recorded"
                    f" or damaged ones: {', '.join(real)}); move that folder away, or choose"
                    " another --out"
                )
            self.console.print("clips or options changed: the simulated sessions are made again")
            layout.clear(layout.sessions)
        layout.clear(layout.trial)
        for step in ("window", "virtual"):
            self.record.forget(step)
        self.record.done("sessions", key, 0.0)

    def _sitting_plan(self) -> SittingPlan:
        return SittingPlan(
            protocol=self.protocol,
            protocol_file=self.options.study,
            display=self.display,
            display_name=self.display_name,
            clips=self.layout.clips,
            sessions=self.layout.sessions,
            seed=self.options.seed,
        )

    def sit_in_window(self, step: Step) -> None:
        """Run, or go on with, the one before the window."""
        plan = self._sitting_plan()
        if self._is_complete(PARTICIPANT):
            step.result = "kept"
            return
        began_s = time.monotonic()
        total = self._trials()
        counter = _counter(step, total)
        for attempt in attempts_of(plan.folder):
            counter(attempt)
        notes: dict[str, object] = {}
        if self.options.display is not None:
            run_in_window(plan, None, counter)
        else:
            with (
                virtual_screen(self.display) as screen,
                Watcher(screen.pixels, clip_place(self.display, self.protocol)) as watcher,
            ):
                keep = _KeepBest(self, plan)
                run_in_window(plan, screen.env, counter, watcher, keep)
                seen = watcher.seen
            found = compare_with_log(plan, self.manifest, attempts_of(plan.folder), seen)
            notes = {"flips": found.flips, "seen": found.seen, "wrong": list(found.wrong)}
        if not self._is_complete(PARTICIPANT):
            raise StudyError(
                "the session in the window must be completed (it was stopped); run this again to"
                " go on with it"
            )
        self.record.done("window", self._sessions_key, time.monotonic() - began_s, notes)
        step.result = f"{len(attempts_of(plan.folder))} trials in a real window"

    def simulate(self, step: Step) -> None:
        """Run those who sit before a virtual display."""
        began_s = time.monotonic()
        count = self.options.observers - self.options.window
        total = count * self._trials()
        counter = _counter(step, total)
        simulation = Simulation(
            self.protocol, self.display, seed=self.options.seed, manifest=self.manifest
        )
        for code in map(participant_code, range(count)):
            for attempt in attempts_of(self.folder / code):
                counter(attempt)
        outcomes = simulate_study(
            simulation,
            self.layout.sessions,
            count,
            on_attempt=lambda _code, attempt: counter(attempt),
        )
        if outcomes or not self.record.seconds("virtual"):
            self.record.done("virtual", self._sessions_key, time.monotonic() - began_s)
        step.result = f"{len(outcomes)} simulated, {count - len(outcomes)} kept"

    def strip_from_log(self) -> None:
        """Where no screen could be read: the trial's pictures from the log and the clips."""
        strip = filmstrip.read_strip_file(self.layout.trial)
        code = PARTICIPANT if self.options.window else participant_code(0)
        if strip is not None and strip.participant == code:
            return
        folder = self.folder / code
        attempts = attempts_of(folder)
        best = max(attempts, key=lambda one: filmstrip.worth(one, self.protocol))
        flips = filmstrip.chosen_flips(_from_zero(flips_of(folder, best)), None)
        drawn = filmstrip.redraw(
            flips, self.layout.clips, self.manifest, self.protocol, self.display
        )
        filmstrip.write_strip(self.layout.trial, "log", code, best, self.protocol, flips, drawn)

    def _is_complete(self, code: str) -> bool:
        if not (self.folder / code / JOURNAL_NAME).exists():
            return False
        return any(
            sitting.participant == code and sitting.state == "completed"
            for sitting in find_sittings(self.layout.sessions, self.protocol.study.name)
        )

    def _trials(self) -> int:
        return len(make_plan(self.protocol, self.manifest, PARTICIPANT, 0).trials)


class _KeepBest:
    """Keeps the pictures of the attempt that is most worth showing."""

    def __init__(self, observers: Observers, plan: SittingPlan) -> None:
        self._observers, self._plan, self._best = observers, plan, 0

    def __call__(self, attempt: Attempt, shown: dict[int, Image]) -> None:
        value = filmstrip.worth(attempt, self._observers.protocol)
        if value <= self._best:
            return
        flips = filmstrip.chosen_flips(_from_zero(flips_of(self._plan.folder, attempt)), shown)
        if len({flip.phase for flip in flips}) < len(filmstrip.SHOTS):
            return  # a busy machine: too little of it was seen
        self._best = value
        folder = self._observers.layout.trial
        filmstrip.write_strip(
            folder, "screen", PARTICIPANT, attempt, self._observers.protocol, flips, shown
        )


def _from_zero(flips: list[Flip]) -> list[Flip]:
    """Count time from the attempt's first flip."""
    begin_s = flips[0].t_s if flips else 0.0
    return [replace(flip, t_s=flip.t_s - begin_s) for flip in flips]


def _counter(step: Step, total: int) -> Callable[[Attempt], None]:
    done = 0

    def count(attempt: Attempt) -> None:
        nonlocal done
        done += attempt.outcome == "completed"
        step(min(done, total), total, "trials")

    return count
