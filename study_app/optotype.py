"""A Landolt ring as an image: drawn by its geometry, smooth at the edge of pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from protocols.display import Display
from protocols.phases import Optotype
from protocols.viewing import Viewing

_FINER = 8
"""Samples per pixel edge."""


def landolt_ring(ring: Optotype, display: Display) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """Draw a ring for one display.

    Parameters
    ----------
    ring : Optotype
        Stroke and gap are a fifth of its height (ISO 8596); the gap has parallel sides.
    display : Display
        Pixels and distance.

    Returns
    -------
    image : ndarray of uint8, shape (height, width, 4)
        RGBA; alpha is the share of each pixel that the ring covers.
    place : (int, int)
        Upper left corner, pixels from the upper left corner of the screen.
    """
    viewing = Viewing.of(display)
    x_px, y_px = viewing.to_px(ring.x_deg, ring.y_deg)
    _, top = viewing.to_px(ring.x_deg, ring.y_deg - ring.height_deg / 2)
    _, bottom = viewing.to_px(ring.x_deg, ring.y_deg + ring.height_deg / 2)
    height = bottom - top
    reach = math.ceil(height / 2) + 1
    place = math.floor(x_px) - reach, math.floor(y_px) - reach
    samples = (np.arange(2 * reach * _FINER) + 0.5) / _FINER
    x = samples[None, :] + place[0] - x_px
    y = -(samples[:, None] + place[1] - y_px)  # up, as angles count
    radius = np.hypot(x, y)
    inked = (radius <= height / 2) & (radius >= 0.3 * height)
    if ring.gap_deg is not None:
        angle = math.radians(ring.gap_deg)
        along = x * math.cos(angle) + y * math.sin(angle)
        across = -x * math.sin(angle) + y * math.cos(angle)
        inked &= ~((along > 0) & (np.abs(across) <= 0.1 * height))
    edge = 2 * reach
    covered = inked.reshape(edge, _FINER, edge, _FINER).mean(axis=(1, 3))
    image = np.empty((edge, edge, 4), np.uint8)
    image[..., :3] = round(255 * ring.grey)
    image[..., 3] = np.rint(255 * covered)
    return image, place
