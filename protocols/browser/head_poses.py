"""Poses of a participant's head, as a headset's page sends them home, one for each flip.

A pose is the head's unit quaternion x, y, z, w in the room of WebXR (x to the right, y up, z to the
back), times 32767, in whole numbers of 16 bits. All 0: the head was not tracked. The head's pose is
not fixation: eyes move in a head that is still.
"""

from __future__ import annotations

import base64
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Poses: TypeAlias = NDArray[np.int16]
"""A row for each flip: x, y, z, w."""
WHOLE = 32767


def poses_of(quaternions: NDArray[np.float64]) -> Poses:
    """Return unit quaternions, shape (flips, 4), as poses."""
    return np.floor(WHOLE * quaternions + 0.5).astype(np.int16)


def encoded_poses(poses: Poses) -> str:
    """Return poses as a line has them: Base64 of their bytes, the lower one first."""
    return base64.b64encode(poses.astype("<i2").tobytes()).decode("ascii")


def decoded_poses(text: str) -> Poses:
    """Return the poses of a line.

    Raises
    ------
    ValueError
        If it is no Base64 of whole poses.
    """
    data = base64.b64decode(text, validate=True)
    return np.frombuffer(data, "<i2").reshape(-1, 4).astype(np.int16)


def turned_away(poses: Poses, most_deg: float) -> NDArray[np.bool_]:
    """Return for each flip whether the head points farther from straight ahead than an angle.

    A turn by an angle has x^2 + y^2 = sin^2(angle / 2), and rolling the head changes nothing of it.
    """
    x, y = poses[:, 0].astype(np.int64), poses[:, 1].astype(np.int64)
    most = (WHOLE * math.sin(math.pi * most_deg / 360)) ** 2
    away: NDArray[np.bool_] = x * x + y * y > most
    return away


def turns_deg(poses: Poses) -> NDArray[np.float64]:
    """Return the angle of the head from straight ahead at each flip; NaN: not tracked."""
    unit = poses / WHOLE
    angle = 2 * np.degrees(np.arcsin(np.minimum(np.hypot(unit[:, 0], unit[:, 1]), 1)))
    return np.where(poses.any(axis=1), angle, np.nan)
