"""Files of numbers a pixel, read as they are stored and written as programs write them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.pictures.depth_and_flow import MAGIC, _read


def load_plane(path: Path) -> tuple[NDArray[Any], bool]:
    """Read the numbers (H, W) as stored; also return whether they are integers."""
    plane, _ = _read(path)
    return plane, plane.dtype.kind in "iu"


def write_flo(path: Path, flow_px: NDArray[np.float32]) -> None:
    """Write `flow_px`, float32 of shape (H, W, 2), as Middlebury does."""
    height, width, _ = flow_px.shape
    header = MAGIC.astype("<f4").tobytes() + np.array([width, height], "<i4").tobytes()
    path.write_bytes(header + np.ascontiguousarray(flow_px, "<f4").tobytes())
