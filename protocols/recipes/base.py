"""Base of stimulus recipes, named stimuli with their conditions, and the pool that a task gets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple, TypeAlias

from protocols.blocks import Block
from protocols.disk.hashing import Json
from protocols.display import Display
from protocols.errors import Problem, did_you_mean
from protocols.units import Condition, ExtendedModel, Model, Number, Parameters, Scalar, Seed, Text

SCENE = "scene"
"""The column of a condition that says what is to be seen: statistics cluster on it."""


@dataclass(frozen=True)
class Stimulus:
    """One clip or still of a study, before it is made."""

    name: str
    """Its folder among the clips."""
    condition: Condition
    """Condition shown, column by column."""

    @property
    def scene(self) -> str:
        """Scene to be seen; empty where the recipe does not say."""
        return str(self.condition.get(SCENE, ""))


class Group(NamedTuple):
    """Stimuli that differ in one column of their condition alone."""

    scene: str
    parity: int
    """Sum of the places of all other values among those declared: for taking turns."""
    stimuli: dict[str, Stimulus]
    """Stimuli by their value in that column, as text."""
    condition: dict[str, Scalar]
    """All other columns."""


class Cut(Model):
    """A line through the gaze: the method on one side of it, the picture itself on the other."""

    angle_deg: Number
    """Its direction, counter-clockwise from the right; the method is on its left."""
    ramp_deg: Number
    """Width over which the sides blend."""


Change: TypeAlias = Literal["always", "during-saccades"]
"""Times at which the gaze that is drawn for may change."""


class LiveMethod(ExtendedModel):
    """Method that draws a stimulus to the gaze."""

    method: Text
    """A condition of `metamerlab foveate --list`; `reference`: the picture itself."""
    parameters: Parameters
    """Parameters of the condition. Others keep their defaults."""
    seed: Seed
    """Seed of noise or displacement."""
    cut: Cut | None = None
    """Null: the whole picture is drawn by the method."""
    change: Change = "always"
    """Times at which the gaze that is drawn for may change. Left out where it always may."""

    added_later: ClassVar[tuple[str, ...]] = ("change",)


class Recipe(Model):
    """Recipe of a study's stimuli: the section `[stimuli]`."""

    kind: str
    """Source of the stimuli: scenes that are rendered, or files that were made elsewhere."""

    section: ClassVar[str] = "stimuli"
    """Section of a file that says size, rate and duration."""

    @property
    def size_unit(self) -> str:
        """Unit in which it says the size."""
        return "px"

    def resolved(self, _folder: Path) -> Recipe:
        """Return the recipe with what lies in files beside the protocol read in."""
        return self

    def pool(self) -> tuple[Stimulus, ...]:
        """Return every stimulus that can be made, in a fixed order."""
        raise NotImplementedError

    def identity(self) -> dict[str, Json]:
        """Return everything that decides the pixels, except for the display."""
        return {"stimuli": self.model_dump(mode="json")}

    def labels(self) -> Mapping[str, str]:
        """Return the words that reports print for the values of conditions."""
        return {}

    def described(self, _display: Display, _scenes: Sequence[str]) -> tuple[Block, ...]:
        """Return a preregistration's blocks on the stimuli."""
        raise NotImplementedError

    def size_px(self, display: Display) -> tuple[int, int]:
        """Return (width, height) of every stimulus in native pixels of `display`."""
        raise NotImplementedError

    @property
    def frame_hz(self) -> float:
        """Frames per second of every stimulus; 1 for stills."""
        return 1.0

    @property
    def frames(self) -> int:
        """Frames of the longest stimulus; 1 for stills."""
        return 1

    @property
    def seed(self) -> int:
        """Seed of every random texture."""
        return 0

    @property
    def bit_depth(self) -> int:
        """Bits per channel of what is shown."""
        return 8

    @property
    def clip_s(self) -> float | None:
        """Length of a clip, s; None for stills, which are shown as long as the task says."""
        return None if self.frames == 1 else self.frames / self.frame_hz

    @property
    def overlap(self) -> tuple[float, float]:
        """Pictures' worth of pixels that a scene's stimuli share, and that each has for itself."""
        return 0.0, 1.0

    @property
    def follows_gaze(self) -> bool:
        """True if stimuli are drawn to the gaze, frame by frame: `LiveImage`, not `Image`."""
        return False

    def live_methods(self) -> Mapping[str, LiveMethod]:
        """Return the drawing method of each stimulus that follows the gaze, by its name."""
        return {}

    def stated(self, _stimulus: Stimulus) -> Parameters:
        """Return a stimulus's values in a manifest, by field of its clip or by parameter."""
        return {"fps": self.frame_hz, "bit_depth": self.bit_depth}

    def values(self, column: str) -> tuple[Scalar, ...]:
        """Return the values of a column of the conditions, in the order declared."""
        found = (s.condition[column] for s in self.pool() if column in s.condition)
        return tuple(dict.fromkeys(found))

    def columns(self) -> tuple[str, ...]:
        """Return the columns of the conditions, in order."""
        return tuple(dict.fromkeys(name for s in self.pool() for name in s.condition))

    def groups(self, scenes: Sequence[str], column: str) -> list[Group]:
        """Group the pool by everything but one column.

        Parameters
        ----------
        scenes : sequence of str
            Those wanted; groups come in this order, then in the pool's.
        column : str
            In which the stimuli of a group differ.
        """
        columns = [name for name in self.columns() if name != column]
        ranks = {
            name: {value: place for place, value in enumerate(self.values(name))}
            for name in columns
        }
        ranks[SCENE] = {scene: place for place, scene in enumerate(scenes)}
        found: dict[tuple[Scalar, ...], dict[str, Stimulus]] = {}
        for stimulus in self.pool():
            if stimulus.scene in ranks[SCENE] and column in stimulus.condition:
                key = tuple(stimulus.condition[name] for name in columns)
                found.setdefault(key, {})[str(stimulus.condition[column])] = stimulus
        groups = []
        for key, stimuli in found.items():
            condition = dict(zip(columns, key, strict=True))
            scene = str(condition.get(SCENE, ""))
            others = (ranks[name][value] for name, value in condition.items() if name != SCENE)
            parity = ranks[SCENE][scene] + sum(others)
            groups.append(Group(scene, parity, stimuli, condition))
        return sorted(groups, key=lambda group: ranks[SCENE][group.scene])

    def problems(self, _folder: Path) -> list[Problem]:
        """Return a problem for every file that is needed and not below `folder`."""
        return []

    def unseen(self, _display: Display) -> list[Problem]:
        """Return a problem where the display does not show what a trial is about."""
        return []

    def cut_away(self) -> tuple[str, ...]:
        """Return in sentences what the study leaves out because displays are not larger."""
        return ()


@dataclass(frozen=True)
class Pool:
    """Stimuli of a study, and how its trials use them."""

    stimuli: Recipe
    scenes: tuple[str, ...]
    """Scenes of the trials that are asked for; one empty name where the stimuli tell none."""
    repeats: int
    """Trials per condition and participant."""

    def check_columns(self, place: str, names: Iterable[str]) -> Iterator[Problem]:
        """Yield a problem for every name that is no column of the stimuli's conditions."""
        known = self.stimuli.columns()
        for name in names:
            if name not in known:
                yield Problem(
                    place,
                    f"must name a column of the stimuli ({', '.join(known)}) (got {name!r})"
                    f"{did_you_mean(name, known)}",
                )

    def check_where(self, place: str, where: Mapping[str, Scalar]) -> Iterator[Problem]:
        """Yield a problem for every column or value that no stimulus has."""
        yield from self.check_columns(place, where)
        for column, value in where.items():
            known = self.stimuli.values(column)
            if isinstance(value, int | float) and str(value) in map(str, known):
                continue  # a column of texts that should be one of numbers: told where it is used
            if known and value not in known:
                listed = ", ".join(map(str, known[:12])) + (", ..." if len(known) > 12 else "")
                yield Problem(
                    f"{place}.{column}",
                    f"must be a value that the stimuli have ({listed}) (got {value!r})"
                    f"{did_you_mean(value, map(str, known))}",
                )
