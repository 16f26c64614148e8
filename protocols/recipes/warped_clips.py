"""Clips of scenes that were warped to other views and filled: the recipe `warped-clips`.

A clip is one scene at one size of disocclusion, filled by one method.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import escape
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self, TypeAlias

from pydantic import Field, field_validator, model_validator

from protocols.blocks import Block, TableBlock
from protocols.disk.hashing import Json
from protocols.display import Display
from protocols.errors import Problem, labelled, shortest
from protocols.recipes.base import Recipe, Stimulus
from protocols.units import (
    Condition,
    Degrees,
    EvenPixels,
    ExtendedModel,
    Factor,
    FocalPixels,
    Hertz,
    Metres,
    Model,
    Name,
    Number,
    Parameters,
    Pixels,
    RimPixels,
    Scalar,
    Seconds,
    SecondsOrNone,
    Seed,
    Share,
    SignedDegrees,
    StoredNumber,
    Text,
    Vector3,
    matching,
)

PHOTOGRAPH_RIM_PX = 1
"""Width of the rim of mixed pixels along a photograph's silhouettes, unless stated."""


class CameraView(Model):
    """View that the camera starts from. The world is right-handed, y up, in metres."""

    position_m: Vector3
    """Position of the camera."""
    look_at_m: Vector3
    """The point it looks at."""
    vertical_fov_deg: Degrees | None = None
    """Vertical field of view. Default: the scene's own."""


class CirclePath(Model):
    """A circle around the scene's camera, parallel to the image plane ([MI] 5).

    Its radius follows from the hole share of the size.
    """

    kind: Literal["circle"]
    turns: Annotated[float, Field(ge=1e-3, le=1000)] = 1.0
    """Turns per clip."""
    start_deg: SignedDegrees = 0.0
    """First frame on the circle, counter-clockwise from the right."""


class LinePath(Model):
    """A straight line."""

    kind: Literal["line"]
    direction: Vector3 = (1.0, 0.0, 0.0)
    """Direction in camera axes: x right, y down, z forward."""
    there_and_back: bool = True
    """Return to the start within the clip."""


class Keyframe(Model):
    """One pose, relative to the scene's camera."""

    t_s: SecondsOrNone
    """Time from the start of the clip."""
    position_m: Vector3
    yaw_deg: SignedDegrees = 0.0
    pitch_deg: SignedDegrees = 0.0
    roll_deg: SignedDegrees = 0.0


class KeyframesPath(Model):
    """Poses at key frames. Positions scale with the size."""

    kind: Literal["keyframes"]
    keyframes: Annotated[tuple[Keyframe, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _in_order(self) -> KeyframesPath:
        stamps = [keyframe.t_s for keyframe in self.keyframes]
        if any(late <= early for early, late in pairwise(stamps)):
            raise ValueError(f"keyframes must be in rising order of t_s (got {stamps})")
        return self


class StereoPath(Model):
    """Path from the left photograph towards the right one, the true view at its end."""

    kind: Literal["stereo"]
    baselines: Annotated[float, Field(ge=1e-3, le=1000)] = 1.0
    """Place of the last frame, in baselines of the pair."""


class UpsamplingPath(ExtendedModel):
    """Temporal up-sampling: every n-th frame is real, the others are warped ([MI] 5)."""

    kind: Literal["upsampling"]
    real_every: Annotated[int, Field(ge=2, le=1000)]
    """n."""
    along: Annotated[CirclePath | LinePath | KeyframesPath, Field(discriminator="kind")] | None = (
        None
    )
    """Motion of the camera of a rendered scene."""
    second_source: bool = False
    """First fill holes from the next real frame, then with the method."""

    added_later: ClassVar[tuple[str, ...]] = ("second_source",)

    @model_validator(mode="after")
    def _backwards_too(self) -> UpsamplingPath:
        if self.second_source and self.along is None:
            raise ValueError(
                "second_source needs a camera that moves (along = ...): the motion that an"
                " OpenEXR sequence brings leads forwards only"
            )
        return self


CameraPath: TypeAlias = Annotated[
    CirclePath | LinePath | KeyframesPath | StereoPath | UpsamplingPath,
    Field(discriminator="kind"),
]


class SceneBase(Model):
    """Keys of every scene."""

    name: Name
    """Its name in this study."""
    label: Text | None = None
    """Its name in reports. Default: the name."""
    camera: CameraPath
    """Motion of the camera during a clip."""
    view: CameraView | None = None
    """View that the camera starts from. Default: the scene's own camera."""
    seed: Seed = 0
    """Seed of a scene made from noise."""
    parameters: Annotated[Parameters, Field(default_factory=dict)]
    """Parameters of the scene."""
    reference: bool | None = None
    """A true view exists. Default: true for rendered scenes and for a stereo pair on the stereo
    path."""

    @model_validator(mode="after")
    def _a_way_to_go(self) -> Self:
        if self.camera.kind == "upsampling" and self.camera.along is None and not self.has_own_path:
            raise ValueError(
                "camera.along must say how the camera moves (got none): only an OpenEXR sequence"
                " brings its own motion"
            )
        if self.camera.kind == "stereo" and not self.is_pair:
            raise ValueError(
                "camera.kind: the stereo path needs a stereo pair (this is none); set"
                " camera.kind = 'circle' or 'line'"
            )
        return self

    is_pair: ClassVar[bool] = False
    """True if there is another photograph to move towards."""

    @property
    def has_own_path(self) -> bool:
        """True if the files tell all motion, so that no size changes it."""
        return False

    @property
    def has_reference(self) -> bool:
        """True if the true view of every frame exists."""
        return self._can_have_reference if self.reference is None else self.reference

    @property
    def _can_have_reference(self) -> bool:
        return True


class BuiltinScene(SceneBase):
    """A scene that comes with metamerlab."""

    kind: Literal["builtin"]
    """Source of the scene."""
    builtin: Name
    """Name of the built-in scene."""


class MeshScene(SceneBase):
    """Textured triangles from a glTF 2.0 file (.gltf, .glb)."""

    kind: Literal["mesh"]
    file: Text
    """Path relative to the study file."""
    scale: Factor = 1.0
    """Metres per unit of the file."""
    lighting: Literal["unlit", "sun"] | None = None
    """`sun` adds a sun with shadows, and sky light. Default: `sun` for files without textures and
    vertex colours."""
    sun_direction: Vector3 | None = None
    """Direction from the scene to the sun, y up. Default: high, from the left and the front."""

    @model_validator(mode="after")
    def _a_sun_to_turn(self) -> MeshScene:
        if self.sun_direction is not None:
            if self.lighting == "unlit":
                raise ValueError("sun_direction needs lighting = 'sun' (got 'unlit')")
            if not any(self.sun_direction):
                raise ValueError("sun_direction must not be zero (got [0, 0, 0])")
        return self


class _PhotoScene(SceneBase):
    @property
    def _can_have_reference(self) -> bool:
        return self.camera.kind in {"stereo", "upsampling"}


class StereoScene(ExtendedModel, _PhotoScene):
    """A rectified stereo pair with disparity: z = focal_px baseline_m / (d + offset_px)."""

    is_pair: ClassVar[bool] = True

    kind: Literal["stereo"]
    left: Text
    """The left photograph, which is warped."""
    right: Text
    """The right photograph."""
    disparity: Text
    """Disparity d of the left view: what lies at x on the left lies at x - d on the right. Unknown
    is 0 in integer files, not finite in float files."""
    units_per_px: Factor = 1.0
    """Value in the file for a disparity of one pixel."""
    unknown: list[StoredNumber] | None = None
    """Further numbers in the file that stand for unknown; `[]` if there are none. Default: what
    looks like one is asked about."""
    focal_px: FocalPixels
    """Focal length."""
    baseline_m: Metres
    """Distance between the two cameras."""
    offset_px: Number = 0.0
    """Difference of the principal points, added to the disparity."""
    rim_px: RimPixels = PHOTOGRAPH_RIM_PX
    """Width of the mixed pixels along a silhouette. They become part of the hole."""
    depth_speckle: bool = True
    """Mend outliers and silhouettes of depth before the warp."""

    added_later: ClassVar[tuple[str, ...]] = ("units_per_px", "unknown", "depth_speckle")


class RgbdScene(ExtendedModel, _PhotoScene):
    """A picture, a depth image of the same size, and the camera's focal length."""

    kind: Literal["rgbd"]
    rgb: Text
    """The picture."""
    depth: Text
    """The depth image."""
    depth_scale: Factor = 1.0
    """Metres per unit of the depth image."""
    depth_is: Literal["distance", "inverse", "ray"] = "distance"
    """`distance`: along the optical axis. `inverse`: 1 / distance. `ray`: along each pixel's
    ray."""
    unknown: list[StoredNumber] | None = None
    """Numbers of the depth image that stand for unknown, as for a stereo pair."""
    focal_px: FocalPixels
    """Focal length."""
    rim_px: RimPixels = PHOTOGRAPH_RIM_PX
    """Rim, as for a stereo pair. Use 0 for renders without anti-aliasing."""
    depth_speckle: bool = True
    """Mending of outliers, as for a stereo pair. Use `false` for rendered depth."""

    added_later: ClassVar[tuple[str, ...]] = ("depth_is", "unknown", "depth_speckle")


class ExrScene(ExtendedModel, _PhotoScene):
    """An OpenEXR picture or sequence with colour, depth and optional motion."""

    kind: Literal["exr"]
    file: Text
    """A file, or a pattern such as `shot.####.exr`."""
    focal_px: FocalPixels | None = None
    """Focal length, where the file does not state it."""
    channels: Annotated[
        dict[Literal["r", "g", "b", "depth", "motion_x", "motion_y"], str],
        Field(default_factory=dict),
    ]
    """Names of channels that differ from those of Blender, Nuke and Unreal."""
    motion: Literal["project", "nuke", "blender", "unreal"] | None = None
    """Program whose units and axes the motion uses. Default: recognised by the channel names."""
    motion_scale: Number = 1.0
    """Factor on the motion."""
    depth_is: Literal["distance", "inverse", "ray"] = "distance"
    """`inverse`: the file holds 1 / distance, as Nuke's ScanlineRender does. `ray`: distance along
    each pixel's ray."""
    depth_scale: Factor = 1.0
    """Metres per unit of depth. Unreal's centimetres are recognised."""
    transfer: Literal["srgb", "rec709", "linear"] = "srgb"
    """Encoding of scene-linear values. `linear`: they are encoded already."""
    rim_px: RimPixels = 0
    """Rim, as for a stereo pair. Use 1 for photographs and anti-aliased pictures."""
    depth_speckle: bool = False
    """Mending of outliers, as for a stereo pair. Use `true` for measured depth."""

    added_later: ClassVar[tuple[str, ...]] = ("depth_speckle",)

    @property
    def has_own_path(self) -> bool:
        """True if it is a sequence, shown pixel for pixel by its own motion."""
        return self.camera.kind == "upsampling"


class AroundScene(SceneBase):
    """All that is around a place: a panorama with distance, seen in one direction.

    It is a built-in scene, an OpenEXR file of colour and distance, or a picture and its distances.
    """

    kind: Literal["around"]
    builtin: Name | None = None
    """Name of a built-in scene, seen all around."""
    height_px: Annotated[int, Field(ge=16, le=2048)] = 1024
    """Height of its panorama."""
    file: Text | None = None
    """Instead, an OpenEXR panorama, such as `stimuli panorama SCENE --depth` writes."""
    rgb: Text | None = None
    """Instead, a picture of a panorama."""
    depth: Text | None = None
    """Distances of its pixels."""
    depth_scale: Factor = 1.0
    """Metres per unit of `depth`."""
    depth_is: Literal["ray", "inverse", "distance"] = "ray"
    """`ray`: along each pixel's own ray. `inverse`: 1 / that. `distance` is along an axis, which a
    panorama has not, and is refused."""
    unknown: list[StoredNumber] | None = None
    """Numbers of `depth` that stand for unknown, as for a stereo pair."""
    rim_px: RimPixels = 0
    """Rim, as for a stereo pair. Use 1 for photographs and anti-aliased pictures."""
    depth_speckle: bool = False
    """Mending of outliers, as for a stereo pair. Use `true` for measured depth."""
    right_deg: SignedDegrees = 0.0
    """Direction of the clip's centre, right of the panorama's centre."""
    down_deg: Annotated[SignedDegrees, Field(ge=-90, le=90)] = 0.0
    """Direction of the clip's centre, below the panorama's centre."""
    view_deg: Degrees = 90.0
    """Visual angle of the clip's width in the panorama."""

    @model_validator(mode="after")
    def _one_source(self) -> AroundScene:
        given = [key for key in ("builtin", "file", "rgb") if getattr(self, key) is not None]
        if len(given) != 1 or (self.rgb is None) != (self.depth is None):
            raise ValueError(
                "must say builtin, or file, or rgb and depth"
                f" (got {', '.join([*given, *(['depth'] if self.depth else [])]) or 'none'})"
            )
        if self.depth_is == "distance":
            raise ValueError(
                "depth_is must be 'ray' or 'inverse' (got 'distance', depth along an axis): a"
                " panorama looks in all directions and has no axis; write each pixel's distance"
            )
        if self.builtin is None and (self.camera.kind == "upsampling" or self.view is not None):
            raise ValueError(
                "view and a camera of kind upsampling need builtin: a file was seen from one place"
            )
        if self.view is not None and self.view.vertical_fov_deg is not None:
            raise ValueError("view_deg says how wide the view is: leave vertical_fov_deg out")
        return self

    @property
    def _can_have_reference(self) -> bool:
        return self.builtin is not None


Scene: TypeAlias = Annotated[
    BuiltinScene | MeshScene | StereoScene | RgbdScene | ExrScene | AroundScene,
    Field(discriminator="kind"),
]


class Size(Model):
    """An amount of disocclusion: a mean share of hole pixels, or an extent of the path.

    Give neither if every scene is an OpenEXR sequence with its own motion.
    """

    name: Name
    """Its name in this study."""
    label: Text | None = None
    """Its name in reports. Default: the name."""
    hole_share: Annotated[float, Field(ge=1e-4, lt=0.5)] | None = None
    """Mean share of hole pixels. The path's extent is solved for it."""
    extent_m: Metres | None = None
    """Radius of the circle or length of the line, instead of a share."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Size:
        if self.hole_share is not None and self.extent_m is not None:
            raise ValueError("a size says either hole_share or extent_m (got both)")
        return self

    @property
    def is_own(self) -> bool:
        """True if it says nothing, for sequences that bring their own motion."""
        return self.hole_share is None and self.extent_m is None


MethodReference = Annotated[
    str,
    matching(
        r"^([a-z0-9]+(-[a-z0-9]+)*|onnx:.+|frames:.+)$",
        "a fill method that 'metamerlab warp --list' lists, or like 'onnx:FILE' or 'frames:FOLDER'",
    ),
]


class FillMethod(Model):
    """A method that fills holes, with its parameters."""

    name: Name
    """Its name in this study: in clips, pairings, journals and tables."""
    method: MethodReference | None = None
    """Registered method, such as `metameric`, `reference`, `onnx:FILE` or `frames:FOLDER`. Default:
    the name."""
    label: Text | None = None
    """Its name in reports. Default: the name."""
    parameters: Annotated[Parameters, Field(default_factory=dict)]
    """Parameters of the method. Others keep their defaults."""

    @property
    def registry_name(self) -> str:
        """The name under which the registry knows the method."""
        return self.method or self.name

    @property
    def is_reference(self) -> bool:
        """True if this is the true view."""
        return self.registry_name == "reference"


class TrueView(Model):
    """Show the true view around the fixation target, as in [MI] Fig. 12."""

    within_deg: Degrees
    """Radius of the true view. Over the next degree it blends into the method's frame."""
    x_deg: SignedDegrees = 0.0
    """Position of the target, right of the clip's centre."""
    y_deg: SignedDegrees = 0.0
    """Position of the target, below the clip's centre."""


class Periphery(Model):
    """Show the method's frame coarser around the true view, or changed for the gaze."""

    coarser: Annotated[int, Field(ge=1, le=64)] = 1
    """Edge of the blocks of pixels whose means are shown, interpolated."""
    condition: Name = "reference"
    """Condition of `metamerlab foveate --list`, for an eye that looks at the target."""
    parameters: Parameters = Field(default_factory=dict)
    """Parameters of the condition. Others keep their defaults."""


class Clips(ExtendedModel):
    """Settings of every clip.

    Give its size in degrees or in pixels of the display.
    """

    width_deg: Degrees | None = None
    """Width of the clip, centred before the eye."""
    height_deg: Degrees | None = None
    """Height of the clip."""
    width_px: EvenPixels | None = None
    """Instead of width_deg."""
    height_px: EvenPixels | None = None
    """Instead of height_deg."""
    fps: Hertz
    """Each frame must last a whole number of refreshes."""
    duration_s: Seconds
    """Length of a clip."""
    seed: Seed = 0
    """Seed of random textures. A fill depends on frame and seed only."""
    bit_depth: Literal[8, 16] = 8
    """Bits per channel."""
    render_width_px: Pixels | None = None
    """Width at which the method works, if another. Needs `rescale`."""
    rescale: Literal["none", "box", "lanczos3"] = "none"
    """Filter that brings rendered frames to display pixels, before hashing."""
    margin_share: Share = 0.15
    """Extra picture around the source view."""
    exr: bool = False
    """Keep float frames beside the PNGs."""
    preview: bool = True
    """Write a small video per clip."""
    true_view: TrueView | None = None
    """The true view around the fixation target. Default: the method's frame everywhere."""
    periphery: Periphery | None = None
    """Look of the method's frame around the true view. Default: as the method made it."""

    @property
    def frames(self) -> int:
        """Frames in one clip."""
        return round(self.duration_s * self.fps)

    added_later: ClassVar[tuple[str, ...]] = ("width_px", "height_px", "true_view", "periphery")

    @field_validator("periphery")
    @classmethod
    def _none_if_nothing_changes(cls, given: Periphery | None) -> Periphery | None:
        return None if given == Periphery() else given

    @model_validator(mode="after")
    def _around_a_true_view(self) -> Clips:
        if self.periphery is not None and self.true_view is None:
            raise ValueError(
                "periphery needs true_view, around which it lies (got none); add true_view ="
                " { within_deg = 5 }, or leave periphery out"
            )
        return self

    def around_dot(self) -> dict[str, str]:
        """Return the looks of the true view and the periphery, for readers and manifests."""
        found = {}
        if (view := self.true_view) is not None:
            found["true_view"] = (
                f"within {view.within_deg:g} deg of ({view.x_deg:g}, {view.y_deg:g}) deg"
            )
        if (around := self.periphery) is not None:
            given = "".join(f", {key} {value}" for key, value in around.parameters.items())
            found["periphery"] = f"in blocks of {around.coarser} px" + (
                f", as {around.condition}{given}" * (around.condition != "reference")
            )
        return found

    @model_validator(mode="after")
    def _one_size(self) -> Clips:
        named = ("width_deg", "height_deg", "width_px", "height_px")
        given = [name for name in named if getattr(self, name) is not None]
        if given not in ([*named[:2]], [*named[2:]]):
            raise ValueError(
                "must say width_deg and height_deg, or width_px and height_px"
                f" (got {', '.join(given) or 'none'})"
            )
        return self

    @model_validator(mode="after")
    def _whole_frames(self) -> Clips:
        exact = self.duration_s * self.fps
        if self.frames < 1 or abs(exact - self.frames) > 1e-6:
            nearest = [
                shortest(n / self.fps, lambda s: abs(s * self.fps - round(s * self.fps)) <= 1e-6)
                for n in (max(1, int(exact)), int(exact) + 1)
            ]
            raise ValueError(
                f"duration_s x fps must be whole frames (got {self.duration_s:g} s x"
                f" {self.fps:g} fps = {exact:g}); the nearest durations are"
                f" {' and '.join(f'{near} s' for near in nearest)}"
            )
        if self.render_width_px is not None and self.rescale == "none":
            raise ValueError(
                f"render_width_px = {self.render_width_px} needs a declared filter;"
                " set rescale to 'box' or 'lanczos3', or leave render_width_px out"
            )
        return self


@dataclass(frozen=True, order=True)
class ClipName:
    """One clip of a study; `str` gives its folder, ``scene__size__method``."""

    scene: str
    size: str
    method: str

    def __str__(self) -> str:
        return f"{self.scene}__{self.size}__{self.method}"

    @property
    def condition(self) -> Condition:
        """The columns of its condition."""
        return {"scene": self.scene, "size": self.size, "method": self.method}

    @classmethod
    def of(cls, condition: Condition) -> ClipName:
        """Return the clip of a condition."""
        return cls(*(str(condition[column]) for column in ("scene", "size", "method")))


FILE_KEYS = ("file", "left", "right", "disparity", "rgb", "depth")
"""Keys of scenes that name a file."""


class WarpedClips(Recipe):
    """Scenes warped along camera paths. Methods fill the holes."""

    kind: Literal["warped-clips"]
    scenes: Annotated[tuple[Scene, ...], Field(min_length=1)]
    """The scenes."""
    sizes: Annotated[tuple[Size, ...], Field(min_length=1)]
    """Amounts of disocclusion."""
    methods: Annotated[tuple[FillMethod, ...], Field(min_length=2)]
    """The methods under comparison."""
    clips: Clips
    """Size, rate and duration of every clip."""

    section: ClassVar[str] = "stimuli.clips"

    @model_validator(mode="after")
    def _true_views_exist(self) -> WarpedClips:
        without = [scene.name for scene in self.scenes if not scene.has_reference]
        if self.clips.true_view is not None and without:
            raise ValueError(
                f"true_view needs scenes with a reference ({', '.join(without)}: none); leave them"
                " out, or leave true_view out"
            )
        return self

    @property
    def size_unit(self) -> str:
        """`px` where the clips' size is given in pixels, else `deg`."""
        return "deg" if self.clips.width_px is None else "px"

    def pool(self) -> tuple[Stimulus, ...]:
        """Return every clip in the order scene, size, method."""
        names = (
            ClipName(scene.name, size.name, method.name)
            for scene in self.scenes
            for size in self.sizes
            for method in self.methods
            if scene.has_reference or not method.is_reference
        )
        return tuple(Stimulus(str(name), name.condition) for name in names)

    def identity(self) -> dict[str, Json]:
        """Return scenes, sizes, methods and clips."""
        parts: dict[str, Json] = self.model_dump(mode="json", exclude={"kind"})
        return parts

    def labels(self) -> Mapping[str, str]:
        """Return the labels of methods, sizes and scenes."""
        entries = (*self.methods, *self.sizes, *self.scenes)
        return {entry.name: entry.label or entry.name for entry in entries}

    def described(self, display: Display, scenes: Sequence[str]) -> tuple[Block, ...]:
        """Return clips, scenes, sizes and methods."""
        width, height = self.size_px(display)
        clips, labels = self.clips, self.labels()
        sizes = [
            f"{labelled(size.name, size.label)}: "
            + (
                f"mean hole share {100 * size.hole_share:g} %"
                if size.hole_share is not None
                else "as the files have it"
                if size.extent_m is None
                else f"path extent {size.extent_m:g} m"
            )
            for size in self.sizes
        ]
        methods = tuple(
            (
                labelled(method.name, method.label),
                method.registry_name,
                ", ".join(f"{k} = {v}" for k, v in method.parameters.items()) or "defaults",
            )
            for method in self.methods
        )
        return (
            f"Clips of {clips.duration_s:g} s at {clips.fps:g} frames per second,"
            f" {self._angles(display)} ({width} x {height} px, never rescaled) on {display.name}:"
            f" {display.description or 'no description'}.",
            *(
                f"{key} {said}.".replace("_", " ").capitalize()
                for key, said in clips.around_dot().items()
            ),
            "Scenes: " + ", ".join(labelled(name, labels[name]) for name in scenes) + ".",
            "Sizes: " + "; ".join(sizes) + ".",
            TableBlock.of(
                "", [("method", "l"), ("registry name", "l"), ("parameters", "l")], methods
            ),
        )

    def _angles(self, display: Display) -> str:
        clips = self.clips
        if clips.width_px is not None and clips.height_px is not None:
            angles = display.angles_deg(clips.width_px, clips.height_px)
            return " x ".join(f"{angle:.3g}" for angle in angles) + " deg"
        return f"{clips.width_deg:g} x {clips.height_deg:g} deg"

    def size_px(self, display: Display) -> tuple[int, int]:
        """Return (width, height) of every clip."""
        clips = self.clips
        if clips.width_px is not None and clips.height_px is not None:
            return clips.width_px, clips.height_px
        assert clips.width_deg is not None
        assert clips.height_deg is not None
        return display.centred_size_px(clips.width_deg, clips.height_deg)

    def values(self, column: str) -> tuple[Scalar, ...]:
        """Return the names of scenes, sizes or methods as declared."""
        named: dict[str, tuple[Scene, ...] | tuple[Size, ...] | tuple[FillMethod, ...]] = {
            "scene": self.scenes,
            "size": self.sizes,
            "method": self.methods,
        }
        return tuple(entry.name for entry in named.get(column, ()))

    @property
    def frame_hz(self) -> float:
        """Clip frames per second."""
        return self.clips.fps

    @property
    def frames(self) -> int:
        """Frames of every clip."""
        return self.clips.frames

    @property
    def clip_s(self) -> float:
        """Length of a clip, s: one of a single frame is a clip too."""
        return self.frames / self.frame_hz

    @property
    def seed(self) -> int:
        """Seed of every random texture."""
        return self.clips.seed

    @property
    def bit_depth(self) -> int:
        """Bits per channel."""
        return self.clips.bit_depth

    def stated(self, stimulus: Stimulus) -> Parameters:
        """Return rate, depth, seeds, camera path, and what the study sets of the method."""
        name = ClipName.of(stimulus.condition)
        scene, method = self.scene(name.scene), self.method(name.method)
        found: Parameters = {
            "seed": self.clips.seed,
            "path": scene.camera.kind,
            "scene_seed": scene.seed,
            "exr": self.clips.exr,
            "preview": self.clips.preview,
        }
        if ":" not in method.registry_name:  # else with the folder that its file was found in
            found["method"] = method.registry_name
        for key, value in method.parameters.items():
            found[f"method.{key}"] = tuple(value) if isinstance(value, list) else value
        return super().stated(stimulus) | found | self.clips.around_dot()

    def scene(self, name: str) -> Scene:
        """Return the scene called `name`."""
        return next(scene for scene in self.scenes if scene.name == name)

    def method(self, name: str) -> FillMethod:
        """Return the method called `name`."""
        return next(method for method in self.methods if method.name == name)

    def problems(self, folder: Path) -> list[Problem]:
        """Return a problem for every file of a scene that is not below `folder`.

        Only what is plainly a file is looked for: names of built-in pairs, which have no suffix,
        are left to whoever reads them. Of a sequence (``shot.####.exr``) one file is enough.
        """
        found = []
        for index, scene in enumerate(self.scenes):
            for key in FILE_KEYS:
                name = getattr(scene, key, None)
                if not isinstance(name, str) or not Path(name).suffix:
                    continue
                place = folder / name
                lacks, needed, there = "the file is not there", "it", place.exists()
                if "#" in name:
                    lacks, needed = "no file is called so", "them"
                    there = any(place.parent.glob(re.sub("#+", "*", escape(place.name))))
                if not there:
                    cure = f"'metamerlab stimuli build' needs {needed}"
                    said = f"{lacks} (looked for {place}); {cure}"
                    found.append(Problem(f"stimuli.scenes[{index}].{key}", said))
        return found
