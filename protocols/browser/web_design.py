"""Design of a study as a browser plans and follows it: cells in place of tasks.

The kernel in TypeScript (`study_app/web/src/kernel/`) makes of it what `plan.py` and
`study_app.session` make of a study. So no task, recipe or rule is written twice, and a lab's own
task runs in a browser, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from protocols.adaptive.section import AdaptiveLevels, QuestPlusLevels, UpDownLevels
from protocols.errors import StudyError
from protocols.plan import rounds
from protocols.study_file.schema import StudyProtocol
from protocols.tasks import base
from protocols.units import Count, Few, Model, Name, Number, Positive, Share, Text


class WebArrangement(Model):
    """One way to show a condition."""

    stimuli: tuple[Text, ...]
    """Names in the manifest, as the task counts them."""
    correct: Name | None
    """The right answer. Null where there is none."""
    level: Number | None = None
    """Value in the column that an adaptive rule chooses. Null where there is none."""


class WebCell(Model):
    """One condition of the design. Its arrangements take turns over repeats and places."""

    scene: str
    parity: int
    """Index, modulo their number, of the arrangement that comes first at place 0."""
    arrangements: tuple[WebArrangement, ...]


class QuestPlusRule(Model):
    """The level whose answer is expected to tell most (QUEST+)."""

    kind: Literal["quest-plus"] = "quest-plus"
    levels: tuple[Number, ...]
    """Rising."""
    correct: tuple[tuple[Share, ...], ...]
    """Probability of a right answer: a row for each level, a column for each grid point."""
    log_prior: tuple[float | None, ...]
    """Logarithm of the prior of each grid point. Null where its prior is 0."""


class UpDownRule(Model):
    """An up-down track: the keys of the study's `[task.adaptive]`."""

    kind: Literal["up-down"] = "up-down"
    levels: tuple[Number, ...]
    """Rising."""
    start: Number
    harder: tuple[Number, ...]
    easier: tuple[Number, ...]
    in_a_row: Few
    one_at_first: bool
    falling: bool


AnyRule: TypeAlias = Annotated[QuestPlusRule | UpDownRule, Field(discriminator="kind")]


class WebTrack(Model):
    """Trials that are chosen from each other's answers."""

    name: Text
    options: tuple[WebArrangement, ...]
    """All that they may show."""


class WebAdaptive(Model):
    """Rule that chooses trials from answers."""

    trials: Positive
    """Per track."""
    tracks: tuple[WebTrack, ...]
    rule: AnyRule


class WebPractice(Model):
    """Practice trials."""

    trials: Positive
    """Trials of a round."""
    rounds: Positive
    criterion_share: Share | None
    """Share of right answers below which another round follows. Null: one round only."""
    cells: tuple[WebCell, ...]


class WebDesign(Model):
    """The design of a study, as a browser plans it."""

    answers: tuple[Name, ...]
    """Names from left to right, where keys are not swapped."""
    scenes: tuple[str, ...]
    """Scenes of the main trials. One empty name where the stimuli tell none."""
    repeats: Positive
    blocks: Few
    scene_order: Literal["random", "balanced"]
    side: Literal["by-participant", "by-trial", "fixed"]
    places: Literal["by-arrival", "drawn"]
    rounds: tuple[Positive, Annotated[int, Field(ge=1, le=2**53)]]
    """After how many places arrangements and keys are balanced, and the scenes as well."""
    max_attempts: Few
    consent_required: bool
    questions: tuple[Name, ...]
    """The closing questions, which are the same in every language."""
    cells: tuple[WebCell, ...]
    """Cells of the main trials. Empty where a rule chooses."""
    catch_trials: Count
    catch_cells: tuple[WebCell, ...]
    practice: WebPractice | None
    adaptive: WebAdaptive | None


def web_design(study: StudyProtocol) -> WebDesign:
    """Return the design of a study as data.

    Parameters
    ----------
    study : StudyProtocol
        Checked. Its secret is not needed, and is no part of the result.

    Raises
    ------
    StudyError
        If a rule chooses the trials that a browser cannot follow, naming it.
    """
    design, task, pool = study.design, study.task, study.pool
    texts = study.text.languages[study.text.default_language]
    practice = design.practice
    adaptive = _adaptive(study)
    column = adaptive_column(study)
    return WebDesign(
        answers=task.answers(),
        scenes=pool.scenes,
        repeats=design.repeats,
        blocks=design.blocks,
        scene_order=design.scene_order,
        side=design.side,
        places=design.places,
        rounds=rounds(study),
        max_attempts=design.max_attempts,
        consent_required=study.privacy.consent_required,
        questions=tuple(question.name for question in texts.questions),
        cells=() if adaptive else _cells(task.cells(pool)),
        catch_trials=task.catch_trials,
        catch_cells=_cells(task.catch_cells(pool)) if task.catch_trials else (),
        practice=WebPractice(
            trials=practice.trials,
            rounds=practice.rounds,
            criterion_share=practice.criterion_share,
            cells=_cells(study.practice_cells(), column),
        )
        if practice
        else None,
        adaptive=adaptive,
    )


def adaptive_column(study: StudyProtocol) -> str | None:
    """Return the column that an adaptive rule chooses; None where there is none."""
    rule = study.task.adaptation
    return rule.column if isinstance(rule, AdaptiveLevels) else None


def _adaptive(study: StudyProtocol) -> WebAdaptive | None:
    rule, task, pool = study.task.adaptation, study.task, study.pool
    if rule is None:
        return None
    if not isinstance(rule, QuestPlusLevels | UpDownLevels):
        raise StudyError(
            "task.adaptive.rule: must be 'quest-plus' or 'up-down' in a browser, which cannot"
            f" follow any other (got {rule.rule!r}); plan all trials, or run the study at the desk"
        )
    levels = rule.levels(task, pool)
    options: dict[str, list[WebArrangement]] = {}
    for cell in task.cells(pool):
        for arrangement in cell.arrangements:
            name = rule.track_of(arrangement.condition)
            options.setdefault(name, []).append(_arrangement(arrangement, rule.column))
    return WebAdaptive(
        trials=rule.trials,
        tracks=tuple(
            WebTrack(name=name, options=tuple(options[name])) for name in rule.tracks(task, pool)
        ),
        rule=_quest_plus(rule, levels)
        if isinstance(rule, QuestPlusLevels)
        else UpDownRule(
            levels=levels,
            **rule.model_dump(
                include={"start", "harder", "easier", "in_a_row", "one_at_first", "falling"}
            ),
        ),
    )


def _quest_plus(rule: QuestPlusLevels, levels: tuple[float, ...]) -> QuestPlusRule:
    from protocols.adaptive.quest_plus import tables

    table = tables(rule.grid(levels))
    prior = (float(value) for value in table.log_prior)
    return QuestPlusRule(
        levels=levels,
        correct=tuple(map(tuple, table.correct.tolist())),
        log_prior=tuple(value if value > float("-inf") else None for value in prior),
    )


def _cells(cells: Iterable[base.Cell], column: str | None = None) -> tuple[WebCell, ...]:
    return tuple(
        WebCell(
            scene=cell.scene,
            parity=cell.parity,
            arrangements=tuple(_arrangement(one, column) for one in cell.arrangements),
        )
        for cell in cells
    )


def _arrangement(given: base.Arrangement, column: str | None) -> WebArrangement:
    level = given.condition.get(column) if column else None
    return WebArrangement(
        stimuli=given.stimuli,
        correct=given.correct,
        level=None if level is None else float(level),
    )
