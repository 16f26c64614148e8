"""What must hold between the sections of a study: names that exist, pairs, keys, texts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping

from protocols.errors import Problem
from protocols.session_schema import (
    PLACEHOLDERS,
    Analysis,
    Design,
    Gaze,
    Response,
    TextSection,
    TrialTiming,
)
from protocols.suggest import did_you_mean


def cross_check(sections: Mapping[str, object]) -> list[Problem]:
    """Return every mistake between sections.

    `sections` holds the sections and entries that are right by themselves; what is missing is
    not judged, so that a file with other mistakes still gets all that can be said about it.
    """
    return list(_duplicates(sections)) + list(_references(sections)) + list(_rules(sections))


def _entries(sections: Mapping[str, object], name: str) -> list[tuple[int, object]]:
    value = sections.get(name)
    if isinstance(value, Mapping):  # index -> entry, from a file with other mistakes
        return sorted(value.items())
    return list(enumerate(value)) if isinstance(value, tuple) else []


def _duplicates(sections: Mapping[str, object]) -> Iterator[Problem]:
    for section in ("scenes", "sizes", "methods"):
        first: dict[str, int] = {}
        for index, entry in _entries(sections, section):
            name = str(getattr(entry, "name", ""))
            if name in first:
                yield Problem(
                    f"{section}[{index}].name",
                    f"names must differ (got {name!r}, which {section}[{first[name]}] has);"
                    " rename one of them",
                )
            first.setdefault(name, index)


def _references(sections: Mapping[str, object]) -> Iterator[Problem]:
    """Names in one section that another must define."""
    used: list[tuple[str, str, str]] = []  # section that defines it, place, name
    design, analysis = sections.get("design"), sections.get("analysis")
    if isinstance(design, Design):
        used += [("scenes", f"design.scenes[{i}]", name) for i, name in enumerate(design.scenes)]
        if design.pairings != "all":
            used += [
                ("methods", f"design.pairings[{i}][{j}]", name)
                for i, pairing in enumerate(design.pairings)
                for j, name in enumerate(pairing)
            ]
        if design.practice:
            used += [
                ("scenes", f"design.practice.scenes[{i}]", name)
                for i, name in enumerate(design.practice.scenes)
            ]
        if design.catch:
            used += [
                ("methods", "design.catch.better", design.catch.better),
                ("methods", "design.catch.worse", design.catch.worse),
                ("sizes", "design.catch.size", design.catch.size),
            ]
    if isinstance(analysis, Analysis):
        primary = analysis.primary
        used += [
            ("methods", "analysis.primary.method", primary.method),
            ("methods", "analysis.primary.against", primary.against),
        ]
        if primary.size is not None:
            used.append(("sizes", "analysis.primary.size", primary.size))
    for section, place, name in used:
        value = sections.get(section)
        if not isinstance(value, tuple):  # has mistakes of its own: its names are not known
            continue
        known = [str(getattr(entry, "name", "")) for entry in value]
        if name not in known:
            yield Problem(
                place,
                f"must name one of the {section} ({', '.join(known)})"
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
        yield from _analysis_rules(analysis, design)
    if isinstance(response, Response):
        uses = Counter(key for keys in response.actions().values() for key in keys)
        for key, count in uses.items():
            if count > 1:
                actions = [name for name, keys in response.actions().items() if key in keys]
                yield Problem(
                    f"response.{actions[-1]}",
                    f"a key must do one thing (got {key!r} in {' and '.join(actions)})",
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
            f" (got {text.default_language!r})",
        )
    for language, texts in text.languages.items():
        for field, value in texts.model_dump().items():
            for word in re.findall(r"\{(\w*)\}", str(value) if field != "questions" else ""):
                if word not in PLACEHOLDERS:
                    yield Problem(
                        f"text.languages.{language}.{field}",
                        f"{{...}} must be one of {', '.join(PLACEHOLDERS)} (got {{{word}}})"
                        f"{did_you_mean(word, PLACEHOLDERS)}",
                    )
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


def _analysis_rules(analysis: Analysis, design: object) -> Iterator[Problem]:
    primary, rules = analysis.primary, analysis.exclusions
    pairing = {primary.method, primary.against}
    if len(pairing) == 1:
        yield Problem("analysis.primary.against", f"must differ from method ({primary.method!r})")
    elif (
        isinstance(design, Design)
        and design.pairings != "all"
        and pairing not in [set(entry) for entry in design.pairings]
    ):
        yield Problem(
            "analysis.primary",
            f"must compare two methods that the design pairs (got {primary.method!r} against"
            f" {primary.against!r}); add the pairing, or choose another comparison",
        )
    if rules.rt_max_s is not None and rules.rt_max_s <= rules.rt_min_s:
        yield Problem(
            "analysis.exclusions.rt_max_s",
            f"must be longer than rt_min_s = {rules.rt_min_s:g} s (got {rules.rt_max_s:g} s)",
        )


def _design_rules(design: Design) -> Iterator[Problem]:
    if design.pairings != "all":
        seen: dict[frozenset[str], int] = {}
        for index, pairing in enumerate(design.pairings):
            if pairing[0] == pairing[1]:
                yield Problem(
                    f"design.pairings[{index}]",
                    f"a pairing must hold two different methods (got {pairing[0]!r} twice)",
                )
            elif frozenset(pairing) in seen:
                yield Problem(
                    f"design.pairings[{index}]",
                    f"every pairing must be given once (got {list(pairing)}, which"
                    f" design.pairings[{seen[frozenset(pairing)]}] has); raise repeats instead",
                )
            seen.setdefault(frozenset(pairing), index)
    for place, names in (
        ("design.scenes", design.scenes),
        ("design.practice.scenes", design.practice.scenes if design.practice else ()),
    ):
        for name, count in Counter(names).items():
            if count > 1:
                yield Problem(place, f"every scene must be given once (got {name!r} {count} times)")
    if design.catch and design.catch.better == design.catch.worse:
        yield Problem(
            "design.catch.worse", f"must differ from better (got {design.catch.worse!r} for both)"
        )
