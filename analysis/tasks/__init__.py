"""Analyses by kind: `kind` in the section `[analysis]` of a study names one.

Each is imported when it is asked for. A package adds one by an entry point of
``metamerlab.analyses`` that names a function without arguments, which returns it. Planning
asks them if a design can find anything at all.
"""

from collections.abc import Callable, Mapping
from functools import partial

from analysis.showable import limits_of_design
from analysis.tasks.base import AnyAnalysis, TaskAnalysis
from protocols.errors import StudyError, must_be_one_of
from protocols.plugins import misfit, named, registered, taking
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.task_kinds import SHIPPED, TASKS, TaskKind

TABLE_TASKS = ("ratings", "reaction", "psychometric")
"""Kinds of analysis by which tables may name a task, as well as by the task's own name."""


def _of_task(kind: TaskKind) -> object:
    return named(f"{kind.analysis}.of")(kind.task)


KINDS: Mapping[str, str | Callable[..., object]] = registered(
    "analyses",
    {
        **{kind.task.analysis.own_kind(): partial(_of_task, kind) for kind in SHIPPED.values()},
        "psychometric": "analysis.tasks.rates:TableOfLevels",
        "reaction": "analysis.tasks.time_tables:TableOfTimes",
    },
    "name a function or class without arguments that gives a TaskAnalysis",
    taking(0),
)
"""Makers of analyses by kind; one that ships is named, and imported when it is asked for."""


def analysis_of(kind: str) -> AnyAnalysis:
    """Return the analysis of a kind.

    Raises
    ------
    StudyError
        If nobody wrote it.
    """
    if kind not in KINDS:
        raise StudyError(
            f"analysis {kind!r}: must be one of {', '.join(KINDS)}; the package that adds the"
            " task can add its analysis"
        )
    made = named(KINDS[kind])()
    if not isinstance(made, TaskAnalysis):
        raise misfit("analyses", kind, "give an analysis.tasks.base.TaskAnalysis", made)
    return made


def analysis_of_task(task: str) -> AnyAnalysis:
    """Return the analysis that goes with a task, by the task's name.

    Raises
    ------
    StudyError
        If there is no such task.
    """
    if task in TABLE_TASKS:
        return analysis_of(task)
    if task not in TASKS:
        raise StudyError(must_be_one_of("task", task, (*TASKS, *TABLE_TASKS)))
    return analysis_of(TASKS[task].task.analysis.own_kind())


def planning_notes(study: StudyProtocol) -> list[str]:
    """Return notes on claims that the planned design can hardly or never show."""
    analysis = study.analysis
    people, families = study.study.participants, analysis_of(analysis.kind).families(study)
    scenes = len({cell.scene for cell in study.task.cells(study.pool)} - {""})
    return limits_of_design(families, people, analysis.alpha, scenes, analysis)
