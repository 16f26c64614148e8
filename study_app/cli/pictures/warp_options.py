"""The options of `metamerlab warp`: of a file, a picture with motion or depth, or a stereo pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from study_app.cli.options import unknown_numbers
from study_app.cli.pictures.one_picture_options import (
    DisplayOption,
    FovOption,
    GazeOption,
    look_option,
    panel_option,
)

_file_option = panel_option("File of colour, depth and flow")
_picture_option = panel_option("Picture with motion or depth")
_stereo_option = panel_option("Stereo pair")
_gaze_option = panel_option("True view around the gaze")


@dataclass(frozen=True)
class FileOptions:
    """Options of a file of colour, depth and flow."""

    clip: Annotated[
        bool,
        _file_option(
            "--clip", help="Clip light brighter than the display can show instead of refusing it."
        ),
    ] = False
    encoded: Annotated[
        bool,
        _file_option(
            "--encoded", help="The file's colour is display-referred already, not scene-linear."
        ),
    ] = False
    channels: Annotated[
        list[str] | None,
        _file_option(
            "--channel",
            metavar="WHAT=NAME",
            help="Name of a channel that is not R, G, B, Z, flow.x, flow.y or target.Z. WHAT is"
            " red, green, blue, depth, flow_x, flow_y or target_depth.",
        ),
    ] = None


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture with motion or depth; see `stimuli.one_picture`."""

    flow: Annotated[
        Path | None,
        _picture_option(help="Motion of each pixel: a Middlebury file (.flo)."),
    ] = None
    depth: Annotated[
        Path | None,
        _picture_option(
            help="Depth along the optical axis: .png, .tif, .pgm, .pfm, .exr, .npy or .npz; unknown"
            " is 0 in integers, not a number in floats. Given alone, the camera moves sideways."
            " Also useful with --flow."
        ),
    ] = None
    depth_scale: Annotated[
        float,
        _picture_option(help="Metres per unit of --depth: 0.001 for millimetres."),
    ] = 1.0
    depth_is: Annotated[
        str,
        _picture_option(
            help="Meaning of --depth: distance (along the optical axis), inverse (1 / distance) or"
            " ray (distance along each pixel's ray)."
        ),
    ] = "distance"
    nearer: Annotated[
        str,
        _picture_option(
            help="Surface in front if --flow comes without --depth: fast (what moves"
            " faster) or none."
        ),
    ] = "fast"
    camera: Annotated[
        str | None,
        _picture_option(
            metavar="FX,FY,CX,CY", help="Intrinsics in pixels; the first pixel's centre is at 0, 0."
        ),
    ] = None
    pose: Annotated[
        str | None,
        _picture_option(
            metavar="POSE",
            help="Pose of the picture, world from camera: 'tx ty tz qx qy qz qw', 16 numbers of a"
            r" matrix, or FILE:LINE. \[default: the world's origin]",
        ),
    ] = None
    target_pose: Annotated[
        str | None,
        _picture_option(metavar="POSE", help="Pose of the new view."),
    ] = None
    parallax: Annotated[
        float | None,
        _picture_option(
            metavar="SHARE",
            help="With --depth alone: move the camera to the right until near surfaces move by"
            r" this share of the width; negative: to the left. \[default: 0.03]",
        ),
    ] = None
    unknown: tuple[float, ...] | None = None
    """Numbers that stand for unknown; given once for both kinds."""


@dataclass(frozen=True)
class PairOptions:
    """Options of a stereo pair; see `stimuli.scenes.stereo.load_pair`."""

    disparity: Annotated[
        Path | None,
        _stereo_option(
            help="Disparity of the left image: .png, .pgm, .pfm, .exr, .npy or .npz; unknown is 0"
            " in integers, not finite in floats."
        ),
    ] = None
    right: Annotated[
        Path | None,
        _stereo_option(help="Right image. Fills are measured against it."),
    ] = None
    units_per_px: Annotated[
        float,
        _stereo_option(help="Stored value of 1 px of disparity."),
    ] = 1.0
    focal_px: Annotated[
        float | None,
        _stereo_option(help="Focal length. Without it, depths are right in ratio only."),
    ] = None
    baseline_m: Annotated[float, _stereo_option(help="Distance of the cameras.")] = 0.1
    offset_px: Annotated[
        float,
        _stereo_option(
            help="Offset of the principal points (doffs), added to the disparity for depth."
        ),
    ] = 0.0
    amount: Annotated[
        float,
        _stereo_option(help="Share of the way to move: 1 is the right camera, 0.5 half way."),
    ] = 1.0
    to_left: Annotated[
        bool,
        _stereo_option(
            "--to-left",
            help="From the right camera to the left: SOURCE and --disparity are the right image's,"
            " --right is the left image.",
        ),
    ] = False
    unknown: tuple[float, ...] | None = None
    """Numbers that stand for unknown; given once for both kinds."""


@dataclass(frozen=True)
class SourceOptions:
    """Statements on SOURCE, of whatever kind it is."""

    file: FileOptions
    picture: PictureOptions
    unknown: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NUMBER",
            help="A number in --depth or --disparity that stands for unknown, as it is stored; may"
            " be repeated. none: no further number does.",
        ),
    ] = None
    mask: Annotated[
        Path | None,
        typer.Option(
            help="A picture as large as SOURCE that is white where SOURCE is to be filled, and"
            " black elsewhere. SOURCE is not warped, and needs no depth."
        ),
    ] = None
    truth: Annotated[
        Path | None,
        typer.Option(help="The true new view. Fills are measured against it."),
    ] = None
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

    rim_px: Annotated[
        int | None,
        typer.Option(
            help="Number of background pixels along a hole, 0 to 4, that are hole too. A"
            " photograph's pixels at a silhouette mix both sides, and would leave a ghost of the"
            " outline. Give 0 to a pair rendered without anti-aliasing, 1 to a file with"
            " anti-aliased edges, more to pictures that are blurred or enlarged."
            r" \[default: 1 for a stereo pair, 0 for a file]"
        ),
    ] = None
    depth_speckle: Annotated[
        bool | None,
        typer.Option(
            "--depth-speckle/--no-depth-speckle",
            help="Mend outliers of depth before the warp: pixels that nothing around them bears"
            " out. Give --no-depth-speckle to rendered depth, --depth-speckle to a file with"
            r" measured depth. \[default: mend for a stereo pair, leave a file]",
        ),
    ] = None


@dataclass(frozen=True)
class WarpFigureOptions:
    """Pictures that are made to be looked at."""

    steps: Annotated[
        Path | None,
        look_option(
            help="Folder for pictures of every intermediate: masks, depth, bands, moments, noise."
        ),
    ] = None
    compare: Annotated[
        Path | None,
        look_option(
            help="One labelled sheet with the fills side by side: those of --methods, or of all"
            " methods. With --true-within also crops of fovea and periphery.",
        ),
    ] = None


@dataclass(frozen=True)
class EyeOptions:
    """Options of the true view around the gaze."""

    true_within: Annotated[
        float | None,
        _gaze_option(
            metavar="DEG",
            help="Show the true view this far around the gaze, as a foveated display does whose"
            " periphery is filled up by warping. Fills are measured outside.",
        ),
    ] = None
    gaze: GazeOption = None
    display: DisplayOption = None
    fov: FovOption = None
