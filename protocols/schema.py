"""A study protocol: the sections together, and what must hold between them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Literal

from pydantic import Field, model_validator

from protocols.cross_check import cross_check
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
from protocols.units import Model


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
