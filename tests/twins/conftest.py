"""Scene and passes of a metameric fill that several files of twins need."""

import dataclasses

import moderngl
import numpy as np
import pytest

from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back, upload
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings
from tests.twins.work_lists import is_of_pass

Z_NEAR_M = 1.0
ROUNDOFF = 2.0**-24  # of one float32 operation
# From end to end: a sixteenth of an 8-bit step. A band whose variance the base has all but
# reached is the root of a small difference, whose error no count of roundings keeps small.
WHOLE_ATOL = 2.0**-12


@pytest.fixture(scope="session")
def disc_scene():
    """Give `make_disc_scene`."""
    return make_disc_scene


def make_disc_scene(rng, size, *, inf_background=False):
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


class MetamericRun:
    """A pass with the textures of one frame; fills as often as it is called."""

    def __init__(self, ctx, frame, settings):
        self.frame, self.settings = frame, settings
        height, width = frame.size
        self.fill_pass = MetamericPass(ctx, (width, height), settings)
        self.textures = FrameTextures.create(ctx, (width, height))

    def load(self, frame=None):
        frame = frame or self.frame
        self.textures.upload(frame)
        # What the array holds inside holes goes up too: no pass may read it.
        alpha = ~frame.hole[..., None]
        rgba = np.concatenate([frame.colour, alpha], -1, dtype=np.float32)
        upload(self.textures.colour, rgba)

    def call(self, seed=3):
        self.fill_pass(self.textures, z_near_m=Z_NEAR_M, seed=seed)

    def __call__(self, frame=None, seed=3):
        self.load(frame)
        self.call(seed)
        return read_back(self.textures.colour)

    def reference(self, seed=3, **changes):
        return metameric_fill(
            self.frame,
            dataclasses.replace(self.settings, **changes),
            seed=seed,
            z_near_m=Z_NEAR_M,
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
            elif is_of_pass(item):
                pending += vars(item).values()
        return found

    def release(self):
        for thing in (self.fill_pass, self.textures):
            thing.release()

    def decided_by_threshold(self, fill, margin=12 * ROUNDOFF):
        """Tell where moving the threshold by less than what a step of the guide is off matters.

        By default that is two guides, 6 roundings each. The reference is exact to 2^-52, so a pixel
        that no such decision reaches keeps its bits.
        """
        threshold = self.settings.depth_threshold
        others = [
            self.reference(depth_threshold=threshold + shift).colour for shift in (-margin, margin)
        ]
        return np.any([(other != fill.colour).any(axis=-1) for other in others], axis=0)

    def agrees(self, filled, fill, share=1e-3):
        """Assert that every hole pixel is within the bound, but for a share of the frame.

        Each of those must be a threshold decision: see `decided_by_threshold`.
        """
        hole = self.frame.hole
        off = hole & ~(np.abs(filled[..., :3] - fill.colour) <= WHOLE_ATOL).all(axis=-1)
        if off.any():
            assert off.sum() <= share * hole.size
            assert self.decided_by_threshold(fill)[off].all()
        assert filled[~hole][:, :3].tobytes() == self.frame.colour[~hole].tobytes()
        np.testing.assert_array_equal(filled[..., 3], ~hole)

    def needed(self, k):
        """Tell which texels of level k's half the interpolation at hole pixels reaches."""
        wanted = np.zeros([-(-edge // (2 << k)) for edge in self.frame.hole.shape], bool)
        rows, columns = np.nonzero(self.frame.hole)
        first = [np.floor((axis + 0.5) / (2 << k) - 0.5).astype(int) for axis in (rows, columns)]
        for down in (0, 1):
            for right in (0, 1):
                wanted[
                    np.clip(first[0] + down, 0, wanted.shape[0] - 1),
                    np.clip(first[1] + right, 0, wanted.shape[1] - 1),
                ] = True
        return wanted


@pytest.fixture
def prepare(gl_context):
    """Give a function that builds a run; all are released after the test."""
    runs = []

    def build(frame, **settings):
        runs.append(MetamericRun(gl_context, frame, MetamericSettings(**settings)))
        return runs[-1]

    yield build
    for run in runs:
        run.release()
