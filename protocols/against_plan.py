"""Compares what a journal says with the plan that it was recorded by.

Who analyses a session has the protocol, but neither clips nor display. The order of trials needs
neither: it follows from protocol, participant code and slot, and the journal's header holds the
hash of the plan that it began with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from protocols.errors import StudyError
from protocols.journal import Attempt, SessionStart
from protocols.plan import Plan, PlannedTrial, planned_trials
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import POINTER
from protocols.tasks.confidence_question import CONFIDENCE

_ROUND_S = 2e-6
"""Stamps are rounded to microseconds."""


def plan_of(study: StudyProtocol, start: SessionStart) -> Plan | None:
    """Return the plan of a session; None where it does not come out as the session had it.

    So it is where the study's secret is not at hand.
    """
    if start.remote:
        study = study.ordered_by(start.seed, start.remote.places_key)
    try:
        trials = planned_trials(study, start.participant, start.slot)
        seed = study.order_seed
    except StudyError:
        return None
    plan = Plan(
        study=study.study.name,
        participant=start.participant,
        slot=start.slot,
        seed=seed,
        protocol_sha256=start.protocol_sha256,
        manifest_sha256=start.manifest_sha256,
        trials=trials,
    )
    return plan if plan.sha256 == start.plan_sha256 else None


def contradictions(
    study: StudyProtocol, plan: Plan, attempts: Sequence[Attempt]
) -> Iterator[tuple[Attempt, str]]:
    """Yield every attempt that the plan, or the attempt itself, does not allow, and why.

    Compared are trial, condition, stimuli, answers and their keys, numbers of attempts, and times.
    What an adaptive rule chose is compared by what was fixed beforehand.
    """
    trials = {trial.id: trial for trial in plan.trials}
    tries: Counter[str] = Counter()
    for attempt in attempts:
        trial = trials.get(attempt.trial)
        if trial is None:
            yield attempt, f"trial must be one of the plan (got {attempt.trial})"
            continue
        tries[trial.id] += 1
        wrong = next(_differences(study, trial, attempt), None)
        if wrong is None and attempt.attempt < tries[trial.id]:
            wrong = f"attempt must be at least {tries[trial.id]} (got {attempt.attempt})"
        if wrong is not None:
            yield attempt, f"{attempt.trial}: {wrong}"


def _differences(study: StudyProtocol, trial: PlannedTrial, attempt: Attempt) -> Iterator[str]:
    for key, planned, found in _fixed(trial, attempt):
        if planned != found:
            yield f"{key} must be {_said(planned)}, as planned (got {_said(found)})"
    if trial.track is None:
        shown = attempt.stimulus_names
        if shown != trial.stimuli:
            yield f"stimuli must be {_said(trial.stimuli)}, as planned (got {_said(shown)})"
    else:
        known = {entry.name for entry in study.stimuli.pool()}
        unknown = [name for name in attempt.stimulus_names if name not in known]
        if unknown:
            yield f"stimuli must be the study's (got {unknown[0]})"
    yield from _answered(study, attempt)
    yield from _sure(study, attempt)
    yield from _timed(attempt)


def _fixed(trial: PlannedTrial, attempt: Attempt) -> Iterator[tuple[str, object, object]]:
    yield "role", trial.role, attempt.role
    yield "block", trial.block, attempt.block
    yield "repeat", trial.repeat, attempt.repeat
    yield "track", trial.track, attempt.track
    yield "answers", trial.answers, attempt.answers
    if trial.track is None:
        yield "expected", trial.correct, attempt.expected
        yield "condition", trial.condition, attempt.condition
    else:
        for column, value in trial.condition.items():
            yield f"condition.{column}", value, attempt.condition.get(column)


def _answered(study: StudyProtocol, attempt: Attempt) -> Iterator[str]:
    """Compare the answer with the key that stands for it."""
    if attempt.answer is None:
        return
    keys, pointed = study.response.keys, study.response.pointer and attempt.key == POINTER
    place = attempt.answers.index(attempt.answer)
    if len(keys) == len(attempt.answers) and not pointed and attempt.key not in keys[place]:
        yield (
            f"answer {attempt.answer!r} must come from one of its keys ({', '.join(keys[place])})"
            f" (got {attempt.key})"
        )


def _sure(study: StudyProtocol, attempt: Attempt) -> Iterator[str]:
    """Each question was answered once; compare how sure the answer was with the key for it."""
    asked = [one.question for one in attempt.further]
    if len(set(asked)) < len(asked):
        yield f"further must have each question once (got {', '.join(asked)})"
    sure = study.task.confidence
    if sure is None or attempt.outcome != "completed":
        return
    given = next((one for one in attempt.further if one.question == CONFIDENCE), None)
    keys = dict(zip(sure.answers, sure.all_keys, strict=True))
    if given is None or given.answer not in keys:
        found = f"{given.answer!r}" if given else "nothing"
        yield f"{CONFIDENCE} must be one of {', '.join(keys)} (got {found})"
    elif given.key not in keys[given.answer] and not (
        study.response.pointer and given.key == POINTER
    ):
        yield (
            f"{CONFIDENCE} {given.answer!r} must come from one of its keys"
            f" ({', '.join(keys[given.answer])}) (got {given.key})"
        )


def _timed(attempt: Attempt) -> Iterator[str]:
    """Phases follow each other; the answer came while one was awaited."""
    for phase in attempt.phases:
        if phase.offset_s < phase.onset_s:
            yield f"{phase.phase} must not end before it begins"
    for before, after in zip(attempt.phases, attempt.phases[1:], strict=False):
        if abs(after.onset_s - before.offset_s) > _ROUND_S:
            yield f"{after.phase} must begin when {before.phase} ends"
    if attempt.phases and attempt.t_s + _ROUND_S < attempt.phases[-1].onset_s:
        yield "t_s must not be before the last phase"
    asked = {phase.phase: phase for phase in attempt.phases}
    if attempt.rt_s is not None and "respond" in asked:
        lasted_s = asked["respond"].offset_s - asked["respond"].onset_s
        if attempt.rt_s > lasted_s + _ROUND_S:
            yield f"rt_s must be within the answer phase, {lasted_s:g} s (got {attempt.rt_s:g})"
    for one in attempt.further:
        if attempt.phases:
            first = asked.get(one.question, attempt.phases[0])
            lasted_s = attempt.phases[-1].offset_s - first.onset_s
            if one.rt_s > lasted_s + _ROUND_S:
                yield (
                    f"rt_s of {one.question!r} must be within the attempt, {lasted_s:g} s after the"
                    f" question (got {one.rt_s:g})"
                )


def _said(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    if isinstance(value, dict):
        return ", ".join(f"{name}={entry}" for name, entry in value.items())
    return "nothing" if value is None else str(value)
