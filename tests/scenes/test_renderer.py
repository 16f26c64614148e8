"""The renderer against geometry worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from cameras import wide_camera

from pipeline.camera import flow_between
from pipeline.errors import InputError
from pipeline.gl.texture import read_back, texture_from
from protocols.recipes.warped_clips import CirclePath, LinePath, UpsamplingPath
from stimuli.batch.footage import CameraShot, Footage
from stimuli.rendering.motion import MotionPass
from stimuli.rendering.paths import make_path
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scenery import RenderedScenery
from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World

VIEW = Viewpoint((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 60.0)


def sheet(corners, material, colour=(1.0, 1.0, 1.0)):
    """Two triangles over four corners, texture once over them."""
    corners = np.asarray(corners, np.float32)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    mesh = Mesh(
        corners,
        np.tile(normal, (4, 1)),
        np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32),
        np.tile(np.asarray(colour, np.float32), (4, 1)),
        np.array([[0, 1, 2], [1, 3, 2]], np.uint32),
    )
    return MeshPart(mesh, material)


def plain(r, g, b, a=255):
    return np.full((4, 4, 4), (r, g, b, a), np.uint8)


def wall_at(z, material, half=100.0):
    return sheet([[-half, -half, z], [half, -half, z], [-half, half, z], [half, half, z]], material)


@pytest.fixture
def draw(gl_context):
    """Draw a world once."""

    def run(world, camera):
        renderer = WorldRenderer(gl_context, world)
        try:
            return renderer.render(camera)
        finally:
            renderer.release()

    return run


@pytest.fixture
def two_planes():
    """A card of 1 m x 1 m at 2 m over a wall at 5 m, unlit, with a dotted texture."""
    rng = np.random.default_rng(1)
    dots = np.full((64, 64, 4), 255, np.uint8)
    dots[..., :3] = rng.integers(60, 200, (64, 64, 3))
    near = sheet(
        [[-0.5, -0.5, -2], [0.5, -0.5, -2], [-0.5, 0.5, -2], [0.5, 0.5, -2]],
        Material(plain(200, 30, 30), lit=False),
    )
    return World((wall_at(-5.0, Material(dots, lit=False), 20.0), near), VIEW)


def test_a_cards_edges_lie_where_its_corners_project(draw, two_planes):
    """By hand: f = 48 / tan(30 deg) = 83.14 px, so 0.5 m at 2 m is 20.8 px from the centre."""
    frame = draw(two_planes, VIEW.camera(128, 96))

    near = frame.depth_m < 3
    rows, columns = np.nonzero(near)
    # Pixel centres between 64 - 20.8 and 64 + 20.8: 43.5 to 84.5.
    assert (columns.min(), columns.max()) == (43, 84)
    assert (rows.min(), rows.max()) == (27, 68)


def test_depth_is_along_the_axis_and_exact_on_a_slanted_plane(draw):
    corners = [[-9.0, -1.0, 0.0], [9.0, -1.0, 0.0], [-9.0, -1.0, -50.0], [9.0, -1.0, -50.0]]
    camera = VIEW.camera(64, 48)
    frame = draw(World((sheet(corners, Material(plain(9, 9, 9), lit=False)),), VIEW), camera)

    # The ground 1 m below: depth z = f / (y - cy).
    rows = np.arange(30, 48)
    wanted = camera.fy_px / (rows + 0.5 - camera.cy_px)
    np.testing.assert_allclose(frame.depth_m[30:48, 32], wanted, rtol=2e-5)
    assert np.isinf(frame.depth_m[:24]).all()


def test_the_flow_takes_each_pixel_to_the_projection_of_its_3d_point(draw, two_planes, gl_context):
    """Points are found on the planes by hand, projected by hand, and compared."""
    source = VIEW.camera(96, 72)
    turned = np.radians(4.0)
    pose = source.world_from_camera.copy()
    rotation = np.array(
        [[np.cos(turned), 0, np.sin(turned)], [0, 1, 0], [-np.sin(turned), 0, np.cos(turned)]]
    )
    pose[:3, :3] = pose[:3, :3] @ rotation
    pose[:3, 3] = (0.3, 0.1, -0.2)
    target = replace(source, world_from_camera=pose)
    frame = draw(two_planes, source)
    depth = texture_from(gl_context, frame.depth_m, "r32f")
    motion = MotionPass(gl_context, (96, 72))
    motion(depth, source, target)
    flow, target_depth = read_back(motion.flow_px), read_back(motion.target_depth_m)
    for resource in (depth, motion):
        resource.release()

    for row, column in ((36, 48), (5, 7), (60, 80), (36, 30)):
        z = 2.0 if abs(column + 0.5 - 48) < 15 and abs(row + 0.5 - 36) < 15 else 5.0
        point = np.array(
            [
                (column + 0.5 - source.cx_px) / source.fx_px * z,
                -(row + 0.5 - source.cy_px) / source.fy_px * z,
                -z,
            ]
        )
        seen = pose[:3, :3].T @ (point - pose[:3, 3])
        place = source.fx_px * seen[:2] / seen[2] + (source.cx_px, source.cy_px)
        moved = place - (column + 0.5, row + 0.5)
        np.testing.assert_allclose(flow[row, column], moved, atol=1e-3)
        np.testing.assert_allclose(target_depth[row, column], seen[2], rtol=1e-5)


@pytest.mark.parametrize("offset", [(0.2, 0.0, 0.0), (0.1, -0.05, 0.3), (0.0, 0.0, -1.0)])
def test_motion_on_the_gpu_is_flow_between(gl_context, rng, offset):
    """Single against double precision: positions to 1e-4 px, as 1000 px x 2^-24 x 4."""
    depth_m = rng.uniform(1, 30, (40, 60)).astype(np.float32)
    depth_m[:6] = np.inf
    source = wide_camera(60, 40, 70)
    target = source.moved(offset)
    depth = texture_from(gl_context, depth_m, "r32f")
    motion = MotionPass(gl_context, (60, 40))
    motion(depth, source, target)
    flow, seen = flow_between(source, target, depth_m)
    found, found_depth = read_back(motion.flow_px), read_back(motion.target_depth_m)
    for resource in (depth, motion):
        resource.release()
    np.testing.assert_allclose(found, flow, atol=1e-4)
    np.testing.assert_allclose(found_depth, seen, rtol=1e-6)


def test_unlit_textures_come_out_as_they_are(draw):
    """sRGB decode and encode in the sampler and the shader cost at most one part in 255."""
    frame = draw(World((wall_at(-3.0, Material(plain(200, 90, 13), lit=False)),), VIEW),
                 VIEW.camera(16, 12))  # fmt: skip
    np.testing.assert_allclose(frame.colour[6, 8] * 255, (200, 90, 13), atol=0.5)


def test_cut_outs_show_what_is_behind_them(draw):
    holes = plain(10, 200, 10)
    holes[:, :2, 3] = 0  # the left half is not there
    card = sheet(
        [[-1, -1, -2], [1, -1, -2], [-1, 1, -2], [1, 1, -2]], Material(holes, True, lit=False)
    )
    behind = wall_at(-5.0, Material(plain(50, 50, 50), lit=False))
    frame = draw(World((card, behind), VIEW), VIEW.camera(64, 48))
    assert frame.depth_m[24, 28] == pytest.approx(5, rel=1e-5)
    assert frame.depth_m[24, 44] == pytest.approx(2, rel=1e-5)


def test_a_roof_throws_a_shadow(draw):
    """The sun stands overhead: ground under the roof is darker than beside it."""
    ground = sheet(
        [[-9, -1, 0], [9, -1, 0], [-9, -1, -9], [9, -1, -9]], Material(plain(150, 150, 150))
    )
    roof = sheet(
        [[-1, 1.5, -3], [1, 1.5, -3], [-1, 1.5, -5], [1, 1.5, -5]], Material(plain(90, 90, 90))
    )
    world = World((ground, roof), VIEW, Light((0.0, 1.0, 0.0)))
    camera = VIEW.camera(96, 72)
    frame = draw(world, camera)
    row = int(camera.cy_px + camera.fy_px / 4.0)  # ground at z = -4
    assert frame.colour[row, 48].mean() < 0.8 * frame.colour[row, 90].mean()


def test_light_does_not_move_with_the_camera(draw):
    ground = sheet(
        [[-9, -1, 0], [9, -1, 0], [-9, -1, -9], [9, -1, -9]], Material(plain(150, 140, 130))
    )
    world = World((ground,), VIEW, Light((0.3, 1.0, 0.2), haze_m=20.0))
    source, target = VIEW.camera(64, 48), VIEW.camera(64, 48).moved((0.5, 0, 0))
    seen, moved = draw(world, source), draw(world, target)
    flow, _ = flow_between(source, target, seen.depth_m)
    row, column = 40, 50
    there = column + round(float(flow[row, column, 0]))
    np.testing.assert_allclose(moved.colour[row, there], seen.colour[row, column], atol=0.01)


def test_what_is_near_is_seen_in_a_world_of_kilometres(draw):
    far = wall_at(-2000.0, Material(plain(50, 50, 50), lit=False), 3000.0)
    near = sheet(
        [[-0.1, -0.1, -0.2], [0.1, -0.1, -0.2], [-0.1, 0.1, -0.2], [0.1, 0.1, -0.2]],
        Material(plain(200, 0, 0), lit=False),
    )
    frame = draw(World((far, near), VIEW), VIEW.camera(32, 24))
    assert frame.depth_m[12, 16] == pytest.approx(0.2, rel=1e-5)
    assert frame.depth_m[1, 1] == pytest.approx(2000, rel=1e-4)


def test_rays_that_meet_nothing_are_infinitely_far(draw, two_planes):
    world = World(two_planes.parts[1:], VIEW, backdrop=(0.25, 0.5, 0.75))
    frame = draw(world, VIEW.camera(32, 24))
    assert np.isinf(frame.depth_m[0, 0])
    np.testing.assert_allclose(frame.colour[0, 0], (0.25, 0.5, 0.75), atol=1e-6)


@pytest.fixture
def scenery(gl_context, two_planes):
    held = RenderedScenery(WorldRenderer(gl_context, two_planes), "planes")
    yield held
    held.release()


def shot(frames=4, extent_m=0.2, margin=0.0, path=None):
    chosen = path or CirclePath(kind="circle")
    return CameraShot(make_path(chosen, frames, 10.0), (96, 72), extent_m, margin)


def test_the_margin_grows_until_no_hole_comes_from_outside(gl_context, scenery):
    """Without a margin the 0.2 m circle would uncover 2.5 px of wall at the border.

    Only the card hides anything: holes lie within its own parallax of its edge.
    """
    footage = Footage(gl_context, scenery, shot())
    holes = np.stack([footage.holes(k) for k in range(4)])
    margin = footage.margin_px
    footage.release()
    assert margin >= 3
    assert holes.any()
    # f = 62.35 px: the card's edge at 15.6 px, parallax 0.2 * f * (1/2 - 1/5) = 3.7 px.
    inside = np.zeros((72, 96), bool)
    reach = int(15.6 + 0.2 * 62.35 / 2 + 3)
    inside[36 - reach : 36 + reach, 48 - reach : 48 + reach] = True
    assert not holes[:, ~inside].any()


def test_outside_holes_the_warp_shows_the_true_view(gl_context, scenery):
    """The reference is sampled as the source: only the warp's resampling differs."""
    footage = Footage(gl_context, scenery, shot(extent_m=0.1))
    warped, truth = footage.warped(1), footage.truth(1)
    footage.release()
    near = (warped.depth_m < 3) & ~warped.hole
    inner = near & (np.abs(truth - (200 / 255, 30 / 255, 30 / 255)).max(axis=-1) < 0.01)
    assert near.sum() > 800
    assert near.sum() - inner.sum() <= 2 * 33  # a pixel along the card's upright edges


def test_a_frame_alone_is_the_frame_in_a_row(gl_context, scenery):
    alone = Footage(gl_context, scenery, shot())
    third = alone.warped(2)
    alone.release()
    row = Footage(gl_context, scenery, shot())
    frames = [row.warped(k) for k in range(4)]
    row.release()
    assert third.frame_index == frames[2].frame_index == 2
    assert np.array_equal(third.colour, frames[2].colour)
    assert np.array_equal(third.hole, frames[2].hole)


def test_up_sampling_shows_real_frames_as_they_are(gl_context, scenery):
    path = UpsamplingPath(kind="upsampling", real_every=2, along=CirclePath(kind="circle"))
    footage = Footage(gl_context, scenery, shot(path=path))
    frames = [footage.warped(k) for k in range(4)]
    truth = footage.truth(2)
    footage.release()
    assert not frames[0].hole.any()
    assert not frames[2].hole.any()
    assert frames[1].hole.any()
    np.testing.assert_allclose(frames[2].colour, truth, atol=1e-3)  # a quarter of 1/255


def line(second_source):
    along = LinePath(kind="line", direction=(1.0, 0.0, 0.0), there_and_back=False)
    return UpsamplingPath(kind="upsampling", real_every=2, along=along, second_source=second_source)


def test_a_second_source_shows_what_the_first_did_not_see(gl_context, scenery):
    """The next real frame sees all that the card uncovers on its way to it."""
    one = Footage(gl_context, scenery, shot(5, 1.0, path=line(second_source=False)))
    two = Footage(gl_context, scenery, shot(5, 1.0, path=line(second_source=True)))
    before, after, truth = one.warped(3), two.warped(3), two.truth(3)
    real = two.warped(2), one.warped(2)
    one.release()
    two.release()

    taken = before.hole & ~after.hole
    assert before.hole.sum() > 100
    assert not after.hole.any()
    assert np.median(np.abs(after.colour - truth)[taken]) < 1 / 255
    np.testing.assert_allclose(after.depth_m[taken], 5, rtol=1e-5)
    known = ~before.hole
    assert after.colour[known].tobytes() == before.colour[known].tobytes()
    assert real[0].colour.tobytes() == real[1].colour.tobytes()


def test_frames_after_the_last_real_one_have_no_second_source(gl_context, scenery):
    one = Footage(gl_context, scenery, shot(4, path=line(second_source=False)))
    two = Footage(gl_context, scenery, shot(4, path=line(second_source=True)))
    found, alone = two.warped(3), one.warped(3)
    one.release()
    two.release()

    assert found.hole.any()
    assert np.array_equal(found.hole, alone.hole)


def test_a_camera_that_sees_nothing_is_refused(gl_context, two_planes):
    away = two_planes.seen_from(Viewpoint((0, 0, 0), (0, 0, 1.0)))
    scenery = RenderedScenery(WorldRenderer(gl_context, away), "planes")
    try:
        with pytest.raises(InputError, match="planes: the camera must see something"):
            Footage(gl_context, scenery, shot())
    finally:
        scenery.release()
