"""Coherence transport on the GPU against its definition, and what it leaves alone."""

import dataclasses
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back, texture_bytes
from pipeline.inpaint import regions
from pipeline.inpaint.regions import SHELLS, WorkLists
from pipeline.methods.registry import create_method
from pipeline.transport.gpu import TransportPass
from pipeline.transport.reference import LEFT_OUT, UNREACHED, TransportSettings, transport_fill
from tests.twins.work_lists import entries_of, entry_counts, is_of_pass

Z_NEAR_M, SEED = 1.0, 7
ATOL = 2.0**-14  # float32 over a hundred shells: a sixty-fourth of an 8-bit step


def two_grounds(rng, size, width_px=24, *, far_m=20.0) -> WarpedFrame:
    """Stripes at 5 m and others behind, a post that moved in front of both, a hole at the border.

    From gaps in the post no background is seen, and some pixels anywhere are holes.
    """
    height, width = size
    y, x = np.mgrid[:height, :width]
    left = width // 3 + (y // 7) % 3
    post = (x >= left - 8) & (x < left)
    hole = (x >= left) & (x < left + width_px) & (y > 2)
    hole |= (x >= width - 5) & (y > height // 2)
    hole |= (np.abs(x - left + 4) < 2) & (y % 9 < 4)
    hole |= rng.random(size) < 0.03
    hole[0, 0] = False
    stripes = 0.2 * np.sin(0.5 * x + 0.8 * y) + 0.1 * rng.standard_normal(size)
    texture = (0.5 + stripes[..., None] * (1, 0.7, 0.4)).clip(0, 1)
    colour = np.where(post[..., None], (0.9, 0.1, 0.1), texture).astype(np.float32)
    depth_m = np.where(post & ~hole, 2.0, np.where(y < height // 3, far_m, 5.0)).astype(np.float32)
    return WarpedFrame(colour, depth_m, hole, np.zeros((*size, 2), np.float32))


WHOLE = TransportSettings(detail=1.0)
GAZED = TransportSettings(fovea_deg=3, gaze_x_deg=-12, gaze_y_deg=1, detail=1.0)


class Run:
    """A pass with the textures of one frame."""

    def __init__(self, ctx, frame, settings=WHOLE):
        self.frame = frame
        self.fill_pass = TransportPass(ctx, frame.size[::-1], settings)
        self._inputs = FrameTextures.create(ctx, frame.size[::-1])

    def __call__(self):
        self._inputs.upload(self.frame)
        self.fill_pass(self._inputs, z_near_m=Z_NEAR_M, seed=SEED)
        return read_back(self._inputs.colour)

    def release(self):
        for item in (self.fill_pass, self._inputs):
            item.release()


RUNS = {
    "odd": (75, 110, 24, WHOLE),
    "thin": (64, 96, 4, WHOLE),
    "smooth": (64, 96, 24, TransportSettings(detail=0.0)),
    "deep": (24, 300, 190, WHOLE),
    "gazed": (24, 300, 190, GAZED),
}


@pytest.fixture(scope="module", params=RUNS.values(), ids=RUNS)
def run(request, module_gl_context):
    """A filled frame; of odd size, with thin holes, or with one of more shells than are sent."""
    height, width, width_px, settings = request.param
    frame = two_grounds(np.random.default_rng(5), (height, width), width_px)
    made = Run(module_gl_context, frame, settings)
    made.filled = made()
    made.wanted = transport_fill(frame, settings, z_near_m=Z_NEAR_M, seed=SEED)
    yield made
    made.release()


def test_shells_are_the_same(run):
    hole, shell = run.frame.hole, run.wanted.shell
    found = read_back(run.fill_pass.tensors)[hole][:, 3]

    np.testing.assert_array_equal(found, np.where(shell < UNREACHED, shell, 1e9)[hole])
    assert (shell == UNREACHED).any()
    if run.fill_pass.attention is not None:
        assert ((shell == LEFT_OUT) & hole).sum() > hole.sum() / 4
    if run.fill_pass.attention is None and run.frame.size[1] == 300:
        assert shell[shell < UNREACHED].max() > SHELLS


def test_fills_agree(run):
    hole = run.frame.hole

    np.testing.assert_allclose(run.filled[hole][:, :3], run.wanted.colour[hole], rtol=0, atol=ATOL)
    assert np.abs(run.wanted.colour - run.wanted.base)[hole].max() > 0.05


def test_known_pixels_keep_their_bits_and_alpha_stays(run):
    hole = run.frame.hole

    assert run.filled[~hole][:, :3].tobytes() == run.frame.colour[~hole].tobytes()
    np.testing.assert_array_equal(run.filled[..., 3], ~hole)
    assert run.filled[..., :3].min() >= 0
    assert run.filled[..., :3].max() <= 1


def written(item, found):
    """Collect all buffers and textures that a pass writes."""
    if isinstance(item, moderngl.Buffer | moderngl.Texture):
        found[id(item)] = item
    elif isinstance(item, list | tuple | dict):
        for part in item.values() if isinstance(item, dict) else item:
            written(part, found)
    elif is_of_pass(item):
        for part in vars(item).values():
            written(part, found)


def test_nothing_left_in_memory_is_ever_read(run):
    """But that nothing is on a list yet, which each frame leaves as it found it."""
    found = {}
    written(run.fill_pass, found)
    lists, listed = run.fill_pass.lists, run.fill_pass.listed
    for fixed in (lists._packed_regions, lists._region_of_group, listed, run.fill_pass.attention):
        found.pop(id(fixed), None)
    if run.fill_pass.settings.noise.noise:
        found.pop(id(run.fill_pass.detail._noise))
    assert len(found) > 12
    for value in (np.nan, 7.0):
        for item in found.values():
            size = item.size if isinstance(item, moderngl.Buffer) else texture_bytes(item)
            item.write(np.full(size // 4, value, np.float32).tobytes())
        assert run().tobytes() == run.filled.tobytes()
        assert not any(listed.read())


@pytest.mark.parametrize("size", [(1, 2), (2, 1), (5, 3), (40, 1)])
def test_the_smallest_frames_are_filled(gl_context, size):
    hole = np.zeros(size, bool)
    hole[-1, -1] = True
    frame = WarpedFrame(
        np.full((*size, 3), 0.25, np.float32),
        np.full(size, 3.0, np.float32),
        hole,
        np.zeros((*size, 2), np.float32),
    )
    small = Run(gl_context, frame)

    np.testing.assert_allclose(small()[..., :3], 0.25, rtol=0, atol=1e-6)
    small.release()


def test_far_backgrounds_and_holes_without_a_background_are_filled(gl_context, rng):
    """The sky is at infinity; a hole that nothing but a nearer thing borders keeps push-pull."""
    frame = two_grounds(rng, (48, 64), 12, far_m=np.inf)
    nearer = np.full(frame.size, 1.5, np.float32)
    enclosed = dataclasses.replace(
        frame, depth_m=np.where(frame.hole, np.float32(9.0), nearer).astype(np.float32)
    )
    for case in (frame, enclosed):
        one = Run(gl_context, case)
        wanted = transport_fill(case, WHOLE, z_near_m=Z_NEAR_M, seed=SEED).colour
        np.testing.assert_allclose(one()[..., :3], wanted, rtol=0, atol=ATOL)
        one.release()


def test_a_nearest_depth_that_is_none_is_refused(gl_context):
    with pytest.raises(InputError, match="z_near_m must be a depth in metres"):
        create_method("coherence-transport", gl_context, {"z_near_m": -1.0})


def filled_by(ctx, frame, name, **parameters):
    if name == "coherence-transport":
        parameters = {"detail": 0.0} | parameters
    method = create_method(name, ctx, {"z_near_m": Z_NEAR_M, **parameters})
    filled = method.fill(frame, 0)
    method.release()
    return filled


def test_near_the_gaze_transport_fills_and_push_pull_depth_beyond(gl_context, rng):
    frame = two_grounds(rng, (75, 110), 24)
    gaze = {"fovea_deg": 7.0, "gaze_x_deg": -2.0, "gaze_y_deg": -4.0}
    attention = TransportSettings(**gaze).attention(frame.size)
    away, within = attention == 0, attention == 1
    plain = filled_by(gl_context, frame, "push-pull-depth")
    whole = filled_by(gl_context, frame, "coherence-transport")

    found = filled_by(gl_context, frame, "coherence-transport", **gaze)

    np.testing.assert_array_equal(found[away], plain[away])
    np.testing.assert_array_equal(found[within], whole[within])
    assert (whole != plain)[frame.hole & within].any(axis=-1).mean() > 0.5
    wide = filled_by(gl_context, frame, "coherence-transport", **gaze | {"fovea_deg": 90.0})
    assert wide.tobytes() == whole.tobytes()
    off = filled_by(
        gl_context, frame, "coherence-transport", **gaze | {"gaze_x_deg": 80.0, "detail": 1.0}
    )
    assert off.tobytes() == plain.tobytes()


def test_shells_and_their_band_share_one_place_for_each_pixel(gl_context):
    """Frames of 4096 x 4096 px would not fit Mesa's 128 MiB otherwise."""
    sizes = [(90, 70), (45, 35), (23, 18), (12, 9)]
    plain, shelled = (WorkLists(gl_context, sizes, 1, shells=shells) for shells in (False, True))
    counts = 4 * 4 * (SHELLS + 2)  # of each list

    assert shelled.held_bytes == plain.held_bytes + 4 * 90 * 70 + counts
    for lists in (plain, shelled):
        lists.release()


def test_lists_that_a_driver_cannot_take_are_refused_with_its_limit(gl_context, monkeypatch):
    driver = SimpleNamespace(info={"GL_MAX_SHADER_STORAGE_BLOCK_SIZE": 1 << 20})
    check = regions._checked
    monkeypatch.setattr(regions, "_checked", lambda _, *given: check(driver, *given))

    with pytest.raises(
        InputError, match=r"at most 1 MiB on this driver \(got 512x400, which takes"
    ):
        TransportPass(gl_context, (512, 400), WHOLE)


def test_lists_are_read_through_a_copy(gl_context):
    """A graphics card mapped them as they were before the last pass appended to them."""

    class Unread:
        def __init__(self, buffer):
            self._buffer = buffer

        def __getattr__(self, name):
            assert name != "read"
            return getattr(self._buffer, name)

    made = Run(gl_context, two_grounds(np.random.default_rng(5), (24, 300), 190))
    lists = made.fill_pass.lists
    for name in ("_counts", "_entries", "_active"):
        setattr(lists, name, Unread(getattr(lists, name)))
    made()
    assert entry_counts(lists)["holes", 1] > 0
    assert len(entries_of(lists, ("holes", 1))) > 0
    made.release()
