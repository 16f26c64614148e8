"""The options of `metamerlab warp`: of a file, a picture with motion or depth, or a stereo pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import typer

from study_app.cli.options import unknown_numbers
from study_app.cli.pictures.one_picture_options import LOOK, FovOption, GazeOption, ShownOption


@dataclass(frozen=True)
class FileOptions:
    """Options of a file of colour, depth and flow."""

    panel: ClassVar = "File of colour, depth and flow"

    clip: bool = False
    """Clip light brighter than the display can show instead of refusing it."""
    encoded: bool = False
    """The file's colour is display-referred already, not scene-linear."""
    channels: Annotated[list[str] | None, typer.Option("--channel", metavar="WHAT=NAME")] = None
    """Name of a channel that is not R, G, B, Z, flow.x, flow.y or target.Z. WHAT is red, green,
    blue, depth, flow_x, flow_y or target_depth."""


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture with motion or depth; see `pipeline.pictures.warp_input`."""

    panel: ClassVar = "Picture with motion or depth"

    flow: Path | None = None
    """Motion of each pixel: .flo, .pfm, .npy, .npz, or KITTI's .png."""
    depth: Path | None = None
    """Depth along the optical axis: .png, .tif, .pgm, .pfm, .exr, .npy or .npz; unknown is 0 in
    integers, not a number in floats. Given alone, the camera moves sideways. Also useful with
    --flow."""
    depth_scale: float = 1.0
    """Metres per unit of --depth: 0.001 for millimetres."""
    depth_is: str | None = None
    r"""Meaning of --depth: distance (along the optical axis), inverse (1 / distance) or ray
    (distance along each pixel's ray). \[default: distance; ray of a panorama]"""
    nearer: str = "fast"
    """Surface in front if --flow comes without --depth: fast (what moves faster) or none."""
    camera: Annotated[str | None, typer.Option(metavar="FX,FY,CX,CY")] = None
    """Intrinsics in pixels; the first pixel's centre is at 0, 0."""
    pose: Annotated[str | None, typer.Option(metavar="POSE")] = None
    r"""Pose of the picture, world from camera: 'tx ty tz qx qy qz qw', 16 numbers of a matrix, or
    FILE:LINE. \[default: the world's origin]"""
    target_pose: Annotated[str | None, typer.Option(metavar="POSE")] = None
    """Pose of the new view."""
    parallax: Annotated[float | None, typer.Option(metavar="SHARE")] = None
    r"""With --depth alone: move the camera to the right until near surfaces move by this share of
    the width; negative: to the left. \[default: 0.03]"""
    unknown: tuple[float, ...] | None = None  # no option here: given once for both kinds


@dataclass(frozen=True)
class PairOptions:
    """Options of a stereo pair; see `stimuli.scenes.stereo.load_pair`."""

    panel: ClassVar = "Stereo pair"

    disparity: Path | None = None
    """Disparity of the left image: .png, .pgm, .pfm, .exr, .npy or .npz; unknown is 0 in integers,
    not finite in floats."""
    right: Path | None = None
    """Right image. Fills are measured against it."""
    units_per_px: float = 1.0
    """Stored value of 1 px of disparity."""
    focal_px: float | None = None
    """Focal length. Without it, depths are right in ratio only."""
    baseline_m: float = 0.1
    """Distance of the cameras."""
    offset_px: float = 0.0
    """Offset of the principal points (doffs), added to the disparity for depth."""
    amount: float = 1.0
    """Share of the way to move: 1 is the right camera, 0.5 half way."""
    to_left: bool = False
    """Warp from the right camera to the left: SOURCE and --disparity are the right image's, --right
    is the left image."""
    unknown: tuple[float, ...] | None = None  # no option here: given once for both kinds


@dataclass(frozen=True)
class PanoramaOptions:
    """Options of a panorama with distance; see `pipeline.methods.moved_panorama`."""

    panel: ClassVar = "Panorama with distance"

    panorama: bool = False
    """SOURCE is equirectangular and has distances: an .exr file, a picture with --depth, or
    builtin:SCENE, whose true view is known."""
    move: Annotated[str | None, typer.Option(metavar="X,Y,Z")] = None
    r"""Move of the eye in metres: right, down, and to the panorama's middle. \[default: 0,0,0]"""
    look: Annotated[str | None, typer.Option(metavar="RIGHT,DOWN")] = None
    r"""Direction of the new view in degrees, from the panorama's middle. \[default: 0,0]"""
    view_deg: float | None = None
    r"""Visual angle of the new view, which is square. \[default: 90]"""
    around: Path | None = None
    """Write the whole panorama from the moved eye too, filled by the first method, .png or .exr, as
    a headset shows it."""


@dataclass(frozen=True)
class SourceOptions:
    """Statements on SOURCE, of whatever kind it is."""

    file: FileOptions
    picture: PictureOptions
    panorama: PanoramaOptions
    unknown: Annotated[list[str] | None, typer.Option(metavar="NUMBER")] = None
    """A number in --depth or --disparity that stands for unknown, as it is stored; may be repeated.
    none: no further number does."""
    mask: Path | None = None
    """A picture as large as SOURCE that is white where SOURCE is to be filled, and black elsewhere.
    SOURCE is not warped, and needs no depth."""
    truth: Path | None = None
    """The true new view. Fills are measured against it."""
    pair: PairOptions = PairOptions()

    @property
    def files(self) -> list[Path | None]:
        """Files that are read besides SOURCE."""
        pair, picture = self.pair, self.picture
        return [pair.disparity, pair.right, picture.flow, picture.depth, self.truth, self.mask]

    def with_unknown(self) -> SourceOptions:
        """Return these with the numbers that stand for unknown where the file is that holds them.

        Raises
        ------
        StudyError
            If one is no number.
        """
        numbers = unknown_numbers(self.unknown)
        if self.picture.depth is None:
            return replace(self, pair=replace(self.pair, unknown=numbers))
        return replace(self, picture=replace(self.picture, unknown=numbers))


@dataclass(frozen=True)
class HoleOptions:
    """Treatment of silhouettes and depth by the warp."""

    rim_px: int | None = None
    r"""Number of background pixels along a hole, 0 to 4, that are hole too. A photograph's pixels
    at a silhouette mix both sides, and would leave a ghost of the outline. Give 0 to a pair
    rendered without anti-aliasing, 1 to a file with anti-aliased edges, more to pictures that are
    blurred or enlarged. \[default: 1 for a stereo pair, 0 for a file]"""
    depth_speckle: Annotated[bool | None, typer.Option("--depth-speckle/--no-depth-speckle")] = None
    r"""Mend depth before the warp: outliers and silhouettes follow what is around them and of their
    colour. Give --no-depth-speckle to rendered depth, --depth-speckle to a file with measured
    depth. \[default: mend for a stereo pair, leave a file]"""


@dataclass(frozen=True)
class WarpFigureOptions:
    """Pictures that are made to be looked at."""

    panel: ClassVar = LOOK

    steps: Path | None = None
    """Folder for pictures of every intermediate: masks, depth, bands, moments, noise."""
    compare: Path | None = None
    """One labelled sheet with the fills side by side: those of --methods, or of all methods. With
    --true-within also crops of fovea and periphery."""


@dataclass(frozen=True)
class EyeOptions:
    """Options of the true view around the gaze."""

    panel: ClassVar = "True view around the gaze"

    true_within: Annotated[float | None, typer.Option(metavar="DEG")] = None
    """Show the true view this far around the gaze, as a foveated display does whose periphery is
    filled up by warping. Fills are measured outside."""
    coarser: Annotated[int, typer.Option(min=1, max=64, metavar="PX")] = 1
    """Average what lies around the true view to blocks of so many pixels an edge."""
    condition: Annotated[str, typer.Option(metavar="NAME")] = "reference"
    """Show it by this condition of 'metamerlab foveate --list'."""
    gaze: GazeOption = None
    display: ShownOption = None
    fov: FovOption = None
