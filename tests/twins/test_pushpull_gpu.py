"""Push-pull on the GPU against its definition."""

import numpy as np
import pytest

from benchmarks.shared.dispatches import dispatches_of
from pipeline.errors import InputError
from pipeline.gl.texture import create_texture, read_back, texture_from
from pipeline.pushpull.gpu import PushPullPass, coarser_sizes
from pipeline.pushpull.reference import push_pull

SIZES = [(1, 1), (2, 1), (1, 7), (9, 1), (2, 2), (3, 5), (8, 8), (17, 16), (33, 64), (96, 61)]

ROUNDOFF = 2.0**-24  # of one float32 operation


def tolerance(size, *, partial_confidences):
    """Bound the error of one fill of colours in [0, 1], absolute.

    Known or unknown, nothing between: confidences are exact, and a product with one is
    too. Pull: 3 sums and a division (5): 8 per level. Push: in the four weighted taps a
    product and 2 to 3 sums: 4 per level.

    Confidences between: one of level n is off by the 3n sums that made it, relative. Pull:
    a product, 3 sums above the line, 3 below, a division: 12, and twice the confidences'
    own 3n. Push: 4 for the taps, 1 for the difference to 1, 2 for products and sum: 7, and
    twice 3n, since the confidence weighs both sides.
    """
    levels = len(coarser_sizes(size)) or 1
    if not partial_confidences:
        return (8 + 4) * levels * ROUNDOFF
    from_confidences = sum(2 * 3 * level for level in range(levels))
    return ((12 + 7) * levels + 2 * from_confidences) * ROUNDOFF


def random_image(rng, size, known_share, *, partial_confidences=False):
    """Return an image of (width, height) with colours in unknown pixels as well."""
    width, height = size
    image = rng.random((height, width, 4), np.float32)
    image[..., 3] = rng.uniform(1 / 16, 1, (height, width)) if partial_confidences else 1
    image[rng.random((height, width)) >= known_share, 3] = 0
    image[rng.integers(height), rng.integers(width), 3] = 1
    return image


@pytest.fixture
def fill(gl_context):
    """Give a function that fills an image on the GPU, into itself if told so."""

    def run(image, *, in_place=False):
        size = (image.shape[1], image.shape[0])
        fill_pass = PushPullPass(gl_context, size)
        source = texture_from(gl_context, image, "rgba32f")
        target = source if in_place else create_texture(gl_context, size, "rgba32f")
        fill_pass(source, target)
        filled = read_back(target)
        for thing in (fill_pass, source, target):
            thing.release()
        return filled

    return run


@pytest.mark.parametrize(
    ("known_share", "partial"),
    [(0.0, False), (0.02, False), (0.5, False), (1.0, False), (0.1, True), (1.0, True)],
)
@pytest.mark.parametrize("size", SIZES)
def test_push_pull_on_gpu_matches_reference(fill, rng, size, known_share, partial):
    image = random_image(rng, size, known_share, partial_confidences=partial)

    filled = fill(image)

    atol = tolerance(size, partial_confidences=partial)
    np.testing.assert_allclose(filled[..., :3], push_pull(image), rtol=0, atol=atol)
    if not partial:
        np.testing.assert_array_equal(filled[..., 3], image[..., 3])


@pytest.mark.parametrize("size", SIZES)
def test_known_pixels_are_kept_bit_for_bit(fill, rng, size):
    image = random_image(rng, size, 0.5)
    image[0, 0] = (-0.0, 2.0**-100, 1.0, 1.0)
    known = image[..., 3] == 1

    filled = fill(image)

    assert filled[known].tobytes() == image[known].tobytes()


@pytest.mark.parametrize("size", SIZES)
def test_filling_in_place_gives_the_same_bits(fill, rng, size):
    image = random_image(rng, size, 0.3, partial_confidences=True)

    assert fill(image, in_place=True).tobytes() == fill(image).tobytes()


def test_two_runs_of_one_pass_give_the_same_bits(gl_context, rng):
    """The second run finds the levels as the first, of another image, left them."""
    images = [random_image(rng, (61, 47), share) for share in (0.05, 0.6, 0.05)]
    images[2] = images[0]
    fill_pass = PushPullPass(gl_context, (61, 47))
    target = create_texture(gl_context, (61, 47), "rgba32f")
    results = []
    for image in images:
        source = texture_from(gl_context, image, "rgba32f")
        fill_pass(source, target)
        results.append(read_back(target))
        source.release()
    target.release()
    fill_pass.release()

    assert results[0].tobytes() == results[2].tobytes()
    assert results[0].tobytes() != results[1].tobytes()


def test_the_image_is_left_as_it_was(gl_context, rng):
    image = random_image(rng, (20, 30), 0.3)
    fill_pass = PushPullPass(gl_context, (20, 30))
    source = texture_from(gl_context, image, "rgba32f")
    target = create_texture(gl_context, (20, 30), "rgba32f")

    fill_pass(source, target)
    after = read_back(source)
    for thing in (fill_pass, source, target):
        thing.release()

    assert after.tobytes() == image.tobytes()


@pytest.mark.parametrize("argument", ["image", "filled"])
@pytest.mark.parametrize(
    ("size", "name"), [((9, 8), "rgba32f"), ((8, 9), "rgba16f"), ((8, 9), "rg32f")]
)
def test_a_texture_of_another_size_or_format_is_refused(gl_context, argument, size, name):
    fill_pass = PushPullPass(gl_context, (8, 9))
    good = create_texture(gl_context, (8, 9), "rgba32f")
    wrong = create_texture(gl_context, size, name)
    textures = {"image": good, "filled": good} | {argument: wrong}

    with pytest.raises(
        InputError, match=rf"^{argument} must be 8x9 rgba32f, .* \(got {size[0]}x{size[1]} {name}\)"
    ):
        fill_pass(**textures)
    for thing in (fill_pass, good, wrong):
        thing.release()


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (-3, 4), (10**6, 4)])
def test_a_pass_for_a_size_no_texture_can_have_is_refused(gl_context, size):
    with pytest.raises(InputError, match=rf"texture edges must lie in .* \(got {size[0]}x"):
        PushPullPass(gl_context, size)


def test_dispatches_are_two_for_each_level(gl_context):
    """By hand: 5x3, then 3x2, 2x1, 1x1."""
    fill_pass = PushPullPass(gl_context, (5, 3))
    image = create_texture(gl_context, (5, 3), "rgba32f")
    made = dispatches_of(lambda: fill_pass(image, image))
    fill_pass.release()
    image.release()

    assert coarser_sizes((5, 3)) == [(3, 2), (2, 1), (1, 1)]
    assert len(made) == 6


def test_a_call_allocates_nothing(gl_context, gl_watch, rng):
    fill_pass = PushPullPass(gl_context, (16, 16))
    texture = texture_from(gl_context, random_image(rng, (16, 16), 0.5), "rgba32f")
    watch = gl_watch()

    fill_pass(texture, texture)
    gained = watch.gained()
    texture.release()
    fill_pass.release()

    assert not gained
