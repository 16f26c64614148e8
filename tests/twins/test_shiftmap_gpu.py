"""A shift-map fill on the GPU against its definition, step by step, and what it leaves alone."""

import dataclasses

import moderngl
import numpy as np
import pytest

from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back, texture_bytes
from pipeline.inpaint.reference import guide_from_depth
from pipeline.shiftmap.base import find_ways, nearer_around, smooth_base
from pipeline.shiftmap.gpu import TILE_BYTES, TILES, ShiftMapPass
from pipeline.shiftmap.reference import lay_detail
from pipeline.shiftmap.settings import ENCODED_STEPS, GUIDE_STEPS, ShiftMapSettings
from pipeline.shiftmap.tiles import SUBPIXELS, Planes, Search, cut_tiles, planes_of, rounded

Z_NEAR_M = 1.0
THRESHOLD = 0.04
ROUNDOFF = 2.0**-24  # of one float32 operation
# Push-pull takes 36 operations a resolution, and frames here have up to 9; the low-pass of its
# means 12 more; ways side by side are averaged over 2 * 64 + 1 at most, each with 3.
BASE_ATOL = (36 * 9 + 12 + 3 * 129) * ROUNDOFF
# From end to end: a sixteenth of an 8-bit step. A tile whose base all but reaches the detail's
# variance takes the root of a small difference.
WHOLE_ATOL = 2.0**-12


def two_grounds(rng, size, width_px=24, *, far_m=20.0) -> WarpedFrame:
    """A ground at 5 m and one behind, a post that moved in front of both, a hole at the border.

    From a narrow gap in the post no ray meets the ground, and from a window only through its frame
    and past what lies far behind.
    """
    height, width = size
    y, x = np.mgrid[:height, :width]
    left = width // 3 + (y // 7) % 3
    post = (x >= left - 6) & (x < left)
    hole = (x >= left) & (x < left + width_px) & (y > 2)
    hole |= (x >= width - 5) & (y > height // 2)
    gap = post & (np.abs(x - left + 3.5) < 1) & (y >= 43) & (y < 45)
    aside, below = np.abs(x - width + 23), np.abs(y - height // 2)
    window = (aside < 5) & (below < 6)
    post |= (aside < 7) & (below < 8) & ~window
    post, hole = post & ~gap, hole | gap | window
    hole[0, 0] = False
    texture = 0.5 + 0.15 * rng.standard_normal((*size, 3)) + 0.1 * np.sin(0.9 * x)[..., None]
    colour = np.where(post[..., None], (0.9, 0.1, 0.1), texture.clip(0, 1)).astype(np.float32)
    far = (y < height // 3) | ((aside < 9) & (below < 10) & ~window)
    depth_m = np.where(post, 2.0, np.where(far, far_m, 5.0)).astype(np.float32)
    # Motion in 256ths of a pixel, as the warp gives it.
    flow_px = np.where(post[..., None], (-float(width_px), 0.0), (2 + 77 / 256, -31 / 256))
    return WarpedFrame(colour, depth_m, hole, flow_px.astype(np.float32))


class Run:
    """A pass with the textures of one frame."""

    def __init__(self, ctx, frame, **settings):
        self.frame, self.settings = frame, ShiftMapSettings(**settings)
        height, width = frame.size
        self.fill_pass = ShiftMapPass(ctx, (width, height), self.settings)
        self._inputs = FrameTextures.create(ctx, (width, height))

    def __call__(self):
        self._inputs.upload(self.frame)
        self.fill_pass(self._inputs, z_near_m=Z_NEAR_M)
        return read_back(self._inputs.colour)

    def made(self, name):
        return read_back(self.fill_pass.textures[name])

    def table(self, tiles):
        """Give what the pass has of tiles of the twin: rows of whole numbers."""
        rows = np.frombuffer(self.fill_pass.tiles.read(), np.int32).reshape(-1, TILE_BYTES // 4)
        return rows[tiles.cell @ (tiles.index.shape[1], 1)]

    def planes(self) -> Planes:
        """Unpack what the search compares; 0 far from holes."""
        x, y = np.moveaxis(self.made("planes").astype(np.int64), -1, 0)
        colour, low = (np.stack([word >> s & 255 for s in (0, 8, 16)], axis=-1) for word in (x, y))
        return Planes(y >> 31 != 0, x >> 24 | (y >> 24 & 127) << 8, colour, low)

    def release(self):
        for item in (self.fill_pass, self._inputs):
            item.release()


@pytest.fixture(scope="module", params=[(75, 110, 24), (64, 96, 4)], ids=["odd", "narrow"])
def run(request, module_gl_context):
    """A filled frame; of odd size with a wide hole, or with one that is not quite thin."""
    height, width, width_px = request.param
    frame = two_grounds(np.random.default_rng(5), (height, width), width_px)
    made = Run(module_gl_context, frame)
    made.filled = made()
    made.guide = guide_from_depth(frame.depth_m, Z_NEAR_M)
    made.ways = find_ways(frame, made.guide, THRESHOLD)
    made.base = smooth_base(frame, made.guide, made.ways, THRESHOLD)
    yield made
    made.release()


def test_ways_lead_to_the_same_ends(run):
    hole = run.frame.hole
    step_x, step_y, steps, across_px = np.moveaxis(run.made("ways")[hole], -1, 0)

    np.testing.assert_array_equal(np.stack([step_y, step_x], axis=-1), run.ways.step)
    np.testing.assert_array_equal(steps, run.ways.steps)
    np.testing.assert_array_equal(across_px, run.ways.across_px)
    assert len(np.unique(run.ways.step, axis=0)) > 1


def test_bases_agree(run):
    hole = run.frame.hole
    found = run.made("base")[hole]

    np.testing.assert_allclose(found[:, :3], run.base.colour[hole], rtol=0, atol=BASE_ATOL)
    np.testing.assert_allclose(found[:, 3], run.base.wide[hole], rtol=0, atol=BASE_ATOL)
    assert 0 < found[:, 3].max() <= 1
    _, share = nearer_around(run.frame, run.ways.pixel[run.ways.steps == 0])
    assert 0 < share.max() < 1


def test_planes_agree_to_one_step(run):
    """Half a step and rounding: a tie may fall either way."""
    frame, base = run.frame, run.base
    wanted = planes_of(frame.hole, run.guide, base.colour, base.half_low)
    found = run.planes()

    assert (found.hole == wanted.hole).all()
    for name, steps in (("guide", GUIDE_STEPS), ("colour", ENCODED_STEPS), ("low", ENCODED_STEPS)):
        off = np.abs(getattr(found, name) - getattr(wanted, name))
        assert off.max() <= 1
        # A value lies so near to a tie by chance in at most this share of pixels, twice over.
        assert (off > 0).mean() <= 4 * steps * BASE_ATOL


def tiles_of(run):
    """Cut the twin's tiles, by guides as the pass packed them."""
    return cut_tiles(run.base.wide > 0, run.planes().guide, run.frame.flow_px, run.ways)


def test_tiles_are_the_same_bit_for_bit(run):
    tiles = tiles_of(run)
    rows = run.table(tiles)

    assert len(tiles.count) > 10
    assert run.fill_pass.lists.entry_counts()[TILES][0] == len(tiles.count)
    assert (rows[:, 0] == tiles.count).all()
    assert (rows[:, 1:3] == tiles.way).all()
    assert (rows[:, [3, 7]] == np.stack([tiles.way_px, tiles.across_px], axis=1)).all()
    corner = rounded(rows[:, 4:6].astype(np.intp), SUBPIXELS * tiles.count[:, None])
    assert (corner == tiles.corner).all()
    assert (rounded(rows[:, 6].astype(np.intp), tiles.count) == tiles.guide).all()


def test_shifts_are_the_same_bit_for_bit(run):
    """All is whole numbers from the packed planes on."""
    tiles = tiles_of(run)
    search = Search(tiles, run.planes(), THRESHOLD)
    first = search.first_shifts()

    wanted = search.agree(first)

    assert (run.table(tiles)[:, [9, 8]] == wanted).all()
    assert (wanted != first).any()


def test_fills_agree_given_the_shifts(run):
    tiles, hole = tiles_of(run), run.frame.hole
    shift = run.table(tiles)[:, [9, 8]].astype(np.intp)

    wanted = lay_detail(run.frame, run.guide, run.base, tiles, shift, run.settings)

    # Blended shares sum to twice the root of their power at most, and source and low-pass are off.
    detail = np.where((run.base.wide > 0)[..., None], run.made("detail")[..., :3], 0.0)
    np.testing.assert_allclose(detail, wanted.detail, rtol=0, atol=2 * 2 * BASE_ATOL)
    np.testing.assert_allclose(
        run.filled[hole][:, :3], wanted.colour[hole], rtol=0, atol=WHOLE_ATOL
    )
    assert wanted.gain.max() > 0.3


def test_known_pixels_keep_their_bits_and_alpha_stays(run):
    hole = run.frame.hole

    assert run.filled[~hole][:, :3].tobytes() == run.frame.colour[~hole].tobytes()
    np.testing.assert_array_equal(run.filled[..., 3], ~hole)
    assert run.filled[..., :3].min() >= 0
    assert run.filled[..., :3].max() <= 1


def written(item, found):
    """Collect all buffers and textures that a pass writes, but what is written once and for all."""
    if isinstance(item, moderngl.Buffer | moderngl.Texture):
        found[id(item)] = item
    elif isinstance(item, list | tuple | dict):
        for part in item.values() if isinstance(item, dict) else item:
            written(part, found)
    elif type(item).__module__.startswith("pipeline."):
        for part in vars(item).values():
            written(part, found)


def test_nothing_left_in_memory_is_ever_read(run):
    found = {}
    written(run.fill_pass, found)
    lists = run.fill_pass.lists
    for fixed in (lists._packed_regions, lists._region_of_group):
        del found[id(fixed)]
    assert len(found) > 12
    for value in (np.nan, 7.0):
        for item in found.values():
            size = item.size if isinstance(item, moderngl.Buffer) else texture_bytes(item)
            item.write(np.full(size // 4, value, np.float32).tobytes())
        assert run().tobytes() == run.filled.tobytes()


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

    assert (small()[..., :3] == 0.25).all()
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
        filled = one()[..., :3]
        one.release()
        assert np.isfinite(filled).all()
