"""Checks that a plan can find anything at all: by looks, by a family of tests, over scenes."""

from bisect import bisect_left
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.models.sequential_bounds import SequentialPlan, never_stops, plan_of, spent
from analysis.showable import MOST_UNITS, FamilyOfTests, two_scenes
from analysis.tasks import analysis_of
from protocols.errors import StudyError
from protocols.prose import count_of
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.sequential import Sequential
from protocols.tasks.mixed import MOST_DRAWS


def look_problems(study: StudyProtocol) -> list[str]:
    """Return the faults of planned looks at which the study can never stop, and a cure."""
    section = study.analysis.sequential
    if section is None:
        return []
    families, alpha = analysis_of(study.analysis.kind).families(study), study.analysis.alpha
    plan = plan_of(section, alpha)
    never = _never(plan, families[0]) if families else []
    if not never:
        return []
    bound, people = plan.reject_p[never[0]], plan.looks[never[0]]
    return [
        "analysis.sequential.looks: each look must be able to stop the study; with"
        f" {count_of(people, 'participant')} it stops where p is at most {bound:.2g}, and"
        f" {families[0].why(people)} (got {list(plan.looks)});"
        f" {_cure(section, plan, families[0])}"
    ]


def check_looks(path: Path, study: StudyProtocol) -> None:
    """Refuse looks that can never stop the study (StudyError); `path` says where."""
    if problems := look_problems(study):
        raise StudyError("\n".join(f"{path}: {problem}" for problem in problems))


def _never(plan: SequentialPlan, family: FamilyOfTests) -> list[int]:
    """Return looks, counted from 0, at which no p of the planned test can stop the study."""
    return [k for k, n in enumerate(plan.looks) if never_stops(plan, k, family.least_p(n))]


def _cure(section: Sequential, plan: SequentialPlan, family: FamilyOfTests) -> str:
    """Return looks that can stop: the first later, others as they are; or what else helps."""
    *early, last = plan.looks
    alpha = plan.alpha

    def stops(*looks: int) -> bool:
        return not _never(plan_of(section.model_copy(update={"looks": looks}), alpha), family)

    for first in range(early[0], last):
        # What the first look may spend is its bound.
        may = 1.0 if section.rule == "bayes-factor" else spent(first / last, alpha, section.rule)
        kept = (first, *(look for look in early if look > first), last)
        if may >= family.least_p(first) and stops(*kept):
            return f"say looks = {list(kept)}"
    if family.draws:
        more = range(family.draws, MOST_DRAWS + 1)
        enough = bisect_left(more, True, key=lambda n: not _never(plan, replace(family, draws=n)))
        leave = "leave out analysis.bootstrap_draws"
        return f"say analysis.bootstrap_draws = {more[enough]}" if enough < len(more) else leave
    if stops(last):
        return "leave out [analysis.sequential], and test once, at the end"
    enough = next(people for people in range(last, MOST_UNITS) if stops(people))
    fewer = ", or fewer comparisons" * (family.holm and family.count > 1)
    return (
        f"plan {enough} participants or more (study.participants){fewer}, and test once, at the end"
        " (leave out [analysis.sequential])"
    )


def planning_notes(study: StudyProtocol) -> list[str]:
    """Return notes on claims that the planned design can hardly or never show."""
    analysis = study.analysis
    people, families = study.study.participants, analysis_of(analysis.kind).families(study)
    test = getattr(analysis, "test", None)  # of ratings always about further scenes
    alone = ', or say test = "participant", which speaks of these alone' * (test is not None)
    scenes = np.unique([cell.scene for cell in study.task.cells(study.pool)]).size
    return [
        *(note for one in families for note in one.hopeless(people, analysis.alpha)),
        *(
            f"{note}. Show four or more{alone}"
            for note in two_scenes(scenes)
            if test in (None, "participant-scene")
        ),
    ]
