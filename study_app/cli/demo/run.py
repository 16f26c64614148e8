"""The demonstration: every step of a study on real input, one after the other."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path

from rich.console import Console

from analysis.report import report_sessions
from protocols.errors import StudyError
from protocols.feasibility import require_feasible
from protocols.hashing import sha256_file, sha256_json
from protocols.journal import Attempt
from protocols.journal_file import JOURNAL_NAME
from protocols.load import load_display, load_protocol
from protocols.manifest import Manifest
from protocols.revision import code_revision, package_version
from stimuli.build import build
from stimuli.check import check_batch
from stimuli.executors import cores, local_processes
from stimuli.orders import Orders
from study_app.cli.demo import filmstrip, pictures
from study_app.cli.demo.layout import Layout, Record
from study_app.cli.demo.page import Facts, write_page
from study_app.cli.demo.screen import require_screen, virtual_screen
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
from study_app.cli.demo.steps import Step, Steps
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


def run_demo(options: Options, console: Console) -> Layout:
    """Do all that is not done yet, then write the page.

    Raises
    ------
    StudyError, InputError, GLUnavailableError, OSError
        As the steps raise them; what was finished is kept, and the next run goes on from there.
    """
    if options.window and options.display is None:
        require_screen()
    layout = Layout(options.out)
    layout.prepare()
    return _Demo(options, layout, console).run()


class _Demo:
    def __init__(self, options: Options, layout: Layout, console: Console) -> None:
        self.options, self.layout, self.console = options, layout, console
        self.record = Record(layout)
        self.protocol = load_protocol(options.study)
        with as_file(files("study_app.cli.demo") / "screen.toml") as path:
            shutil.copyfile(path, layout.screen)
        self.display_name = options.display or str(layout.screen.resolve())
        self.display = load_display(self.display_name)
        require_feasible(self.protocol, self.display)
        self.folder = layout.sessions / self.protocol.study.name
        self.manifest: Manifest

    def run(self) -> Layout:
        options, layout = self.options, self.layout
        began_s = time.monotonic()
        with Steps(self.console, 7 if options.window else 6) as steps:
            with steps.step("fill the holes of a photograph") as step:
                photographs = self._photographs(step)
            with steps.step("build the study's clips") as step:
                self._build(step)
            with steps.step("check the clips") as step:
                self._check(step)
            self._drop_stale_sessions()
            if options.window:
                with steps.step("one observer before a window") as step:
                    self._sit(step)
            with steps.step("observers on a virtual display") as step:
                self._simulate(step)
            self._strip_from_log()
            with steps.step("analyse") as step:
                headline = self._report(step)
            with steps.step("write the page") as step:
                facts = Facts(
                    protocol=self.protocol,
                    study=str(options.study),
                    display=self.display,
                    own_display=options.display,
                    observers=options.observers,
                    window=options.window,
                    photographs=photographs,
                    manifest=self.manifest,
                    headline=headline,
                    cores=cores(),
                    version=f"{package_version()}, revision {code_revision()}",
                    run_s=time.monotonic() - began_s,
                )
                write_page(layout, self.record, facts)
                step.result = str(layout.page)
        return layout

    def _photographs(self, step: Step) -> pictures.Photographs:
        key = f"{code_revision()} {self.options.seed}"
        names = (*pictures.METHODS, pictures.WARPED, pictures.TRUTH)
        there = all((self.layout.pictures / f"{name}.png").is_file() for name in names)
        if there and self.record.matches("pictures", key):
            step.result = "kept"
            notes = dict(self.record.notes("pictures"))
            return pictures.Photographs.from_notes(notes)
        began_s = time.monotonic()
        made = pictures.fill_photographs(self.layout.pictures, self.options.seed)
        self.record.done("pictures", key, time.monotonic() - began_s, asdict(made))
        height, width = made.size_px
        step.result = f"{width} x {height} px, holes {100 * made.hole_share:.1f} % of the frame"
        return made

    def _build(self, step: Step) -> None:
        orders = Orders(self.protocol, self.display, self._study_folder())
        began_s = time.monotonic()
        parallel = min(cores(), len(orders.clip_names))
        with local_processes(parallel) as executor:
            outcome = build(
                orders, self.layout.clips.absolute(), executor, parallel=parallel, report=step
            )
        self.manifest = outcome.manifest
        if outcome.built or not self.record.seconds("clips"):
            self.record.done("clips", self.manifest.sha256, time.monotonic() - began_s)
        step.result = f"{len(outcome.built)} clips built, {len(outcome.kept)} kept"

    def _check(self, step: Step) -> None:
        began_s = time.monotonic()
        verdict = check_batch(self.layout.clips, step)
        if not verdict.in_order:
            wrong = [*verdict.missing, *verdict.changed, *verdict.extra]
            raise StudyError(
                f"{self.layout.clips}: every file must be as the manifest says"
                f" ({len(wrong)} are not, such as {wrong[0]}); run this again"
            )
        notes = {"frames": verdict.frames}
        self.record.done("check", self.manifest.sha256, time.monotonic() - began_s, notes)
        step.result = f"{verdict.frames} frames, every hash as in the manifest"

    # Observers

    @property
    def _sessions_key(self) -> str:
        return sha256_json(
            [
                self.protocol.sha256, self.manifest.sha256, self.options.seed,
                self.options.observers, self.options.window, self.options.display,
                self.display.model_dump(mode="json"),
            ]
        )  # fmt: skip

    def _drop_stale_sessions(self) -> None:
        """Sittings with other clips cannot be analysed with these: simulate them again."""
        layout, key = self.layout, self._sessions_key
        if self.record.matches("sessions", key):
            return
        if layout.sessions.exists():
            real = [
                sitting.participant
                for sitting in find_sittings(layout.sessions)
                if sitting.state not in {"damaged", "stillborn", "withdrawn"}
                and not sitting.journal.start.simulated
            ]
            if real:
                raise StudyError(
                    f"{layout.sessions}: must hold simulated sittings alone (it holds recorded"
                    f" ones: {', '.join(real)}); move that folder away, or choose another --out"
                )
            self.console.print("clips or options changed: the simulated sittings are made again")
            shutil.rmtree(layout.sessions)
        shutil.rmtree(layout.trial, ignore_errors=True)
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

    def _sit(self, step: Step) -> None:
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
                "the sitting in the window must be completed (it was stopped); run this again to"
                " go on with it"
            )
        self.record.done("window", self._sessions_key, time.monotonic() - began_s, notes)
        step.result = f"{len(attempts_of(plan.folder))} trials in a real window"

    def _simulate(self, step: Step) -> None:
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

    def _strip_from_log(self) -> None:
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
        filmstrip.write_strip(self.layout.trial, "log", code, best, flips, drawn)

    # The end

    def _report(self, step: Step) -> str:
        journals = sorted(self.folder.glob(f"*/{JOURNAL_NAME}"))
        key = sha256_json(
            [code_revision(), self.options.figures, *(sha256_file(path) for path in journals)]
        )
        headline = str(self.record.notes("report").get("headline", ""))
        if headline and self.record.matches("report", key) and self.layout.report.is_dir():
            step.result = "kept"
            return headline
        began_s = time.monotonic()
        made = report_sessions(
            self.layout.sessions,
            self.protocol,
            self.layout.report,
            replace=True,
            figure_files=self.options.figures,
            progress=lambda name, done, total: step(done, total, name),
        )
        took_s = time.monotonic() - began_s
        self.record.done("report", key, took_s, {"headline": made.headline})
        step.result = "report written"
        return made.headline

    def _is_complete(self, code: str) -> bool:
        if not (self.folder / code / JOURNAL_NAME).exists():
            return False
        return any(
            sitting.participant == code and sitting.state == "completed"
            for sitting in find_sittings(self.layout.sessions, self.protocol.study.name)
        )

    def _trials(self) -> int:
        from protocols.plan import make_plan

        return len(make_plan(self.protocol, self.manifest, PARTICIPANT, 0).trials)

    def _study_folder(self) -> Path:
        return self.options.study.absolute().parent


class _KeepBest:
    """Keeps the pictures of the attempt that is most worth showing."""

    def __init__(self, demo: _Demo, plan: SittingPlan) -> None:
        self._demo, self._plan, self._best = demo, plan, 0

    def __call__(self, attempt: Attempt, shown: dict[int, Image]) -> None:
        value = filmstrip.worth(attempt, self._demo.protocol)
        if value <= self._best:
            return
        flips = filmstrip.chosen_flips(_from_zero(flips_of(self._plan.folder, attempt)), shown)
        if len({flip.phase for flip in flips}) < len(filmstrip.SHOTS):
            return  # a busy machine: too little of it was seen
        self._best = value
        folder = self._demo.layout.trial
        filmstrip.write_strip(folder, "screen", PARTICIPANT, attempt, flips, shown)


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
