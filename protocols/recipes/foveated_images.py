"""Pictures shown to a gaze, with rings or a cut drawn in: the recipe `foveated-images`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from protocols.blocks import Block
from protocols.disk.hashing import Chance, Json
from protocols.display import Display
from protocols.errors import Problem, count_of
from protocols.recipes.base import Change, Cut, LiveMethod, Recipe, Stimulus
from protocols.units import (
    Degrees,
    ExtendedModel,
    Few,
    Model,
    Name,
    Parameters,
    Pixels,
    Scalar,
    Seed,
    Share,
    SignedDegrees,
    Text,
)

REFERENCE = "reference"
CLOSED, OPEN = "closed", "open"
CONSISTENT, INCONSISTENT = "consistent", "inconsistent"
BUILTIN = "builtin:"
"""Before the name of a picture that is made here, in place of a file."""
_FOLLOWS: Mapping[Change, str] = {
    "always": "Each frame is drawn to the gaze of that moment.",
    "during-saccades": "Each picture is drawn to the gaze of its first moment. It changes with the"
    " gaze during saccades, and up to 50 ms behind them.",
}
_TURN = 360
_FINER = 1000  # of a degree: angles are whole thousandths, the same on every platform


class PanoramaView(Model):
    """A flat view out of a panorama."""

    right_deg: SignedDegrees = 0.0
    """Longitude of the view's centre, right of the panorama's centre."""
    down_deg: SignedDegrees = 0.0
    """Latitude of the view's centre, below the panorama's centre, from -90 to 90."""


CROPS = {
    "middle": (0.5, 0.5), "top": (0.5, 0.0), "bottom": (0.5, 1.0), "left": (0.0, 0.5),
    "right": (1.0, 0.5),
}  # fmt: skip
"""Words for the point of a picture that a crop keeps in its middle, as far as there is room."""
Crop = Literal["middle", "top", "bottom", "left", "right"] | tuple[Share, Share]


class ScenePicture(ExtendedModel):
    """A picture, which is the scene."""

    name: Name
    """Its name in this study."""
    file: Text
    """Path relative to the study file, or `builtin:NAME`, drawn in the study's size and at the
    display's angles."""
    view: PanoramaView | None = None
    """View of a whole 2:1 equirectangular panorama to show, at the display's angles. Default:
    the picture is flat."""
    crop: Crop | None = None
    """Part of this picture that `fit = "cover"` keeps. Default: `stimuli.crop`."""

    added_later: ClassVar[tuple[str, ...]] = ("crop",)


class ShownMethod(Model):
    """A way to show pictures."""

    name: Name
    """Its name in this study."""
    method: Text | None = None
    """A condition of `metamerlab foveate --list`. Default: the name. `files:FOLDER`: pictures made
    elsewhere, `000000.png` for the first picture and gaze, then its next gaze, and so on."""
    parameters: Parameters = Field(default_factory=dict)
    """Parameters of the condition. Others keep their defaults."""
    columns: dict[Name, Scalar] = Field(default_factory=dict)
    """Further columns of the table of stimuli, such as `{ scaling = 0.25 }`."""
    label: Text | None = None
    """Its name in reports. Default: the name."""

    @property
    def condition(self) -> str:
        """The condition's name in the registry."""
        return self.method or self.name


class GazePoint(Model):
    """Point that the eye looks at. The fixation target must be there."""

    name: Name
    """Its name in this study."""
    x_deg: SignedDegrees = 0.0
    """Right of the picture's centre."""
    y_deg: SignedDegrees = 0.0
    """Below the picture's centre."""


class Rings(Model):
    """Landolt rings drawn into the picture before foveation, one per stimulus."""

    eccentricities_deg: Annotated[tuple[Degrees, ...], Field(min_length=1)]
    """Angles from the gaze to the ring's centre."""
    height_deg: Degrees = 1.25
    """Outer diameter. Stroke and gap are a fifth of it (ISO 8596)."""
    places: Few = 5
    """Rings of each kind per eccentricity: one in each of as many equal sectors. Methods and scenes
    share the places."""
    scenes: Literal["each", "in-turn"] = "each"
    """`each`: every ring in every picture. `in-turn`: every ring in one picture, the same for all
    methods."""
    field_deg: tuple[Degrees, Degrees] | None = None
    """Width and height of the field around the gaze that rings may occupy. Default: whole
    circles."""
    gaps_deg: Annotated[tuple[SignedDegrees, ...], Field(min_length=1)] = (0.0,)
    """Directions of the gap, counter-clockwise from the right."""
    closed: bool = True
    """Show closed rings too."""
    grey: Share = 0.0
    """Gamma-encoded grey of the ring."""
    background: Literal["foveated", "undistorted"] = "foveated"
    """Surroundings of the ring: the method's picture, or the original."""
    rim_deg: Degrees = 0.625
    """Width of the method's picture around the ring, for an undistorted background."""

    def arcs(self, eccentricity_deg: float) -> tuple[float, float]:
        """Return the part of its circle's first quarter where a ring fits: polar angles from, to.

        The other quarters mirror it; from equals to where it fits nowhere. A ring fits where the
        cone of sight that holds it passes no edge of the field: the direction to its middle is at
        least its radius away from the plane through the eye and the edge.
        """
        if self.field_deg is None:
            return 0.0, _TURN / 4
        across, up = (_reach(angle, eccentricity_deg, self.height_deg) for angle in self.field_deg)
        first = 0.0 if across >= 1 else math.degrees(math.acos(max(0.0, across)))
        last = _TURN / 4 if up >= 1 else math.degrees(math.asin(max(0.0, up)))
        return first, max(first, last)

    def circle_share(self, eccentricity_deg: float) -> float:
        """Return the share of a circle on which rings fit."""
        first, last = self.arcs(eccentricity_deg)
        return (last - first) / (_TURN / 4)

    def polar_deg(self, eccentricity_deg: float, share: float) -> float:
        """Return the polar angle at a share of all arcs, counter-clockwise from the right."""
        first, last = self.arcs(eccentricity_deg)
        if (first, last) == (0.0, _TURN / 4):
            return _TURN * share
        quarter, along = divmod(4 * share, 1)
        turned = along if quarter % 2 == 0 else 1 - along  # every other quarter is mirrored
        angle = first + turned * (last - first)
        return quarter * _TURN / 4 + (angle if quarter % 2 == 0 else _TURN / 4 - angle)

    def cut_away(self) -> list[str]:
        """Return the part of each circle outside of the field, in a line; none: nothing is."""
        said = []
        for eccentricity in self.eccentricities_deg:
            first, last = self.arcs(eccentricity)
            if (first, last) != (0.0, _TURN / 4):
                said.append(
                    f"at {eccentricity:g} deg rings lie on"
                    f" {self.circle_share(eccentricity):.0%} of the circle:"
                    f" from {first:.0f} to {last:.0f} deg off the horizontal, right and left, above"
                    " and below"
                )
        return said

    @property
    def around(self) -> str:
        """Sentence for a reader about the background; empty where it is the method's."""
        if self.background == "foveated":
            return ""
        return (
            f" Beyond {self.rim_deg:g} degrees around the ring the scene is undistorted (blended"
            " over as much again)."
        )


class Cuts(Model):
    """A line through the gaze at a random angle, with the method on one side.

    The other side is the reference. In consistent stimuli both sides are the method.
    """

    draws: Few = 6
    """Stimuli of each kind, each with its own angle and seed."""
    ramp_deg: Degrees = 1.0
    """Width over which the sides blend."""
    own_seeds: bool = True
    """Each draw has its own noise. If false, all draws cut one picture; live, all pictures share
    their noise."""


@dataclass(frozen=True)
class FoveatedStimulus:
    """One stimulus in full."""

    name: str
    condition: dict[str, Scalar]
    picture: ScenePicture
    shown: ShownMethod
    gaze: GazePoint
    seed: int
    """Seed of noise or displacement."""
    eccentricity_deg: float | None = None
    polar_deg: float | None = None
    """Counter-clockwise from the right; None: no ring."""
    gap_deg: float | None = None
    """None: a closed ring, or none."""
    cut_deg: float | None = None
    """Direction of the line, counter-clockwise from the right; None: not cut."""

    def told(self, more: Mapping[str, Scalar], *words: str) -> FoveatedStimulus:
        """Return it with further words in its name and further columns of its condition."""
        name = "__".join((self.name, *words))
        return replace(self, name=name, condition={**self.condition, **more})


class FoveatedImages(ExtendedModel, Recipe):
    """Stills prepared for a gaze by several methods, or drawn to it while they are shown."""

    added_later: ClassVar[tuple[str, ...]] = ("live", "change", "crop")

    kind: Literal["foveated-images"]
    live: bool = False
    """Draw every frame to the gaze of that moment, on the machine of the session. What is built and
    hashed is the picture itself. Default: pictures are made beforehand, for `gazes`."""
    change: Change = "always"
    """Changes of live pictures. `during-saccades`: the first frame of a phase shows the gaze of its
    moment, which is held until a flip is due in a saccade or up to 50 ms behind it. Default: every
    frame follows."""
    width_px: Pixels
    """Width of every stimulus. Stimuli are never rescaled on the screen."""
    height_px: Pixels
    """Height of every stimulus."""
    fit: Literal["exact", "cover"] = "exact"
    """`exact`: pictures have this size. `cover`: they are scaled to cover it, then cropped."""
    crop: Crop = "middle"
    """Part that `cover` keeps: the middle, an edge, or the surroundings of a point, such as `[0.5,
    0.2]`, in shares of the picture's width and height from its upper left corner."""
    pictures: Annotated[tuple[ScenePicture, ...], Field(min_length=1)]
    """The scenes."""
    methods: Annotated[tuple[ShownMethod, ...], Field(min_length=1)]
    """Ways to show a picture. `reference` is the picture itself."""
    gazes: Annotated[tuple[GazePoint, ...], Field(min_length=1)] = (GazePoint(name="middle"),)
    """Points that the eye looks at."""
    draws: Few = 1
    """Stimuli that differ in the seed only, if nothing is drawn in."""
    texture_seed: Seed = 0
    """Seed of noise, displacements, polar angles and cuts."""
    rings: Rings | None = None
    """Landolt rings in the pictures. Default: none."""
    cuts: Cuts | None = None
    """Cut pictures. Default: whole pictures."""

    @model_validator(mode="after")
    def _names_once(self) -> FoveatedImages:
        for what, names in (
            ("picture", [one.name for one in self.pictures]),
            ("method", [one.name for one in self.methods]),
            ("gaze", [one.name for one in self.gazes]),
        ):
            for name, count in Counter(names).items():
                if count > 1:
                    raise ValueError(f"every {what} must be named once (got {name!r} {count}x)")
        if self.rings is not None and self.cuts is not None:
            raise ValueError("rings and cuts are two experiments: give one of them")
        if self.draws > 1 and (self.rings is not None or self.cuts is not None):
            raise ValueError("draws is for whole pictures: rings have places, cuts have draws")
        if self.rings is not None and self.rings.field_deg is not None:
            if max(self.rings.field_deg) >= 2 * 90:
                raise ValueError("field_deg must be less than 180 degrees wide and high")
            if any(gaze.x_deg or gaze.y_deg for gaze in self.gazes):
                raise ValueError("field_deg lies around a gaze in the middle: leave gazes out")
            for eccentricity in self.rings.eccentricities_deg:
                first, last = self.rings.arcs(eccentricity)
                if first == last:
                    raise ValueError(
                        f"a ring {eccentricity:g} degrees from the gaze must fit somewhere in"
                        " field_deg; leave that eccentricity out, or sit nearer to the display"
                    )
        if self.cuts is not None and all(one.condition == REFERENCE for one in self.methods):
            raise ValueError("cuts need a method beside 'reference'")
        if self.live and (self.rings is not None or self.gazes != (GazePoint(name="middle"),)):
            raise ValueError("live pictures follow the gaze: leave rings and gazes out")
        if self.change != "always" and not self.live:
            raise ValueError(
                f"change is of live pictures (got {self.change!r}); set live = true, or leave it"
                " out"
            )
        cropped = self.crop != "middle" or any(one.crop is not None for one in self.pictures)
        if cropped and self.fit != "cover":
            raise ValueError('crop needs fit = "cover" (got "exact", which cuts nothing)')
        for picture in self.pictures:
            if picture.crop is not None and picture.view is not None:
                raise ValueError(
                    f"crop is for flat pictures, and {picture.name!r} has a view: leave one out"
                )
            if picture.view is not None and abs(picture.view.down_deg) > 90:
                raise ValueError(f"view of {picture.name!r} must have down_deg from -90 to 90")
        for gaze in self.gazes:
            if max(abs(gaze.x_deg), abs(gaze.y_deg)) >= 90:
                raise ValueError(f"gaze {gaze.name!r} must lie within 90 degrees of the middle")
        return self

    def kept(self, picture: ScenePicture) -> tuple[float, float]:
        """Return the point of a picture that a crop keeps, (x, y) in shares of its size."""
        crop = self.crop if picture.crop is None else picture.crop
        return CROPS[crop] if isinstance(crop, str) else crop

    def stimuli(self) -> tuple[FoveatedStimulus, ...]:
        """Return every stimulus in full, in the order of the pool."""
        return tuple(self._stimuli())

    def _stimuli(self) -> Iterator[FoveatedStimulus]:
        turns = self._turns()
        for picture, shown, gaze in product(self.pictures, self.methods, self.gazes):
            condition = {"scene": picture.name, "method": shown.name, **shown.columns}
            plain = FoveatedStimulus(
                f"{picture.name}__{shown.name}", condition, picture, shown, gaze, 0
            )
            if len(self.gazes) > 1:
                plain = plain.told({"gaze": gaze.name}, gaze.name)
            if self.rings is not None:
                yield from self._rings(self.rings, plain, turns)
            elif self.cuts is not None:
                yield from self._cuts(self.cuts, plain)
            else:
                yield from self._draws(plain)

    def _draws(self, plain: FoveatedStimulus) -> Iterator[FoveatedStimulus]:
        if self.draws == 1 or plain.shown.condition == REFERENCE:  # which has no seed
            yield replace(plain, seed=self._seed_of(0))
            return
        for draw in range(self.draws):
            yield replace(plain.told({"draw": draw}, f"d{draw}"), seed=self._seed_of(draw))

    def _turns(self) -> dict[tuple[float, str, float | None, int], str]:
        """Return the one picture of every ring, where pictures take turns; else nothing."""
        if self.rings is None or self.rings.scenes == "each":
            return {}
        names: list[str] = []
        drawn = [
            (eccentricity, symbol, gap, place)
            for eccentricity, (symbol, gap) in product(
                self.rings.eccentricities_deg, _kinds(self.rings)
            )
            for place in range(self.rings.places)
        ]
        while len(names) < len(drawn):
            chance = Chance(self.texture_seed, "scenes", len(names))
            names += chance.shuffled([picture.name for picture in self.pictures])
        return dict(zip(drawn, names, strict=False))

    def _rings(
        self,
        rings: Rings,
        plain: FoveatedStimulus,
        turns: Mapping[tuple[float, str, float | None, int], str],
    ) -> Iterator[FoveatedStimulus]:
        scene, kinds = plain.picture.name, _kinds(rings)
        for eccentricity, (symbol, gap) in product(rings.eccentricities_deg, kinds):
            for place in range(rings.places):
                if turns.get((eccentricity, symbol, gap, place), scene) != scene:
                    continue
                chance = Chance(self.texture_seed, "polar", eccentricity, symbol, gap, place)
                within = chance.below(_FINER) / _FINER
                share = (place + within) / rings.places
                polar = round(rings.polar_deg(eccentricity, share) * _FINER) / _FINER
                words = [f"e{_word(eccentricity)}", symbol]
                if len(rings.gaps_deg) > 1 and gap is not None:
                    words.append(f"g{_word(gap)}")
                words.append(f"p{place}")
                more: dict[str, Scalar] = {
                    "eccentricity_deg": eccentricity,
                    "symbol": symbol,
                    "gap_deg": 0.0 if gap is None else gap,
                    "place": place,
                    "polar_deg": polar,
                }
                # Of the picture, not of the method: methods differ in nothing else.
                seed = self._seed_of(scene, plain.gaze.name, eccentricity, symbol, gap, place)
                yield replace(
                    plain.told(more, *words), seed=seed, eccentricity_deg=eccentricity,
                    polar_deg=polar, gap_deg=gap,
                )  # fmt: skip

    def _cuts(self, cuts: Cuts, plain: FoveatedStimulus) -> Iterator[FoveatedStimulus]:
        # A reference beside a reference is consistent, whatever the cut.
        alone = plain.shown.condition == REFERENCE
        scene, gaze = plain.picture.name, plain.gaze.name
        for cut, draw in product([CONSISTENT] if alone else [CONSISTENT, INCONSISTENT],
                                 range(cuts.draws)):  # fmt: skip
            chance = Chance(self.texture_seed, "cut", scene, plain.shown.name, gaze, cut, draw)
            angle = chance.below(_TURN * _FINER) / _FINER
            more: dict[str, Scalar] = {"cut": cut, "draw": draw, "cut_deg": angle}
            own = (cut, draw) if cuts.own_seeds else ()
            # A new seed takes long to prepare: live, between trials.
            named = () if self.live and not own else (scene, gaze)
            cut_deg = angle if cut == INCONSISTENT else None
            stimulus = plain.told(more, cut, f"d{draw}")
            yield replace(stimulus, seed=self._seed_of(*named, *own), cut_deg=cut_deg)

    def _seed_of(self, *what: Scalar | None) -> int:
        return Chance(self.texture_seed, "noise", *what).below(2**53)

    def pool(self) -> tuple[Stimulus, ...]:
        """Return every stimulus: scene by scene, method by method."""
        return tuple(Stimulus(one.name, one.condition) for one in self.stimuli())

    @property
    def follows_gaze(self) -> bool:
        """True if stimuli are drawn to the gaze."""
        return self.live

    def live_methods(self) -> dict[str, LiveMethod]:
        """Return method, seed and cut of each stimulus that follows the gaze."""
        ramp_deg = self.cuts.ramp_deg if self.cuts else 0.0
        return {
            one.name: LiveMethod(
                method=one.shown.condition,
                parameters=one.shown.parameters,
                seed=one.seed,
                cut=None if one.cut_deg is None else Cut(angle_deg=one.cut_deg, ramp_deg=ramp_deg),
                change=self.change,
            )
            for one in (self.stimuli() if self.live else ())
        }

    def identity(self) -> dict[str, Json]:
        """Return everything that decides the pixels; labels, and when gaze is taken, do not."""
        raw = self.model_dump(mode="json")
        raw.pop("change", None)
        for method in raw["methods"]:
            method.pop("label")
        return {"stimuli": raw}

    def labels(self) -> dict[str, str]:
        """Return the words that reports print for methods."""
        return {one.name: one.label for one in self.methods if one.label}

    def described(self, display: Display, scenes: Sequence[str]) -> tuple[Block, ...]:
        """Return pictures, methods and what is drawn in."""
        methods = [
            f"{one.name}: {one.condition}"
            + "".join(f", {key} {value}" for key, value in one.parameters.items())
            for one in self.methods
        ]
        drawn = []
        if self.rings is not None:
            at = ", ".join(f"{value:g}" for value in self.rings.eccentricities_deg)
            drawn.append(
                f"Landolt rings {self.rings.height_deg:g} degrees high at {at} degrees from the"
                f" gaze, {self.rings.places} of each kind"
                + (", open and closed." if self.rings.closed else ".")
                + self.rings.around
                + "".join(f" {one[0].upper()}{one[1:]}." for one in self.rings.cut_away())
                + (
                    " Every ring is in one scene, and scenes take turns."
                    if self.rings.scenes == "in-turn"
                    else ""
                )
            )
        if self.cuts is not None:
            drawn.append(
                "Cut by a line through the gaze at a random angle, blended over"
                f" {self.cuts.ramp_deg:g} degrees, {self.cuts.draws} of each kind."
                + ("" if self.cuts.own_seeds else " All of a kind cut one picture.")
            )
        return (
            f"{count_of(len(self.stimuli()), 'picture')}, {self.width_px} x {self.height_px} px, on"
            f" {display.name}: {display.description or 'no description'}.",
            f"Scenes: {', '.join(scene for scene in scenes if scene)}.",
            methods,
            *drawn,
            *[_FOLLOWS[self.change]] * self.live,
        )

    def size_px(self, _display: Display) -> tuple[int, int]:
        """Return (width, height) of every picture."""
        return self.width_px, self.height_px

    @property
    def overlap(self) -> tuple[float, float]:
        """Rings on one picture differ about the ring; cuts of one picture, along the cut."""
        if self.rings is not None and self.rings.background == "undistorted":
            return 1.0, 0.05
        if self.cuts is not None and not self.cuts.own_seeds:
            return float(len(self.methods)), 0.15
        return super().overlap

    @property
    def seed(self) -> int:
        """Seed of every texture."""
        return self.texture_seed

    def problems(self, folder: Path) -> list[Problem]:
        """Return a problem for every picture that is not below `folder`."""
        return [
            Problem(
                f"stimuli.pictures[{index}].file",
                f"the file of {one.name!r} is not there (looked for {folder / one.file});"
                " 'metamerlab stimuli build' needs it",
            )
            for index, one in enumerate(self.pictures)
            if not one.file.startswith(BUILTIN) and not (folder / one.file).exists()
        ]

    def unseen(self, display: Display) -> list[Problem]:
        """Return a problem where rings leave the picture as this display shows it."""
        rings = self.rings
        if rings is None or any(gaze.x_deg or gaze.y_deg for gaze in self.gazes):
            return []  # off the middle: the builder tries each ring
        angles = display.angles_deg(
            min(self.width_px, display.width_px), min(self.height_px, display.height_px)
        )
        whole = Rings(**{**rings.model_dump(), "field_deg": angles})
        for one in self.stimuli():
            assert one.eccentricity_deg is not None
            assert one.polar_deg is not None
            first, last = whole.arcs(one.eccentricity_deg)
            off = one.polar_deg % (_TURN / 2)
            off = min(off, _TURN / 2 - off)
            if not first - 1 / _FINER <= off <= last + 1 / _FINER or first == last:
                fits = [math.floor(10 * angle) / 10 for angle in angles]
                left = ", ".join(
                    f"{share:.0%} at {eccentricity:g} deg"
                    for eccentricity in rings.eccentricities_deg
                    if (share := whole.circle_share(eccentricity)) < 1
                )
                return [
                    Problem(
                        "stimuli.rings.field_deg",
                        f"every ring must lie on the picture, {angles[0]:.1f} x {angles[1]:.1f} deg"
                        f" on this display (one lies {one.eccentricity_deg:g} deg from the gaze at"
                        f" {one.polar_deg:g} deg); write field_deg = {fits}, so that angles are"
                        f" uniform on the arcs that fit ({left} of the circle), or choose smaller"
                        " eccentricities",
                    )
                ]
        return []

    def cut_away(self) -> tuple[str, ...]:
        """Return the parts of a circle that have no rings."""
        return () if self.rings is None else tuple(self.rings.cut_away())


def _kinds(rings: Rings) -> list[tuple[str, float | None]]:
    """The symbols of a place: each direction of the gap, and the closed ring."""
    kinds: list[tuple[str, float | None]] = [(OPEN, gap) for gap in rings.gaps_deg]
    return [*kinds, (CLOSED, None)] if rings.closed else kinds


def _reach(field_deg: float, eccentricity_deg: float, height_deg: float) -> float:
    """Largest cosine (sine) of the polar angle at which a ring stays in the width (height)."""
    half, away = math.radians(field_deg / 2), math.radians(eccentricity_deg)
    room = math.cos(away) * math.sin(half) - math.sin(math.radians(height_deg / 2))
    return room / (math.sin(away) * math.cos(half))


def _word(value: float) -> str:
    """A number in a name: 2.5 is 2-5, -45 is m45."""
    return ("m" if value < 0 else "") + f"{abs(value):g}".replace(".", "-")
