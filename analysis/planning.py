"""Checks that a plan can find anything at all: by looks, by a family of tests, over scenes."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from analysis.models.sequential_bounds import never_stops, plan_of, spent
from analysis.showable import MOST_PEOPLE, hopeless, two_scenes
from analysis.tasks import analysis_of
from protocols.errors import StudyError
from protocols.prose import count_of
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.sequential import Sequential


def look_problems(study: StudyProtocol) -> list[str]:
    """Return what is wrong with planned looks at which the study can never stop, and a cure."""
    section = study.analysis.sequential
    if section is None:
        return []
    analysis, alpha = analysis_of(study.analysis.kind), study.analysis.alpha

    @cache
    def least(people: int) -> float:
        return analysis.least_p(study, people)

    plan = plan_of(section, alpha)
    never = [k for k in range(len(plan.looks)) if never_stops(plan, k, least(plan.looks[k]))]
    if not never:
        return []
    bound, people = plan.reject_p[never[0]], plan.looks[never[0]]
    return [
        "analysis.sequential.looks: each look must be able to stop the study; with"
        f" {count_of(people, 'participant')} it stops where p is at most {bound:.2g}, and so few"
        f" can show no p below {least(people):.2g} (got {list(plan.looks)});"
        f" {_cure(section, alpha, least)}"
    ]


def check_looks(path: Path, study: StudyProtocol) -> None:
    """Refuse looks that can never stop the study (StudyError); `path` says where."""
    if problems := look_problems(study):
        raise StudyError("\n".join(f"{path}: {problem}" for problem in problems))


def _cure(section: Sequential, alpha: float, least: Callable[[int], float]) -> str:
    """Return looks that can stop: the first later, others as they are; or what else helps."""
    *early, last = section.looks

    def stops(*looks: int) -> bool:
        plan = plan_of(section.model_copy(update={"looks": looks}), alpha)
        return not any(never_stops(plan, k, least(people)) for k, people in enumerate(looks))

    for first in range(early[0], last):
        # What the first look may spend is its bound.
        may = 1.0 if section.rule == "bayes-factor" else spent(first / last, alpha, section.rule)
        kept = (first, *(look for look in early if look > first), last)
        if may >= least(first) and stops(*kept):
            return f"say looks = {list(kept)}"
    if stops(last):
        return "leave out [analysis.sequential], and test once, at the end"
    enough = next(people for people in range(last, MOST_PEOPLE) if stops(people))
    return f"plan {enough} participants or more (study.participants), or fewer comparisons"


def planning_notes(study: StudyProtocol) -> list[str]:
    """Return what the planned design can hardly or never show."""
    analysis = study.analysis
    kind, people = analysis_of(analysis.kind), study.study.participants
    scenes = np.unique([cell.scene for cell in study.task.cells(study.pool)]).size
    whose = getattr(analysis, "test", "participant-scene")
    return [
        *hopeless(people, kind.family(study), analysis.alpha),
        *(
            f'{note}. Show four or more, or say test = "participant", which speaks of these alone'
            for note in two_scenes(scenes)
            if whose == "participant-scene"
        ),
    ]
