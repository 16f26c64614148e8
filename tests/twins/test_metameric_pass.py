"""Memory, dispatches and refusals of a metameric fill on the GPU."""

import moderngl
import numpy as np
import pytest

from benchmarks.shared.dispatches import dispatches_of
from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import create_texture, read_back, texture_bytes, texture_from
from pipeline.inpaint.regions import MOST_EDGE_PX
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.settings import MetamericSettings


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


def reads_nothing_left(run):
    """Hold two runs, after all memory was set to NaN and to 7, to each other and the reference."""
    run()
    results = []
    for value in (np.nan, 7.0):
        for item in run.buffers():
            item.write(np.full(held_bytes(item) // 4, value, np.float32).tobytes())
        results.append(run())
    assert results[0].tobytes() == results[1].tobytes()
    run.agrees(results[0], run.reference())


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
    reads_nothing_left(run)


@pytest.mark.parametrize("begin", [125, 4000])
def test_nothing_far_from_a_hole_is_read_in_a_wide_frame(prepare, rng, begin):
    """Up to resolution 8 there are dispatches; all memory is first set to NaN, or to 7."""
    size = (4, 8200)
    hole = np.zeros(size, bool)
    hole[:, begin : begin + 5] = True
    depth_m = np.full(size, 5, np.float32)
    flow = np.zeros((*size, 2), np.float32)
    run = prepare(WarpedFrame(rng.random((*size, 3), np.float32), depth_m, hole, flow))
    reads_nothing_left(run)


def test_a_call_allocates_nothing_and_reads_nothing_back(
    prepare, rng, gl_watch, monkeypatch, disc_scene
):
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


@pytest.mark.parametrize("edge", [512, 1024, 2048])
def test_a_fill_needs_at_most_45_dispatches(gl_context, edge):
    fill_pass = MetamericPass(gl_context, (edge, 64), MetamericSettings())
    frame = FrameTextures.create(gl_context, (edge, 64))
    made = dispatches_of(lambda: fill_pass(frame, z_near_m=1.0, seed=0))
    fill_pass.release()
    frame.release()

    assert 20 < len(made) <= 45


@pytest.mark.parametrize("channels", ["correlated", "independent"])
def test_a_pass_holds_at_most_128_bytes_per_pixel(gl_context, channels):
    fill_pass = MetamericPass(gl_context, (1024, 1024), MetamericSettings(channels=channels))
    held = fill_pass.held_bytes
    fill_pass.release()

    assert held <= 128 * 1024 * 1024


def test_held_bytes_are_what_is_held(prepare, rng, disc_scene):
    run = prepare(disc_scene(rng, (60, 75)))

    held = sum(map(held_bytes, (*run.buffers(), *run.fixed())))

    assert run.fill_pass.held_bytes == held


@pytest.mark.parametrize("argument", ["colour", "depth_m", "flow_px"])
def test_textures_of_another_size_are_refused(gl_context, argument):
    fill_pass = MetamericPass(gl_context, (8, 9), MetamericSettings())
    formats = {"colour": "rgba32f", "depth_m": "r32f", "flow_px": "rg32f"}
    good = {name: create_texture(gl_context, (8, 9), kind) for name, kind in formats.items()}
    wrong = create_texture(gl_context, (9, 8), formats[argument])

    with pytest.raises(InputError, match=rf"^{argument} must be 8x9"):
        fill_pass(FrameTextures(**(good | {argument: wrong})), z_near_m=1.0, seed=1)
    for thing in (fill_pass, wrong, *good.values()):
        thing.release()


def widest(gl_context):
    return min(MOST_EDGE_PX, int(gl_context.info["GL_MAX_TEXTURE_SIZE"]) // 3 * 2)


def test_a_frame_too_wide_for_the_driver_is_refused(gl_context):
    most = widest(gl_context)

    with pytest.raises(InputError, match=rf"at most {most} px wide .* \(got {most + 1}x2\)"):
        MetamericPass(gl_context, (most + 1, 2), MetamericSettings())


@pytest.mark.parametrize(("tall", "levels"), [(True, 4), (False, 4), (False, 6)])
def test_the_widest_and_the_tallest_frame_are_filled_to_the_end(
    prepare, gl_context, rng, tall, levels, disc_scene
):
    """Entries of lists hold columns and rows; a hole lies in the last of them."""
    limit = min(MOST_EDGE_PX, int(gl_context.info["GL_MAX_TEXTURE_SIZE"]))
    frame = disc_scene(rng, (4, limit if tall else widest(gl_context)))
    if tall:
        parts = (frame.colour, frame.depth_m, frame.hole, frame.flow_px)
        frame = WarpedFrame(*(np.ascontiguousarray(part.swapaxes(0, 1)) for part in parts))
    run = prepare(frame, levels=levels)

    assert frame.hole[-1 if tall else 0, 0 if tall else -1]
    run.agrees(run(), run.reference())


@pytest.mark.parametrize("seed", [-1, 2**63, 3.0, True])
def test_what_is_no_seed_is_refused(prepare, rng, seed, disc_scene):
    run = prepare(disc_scene(rng, (20, 30)))

    with pytest.raises(InputError, match=r"^seed must be a whole number"):
        run(seed=seed)


def test_a_texture_of_the_warp_is_taken_as_it_is(gl_context, rng, disc_scene):
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
        fill_pass(FrameTextures(image, depth_m, flow_px), z_near_m=1.0, seed=1)
        results.append(read_back(image))
        for thing in (image, depth_m, flow_px, fill_pass):
            thing.release()

    assert results[0].tobytes() == results[1].tobytes()
