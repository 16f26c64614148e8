"""Conducts a sitting: asks `next_step` what to do, does it on the stage, writes it down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from protocols.hashing import sha256_bytes
from protocols.journal import (
    Answer,
    Attempt,
    BlockEnd,
    BlockStart,
    Break,
    Consent,
    Note,
    Pause,
    SessionEnd,
    SessionStart,
    VoidReason,
)
from protocols.plan import Plan
from study_app.attempt import Log, Watcher, attempt_event, run_attempt
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.geometry import Viewing
from study_app.gaze.source import GazeSource
from study_app.opening import Setting, texts_of
from study_app.recorder import Recorder
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
from study_app.stage import Page, PageResult, Stage
from study_app.trial import Timeline, Trial
from study_app.wording import fill

EndReason = Literal["completed", "quit", "consent-refused", "tracker-lost", "error"]


@dataclass(frozen=True)
class Outcome:
    """How a run of the program ended."""

    reason: EndReason
    main_done: int
    main_planned: int
    given_up: tuple[str, ...]


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
        self._texts = texts_of(self._protocol, self._language)
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
                result = self._page(
                    "break", texts.break_page, least_s=self._protocol.design.break_s, done=block
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
                    Page(
                        "question",
                        self._filled(question.text),
                        self._keys(),
                        choices=question.choices,
                    )
                )
                recorder.append(
                    Answer(**recorder.stamps(), question=question.name, text=result.answer)
                )
        return True

    def _consent(self) -> bool:
        contact = self._protocol.privacy.contact
        text = self._filled(self._texts.consent + (f"\n\n{contact}" if contact else ""))
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
                Page(
                    "quit",
                    self._filled(self._texts.quit_question),
                    (*keys.quit_keys, *keys.continue_keys),
                )
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

    def _page(
        self, name: str, text: str, *, least_s: float = 0.0, wait: bool = True, done: int = 0
    ) -> PageResult:
        keys = self._keys() if wait else ()
        return self._stage.page(Page(name, self._filled(text, done), keys, least_s=least_s))

    def _filled(self, text: str, done: int = 0) -> str:
        return fill(text, self._protocol.response, done=done, total=max(self._plan.blocks))

    def _quit_pressed(self, result: PageResult) -> bool:
        return result.key in self._protocol.response.quit_keys
