"""Files of Nuke, Blender and Unreal come to one convention, by flow known from geometry."""

from dataclasses import dataclass

import numpy as np
import pytest

from pipeline.camera import Camera, flow_between
from pipeline.colour import decode_srgb
from pipeline.errors import InputError
from pipeline.frame import SourceFrame
from pipeline.pictures.channels import Channels
from pipeline.pictures.warp_input import load_warp_input
from protocols.recipes.warped_clips import CirclePath, ExrScene, UpsamplingPath
from stimuli.rendering.paths import STILL
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scenery import CameraStep
from stimuli.scenes.builtin_scenes import build_scene
from stimuli.scenes.sequence import load_picture, open_sequence, turned_round

CIRCLE = CirclePath(kind="circle")
UP = UpsamplingPath(kind="upsampling", real_every=2, along=CIRCLE)
SIZE = (96, 72)
EMPTY = np.float32(1e10)


@dataclass(frozen=True)
class Take:
    """Two frames of a scene, from cameras of which the second is right, up and ahead."""

    first: SourceFrame
    second: SourceFrame
    cameras: tuple[Camera, Camera]

    @property
    def ahead_px(self):
        """Exact flow from the first frame to the second."""
        return flow_between(*self.cameras, self.first.depth_m)[0]

    @property
    def back_px(self):
        """Exact flow from the second frame to the first."""
        return flow_between(*self.cameras[::-1], self.second.depth_m)[0]


@pytest.fixture(scope="module")
def take(module_gl_context):
    world = build_scene("colonnade", 0, {})
    here = world.viewpoint.camera(*SIZE)
    there = here.moved((0.15, -0.08, 0.1))
    renderer = WorldRenderer(module_gl_context, world)
    try:
        return Take(renderer.render(here), renderer.render(there), (here, there))
    finally:
        renderer.release()


def light(frame, half=True):
    return decode_srgb(frame.colour.astype(np.float64)).astype(np.float16 if half else np.float32)


def finite(depth_m):
    return np.where(np.isinf(depth_m), EMPTY, depth_m).astype(np.float32)


def project(take):
    """As this project's docs say: pixels, right and down."""
    c, flow = light(take.first), take.ahead_px
    return [{"R": c[..., 0], "G": c[..., 1], "B": c[..., 2], "Z": finite(take.first.depth_m),
             "flow.x": flow[..., 0], "flow.y": flow[..., 1]}]  # fmt: skip


def nuke(take):
    """Pixels from the lower left corner: right and up. Layers of a multi-part file."""
    c, flow = light(take.first), take.ahead_px
    return [
        {"R": c[..., 0], "G": c[..., 1], "B": c[..., 2]},
        {"depth.Z": finite(take.first.depth_m)},
        {"forward.u": flow[..., 0], "forward.v": -flow[..., 1]},
    ]


def blender(take):
    """X Y: previous place minus this, Z W: this minus the next; right and up."""
    c, flow = light(take.first), take.ahead_px
    layer = {f"ViewLayer.Combined.{name}": c[..., k] for k, name in enumerate("RGB")}
    layer["ViewLayer.Depth.Z"] = finite(take.first.depth_m)
    layer |= {f"ViewLayer.Vector.{name}": np.full_like(flow[..., 0], 9.0) for name in "XY"}
    layer["ViewLayer.Vector.Z"] = -flow[..., 0]
    layer["ViewLayer.Vector.W"] = flow[..., 1]
    return [layer]


def unreal(take):
    """This place minus the previous, in pictures, right and up, about 0.5; centimetres."""
    c, back = light(take.second), take.back_px
    layer = {name: c[..., k] for k, name in enumerate("RGB")}
    layer["FinalImageMovieRenderQueue_WorldDepth.R"] = finite(take.second.depth_m * 100)
    layer["FinalImageMovieRenderQueue_MotionVectors.R"] = 0.5 - back[..., 0] / SIZE[0]
    layer["FinalImageMovieRenderQueue_MotionVectors.G"] = 0.5 + back[..., 1] / SIZE[1]
    return [layer]


def scene(file="a.exr", camera=CIRCLE, **more):
    return ExrScene(kind="exr", name="s", file=file, camera=camera, **more)


@pytest.mark.parametrize("program", [project, nuke, blender, unreal])
def test_every_programs_file_gives_the_flow_of_the_geometry(take, tmp_path, write_exr, program):
    """Both readers. Unreal's 0.5 is added in float32: half a step of 0.5 to 1 is 2^-25 pictures."""
    write_exr(tmp_path / "a.exr", program(take))
    back = program is unreal
    frame = take.second if back else take.first
    wanted = take.back_px if back else take.ahead_px
    atol = SIZE[0] * 2.0**-24 if back else 0.0

    picture = load_picture(tmp_path / "a.exr", scene())
    warp = load_warp_input(tmp_path / "a.exr")

    assert np.abs(wanted).max() > 3  # both axes move enough to tell signs apart
    assert (np.abs(wanted).reshape(-1, 2).mean(axis=0) > 0.4).all()
    assert picture.motion.to_previous == back
    np.testing.assert_allclose(picture.motion.flow_px, wanted, rtol=1e-6, atol=atol)
    np.testing.assert_array_equal(warp.flow_px, picture.motion.flow_px)
    for found in (picture.frame, warp.source):
        np.testing.assert_allclose(found.depth_m, frame.depth_m, rtol=1e-6)
        np.testing.assert_allclose(found.colour, frame.colour, atol=2.0**-10)


def test_a_protocol_names_channels_in_its_own_or_a_programs_units(take, tmp_path, write_exr):
    (layer,) = project(take)
    layer["speed.x"], layer["speed.y"] = layer.pop("flow.x") / 2, -layer.pop("flow.y") / 2
    layer["far"] = 0.01 / layer.pop("Z")
    write_exr(tmp_path / "a.exr", [layer])
    told = {"motion_x": "speed.x", "motion_y": "speed.y", "depth": "far"}

    picture = load_picture(
        tmp_path / "a.exr",
        scene(channels=told, motion="nuke", motion_scale=2, depth_is="inverse", depth_scale=0.01),
    )

    np.testing.assert_allclose(picture.motion.flow_px, take.ahead_px, rtol=1e-6)
    seen = np.isfinite(take.first.depth_m)
    np.testing.assert_allclose(picture.frame.depth_m[seen], take.first.depth_m[seen], rtol=1e-6)

    plain = load_picture(tmp_path / "a.exr", scene(channels=told))
    np.testing.assert_allclose(
        plain.motion.flow_px, take.ahead_px * np.array([0.5, -0.5]), rtol=1e-6
    )


def test_the_warp_command_takes_named_channels_of_a_foreign_file(take, tmp_path, write_exr):
    (layer,) = project(take)
    layer["a.x"], layer["a.y"] = layer.pop("flow.x"), layer.pop("flow.y")
    write_exr(tmp_path / "a.exr", [layer])
    told = Channels(flow_x=("a.x",), flow_y=("a.y",))
    np.testing.assert_array_equal(
        load_warp_input(tmp_path / "a.exr", channels=told).flow_px, take.ahead_px
    )


def test_one_of_two_motion_channels_is_not_enough(take, tmp_path, write_exr):
    (layer,) = nuke(take)[:1]
    layer |= nuke(take)[1] | {"forward.u": take.ahead_px[..., 0]}
    write_exr(tmp_path / "a.exr", [layer])
    with pytest.raises(InputError, match=r"must have a channel forward\.v for motion"):
        load_warp_input(tmp_path / "a.exr")
    sequence = open_sequence(scene(camera=UP), tmp_path)
    with pytest.raises(InputError, match=r"forward\.v for motion .* motion_x ="):
        sequence.motion((64, 48), 0, CameraStep(0, 1, STILL, STILL, 0.0))


def test_motion_turned_round_is_the_motion_ahead(take):
    """Exact to the flow's own change within the half pixel by which places are rounded."""
    found = turned_round(take.back_px, take.second, take.first)
    ahead = take.ahead_px
    height, width = take.first.size
    y, x = np.mgrid[:height, :width]
    row = np.rint(y + ahead[..., 1]).astype(int)
    column = np.rint(x + ahead[..., 0]).astype(int)
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    reached = take.second.depth_m[row.clip(0, height - 1), column.clip(0, width - 1)]
    expected = flow_between(*take.cameras, take.first.depth_m)[1]
    with np.errstate(invalid="ignore"):
        visible = inside & (np.abs(reached / expected - 1) < 0.02)
    error = np.linalg.norm(found - ahead, axis=-1)
    assert visible.mean() > 0.6
    assert np.quantile(error[visible], 0.98) < 0.25
    assert np.linalg.norm(ahead, axis=-1)[visible].mean() > 5 * error[visible].mean()


def test_unreals_sequence_is_followed_ahead_by_the_next_files_motion(take, tmp_path, write_exr):
    (second,) = unreal(take)
    (first,) = unreal(Take(take.first, take.first, (take.cameras[0],) * 2))  # nothing moved yet
    write_exr(tmp_path / "s.0001.exr", [first])
    write_exr(tmp_path / "s.0002.exr", [second])
    sequence = open_sequence(scene("s.####.exr", UP), tmp_path)

    flow, depth_m = sequence.motion(SIZE, 0, CameraStep(0, 1, STILL, STILL, 0.0))

    np.testing.assert_allclose(depth_m, take.first.depth_m, rtol=1e-6)
    seen = np.isfinite(take.first.depth_m)
    assert np.median(np.linalg.norm(flow - take.ahead_px, axis=-1)[seen]) < 0.1
