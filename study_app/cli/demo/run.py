"""The demonstration: every step of a study on real input, one after the other."""

from __future__ import annotations

import shutil
import time
from dataclasses import asdict
from importlib.resources import as_file, files
from pathlib import Path

from rich.console import Console

from analysis.report.build import report_sessions
from protocols.errors import StudyError
from protocols.feasibility import require_feasible
from protocols.hashing import sha256_file, sha256_json
from protocols.journal_file import JOURNAL_NAME
from protocols.load import load_display, load_protocol
from protocols.manifest import Manifest
from protocols.result_folder import unlisted, write_listing
from protocols.revision import code_revision, package_version
from stimuli.build import build
from stimuli.check import check_batch
from stimuli.executors import cores, local_processes
from stimuli.orders import Orders
from study_app.cli.demo import pictures, studies
from study_app.cli.demo.layout import RECORD_NAME, Layout, Record
from study_app.cli.demo.observers import Observers, Options
from study_app.cli.demo.page import Facts, write_page
from study_app.cli.demo.screen import require_screen
from study_app.cli.demo.steps import Step, Steps


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
    theirs = set(unlisted(options.out)) - {options.out / RECORD_NAME}
    try:
        return _Demo(options, layout, console).run()
    finally:
        write_listing(options.out, theirs)


class _Demo:
    def __init__(self, options: Options, layout: Layout, console: Console) -> None:
        self.options, self.layout, self.console = options, layout, console
        self.record = Record(layout)
        self.protocol = load_protocol(options.study)
        with as_file(files("study_app.cli.demo") / "screen.toml") as path:
            shutil.copyfile(path, layout.screen)
        own = str(layout.screen.resolve())
        self.display_name = own if options.display is None else options.display
        self.display = load_display(self.display_name)
        require_feasible(self.protocol, self.display)
        self.folder = layout.sessions / self.protocol.study.name
        self.manifest: Manifest

    def run(self) -> Layout:
        options, layout = self.options, self.layout
        with Steps(self.console, 6 + options.window + options.studies) as steps:
            with steps.step("fill the holes of a photograph") as step:
                photographs = self._photographs(step)
            with steps.step("build the study's clips") as step:
                self._build(step)
            with steps.step("check the clips") as step:
                self._check(step)
            observers = self._observers()
            observers.drop_stale()
            if options.window:
                with steps.step("one observer before a window") as step:
                    observers.sit_in_window(step)
            with steps.step("observers on a virtual display") as step:
                observers.simulate(step)
            observers.strip_from_log()
            with steps.step("analyse") as step:
                headline = self._report(step)
            if options.studies:
                with steps.step("studies on foveated pictures") as step:
                    self._studies(step)
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

    def _observers(self) -> Observers:
        return Observers(
            self.options,
            self.layout,
            self.record,
            self.protocol,
            self.display,
            self.display_name,
            self.manifest,
            self.console,
        )

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

    def _studies(self, step: Step) -> None:
        key = code_revision()
        if not self.record.matches("studies", key):
            self.layout.clear(self.layout.studies)
        began_s = time.monotonic()
        for name in studies.unfinished(self.layout.studies):
            self.layout.clear(self.layout.studies / name)  # what an interruption left
        studies.show_studies(self.layout.studies, step)
        if not self.record.matches("studies", key):
            self.record.done("studies", key, time.monotonic() - began_s)

    def _study_folder(self) -> Path:
        return self.options.study.absolute().parent
