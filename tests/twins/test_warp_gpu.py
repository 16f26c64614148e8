"""The warp on the GPU against its definition."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import moderngl
import numpy as np
import pytest
from cameras import wide_camera
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.shared.dispatches import dispatches_of
from pipeline.camera import Camera, flow_between
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, TargetWindow, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import create_texture, texture_from
from pipeline.warp.gpu import MOST_QUADS, WarpPass, warp_frame
from pipeline.warp.reference import (
    coverage,
    moved_mesh,
    partitioned_depth,
    torn_quads,
    warp,
    with_strips,
    with_thin,
)
from pipeline.warp.settings import VARIANTS, WarpSettings
from pipeline.warp.speckle import DIRECTIONS, HOLE_PX, ahead

# Roundoffs of float32. A weight is a quotient of two exact integers: 2 to convert them and 5
# to divide (GLSL allows 2.5 ulp). Which quad covers a pixel is decided on integers: no slack.
ROUNDOFF = 2.0**-24
WEIGHT = 7
# base + w1 (c1 - base) + w2 (c2 - base), with w1 + w2 <= 1 and differences up to 1: WEIGHT + 2
# in the products, 2 in the sums of up to 2, and 1 to round the reference.
COLOUR_ATOL = (WEIGHT + 2 + 2 * 2 + 1) * ROUNDOFF
# The same with differences up to twice the largest motion, and sums up to three times.
FLOW_RTOL_OF_MAX = (2 * (WEIGHT + 2) + 2 * 3 + 1) * ROUNDOFF
# 1 / depth, relative to its maximum M: a ratio a/b costs 5, less one 1, times a weight
# WEIGHT + 1: 14 M + 9; the sums 2 M; dividing again 5, rounding the reference 1.
INVERSE_DEPTH_RTOL_OF_MAX = (14 + 9 + 2 + 5 + 1) * ROUNDOFF
# The key, 1 / depth as well: 5 to invert, WEIGHT + 2 in the products, 4 in the sums.
KEY_RTOL_OF_MAX = (5 + 2 * (WEIGHT + 2) + 4) * ROUNDOFF
# The least share of pixels whose foremost depths float32 can order.
SURE = 0.997


@dataclass(frozen=True)
class Scene:
    """Input of one comparison of warps."""

    frame: SourceFrame
    flow_px: NDArray[np.float32]
    target_depth_m: NDArray[np.float32] | None = None
    window: TargetWindow | None = None


def slanted(height: int = 64, width: int = 80) -> SourceFrame:
    """Make a textured floor with three boxes on it, and sky."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width] + 0.5
    depth = 40.0 / np.maximum(y - 12, 0.01)
    depth[y < 14] = np.inf
    for left, top, size, metres in ((10, 20, 14, 2.1), (30, 8, 20, 1.3), (60, 30, 9, 0.9)):
        depth[(abs(x - left - size / 2) < size / 2) & (abs(y - top - size / 2) < size / 2)] = metres
    return SourceFrame(rng.random((height, width, 3), np.float32), depth.astype(np.float32))


def turn(yaw_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """Give the rotation of a camera."""
    yaw, roll = np.radians((yaw_deg, roll_deg))
    about_y = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    about_z = [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    return np.array(about_y) @ np.array(about_z)


def seen_from(offset_m: tuple[float, float, float], turned: NDArray[np.float64]) -> Scene:
    """Move and turn the camera in front of the slanted scene."""
    frame = slanted()
    source = wide_camera(80, 64, 60)
    moved = source.moved(np.array(offset_m))
    pose = moved.world_from_camera.copy()
    pose[:3, :3] @= turned
    target = Camera(80, 64, source.fx_px, source.fy_px, source.cx_px, source.cy_px, pose)
    return Scene(frame, *flow_between(source, target, frame.depth_m))


def random_scene(
    rng: np.random.Generator, scale_px: float, height: int = 40, width: int = 48
) -> Scene:
    """Move every pixel by itself."""
    frame = SourceFrame(
        rng.random((height, width, 3), np.float32),
        rng.uniform(1, 20, (height, width)).astype(np.float32),
    )
    flow = (scale_px * rng.standard_normal((height, width, 2))).astype(np.float32)
    return Scene(frame, flow)


def stretched_by_halves() -> Scene:
    """Make sides of 8 and 4 px in turn, which differ by exactly half of the longer one."""
    scene = random_scene(np.random.default_rng(9), 0, 20, 24)
    x = np.cumsum(np.r_[0, np.tile([8, 4], 12)])[:24] - np.arange(24)
    scene.flow_px[..., 0] = x
    return scene


def passed_post() -> Scene:
    """Put a post behind the camera, between two sides equally far that move differently."""
    scene = random_scene(np.random.default_rng(10), 0, 6, 20)
    scene.flow_px[:, 12:] = (0.25, -0.5)
    target = np.full((6, 20), 3, np.float32)
    target[:, 8:12] = -1
    return Scene(scene.frame, scene.flow_px, target)


def torn_beside_a_passed_post() -> Scene:
    """Tear right beside what is behind the camera: no whole quad reaches into the tear."""
    scene = random_scene(np.random.default_rng(12), 0, 6, 30)
    scene.flow_px[:, 8:] = (10, 0)
    target = np.full((6, 30), 3, np.float32)
    target[:, 6] = 0
    return Scene(scene.frame, scene.flow_px, target)


def lattice(turned_deg: float = 0.0) -> Scene:
    """Put wires of one pixel, near and nearer along their way, before a far wall."""
    rng = np.random.default_rng(13)
    y, x = np.mgrid[:48, :64]
    wires = (y % 11 == 5) | (x % 13 == 6) | ((x + y) % 29 == 3) | ((2 * x + y) % 31 == 8)
    depth = np.where(wires, 1.2 + 0.011 * x + 0.007 * y, 9.0).astype(np.float32)
    frame = SourceFrame(rng.random((48, 64, 3), np.float32), depth)
    source = wide_camera(64, 48, 60)
    moved = source.moved(np.array((0.21, 0.13, 0.1)))
    pose = moved.world_from_camera.copy()
    pose[:3, :3] @= turn(0, turned_deg)
    target = Camera(64, 48, source.fx_px, source.fy_px, source.cx_px, source.cy_px, pose)
    return Scene(frame, *flow_between(source, target, frame.depth_m))


SCENES: dict[str, Callable[[], Scene]] = {
    "sideways": lambda: seen_from((0.25, 0.05, 0), np.eye(3)),
    "forward, past a box": lambda: seen_from((0, 0, 1.1), np.eye(3)),
    "backward": lambda: seen_from((0, 0, -1.5), np.eye(3)),
    "turned": lambda: seen_from((0.1, 0, 0.2), turn(12, 25)),
    "turned about": lambda: seen_from((0, 0, 0), turn(0, 180)),
    "jittered": lambda: random_scene(np.random.default_rng(1), 0.4),
    "scattered": lambda: random_scene(np.random.default_rng(2), 30, 25, 32),
    "thrown far out": lambda: random_scene(np.random.default_rng(3), 9000, 12, 14),
    "stretched by halves": stretched_by_halves,
    "past a post": passed_post,
    "torn beside a passed post": torn_beside_a_passed_post,
    "wires": lattice,
    "wires, turned": lambda: lattice(33),
    "one pixel": lambda: random_scene(np.random.default_rng(4), 0.3, 1, 1),
    "one row": lambda: random_scene(np.random.default_rng(5), 3, 1, 50),
    "one column": lambda: random_scene(np.random.default_rng(6), 3, 50, 1),
}


def undecided(scene: Scene, settings: WarpSettings) -> NDArray[np.bool_]:
    """Tell where two depths lie too close for float32 to order them, or to see that they tie."""
    frame, window = scene.frame, scene.window or TargetWindow.of(scene.frame.size)
    depth = scene.frame.depth_m if scene.target_depth_m is None else scene.target_depth_m
    mesh = moved_mesh(depth.astype(np.float64), scene.flow_px, window)
    stretched = mesh.ring_0.copy()
    drawn = mesh.drawable & ~(mesh.ring_0 & (settings.variant != "full"))
    if settings.variant != "smear":
        stretched |= torn_quads(
            scene.flow_px, settings.stretch_subpixels(window), settings.surface_px
        )
    if settings.variant == "remove":
        drawn &= ~stretched
    mesh, stretched, drawn = with_strips(mesh, stretched, drawn, frame.size, window)
    mesh, stretched, drawn = with_thin(
        mesh, stretched, drawn, scene.flow_px, depth.astype(np.float64), window, settings
    )
    hits = coverage(mesh, drawn, window)
    rank = partitioned_depth(mesh, stretched, hits)
    order = np.lexsort((rank, hits.pixel))
    pixel, rank, quad = hits.pixel[order], rank[order], hits.quad[order]
    place = (hits.weight * mesh.pixel[hits.quad]).sum(axis=1)[order]
    first = np.flatnonzero(np.r_[True, np.diff(pixel) > 0])
    runner_up = first[first + 1 < len(pixel)] + 1
    runner_up = runner_up[pixel[runner_up] == pixel[runner_up - 1]]
    margin = rank[runner_up] - rank[runner_up - 1]
    # Of two that tie, the GPU rounds the one whose corners are not all equally far. On an edge
    # that they share they are one and the same.
    sloped = ~stretched & (mesh.depth_m != mesh.depth_m[:, :1]).any(axis=1)
    rounded = sloped[quad[runner_up]] != sloped[quad[runner_up - 1]]
    rounded &= abs(place[runner_up] - place[runner_up - 1]) > ROUNDOFF
    close = ((margin > 0) | rounded) & (margin < 0.5 * 2 * KEY_RTOL_OF_MAX)
    result = np.zeros(window.height_px * window.width_px, np.bool_)
    result[pixel[runner_up[close]]] = True
    return result.reshape(window.height_px, window.width_px)


def undecided_rim(
    bare: WarpedFrame, unsure: NDArray[np.bool_], slack_px: float, rim_px: int, alike_px: float
) -> NDArray[np.bool_]:
    """Tell where a rim hangs on a pixel that is `unsure`, or on motions too close for float32."""
    reach = 2 * (rim_px + HOLE_PX - 1) + 1
    result = ndimage.maximum_filter(unsure, reach)
    for direction in DIRECTIONS:
        for steps in range(1, rim_px + 1):
            for axis in (0, 1):
                motion = bare.flow_px[..., axis].astype(np.float64)
                off_px = abs(motion - ahead(motion, direction, steps))
                close = abs(off_px - alike_px) <= slack_px
                result |= close & ahead(bare.hole, direction, steps)
    return result


def assert_alike(found: WarpedFrame, scene: Scene, settings: WarpSettings) -> WarpedFrame:
    """Compare with the reference; give the reference."""
    expected = warp(
        scene.frame,
        scene.flow_px,
        target_depth_m=scene.target_depth_m,
        window=scene.window,
        settings=settings,
    )
    sure = ~undecided(scene, settings)
    assert sure.mean() >= SURE
    depth = scene.frame.depth_m if scene.target_depth_m is None else scene.target_depth_m
    nearest = depth[depth > 0].min()
    bare = expected
    if settings.rim_px > 0:
        bare = warp(
            scene.frame,
            scene.flow_px,
            target_depth_m=scene.target_depth_m,
            window=scene.window,
            settings=replace(settings, rim_px=0),
        )
        alike_px = settings.alike_px(scene.window or TargetWindow.of(scene.frame.size))
        slack_px = FLOW_RTOL_OF_MAX * abs(scene.flow_px).max() + alike_px * ROUNDOFF
        doubtful = undecided_rim(bare, ~sure, slack_px, settings.rim_px, alike_px)
        assert doubtful.mean() <= 0.1  # each pixel left out above takes its surroundings along
        sure &= ~doubtful
    np.testing.assert_array_equal(found.hole[sure], expected.hole[sure])
    np.testing.assert_allclose(found.colour[sure], expected.colour[sure], rtol=0, atol=COLOUR_ATOL)
    fastest = abs(scene.flow_px).max()
    np.testing.assert_allclose(
        found.flow_px[sure], expected.flow_px[sure], rtol=0, atol=FLOW_RTOL_OF_MAX * fastest
    )
    np.testing.assert_allclose(
        1 / found.depth_m[sure].astype(np.float64),
        1 / expected.depth_m[sure].astype(np.float64),
        rtol=0,
        atol=INVERSE_DEPTH_RTOL_OF_MAX / nearest,
    )
    # What is not interpolated is the same to the bit; but a card's quotient may end otherwise.
    held = sure & bare.hole
    np.testing.assert_array_max_ulp(found.depth_m[held], expected.depth_m[held], maxulp=1)
    np.testing.assert_array_equal(found.flow_px[held], expected.flow_px[held])
    return expected


def run(ctx: moderngl.Context, scene: Scene, settings: WarpSettings) -> WarpedFrame:
    """Warp on the GPU."""
    return warp_frame(
        scene.frame,
        scene.flow_px,
        target_depth_m=scene.target_depth_m,
        window=scene.window,
        settings=settings,
        ctx=ctx,
    )


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", SCENES)
def test_gpu_matches_reference(gl_context, name, variant):
    scene, settings = SCENES[name](), WarpSettings(variant)
    assert_alike(run(gl_context, scene, settings), scene, settings)


@pytest.mark.parametrize("rim_px", [1, 3])
@pytest.mark.parametrize("name", SCENES)
def test_gpu_matches_reference_with_a_rim(gl_context, name, rim_px):
    scene, settings = SCENES[name](), WarpSettings(rim_px=rim_px)
    assert_alike(run(gl_context, scene, settings), scene, settings)


@given(
    rng=st.integers(0, 2**32 - 1).map(np.random.default_rng),
    scale=st.sampled_from([1.0, 5.0, 40.0]),
    rim_px=st.integers(1, 4),
)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_gpu_matches_reference_with_a_rim_under_any_motion(gl_context, rng, scale, rim_px):
    """Blocks that move apart: holes of all sizes between few depths."""
    height, width = (int(edge) for edge in rng.integers(1, 60, 2))
    blocks = rng.integers(0, 4, (-(-height // 6), -(-width // 6)))
    which = np.kron(blocks, np.ones((6, 6), int))[:height, :width]
    depth = np.float32([2, 2.03, 5, 9])[which]
    flow = (scale * rng.standard_normal((4, 2))).astype(np.float32)[which]
    frame = SourceFrame(rng.random((height, width, 3), np.float32), depth)
    scene, settings_ = Scene(frame, flow), WarpSettings(rim_px=rim_px)
    assume(undecided(scene, settings_).mean() <= 1 - SURE)
    assert_alike(run(gl_context, scene, settings_), scene, settings_)


@pytest.mark.parametrize("rim_px", [1, 2, 3, 4])
def test_a_rim_is_as_wide_as_asked_for(gl_context, disc_over_plane, rim_px):
    flow = np.stack([60 / disc_over_plane.depth_m, 0 * disc_over_plane.depth_m], axis=-1)
    scene = Scene(disc_over_plane, flow)
    bare = run(gl_context, scene, WarpSettings())
    grown = run(gl_context, scene, WarpSettings(rim_px=rim_px))

    middle = slice(20, None)  # of the row through the disc: right of what enters at the border
    row = np.flatnonzero(grown.hole[48, middle] & ~bare.hole[48, middle])
    first = np.flatnonzero(bare.hole[48, middle])[0]
    np.testing.assert_array_equal(row, np.arange(first - rim_px, first))
    np.testing.assert_array_equal(grown.colour[grown.hole], 0)
    np.testing.assert_array_equal(grown.colour[~grown.hole], bare.colour[~grown.hole])
    np.testing.assert_array_equal(grown.depth_m, bare.depth_m)
    np.testing.assert_array_equal(grown.flow_px, bare.flow_px)


def test_a_rim_of_two_pixels_costs_two_dispatches_and_holds_no_memory(gl_context):
    scene = random_scene(np.random.default_rng(7), 4)
    sources = (
        texture_from(gl_context, np.dstack([scene.frame.colour, scene.frame.depth_m]), "rgba32f"),
        texture_from(gl_context, scene.frame.depth_m, "r32f"),
        texture_from(gl_context, scene.flow_px, "rg32f"),
    )
    warped = FrameTextures.create(gl_context, (48, 40))
    held = set()
    for settings_, dispatches in (
        (WarpSettings("remove"), 7),
        (WarpSettings(), 9),
        (WarpSettings(rim_px=2), 11),
    ):
        warp_pass = WarpPass(gl_context, (48, 40), settings=settings_)
        made = dispatches_of(partial(warp_pass, *sources, warped))
        assert len(made) == dispatches
        held.add(warp_pass.held_bytes)
        warp_pass.release()
    assert len(held) == 1
    for resource in (*sources, warped):
        resource.release()


def test_gpu_matches_reference_on_fig_5(gl_context, disc_over_plane):
    flow = np.stack([60 / disc_over_plane.depth_m, 17 / disc_over_plane.depth_m], axis=-1)
    scene = Scene(disc_over_plane, flow)

    warped = run(gl_context, scene, WarpSettings())

    assert_alike(warped, scene, WarpSettings())
    assert warped.hole.mean() > 0.05
    np.testing.assert_array_equal(warped.depth_m[warped.hole], 5)
    red = warped.colour[..., 0] > 2 * warped.colour[..., 1]
    np.testing.assert_array_equal(warped.depth_m[red], 2)
    np.testing.assert_array_equal(warped.depth_m[~red], 5)


@given(
    rng=st.integers(0, 2**32 - 1).map(np.random.default_rng),
    scale=st.sampled_from([0.2, 1.0, 5.0, 40.0]),
    whole=st.booleans(),
    settings_=st.builds(
        WarpSettings,
        st.sampled_from(VARIANTS),
        st.sampled_from([None, 1.0, 7.5, 1e6]),
        st.sampled_from([2, 8, 1000]),
    ),
)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_gpu_matches_reference_under_any_motion_and_setting(
    gl_context, rng, scale, whole, settings_
):
    """Whole pixels put corners onto pixel centres and make many depths equal."""
    height, width = (int(edge) for edge in rng.integers(1, 40, 2))
    scene = random_scene(rng, scale, height, width)
    if whole:
        scene = Scene(
            SourceFrame(scene.frame.colour, np.ceil(scene.frame.depth_m / 5)),
            np.round(scene.flow_px),
            window=TargetWindow(
                *(int(n) for n in (*rng.integers(-9, 9, 2), *rng.integers(1, 40, 2)))
            ),
        )
    found = run(gl_context, scene, settings_)
    if whole:  # equal depths that both twins round: only the hole mask is certain
        expected = warp(scene.frame, scene.flow_px, window=scene.window, settings=settings_)
        np.testing.assert_array_equal(found.hole, expected.hole)
    else:
        assume(undecided(scene, settings_).mean() <= 1 - SURE)  # wide quads may be as far by chance
        assert_alike(found, scene, settings_)


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (37, 50)])
def test_no_motion_returns_the_frame_bit_by_bit(gl_context, rng, size):
    depth = rng.uniform(1, 9, size).astype(np.float32)
    depth[0, -1] = np.inf
    frame = SourceFrame(rng.random((*size, 3), np.float32), depth)

    warped = warp_frame(frame, np.zeros((*size, 2), np.float32), ctx=gl_context)

    assert not warped.hole.any()
    np.testing.assert_array_equal(warped.colour, frame.colour)
    np.testing.assert_array_equal(warped.depth_m, frame.depth_m)
    np.testing.assert_array_equal(warped.flow_px, 0)


def test_whole_pixel_translation_moves_every_bit(gl_context, rng):
    frame = SourceFrame(rng.random((30, 40, 3), np.float32), np.full((30, 40), 3, np.float32))
    warped = warp_frame(frame, np.full((30, 40, 2), (5, -2), np.float32), ctx=gl_context)
    np.testing.assert_array_equal(warped.colour[:28, 5:], frame.colour[2:, :35])
    assert warped.hole.sum() == 30 * 40 - 28 * 35
    np.testing.assert_array_equal(warped.depth_m, 3)


def test_a_constant_frame_stays_constant(gl_context, rng):
    frame = SourceFrame(np.full((40, 40, 3), 0.3, np.float32), np.full((40, 40), 2.7, np.float32))
    warped = warp_frame(frame, (3 * rng.standard_normal((40, 40, 2))).astype("f4"), ctx=gl_context)
    np.testing.assert_array_equal(warped.colour[~warped.hole], np.float32(0.3))
    np.testing.assert_array_equal(warped.depth_m, np.float32(2.7))


def test_one_quad_may_span_the_whole_view(gl_context):
    """Four pixels, thrown to the corners: torn, or smeared, over 512 px."""
    frame = SourceFrame(
        np.float32([[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]), np.float32([[2, 3], [4, 5]])
    )
    flow = np.float32([[(-3, -2), (511, 1)], [(5, 512), (509, 513)]])
    scene = Scene(frame, flow, window=TargetWindow(0, 0, 512, 512))

    for variant in VARIANTS:
        expected = assert_alike(
            run(gl_context, scene, WarpSettings(variant)), scene, WarpSettings(variant)
        )
        if variant == "full":
            assert expected.hole.mean() > 0.99
            assert (expected.depth_m[expected.hole] == 5).mean() > 0.95
        if variant == "smear":
            assert expected.hole.mean() < 0.03


def test_wide_quads_seen_through_a_small_window_stay_exact(gl_context):
    """Nothing is torn: quads of thousands of pixels, of which the view shows a few."""
    whole = random_scene(np.random.default_rng(11), 2000, 12, 14)
    scene = Scene(whole.frame, whole.flow_px, window=TargetWindow(4, 4, 3, 4))
    settings = WarpSettings(stretch_px=1e6)
    assert not assert_alike(run(gl_context, scene, settings), scene, settings).hole.all()


def test_the_list_holds_every_quad_at_once(gl_context):
    """A zoom by 12 about the centre leaves no small quad."""
    y, x = np.mgrid[-24:24, -24:24] + 0.5
    frame = slanted(48, 48)
    scene = Scene(frame, np.stack([11 * x, 11 * y], axis=-1).astype(np.float32))
    assert not assert_alike(
        run(gl_context, scene, WarpSettings()), scene, WarpSettings()
    ).hole.any()


@pytest.mark.parametrize("rim_px", [0, 2])
def test_frames_do_not_remember_each_other(gl_context, gl_watch, rim_px):
    """One pass warps a, b, a: both a are the same to the bit, and nothing was allocated."""
    ctx = gl_context
    scenes = [random_scene(np.random.default_rng(seed), 4) for seed in (7, 8)]
    sources = [
        (
            texture_from(ctx, np.dstack([s.frame.colour, s.frame.depth_m]), "rgba32f"),
            texture_from(ctx, s.frame.depth_m, "r32f"),
            texture_from(ctx, s.flow_px, "rg32f"),
        )
        for s in scenes
    ]
    warp_pass = WarpPass(ctx, (48, 40), settings=WarpSettings(rim_px=rim_px))
    warped = FrameTextures.create(ctx, (48, 40))
    watch = gl_watch()
    results = []
    for index in (0, 1, 0):
        warp_pass(*sources[index], warped)
        results.append(warped.read_back())
    assert not watch.gained()

    for name in ("colour", "depth_m", "hole", "flow_px"):
        np.testing.assert_array_equal(getattr(results[0], name), getattr(results[2], name))
    assert not np.array_equal(results[0].colour, results[1].colour)
    for resource in (*sources[0], *sources[1], warp_pass, warped):
        resource.release()


def test_a_window_in_a_margin_has_no_border_holes(gl_context):
    frame = slanted()
    flow = np.stack([6 / frame.depth_m, 2 / frame.depth_m], axis=-1)
    flow[:, :2] = flow[:, 2:3]
    scene = Scene(frame, flow, window=TargetWindow.inside_margin((64, 80), 8))

    warped = run(gl_context, scene, WarpSettings())

    assert warped.size == (48, 64)
    assert_alike(warped, scene, WarpSettings())
    assert not warped.hole[:, 0].any()


def test_motorcycle_pair_matches_reference_and_fills_its_holes_from_behind(gl_context):
    skimage_data = pytest.importorskip("skimage.data")
    left, right, disparity = skimage_data.stereo_motorcycle()
    view = slice(180, 360), slice(380, 640)
    disparity_px = known_or_farther_neighbour(disparity)[view]
    depth = (994.978 * 0.193001 / (disparity_px + 31.086)).astype(np.float32)
    frame = SourceFrame((left[view] / 255).astype(np.float32), depth)
    flow = np.stack([-disparity_px, 0 * disparity_px], axis=-1).astype(np.float32)
    scene = Scene(frame, flow)

    warped = run(gl_context, scene, WarpSettings())

    assert_alike(warped, scene, WarpSettings())
    inner = warped.hole[:, :190]  # left of what enters at the border
    assert 0.05 < inner.mean() < 0.3
    depth_right_of = np.roll(warped.depth_m, -1, axis=1)
    ends = warped.hole & ~np.roll(warped.hole, -1, axis=1)
    ends[:, 190:] = False
    # The source moved left: at its right end, a hole meets the background that it continues.
    assert (warped.depth_m >= 0.98 * depth_right_of)[ends].mean() > 0.95
    error = (warped.colour - right[view] / 255)[:, :190][~inner]
    assert -10 * np.log10((error**2).mean()) > 22


def known_or_farther_neighbour(disparity_px: NDArray[np.float32]) -> NDArray[np.float64]:
    """Give unknown disparities the smaller of the two nearest known ones in their row."""
    known = np.isfinite(disparity_px)
    column = np.arange(disparity_px.shape[1])
    before = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, column, len(column))[:, ::-1], axis=1)[:, ::-1]
    padded = np.pad(disparity_px.astype(np.float64), ((0, 0), (1, 1)), constant_values=np.inf)
    return np.minimum(
        np.take_along_axis(padded, before + 1, axis=1),
        np.take_along_axis(padded, after + 1, axis=1),
    )


def test_textures_of_the_wrong_size_or_format_are_refused(gl_context):
    ctx = gl_context
    warp_pass, warped = WarpPass(ctx, (6, 4)), FrameTextures.create(ctx, (6, 4))
    colour, depth, flow = (
        create_texture(ctx, (6, 4), name) for name in ("rgba32f", "r32f", "rg32f")
    )
    small, half = create_texture(ctx, (5, 4), "r32f"), create_texture(ctx, (6, 4), "rg16f")
    try:
        with pytest.raises(InputError, match=r"depth_m must be r32f of 6x4 .*\(got r32f of 5x4\)"):
            warp_pass(colour, small, flow, warped)
        with pytest.raises(InputError, match=r"flow_px must be rg32f of 6x4 .*rg16f of 6x4"):
            warp_pass(colour, depth, half, warped)
    finally:
        for resource in (warp_pass, warped, colour, depth, flow, small, half):
            resource.release()


def test_images_beyond_the_drivers_buffers_are_refused(gl_context):
    limit = min(gl_context.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"], 4 * MOST_QUADS)
    with pytest.raises(InputError, match=f"shader buffers of {limit} bytes"):
        WarpPass(gl_context, (4, 4), TargetWindow(0, 0, limit // 4 + 1, 1))
    with pytest.raises(InputError, match="use smaller images"):
        WarpPass(gl_context, (limit // 16, 4), TargetWindow(0, 0, 4, 4))


def test_bad_arrays_are_refused_before_anything_is_drawn(gl_context, disc_over_plane):
    flow = np.zeros((96, 128, 2), np.float32)
    flow[3, 4] = np.nan
    with pytest.raises(InputError, match=r"flow_px must be finite .*row 3, column 4"):
        warp_frame(disc_over_plane, flow, ctx=gl_context)
