"""Metameric inpainting on the GPU against its definition, stage by stage and as a whole."""

import dataclasses

import moderngl
import numpy as np
import pytest
from scipy import ndimage

from pipeline.camera import Camera, flow_between, reprojection
from pipeline.colour import RGB_FROM_YCBCR, ycbcr_from_rgb
from pipeline.errors import InputError
from pipeline.features.reference import analyse, grow, spoiled_levels
from pipeline.frame import SourceFrame, WarpedFrame
from pipeline.gl.texture import create_texture, read_back, texture_bytes, texture_from, upload
from pipeline.inpaint.reference import (
    Level,
    children,
    guide_from_depth,
    guided_base,
    near_a_hole,
    pull,
    pull_push,
    push,
)
from pipeline.inpaint.region import STATISTICS_RINGS
from pipeline.noise.mixing import fitted_mixing
from pipeline.noise.tile import TEXELS_PER_PX, noise_bands
from pipeline.statistics.lacking import known_background, noise_variances
from pipeline.statistics.moments import moments
from pipeline.statistics.reference import outlined_levels
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.reference import (
    deviations,
    metameric_fill,
    sample,
    shaped_noise,
)
from pipeline.synthesis.settings import MetamericSettings
from pipeline.warp.gpu import warp_frame
from pipeline.warp.reference import warp

Z_NEAR_M = 1.0
THRESHOLD = MetamericSettings().depth_threshold
ROUNDOFF = 2.0**-24  # of one float32 operation
# Roundings, counted in docs/precision.md.
GUIDED = 9 + 13 + 14  # of one pull and push, gamma from 0, 0.25, 0.5, 1
LOW_BAND = 9  # of one level
BAND = 11  # of a coefficient from its 3x3 colours
SHARES = 9  # of a guided interpolation
LOOK_UP = 40  # of noise between texels, with its gain
LARGEST_GAIN, GAIN_SLOPE = 1.4, 0.6  # over all of mixing.json; the latter per texel of an axis
# From end to end: a sixteenth of an 8-bit step. A band whose variance the base has all but
# reached is the root of a small difference, whose error no count of roundings keeps small.
WHOLE_ATOL = 2.0**-12


def disc_scene(rng, size, *, inf_background=False):
    """Make noise behind a disc that moved, with two holes; flow in 256ths of a pixel."""
    height, width = size
    y, x = np.mgrid[:height, :width] + 0.5
    radius = max(1.0, 0.25 * min(size))
    disc = np.hypot(x - 0.4 * width, y - 0.5 * height) < radius
    was = np.hypot(x - 0.4 * width - 0.6 * radius, y - 0.5 * height) < radius
    hole = (was & ~disc) | ((x > 0.9 * width) & (y < 0.3 * height))
    hole[0, 0] = False
    if not hole.any() and hole.size > 1:
        hole[-1, -1] = True
    texture = 0.5 + 0.12 * rng.standard_normal((height, width, 3))
    texture += 0.1 * np.sin(0.7 * x + 0.4 * y)[..., None] * [1.0, 0.7, 0.2]
    colour = np.where(disc[..., None], [0.9, 0.1, 0.1], texture.clip(0, 1))
    background = np.inf if inf_background else 5.0
    flow = np.where(disc[..., None], [13.0, 0.0], [4 + 77 / 256, -2 - 31 / 256])
    return WarpedFrame(
        colour.astype(np.float32),
        np.where(disc, 2.0, background).astype(np.float32),
        hole,
        flow.astype(np.float32),
    )


def cameras(size):
    """Give the matrix of a target camera beside and turned a little from its source."""
    source = Camera.with_field_of_view(size[1], size[0], 50)
    target = source.moved(np.array([0.11, -0.07, 0.05]))
    pose = target.world_from_camera.copy()
    angle = 0.03
    turn = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    pose[:3, :3] = pose[:3, :3] @ turn
    return reprojection(source, dataclasses.replace(target, world_from_camera=pose))


class Run:
    """A pass with the textures of one frame; fills as often as it is called."""

    def __init__(self, ctx, frame, settings):
        self.frame, self.settings = frame, settings
        height, width = frame.size
        self.fill_pass = MetamericPass(ctx, (width, height), settings)
        self._image = create_texture(ctx, (width, height), "rgba32f")
        self._depth_m = create_texture(ctx, (width, height), "r32f")
        self._flow_px = create_texture(ctx, (width, height), "rg32f")
        self.matrix = cameras(frame.size) if settings.anchor == "camera" else None

    def load(self, frame=None):
        frame = frame or self.frame
        alpha = ~frame.hole[..., None]
        upload(self._image, np.concatenate([frame.colour, alpha], -1, dtype=np.float32))
        upload(self._depth_m, frame.depth_m)
        upload(self._flow_px, frame.flow_px)

    def call(self, seed=3):
        self.fill_pass(
            self._image,
            self._depth_m,
            self._flow_px,
            z_near_m=Z_NEAR_M,
            seed=seed,
            source_from_target=self.matrix,
        )

    def __call__(self, frame=None, seed=3):
        self.load(frame)
        self.call(seed)
        return read_back(self._image)

    def reference(self, seed=3, **changes):
        return metameric_fill(
            self.frame,
            dataclasses.replace(self.settings, **changes),
            seed=seed,
            z_near_m=Z_NEAR_M,
            source_from_target=self.matrix,
        )

    def fixed(self):
        """Give what is written once and for all."""
        lists = self.fill_pass.base.lists
        own = self.fill_pass
        return own._noise, lists._packed_regions, lists._region_of_group

    def buffers(self):
        """Give all buffers and textures that the pass writes, for poisoning."""
        pending, found = [self.fill_pass], []
        while pending:
            item = pending.pop()
            if isinstance(item, moderngl.Buffer | moderngl.Texture):
                found += [] if any(item is one for one in (*self.fixed(), *found)) else [item]
            elif isinstance(item, list | tuple):
                pending += item
            elif isinstance(item, dict):
                pending += item.values()
            elif type(item).__module__.startswith("pipeline."):
                pending += vars(item).values()
        return found

    def release(self):
        for thing in (self.fill_pass, self._image, self._depth_m, self._flow_px):
            thing.release()


@pytest.fixture
def prepare(gl_context):
    """Give a function that builds a run; all are released after the test."""
    runs = []

    def build(frame, **settings):
        runs.append(Run(gl_context, frame, MetamericSettings(**settings)))
        return runs[-1]

    yield build
    for run in runs:
        run.release()


def moment_tolerances(run, fill, k):
    """Bound mean and second moment of level k, absolute, by the magnitudes of this frame."""
    resolutions = max(1, int(np.ceil(np.log2(max(run.frame.size)))))
    largest = np.abs(analyse(ycbcr_from_rgb(fill.base), k + 1).bands[k]).max()
    base = GUIDED * resolutions * ROUNDOFF
    # Taps' magnitudes sum to 0.733 at most, and each difference has two colours.
    band = 2 * 0.733 * (base + LOW_BAND * k * ROUNDOFF) + BAND * 0.733 * ROUNDOFF
    mean = band + GUIDED * resolutions * largest * ROUNDOFF
    second = 2 * largest * band + (1 + GUIDED * resolutions) * largest**2 * ROUNDOFF
    return mean, second


def variance_tolerance(bands, variance):
    """Bound a variance made from given moments and colours, absolute.

    Its terms and those of the base's energy, measured or a share of it, are at most
    (2 x largest)^2 and cost 11 roundings: of a share a division and a mix, of a variance two,
    their product and difference. A coefficient's own error, BAND, counts twice its
    size twice.
    """
    largest = np.abs(bands).max()
    off = (11 * (2 * largest) ** 2 + 2 * (2 * largest) * BAND * 0.733) * ROUNDOFF
    return off + 20 * variance * ROUNDOFF


def noise_tolerance(run, lacking, guide, anchor_px):
    """Bound the colour that given variances and base lead to, absolute: (H, W, 3).

    Interpolation of variances costs SHARES and 4 roundings, their root half of it and 4 of its
    own. Luma's are positive. Chroma's may cancel, so
    their magnitudes count. Where a place is off, so are noise, by what neighbouring texels differ
    along both axes, and its gain.
    """
    settings = run.settings
    cross = settings.channels == "correlated"
    noise = noise_bands(3, settings.levels, 1 if cross else 3)
    farthest_px = np.abs(anchor_px).max() + max(run.frame.size)
    moved_px = ROUNDOFF * farthest_px * (16 if settings.anchor == "camera" else 1)
    total = np.zeros((*run.frame.size, 3))
    for k, level in enumerate(lacking):
        tile = noise.tiles[k].astype(np.float64)
        tallest = np.abs(tile).max()
        step = max(np.abs(tile - np.roll(tile, 1, axis)).max() for axis in (1, 2))
        slope = 2 * TEXELS_PER_PX * (LARGEST_GAIN * step + GAIN_SLOPE * tallest)
        size = Level(np.abs(level.values), level.validity, level.guide)
        here = sample(size, guide, k + 1, settings.depth_threshold)
        here = deviations(here.reshape(*run.frame.size, 3, 3), cross=cross)
        roundings = LOOK_UP + SHARES + 10
        off = roundings * ROUNDOFF * LARGEST_GAIN * tallest + slope * moved_px
        total += off * here.sum(axis=2)
    return (settings.noise * total + 8 * ROUNDOFF) @ np.abs(RGB_FROM_YCBCR).T


def test_the_look_up_s_gain_is_within_what_the_tolerance_says():
    """From texel to texel, every hundredth: the gain of `look_up`, and how it changes."""
    x = np.linspace(0, 1, 101)
    y = x[:, None]
    a, b, c, d = (1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y
    for levels in range(1, 7):
        lag = fitted_mixing(levels).lag_correlation.reshape(-1, 4, 1, 1).astype(np.float64)
        pairs = (a * b + c * d, a * c + b * d, a * d, b * c)
        twice = 2 * sum(lag[:, index] * pair for index, pair in enumerate(pairs))
        gain = 1 / np.sqrt(a * a + b * b + c * c + d * d + twice)
        assert 1.2 < gain.max() < LARGEST_GAIN
        assert (
            0.4 < 100 * max(np.abs(np.diff(gain, axis=axis)).max() for axis in (1, 2)) < GAIN_SLOPE
        )


def needed(hole, k):
    """Tell which texels of level k's half the interpolation at hole pixels reaches."""
    wanted = np.zeros([-(-edge // (2 << k)) for edge in hole.shape], bool)
    rows, columns = np.nonzero(hole)
    first = [np.floor((axis + 0.5) / (2 << k) - 0.5).astype(int) for axis in (rows, columns)]
    for down in (0, 1):
        for right in (0, 1):
            wanted[
                np.clip(first[0] + down, 0, wanted.shape[0] - 1),
                np.clip(first[1] + right, 0, wanted.shape[1] - 1),
            ] = True
    return wanted


def decided_by_threshold(run, fill, margin=12 * ROUNDOFF):
    """Tell where moving the threshold by less than what a step of the guide is off matters.

    By default that is two guides, 6 roundings each. The reference is exact to 2^-52, so a pixel
    that no such decision reaches keeps its bits.
    """
    threshold = run.settings.depth_threshold
    others = [
        run.reference(depth_threshold=threshold + shift).colour for shift in (-margin, margin)
    ]
    return np.any([(other != fill.colour).any(axis=-1) for other in others], axis=0)


def close_enough(run, filled, fill, share=1e-3):
    """Assert that every hole pixel is within the bound, but for a share of the frame.

    Each of those must be a threshold decision: see `decided_by_threshold`.
    """
    hole = run.frame.hole
    off = hole & ~(np.abs(filled[..., :3] - fill.colour) <= WHOLE_ATOL).all(axis=-1)
    if off.any():
        assert off.sum() <= share * hole.size
        assert decided_by_threshold(run, fill)[off].all()
    assert filled[~hole][:, :3].tobytes() == run.frame.colour[~hole].tobytes()
    np.testing.assert_array_equal(filled[..., 3], ~hole)


SIZES = [(1, 2), (1, 70), (53, 1), (2, 2), (7, 5), (48, 64), (61, 83), (90, 301)]


@pytest.mark.parametrize("size", SIZES)
def test_fill_on_gpu_matches_reference(prepare, rng, size):
    run = prepare(disc_scene(rng, size))

    close_enough(run, run(), run.reference())


@pytest.mark.parametrize(
    "settings",
    [
        {"levels": 1},
        {"levels": 3, "gamma": 0.0},
        {"levels": 3, "channels": "independent", "skip_depth_edges": False},
        {"levels": 5, "gamma": 1.0, "anchor": "screen"},
        {"levels": 6, "gamma": 0.5, "channels": "independent"},
        {"anchor": "camera"},
        {"anchor": "camera", "channels": "independent", "noise": 0.5},
        {"anchor": "screen", "skip_depth_edges": False},
        {"noise": 0.0},
        {"depth_threshold": 1.0},
    ],
    ids=lambda settings: ",".join(f"{key}={value}" for key, value in settings.items()),
)
def test_every_setting_matches_reference(prepare, rng, settings):
    run = prepare(disc_scene(rng, (75, 90)), **settings)

    close_enough(run, run(), run.reference())


def random_scene(rng):
    """Any holes before, beside and behind any depths, of any size up to 90 px, soft or sharp."""
    height, width = (int(rng.integers(1, 1 << rng.integers(1, 7))) for _ in range(2))
    height, width = height + int(rng.integers(28)), width + int(rng.integers(28))
    x, y = np.arange(width), np.arange(height)[:, None]
    depth = 1 + 6 / (1 + rng.choice([0, 0.1, 0.3]) * x + rng.choice([0, 0.1, 0.3]) * y)
    hole = rng.random((height, width)) < rng.choice([0, 0.02, 0.3])
    for array, values in ((depth, (1.0, 1.5, 2.0, 5.0, 30.0, np.inf)), (hole, (True,))):
        for _ in range(rng.integers(1, 6)):
            top, left = rng.integers(height), rng.integers(width)
            below, right = top + 1 + rng.integers(height), left + 1 + rng.integers(width // 2 + 1)
            array[top:below, left:right] = rng.choice(values)
    hole[rng.integers(height), rng.integers(width)] = False
    flow = np.broadcast_to(rng.integers(-2000, 2000, 2) / 256, (height, width, 2))
    colour = rng.random((height, width, 3), np.float32)
    if rng.random() < 0.5:
        colour = ndimage.gaussian_filter(colour, (1.2, 1.2, 0))
    return WarpedFrame(
        colour,
        depth.astype(np.float32),
        hole,
        flow.astype(np.float32),
    )


@pytest.mark.parametrize("seed", range(24))
def test_any_holes_and_depths_match_reference(prepare, seed):
    rng = np.random.default_rng(seed)
    run = prepare(
        random_scene(rng),
        levels=1 + seed % 6,
        channels=str(rng.choice(["correlated", "independent"])),
        skip_depth_edges=bool(seed % 4),
    )

    close_enough(run, run(), run.reference())


def test_a_slant_that_is_an_outline_at_coarse_levels_alone_matches_reference(prepare, rng):
    """Up to the hole the guide rises by 0.012 a pixel: four taps span less than 0.04."""
    frame = disc_scene(rng, (48, 64))
    guide = np.broadcast_to(0.1 + 0.012 * np.minimum(np.arange(64), 40), frame.size)
    depth_m = (Z_NEAR_M / (1 - guide)).astype(np.float32)
    run = prepare(dataclasses.replace(frame, depth_m=depth_m))

    close_enough(run, run(), run.reference())


@pytest.mark.full
@pytest.mark.parametrize("levels", range(1, 7))
@pytest.mark.parametrize("channels", ["correlated", "independent"])
@pytest.mark.parametrize("anchor", ["flow", "camera", "screen"])
@pytest.mark.parametrize("skip_depth_edges", [True, False])
@pytest.mark.parametrize("gamma", [0.0, 0.25, 0.5, 1.0])
def test_every_combination_matches_reference(
    prepare, rng, levels, channels, anchor, skip_depth_edges, gamma
):
    for size in ((61, 83), (1, 40), (33, 270)):
        run = prepare(
            disc_scene(rng, size),
            levels=levels,
            channels=channels,
            anchor=anchor,
            skip_depth_edges=skip_depth_edges,
            gamma=gamma,
        )

        close_enough(run, run(), run.reference())


class Stages:
    """What the GPU holds after a fill, as the reference would have it."""

    def __init__(self, run):
        frame, fill_pass = run.frame, run.fill_pass
        self.filled = run()[..., :3]
        levels, sizes = run.settings.levels, fill_pass.base.resolutions.sizes
        texels = read_back(fill_pass.variances.texels)
        self.moments, self.validity, self.lacking, self.guides = [], [], [], []
        for k in range(levels):
            columns, rows = sizes[k + 2]
            chains = read_back(fill_pass.variances.chain.at(k + 2)).reshape(-1, rows, columns, 5, 4)
            planes = chains[k].astype(np.float64)
            seconds = (planes[..., 1:4, 3], planes[..., 3, :3], planes[..., 4, :3])
            pairs = [np.concatenate([planes[..., b, :3], seconds[b]], axis=-1) for b in range(3)]
            self.moments.append(np.concatenate(pairs, axis=-1))
            self.validity.append(planes[..., 0, 3])
            here = fill_pass.variances.level_of(texels, k).astype(np.float64)
            bands = here[..., :3].reshape(*here.shape[:2], 9)
            self.lacking.append(bands)
            self.guides.append(here[:, :, 0, 3])
        lows = [read_back(low) for low in fill_pass.low_bands._coarser]
        run.load()
        fill_pass.base(run._image, run._depth_m, Z_NEAR_M)
        self.base = read_back(run._image)[..., :3].astype(np.float64)
        self.bands = [
            analyse(ycbcr_from_rgb(np.nan_to_num(colour.astype(np.float64))), 1).bands[0]
            for colour in (self.base, *(low[..., :3] for low in lows))
        ]
        np.testing.assert_array_equal(self.base[~frame.hole], frame.colour[~frame.hole])


def taps(texels):
    """Tell which of the next coarser texels push reads for these."""
    rows, columns = np.nonzero(texels)
    read = np.zeros([-(-edge // 2) for edge in texels.shape], bool)
    near = rows >> 1, columns >> 1
    far = [
        np.clip(own + 2 * (axis & 1) - 1, 0, edge - 1)
        for own, axis, edge in zip(near, (rows, columns), read.shape, strict=True)
    ]
    for row in (near[0], far[0]):
        for column in (near[1], far[1]):
            read[row, column] = True
    return read


def moments_taken(run, k):
    """Give the completed moments of level k's 4x4 that hole pixels take from: (n, planes, 4)."""
    columns, rows = run.fill_pass.base.resolutions.sizes[k + 2]
    chains = read_back(run.fill_pass.variances.chain.at(k + 2)).reshape(-1, rows, columns, 5, 4)
    return chains[k][taps(needed(run.frame.hole, k))]


def own_tolerances(bands):
    """Bound mean and second moment of 2x2 given coefficients, pushed into, absolute."""
    largest = np.abs(bands).max()
    mean = (BAND * 0.733 + GUIDED * largest) * ROUNDOFF
    return mean, 2 * largest * BAND * 0.733 * ROUNDOFF + (1 + GUIDED) * largest**2 * ROUNDOFF


@pytest.mark.parametrize("channels", ["correlated", "independent"])
@pytest.mark.parametrize("size", [(61, 83), (130, 301)])
def test_every_stage_on_gpu_matches_reference(prepare, rng, size, channels):
    """Completed moments of 4x4; then each later stage from what the GPU gave it."""
    run = prepare(disc_scene(rng, size), channels=channels)
    stages, fill = Stages(run), run.reference()
    cross, hole = channels == "correlated", run.frame.hole
    base_levels = guided_base(
        run.frame.colour,
        hole,
        guide_from_depth(run.frame.depth_m, Z_NEAR_M),
        levels=4,
        gamma=run.settings.gamma,
        threshold=THRESHOLD,
    )
    guides = [level.guide for level in base_levels]
    outlined, spoiled = outlined_levels(guides, 4, THRESHOLD), spoiled_levels(hole, 4)
    exact_bands = analyse(ycbcr_from_rgb(fill.base), 4).bands
    for k in range(4):
        near = near_a_hole(hole, k, STATISTICS_RINGS, k + 1)[:: 1 << k, :: 1 << k]
        valid = (near & ~spoiled[k] & ~outlined[k]).astype(float)
        wanted = needed(hole, k)
        read = taps(wanted)

        measured = Level(moments(exact_bands[k], cross=cross), valid, guides[k])
        exact = pull_push(measured, run.settings.gamma, THRESHOLD)[2]
        # Validity stays as first pulled, and push never touches certain texels.
        np.testing.assert_array_equal(stages.validity[k][read], exact.validity[read])
        for part, atol in zip(np.s_[:3, 3:], moment_tolerances(run, fill, k), strict=True):
            found, right = (
                values.reshape(*values.shape[:2], 3, 6)[..., part][read]
                for values in (stages.moments[k], exact.values)
            )
            np.testing.assert_allclose(found, right, rtol=0, atol=atol)
        np.testing.assert_allclose(
            stages.guides[k][wanted], guides[k + 1][wanted], rtol=0, atol=6 * ROUNDOFF
        )

        across = children(outlined[k][..., None].astype(float)).any(axis=2)[..., 0]
        assert across[wanted].any()
        assert not across[wanted].all()
        given = np.where(read[..., None], stages.moments[k], 0.0)
        completed = push(
            pull(Level(moments(stages.bands[k], cross=cross), valid, guides[k]), THRESHOLD),
            Level(given, exact.validity, guides[k + 2]),
            run.settings.gamma,
            THRESHOLD,
        )
        right = noise_variances(
            completed.values,
            stages.bands[k],
            outlined[k],
            known_background(base_levels[k + 1], THRESHOLD),
            cross=cross,
        )
        first = 1 if cross else 3  # a slope's error has no bound where luma has no variance
        found, right = (
            values[wanted].reshape(-1, 3, 3)[..., :first] for values in (stages.lacking[k], right)
        )
        mean, second = own_tolerances(stages.bands[k])
        # Of a variance and of the base's energy about the mean.
        off = second + (2 + 4) * np.abs(stages.bands[k]).max() * mean
        tolerance = variance_tolerance(stages.bands[k], right) + off
        assert (np.abs(found - right) <= tolerance).all()

    guide = guide_from_depth(run.frame.depth_m, Z_NEAR_M)
    lacking = [
        Level(
            np.where(needed(run.frame.hole, k)[..., None], values, 0.0), exact.validity, exact.guide
        )
        for k, (values, exact) in enumerate(zip(stages.lacking, fill.statistics, strict=True))
    ]
    noise = noise_bands(3, 4, 1 if cross else 3)
    added = shaped_noise(lacking, guide, fill.anchor_px, noise, run.settings.depth_threshold)
    colour = (stages.base + added @ RGB_FROM_YCBCR.T).clip(0, 1)
    tolerance = noise_tolerance(run, lacking, guide, fill.anchor_px)
    assert (np.abs(stages.filled - colour) <= tolerance)[hole].all()
    assert np.median(tolerance[hole]) < 2.0**-10  # a bound that bounds something


@pytest.mark.parametrize("seed", range(4))
def test_a_step_of_depth_as_high_as_the_threshold_is_a_decision(prepare, seed):
    """Some known pixels beside the hole lie one threshold in front of it, give or take an ulp.

    Which of them take part is for rounding to say, and no two machines need agree. One more
    coefficient in the moments moves a whole hole, so here any number may be decided so.
    """
    rng = np.random.default_rng(seed)
    frame = disc_scene(rng, (120, 160))
    depth_m = frame.depth_m.copy()
    beside = np.zeros(frame.size, bool)
    beside[58:60, :] = True
    near = grow(frame.hole, 2) & ~frame.hole & (depth_m == 5) & beside
    tie = np.float32(1 / (1 / 5 + MetamericSettings().depth_threshold))  # guides 0.8 and 0.76
    ulps = rng.integers(-2, 3, near.sum())
    depth_m[near] = tie + ulps.astype(np.float32) * np.spacing(tie)
    run = prepare(dataclasses.replace(frame, depth_m=depth_m))
    fill = run.reference()

    assert near.any()
    assert decided_by_threshold(run, fill)[frame.hole].any()
    close_enough(run, run(), fill, share=1.0)


def test_the_comparison_lets_no_other_pixel_through(prepare, rng):
    """One hole pixel off by twice the bound, or not a number, where nothing was decided."""
    run = prepare(disc_scene(rng, (48, 64)))
    fill = run.reference()
    row, column = np.argwhere(run.frame.hole)[0]
    for wrong in (fill.colour[row, column, 1] + 2 * WHOLE_ATOL, np.nan):
        filled = run()
        filled[row, column, 1] = wrong
        with pytest.raises(AssertionError):
            close_enough(run, filled, fill)


@pytest.mark.parametrize("turned", [False, True])
def test_noise_sticks_to_the_screen_where_there_is_no_place_to_look(prepare, rng, turned):
    """Behind the source camera, and where the motion is out of all bounds."""
    frame = disc_scene(rng, (40, 56))
    if turned:
        source = Camera.with_field_of_view(56, 40, 50)
        back = source.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])
        run = prepare(frame, anchor="camera")
        run.matrix = reprojection(source, dataclasses.replace(source, world_from_camera=back))
    else:
        run = prepare(dataclasses.replace(frame, flow_px=np.full_like(frame.flow_px, -3e38)))
    fill, screen = run.reference(), run.reference(anchor="screen")

    np.testing.assert_array_equal(fill.colour, screen.colour)
    close_enough(run, run(), fill)


@pytest.mark.parametrize("seed", [-1, 2**63, 3.0, True])
def test_what_is_no_seed_is_refused(prepare, rng, seed):
    run = prepare(disc_scene(rng, (20, 30)))

    with pytest.raises(InputError, match=r"^seed must be a whole number"):
        run(seed=seed)


def test_a_background_at_infinity_is_filled(prepare, rng):
    run = prepare(disc_scene(rng, (60, 80), inf_background=True))

    close_enough(run, run(), run.reference())


def test_two_runs_give_the_same_bits(prepare, rng):
    """Of one pass with another frame and seed between, and of another pass."""
    frame, other = (disc_scene(rng, (70, 130)) for _ in range(2))
    run = prepare(frame)

    first = run()
    between = run(other, seed=9)
    again = run(frame, seed=3)

    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != between.tobytes()
    assert prepare(frame)().tobytes() == first.tobytes()


def held_bytes(item):
    return item.size if isinstance(item, moderngl.Buffer) else texture_bytes(item)


def noisy_depth_scene(width, levels):
    """A narrow hole beside a band where every kernel straddles a jump of depth.

    Nothing there is valid, so push must look far beyond the ring of tiles that is read.
    """
    rng = np.random.default_rng(0)
    size = (16, width)
    end = (112 << (levels - 1)) + 2
    hole = np.zeros(size, bool)
    hole[:, end - 4 : end] = True
    depth = np.full(size, 5, np.float32)
    depth[:, end : end + (200 << (levels - 1)) : 2] = 2
    flow = np.zeros((*size, 2), np.float32)
    return WarpedFrame(rng.random((*size, 3), np.float32), depth, hole, flow)


@pytest.mark.parametrize(
    ("levels", "made_for", "width"),
    [(1, 1, 1024), (2, 2, 2048), (2, 1, 1024), (4, 2, 2048), (4, 4, 300)],
)
def test_nothing_left_in_memory_is_ever_read(prepare, levels, made_for, width):
    """All that the pass writes is first set to NaN, or to 7: the fill must not notice.

    The scene is one where push leaves the ring of so many levels; with more of them it must be
    a coarser one's that holds it.
    """
    run = prepare(noisy_depth_scene(width, made_for), levels=levels)
    run()
    results, carried = [], []
    for value in (np.nan, 7.0):
        for item in run.buffers():
            item.write(np.full(held_bytes(item) // 4, value, np.float32).tobytes())
        results.append(run())
        carried.append([moments_taken(run, k) for k in range(levels)])

    assert results[0].tobytes() == results[1].tobytes()
    # Noise beside known background comes to 0, whatever the moments: these may not differ either.
    for without, other in zip(*carried, strict=True):
        assert np.isfinite(without).all()
        np.testing.assert_array_equal(without, other)
    close_enough(run, results[0], run.reference())


@pytest.mark.parametrize("begin", [125, 4000])
def test_nothing_far_from_a_hole_is_read_in_a_wide_frame(prepare, rng, begin):
    """Up to resolution 8 there are dispatches; all memory is first set to NaN, or to 7."""
    size = (4, 8200)
    hole = np.zeros(size, bool)
    hole[:, begin : begin + 5] = True
    depth_m = np.full(size, 5, np.float32)
    flow = np.zeros((*size, 2), np.float32)
    run = prepare(WarpedFrame(rng.random((*size, 3), np.float32), depth_m, hole, flow))
    run()
    results = []
    for value in (np.nan, 7.0):
        for item in run.buffers():
            item.write(np.full(held_bytes(item) // 4, value, np.float32).tobytes())
        results.append(run())

    assert results[0].tobytes() == results[1].tobytes()
    close_enough(run, results[0], run.reference())


def test_an_empty_mask_gives_the_frame_back(prepare, rng):
    frame = disc_scene(rng, (40, 50))
    frame = dataclasses.replace(frame, hole=np.zeros_like(frame.hole))
    run = prepare(frame)

    assert run()[..., :3].tobytes() == frame.colour.tobytes()


def test_a_call_allocates_nothing_and_reads_nothing_back(prepare, rng, gl_watch, monkeypatch):
    frame = disc_scene(rng, (70, 90))
    run = prepare(frame)
    run()
    run.load()

    def refuse(*_, **__):
        pytest.fail("read back, or allocated, between frames")

    with monkeypatch.context() as patch:
        for kind, names in (
            (moderngl.Buffer, ("read", "read_into", "read_chunks", "orphan")),
            (moderngl.Texture, ("read", "read_into")),
            (moderngl.Context, ("buffer", "texture", "compute_shader", "finish")),
        ):
            for name in names:
                patch.setattr(kind, name, refuse)
        watch = gl_watch()
        run.call()
        gained = watch.gained()

    assert not gained


@pytest.mark.parametrize("levels", [1, 4, 6])
@pytest.mark.parametrize("size", [(1, 2), (40, 60), (300, 200)])
def test_dispatches_are_counted_right(prepare, rng, monkeypatch, size, levels):
    made = []
    for name in ("run", "run_indirect"):
        plain = getattr(moderngl.ComputeShader, name)

        def counted(self, *args, plain=plain, **kwargs):
            made.append(self)
            return plain(self, *args, **kwargs)

        monkeypatch.setattr(moderngl.ComputeShader, name, counted)
    run = prepare(disc_scene(rng, size), levels=levels)

    run()

    assert len(made) == run.fill_pass.dispatches


@pytest.mark.parametrize("edge", [512, 1024, 2048])
def test_four_levels_need_at_most_sixty_dispatches(gl_context, edge):
    fill_pass = MetamericPass(gl_context, (edge, 64), MetamericSettings())
    dispatches = fill_pass.dispatches
    fill_pass.release()

    assert dispatches <= 60


@pytest.mark.parametrize("channels", ["correlated", "independent"])
def test_a_pass_holds_at_most_128_bytes_per_pixel(gl_context, channels):
    fill_pass = MetamericPass(gl_context, (1024, 1024), MetamericSettings(channels=channels))
    held = fill_pass.held_bytes
    fill_pass.release()

    assert held <= 128 * 1024 * 1024


def test_held_bytes_are_what_is_held(prepare, rng):
    run = prepare(disc_scene(rng, (60, 75)))

    held = sum(map(held_bytes, (*run.buffers(), *run.fixed())))

    assert run.fill_pass.held_bytes == held


@pytest.mark.parametrize("argument", ["image", "depth_m", "flow_px"])
def test_textures_of_another_size_are_refused(gl_context, argument):
    fill_pass = MetamericPass(gl_context, (8, 9), MetamericSettings())
    formats = {"image": "rgba32f", "depth_m": "r32f", "flow_px": "rg32f"}
    good = {name: create_texture(gl_context, (8, 9), kind) for name, kind in formats.items()}
    wrong = create_texture(gl_context, (9, 8), formats[argument])

    with pytest.raises(InputError, match=rf"^{argument} must be 8x9"):
        fill_pass(**(good | {argument: wrong}), z_near_m=1.0, seed=1)
    for thing in (fill_pass, wrong, *good.values()):
        thing.release()


def widest(gl_context):
    return int(gl_context.info["GL_MAX_TEXTURE_SIZE"]) // 3 * 2


def test_a_frame_too_wide_for_the_driver_is_refused(gl_context):
    most = widest(gl_context)

    with pytest.raises(InputError, match=rf"at most {most} px wide .* \(got {most + 1}x2\)"):
        MetamericPass(gl_context, (most + 1, 2), MetamericSettings())


@pytest.mark.parametrize(("tall", "levels"), [(True, 4), (False, 4), (False, 6)])
def test_the_widest_and_the_tallest_frame_are_filled_to_the_end(
    prepare, gl_context, rng, tall, levels
):
    """Entries of lists hold columns and rows; a hole lies in the last of them."""
    limit = int(gl_context.info["GL_MAX_TEXTURE_SIZE"])
    frame = disc_scene(rng, (4, limit if tall else widest(gl_context)))
    if tall:
        parts = (frame.colour, frame.depth_m, frame.hole, frame.flow_px)
        frame = WarpedFrame(*(np.ascontiguousarray(part.swapaxes(0, 1)) for part in parts))
    run = prepare(frame, levels=levels)

    assert frame.hole[-1 if tall else 0, 0 if tall else -1]
    close_enough(run, run(), run.reference())


def test_a_camera_anchor_without_cameras_is_refused(prepare, rng):
    run = prepare(disc_scene(rng, (20, 30)), anchor="camera")
    run.matrix = None

    with pytest.raises(InputError, match="source_from_target"):
        run()


def test_the_motorcycle_matches_reference(prepare, gl_context):
    """The real pair, a crop around the front wheel, as the warp leaves it."""
    from stimuli.scenes.stereo import PAIR_WARP, built_in_pair

    frame = built_in_pair("motorcycle").warp_input()
    whole = warp_frame(gl_context, frame.source, frame.flow_px, settings=PAIR_WARP)
    crop = np.s_[150:362, 90:411]
    warped = WarpedFrame(
        *(
            np.ascontiguousarray(part[crop])
            for part in (whole.colour, whole.depth_m, whole.hole, whole.flow_px)
        )
    )
    assert warped.hole.mean() > 0.03
    run = prepare(warped)

    close_enough(run, run(), run.reference())


@pytest.mark.parametrize("offset_m", [(0.15, 0.0, 0.0), (-0.08, 0.05, 0.1)])
def test_from_source_to_fill_the_gpu_matches_reference(prepare, gl_context, rng, offset_m):
    """Warp and fill by the one, warp and fill by the other: a ball before a slanted floor."""
    source = Camera.with_field_of_view(150, 110, 55)
    x, y = np.moveaxis(source.pixel_centres(), -1, 0)
    ball = np.hypot(x - 70, y - 50) < 24
    depth_m = np.where(ball, 2.0, 120 / (y + 25)).astype(np.float32)
    colour = np.where(
        ball[..., None], [0.9, 0.1, 0.1], 0.5 + 0.1 * rng.standard_normal((110, 150, 3))
    )
    frame = SourceFrame(colour.clip(0, 1).astype(np.float32), depth_m)
    flow_px, target_depth_m = flow_between(source, source.moved(offset_m), depth_m)
    found = warp_frame(gl_context, frame, flow_px, target_depth_m=target_depth_m)
    exact = warp(frame, flow_px, target_depth_m=target_depth_m)
    assert 0.02 < exact.hole.mean() < 0.3
    np.testing.assert_array_equal(found.hole, exact.hole)
    run = prepare(exact)
    fill = run.reference()

    filled = run(found)[..., :3]

    off = ~(np.abs(filled - fill.colour) <= WHOLE_ATOL).all(axis=-1)
    assert off.sum() <= 1e-3 * off.size
    # Interpolated, the inverse depth is off by 31 roundings of the nearest's (test_warp_gpu.py).
    margin = 2 * (6 + 31 * Z_NEAR_M / target_depth_m.min()) * ROUNDOFF
    assert decided_by_threshold(run, fill, margin)[off].all()


def test_a_texture_of_the_warp_is_taken_as_it_is(gl_context, rng):
    """Colours inside holes are of no account."""
    frame = disc_scene(rng, (30, 40))
    settings = MetamericSettings()
    results = []
    for inside in (0.0, 123.0):
        colour = np.where(frame.hole[..., None], np.float32(inside), frame.colour)
        image = texture_from(
            gl_context,
            np.concatenate([colour, ~frame.hole[..., None]], -1, dtype=np.float32),
            "rgba32f",
        )
        depth_m = texture_from(gl_context, frame.depth_m, "r32f")
        flow_px = texture_from(gl_context, frame.flow_px, "rg32f")
        fill_pass = MetamericPass(gl_context, (40, 30), settings)
        fill_pass(image, depth_m, flow_px, z_near_m=1.0, seed=1)
        results.append(read_back(image))
        for thing in (image, depth_m, flow_px, fill_pass):
            thing.release()

    assert results[0].tobytes() == results[1].tobytes()
