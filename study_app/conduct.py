"""Conducts a session: asks `next_step` what to do, does it on the stage, writes it down."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

from protocols.disk.hashing import sha256_bytes
from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.journal import (
    Answer,
    Attempt,
    BlockEnd,
    BlockStart,
    Break,
    Consent,
    Pause,
    SessionEnd,
    SessionStart,
    VoidReason,
)
from protocols.make_script import Scripts
from protocols.plan import Plan
from protocols.study_file.session_schema import (
    ClosingQuestion,
    Response,
    Texts,
    consent_text,
    filled_text,
)
from study_app.attempt import (
    AttemptLog,
    AttemptResult,
    GazeWatcher,
    WatchedGaze,
    attempt_event,
    run_attempt,
)
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.gaze_check import GazeCheck
from study_app.gaze.saccades import SaccadeWatch
from study_app.gaze.source import GazeSource, RawFile, Tracker
from study_app.pacing import cannot_keep_up
from study_app.recorder import DiskError, Recorder
from study_app.session import (
    NOT_THE_PARTICIPANTS,
    AskConsent,
    AskQuestion,
    EndBlock,
    Finish,
    RunTrial,
    StartBlock,
    Step,
    TakeBreak,
    following,
    given_up,
    next_step,
)
from study_app.session_setup import SessionListener, SessionSetup
from study_app.stage import Page, PageResult, Stage
from study_app.trial import Trial

_RAW_FILES_MOST = 20
"""Files that a tracker may have of one run."""
IDLE_MOST = 20
"""So many attempts in a row that are void by what nobody takes away end a simulated run."""
EndReason = Literal["completed", "quit", "consent-refused", "tracker-lost", "error"]


@dataclass(frozen=True)
class RunOutcome:
    """End of a run of the program."""

    reason: EndReason
    main_done: int
    main_planned: int
    given_up: tuple[str, ...]


def conduct(
    setup: SessionSetup,
    plan: Plan,
    recorder: Recorder,
    stage: Stage,
    gaze: GazeSource | None,
    listener: SessionListener | None = None,
    gaze_check: GazeCheck | None = None,
) -> RunOutcome:
    """Run a session from where its journal stands to its end, or until it is stopped.

    Parameters
    ----------
    setup : SessionSetup
        As the session was begun, or gone on with.
    plan, recorder : Plan, Recorder
        As `begin` or `resume` returned them.
    stage, gaze : Stage, GazeSource or None
        Open.
    listener : SessionListener
        Told every attempt, and what happens when.
    gaze_check : GazeCheck, optional
        Validates the gaze source before each block; left out: nothing is validated.

    Raises
    ------
    DiskError
        If the disk is full: the journal ends with the last whole event.
    StudyError
        If a clip is missing or changed, gaze cannot be judged, or the display cannot keep up: the
        journal says so.
    """
    conductor = _Conductor(
        setup, plan, recorder, stage, gaze, listener or SessionListener(), gaze_check
    )
    try:
        reason = conductor.run()
    except DiskError:
        raise
    except StudyError as error:
        conductor.hear_tracker()
        done = _main_done(recorder)
        recorder.append(
            SessionEnd(
                **recorder.stamps(), reason="error", completed_trials=done, message=str(error)
            )
        )
        raise
    conductor.hear_tracker()
    attempts = [event for event in recorder.events if isinstance(event, Attempt)]
    done = _main_done(recorder)
    recorder.append(SessionEnd(**recorder.stamps(), reason=reason, completed_trials=done))
    missing = given_up(plan, attempts, setup.study.design.max_attempts)
    return RunOutcome(reason, done, plan.main_trials, tuple(missing))


def _main_done(recorder: Recorder) -> int:
    return sum(event.decides for event in recorder.events if isinstance(event, Attempt))


class _Conductor:
    """One run of a session."""

    def __init__(
        self,
        setup: SessionSetup,
        plan: Plan,
        recorder: Recorder,
        stage: Stage,
        gaze: GazeSource | None,
        listener: SessionListener,
        gaze_check: GazeCheck | None,
    ) -> None:
        start = recorder.events[0]
        assert isinstance(start, SessionStart)
        setup = replace(setup, language=start.language)
        self._setup, self._plan, self._recorder = setup, plan, recorder
        self._stage, self._listener = stage, listener
        self._study, self._texts = setup.study, setup.texts
        self._attempts = list[Attempt]()
        self._between = ""  # what came between participant and display, last
        self._scripts = Scripts(self._study, setup.display, setup.spoken, setup.manifest)
        self._pages = Dialogue(stage, self._study.response, self._texts, max(plan.blocks))
        self._watcher = None
        if gaze is not None and self._study.gaze.mode != "none":
            timing = self._study.trial
            info, viewing = gaze.info(), Viewing.of(setup.display)
            monitor = FixationMonitor(
                self._study.gaze,
                viewing,
                (timing.fixation_x_deg, timing.fixation_y_deg),
                info.rate_hz,
                polled=info.polled,
            )
            watch = None
            if self._study.stimuli.follows_gaze:
                watch = SaccadeWatch(math.radians(viewing.distance_mm / viewing.pitch_x_mm))
            self._watcher = GazeWatcher(gaze, monitor, watch)
            stage.follow(self._watcher, polled=info.polled)
        self._gaze_check = gaze_check if self._watcher is not None else None

    def run(self) -> EndReason:
        """Do step after step."""
        while True:
            step = next_step(self._study, self._plan, self._recorder.events, self._setup.spoken)
            if isinstance(step, Finish):
                if not step.consented:
                    return "consent-refused"
                self._pages.show("thanks", self._texts.thanks, wait=False)
                return "completed"
            if not self._do(step):
                return "quit"
            if isinstance(step, RunTrial) and self._tracker_lost():
                return "tracker-lost"
            if self._all_void(self._setup.late_most, {"dropped-frames"}):
                raise self._too_slow()
            # Nobody takes the cause away, and these voids do not use up `max_attempts`.
            if self._setup.simulated and self._all_void(IDLE_MOST, NOT_THE_PARTICIPANTS):
                raise self._stands_still()

    def _tracker_lost(self) -> bool:
        silence_s = self._study.gaze.silence_s
        return self._watcher is not None and self._watcher.stays_silent(self._stage, silence_s)

    def _all_void(self, most: int, reasons: Collection[VoidReason]) -> bool:
        """Return True if the last so many attempts of this run are void for such reasons."""
        last = self._attempts[-most:]
        return len(last) == most and all(each.void_reason in reasons for each in last)

    def _stands_still(self) -> StudyError:
        """Return the error on a simulated run whose attempts come to nothing again and again."""
        cause = self._between or "the pause key went down"
        return StudyError(
            f"a simulated session must get on (its last {IDLE_MOST} attempts are void: {cause});"
            " everything up to here is saved. Close what comes between, turn 'do not disturb' on,"
            " screen saver and lock off, and leave the keyboard alone; then run 'metamerlab session"
            " resume'"
        )

    def _too_slow(self) -> StudyError:
        """Return the error on a display that made the last attempts void."""
        attempts = self._attempts[-self._setup.late_most :]
        late = [phase for each in attempts for phase in each.phases if phase.dropped]
        words = cannot_keep_up(
            self._stage.refresh_hz,
            sum(phase.dropped for phase in late),
            sum(phase.refreshes for phase in late),
        )
        return StudyError(
            f"display {self._setup.display.name!r}: {words}; the last {len(attempts)} attempts"
            " are void, and everything up to here is saved. Close what else runs, or take a faster"
            " machine, then run 'metamerlab session resume'. A lower refresh rate, a lower"
            " resolution or smaller stimuli need a new session"
        )

    def _do(self, step: Step) -> bool:
        """Do one step; False where the session is to stop."""
        recorder, texts = self._recorder, self._texts
        match step:
            case AskConsent():
                return self._consent()
            case StartBlock(block, trials, first):
                if first and any(
                    self._pages.quit_pressed(self._pages.show("instructions", text))
                    for text in texts.instructions
                ):
                    return False
                if not self._announce(block):
                    return False
                if not self._gaze_passed(block):
                    return False
                recorder.append(BlockStart(**recorder.stamps(), block=block, trials=trials))
                self._listener.on_mark(f"block {block}", self._stage.now())
            case RunTrial():
                return self._gaze_passed(step.trial.block) and self._trial(step)
            case EndBlock(block):
                recorder.append(BlockEnd(**recorder.stamps(), block=block))
            case TakeBreak(block):
                result = self._pages.show(
                    "break", texts.break_page, least_s=self._study.design.break_s, done=block
                )
                if self._pages.quit_pressed(result):
                    return False
                recorder.append(
                    Break(
                        **recorder.stamps(),
                        after_block=block,
                        duration_s=round(result.duration_s, 6),
                    )
                )
            case AskQuestion(question):
                result = self._pages.ask(question)
                if self._pages.quit_pressed(result):
                    return False
                recorder.append(
                    Answer(**recorder.stamps(), question=question.name, text=result.answer)
                )
        return True

    def _consent(self) -> bool:
        text = self._pages.filled(consent_text(self._texts, self._study.privacy.contact))
        result = self._pages.show("consent", text)
        self._recorder.append(
            Consent(
                **self._recorder.stamps(),
                agreed=result.key in self._study.response.continue_keys,
                language=self._setup.spoken,
                text_sha256=sha256_bytes(text.encode("utf-8")),
            )
        )
        return True

    def _announce(self, block: int) -> bool:
        """Show the page before practice or before the first main block."""
        if block == 0:
            return not self._pages.quit_pressed(self._pages.show("practice", self._texts.practice))
        if block == next(number for number in self._plan.blocks if number > 0):
            return not self._pages.quit_pressed(self._pages.show("start", self._texts.start))
        return True

    def _gaze_passed(self, block: int) -> bool:
        return self._gaze_check is None or self._gaze_check.passed(block)

    def _trial(self, step: RunTrial) -> bool:
        script, on_mark = self._scripts.of(step.trial), self._listener.on_mark
        self._stage.prepare(step.trial, script, step.attempt)
        after = following(self._study, self._plan, self._recorder.events, step.trial)
        if after is not None:
            self._stage.expect(after)
        if self._watcher:
            self._watcher.source.mark(f"{step.trial.id} attempt {step.attempt}")

        def write(trial: Trial, log: AttemptLog) -> None:
            event = attempt_event(
                step,
                trial,
                log,
                script,
                self._setup.manifest,
                self._recorder,
                self._stage.kept(),
                WatchedGaze(
                    self._watcher.saccades_since(log.flips[0].flip.t_s) if self._watcher else (),
                    self._study.privacy.store_gaze,
                ),
            )
            self._recorder.append(event)
            self._attempts.append(event)
            self._between = log.disturbance
            self._listener.on_attempt(event, self._recorder.events)

        result = run_attempt(
            script,
            self._stage,
            self._watcher,
            write,
            lambda phase, t_s: on_mark(f"{step.trial.id} attempt {step.attempt} {phase}", t_s),
        )
        self.hear_tracker(f"{step.position:04d}")
        return self._interrupted(result)

    def hear_tracker(self, stem: str = "end") -> None:
        """Note what happened to the gaze source, and keep what its tracker recorded or sent."""
        source = self._watcher.source if self._watcher else None
        if not isinstance(source, Tracker):
            return
        recorder, over = self._recorder, stem == "end"
        told, files = list(source.news()), list[RawFile]()
        for _ in range(_RAW_FILES_MOST if over else 1):
            try:
                raw = source.raw(over=over)
            except StudyError as error:
                if str(error) in told:
                    break
                told.append(str(error))
                continue
            if raw is None:
                break
            files.append(raw)
        for text in told:
            recorder.note(text)
        for number, raw in enumerate(files if self._study.privacy.store_gaze else (), 1):
            name = f"tracker/{stem}" + f"-{number}" * (number > 1)
            file = recorder.side_file(name, raw.suffix, raw.data)
            recorder.note("gaze: the tracker's own data", file)

    def _interrupted(self, result: AttemptResult) -> bool:
        """Ask once after the quit key; rest after the pause key or a disturbance."""
        interrupts, void_reason = result.interrupts, result.trial.void_reason
        if "quit" in interrupts:
            return not self._pages.quit_pressed(self._pages.ask_to_quit())
        if "paused" in interrupts or void_reason == "focus-lost":
            if void_reason == "focus-lost":
                self._recorder.note(result.log.disturbance)
            page = self._pages.show("paused", self._texts.paused)
            self._recorder.append(
                Pause(**self._recorder.stamps(), duration_s=round(page.duration_s, 6))
            )
            return not self._pages.quit_pressed(page)
        return True


class Dialogue:
    """Shows a participant's pages on a stage.

    Parameters
    ----------
    stage : Stage
        Open.
    response : Response
        Whose keys turn pages and quit.
    texts : Texts
        In the participant's language.
    blocks : int
        How many there are in all.
    """

    def __init__(self, stage: Stage, response: Response, texts: Texts, blocks: int) -> None:
        self._stage, self._response = stage, response
        self._texts, self._blocks = texts, blocks
        self.keys = (*response.continue_keys, *response.quit_keys)

    def show(
        self, name: str, text: str, *, least_s: float = 0.0, wait: bool = True, done: int = 0
    ) -> PageResult:
        """Show a page; after the quit key ask, and show it again if the session goes on."""
        keys = self.keys if wait else ()
        share = done / self._blocks if done else 0.0
        page = Page(name, self.filled(text, done), keys, least_s=least_s, done_share=share)
        result = self._stage.page(page)
        while name != "paused" and self.quit_pressed(result):
            asked = self.ask_to_quit()
            if self.quit_pressed(asked):
                return asked
            result = self._stage.page(page)
        return result

    def ask(self, question: ClosingQuestion) -> PageResult:
        """Ask a closing question; what was typed stays where the session goes on after all."""
        draft = ""
        while True:
            page = Page(
                "question",
                self.filled(question.text),
                self.keys,
                choices=question.choices,
                draft=draft,
            )
            result = self._stage.page(page)
            if not self.quit_pressed(result):
                return result
            asked = self.ask_to_quit()
            if self.quit_pressed(asked):
                return asked
            draft = result.answer

    def ask_to_quit(self) -> PageResult:
        """Ask whether to stop."""
        keys = self._response
        text = self.filled(self._texts.quit_question)
        return self._stage.page(Page("quit", text, (*keys.quit_keys, *keys.continue_keys)))

    def filled(self, text: str, done: int = 0) -> str:
        """Return a text with its placeholders replaced."""
        return filled_text(text, self._response, done=done, total=self._blocks)

    def quit_pressed(self, result: PageResult) -> bool:
        """Return True if a quit key ended a page."""
        return result.key in self._response.quit_keys
