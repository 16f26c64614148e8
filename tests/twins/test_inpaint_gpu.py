"""Guided pull and push on the GPU against its definition, and the lists it works through."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.gl import passes
from pipeline.gl.texture import create_texture, read_back, texture_from
from pipeline.inpaint.gpu import GuidedBasePass, ResolutionSizes
from pipeline.inpaint.reference import guide_from_depth, guided_base, near_a_hole
from pipeline.inpaint.regions import (
    CELL,
    FIRST_STORED,
    RING_REACH,
    SOURCE_RINGS,
    STATISTICS_RINGS,
    source_resolution,
)
from tests.twins.work_lists import entries_of, entry_counts, read_numbers

ROUNDOFF = 2.0**-24  # of one float32 operation
THRESHOLD = 0.04
Z_NEAR_M = 1.0
SIZES = [(1, 1), (1, 2), (1, 40), (33, 1), (2, 2), (7, 5), (64, 48), (61, 83), (301, 40), (37, 530)]
# Roundings of validity ** gamma: GLSL builds sqrt from inversesqrt (2 ulp) and a division
# (2.5 ulp), which the second root halves; pow from log2 (3 ulp of at most 24) and exp2.
KEPT = {0.0: 0, 0.25: 14, 0.5: 9, 0.6: 240, 1.0: 0}
GUIDE_ATOL = (5 + 1) * ROUNDOFF


def active_tiles(lists, key):
    """Tiles of a region that were in it in the last frame: bool (rows, columns)."""
    item = lists._regions[key]
    flags = read_numbers(lists, lists._active)[item.first : item.first + item.tiles]
    return flags.reshape(-1, -(-lists.sizes[item.resolution][0] // CELL)) != 0


def tolerance(size, gamma):
    """Bound the base's error, absolute, for colours in [0, 1].

    Validities are multiples of 4^-level and exact. Pull: shares (5), a product and three
    sums: 9. Push: the same, 1 for the difference to 1, 2 products, a sum, and the error of
    what is kept times a difference of at most 1: 13 and `KEPT`. Two halves of a relaxation: as much
    each.
    """
    levels = max(1, int(np.ceil(np.log2(max(size)))))
    return (9 + 3 * (13 + KEPT[gamma])) * levels * ROUNDOFF


def random_scene(rng, size, hole_share=0.3):
    """Give colour, hole and depth: three depths far apart, in patches, holes in patches too."""
    height, width = size
    colour = rng.random((height, width, 3), np.float32)

    def patches(edge):
        coarse = rng.random((-(-height // edge), -(-width // edge)))
        return coarse.repeat(edge, 0).repeat(edge, 1)[:height, :width]

    hole = patches(5) < hole_share
    hole[rng.integers(height), rng.integers(width)] = False
    depth = np.choose((patches(7) * 3).astype(int), [1.25, 2.5, np.inf]).astype(np.float32)
    return colour, hole, depth


def with_alpha(colour, hole):
    return np.concatenate([colour, ~hole[..., None]], axis=-1).astype(np.float32)


class Filled:
    """A pass that has run once on a scene, what it gave, and its texels."""

    def __init__(self, ctx, scene, *, levels=1, gamma=0.25):
        colour, hole, depth = scene
        size = (hole.shape[1], hole.shape[0])
        self.base = GuidedBasePass(ctx, size, levels=levels, gamma=gamma, depth_threshold=THRESHOLD)
        image = texture_from(ctx, with_alpha(colour, hole), "rgba32f")
        depth_m = texture_from(ctx, depth, "r32f")
        self.base(image, depth_m, Z_NEAR_M)
        self.image = read_back(image)
        image.release()
        depth_m.release()

    def texels(self, resolution):
        width, height = self.base.resolutions.sizes[resolution]
        found = np.frombuffer(self.base.chain.at(resolution).read(), np.float32)
        return found.reshape(height, width, 4)

    def guide(self, resolution):
        width, height = self.base.resolutions.sizes[resolution]
        found = np.frombuffer(self.base.guide.at(resolution).read(), np.float32)
        return found.reshape(height, width)


@pytest.fixture(params=[True, False], ids=["on a processor", "on a card"])
def any_variant(request, monkeypatch):
    """Compile the shaders of either kind of renderer: both are twins of one reference."""
    monkeypatch.setattr(passes, "describe", lambda _: SimpleNamespace(software=request.param))


@pytest.fixture
def fill(gl_context):
    """Give a function that fills a scene; its passes are released after the test."""
    made = []

    def run(scene, **settings):
        made.append(Filled(gl_context, scene, **settings))
        return made[-1]

    yield run
    for filled in made:
        filled.base.release()


def expected(scene, *, levels=1, gamma=0.25):
    colour, hole, depth = scene
    guide = guide_from_depth(depth, Z_NEAR_M)
    return guided_base(colour, hole, guide, levels=levels, gamma=gamma, threshold=THRESHOLD)


@pytest.mark.parametrize("size", SIZES)
def test_base_on_gpu_matches_reference(fill, rng, size):
    """Also the sizes of a single row, odd ones, and those whose cells lie far apart."""
    scene = random_scene(rng, size)
    hole = scene[1]

    filled = fill(scene).image

    np.testing.assert_allclose(
        filled[hole][:, :3], expected(scene)[0].values[hole], rtol=0, atol=tolerance(size, 0.25)
    )
    np.testing.assert_array_equal(filled[..., 3], ~hole)  # alpha stays
    assert filled[~hole].tobytes() == with_alpha(*scene[:2])[~hole].tobytes()


@pytest.mark.parametrize("gamma", KEPT)
def test_every_gamma_matches_reference(fill, rng, gamma):
    scene = random_scene(rng, (75, 90), hole_share=0.7)

    filled = fill(scene, gamma=gamma).image[scene[1]][:, :3]

    np.testing.assert_allclose(
        filled,
        expected(scene, gamma=gamma)[0].values[scene[1]],
        rtol=0,
        atol=tolerance((75, 90), gamma),
    )


@pytest.mark.parametrize("levels", [1, 4, 6])
def test_base_resolutions_match_reference(fill, rng, levels):
    """Read back every dispatched resolution: validity exact, guide and values within bounds."""
    size = (300, 400)
    scene = random_scene(rng, size, hole_share=0.02)
    source = source_resolution(levels)
    near = near_a_hole(scene[1], source, SOURCE_RINGS, source)

    filled = fill(scene, levels=levels)

    for resolution, level in enumerate(expected(scene, levels=levels)):
        if not 1 <= resolution <= filled.base.resolutions.top:
            continue
        step = 1 << resolution
        inside = near[::step, ::step]
        texels = filled.texels(resolution)
        np.testing.assert_array_equal(texels[..., 3][inside], level.validity[inside])
        np.testing.assert_allclose(
            filled.guide(resolution)[inside], level.guide[inside], rtol=0, atol=GUIDE_ATOL
        )
        sure = inside & (level.validity >= 1)
        np.testing.assert_allclose(
            texels[..., :3][sure], level.values[sure], rtol=0, atol=tolerance(size, 0.25)
        )


def test_an_image_of_foreground_alone_is_filled_with_it_on_the_gpu(fill, rng):
    """The last resort: all that is known lies in front of the holes."""
    colour, hole, _ = random_scene(rng, (40, 56))
    scene = (colour, hole, np.where(hole, np.float32(9), np.float32(1.5)))

    filled = fill(scene).image

    np.testing.assert_allclose(
        filled[hole][:, :3], expected(scene)[0].values[hole], rtol=0, atol=tolerance((40, 56), 0.25)
    )


def test_what_lies_beyond_the_depth_of_a_hole_s_neighbours_is_still_reached(fill, rng):
    """A hole of its own depth, between the known ones: farther colour before none."""
    colour, hole, depth = random_scene(rng, (64, 64))
    depth[hole & (rng.random(hole.shape) < 0.2)] = 1.6
    scene = (colour, hole, depth)

    filled = fill(scene).image

    np.testing.assert_allclose(
        filled[hole][:, :3], expected(scene)[0].values[hole], rtol=0, atol=tolerance((64, 64), 0.25)
    )


def test_a_constant_stays_the_same_bits(fill, rng):
    """Only for values whose multiples are exact: 0.25 needs no rounding anywhere."""
    _, hole, depth = random_scene(rng, (50, 60))
    colour = np.full((50, 60, 3), 0.25, np.float32)

    filled = fill((colour, hole, depth)).image[..., :3]

    np.testing.assert_allclose(filled, 0.25, rtol=0, atol=tolerance((50, 60), 0.25))


def test_no_hole_changes_nothing(fill, rng):
    colour, hole, depth = random_scene(rng, (50, 60))
    hole[:] = False

    filled = fill((colour, hole, depth)).image

    assert filled.tobytes() == with_alpha(colour, hole).tobytes()


@pytest.mark.usefixtures("any_variant")
@pytest.mark.parametrize("levels", [1, 3, 6])
@pytest.mark.parametrize("size", [(1, 1), (20, 1600), (300, 410)])
def test_lists_of_tiles_are_what_the_reference_calls_near(fill, rng, size, levels):
    hole = np.zeros(size, bool)
    for _ in range(2):
        hole[rng.integers(size[0]), rng.integers(size[1])] = True
    hole[0, 0] = False
    scene = (np.zeros((*size, 3), np.float32), hole, np.ones(size, np.float32))

    base = fill(scene, levels=levels).base

    source = source_resolution(levels)
    for resolution in range(1, base.resolutions.top + 1):
        tile = CELL << resolution
        wanted = {("source", resolution): near_a_hole(hole, source, SOURCE_RINGS, resolution)}
        for level in range(min(resolution, levels)):
            if level != resolution - FIRST_STORED:
                key = ("chain", level, resolution)
                wanted[key] = near_a_hole(hole, level, STATISTICS_RINGS, resolution)
        for key, near in wanted.items():
            tiles = near[::tile, ::tile]
            np.testing.assert_array_equal(active_tiles(base.lists, key), tiles, err_msg=str(key))
            own = {"source": 0, "chain": resolution - 1}[key[0]]
            if key in (("source", resolution), ("chain", own, resolution)):
                name = key if key[0] == "source" else ("first", own)
                assert listed(base, name) == {(*tile, own) for tile in places(tiles)}
        pulled = range(min(max(0, resolution - FIRST_STORED), levels))
        widest = resolution - RING_REACH
        near = near_a_hole(hole, source, SOURCE_RINGS, resolution)
        if widest < levels:
            near = near_a_hole(hole, max(0, widest), STATISTICS_RINGS, resolution)
        assert listed(base, ("pulled", resolution)) == {
            (*tile, chain) for tile in places(near[::tile, ::tile]) for chain in pulled
        }


def places(mask):
    return {(int(row), int(column)) for row, column in np.argwhere(mask)}


def listed(base, key):
    """Give the entries of a list, of which there must be none twice."""
    entries = entries_of(base.lists, key)
    found = {tuple(int(part) for part in entry) for entry in entries}
    assert len(found) == len(entries)
    return found


@pytest.mark.usefixtures("any_variant")
def test_the_list_of_holes_holds_every_block_with_a_hole_once(fill, rng):
    scene = random_scene(rng, (31, 46))

    base = fill(scene).base

    padded = np.pad(scene[1], ((0, 1), (0, 0)))
    blocks = padded.reshape(16, 2, 23, 2).any(axis=(1, 3))
    assert listed(base, ("holes", 1)) == {(*place, 0) for place in places(blocks)}


@pytest.mark.usefixtures("any_variant")
def test_a_list_has_as_many_work_groups_as_its_entries_need(fill, rng):
    """Appended one by one or four at once, by pixel 64 to a group and by tile one or four."""
    lists = fill(random_scene(rng, (190, 210), 0.1), levels=4).base.lists

    groups = np.frombuffer(lists._counts.read(), np.uint32).reshape(-1, 4)[:, :3]
    per_group = {"holes": 64, "base": 64, "source": 1, "first": 4, "pulled": 1}
    seen = 0
    for (key, entries), (x, y, z) in zip(entry_counts(lists).items(), groups, strict=True):
        if key[0] in per_group:
            assert (x, y, z) == (-(-entries // per_group[key[0]]), 1, 1), key
            seen += entries > 64
    assert seen > 5


@pytest.mark.slow
@pytest.mark.usefixtures("any_variant")
def test_more_holes_than_work_groups_in_a_row(fill):
    """32 769 groups of 64 blocks, one block in the last: a second row of groups must fill it."""
    size = (2050, 4096)
    hole = np.ones(size, bool)
    hole[0, 0] = hole[2048:] = False
    hole[-1, -1] = True
    colour = np.full((*size, 3), 0.3, np.float32)
    scene = (np.where(hole[..., None], 0, colour), hole, np.full(size, 2, np.float32))

    filled = fill(scene)

    assert entry_counts(filled.base.lists)[("holes", 1)] == 64 * 32768 + 1
    np.testing.assert_allclose(filled.image[..., :3], colour, rtol=0, atol=tolerance(size, 0.25))


def test_a_pass_forgets_the_frame_before(fill, gl_context, rng):
    """One pass over two frames gives what each gets from a pass of its own."""
    scenes = [random_scene(rng, (90, 70), share) for share in (0.6, 0.05)]
    filled = fill(scenes[0])
    image = texture_from(gl_context, with_alpha(*scenes[1][:2]), "rgba32f")
    depth_m = texture_from(gl_context, scenes[1][2], "r32f")

    filled.base(image, depth_m, Z_NEAR_M)
    second = read_back(image)
    image.release()
    depth_m.release()

    assert second.tobytes() == fill(scenes[1]).image.tobytes()


@pytest.mark.parametrize("argument", ["image", "depth_m"])
def test_textures_of_another_size_are_refused(gl_context, argument):
    base = GuidedBasePass(gl_context, (8, 9), gamma=0.25)
    textures = {
        "image": create_texture(gl_context, (8, 9), "rgba32f"),
        "depth_m": create_texture(gl_context, (8, 9), "r32f"),
    }
    wrong = create_texture(gl_context, (9, 8), "rgba32f" if argument == "image" else "r32f")

    with pytest.raises(InputError, match=rf"^{argument} must be 8x9"):
        base(**(textures | {argument: wrong}), z_near_m=1.0)
    for thing in (base, wrong, *textures.values()):
        thing.release()


def test_a_size_no_texture_can_have_is_refused(gl_context):
    with pytest.raises(InputError, match="texture edges must lie in"):
        GuidedBasePass(gl_context, (0, 4), gamma=0.25)


@pytest.mark.parametrize("size", [(16385, 4), (4, 20000)])
def test_a_frame_larger_than_its_lists_lead_is_refused(size):
    with pytest.raises(InputError, match=rf"at most 16384 px wide and high \(got {size[0]}x"):
        ResolutionSizes(size, 4)
