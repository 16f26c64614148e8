"""Recirculation of [HF] against values worked by hand, and clips that use it."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.methods.method import PlateMethod
from pipeline.methods.registry import create_method
from pipeline.pushpull.reference import recirculating, weighted_pull_push


def view(hole, grey, motion_px=0.0, depth_m=4.0) -> WarpedFrame:
    """A row of greys that moved by `motion_px` to the right."""
    colour = np.repeat(np.float32(grey)[None, :, None], 3, axis=-1)
    size = (1, len(grey))
    flow_px = np.full((*size, 2), (motion_px, 0.0), np.float32)
    depth = np.full(size, depth_m, np.float32)
    return WarpedFrame(colour, depth, np.array([hole], bool), flow_px)


def alone(frame: WarpedFrame) -> np.ndarray:
    image = np.dstack([frame.colour, ~frame.hole])
    fill = weighted_pull_push(image).astype(np.float32)
    return np.where(frame.hole[..., None], fill, frame.colour)


def test_the_first_view_shows_its_own_fill(rng):
    frame = view([0, 1, 1, 0, 0, 1, 0, 0], rng.random(8))

    np.testing.assert_array_equal(recirculating(0.5).fill(frame), alone(frame))


def test_what_was_shown_last_is_blended_by_the_ratio_of_squared_weights():
    """By hand: the second pixel showed 0.25, and now its neighbour is 0.75.

    It weighs 1/2 beside 1, so it counts a fifth in the pair's mean:
    (0.75 + 0.25 / 4) / (1 + 1 / 4) = 0.65, of weight 3/4. The share of its own is
    (1/2 / 3/4)^2 = 4/9, and 4/9 x 0.25 + 5/9 x 0.65 = 0.4722.
    """
    recirculation = recirculating(0.5)
    before = view([0, 1], [0.25, 0.0])
    recirculation.fill(before)

    after = view([0, 1], [0.75, 0.0])
    shown = recirculation.fill(after)

    np.testing.assert_allclose(shown[0, :, 0], [0.75, 4 / 9 * 0.25 + 5 / 9 * 0.65], atol=2e-5)


def test_what_is_shown_replaces_what_was_shown_before():
    """At weight 1 the last shown colour stays; the first of three does not come back by itself."""
    recirculation = recirculating(0.25)
    greys = (0.0, 1.0, 1.0, 1.0, 1.0)
    found = []
    for grey in greys:
        frame = view([0, 1], [grey, 0.0])
        found.append(float(recirculation.fill(frame)[0, 1, 0]))

    assert found[0] == 0
    assert (np.diff(found) > 0).all()  # each starts from the last, and goes towards what is known
    share = 1 - found[1]
    np.testing.assert_allclose(
        1 - np.array(found[2:]), [share**2, share**3, share**4], atol=2e-4
    )  # a part of what the last frame lacked is left each time


def test_colours_move_with_the_background():
    """At weight 1 a hole whose background moved by 2 px shows what it showed, 2 px further."""
    recirculation = recirculating(1.0)
    first = view([0, 0, 1, 1, 0, 0, 0, 0], [0.1, 0.1, 0, 0, 0.9, 0.9, 0.9, 0.9])
    shown = recirculation.fill(first)

    second = view([0, 0, 0, 0, 1, 1, 0, 0], [0.5] * 8, motion_px=2.0)
    moved = recirculation.fill(second)

    np.testing.assert_allclose(moved[0, 4:6], shown[0, 2:4], atol=2e-5)


@pytest.mark.parametrize(("depth_m", "comes_back"), [(4.1, True), (4.3, False)])
def test_another_surface_is_filled_anew(depth_m, comes_back):
    recirculation = recirculating(1.0)
    first = view([0, 1], [0.0, 0.0])
    recirculation.fill(first)

    second = view([0, 1], [1.0, 0.0], depth_m=depth_m)

    found = recirculation.fill(second)[0, 1, 0]
    assert found == (0.0 if comes_back else 1.0)


def test_only_a_recirculating_method_needs_the_views_in_order(module_gl_context):
    plain = create_method("weighted-pull-push", module_gl_context)
    returning = create_method("weighted-pull-push", module_gl_context, {"recirculate": 0.5})

    assert not isinstance(plain, PlateMethod)
    assert isinstance(returning, PlateMethod)
    for method in (plain, returning):
        method.release()


@pytest.mark.parametrize("weight", [-0.1, 1.5, float("nan")])
def test_weights_outside_0_to_1_are_refused(module_gl_context, weight):
    with pytest.raises(InputError, match=r"recirculate must lie in 0\.\.1"):
        create_method("weighted-pull-push", module_gl_context, {"recirculate": weight})
