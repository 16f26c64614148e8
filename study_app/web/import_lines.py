"""Lines from browsers become ordinary sessions: the plan is made again, each trial is run again.

Nothing that a browser claims is taken on trust. What comes next is asked of `next_step`; each
attempt is run on the stamps and keys that were observed, and must end as the browser says. A
participant whose lines contradict this is named and left out, whole.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Literal, TypeAlias

from protocols.browser.browser_window import shows_all, window_in_words
from protocols.browser.shared_links import (
    SharedLink,
    keep_sender,
    link_marks,
    session_marks,
    shared_links,
)
from protocols.browser.web_lines import (
    AnswerLine,
    AnyLine,
    AttemptLine,
    BlockEndLine,
    BlockStartLine,
    BreakLine,
    ConsentLine,
    EndLine,
    NoteLine,
    PauseLine,
    ResumeLine,
    StartLine,
)
from protocols.browser.web_study import deviations_s
from protocols.disk.hashing import sha256_json
from protocols.disk.result_folder import whole_folder
from protocols.display import Display
from protocols.errors import StudyError, must_be_one_of
from protocols.journal import (
    EVENT,
    AnyEvent,
    Attempt,
    BrowserWindow,
    Note,
    Remote,
    RemoteStart,
    SessionEnd,
    SessionResume,
    SessionStart,
)
from protocols.journal_file import JOURNAL_NAME, read_journal
from protocols.make_script import Scripts
from protocols.manifest import Manifest
from protocols.outside import shown
from protocols.plan import make_plan
from protocols.study_file.schema import StudyProtocol
from study_app.attempt import AttemptLog, WatchedGaze, attempt_event, run_attempt
from study_app.recorder import DiskError, Recorder, journal_held, write_numbered
from study_app.session import (
    AskConsent,
    AskQuestion,
    EndBlock,
    Finish,
    RunTrial,
    StartBlock,
    Step,
    TakeBreak,
    next_step,
)
from study_app.session_folders import (
    SessionFolder,
    find_sessions,
    require_portable,
    session_folder,
)
from study_app.stage import FlipPicture, FlipReport, KeyPress
from study_app.trial import Trial
from study_app.verification import verify
from study_app.web.check_lines import LineCheck, wrong
from study_app.web.export import WebBuild, stimuli_px
from study_app.web.heads import head_of
from study_app.web.histories import TreeLine, histories, left_by
from study_app.web.read_results import (
    BrowserResults,
    ContradictionError,
    ParticipantLines,
    whole_lines,
)

EVIDENCE = "animation frame"
"""Evidence for the stamps of a browser's flips."""
DISTURBANCES = {
    "focus": "the page lost the keyboard",
    "hidden": "the page was hidden",
    "full-screen": "the page left full screen",
    "size": "the window changed its size",
    "turned": "the head turned away",
    "session-end": "the headset's session ended",
    "controller-lost": "a controller was lost",
    "head-lost": "the head was not tracked",
}

State: TypeAlias = Literal["imported", "continued", "already there", "set aside", "refused"]


@dataclass(frozen=True)
class ImportResult:
    """Result of the import of one participant's lines."""

    participant: str
    state: State
    """`continued`: lines that came later were added to a session imported before. `set aside`:
    nobody took part."""
    message: str
    attempts: int = 0
    reason: str = ""
    """Reason for the end of the session; empty where it did not end."""
    begun: StartLine | None = None
    """Beginning of the session, where there is one now."""

    def sharing(self, shared: Sequence[SharedLink]) -> ImportResult:
        """Return the result that says, too, with whom its participant shares a link."""
        said = [str(one) for one in shared if self.begun and self.participant in one.participants]
        return replace(self, message="; ".join(filter(None, [self.message, *said])))


def import_results(
    inbox: BrowserResults,
    study: StudyProtocol,
    display: Display,
    manifest: Manifest,
    root: Path,
    *,
    write: bool = True,
) -> list[ImportResult]:
    """Make sessions of all lines of a study.

    Parameters
    ----------
    inbox : BrowserResults
        As `read_web_results` returns it.
    study, display, manifest : StudyProtocol, Display, Manifest
        Those of the export.
    root : Path
        Folder of all sessions.
    write : bool
        False: only say what would happen.

    Raises
    ------
    StudyError
        If there is no line of the study.
    """
    ours = {who: found for (name, who), found in inbox.found.items() if name == study.study.name}
    if not ours:
        others = ", ".join(sorted({name for name, _ in inbox.found})) or "none"
        raise StudyError(
            f"results: must hold lines of the study {study.study.name!r} (found lines of:"
            f" {others}); name that study's file, or other results"
        )
    sessions = find_sessions(root, study.study.name) if root.is_dir() else []
    known = [one for one in sessions if one.state not in ("damaged", "stillborn", "withdrawn")]
    slots = {
        one.journal.start.slot: one.participant
        for one in known
        if one.state != "refused" and one.journal.start.remote is None
    }
    marks = {one.participant: session_marks(one.journal.start, one.folder) for one in known}
    importer = _Importer(WebBuild(study, display, manifest), root, slots, write)
    results = []
    # Browsers draw small letters: who copies a code in capitals comes after.
    for who, found in sorted(ours.items(), key=lambda one: one[0].swapcase()):
        result = importer.participant(who, found)
        if result.begun is not None:
            sender = inbox.marks(found)
            begun = link_marks(result.begun.slot, result.begun.identifier, sender)
            marks[who] = begun.union(marks.get(who, ()))
            if write:
                keep_sender(session_folder(root, study, who), sender)
        results.append(result)
    shared = shared_links(marks)
    return [one.sharing(shared) for one in results]


@dataclass
class _Importer:
    """Import of a study's participants, one after the other, into a folder of sessions."""

    build: WebBuild
    root: Path
    slots: Mapping[int, str]
    """Participants of the lab's own sessions, by slot."""
    write: bool
    _session: RebuiltSession | None = None
    """The one that is being made."""

    def participant(self, who: str, found: ParticipantLines) -> ImportResult:
        """Import the first history of a participant that is a session; say what it leaves.

        Whatever their lines do, the others are imported.

        Raises
        ------
        StudyError
            If the disk refuses.
        OSError
            Likewise.
        """
        if found.simulated:
            return ImportResult(who, "set aside", "simulated: nobody took part")
        self._session = None
        try:
            return self._best(who, found)
        except DiskError as error:
            raise StudyError(
                f"{str(error).partition(';')[0]}: of {who} nothing was imported, and those before"
                " are whole; make room, and import again"
            ) from None
        except OSError:
            raise
        except Exception as error:  # a fault of ours, which costs no other participant
            must = "lines must be such as a page sends"
            if self._session:
                must = f"line number {self._session.line.n}: must be one that a page sends"
            what = f"{type(error).__name__}: {shown(error)}"
            return ImportResult(who, "refused", f"{must} ({what})")

    def _best(self, who: str, found: ParticipantLines) -> ImportResult:
        refused = ""
        for end in histories(found.told):
            kept = end.history
            try:
                result = self._history(who, kept)
            except DiskError:
                raise
            except StudyError as error:
                own = isinstance(error, ContradictionError)
                refused = refused or f"{'' if own else 'not as this study makes it: '}{error}"
            else:
                said = [f"{found.repeated} lines came more than once"] if found.repeated else []
                said += filter(None, [left_by(kept, found.told)])
                if refused:
                    said.append(f"another history was refused: {refused}")
                return replace(result, message="; ".join(said))
            if end.length <= end.n:
                break  # before all of the best one has come, no other is imported
        return ImportResult(who, "refused", refused)

    def _history(self, who: str, history: Sequence[TreeLine]) -> ImportResult:
        self._session = session = RebuiltSession(self.build, whole_lines(history))
        folder, start = session_folder(self.root, self.build.study, who), session.begun
        require_portable(folder)
        if start.slot_from != "drawn" and start.slot in self.slots:
            raise ContradictionError(
                f"slot {start.slot} is that of the lab's session {self.slots[start.slot]!r}: two"
                " people had one place; keep one of the two, and withdraw the other"
            )
        state: State = "imported"
        with whole_folder(folder) if self.write and not folder.exists() else _aside(who) as made:
            session.write(made)
            session.verify(made)
            if folder.exists():
                state = _beside(folder, made)
            if self.write and state == "continued":
                _continue(folder, made)
        return ImportResult(who, state, "", session.attempts, session.reason, start)


@contextmanager
def _aside(who: str) -> Iterator[Path]:
    """Give a folder for a session that only is looked at, or compared."""
    with tempfile.TemporaryDirectory(prefix="metamerlab-import-") as temporary:
        yield Path(temporary) / who


def _beside(folder: Path, made: Path) -> State:
    """Return the state of a session beside the one that the lab has under its code.

    Raises
    ------
    ContradictionError
        If it is another session.
    """
    path = folder / JOURNAL_NAME
    there = path.read_bytes() if path.exists() else b""
    ours = (made / JOURNAL_NAME).read_bytes()
    if there and ours.startswith(there):
        return "already there" if ours == there else "continued"
    if there.startswith(ours):
        return "already there"  # what came later was imported before
    raise ContradictionError(
        f"the code is that of another session ({folder}); a code is used once: keep one of the two,"
        " and withdraw the other"
    )


def _continue(folder: Path, made: Path) -> None:
    """Add to a session what came home since it was imported; nothing of it changes."""
    for path in sorted(one for one in made.rglob("*") if one.is_file()):
        place = folder / path.relative_to(made)
        if path.name != JOURNAL_NAME and not place.exists():
            place.parent.mkdir(exist_ok=True)
            write_numbered(place.with_suffix(""), place.suffix, path.read_bytes())
    journal, whole = folder / JOURNAL_NAME, (made / JOURNAL_NAME).read_bytes()
    with journal_held(journal), journal.open("r+b", buffering=0) as file:
        length = file.seek(0, os.SEEK_END)
        left = memoryview(whole)[length:]
        try:
            while left:
                left = left[file.write(left) :]
            os.fsync(file.fileno())
        except OSError:
            file.truncate(length)
            raise


class RebuiltSession:
    """One participant's session, made again from lines.

    Parameters
    ----------
    build : WebBuild
        The export.
    lines : iterator of lines
        All, in order.

    Raises
    ------
    ContradictionError
        If they do not begin as a session of this study does.
    """

    def __init__(self, build: WebBuild, lines: Iterator[AnyLine]) -> None:
        study, manifest = build.study, build.manifest
        begun = next(lines)
        if not isinstance(begun, StartLine):
            raise ContradictionError(f"line number 0 must be the start (got {begun.kind})")
        for what, now, then in (
            ("study file", study.sha256, begun.protocol_sha256),
            ("manifest of the stimuli", manifest.sha256, begun.manifest_sha256),
        ):
            if now != then:
                raise ContradictionError(
                    f"the {what} must be the one that was exported (hash {then[:12]}, got"
                    f" {now[:12]}); import with that one"
                )
        key = begun.places_key
        if key is not None and key != study.places_key:
            raise ContradictionError(
                f"places_key must be the export's, as in its study.json (got {key}): the line was"
                " changed, or is of another export"
            )
        self.line: AnyLine = begun
        self.checks = LineCheck(build, begun)
        self.checks.check(begun)
        self.begun, self.lines, self.build, self.manifest = begun, lines, build, manifest
        self.study = study.in_a_browser().ordered_by(begun.seed, key)
        self._run_at(begun.rate_hz)
        ordered = study.ordered_by(begun.seed, key)
        self.plan = make_plan(ordered, manifest, begun.participant, begun.slot)
        self._sources = [begun.n]
        self._now_s = 0.0
        self._window = BrowserWindow(
            **begun.machine.model_dump(include=set(BrowserWindow.model_fields))
        )
        """The one of the last line that told one."""
        self.attempts = 0
        self.reason = ""

    def _run_at(self, rate_hz: float) -> None:
        """Take display and scripts of a refresh rate from here on."""
        self.display = self.build.at(rate_hz)
        self.scripts = Scripts(self.study, self.display, self.begun.language, self.manifest)

    def write(self, folder: Path) -> None:
        """Write the journal with its side files.

        Raises
        ------
        ContradictionError
            Naming the line that does not follow from those before it.
        """
        with Recorder.create(folder, lambda: self._now_s, lambda: self.line.at) as recorder:
            recorder.waits_for_disk = False
            self._now_s = self.begun.t_s
            recorder.append(self._start(recorder))
            for line in self.lines:
                self.line, self._now_s = line, line.t_s
                self.checks.check(line)
                window = line.window if isinstance(line, AttemptLine) else None
                if window is not None and window != self._window:
                    self._window = window
                    recorder.append(Note(**recorder.stamps(), text=window_in_words(window)))
                recorder.append(self._event(line, recorder))
                self.attempts += isinstance(line, AttemptLine)
                if isinstance(line, AttemptLine) and line.disturbed:
                    text = DISTURBANCES[line.disturbed[1]]
                    recorder.append(Note(**recorder.stamps(), text=text))
                self._sources += [line.n] * (len(recorder.events) - len(self._sources))

    def verify(self, folder: Path) -> None:
        """Check what was written as 'session verify' does.

        Raises
        ------
        ContradictionError
            Naming the first line that something is wrong with.
        """
        journal = read_journal(folder / JOURNAL_NAME, lenient=True)
        for problem in verify(SessionFolder(folder, journal), self.build.study).problems[:1]:
            said = re.sub(
                r"^line (\d+)",
                lambda found: f"line number {self._sources[int(found[1]) - 1]}",
                problem,
            )
            raise ContradictionError(said)

    def _start(self, recorder: Recorder) -> SessionStart:
        begun = self.begun
        same = {"study", "participant", "slot", "language", "seed", "protocol_sha256"}
        return SessionStart(
            **recorder.stamps(),
            **begun.model_dump(include=same | {"manifest_sha256"}),
            task=self.study.task.kind,
            simulated=begun.machine.simulated,
            stimuli_sha256=self.study.stimuli_sha256,
            plan_sha256=self.plan.sha256,
            trials=self.plan.main_trials,
            display=self.display.name,
            display_sha256=sha256_json(self.display),
            display_report=None,
            refresh_hz=begun.rate_hz,
            gaze_mode="none",
            gaze=None,
            revision=begun.revision,
            versions={},
            platform=begun.machine.browser,
            timing_evidence=EVIDENCE,
            remote=Remote(
                **begun.model_dump(include=set(RemoteStart.model_fields)),
                deviations_s=deviations_s(self.study, self.display),
            ),
        )

    def _event(self, line: AnyLine, recorder: Recorder) -> AnyEvent:
        """Return the journal's event of a line: what it says, and what follows from the plan."""
        if isinstance(line, ResumeLine):
            self.reason = ""
            if changed := line.rate_hz != self.display.refresh_hz:
                self._run_at(line.rate_hz)
            return SessionResume(
                **recorder.stamps(),
                revision=self.begun.revision,
                versions={},
                display_report=None,
                gaze=None,
                torn_file=None,
                refresh_hz=line.rate_hz if changed else None,
                deviations_s=deviations_s(self.study, self.display) if changed else None,
            )
        if isinstance(line, EndLine):
            self._check_end(line, recorder)
            self.reason = line.reason
            done = sum(one.decides for one in recorder.events if isinstance(one, Attempt))
            return SessionEnd(**recorder.stamps(), reason=line.reason, completed_trials=done)
        planned: Mapping[str, object] = {}
        if not isinstance(line, PauseLine | NoteLine):
            step = next_step(self.study, self.plan, recorder.events, self.begun.language)
            if isinstance(step, RunTrial) and isinstance(line, AttemptLine):
                return self._attempt(step, line, recorder)
            planned = self._planned(step, line)
        return EVENT.validate_python({**line.told(), **planned, **recorder.stamps()})

    def _check_end(self, line: EndLine, recorder: Recorder) -> None:
        """Refuse an end that says that the session is over, where it is not."""
        step = next_step(self.study, self.plan, recorder.events, self.begun.language)
        over = isinstance(step, Finish) and ("completed" if step.consented else "consent-refused")
        if line.reason in ("completed", "consent-refused") and line.reason != over:
            what = f"reason must not be that, since there comes {_named(step)}"
            raise wrong(line, what, line.reason)

    def _planned(self, step: Step, line: AnyLine) -> Mapping[str, object]:
        """Return fields of the event that no line says, if the line is what comes next."""
        match step, line:
            case AskConsent(), ConsentLine():
                return {"language": self.begun.language}
            case StartBlock(block=due), BlockStartLine(block=said) if said == due:
                return {"trials": step.trials}
            case EndBlock(due), BlockEndLine(block=said) if said == due:
                return {}
            case TakeBreak(due), BreakLine(after_block=said) if said == due:
                return {}
            case AskQuestion(), AnswerLine(question=said) if said == step.question.name:
                choices = step.question.choices
                if choices and line.text not in choices:
                    raise wrong(line, must_be_one_of("text", line.text, choices))
                return {}
        raise wrong(line, f"must be what comes next, {_named(step)}", line.kind)

    def _attempt(self, step: RunTrial, line: AttemptLine, recorder: Recorder) -> Attempt:
        """Run a trial again on what was observed; return the event of what comes out."""
        planned = (step.trial.id, step.attempt, step.position)
        self._check(line, ("trial", "attempt", "position"), planned, "as the plan has it")
        script = self.scripts.of(step.trial)
        need_px, headset = stimuli_px(script), self.study.headset
        window_fits = headset is not None or shows_all(self._window, need_px)
        if line.outcome == "completed" and not window_fits:
            width, height = need_px
            must = f"the window must show {width} x {height} px of an attempt that counts"
            raise wrong(line, must, window_in_words(self._window))
        stage = ReplayedStage(line, self.display.refresh_hz)
        made: list[Attempt] = []

        def write(trial: Trial, log: AttemptLog) -> None:
            stage.written = True
            watched = [script.phases[entry.phase].watched for entry in log.flips]
            head = head_of(line, watched, headset, recorder)
            event = attempt_event(
                step, trial, log, script, self.manifest, recorder, {}, WatchedGaze()
            )
            made.append(event.model_copy(update=head))

        try:
            run_attempt(script, stage, None, write)
        except ValueError as error:
            raise wrong(line, "flips must be such as a screen shows", error) from None
        (event,) = made
        void = event.void_reason == "focus-lost"
        if void != (line.disturbed is not None):
            raise wrong(line, f"disturbed must {'not ' * (not void)}be given", line.disturbed)
        ran, ends = (event.outcome, event.void_reason, event.answer), "as the trial comes out"
        self._check(line, ("outcome", "void_reason", "answer"), ran, ends)
        if stage.used != len(line.flips_us):
            raise wrong(line, f"flips must be {stage.used}, {ends}", len(line.flips_us))
        return event

    def _check(
        self, line: AttemptLine, keys: Sequence[str], ours: Sequence[object], why: str
    ) -> None:
        """Refuse a line that says something else than we do."""
        for key, must in zip(keys, ours, strict=True):
            if (found := getattr(line, key)) != must:
                raise wrong(line, f"{key} must be {must}, {why}", str(found))


class ReplayedStage:
    """A stage that shows again what a browser showed: its stamps, its keys.

    Once the outcome is written, flips come in time and nothing happens any more.
    """

    def __init__(self, line: AttemptLine, refresh_hz: float) -> None:
        self._line, self._period_s = line, 1 / refresh_hz
        self._stamps_s = [us / 1e6 for us in accumulate(line.flips_us)]
        self.refresh_hz = refresh_hz
        self.used = 0
        """Flips that were shown until the outcome was written."""
        self.written = False
        """True if the outcome was written."""
        self._shown = 0
        self._presses: dict[int, list[KeyPress]] = defaultdict(list)
        for press in line.presses:
            key = KeyPress(press.key, press.at_us / 1e6, press.x or 0.0)
            self._presses[press.flip].append(key)

    def now(self) -> float:
        """Return the stamp of the last flip."""
        return self._stamps_s[self._shown - 1]

    def show(self, _picture: FlipPicture) -> FlipReport:
        """Return the next flip that was observed; `ValueError` where the trial needs more."""
        if self._shown == len(self._stamps_s):
            if not self.written:
                raise ValueError(f"{self._shown} of them, and the trial goes on")
            self._stamps_s.append(self._stamps_s[-1] + self._period_s)
        self._shown += 1
        self.used = min(self._shown, len(self._line.flips_us))
        return FlipReport(self._stamps_s[self._shown - 1], self._shown - 1, EVIDENCE)

    def key_presses(self) -> Sequence[KeyPress]:
        """Return the keys that were read after this flip."""
        return self._presses[self._shown - 1]

    def disturbed(self) -> str:
        """Return the disturbance between participant and page after this flip."""
        flip, what = self._line.disturbed or (-1, "")
        return DISTURBANCES[what] if flip == self._shown - 1 else ""


_STEPS: Mapping[type[Step], str] = {
    AskConsent: "consent",
    StartBlock: "the start of block {block}",
    EndBlock: "the end of block {block}",
    TakeBreak: "the break after block {after_block}",
    AskQuestion: "the answer to {question.name!r}",
    RunTrial: "attempt {attempt} at {trial.id}",
    Finish: "the end",
}


def _named(step: Step) -> str:
    """Return a step in words."""
    return _STEPS[type(step)].format(**vars(step))
