"""Frames are recorded: later ones are as right as the first, and cost the host few calls."""

from functools import partial

import numpy as np
import pytest

from benchmarks.shared.frame_cost import python_calls
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Flat
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.printed.gpu import PrintedPass
from pipeline.printed.reference import PrintedSettings
from pipeline.pushpull.gpu import PushPullPass
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.settings import MetamericSettings
from pipeline.transport.gpu import TransportPass
from pipeline.transport.reference import TransportSettings
from pipeline.warp.gpu import WarpPass

SIZE = 72, 60
MOST_CALLS = 120


def guided(ctx):
    made = GuidedBasePass(ctx, SIZE, gamma=0.25)
    return made, lambda frame, z_near_m, _seed: made(frame.colour, frame.depth_m, z_near_m)


def push_pull(ctx):
    made = PushPullPass(ctx, SIZE)
    return made, lambda frame, _z_near_m, _seed: made(frame.colour, frame.colour)


def seeded(kind, settings, ctx):
    made = kind(ctx, SIZE, settings)
    return made, lambda frame, z_near_m, seed: made(frame, z_near_m=z_near_m, seed=seed)


FILLS = {
    "push-pull": push_pull,
    "push-pull-depth": guided,
    "metameric": partial(seeded, MetamericPass, MetamericSettings(levels=3)),
    "coherence-transport": partial(seeded, TransportPass, TransportSettings(detail=0.6)),
    "printed": partial(seeded, PrintedPass, PrintedSettings(levels=2)),
}


def frame_of(number):
    """A frame with a hole 40 px wide, so that transport walks on after its first shells."""
    rng = np.random.default_rng(number)
    hole = np.zeros(SIZE[::-1], bool)
    hole[2:58, 20 + number : 68] = True
    depth_m = np.where(np.arange(SIZE[0]) < 12, 2.0, 5.0 + number).astype(np.float32)
    colour = rng.random((*SIZE[::-1], 3), np.float32)
    nowhere = np.zeros((*SIZE[::-1], 2), np.float32)
    return WarpedFrame(colour, np.tile(depth_m, (SIZE[1], 1)), hole, nowhere)


@pytest.mark.parametrize("name", FILLS)
def test_a_recorded_frame_is_as_right_as_the_first_one(gl_context, name):
    """Two targets take turns, and depth, seed and content change: what was told is not stale."""
    targets = [FrameTextures.create(gl_context, SIZE) for _ in range(2)]
    turns = [(0, 0, 1.0, 3), (1, 1, 1.5, 3), (0, 2, 1.5, 4), (1, 0, 1.0, 3), (0, 1, 1.5, 3)]

    def run(work, target, number, z_near_m, seed):
        targets[target].upload(frame_of(number))
        work(targets[target], z_near_m, seed)
        return read_back(targets[target].colour)

    kept, work = FILLS[name](gl_context)
    found = [run(work, *turn) for turn in turns]
    kept.release()
    for turn, one in zip(turns, found, strict=True):
        fresh, work = FILLS[name](gl_context)
        np.testing.assert_array_equal(one, run(work, *turn))
        fresh.release()
    assert not np.array_equal(found[0], found[2])
    for target in targets:
        target.release()


@pytest.mark.parametrize("name", FILLS)
def test_a_recorded_fill_costs_the_host_few_calls(gl_context, name):
    frame = FrameTextures.of(gl_context, frame_of(0))
    kept, work = FILLS[name](gl_context)
    work(frame, 1.0, 3)

    assert 5 < python_calls(gl_context, lambda: work(frame, 1.0, 3)) <= MOST_CALLS
    for one in (kept, frame):
        one.release()


def test_a_recorded_warp_and_a_recorded_metamer_cost_the_host_few_calls(gl_context):
    source, warped = (FrameTextures.of(gl_context, frame_of(k)) for k in range(2))
    warp = WarpPass(gl_context, SIZE)
    metamer = Foveator(SIZE[::-1], viewing=Flat(40), method="metamer", ctx=gl_context).passes
    metamer.hold(source.colour)
    works = (
        lambda: warp(*vars(source).values(), warped),
        lambda: metamer.show(warped.colour, (30.0, 30.0)),
    )
    for work in works:
        work()
        assert 5 < python_calls(gl_context, work) <= MOST_CALLS
    for one in (warp, metamer, source, warped):
        one.release()
