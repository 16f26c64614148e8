"""A Landolt ring as an image: drawn by its geometry, smooth at the edge of pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from protocols.script import Ring

_FINER = 8
"""Samples per pixel edge."""


def ring_image(ring: Ring) -> NDArray[np.uint8]:
    """Draw a ring.

    Parameters
    ----------
    ring : Ring
        Stroke and gap are a fifth of its height (ISO 8596); the gap has parallel sides.

    Returns
    -------
    ndarray of uint8, shape (edge_px, edge_px, 4)
        RGBA; alpha is the share of each pixel that the ring covers.
    """
    edge, height = ring.edge_px, ring.height_px
    samples = (np.arange(edge * _FINER) + 0.5) / _FINER
    x = samples[None, :] - ring.middle_px[0]
    y = -(samples[:, None] - ring.middle_px[1])  # up, as angles count
    radius = np.hypot(x, y)
    inked = (radius <= height / 2) & (radius >= 0.3 * height)
    if ring.gap_deg is not None:
        angle = math.radians(ring.gap_deg)
        along = x * math.cos(angle) + y * math.sin(angle)
        across = -x * math.sin(angle) + y * math.cos(angle)
        inked &= ~((along > 0) & (np.abs(across) <= 0.1 * height))
    covered = inked.reshape(edge, _FINER, edge, _FINER).mean(axis=(1, 3))
    image = np.empty((edge, edge, 4), np.uint8)
    image[..., :3] = ring.grey
    image[..., 3] = np.rint(255 * covered)
    return image
