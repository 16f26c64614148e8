"""Rules between the sections of a study: names that exist, pairs, keys, texts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from protocols.errors import Problem, did_you_mean
from protocols.recipes.base import Recipe
from protocols.recipes.warped_clips import WarpedClips
from protocols.study_file.session_schema import (
    Design,
    Gaze,
    Privacy,
    Response,
    TextSection,
    TrialTiming,
    unknown_placeholders,
)
from protocols.tasks.base import Analysis, Task
from protocols.tasks.pairs import PairTask
from protocols.tasks.task_kinds import TASKS


def cross_check(sections: Mapping[str, object]) -> list[Problem]:
    """Return every mistake between sections.

    `sections` holds the sections and entries that are right by themselves; what is missing is
    not judged, so that a file with other mistakes still gets all that can be said about it.
    """
    return list(_entries(sections)) + list(_references(sections)) + list(_rules(sections))


def _entries(sections: Mapping[str, object]) -> Iterator[Problem]:
    """Names that are there twice, and sizes that say nothing."""
    stimuli = sections.get("stimuli")
    if not isinstance(stimuli, WarpedClips):
        return
    for section in ("scenes", "sizes", "methods"):
        first: dict[str, int] = {}
        for index, entry in enumerate(getattr(stimuli, section)):
            if entry.name in first:
                yield Problem(
                    f"stimuli.{section}[{index}].name",
                    f"names must differ (got {entry.name!r}, which"
                    f" stimuli.{section}[{first[entry.name]}] has); rename one of them",
                )
            first.setdefault(entry.name, index)
    moved = next((scene.name for scene in stimuli.scenes if not scene.has_own_path), None)
    for index, size in enumerate(stimuli.sizes):
        if moved is not None and size.is_own:
            yield Problem(
                f"stimuli.sizes[{index}]",
                f"a size says either hole_share or extent_m (got neither), for scene {moved!r};"
                " OpenEXR sequences with their own motion alone need none",
            )


def _references(sections: Mapping[str, object]) -> Iterator[Problem]:
    """Scenes that the design names and the stimuli must have."""
    design, stimuli = sections.get("design"), sections.get("stimuli")
    if not isinstance(design, Design) or not isinstance(stimuli, Recipe):
        return
    used = [(f"design.scenes[{i}]", name) for i, name in enumerate(design.scenes)]
    if design.practice:
        used += [
            (f"design.practice.scenes[{i}]", name) for i, name in enumerate(design.practice.scenes)
        ]
    known = [str(value) for value in stimuli.values("scene")]
    for place, name in used:
        if name not in known:
            yield Problem(
                place,
                f"must name one of the scenes ({', '.join(known)})"
                f" (got {name!r}){did_you_mean(name, known)}",
            )


def _rules(sections: Mapping[str, object]) -> Iterator[Problem]:
    design, text = sections.get("design"), sections.get("text")
    response, gaze = sections.get("response"), sections.get("gaze")
    if isinstance(design, Design):
        yield from _design_rules(design)
    if isinstance(text, TextSection):
        yield from _text_rules(text)
    analysis = sections.get("analysis")
    if isinstance(analysis, Analysis):
        yield from _analysis_rules(analysis)
    task = sections.get("task")
    if isinstance(task, Task):
        yield from _task_rules(task, design, response, text, analysis)
    if isinstance(response, Response):
        uses = Counter(key for keys in response.actions().values() for key in keys)
        for key, count in uses.items():
            if count > 1:
                actions = [name for name, keys in response.actions().items() if key in keys]
                yield Problem(
                    f"response.{actions[-1]}",
                    f"a key must do one thing (got {key!r} in {' and '.join(actions)})",
                )
    stimuli = sections.get("stimuli")
    if isinstance(stimuli, Recipe) and stimuli.follows_gaze:
        if isinstance(gaze, Gaze) and gaze.mode == "none":
            yield Problem(
                "gaze.mode",
                "must watch gaze where pictures follow it (got 'none'); write 'enforce', so that an"
                " eye that is lost for longer than blink_s makes a trial void, or 'monitor'",
            )
        privacy = sections.get("privacy")
        if isinstance(privacy, Privacy) and not privacy.store_gaze:
            yield Problem(
                "privacy.store_gaze",
                "must be true where pictures follow the gaze: a frame can be drawn again from its"
                " gaze alone, which is kept with every flip (got false)",
            )
    trial = sections.get("trial")
    if isinstance(trial, TrialTiming) and trial.fixation_timeout_s <= trial.fixation_s:
        yield Problem(
            "trial.fixation_timeout_s",
            f"must be longer than fixation_s = {trial.fixation_s:g} s"
            f" (got {trial.fixation_timeout_s:g} s)",
        )
    if isinstance(gaze, Gaze) and gaze.blink_s > 0 and gaze.violation_s > gaze.blink_s:
        yield Problem(
            "gaze.violation_s",
            f"must not be longer than blink_s = {gaze.blink_s:g} s (got {gaze.violation_s:g} s)",
        )


def _text_rules(text: TextSection) -> Iterator[Problem]:
    if text.default_language not in text.languages:
        yield Problem(
            "text.default_language",
            f"must be one of the languages given ({', '.join(text.languages)})"
            f" (got {text.default_language!r})"
            f"{did_you_mean(text.default_language, text.languages)}",
        )
    for language, texts in text.languages.items():
        labels = {f"answers.{name}": label for name, label in texts.answers.items()}
        for field, value in (texts.model_dump(exclude={"answers"}) | labels).items():
            for wrong in unknown_placeholders(str(value) if field != "questions" else ""):
                yield Problem(f"text.languages.{language}.{field}", wrong)
    asked = {
        language: [(question.name, len(question.choices)) for question in texts.questions]
        for language, texts in text.languages.items()
    }
    for language, questions in asked.items():
        first = next(iter(asked))
        if questions != asked[first]:
            yield Problem(
                f"text.languages.{language}.questions",
                f"must have the names and numbers of choices of {first!r}, or answers cannot be"
                f" compared ({asked[first]}) (got {questions})",
            )


def _analysis_rules(analysis: Analysis) -> Iterator[Problem]:
    rules = analysis.exclusions
    if rules.rt_max_s is not None and rules.rt_max_s <= rules.rt_min_s:
        yield Problem(
            "analysis.exclusions.rt_max_s",
            f"must be longer than rt_min_s = {rules.rt_min_s:g} s (got {rules.rt_max_s:g} s)",
        )


def _design_rules(design: Design) -> Iterator[Problem]:
    for place, names in (
        ("design.scenes", design.scenes),
        ("design.practice.scenes", design.practice.scenes if design.practice else ()),
    ):
        for name, count in Counter(names).items():
            if count > 1:
                yield Problem(place, f"every scene must be given once (got {name!r} {count} times)")


def _task_rules(
    task: Task, design: object, response: object, text: object, analysis: object
) -> Iterator[Problem]:
    """Answers, their keys and labels; feedback; the kind of analysis."""
    answers = task.answers()
    distinct = len(set(answers)) == len(answers)  # else the task says so
    if distinct and isinstance(response, Response) and len(response.keys) != len(answers):
        yield Problem(
            "response.keys",
            f"must have an entry for each answer of the task ({', '.join(answers)})"
            f" (got {len(response.keys)})",
        )
    if distinct and isinstance(text, TextSection):
        for language, texts in text.languages.items():
            if set(texts.answers) != set(answers):
                yield Problem(
                    f"text.languages.{language}.answers",
                    f"must label the answers of the task ({', '.join(answers)})"
                    f" (got {', '.join(texts.answers)})",
                )
    if isinstance(analysis, Analysis) and not isinstance(analysis, task.analysis):
        yield Problem(
            "analysis.kind",
            f"must be {task.analysis.own_kind()!r} for the task {task.kind!r}"
            f" (got {analysis.kind!r})",
        )
    if task.confidence is not None and task.decides:
        yield from task.confidence.problems(response, text)
    elif task.confidence is not None:
        having = ", ".join(kind for kind, known in TASKS.items() if known.task.decides)
        yield Problem(
            "task.confidence",
            f"must be left out for the task {task.kind!r}, whose answers are no decisions that one"
            f" can be sure of; tasks that may have it: {having}",
        )
    if isinstance(design, Design):
        yield from _side_and_practice(task, design, text)


def _side_and_practice(task: Task, design: Design, text: object) -> Iterator[Problem]:
    """Sides that keys may swap, and practice that judges."""
    answers = task.answers()
    if design.side != "fixed" and (task.sided or len(answers) > 2):
        why = "name sides or places" if task.sided else "are more than two"
        yield Problem(
            "design.side",
            f"must be 'fixed' for the task {task.kind!r}, whose answers {why} (got"
            f" {design.side!r})",
        )
    practice = design.practice
    if practice is None:
        return
    if practice.judged and (
        not task.decides or (isinstance(task, PairTask) and task.catch is None)
    ):
        key = "feedback" if practice.feedback else "criterion_share"
        yield Problem(
            f"design.practice.{key}",
            "needs a known right answer: "
            + (
                "give task.catch, whose pair practice then shows"
                if task.decides
                else f"leave it out, for the task {task.kind!r} has none"
            ),
        )
    if practice.feedback and isinstance(text, TextSection):
        for language, texts in text.languages.items():
            for field in ("right", "wrong"):
                if getattr(texts, field) is None:
                    yield Problem(
                        f"text.languages.{language}.{field}", "missing: practice gives feedback"
                    )
