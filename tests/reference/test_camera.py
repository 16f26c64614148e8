"""Cameras: positions worked by hand, and flow against points projected one by one."""

import numpy as np
import pytest
from cameras import unprojected
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.camera import UPRIGHT, Camera, flow_between
from pipeline.errors import InputError

ROUNDING_PX = 1e-9  # float64, positions of a few hundred pixels


def camera(pose=UPRIGHT, **changes):
    """100 x 80 px, focal lengths 200 and 100 px, principal point (50, 40)."""
    settings = {"width_px": 100, "height_px": 80, "fx_px": 200.0, "fy_px": 100.0}
    settings |= {"cx_px": 50.0, "cy_px": 40.0, "world_from_camera": pose}
    return Camera(**settings | changes)


def turned(axis, angle_deg, position_m=(0.0, 0.0, 0.0)):
    """Return an upright pose turned about one of its own axes, at a position in the world."""
    first, second = [(1, 2), (2, 0), (0, 1)]["xyz".index(axis)]
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn = np.eye(4)
    turn[[first, first, second, second], [first, second, first, second]] = (
        cosine, -sine, sine, cosine,
    )  # fmt: skip
    pose = UPRIGHT @ turn
    pose[:3, 3] = position_m
    return pose


def random_pose(rng):
    """Return a rotation by the QR decomposition, and a position within 3 m."""
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    pose[:3, 3] = rng.uniform(-3, 3, 3)
    return pose


def test_an_upright_camera_sees_up_at_the_top_and_right_at_the_right():
    """By hand: (1, 2, -4) is 1 right, 2 up, 4 ahead: x = 50 + 200/4, y = 40 - 2 * 100/4."""
    position, depth_m = camera().project(np.array([1.0, 2.0, -4.0]))

    np.testing.assert_array_equal(position, [100, -10])
    assert depth_m == 4


def test_projecting_follows_the_cameras_place_and_turn():
    """By hand: at (10, 0, 0), turned 90 deg to the right, looking along world +x.

    (14, 1, 2) lies 4 ahead, 1 up, 2 right of it: x = 50 + 2 * 200/4, y = 40 - 100/4.
    """
    position, depth_m = camera(turned("y", 90, (10, 0, 0))).project(np.array([14.0, 1.0, 2.0]))

    np.testing.assert_allclose(position, [150, 15], rtol=0, atol=ROUNDING_PX)
    np.testing.assert_allclose(depth_m, 4, rtol=1e-15)


def test_unprojecting_puts_a_pixel_at_its_depth_along_the_axis():
    """By hand: 25 px right of and 20 px above the centre, at 4 m depth: not at 4 m distance."""
    point = unprojected(camera(), np.array([75.0, 20.0]), np.array(4.0))

    np.testing.assert_allclose(point, [0.5, 0.8, -4], rtol=1e-15)


def test_pixel_centres_lie_half_a_pixel_in():
    centres = camera(width_px=3, height_px=2).pixel_centres()

    assert centres.shape == (2, 3, 2)
    np.testing.assert_array_equal(centres[0, 0], [0.5, 0.5])
    np.testing.assert_array_equal(centres[1, 2], [2.5, 1.5])


def test_moving_goes_along_the_cameras_own_axes():
    """Turned 90 deg to the right, forward is world +x, right is world +z, down is world -y."""
    moved = camera(turned("y", 90)).moved(np.array([1.0, 2.0, 3.0]))

    np.testing.assert_allclose(moved.world_from_camera[:3, 3], [3, -2, 1], rtol=0, atol=1e-15)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_projecting_undoes_unprojecting(seed):
    rng = np.random.default_rng(seed)
    view = camera(random_pose(rng))
    start = rng.uniform(-50, 150, (5, 7, 2))
    depth_m = rng.uniform(0.1, 100, (5, 7))

    end, end_depth_m = view.project(unprojected(view, start, depth_m))

    np.testing.assert_allclose(end, start, rtol=0, atol=ROUNDING_PX)
    np.testing.assert_allclose(end_depth_m, depth_m, rtol=1e-11)


def test_projecting_undoes_unprojecting_for_a_pose_rounded_to_float32():
    rng = np.random.default_rng(3)
    view = camera(random_pose(rng).astype(np.float32))
    start = rng.uniform(0, 100, (20, 2))

    end, _ = view.project(unprojected(view, start, np.full(20, 5.0)))

    np.testing.assert_allclose(end, start, rtol=0, atol=ROUNDING_PX)


# --- Flow


def test_a_step_to_the_right_moves_near_things_farther_to_the_left():
    """By hand: flow = -fx * step / depth = -200 * 0.5 / 2 and / 8."""
    depth_m = np.full((80, 100), 2.0, np.float32)
    depth_m[40:] = 8

    flow_px, target_depth_m = flow_between(camera(), camera().moved([0.5, 0, 0]), depth_m)

    np.testing.assert_allclose(flow_px[:40], np.broadcast_to([-50, 0], (40, 100, 2)), atol=1e-5)
    np.testing.assert_allclose(flow_px[40:], np.broadcast_to([-12.5, 0], (40, 100, 2)), atol=1e-5)
    np.testing.assert_allclose(target_depth_m, depth_m, rtol=1e-7)


def test_a_step_forward_zooms_about_the_principal_point_and_lessens_depth():
    """By hand: from 4 m to 3 m depth, distances to the principal point grow by 4/3."""
    depth_m = np.full((80, 100), 4.0, np.float32)
    from_centre = camera().pixel_centres() - (50, 40)

    flow_px, target_depth_m = flow_between(camera(), camera().moved([0, 0, 1.0]), depth_m)

    np.testing.assert_allclose(flow_px, from_centre / 3, atol=1e-5)
    np.testing.assert_allclose(target_depth_m, 3, rtol=1e-7)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_flow_is_where_each_point_goes_when_projected_by_itself(seed):
    """The same points, taken one by one through the world with 4x4 matrices."""
    rng = np.random.default_rng(seed)
    source = camera(random_pose(rng), width_px=5, height_px=4, cx_px=2.0, cy_px=2.5)
    target = camera(random_pose(rng), fx_px=150.0, cy_px=31.0)
    depth_m = rng.uniform(0.5, 20, (4, 5)).astype(np.float32)

    flow_px, target_depth_m = flow_between(source, target, depth_m)

    for row in range(4):
        for column in range(5):
            z = float(depth_m[row, column])
            x, y = column + 0.5, row + 0.5
            seen = np.array([(x - 2.0) / 200 * z, (y - 2.5) / 100 * z, z, 1.0])
            there = np.linalg.solve(target.world_from_camera, source.world_from_camera @ seen)
            if there[2] <= 0:
                assert target_depth_m[row, column] == 0
                assert not flow_px[row, column].any()
                continue
            end = (150 * there[0] / there[2] + 50, 100 * there[1] / there[2] + 31)
            # float32 storage is the only rounding that shows.
            np.testing.assert_allclose(
                flow_px[row, column], np.subtract(end, (x, y)), rtol=2.0**-23, atol=1e-6
            )
            np.testing.assert_allclose(target_depth_m[row, column], there[2], rtol=2.0**-23)


def test_the_sky_turns_with_the_camera_but_does_not_feel_a_step():
    depth_m = np.full((80, 100), np.inf, np.float32)
    turn = turned("y", 5)
    stepped = turned("y", 5, (3.0, -2.0, 7.0))

    flow_px, target_depth_m = flow_between(camera(), camera(turn), depth_m)
    stepped_px, _ = flow_between(camera(), camera(stepped), depth_m)

    # By hand, a turn sideways moves all rows alike: x = 200 tan(a - 5 deg), a the pixel's angle.
    angle = np.arctan((np.arange(100) + 0.5 - 50) / 200) - np.radians(5)
    expected = 200 * np.tan(angle) + 50 - (np.arange(100) + 0.5)
    np.testing.assert_allclose(
        flow_px[..., 0], np.broadcast_to(expected, (80, 100)), rtol=0, atol=1e-5
    )
    np.testing.assert_array_equal(stepped_px, flow_px)
    assert np.isposinf(target_depth_m).all()


def test_a_camera_that_stays_moves_nothing():
    pose = random_pose(np.random.default_rng(1))
    depth_m = np.full((80, 100), 3.0, np.float32)

    flow_px, target_depth_m = flow_between(camera(pose), camera(pose), depth_m)

    np.testing.assert_allclose(flow_px, 0, rtol=0, atol=ROUNDING_PX)
    np.testing.assert_array_equal(target_depth_m, depth_m)


def test_points_behind_the_target_have_no_depth_and_no_flow():
    """A step of 5 m forward passes what was 2 m away, not what was 8 m away."""
    depth_m = np.full((80, 100), 2.0, np.float32)
    depth_m[40:] = 8

    flow_px, target_depth_m = flow_between(camera(), camera().moved([0, 0, 5.0]), depth_m)

    np.testing.assert_array_equal(target_depth_m[:40], 0)
    np.testing.assert_array_equal(flow_px[:40], 0)
    np.testing.assert_allclose(target_depth_m[40:], 3, rtol=1e-7)


def test_a_target_that_looks_away_sees_neither_scene_nor_sky():
    depth_m = np.full((80, 100), 2.0, np.float32)
    depth_m[40:] = np.inf

    flow_px, target_depth_m = flow_between(camera(), camera(turned("y", 180)), depth_m)

    np.testing.assert_array_equal(target_depth_m, 0)
    np.testing.assert_array_equal(flow_px, 0)


def test_points_at_the_target_s_own_plane_have_no_depth_and_no_flow():
    """A step of 2 m forward: what was 2 m away is now beside the camera, at any angle."""
    depth_m = np.full((80, 100), 2.0, np.float32)

    flow_px, target_depth_m = flow_between(camera(), camera().moved([0, 0, 2.0]), depth_m)

    np.testing.assert_array_equal(target_depth_m, 0)
    np.testing.assert_array_equal(flow_px, 0)


@pytest.mark.parametrize("nearest_m", [1e-44, 1e-37, 1e-20, 1.0])
def test_flow_is_finite_however_near_a_point_is(nearest_m):
    """A step of half a metre aside: what was at the lens goes farther than float32 can say."""
    depth_m = np.full((80, 100), nearest_m, np.float32)
    depth_m[:, :50] = np.inf

    flow_px, target_depth_m = flow_between(camera(), camera().moved([0.5, 0, 0]), depth_m)

    assert np.isfinite(flow_px).all()
    np.testing.assert_array_equal(target_depth_m[:, :50], np.inf)
    gone = target_depth_m == 0
    np.testing.assert_array_equal(flow_px[gone], 0)
    assert gone[:, 50:].all() == (nearest_m < 1e-35)


def test_cameras_far_from_the_origin_lose_nothing():
    """A map in metres, 500 km from its origin: the step of 0.5 m still moves by 50 px."""
    far = UPRIGHT.copy()
    far[:3, 3] = (5e5, 30.0, -5e5)
    depth_m = np.full((80, 100), 2.0, np.float32)

    flow_px, _ = flow_between(camera(far), camera(far).moved([0.5, 0, 0]), depth_m)

    np.testing.assert_allclose(flow_px, np.broadcast_to([-50, 0], (80, 100, 2)), atol=1e-5)


# --- Refusals


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width_px": 0}, r"at least 1x1 px \(got 0x80\)"),
        ({"fx_px": 0.0}, r"greater than 0 px and finite \(got 0.0, 100.0\)"),
        ({"fy_px": -1.0}, r"greater than 0 px and finite \(got 200.0, -1.0\)"),
        ({"fx_px": np.nan}, "greater than 0 px and finite"),
        ({"fx_px": np.inf}, "greater than 0 px and finite"),
        ({"cx_px": np.nan}, r"principal point must be finite \(got nan, 40.0\)"),
        ({"world_from_camera": np.eye(3)}, r"finite 4x4 matrix \(got shape \(3, 3\)\)"),
        ({"world_from_camera": np.full((4, 4), np.nan)}, "with NaN or infinite values"),
        ({"world_from_camera": np.diag([2.0, 2, 2, 1])}, r"rotation .* \(got determinant 8"),
        ({"world_from_camera": np.diag([1.0, 1, -1, 1])}, r"\(got determinant -1"),
        ({"world_from_camera": np.eye(4)[[0, 1, 2, 2]]}, "last row"),
    ],
)
def test_an_impossible_camera_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        camera(**change)


def test_a_move_must_have_three_parts():
    with pytest.raises(InputError, match=r"offset_m must be .* \(got shape \(2,\)\)"):
        camera().moved([1.0, 2.0])


def test_depth_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"must be 80x100 as the source camera \(got 100x80\)"):
        flow_between(camera(), camera(), np.ones((100, 80), np.float32))


def test_depth_of_zero_is_refused():
    with pytest.raises(InputError, match="depth_m must be greater than 0"):
        flow_between(camera(), camera(), np.zeros((80, 100), np.float32))


def test_a_camera_keeps_its_pose_when_the_callers_array_changes():
    pose = UPRIGHT.copy()
    view = camera(pose)

    pose[0, 3] = 5.0

    assert view.world_from_camera[0, 3] == 0
    with pytest.raises(ValueError, match="read-only"):
        view.world_from_camera[0, 3] = 1.0


def test_a_pose_of_integers_can_be_moved():
    moved = camera(np.diag([1, -1, -1, 1])).moved([0.25, 0, 0])

    assert moved.world_from_camera[0, 3] == 0.25
