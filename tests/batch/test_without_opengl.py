"""Work without OpenGL 4.3, as on macOS: numpy makes what is made of photographs."""

import os
import subprocess

import forked
import numpy as np
import pytest
from built_study import write_small_study
from PIL import Image

from pipeline.errors import GLUnavailableError
from pipeline.methods.registry import create_method
from pipeline.warp.reference import warp
from protocols.manifest import read_manifest
from stimuli.media.png import decode_png
from stimuli.worker import NUMPY

OURS = (
    "metameric", "metameric-paper", "coherence-transport", "push-pull-depth", "push-pull",
    "weighted-pull-push",
)  # fmt: skip


def run(folder, *arguments, gl: bool) -> subprocess.CompletedProcess[str]:
    hidden = {} if gl else {"MESA_GL_VERSION_OVERRIDE": "4.1"}
    return forked.run(*arguments, folder=folder, env={**os.environ, **hidden})


@pytest.mark.parametrize("name", OURS)
def test_a_method_without_a_gpu_fills_as_on_one(disc_over_plane, gl_context, name):
    flow_px = np.zeros((*disc_over_plane.size, 2), np.float32)
    flow_px[..., 0] = 12 / disc_over_plane.depth_m
    warped = warp(disc_over_plane, flow_px)
    assert warped.hole.any()
    on_gpu, in_numpy = create_method(name, gl_context), create_method(name, None)
    try:
        wanted, found = on_gpu.fill(warped, 3), in_numpy.fill(warped, 3)
    finally:
        on_gpu.release()
        in_numpy.release()

    np.testing.assert_array_equal(found[~warped.hole], warped.colour[~warped.hole])
    assert found.dtype == np.float32
    assert np.abs(found - wanted).max() < 1 / 255


def test_parameters_reach_the_twin(disc_over_plane):
    flow_px = np.zeros((*disc_over_plane.size, 2), np.float32)
    flow_px[..., 0] = 12 / disc_over_plane.depth_m
    warped = warp(disc_over_plane, flow_px)
    still, noisy = (
        create_method("metameric", None, {"noise": noise}).fill(warped, 3) for noise in (0.0, 1.0)
    )

    assert not np.array_equal(still, noisy)


@pytest.mark.slow
def test_photographs_with_depth_are_built_alike_with_and_without_opengl(tmp_path):
    path = write_small_study(tmp_path)
    text = path.read_text().replace('"box"', '"motorcycle"')
    begin = text.index("[[stimuli.scenes]]")
    text = text[:begin] + text[text.index("[[stimuli.scenes]]", begin + 1) :]
    text = text.replace('"push-pull"', '"coherence-transport"').replace('"telea"', '"metameric"')
    path.write_text(text)
    for name, gl in (("drawn", True), ("counted", False)):
        done = run(tmp_path, "stimuli", "build", path, "--out", name, "--workers", 1, gl=gl)
        assert done.returncode == 0, done.stderr
        assert ("numpy works instead, up to 30 times slower" in done.stdout) == (not gl)

    drawn, counted = (read_manifest(tmp_path / name) for name in ("drawn", "counted"))
    assert counted.renderer.renderer == NUMPY.renderer != drawn.renderer.renderer
    assert [clip.name for clip in counted.clips] == [clip.name for clip in drawn.clips]
    differ = [
        np.abs(decode_png(tmp_path / "drawn" / clip.frame_path(k)).astype(int)
               - decode_png(tmp_path / "counted" / clip.frame_path(k)))
        for clip in drawn.clips for k in range(len(clip.frames_sha256))
    ]  # fmt: skip
    assert len(differ) > 4
    assert max(one.max() for one in differ) <= 1


@pytest.mark.slow
def test_a_scene_that_must_be_drawn_is_refused_without_opengl(tmp_path):
    path = write_small_study(tmp_path)

    done = run(tmp_path, "stimuli", "build", path, "--out", "clips", "--workers", 1, gl=False)

    assert done.returncode == 2
    assert "scene 'box' is drawn, for which OpenGL 4.3 is needed" in done.stderr
    assert "take photographs with depth" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_one_picture_is_foveated_without_opengl(tmp_path, rng):
    Image.fromarray(rng.integers(0, 256, (96, 128, 3), np.uint8)).save(tmp_path / "small.png")
    for gl in (True, False):
        done = run(tmp_path, "foveate", "small.png", f"{gl}.png", "--method", "metamer", gl=gl)
        assert done.returncode == 0, done.stderr
        assert ("numpy works instead" in done.stdout) == (not gl)

    drawn, counted = (decode_png(tmp_path / f"{gl}.png").astype(int) for gl in (True, False))
    assert np.abs(drawn - counted).max() <= 1


def test_a_plug_in_without_a_twin_says_that_it_needs_opengl(monkeypatch):
    class Drawn:
        def __init__(self, ctx) -> None:
            self.ctx = ctx

        def fill(self, _warped, _seed):
            raise AssertionError

        def release(self) -> None:
            pass

    monkeypatch.setattr("pipeline.named_classes.NamedClass.load", lambda _self: Drawn)
    with pytest.raises(GLUnavailableError, match="needs an OpenGL context"):
        create_method("telea", None)


@pytest.mark.slow
def test_a_study_that_follows_the_gaze_is_told_that_it_cannot_run_here(tmp_path):
    said = [run(tmp_path, "protocol", "check", "live-preference", gl=gl) for gl in (True, False)]

    assert [done.returncode for done in said] == [0, 0]
    assert ["sessions cannot run on this machine" in done.stdout for done in said] == [False, True]
