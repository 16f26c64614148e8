"""Fills of a shifted picture: what stays when picture and holes lie elsewhere in the frame.

A pyramid halves pixels counted from the frame's corner. Its cells are the only grid in the
definitions, so a shift by whole cells shifts the fill; what other shifts change is stated here and
in docs/method.md.
"""

import numpy as np
import pytest
from scipy import ndimage

from pipeline.frame import WarpedFrame
from pipeline.methods.registry import create_method

HEIGHT, WIDTH = 192, 256  # px, of the frame, which shows a part of the picture
HERE = (0, 128)
STEP = 1 / 255


def disc(column, row, radius_px):
    y, x = np.mgrid[:264, :392]
    return (x - column) ** 2 + (y - row) ** 2 < radius_px**2


@pytest.fixture(scope="module")
def fill(module_gl_context):
    """Give a function that fills one picture, seen at a corner, and returns the hole's pixels.

    A red disc that moved by 12 px uncovers a crescent of smooth noise. Motion is counted
    from the picture, so that it is the view that shifts.
    """
    texture = ndimage.gaussian_filter(
        np.random.default_rng(0).standard_normal((264, 392, 3)), (1.5, 1.5, 0)
    )
    texture = 0.5 + 0.12 * texture / texture.std()
    near = disc(188, 130, 22)
    hole = disc(200, 130, 22) & ~near
    colour = np.where(near[..., None], (0.8, 0.1, 0.1), texture).clip(0, 1)
    colour[hole] = 0
    methods = {}

    def at(name, corner):
        if name not in methods:
            methods[name] = create_method(name, module_gl_context)
        down, right = corner
        window = np.s_[down : down + HEIGHT, right : right + WIDTH]
        flow_px = np.where(near[window][..., None], (-12.0, 0.0), 0.0) - (right, down)
        depth_m = np.where(near[window], 2.0, 5.0)
        frame = WarpedFrame(
            np.float32(colour[window]), np.float32(depth_m), hole[window], np.float32(flow_px)
        )
        return methods[name].fill(frame, 1)[hole[window]] / STEP

    yield at
    for method in methods.values():
        method.release()


CORNERS = {64: (64, 64), 8: (8, 120), 1: (1, 125), 3: (3, 129)}


@pytest.mark.parametrize(
    ("name", "cells_px", "most"),
    [
        ("background-extension", (64, 8, 1, 3), 0),
        ("push-pull", (64, 8), 0),  # these holes are filled from cells of 8 px and less
        ("weighted-pull-push", (64,), 0.1),
        ("push-pull-depth", (64,), 0.1),
        ("coherence-transport", (64,), 0.1),
        ("metameric", (64,), 0.25),  # noise is looked up in float32
    ],
)
def test_a_shift_by_whole_cells_shifts_the_fill(fill, name, cells_px, most):
    here = fill(name, HERE)
    for cell in cells_px:
        np.testing.assert_allclose(fill(name, CORNERS[cell]), here, rtol=0, atol=most)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("push-pull-depth", 1, 5),
        ("metameric", 2, 8),
        ("push-pull", 5, 15),
        ("coherence-transport", 0.3, 3),
    ],
)
def test_a_shift_by_odd_pixels_changes_fills_by_8_bit_steps(fill, name, least, most):
    """On average. Methods whose definition has a pyramid are not covariant, and docs say so."""
    here = fill(name, HERE)
    for corner in (CORNERS[1], CORNERS[3]):
        assert least < np.abs(fill(name, corner) - here).mean() < most
