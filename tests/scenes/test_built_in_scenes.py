"""The seven built-in scenes: places with jumps in depth and natural textures, by their seed."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import InputError
from stimuli.render import Renderer
from stimuli.scenes.registry import build_scene, scene_names


@pytest.mark.parametrize("name", [
    "tunnel",
    *(pytest.param(name, marks=pytest.mark.full) for name in
      ("garden", "shed", "castle", "colonnade", "thicket", "street")),
])  # fmt: skip
def test_a_scene_has_near_and_far_and_detail_like_a_photograph(name, gl_context):
    renderer = Renderer(gl_context, build_scene(name, 1))
    try:
        frame = renderer.render(renderer.world.viewpoint.camera(192, 144))
    finally:
        renderer.release()
    depth = frame.depth_m[np.isfinite(frame.depth_m)]
    near, far = np.percentile(depth, (2, 98))
    assert near < 5
    assert far > 2 * near
    inverse = 1 / frame.depth_m
    jumps = np.abs(np.diff(inverse, axis=1)) > 0.02
    assert jumps.mean() > 0.005
    luma = frame.colour @ (0.2126, 0.7152, 0.0722)
    assert 0.1 < luma.mean() < 0.75
    assert luma.std() > 0.1
    # Amplitudes of photographs fall as about 1 / frequency: power as its square.
    window = np.hanning(144)[:, None] * np.hanning(192)
    power = np.abs(np.fft.rfft2((luma - luma.mean()) * window)) ** 2
    radius = np.hypot(np.fft.fftfreq(144)[:, None], np.fft.rfftfreq(192))
    bands = [power[(radius > low) & (radius <= 2 * low)].mean() for low in (0.02, 0.04, 0.08, 0.16)]
    slope = np.polyfit(np.log2((0.02, 0.04, 0.08, 0.16)), np.log2(bands), 1)[0]
    assert -3.5 < slope < -1.0


def test_a_seed_makes_the_same_place_and_another_seed_another():
    first, again, other = (build_scene("castle", seed) for seed in (4, 4, 5))

    def content(world):
        meshes = [part.mesh.position_m.tobytes() for part in world.parts]
        return meshes, [part.material.texture.tobytes() for part in world.parts]

    assert content(first) == content(again)
    assert content(first)[0] != content(other)[0]


def test_an_unknown_scene_is_refused_with_the_nearest_name():
    with pytest.raises(InputError, match="did you mean 'thicket'"):
        build_scene("thickett")
    assert len(scene_names()) == 7


def test_parameters_that_no_scene_takes_are_refused():
    with pytest.raises(InputError, match="takes no parameters"):
        build_scene("garden", parameters={"flowers": 3})
