"""Next step of a session: a pure function of protocol, plan and journal so far.

Nothing else is remembered, so a session that was killed goes on where it stopped: the trial that
was interrupted comes again, and all others keep the order they would have had.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from protocols.disk.hashing import Chance
from protocols.journal import (
    Answer,
    AnyEvent,
    Attempt,
    BlockEnd,
    BlockStart,
    Break,
    Consent,
    VoidReason,
)
from protocols.plan import Plan, PlannedTrial, chosen
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import ClosingQuestion

NOT_THE_PARTICIPANTS: frozenset[VoidReason] = frozenset({"paused", "quit", "focus-lost"})
"""Voids that do not count towards `max_attempts`: nothing was wrong with the attempt itself."""


@dataclass(frozen=True)
class AskConsent:
    """Show the consent page."""


@dataclass(frozen=True)
class StartBlock:
    """Announce a block; block 0 is practice."""

    block: int
    trials: int
    first: bool
    """Nothing was shown yet: instructions come before."""


@dataclass(frozen=True)
class RunTrial:
    """Run one attempt."""

    trial: PlannedTrial
    attempt: int
    position: int


@dataclass(frozen=True)
class EndBlock:
    """All trials of the block are decided or given up."""

    block: int


@dataclass(frozen=True)
class TakeBreak:
    """Rest before the next block."""

    after_block: int


@dataclass(frozen=True)
class AskQuestion:
    """Ask one of the closing questions."""

    question: ClosingQuestion


@dataclass(frozen=True)
class Finish:
    """The session is over."""

    consented: bool


Step: TypeAlias = AskConsent | StartBlock | RunTrial | EndBlock | TakeBreak | AskQuestion | Finish


def next_step(study: StudyProtocol, plan: Plan, events: Sequence[AnyEvent], language: str) -> Step:
    """Return the session's next step."""
    consent = next((event for event in events if isinstance(event, Consent)), None)
    if study.privacy.consent_required:
        if consent is None:
            return AskConsent()
        if not consent.agreed:
            return Finish(consented=False)
    attempts = [event for event in events if isinstance(event, Attempt)]
    started = {event.block for event in events if isinstance(event, BlockStart)}
    ended = {event.block for event in events if isinstance(event, BlockEnd)}
    rested = {event.after_block for event in events if isinstance(event, Break)}
    for block in plan.blocks:
        if block in ended:
            if block > 0 and block != plan.blocks[-1] and block not in rested:
                return TakeBreak(block)
            continue
        if block not in started:
            return StartBlock(block, len(plan.block(block)), first=not started)
        queue = remaining(study, plan, block, attempts)
        if not queue:
            return EndBlock(block)
        tries = sum(attempt.trial == queue[0].id for attempt in attempts)
        trial = chosen(study, plan, queue[0], attempts)
        return RunTrial(trial, attempt=tries + 1, position=len(attempts))
    answered = {event.question for event in events if isinstance(event, Answer)}
    for question in study.text.languages[language].questions:
        if question.name not in answered:
            return AskQuestion(question)
    return Finish(consented=True)


def following(
    study: StudyProtocol, plan: Plan, events: Sequence[AnyEvent], trial: PlannedTrial
) -> PlannedTrial | None:
    """Return the trial after `trial`, the one that runs; None where that is not known.

    It is the same whether the attempt counts or is void: a void trial never comes at once where
    another is left. What an adaptive trial shows follows from the answer that is awaited, and so
    may whether practice goes on.
    """
    attempts = [event for event in events if isinstance(event, Attempt)]
    queue = remaining(study, plan, trial.block, attempts)[1:]
    for trials in _practice_rounds(study, plan) if trial.block == 0 else ():
        if [entry.id for entry in _queue(study, plan, trials, attempts)] == [trial.id]:
            answers = _right_answers(trials, attempts)
            passed = {_is_passed(study, [*answers, right]) for right in (True, False)}
            if len(passed) > 1:
                return None
            queue = [] if passed == {True} else queue
    queue += [entry for entry in plan.trials if entry.block > trial.block]
    return queue[0] if queue and queue[0].stimuli else None


def remaining(
    study: StudyProtocol, plan: Plan, block: int, attempts: Sequence[Attempt]
) -> list[PlannedTrial]:
    """Return the trials of a block that are still to come, in order.

    A void trial comes again at a seeded place later in its block, not at once where another
    trial is left, and not next to one that shows the same. After `max_attempts` it is given up.
    Practice with a criterion ends with the first round that reaches it.
    """
    rounds = _practice_rounds(study, plan) if block == 0 else []
    if not rounds:
        return _queue(study, plan, plan.block(block), attempts)
    for number, trials in enumerate(rounds):
        left = _queue(study, plan, trials, attempts)
        if left:
            return left + [trial for later in rounds[number + 1 :] for trial in later]
        if _is_passed(study, _right_answers(trials, attempts)):
            break
    return []


def _practice_rounds(study: StudyProtocol, plan: Plan) -> list[tuple[PlannedTrial, ...]]:
    """Return the rounds of practice with a criterion; none where practice has none."""
    practice = study.design.practice
    if practice is None or practice.criterion_share is None:
        return []
    trials, each = plan.block(0), practice.trials
    return [trials[first : first + each] for first in range(0, len(trials), each)]


def _right_answers(trials: Sequence[PlannedTrial], attempts: Sequence[Attempt]) -> list[bool]:
    """Return of every answer to these trials whether it was right."""
    names = {trial.id for trial in trials}
    return [
        bool(attempt.correct)
        for attempt in attempts
        if attempt.trial in names and attempt.outcome == "completed"
    ]


def _is_passed(study: StudyProtocol, answers: Sequence[bool]) -> bool:
    """Return True if these answers to a round of practice reach its criterion."""
    practice = study.design.practice
    share = practice.criterion_share if practice else None
    return share is not None and bool(answers) and sum(answers) >= share * len(answers)


def _queue(
    study: StudyProtocol, plan: Plan, trials: Sequence[PlannedTrial], attempts: Sequence[Attempt]
) -> list[PlannedTrial]:
    queue = list(trials)
    names = {trial.id for trial in trials}
    counted: dict[str, int] = {}
    for attempt in attempts:
        if attempt.trial not in names:
            continue
        trial = next(entry for entry in queue if entry.id == attempt.trial)
        queue.remove(trial)
        if attempt.void_reason is None:
            continue
        if attempt.void_reason not in NOT_THE_PARTICIPANTS:
            counted[trial.id] = counted.get(trial.id, 0) + 1
        if counted.get(trial.id, 0) < study.design.max_attempts:
            queue.insert(_place(plan, queue, trial, attempt.attempt), trial)
    return queue


def given_up(plan: Plan, attempts: Sequence[Attempt], max_attempts: int) -> list[str]:
    """Return the trials that failed `max_attempts` times."""
    failed: dict[str, int] = {}
    for attempt in attempts:
        if attempt.void_reason and attempt.void_reason not in NOT_THE_PARTICIPANTS:
            failed[attempt.trial] = failed.get(attempt.trial, 0) + 1
    return [trial.id for trial in plan.trials if failed.get(trial.id, 0) >= max_attempts]


def _place(plan: Plan, queue: Sequence[PlannedTrial], trial: PlannedTrial, attempt: int) -> int:
    """Return the index in the queue at which a void trial comes again."""
    chance = Chance(plan.seed, plan.participant, plan.slot, "requeue", trial.id, attempt)
    places = range(1, len(queue) + 1)
    free = [
        place
        for place in places
        if not trial.shown
        or (
            queue[place - 1].shown != trial.shown
            and (place == len(queue) or queue[place].shown != trial.shown)
        )
    ]
    candidates = free or list(places) or [0]
    return candidates[chance.below(len(candidates))]
