"""Camera paths and the search for their extent."""

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.errors import InputError
from protocols.recipes.warped_clips import (
    CirclePath,
    Keyframe,
    KeyframesPath,
    LinePath,
    StereoPath,
    UpsamplingPath,
)
from stimuli.rendering.paths import make_path
from stimuli.rendering.solve import search
from stimuli.rendering.world import Viewpoint

CAMERA = Viewpoint((1.0, 2.0, 3.0), (1.0, 2.0, -5.0)).camera(64, 48)


def places(path, frames=8, fps=8.0, extent_m=1.0):
    made = make_path(path, frames, fps)
    cameras = [pose.applied_to(CAMERA, extent_m) for pose in made.poses]
    return np.array([camera.world_from_camera[:3, 3] for camera in cameras])


def test_a_circle_goes_counter_clockwise_in_the_image_plane():
    found = places(CirclePath(kind="circle"), extent_m=0.5) - (1, 2, 3)
    np.testing.assert_allclose(found[0], (0.5, 0, 0), atol=1e-12)
    np.testing.assert_allclose(found[2], (0, 0.5, 0), atol=1e-12)  # up, world y
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 0.5)


def test_a_line_is_centred_and_comes_back():
    found = places(LinePath(kind="line", direction=(0, 0, 2.0)), extent_m=1.0) - (1, 2, 3)
    np.testing.assert_allclose(found[0], (0, 0, 0.5), atol=1e-12)  # behind: forward is -z
    np.testing.assert_allclose(found[4], (0, 0, -0.5), atol=1e-12)
    np.testing.assert_allclose(found[1], found[7], atol=1e-12)


def test_key_frames_scale_in_place_and_not_in_angle():
    path = KeyframesPath(
        kind="keyframes",
        keyframes=(
            Keyframe(t_s=0.0, position_m=(0, 0, 0)),
            Keyframe(t_s=0.875, position_m=(0, 0, 4.0), yaw_deg=90.0),
        ),
    )
    made = make_path(path, 8, 8.0)
    last = made.poses[7].applied_to(CAMERA, 0.25).world_from_camera
    np.testing.assert_allclose(last[:3, 3], (1, 2, 2.75), atol=1e-12)
    np.testing.assert_allclose(last[:3, 2], (1, 0, 0), atol=1e-12)  # looks right: world +x


def test_key_frames_that_stay_are_refused():
    frames = (Keyframe(t_s=0.0, position_m=(0, 0, 0)), Keyframe(t_s=1.0, position_m=(0, 0, 0)))
    with pytest.raises(InputError, match="must leave the scene's camera"):
        make_path(KeyframesPath(kind="keyframes", keyframes=frames), 4, 4.0)


def test_the_stereo_path_ends_at_its_extent():
    found = places(StereoPath(kind="stereo"), 5, extent_m=0.2) - (1, 2, 3)
    np.testing.assert_allclose(found[:, 0], (0, 0.05, 0.1, 0.15, 0.2), atol=1e-12)


def test_up_sampling_warps_from_the_last_real_frame():
    path = UpsamplingPath(kind="upsampling", real_every=3, along=CirclePath(kind="circle"))
    made = make_path(path, 8, 8.0)
    assert made.source_frames == [0, 0, 0, 3, 3, 3, 6, 6]


def test_up_sampling_takes_the_next_real_frame_as_its_second_source():
    path = UpsamplingPath(
        kind="upsampling", real_every=3, along=CirclePath(kind="circle"), second_source=True
    )

    assert make_path(path, 8, 8.0).second_frames == [None, 3, 3, None, 6, 6, None, None]


def test_a_sequence_s_own_motion_leads_forwards_only():
    with pytest.raises(ValidationError, match="second_source needs a camera that moves"):
        UpsamplingPath(kind="upsampling", real_every=2, second_source=True)


@pytest.mark.parametrize("wanted", [0.02, 0.08, 0.3])
@pytest.mark.parametrize("start", [1e-4, 0.1, 50.0])
def test_the_search_finds_the_extent_of_a_saturating_share(wanted, start):
    found = search(lambda extent: 0.6 * (1 - np.exp(-extent)), wanted, start, np.inf, "here")
    assert 0.6 * (1 - np.exp(-found)) == pytest.approx(wanted, rel=0.011)


def test_a_share_that_no_extent_gives_is_refused_with_the_nearest():
    with pytest.raises(InputError, match=r"here: .*8 % of the frame \(the nearest is 1 %"):
        search(lambda extent: 0.01 * extent, 0.08, 0.1, 1.0, "here")
