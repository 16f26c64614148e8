"""Input of a warp: one OpenEXR file, or one picture with its motion, or its depth and two poses.

RGBZ + flow in one OpenEXR file, of one part or several: this project writes ``R`` ``G`` ``B``,
``Z``, ``flow.x``, ``flow.y`` and, where the camera moves along its axis, ``target.Z``;
`pipeline.pictures.channels` says what each means and which other programs' names are known, and
`Channels` tells further ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from pipeline.camera import Camera, flow_between
from pipeline.errors import InputError
from pipeline.frame import (
    NO_DEPTH,
    Bools,
    Floats,
    SourceFrame,
    TargetWindow,
    check_depth,
    check_file_size,
    check_flow,
)
from pipeline.pictures.channels import (
    Channels,
    Layer,
    channel_value,
    depth_layer,
    light_of,
    naming_options,
    need,
    need_motion,
    told_name,
)
from pipeline.pictures.colour_file import (
    TRANSFER,
    Transfer,
    encoded_light,
    linear_light,
    load_colour,
    stored_transfer,
)
from pipeline.pictures.decode import ExrParts, read_parts
from pipeline.pictures.depth_and_flow import (
    DEPTH_UNIT,
    DepthIs,
    Unknown,
    centred,
    check_depth_unit,
    load_depth,
    read_flow,
)
from pipeline.pictures.write import write_pixels
from protocols.disk.whole_file import decoded_text
from protocols.errors import must_be_one_of
from protocols.outside import bounded_bytes, reading


@dataclass(frozen=True)
class WarpInput:
    """Input of a warp: a source frame, and where each of its pixels goes.

    Parameters
    ----------
    source : SourceFrame
    flow_px : ndarray of float32, shape (H, W, 2)
        Target minus source position, x then y.
    target_depth_m : ndarray of float32, shape (H, W), optional
        Depth of the source's pixels as the target camera sees them.
    window : TargetWindow, optional
        What the target view shows, in the source's pixel grid; all of it by default.
    """

    source: SourceFrame
    flow_px: NDArray[np.float32]
    target_depth_m: NDArray[np.float32] | None = None
    window: TargetWindow | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of the target view, pixels."""
        window = self.window or TargetWindow.of(self.source.size)
        return window.height_px, window.width_px


def load_warp_input(
    path: Path,
    *,
    channels: Channels | None = None,
    transfer: Transfer | None = None,
    clip: bool = False,
) -> WarpInput:
    """Read RGBZ and flow from one OpenEXR file; `pipeline.pictures.channels` lists the channels.

    Where the file's motion leads to the previous frame, as Unreal's does, so does the flow.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, a channel is missing, the depth's unit is not metres,
        or a value breaks the rules of `pipeline.frame`: NaN colour, depth at or below 0,
        flow that is not finite.
    """
    told = channels or Channels()
    file, layer, source = read_colour_and_depth(path, told, transfer, clip)
    planes = file.planes
    told_motion = (told_name(planes, told.flow_x), told_name(planes, told.flow_y))
    cure = naming_options("motion_x", "motion_y")
    flow_px = need_motion(path, planes, told_motion, layer=layer, cure=cure).flow_px
    check_flow(flow_px, f"{path}: flow")
    target_m = channel_value(path, planes, "target_depth", told_name(planes, told.target_depth))
    if target_m is not None:
        check_depth(target_m, f"{path}: depth", cure=NO_DEPTH)
    return WarpInput(source, flow_px, target_m)


def read_colour_and_depth(
    path: Path, told: Channels, transfer: Transfer | None, clip: bool
) -> tuple[ExrParts, Layer | None, SourceFrame]:
    """Read one OpenEXR file's colour and depth, its parts, and the layer that the depth is of."""
    file = read_parts(path, encoded=transfer is Transfer.ENCODED)
    planes = file.planes
    layer = depth_layer(path, planes, told_name(planes, told.depth))
    colour = light_of(path, planes, told, layer)
    stored = stored_transfer(path, file.attributes)
    colour = encoded_light(path, colour, transfer or stored, clip)
    check_depth_unit(path, file.attributes)
    depth_m = need(
        path, planes, "depth", told_name(planes, told.depth), cure=naming_options("depth")
    )
    check_depth(depth_m, f"{path}: depth", cure=NO_DEPTH)
    return file, layer, SourceFrame(colour, depth_m)


def save_warp_input(path: Path, frame: WarpInput) -> None:
    """Write RGBZ and flow into one OpenEXR file of 32-bit floats, as `load_warp_input` reads it.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    planes = [linear_light(frame.source.colour), frame.source.depth_m[..., None], frame.flow_px]
    names = ["R", "G", "B", "Z", "flow.x", "flow.y"]
    if frame.target_depth_m is not None:
        planes.append(frame.target_depth_m[..., None])
        names.append("target.Z")
    write_pixels(
        path,
        np.concatenate(planes, axis=-1).astype(np.float32),
        names,
        attributes={
            TRANSFER: Transfer.LINEAR.value,
            DEPTH_UNIT: "m",
            "metamerlab:flow": "target minus source position, x right, y down, pixels",
            "compression": "zip",
        },
    )


Nearer = Literal["fast", "none"]
NEARER: Final[tuple[Nearer, ...]] = get_args(Nearer)
LEAST_NEARNESS = 1e-3  # of the fastest pixel's; so far away is what stands still


def from_flow(
    picture: Path,
    flow: Path,
    depth: Path | None = None,
    *,
    depth_scale: float = 1.0,
    depth_is: DepthIs = "distance",
    unknown: Unknown = None,
    nearer: Nearer = "fast",
) -> WarpInput:
    """Read a picture and its motion (see `read_flow`) into the next one.

    Parameters
    ----------
    depth : Path, optional
        Depth of the picture, see `load_depth`.
    depth_scale, depth_is, unknown
        As `load_depth` has them.
    nearer : {"fast", "none"}
        What stands in front where there is no depth: what moves faster, as seen from a moving
        camera, or nothing, so that all is equally far. Depths are in no unit then.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    InputError
        If a file is not what it must be, or sizes differ.

    Notes
    -----
    A pixel of unknown motion takes that of the nearest known one.
    """
    if nearer not in NEARER:
        raise InputError(must_be_one_of("nearer", nearer, NEARER))
    colour = load_colour(picture)
    flow_px, known = read_flow(flow)
    check_file_size(flow, flow_px, picture, colour)
    if not known.all():
        closest = ndimage.distance_transform_edt(
            ~known, return_distances=False, return_indices=True
        )
        flow_px = np.ascontiguousarray(flow_px[tuple(closest)])
    measured: Bools | None = None
    if depth is not None:
        depth_m, measured = load_depth(depth, depth_scale, is_a=depth_is, unknown=unknown)
        check_file_size(depth, depth_m, picture, colour)
    else:
        speed = np.linalg.norm(flow_px.astype(np.float64), axis=-1) * (nearer == "fast")
        nearness = speed / speed.max() if speed.max() > 0 else np.ones(known.shape)
        depth_m = (1 / np.maximum(nearness, LEAST_NEARNESS)).astype(np.float32)
    return WarpInput(SourceFrame(colour, depth_m, measured), flow_px)


def from_depth(
    picture: Path,
    depth: Path,
    *,
    intrinsics_px: tuple[float, float, float, float],
    pose: Floats,
    target_pose: Floats,
    depth_scale: float = 1.0,
    depth_is: DepthIs = "distance",
    unknown: Unknown = None,
) -> WarpInput:
    """Read a picture with depth, and move it from one pose to another.

    Parameters
    ----------
    intrinsics_px : (fx, fy, cx, cy)
        Of both cameras; the centre of the left top pixel is at (0, 0), as RGB-D data sets have it.
    pose, target_pose : ndarray of float64, shape (4, 4)
        World from camera, metres; see `read_pose`.
    depth_scale, depth_is, unknown
        As `load_depth` has them.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    InputError
        If a file is not what it must be, sizes differ, or a camera is not possible.
    """
    colour = load_colour(picture)
    depth_m, measured = load_depth(
        depth, depth_scale, is_a=depth_is, unknown=unknown, intrinsics_px=intrinsics_px
    )
    check_file_size(depth, depth_m, picture, colour)
    return _moved(SourceFrame(colour, depth_m, measured), intrinsics_px, pose, target_pose)


def from_the_side(
    picture: Path,
    depth: Path,
    parallax_share: float,
    *,
    depth_scale: float = 1.0,
    depth_is: DepthIs = "distance",
    unknown: Unknown = None,
) -> WarpInput:
    """Read a picture with depth, and move its camera to the right by what a parallax asks for.

    The focal length is taken to be the picture's width, a field of view of 53 degrees; depths need
    to be right in ratio only.

    Parameters
    ----------
    parallax_share : float
        How far what is near (the depth that a twentieth of the picture is nearer than) moves to the
        left, in widths of the picture; negative: to the right.
    depth_scale, depth_is, unknown
        As `load_depth` has them.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    InputError
        If a file is not what it must be, sizes differ, nothing has a depth, or the parallax is 0 or
        wider than the picture.
    """
    if not 0 < abs(parallax_share) < 1:
        raise InputError(
            f"the parallax must lie between -1 and 1 widths and not be 0 (got {parallax_share:g})"
        )
    colour = load_colour(picture)
    depth_m, measured = load_depth(depth, depth_scale, is_a=depth_is, unknown=unknown)
    check_file_size(depth, depth_m, picture, colour)
    near = depth_m[np.isfinite(depth_m)]
    if not near.size:
        raise InputError(f"{depth}: some depth must be finite (none is)")
    target = np.eye(4)
    target[0, 3] = parallax_share * float(np.percentile(near, 5))
    height, width = depth_m.shape
    return _moved(
        SourceFrame(colour, depth_m, measured), centred(width, width, height), np.eye(4), target
    )


def _moved(
    source: SourceFrame,
    intrinsics_px: tuple[float, float, float, float],
    pose: Floats,
    target_pose: Floats,
) -> WarpInput:
    flow_px, target_depth_m = motion_between(source.depth_m, intrinsics_px, pose, target_pose)
    return WarpInput(source, flow_px, target_depth_m)


def motion_between(
    depth_m: NDArray[np.float32],
    intrinsics_px: tuple[float, float, float, float],
    pose: Floats,
    target_pose: Floats,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return flow and target depth between two poses; see `from_depth` and `flow_between`."""
    height, width = depth_m.shape
    fx_px, fy_px, cx_px, cy_px = intrinsics_px
    cameras = [
        # Our first pixel's centre is at (0.5, 0.5).
        Camera(width, height, fx_px, fy_px, cx_px + 0.5, cy_px + 0.5, matrix)
        for matrix in (pose, target_pose)
    ]
    return flow_between(cameras[0], cameras[1], depth_m)


def read_pose(text: str) -> Floats:
    """Read where a camera is: world from camera, metres, x right, y down, z forward.

    Parameters
    ----------
    text : str
        ``tx ty tz qx qy qz qw``; the same after a time stamp, as the TUM data sets have it; the 16
        numbers of a 4x4 matrix, row by row; or ``FILE:LINE``, where line 1 is the first that
        is neither empty nor begins with ``#``. Numbers are parted by blanks or commas, or by
        semicolons, and have decimal commas then.

    Raises
    ------
    FileNotFoundError
        If the file is missing.
    InputError
        If it is none of these.
    """
    name, colon, line = text.rpartition(":")
    if colon and line.isdigit():
        with reading(Path(name), "a file of poses", InputError):
            data = bounded_bytes(Path(name), InputError, "table")
            lines = decoded_text(data, []).splitlines()
        rows = [row for row in lines if row.strip() and not row.lstrip().startswith("#")]
        if not 1 <= int(line) <= len(rows):
            raise InputError(f"{name}: must have a pose in line {line} (has {len(rows)} lines)")
        return _pose(rows[int(line) - 1], text)
    return _pose(text, "pose")


def _pose(row: str, where: str) -> Floats:
    try:
        plain = row.replace(",", ".").replace(";", " ") if ";" in row else row.replace(",", " ")
        numbers = np.array([float(part) for part in plain.split()])
    except ValueError:
        numbers = np.empty(0)
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: must hold finite numbers (got {row!r})")
    if len(numbers) == 16:
        return numbers.reshape(4, 4)
    if len(numbers) not in (7, 8):
        raise InputError(
            f"{where}: must be tx ty tz qx qy qz qw, the same after a time stamp, 16 numbers of a"
            f" matrix, or FILE:LINE (got {row!r})"
        )
    turned = numbers[-4:]
    if not abs(np.linalg.norm(turned) - 1) < 0.01:
        raise InputError(
            f"{where}: qx qy qz qw must be a quaternion of length 1"
            f" (its length is {np.linalg.norm(turned):.4g})"
        )
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(turned).as_matrix()
    matrix[:3, 3] = numbers[-7:-4]
    return matrix
