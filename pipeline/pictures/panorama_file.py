"""Panoramas with distance as files: one OpenEXR file, or a picture and its distances.

This project writes ``R`` ``G`` ``B`` and ``Z`` and says in the header that ``Z`` is the distance
along each pixel's ray, as programs do that render panoramas: there is no axis to measure along.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.frame import Bools, PanoramaFrame, check_file_size
from pipeline.pictures.channels import Channels
from pipeline.pictures.colour_file import TRANSFER, Transfer, linear_light, load_colour
from pipeline.pictures.depth_and_flow import DEPTH_UNIT, DepthIs, Unknown, load_depth
from pipeline.pictures.header import check_fits
from pipeline.pictures.warp_input import read_colour_and_depth
from pipeline.pictures.write import write_pixels

DEPTH_IS_ATTRIBUTE = "metamerlab:depth_is"


def save_panorama(path: Path, frame: PanoramaFrame) -> None:
    """Write colour and distance into one OpenEXR file, as `load_panorama` reads it.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    planes = np.dstack([linear_light(frame.colour), frame.distance_m]).astype(np.float32)
    said = {TRANSFER: Transfer.LINEAR.value, DEPTH_UNIT: "m", DEPTH_IS_ATTRIBUTE: "ray"}
    write_pixels(path, planes, ["R", "G", "B", "Z"], attributes=said | {"compression": "zip"})


def load_panorama(
    picture: Path,
    depth: Path | None = None,
    *,
    depth_scale: float = 1.0,
    depth_is: str = "ray",
    unknown: Unknown = None,
    channels: Channels | None = None,
    transfer: Transfer | None = None,
    clip: bool = False,
) -> PanoramaFrame:
    """Read a panorama with distance.

    Parameters
    ----------
    picture : Path
        With `depth` any picture; without it OpenEXR with colour and distance.
    depth_scale, unknown
        As `load_depth` has them, for `depth`.
    depth_is : {"ray", "inverse"}
        Distance along the pixel's ray, or 1 / distance.
    channels, transfer, clip
        As `load_warp_input` has them.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    InputError
        If a file is not what it must be, is not 2:1, or has its depth along an axis.
    """
    if depth is None and picture.suffix.lower() != ".exr":
        raise InputError(
            f"{picture}: a panorama needs the distance of every pixel; give a file of it with"
            " --depth (depth in a study), or OpenEXR with colour and distance, such as 'metamerlab"
            " stimuli panorama SCENE --depth --out FILE.exr' writes"
        )
    check_fits(picture, "warp")
    measured: Bools | None = None
    if depth is None:
        file, _, seen = read_colour_and_depth(picture, channels or Channels(), transfer, clip)
        depth_is = str(file.attributes.get(DEPTH_IS_ATTRIBUTE, depth_is))
        colour, distance_m = seen.colour, seen.depth_m
    else:
        colour = load_colour(picture, channels=channels, transfer=transfer, clip=clip)
        is_a: DepthIs = "inverse" if depth_is == "inverse" else "distance"  # as it is stored
        distance_m, measured = load_depth(depth, depth_scale, is_a=is_a, unknown=unknown)
        check_file_size(depth, distance_m, picture, colour)
    if depth_is not in (("ray",) if depth is None else ("ray", "inverse")):
        raise InputError(
            f"{depth or picture}: a panorama's depth must be the distance along each pixel's own"
            f" ray (ray), or in a file of its own 1 / distance (inverse) (got {depth_is!r}): it"
            " looks in all directions, so no axis is there to measure along"
        )
    try:
        return PanoramaFrame(colour, distance_m, measured)
    except InputError as error:
        raise InputError(f"{picture}: {error}") from None
