"""Middlebury's files of optical flow (`.flo`).

Four bytes that read "PIEH" (the float 202021.25), width and height as 32-bit integers, then two
floats for each pixel, row by row: target minus source position, x to the right, y down, pixels. All
little-endian. A component beyond 1e9 means that the motion is unknown (Baker et al. 2011, "A
Database and Evaluation Methodology for Optical Flow").
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.picture_limits import check_values
from stimuli.media.plane_file import check_byte_order

MAGIC = np.float32(202021.25)
UNKNOWN_PX = 1e9
HEADER_BYTES = 12


def read_flo(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Read a file of flow.

    Returns
    -------
    flow_px : ndarray of float32, shape (H, W, 2)
        As stored; 0 where it is unknown.
    known : ndarray of bool, shape (H, W)

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole file of flow, its numbers have the other byte order, or no motion is
        known.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        data = file.read(HEADER_BYTES)
    if len(data) < HEADER_BYTES or np.frombuffer(data, "<f4", 1)[0] != MAGIC:
        raise InputError(f"{path}: must be a Middlebury flow file (it does not begin with PIEH)")
    width, height = (int(edge) for edge in np.frombuffer(data, "<i4", 2, offset=4))
    wanted = HEADER_BYTES + 8 * width * height
    if width < 1 or height < 1 or size != wanted:
        raise InputError(
            f"{path}: must hold {width}x{height} px of motion in {wanted} bytes"
            f" (has {size}); is it cut off?"
        )
    check_values(path, width, height, 2)
    flow = np.fromfile(path, "<f4", offset=HEADER_BYTES).reshape(height, width, 2)
    check_byte_order(path, flow)
    with np.errstate(invalid="ignore"):
        known = (np.abs(flow) <= UNKNOWN_PX).all(axis=-1)
    if not known.any():
        raise InputError(f"{path}: must know the motion of at least one pixel (knows none)")
    return np.where(known[..., None], flow, 0).astype(np.float32), known
