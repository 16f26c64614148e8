"""Conducts a sitting: asks `next_step` what to do, does it on the stage, writes it down."""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import require_feasible
from protocols.hashing import sha256_bytes, sha256_json
from protocols.journal import (
    Answer,
    Attempt,
    BlockEnd,
    BlockStart,
    Break,
    Consent,
    DisplayReport,
    GazeInfo,
    Note,
    Pause,
    SessionEnd,
    SessionResume,
    SessionStart,
    VoidReason,
)
from protocols.journal_file import JOURNAL_NAME
from protocols.manifest import Manifest, check_manifest
from protocols.plan import Plan, make_plan
from protocols.revision import code_revision, package_version
from protocols.schema import StudyProtocol
from protocols.session_schema import Texts
from study_app.attempt import Log, Watcher, attempt_event, run_attempt
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.geometry import Viewing
from study_app.gaze.source import GazeSource
from study_app.recorder import DiskError, Recorder
from study_app.session import (
    AskConsent,
    AskQuestion,
    EndBlock,
    Finish,
    RunTrial,
    StartBlock,
    Step,
    TakeBreak,
    given_up,
    next_step,
)
from study_app.sittings import claimed, is_stillborn, next_slot, sitting_folder
from study_app.stage import Page, PageResult, Stage
from study_app.trial import Timeline, Trial

EndReason = Literal["completed", "quit", "consent-refused", "tracker-lost", "error"]


@dataclass(frozen=True)
class Setting:
    """Everything a sitting depends on besides the participant."""

    protocol: StudyProtocol
    display: Display
    manifest: Manifest
    root: Path
    """Folder of all sittings."""
    wall_clock: Callable[[], str]
    """UTC as ``2026-01-31T12:00:00Z``."""
    simulated: bool = False
    display_report: DisplayReport | None = None
    timing_evidence: str = ""


@dataclass(frozen=True)
class Outcome:
    """How a run of the program ended."""

    reason: EndReason
    main_done: int
    main_planned: int
    given_up: tuple[str, ...]


def begin(
    setting: Setting, participant: str, language: str, stage: Stage, gaze: GazeSource | None
) -> tuple[Recorder, Plan]:
    """Give a new participant a slot and a plan, and write the first line.

    Raises
    ------
    StudyError
        If the display cannot do the protocol, the manifest is another study's, the code was
        used, the language is missing, or the folder cannot be written. Nothing is written then.
    """
    protocol = setting.protocol
    require_feasible(protocol, setting.display, setting.manifest)
    check_manifest(protocol, setting.manifest)
    _check_rate(setting.display, stage)
    _texts(protocol, language)
    info = _gaze_info(protocol, gaze)
    folder = sitting_folder(setting.root, protocol, participant)
    if folder.exists() and not is_stillborn(folder):
        raise StudyError(
            f"participant: a code is used once (got {participant!r}, which has"
            f" {folder}); take another code, or 'metamerlab session resume' to go on"
        )
    with claimed(setting.root):
        slot = next_slot(setting.root, protocol.study.name)
        plan = make_plan(protocol, setting.manifest, participant, slot)
        torn = (folder / JOURNAL_NAME).exists()
        open_journal = Recorder.resume if torn else Recorder.create
        recorder = open_journal(folder, stage.now, setting.wall_clock)
        recorder.append(
            SessionStart(
                **recorder.stamps(),
                study=protocol.study.name,
                participant=participant,
                slot=slot,
                language=language,
                seed=protocol.design.seed,
                simulated=setting.simulated,
                protocol_sha256=protocol.sha256,
                stimuli_sha256=protocol.stimuli_sha256,
                manifest_sha256=setting.manifest.sha256,
                plan_sha256=plan.sha256,
                trials=plan.main_trials,
                display=setting.display.name,
                display_sha256=sha256_json(setting.display),
                display_report=setting.display_report,
                refresh_hz=stage.refresh_hz,
                gaze_mode=protocol.gaze.mode,
                gaze=info,
                revision=f"{package_version()} {code_revision()}",
                versions=versions(),
                platform=platform.platform(),
                timing_evidence=setting.timing_evidence,
            )
        )
    return recorder, plan


def resume(
    setting: Setting, participant: str, stage: Stage, gaze: GazeSource | None
) -> tuple[Recorder, Plan]:
    """Go on with a sitting that stopped: same plan, same order.

    Raises
    ------
    StudyError
        If there is no such sitting, it is complete or withdrawn, its journal is damaged, or
        protocol, clips or display are not what it was begun with.
    """
    protocol = setting.protocol
    require_feasible(protocol, setting.display, setting.manifest)
    _check_rate(setting.display, stage)
    info = _gaze_info(protocol, gaze)
    folder = sitting_folder(setting.root, protocol, participant)
    recorder = Recorder.resume(folder, stage.now, setting.wall_clock)
    try:
        plan = _same_plan(setting, participant, recorder)
        recorder.append(
            SessionResume(
                **recorder.stamps(),
                revision=f"{package_version()} {code_revision()}",
                versions=versions(),
                display_report=setting.display_report,
                gaze=info,
                torn_file=recorder.torn_file,
            )
        )
    except StudyError:
        recorder.close()
        raise
    return recorder, plan


def conduct(
    setting: Setting,
    plan: Plan,
    recorder: Recorder,
    stage: Stage,
    gaze: GazeSource | None,
    *,
    on_attempt: Callable[[Attempt], None] = lambda _: None,
) -> Outcome:
    """Run a sitting from where its journal stands to its end, or until it is stopped.

    Raises
    ------
    DiskError
        If the disk is full: the journal ends with the last whole event.
    """
    conductor = _Conductor(setting, plan, recorder, stage, gaze, on_attempt)
    reason = conductor.run()
    attempts = [event for event in recorder.events if isinstance(event, Attempt)]
    done = sum(
        attempt.outcome == "completed" and not attempt.practice and not attempt.catch
        for attempt in attempts
    )
    recorder.append(SessionEnd(**recorder.stamps(), reason=reason, completed_trials=done))
    missing = given_up(plan, attempts, setting.protocol.design.max_attempts)
    return Outcome(reason, done, plan.main_trials, tuple(missing))


def versions() -> dict[str, str]:
    """Return the versions a session depends on."""
    found = {"python": sys.version.split()[0]}
    for name in ("moderngl", "glfw", "numpy", "pydantic", "pillow"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


def _check_rate(display: Display, stage: Stage) -> None:
    off = stage.refresh_hz / display.refresh_hz - 1
    if abs(off) > display.refresh_tolerance_share:
        raise StudyError(
            f"display {display.name!r}: must refresh at {display.refresh_hz:g} Hz within"
            f" {100 * display.refresh_tolerance_share:g} % (got {stage.refresh_hz:.6g} Hz); set"
            " the mode, or name the display that is there"
        )


def _texts(protocol: StudyProtocol, language: str) -> Texts:
    try:
        return protocol.text.languages[language]
    except KeyError:
        raise StudyError(
            f"language: must be one of {', '.join(protocol.text.languages)} (got {language!r})"
        ) from None


def _gaze_info(protocol: StudyProtocol, gaze: GazeSource | None) -> GazeInfo | None:
    mode = protocol.gaze.mode
    if mode == "none":
        return None
    if gaze is None:
        raise StudyError(
            f"gaze: mode {mode!r} needs a gaze source; connect one, or set gaze.mode = 'none'"
        )
    info = gaze.info()
    if info.rate_hz < protocol.gaze.rate_min_hz:
        raise StudyError(
            f"gaze: the source must send at least {protocol.gaze.rate_min_hz:g} Hz"
            f" (got {info.rate_hz:g} Hz from {info.source})"
        )
    return GazeInfo(source=info.source, description=info.description, rate_hz=info.rate_hz)


def _same_plan(setting: Setting, participant: str, recorder: Recorder) -> Plan:
    """Return the plan the sitting was begun with, or say what has changed since."""
    events = recorder.events
    if not events or not isinstance(events[0], SessionStart):
        raise StudyError(f"{recorder.path}: must begin with a session-start event; start anew")
    start = events[0]
    last = events[-1]
    if isinstance(last, SessionEnd) and last.reason in {"completed", "consent-refused"}:
        raise StudyError(f"{recorder.path}: the session is over ({last.reason})")
    for what, now, then in (
        ("protocol", setting.protocol.sha256, start.protocol_sha256),
        ("manifest of the clips", setting.manifest.sha256, start.manifest_sha256),
        ("display", sha256_json(setting.display), start.display_sha256),
    ):
        if now != then:
            raise StudyError(
                f"{recorder.path}: the {what} must be the one the session began with (hash"
                f" {then[:12]}, got {now[:12]}); restore it to go on"
            )
    if start.simulated != setting.simulated:
        raise StudyError(f"{recorder.path}: simulated and real sessions must not be mixed")
    plan = make_plan(setting.protocol, setting.manifest, participant, start.slot)
    if plan.sha256 != start.plan_sha256:
        raise StudyError(
            f"{recorder.path}: the plan must come out as it did (hash {start.plan_sha256[:12]},"
            f" got {plan.sha256[:12]}); resume with revision {start.revision}"
        )
    return plan


class _Conductor:
    """One run of a sitting."""

    def __init__(
        self,
        setting: Setting,
        plan: Plan,
        recorder: Recorder,
        stage: Stage,
        gaze: GazeSource | None,
        on_attempt: Callable[[Attempt], None],
    ) -> None:
        self._setting, self._plan, self._recorder = setting, plan, recorder
        self._stage, self._on_attempt = stage, on_attempt
        self._protocol = setting.protocol
        start = recorder.events[0]
        assert isinstance(start, SessionStart)
        self._language = start.language
        self._texts = _texts(self._protocol, self._language)
        self._timeline = Timeline.of(self._protocol, setting.display)
        self._watcher = None
        if gaze is not None and self._protocol.gaze.mode != "none":
            timing = self._protocol.trial
            monitor = FixationMonitor(
                self._protocol.gaze,
                Viewing.of(setting.display),
                (timing.fixation_x_deg, timing.fixation_y_deg),
                gaze.info().rate_hz,
            )
            self._watcher = Watcher(gaze, monitor)

    def run(self) -> EndReason:
        """Do step after step."""
        while True:
            step = next_step(self._protocol, self._plan, self._recorder.events, self._language)
            if isinstance(step, Finish):
                if not step.consented:
                    return "consent-refused"
                self._page("thanks", self._texts.thanks, wait=False)
                return "completed"
            if not self._do(step):
                return "quit"

    def _do(self, step: Step) -> bool:
        """Do one step; False where the sitting is to stop."""
        recorder, texts = self._recorder, self._texts
        match step:
            case AskConsent():
                return self._consent()
            case StartBlock(block, trials, first):
                if first and not self._instructions():
                    return False
                if not self._announce(block):
                    return False
                recorder.append(BlockStart(**recorder.stamps(), block=block, trials=trials))
            case RunTrial():
                return self._trial(step)
            case EndBlock(block):
                recorder.append(BlockEnd(**recorder.stamps(), block=block))
            case TakeBreak(block):
                total = max(self._plan.blocks)
                text = texts.break_page.replace("{done}", str(block))
                result = self._page(
                    "break",
                    text.replace("{total}", str(total)),
                    least_s=self._protocol.design.break_s,
                )
                if self._quit_pressed(result):
                    return False
                recorder.append(
                    Break(
                        **recorder.stamps(),
                        after_block=block,
                        duration_s=round(result.duration_s, 6),
                    )
                )
            case AskQuestion(question):
                result = self._stage.page(
                    Page("question", question.text, self._keys(), choices=question.choices)
                )
                recorder.append(
                    Answer(**recorder.stamps(), question=question.name, text=result.answer)
                )
        return True

    def _consent(self) -> bool:
        contact = self._protocol.privacy.contact
        text = self._texts.consent + (f"\n\n{contact}" if contact else "")
        result = self._page("consent", text)
        self._recorder.append(
            Consent(
                **self._recorder.stamps(),
                agreed=result.key in self._protocol.response.continue_keys,
                language=self._language,
                text_sha256=sha256_bytes(text.encode("utf-8")),
            )
        )
        return True

    def _instructions(self) -> bool:
        return all(
            not self._quit_pressed(self._page("instructions", text))
            for text in self._texts.instructions
        )

    def _announce(self, block: int) -> bool:
        """Show the page before practice or before the first main block."""
        if block == 0:
            return not self._quit_pressed(self._page("practice", self._texts.practice))
        if block == next(number for number in self._plan.blocks if number > 0):
            return not self._quit_pressed(self._page("start", self._texts.start))
        return True

    def _trial(self, step: RunTrial) -> bool:
        self._stage.prepare(step.trial, step.attempt)
        if self._watcher:
            self._watcher.source.mark(f"{step.trial.id} attempt {step.attempt}")

        def write(trial: Trial, log: Log) -> None:
            event = attempt_event(
                step.trial,
                step.attempt,
                step.position,
                trial,
                log,
                self._timeline,
                self._setting.manifest,
                self._recorder,
                store_gaze=self._protocol.privacy.store_gaze,
            )
            self._recorder.append(event)
            self._on_attempt(event)

        result = run_attempt(
            step.trial,
            self._timeline,
            self._protocol.response,
            self._stage,
            self._watcher,
            write,
        )
        return self._interrupted(result.interrupts, result.trial.void_reason)

    def _interrupted(
        self, interrupts: tuple[VoidReason, ...], void_reason: VoidReason | None
    ) -> bool:
        """Ask once after the quit key; rest after the pause key or a lost focus."""
        if "quit" in interrupts:
            keys = self._protocol.response
            result = self._stage.page(
                Page("quit", self._texts.quit_question, (*keys.quit_keys, *keys.continue_keys))
            )
            return not self._quit_pressed(result)
        if "paused" in interrupts or void_reason == "focus-lost":
            if void_reason == "focus-lost":
                self._recorder.append(
                    Note(**self._recorder.stamps(), text="another window took the keyboard")
                )
            result = self._page("paused", self._texts.paused)
            self._recorder.append(
                Pause(**self._recorder.stamps(), duration_s=round(result.duration_s, 6))
            )
            return not self._quit_pressed(result)
        return True

    def _keys(self) -> tuple[str, ...]:
        response = self._protocol.response
        return (*response.continue_keys, *response.quit_keys)

    def _page(self, name: str, text: str, *, least_s: float = 0.0, wait: bool = True) -> PageResult:
        return self._stage.page(Page(name, text, self._keys() if wait else (), least_s=least_s))

    def _quit_pressed(self, result: PageResult) -> bool:
        return result.key in self._protocol.response.quit_keys


__all__ = ["DiskError", "Outcome", "Setting", "begin", "conduct", "resume", "versions"]
