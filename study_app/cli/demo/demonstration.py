"""The demonstration: the commands of every step, what they said, and one page that links all."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from markupsafe import Markup
from rich.console import Console

from protocols.blocks import MediaFile, MediaRow, TableBlock
from protocols.disk.hashing import sha256_json
from protocols.disk.result_folder import remove_listed, unlisted, write_listing
from protocols.disk.whole_file import write_whole
from protocols.errors import StudyError
from protocols.html_page import html_page
from protocols.load import load_study
from protocols.outside import page_bytes
from protocols.revision import code_revision, package_version
from stimuli.executors import cores
from study_app.cli.demo.steps import SCREEN, Options, Step, steps_of
from study_app.cli.demo.xvfb import require_screen, virtual_screen
from study_app.session_folders import is_stillborn

RECORD_NAME = "demo.json"
PAGE_NAME = "index.html"
_OURS = (
    PAGE_NAME, "pictures", "clips", "sessions", "report", "trial.html", "studies", SCREEN,
)  # fmt: skip


def run_demo(options: Options, console: Console) -> Path:
    """Run the commands of all steps that are not done yet, then write the page.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    StudyError, OSError
        With what a command said that failed; what was finished is kept, and the next run goes on
        from there.
    """
    if options.window and options.display is None and not options.pictures_only:
        require_screen()
    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    if not (out / RECORD_NAME).exists():
        for name in _OURS:
            if (out / name).exists():
                raise StudyError(
                    f"{out}: must be empty or made by 'metamerlab demo' (it holds {name}"
                    f" but no {RECORD_NAME}); choose another --out, or move it away"
                )
    theirs = set(unlisted(out)) - {out / RECORD_NAME}
    try:
        return _Demo(options, console).run()
    finally:
        write_listing(out, theirs)


class _Demo:
    def __init__(self, options: Options, console: Console) -> None:
        self.options, self.out, self.console = options, options.out, console
        with as_file(files("study_app.cli.demo") / SCREEN) as path:
            shutil.copyfile(path, self.out / SCREEN)
        self.protocol, self.display = load_study(
            Path(options.study), options.display or str(self.out / SCREEN)
        )
        self.keys: dict[str, str] = {}
        """Hash of what each step depends on, by its name."""
        self.record: dict[str, dict[str, Any]] = {}
        """By step: key, and if it is done, seconds and what its commands said."""
        try:
            known = json.loads((self.out / RECORD_NAME).read_text(encoding="utf-8"))
            self.record = {name: dict(step) for name, step in known.items()}
        except (OSError, ValueError, TypeError, AttributeError, RecursionError):
            pass  # it begins anew
        self._note()

    def run(self) -> Path:
        steps = steps_of(self.options, self.protocol.study.name)
        for number, step in enumerate(steps, 1):
            self._run(step, f"{number}/{len(steps)} {step.title}")
        version = f"{package_version()}, revision {code_revision()}"
        study = Markup("metamerlab {} · study <code>{}</code>").format(version, self.options.study)
        text = html_page(
            "SIMULATED: metamerlab, the demonstration",
            "study_app/cli/demo/demo.html",
            heading="From pictures to a report",
            under=study,
            stamp="DEMONSTRATION: ALL OBSERVERS ARE SIMULATED. NO PERSON TOOK PART.",
            steps=steps,
            record=self.record,
            shown={step.name: self._shown(step) for step in steps},
            done=self._done(steps),
            options=self.options,
            out=os.path.relpath(self.out),
        )
        write_whole(self.out / PAGE_NAME, page_bytes(text))
        return self.out / PAGE_NAME

    def _done(self, steps: list[Step]) -> TableBlock:
        """Return the table of steps with their times, in numbers and as bars."""
        seconds = {step.name: self.record[step.name]["seconds"] for step in steps}
        longest_s = max(seconds.values()) or 1.0
        link = Markup('<a href="#{}">{}</a>').format
        bar = Markup('<i style="width: {:.1f}%"></i>').format
        return TableBlock.each(
            "",
            steps,
            ("Step", "l strong", lambda step: link(step.name, step.title)),
            ("Time", "n", lambda step: f"{seconds[step.name]:.1f} s"),
            ("", "lasts", lambda step: bar(100 * seconds[step.name] / longest_s)),
        )

    def _shown(self, step: Step) -> MediaRow:
        """Return the pictures, videos and pages that the page shows of a step."""
        paths = [path for pattern in step.shows for path in sorted(self.out.glob(pattern))]
        shots = []
        for path in paths:
            address = path.relative_to(self.out).as_posix()
            name = path.name.partition(".")[0].replace("__", ", ") if path.suffix == ".webm" else ""
            alt = step.title if path.suffix == ".html" else f"{step.title}: {address}"
            shots.append(MediaFile(address, name, alt, link=address))
        return MediaRow(tuple(shots), least_rem=20.0 if len(shots) > 1 else 60.0)

    def _run(self, step: Step, label: str) -> None:
        key = self.keys[step.name] = sha256_json(
            [
                code_revision(), self.protocol.sha256, self.display.model_dump(mode="json"),
                json.dumps(step.chains()), [self.keys.get(name) for name in step.needs],
            ]
        )  # fmt: skip
        known = self.record.get(step.name, {})
        begun = known.get("key") == key
        if (
            begun
            and "said" in known
            and all((self.out / name).exists() for name in step.named(step.makes))
        ):
            self.console.print(f"{label}: kept")
            return
        if not begun:
            self._clear(step.named(step.clears))
        self.record[step.name] = {"key": key}
        self._note()
        self.console.print(f"{label} ...", style="bold")
        own_screen = step.when == "window" and self.options.display is None
        began_s = time.monotonic()
        chains = step.chains()
        with (
            virtual_screen(self.display) if own_screen else nullcontext(dict(os.environ)) as env,
            ThreadPoolExecutor(min(cores(), len(chains))) as pool,
        ):
            done = pool.map(
                lambda chain: [self._command(one, env, len(chains) == 1) for one in chain], chains
            )
            said = [one for chain in done for one in chain]
        took_s = time.monotonic() - began_s
        self.record[step.name] |= {"seconds": round(took_s, 2), "said": said}
        self._note()
        self.console.print(f"{label}: {took_s:.0f} s")

    def _command(self, command: list[str], env: dict[str, str], alone: bool) -> tuple[str, str]:
        """Run a command, print it with what it says, and return both."""
        if command[:2] == ["session", "run"]:
            code = command[command.index("--participant") + 1]
            session = self.out / "sessions" / self.protocol.study.name / code
            if session.exists() and not is_stillborn(session):
                command = ["session", "resume", *command[2:]]
        words = f"metamerlab {shlex.join(command)}"
        self.console.print(f"$ {words}")
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "metamerlab", *command],
            cwd=self.out, env=env, text=True, encoding="utf-8", errors="replace",
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=None if alone else subprocess.STDOUT,  # bars of several would overwrite another
        )  # fmt: skip
        lines = []
        assert process.stdout is not None
        try:
            for line in process.stdout:
                lines.append(line.rstrip())
                self.console.print(lines[-1])
        finally:
            if process.poll() is None and sys.exc_info()[0] is not None:
                process.terminate()
            process.wait()
            process.stdout.close()
        if process.returncode != 0:
            raise StudyError(
                f"'{words}' must end well in {self.out} (it ended with status"
                f" {process.returncode}; what it said stands above); mend that, and run this again:"
                " it goes on from there"
            )
        return words, "\n".join(lines)

    def _clear(self, patterns: list[str]) -> None:
        """Remove what demonstrations made, to make it again.

        Raises
        ------
        StudyError
            If it holds what none listed as its own: a user's, or of a demonstration that was
            killed.
        """
        folders = [path for pattern in patterns for path in sorted(self.out.glob(pattern))]
        for folder in folders:
            for theirs in unlisted(self.out, folder):
                raise StudyError(
                    f"{folder}: must hold nothing but what a demonstration listed as its own (it"
                    f" holds {theirs.relative_to(folder)}); move that folder away, or choose"
                    " another --out"
                )
        for folder in folders:
            remove_listed(self.out, folder)

    def _note(self) -> None:
        text = json.dumps(self.record, indent=1, sort_keys=True) + "\n"
        write_whole(self.out / RECORD_NAME, text.encode("utf-8"))
