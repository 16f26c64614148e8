"""A study protocol: the sections together, and what must hold between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Literal

from pydantic import Field, model_validator

from protocols.hashing import sha256_json
from protocols.session_schema import (
    Analysis,
    Design,
    Gaze,
    Privacy,
    Response,
    StudyDisplay,
    StudyInfo,
    TextSection,
    TrialTiming,
)
from protocols.stimuli_schema import Clips, Method, Scene, Size
from protocols.suggest import did_you_mean
from protocols.units import Model


@dataclass(frozen=True)
class Problem:
    """One mistake: where it is, and what must hold, was found and cures it."""

    place: str
    message: str

    def __str__(self) -> str:
        return f"{self.place}: {self.message}" if self.place else self.message


@dataclass(frozen=True, order=True)
class ClipName:
    """One clip of a study; `str` gives its folder, ``scene__size__method``."""

    scene: str
    size: str
    method: str

    def __str__(self) -> str:
        return f"{self.scene}__{self.size}__{self.method}"


class StudyProtocol(Model):
    """A whole study. Two studies with equal hashes are the same study."""

    format: Literal[1]
    """Version of this file format."""
    study: StudyInfo
    display: StudyDisplay
    scenes: Annotated[tuple[Scene, ...], Field(min_length=1)]
    sizes: Annotated[tuple[Size, ...], Field(min_length=1)]
    methods: Annotated[tuple[Method, ...], Field(min_length=2)]
    clips: Clips
    design: Design
    trial: TrialTiming
    gaze: Gaze
    response: Response
    text: TextSection
    analysis: Analysis
    privacy: Privacy

    @model_validator(mode="after")
    def _sections_agree(self) -> StudyProtocol:
        problems = cross_check({name: getattr(self, name) for name in type(self).model_fields})
        if problems:
            raise ValueError("\n".join(map(str, problems)))
        return self

    @property
    def sha256(self) -> str:
        """Hash of everything the protocol says."""
        return sha256_json(self)

    @property
    def stimuli_sha256(self) -> str:
        """Hash of what decides the pixels: display, scenes, sizes, methods, clips.

        Clips stay valid when wording, timing or design change.
        """
        return sha256_json(
            self.model_dump(mode="json", include={"display", "scenes", "sizes", "methods", "clips"})
        )

    def scene(self, name: str) -> Scene:
        """Return the scene called `name`."""
        return next(scene for scene in self.scenes if scene.name == name)

    def method(self, name: str) -> Method:
        """Return the method called `name`."""
        return next(method for method in self.methods if method.name == name)

    def main_scenes(self) -> tuple[Scene, ...]:
        """Return the scenes of the main trials."""
        wanted = self.design.scenes
        return tuple(scene for scene in self.scenes if not wanted or scene.name in wanted)

    def pairings(self) -> tuple[tuple[str, str], ...]:
        """Return the compared pairs of methods, each once."""
        if self.design.pairings == "all":
            return tuple(combinations((method.name for method in self.methods), 2))
        return self.design.pairings

    def comparable(self, scene: Scene, pairing: Iterable[str]) -> bool:
        """Return whether `scene` has clips for both methods of a pairing."""
        return scene.has_reference or not any(self.method(name).is_reference for name in pairing)

    def clip_names(self) -> tuple[ClipName, ...]:
        """Return every clip the study shows, in the order scene, size, method."""
        shown: set[ClipName] = set()
        practice = self.design.practice
        scenes = {scene.name: scene for scene in self.main_scenes()}
        if practice:
            scenes |= {name: self.scene(name) for name in practice.scenes}
        for scene in scenes.values():
            for pairing in self.pairings():
                if self.comparable(scene, pairing):
                    shown |= {
                        ClipName(scene.name, size.name, method)
                        for size in self.sizes
                        for method in pairing
                    }
        catch = self.design.catch
        if catch:
            for scene in self.main_scenes():
                if self.comparable(scene, (catch.better, catch.worse)):
                    shown |= {
                        ClipName(scene.name, catch.size, method)
                        for method in (catch.better, catch.worse)
                    }
        rank = [
            [entry.name for entry in entries] for entries in (self.scenes, self.sizes, self.methods)
        ]
        return tuple(
            sorted(
                shown,
                key=lambda clip: (
                    rank[0].index(clip.scene),
                    rank[1].index(clip.size),
                    rank[2].index(clip.method),
                ),
            )
        )


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
    if isinstance(text, TextSection) and text.default_language not in text.languages:
        yield Problem(
            "text.default_language",
            f"must be one of the languages given ({', '.join(text.languages)})"
            f" (got {text.default_language!r})",
        )
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
