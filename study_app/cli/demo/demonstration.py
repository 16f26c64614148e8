"""The demonstration: the commands of every step, what they said, and one page that links all."""

from __future__ import annotations

import json
import os
import shutil
from base64 import b64encode
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from importlib.resources import as_file, files
from mimetypes import guess_type
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any

from markupsafe import Markup
from rich.console import Console

from protocols.blocks import MediaFile, MediaRow, html_page
from protocols.disk.hashing import sha256_json
from protocols.disk.result_folder import remove_listed, unlisted, write_listing
from protocols.disk.whole_file import write_whole
from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import load_study
from protocols.outside import page_bytes
from protocols.revision import code_revision, package_version
from stimuli.batch.executors import LocalProcesses, cores, local_processes
from study_app.cli.demo.steps import SCREEN, Options, Said, Step, run_commands, steps_of
from study_app.session_folders import is_stillborn

PROGRAMS = ("Xvfb", "openbox")


def require_screen() -> None:
    """Refuse, with the cure, where no screen can be made.

    Raises
    ------
    StudyError
        Naming the missing programs.
    """
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        raise StudyError(
            f"--all needs a window, and with it {' and '.join(PROGRAMS)} (missing:"
            f" {', '.join(missing)}); install them ('apt-get install xvfb openbox'), or show the"
            " window on your own screen (--display FILE), or do without it (leave out --all)"
        )


@contextmanager
def virtual_screen(display: Display) -> Iterator[dict[str, str]]:
    """Start an X server of the display's size; it ends with the context.

    Yields
    ------
    dict of str to str
        What the environment of a program has that shall open its window there.

    Raises
    ------
    StudyError
        If the server does not start.
    """
    with ExitStack() as stack:
        reading, writing = os.pipe()
        command = [
            "Xvfb", "-displayfd", str(writing), "-screen", "0",
            f"{display.width_px}x{display.height_px}x24", "-nolisten", "tcp",
        ]  # fmt: skip
        server = stack.enter_context(
            Popen(command, pass_fds=(writing,), stdout=DEVNULL, stderr=PIPE, text=True)
        )
        stack.callback(server.terminate)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            number = pipe.readline().strip()
        if not number:
            said = server.stderr.read() if server.stderr else ""
            raise StudyError(
                f"Xvfb must start (it said: {said.strip() or 'nothing'}); mend that, or leave out"
                " --all, which wants a window"
            )
        env = {"DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
        manager = Popen(["openbox"], env=os.environ | env, stdout=DEVNULL, stderr=DEVNULL)
        stack.enter_context(manager)
        stack.callback(manager.terminate)
        yield env


RECORD_NAME = "demo.json"
PAGE_NAME = "index.html"


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
    if options.all and options.display is None:
        require_screen()
    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    held = next(out.iterdir(), None)
    if held and not (out / RECORD_NAME).exists():
        raise StudyError(
            f"{out}: must be empty or made by 'metamerlab demo' (it holds {held.name} but no"
            f" {RECORD_NAME}); choose another --out, or move it away"
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
        self.study, self.display = load_study(
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
        steps = steps_of(self.options, self.study.study.name)
        todo = {step.name: step for step in steps if not self._is_kept(step)}
        with local_processes(min(2, cores())) as pool:
            try:
                self._run(todo, pool)
            except BrokenProcessPool:
                raise StudyError(
                    "a process of the demonstration was killed (out of memory?); run this again: it"
                    " goes on from there"
                ) from None
            except BaseException:
                pool.stop()
                raise
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
            options=self.options,
            out=os.path.relpath(self.out),
        )
        write_whole(self.out / PAGE_NAME, page_bytes(text))
        return self.out / PAGE_NAME

    def _paths(self, step: Step) -> list[Path]:
        """Return the pictures and videos that the page shows of a step."""
        return [path for pattern in step.shows for path in sorted(self.out.glob(pattern))]

    def _shown(self, step: Step) -> MediaRow:
        """Return them as parts of the page itself."""
        shots = []
        for path in self._paths(step):
            kind, _ = guess_type(path.name)
            name = path.name.partition(".")[0].replace("__", ", ") if path.suffix == ".webm" else ""
            data = b64encode(path.read_bytes()).decode("ascii")
            alt = f"{step.title}: {path.relative_to(self.out).as_posix()}"
            shots.append(MediaFile(f"data:{kind};base64,{data}", name, alt))
        return MediaRow(tuple(shots), least_rem={1: 60.0, 2: 30.0}.get(len(shots), 20.0))

    def _is_kept(self, step: Step) -> bool:
        """Return True for a step that is done; else what it left of other wishes is removed."""
        key = self.keys[step.name] = sha256_json(
            [
                code_revision(), self.study.sha256, self.display.model_dump(mode="json"),
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
            self.console.print(f"{step.title}: kept")
            return True
        if not begun:
            self._clear(step.named(step.clears))
        self.record[step.name] = {"key": key}
        self._note()
        return False

    def _run(self, todo: dict[str, Step], pool: LocalProcesses) -> None:
        """Run steps side by side, each when what it needs is done."""
        running: dict[str, list[Future[Said]]] = {}
        while todo:
            for name, step in todo.items():
                if name in running or any(need in todo for need in step.needs):
                    continue
                if step.when == "window" and running:
                    break  # the machine must be its own
                running[name] = self._begun(step, pool)
            waited = [one for chains in running.values() for one in chains if not one.done()]
            wait(waited, return_when=FIRST_COMPLETED)
            for name in [name for name in running if all(one.done() for one in running[name])]:
                self._end(todo.pop(name), [one.result() for one in running.pop(name)])

    def _begun(self, step: Step, pool: LocalProcesses) -> list[Future[Said]]:
        self.console.print(f"{step.title} ...", style="bold")
        out, chains = self.out.resolve(), step.chains()
        if step.when != "window":
            return [pool.submit(run_commands, chain, out, {}) for chain in chains]
        (session, *after), *_ = chains
        code = session[session.index("--participant") + 1]
        folder = self.out / "sessions" / self.study.study.name / code
        if folder.exists() and not is_stillborn(folder):
            session = ["session", "resume", *session[2:]]
        with ExitStack() as stack:
            own = self.options.display
            env = {} if own else stack.enter_context(virtual_screen(self.display))
            alone = stack.enter_context(local_processes(1))
            return [alone.submit(run_commands, [session, *after], out, env)]

    def _end(self, step: Step, chains: list[Said]) -> None:
        """Print and note what a step's commands said."""
        said = [one for chain, _ in chains for one in chain]
        for words, text in said:
            self.console.print(f"$ {words}")
            self.console.print(text)
        took_s = sum(seconds for _, seconds in chains)
        self.record[step.name] |= {"seconds": round(took_s, 2), "said": said}
        self._note()
        for path in self._paths(step):
            self.console.print(f"look at {path}", style="bold")

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
