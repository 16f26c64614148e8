"""Foveation on the GPU against its twin."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from skimage import data

from benchmarks.shared.dispatches import dispatches_of
from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator, foveate
from pipeline.foveation.displacement import DisplacementSettings, eidolon, warped_metamer
from pipeline.foveation.displacement_gpu import DisplacementPass
from pipeline.foveation.geometry import Equirectangular, Flat
from pipeline.foveation.gpu import BlurPass, MetamerPass
from pipeline.foveation.picture_fixation import PictureFixation
from pipeline.foveation.pooled_moments import STEEPEST
from pipeline.foveation.pooling import MetamerSettings, Pooling, make_pooling
from pipeline.foveation.reference import blur, metamer
from pipeline.gl.texture import create_texture, read_back, texture_from
from pipeline.named_classes import Choice
from pipeline.noise.gpu import NoisePass
from stimuli.foveate.condition_sheet import look_through

# Pools of half a pixel up to some 30, seen with every sort of border.
VIEWS = [
    ((96, 96), Flat(40), (48.0, 48.0)),
    ((90, 301), Flat(90), (200.0, 40.0)),
    ((77, 64), Flat(40), (-90.0, 500.0)),
    ((100, 200), Equirectangular(), (190.0, 20.0)),
    ((9, 13), Flat(100), (2.0, 2.0)),
    ((1, 1), Flat(40), (9.0, 9.0)),
]
PANORAMA_LOOKS = [
    ("blur", (110.0, 12.0)),
    ("metamer", (30.0, 30.0)),
    ("eidolon", (60.0, 0.0)),
    ("warped-metamer", (5.0, 48.0)),
]
# Weights of noise are half floats, off by at most 2^-11 of themselves, and drivers round them
# either way. Where noise is bound, a deviation of it is worth up to STEEPEST times the normal
# density (.4) of the display; that steep it is where the ends are some 2.5 deviations of noise
# away. The normal place is off by 5e-4, and goes in times the root of 1 + STEEPEST^2.
TOLERANCE = 0.4 * (STEEPEST * 2.5 * 2.0**-11 + (1 + STEEPEST**2) ** 0.5 * 5e-4)
PLAIN_TOLERANCE = 0.1 / 255  # all else is float32


def photograph(size):
    picture = data.astronaut().astype(np.float32) / 255
    return np.ascontiguousarray(picture[60 : 60 + size[0], 120 : 120 + size[1]])


@pytest.fixture
def run(gl_context):
    """Give a function that runs a pass once, and frees it."""

    def apply(make, geometry, picture, gaze_px, **fixation):
        made = make(gl_context, geometry)
        result = made.apply(picture, PictureFixation(geometry, gaze_px, **fixation))
        made.release()
        return result

    return apply


@pytest.mark.parametrize(("size", "viewing", "gaze_px"), VIEWS)
def test_blur_on_gpu_matches_reference(run, size, viewing, gaze_px):
    geometry, pooling = viewing.of(size[1], size[0]), make_pooling("authors")
    picture = photograph(size)
    found = run(lambda ctx, g: BlurPass(ctx, g, pooling), geometry, picture, gaze_px)
    wanted = blur(picture, PictureFixation(geometry, gaze_px).pools(pooling))
    np.testing.assert_allclose(found, wanted, atol=PLAIN_TOLERANCE)


@pytest.mark.parametrize(("size", "viewing", "gaze_px"), VIEWS)
def test_metamer_on_gpu_matches_reference(run, size, viewing, gaze_px):
    geometry, settings = viewing.of(size[1], size[0]), MetamerSettings()
    picture = photograph(size)
    fixation = PictureFixation(geometry, gaze_px, seed=4)
    found = run(lambda ctx, g: MetamerPass(ctx, g, settings), geometry, picture, gaze_px, seed=4)
    wanted = metamer(picture, fixation.pools(settings.pooling), settings, 4)
    np.testing.assert_allclose(found, wanted, atol=TOLERANCE)


@pytest.mark.parametrize(
    "switches",
    [
        {"chroma": "luma"},
        {"residual": "pooled"},
        {"noise": 0.5},
        {"levels": 1},
        {"levels": 6},
        {"pooling": Pooling("linear", 0.46, 0.0)},
    ],
)
def test_every_switch_on_gpu_matches_reference(run, switches):
    size, gaze_px = (150, 170), (20.0, 140.0)
    geometry, settings = Flat(60).of(size[1], size[0]), MetamerSettings(**switches)
    picture = photograph(size)
    fixation = PictureFixation(geometry, gaze_px, seed=1)
    found = run(lambda ctx, g: MetamerPass(ctx, g, settings), geometry, picture, gaze_px, seed=1)
    wanted = metamer(picture, fixation.pools(settings.pooling), settings, 1)
    np.testing.assert_allclose(found, wanted, atol=TOLERANCE)


@pytest.mark.parametrize(("size", "viewing", "gaze_px"), VIEWS)
@pytest.mark.parametrize("match", [False, True])
def test_displacement_on_gpu_matches_reference(run, size, viewing, gaze_px, match):
    geometry, settings = viewing.of(size[1], size[0]), DisplacementSettings()
    picture = photograph(size)
    field_gaze_px = (gaze_px[0] + 3, gaze_px[1])
    fixation = PictureFixation(geometry, gaze_px, seed=4, field_gaze_px=field_gaze_px)
    found = run(
        lambda ctx, g: DisplacementPass(ctx, g, settings, match=match),
        geometry,
        picture,
        gaze_px,
        seed=4,
        field_gaze_px=field_gaze_px,
    )
    wanted = (warped_metamer if match else eidolon)(
        picture,
        fixation.pools(settings.pooling),
        settings,
        4,
        field_pools=fixation.field_pools(settings.pooling),
    )
    # Places are known to some 1e-5 px, and a picture's edge is one step of it a pixel.
    np.testing.assert_allclose(found, wanted, atol=0.5 / 255)


@pytest.mark.parametrize(("method", "gaze_px"), PANORAMA_LOOKS)
def test_panorama_on_gpu_matches_reference(gl_context, method, gaze_px):
    """Belt and caps together, also where they are mixed and at the poles."""
    picture = photograph((60, 120))
    plain, drawn = (
        foveate(picture, gaze_px, viewing=Equirectangular(), method=method, seed=4, ctx=ctx)
        for ctx in (None, gl_context)
    )
    np.testing.assert_allclose(drawn, plain, atol=0.5 / 255)
    assert np.abs(plain - picture)[:6].mean() > 0.005


def test_panoramas_carry_noise_by_numpy(gl_context, rng):
    picture, shift = photograph((32, 64)), rng.random((32, 64, 2))
    plain, drawn = (
        foveate(picture, (3, 9), viewing=Equirectangular(), noise_shift_px=shift, ctx=ctx)
        for ctx in (None, gl_context)
    )
    assert (drawn == plain).all()


def test_carried_displacement_is_left_to_numpy(gl_context, rng):
    picture, shift = photograph((40, 40)), rng.random((40, 40, 2))
    foveator = Foveator((40, 40), method="eidolon", ctx=gl_context)
    drawn = foveator(picture, (-20, 0), noise_shift_px=shift)
    foveator.release()
    plain = foveate(picture, (-20, 0), method="eidolon", noise_shift_px=shift)
    assert (drawn == plain).all()


def test_carried_noise_on_gpu_matches_reference(run, rng):
    size, gaze_px = (80, 100), (-30.0, 10.0)
    geometry, settings = Flat(60).of(size[1], size[0]), MetamerSettings()
    shift = rng.uniform(-300, 300, (*size, 2)).astype(np.float32)
    picture = photograph(size)
    fixation = PictureFixation(geometry, gaze_px, seed=1, noise_shift_px=shift)
    found = run(
        lambda ctx, g: MetamerPass(ctx, g, settings),
        geometry,
        picture,
        gaze_px,
        seed=1,
        noise_shift_px=shift,
    )
    wanted = metamer(picture, fixation.pools(settings.pooling), settings, 1, noise_shift_px=shift)
    # Interpolated at places that float32 knows to 3e-5 px.
    np.testing.assert_allclose(found, wanted, atol=1 / 255)


@pytest.mark.parametrize("carried", [False, True])
def test_fovea_bits_are_the_pictures_on_gpu(run, carried):
    """Also of the first frame with carried noise, whose shader is compiled when it comes."""
    size, gaze_px = (128, 128), (64.0, 50.0)
    geometry = Flat(40).of(128, 128)
    settings = MetamerSettings(Pooling("linear", 0.5, 3.0))
    picture = photograph(size)
    shift = {"noise_shift_px": np.ones((*size, 2))} if carried else {}
    found = run(lambda ctx, g: MetamerPass(ctx, g, settings), geometry, picture, gaze_px, **shift)
    inside = PictureFixation(geometry, gaze_px).pools(settings.pooling).eccentricity_deg() < 2.999
    assert inside.sum() > 200
    assert (found[inside] == picture[inside]).all()


@pytest.mark.parametrize("edge", [128, 200])
def test_passes_are_two_per_halving_and_one(gl_context, edge):
    geometry = Flat(40).of(edge, edge)
    made = MetamerPass(gl_context, geometry, MetamerSettings(), seed=0)
    source, target = (create_texture(gl_context, (edge, edge), "rgba32f") for _ in range(2))
    halvings = int(np.ceil(np.log2(edge))) - 3
    found = dispatches_of(lambda: made(source, target, (edge / 2, edge / 2)))
    assert len(found) == 2 * halvings + 1
    for thing in (made, source, target):
        thing.release()


def test_a_call_makes_no_object_and_seeds_and_gazes_come_back(gl_context, gl_watch):
    geometry, picture = Flat(40).of(96, 96), photograph((96, 96))
    made = MetamerPass(gl_context, geometry, MetamerSettings())
    source = texture_from(gl_context, np.dstack([picture, picture[..., :1]]), "rgba32f")
    target = create_texture(gl_context, (96, 96), "rgba32f")

    def show(gaze_px, seed):
        made(source, target, gaze_px, seed=seed)
        return read_back(target)

    first = show((-40, 10), 1)
    watch = gl_watch()
    other = show((-10, 90), 2)
    again = show((-40, 10), 1)
    assert not watch.gained()
    assert (first == again).all()
    assert np.abs(first - other).max() > 0.05
    assert (first[..., 3] == picture[..., 0]).all()  # alpha
    for thing in (made, source, target):
        thing.release()


def test_another_texture_size_is_refused(gl_context):
    made = BlurPass(gl_context, Flat(40).of(20, 30), Pooling())
    wrong = create_texture(gl_context, (30, 20), "rgba32f")
    with pytest.raises(InputError, match="source must be 20x30"):
        made(wrong, wrong, (1, 1))
    wrong.release()
    made.release()


@pytest.mark.parametrize("name", ["reference", "blur", "eidolon"])
def test_the_one_call_takes_a_context_whether_or_not_the_condition_uses_it(gl_context, name):
    picture = photograph((40, 48))
    plain = foveate(picture, (5, 5), method=name, seed=1)
    drawn = foveate(picture, (5, 5), method=name, seed=1, ctx=gl_context)
    np.testing.assert_allclose(drawn, plain, atol=1 / 255)


def test_full_chroma_is_left_to_numpy(gl_context):
    foveator = Foveator((32, 32), method="metamer", ctx=gl_context, chroma="full")
    assert foveator.passes is None
    foveator.release()


HELD = [
    ("blur", Flat(40)),
    ("metamer", Flat(60)),
    ("eidolon", Flat(60)),
    ("warped-metamer", Flat(60)),
    ("warped-metamer", Equirectangular()),
]


@pytest.mark.parametrize(("method", "viewing"), HELD)
def test_a_picture_that_is_held_is_shown_bit_for_bit_as_it_would_be_anew(
    gl_context, method, viewing
):
    """Also back at a gaze where it was, with another seed between, and with a field at rest."""
    picture = photograph((50, 100))
    looks = [
        {"gaze_px": (20.0, 10.0), "seed": 1},
        {"gaze_px": (90.0, 40.0), "seed": 1, "field_gaze_px": (20.0, 10.0)},
        {"gaze_px": (90.0, 40.0), "seed": 2},
        {"gaze_px": (20.0, 10.0), "seed": 1},
    ]
    foveator = Foveator((50, 100), viewing=viewing, method=method, ctx=gl_context)
    anew = [foveator(picture, **fixation) for fixation in looks]
    foveator.hold(picture)
    held = [foveator.show(**fixation) for fixation in looks]
    foveator.release()
    for one, other in zip(held, anew, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (held[0] != held[1]).any()


def test_a_picture_is_analysed_once_and_what_rests_is_not_displaced_again(gl_context):
    foveator = Foveator((96, 96), method="warped-metamer", ctx=gl_context)
    source, target = (create_texture(gl_context, (96, 96), "rgba32f") for _ in range(2))
    passes, rests = foveator.passes, {"field_gaze_px": (40.0, 40.0)}
    passes(source, target, (3.0, 4.0), **rests)
    shown = dispatches_of(lambda: passes.show(target, (50.0, 60.0), **rests))
    assert not set(shown) & {
        "foveation/shaders/pull.comp.glsl",
        "foveation/shaders/field.comp.glsl",
        "foveation/shaders/displace.comp.glsl",
    }
    moved = dispatches_of(lambda: passes.show(target, (50.0, 60.0), field_gaze_px=(41.0, 40.0)))
    assert len(moved) > len(shown)
    rested = dispatches_of(lambda: passes.show(target, (50.0, 60.0), field_gaze_px=(41.0, 40.0)))
    assert rested == ["foveation/shaders/join.comp.glsl"]
    passes.hold(source)
    assert len(dispatches_of(lambda: passes.show(target, (50.0, 60.0), **rests))) > len(shown)
    for thing in (foveator, source, target):
        thing.release()


@pytest.mark.parametrize("method", ["metamer", "contrast-enhanced", "files"])
def test_pictures_of_8_bits_are_held_as_they_are(gl_context, method, tmp_path):
    bits = data.astronaut()[60:124, 120:200]
    if method == "files":
        Image.fromarray(bits).save(tmp_path / "000000.png")
        method = f"files:{tmp_path}"
    foveator = Foveator((64, 80), method=method, ctx=gl_context)
    shown = foveator((bits / 255).astype(np.float32), (9, 9))
    foveator.hold(bits)
    np.testing.assert_allclose(foveator.show((9, 9)), shown, atol=PLAIN_TOLERANCE)
    assert foveator.passes is None or "rgba8" in foveator.passes._ends
    foveator.release()


def test_nothing_is_shown_before_it_is_held():
    foveator = Foveator((20, 30), method="blur")
    with pytest.raises(InputError, match="must hold a picture"):
        foveator.show((1, 1))
    with pytest.raises(InputError, match="30 x 20"):
        foveator.hold(np.zeros((30, 20, 3), np.uint8))
    with pytest.raises(InputError, match="floating type"):
        foveator.hold(np.zeros((20, 30, 3), np.uint16))
    with pytest.raises(InputError, match=r"shape \(H, W, 3\)"):
        foveator.hold([[0.5, 0.5]])  # before, an AttributeError


def test_a_frame_is_replayed_and_looks_nothing_up(gl_context):
    """Of 864 calls for a metamer, when each frame bound by name, at most a fifth is left."""
    foveator = Foveator((128, 128), ctx=gl_context)
    source, target = (create_texture(gl_context, (128, 128), "rgba32f") for _ in range(2))
    foveator.passes(source, target, (1.0, 2.0))
    calls = []
    sys.setprofile(lambda _frame, event, _argument: calls.append(event))
    foveator.passes(source, target, (3.0, 4.0))
    sys.setprofile(None)
    assert sum(event in ("call", "c_call") for event in calls) < 864 / 5
    for thing in (foveator, source, target):
        thing.release()


@pytest.mark.parametrize("method", ["blur", "metamer", "eidolon", "warped-metamer"])
@pytest.mark.parametrize("viewing", [Flat(40), Equirectangular()])
def test_frames_make_no_gl_objects(gl_context, refuse_gl_objects, viewing, method):
    """After the first: pictures held anew, gazes, read back or not."""
    size = (64, 128)
    foveator = Foveator(size, viewing=viewing, method=method, ctx=gl_context)
    source, target = (create_texture(gl_context, size[::-1], "rgba32f") for _ in range(2))
    picture = photograph(size)
    foveator.hold(picture)
    foveator.show((60.0, 30.0))
    foveator.passes(source, target, (1.0, 2.0))
    refuse_gl_objects()
    foveator.passes.hold(source)
    foveator.passes.show(target, (3.0, 4.0), field_gaze_px=(1.0, 2.0))
    foveator.hold(picture)
    foveator.show((50.0, 20.0))
    for thing in (foveator, source, target):
        thing.release()


def test_frames_that_take_turns_with_textures_stay_apart(gl_context):
    """Two sources and two targets, each pair recorded: none shows another's picture."""
    size, gaze_px = (64, 64), (10.0, 20.0)
    foveator = Foveator(size, ctx=gl_context)
    pictures = [photograph(size), photograph(size)[::-1].copy()]
    sources = [
        texture_from(gl_context, np.dstack([one, one[..., :1]]), "rgba32f") for one in pictures
    ]
    targets = [create_texture(gl_context, size, "rgba32f") for _ in range(2)]
    for _ in range(2):
        for source, target in zip(sources, targets, strict=True):
            foveator.passes(source, target, gaze_px)
    shown = [read_back(target)[..., :3] for target in targets]
    for one, picture in zip(shown, pictures, strict=True):
        np.testing.assert_array_equal(one, foveator(picture, gaze_px))
    for thing in (foveator, *sources, *targets):
        thing.release()


def test_the_last_picture_is_as_any_other_and_all_else_is_freed_before(gl_context, rng):
    picture = rng.integers(0, 255, (40, 60, 3)).astype(np.uint8)
    foveator = Foveator((40, 60), ctx=gl_context)
    foveator.hold(picture)
    passes, shown = foveator.passes, foveator.show((9, 9), seed=2)
    assert passes.held_bytes > 0
    np.testing.assert_array_equal(foveator.show((9, 9), seed=2, last=True), shown)
    assert passes.held_bytes == 0
    foveator.release()


def test_noise_is_made_before_passes_take_memory(gl_context, monkeypatch):
    """It needs 54 bytes a pixel for a while."""
    events = []

    def noted(word, work):
        return lambda *given, **named: (events.append(word), work(*given, **named))[1]

    monkeypatch.setattr(MetamerPass, "_analysis", noted("memory", MetamerPass._analysis))
    monkeypatch.setattr(NoisePass, "_raised", noted("noise", NoisePass._raised))
    foveate(photograph((40, 48)), (5, 5), seed=1, ctx=gl_context)
    look_through(photograph((40, 48)), (5, 5), Flat(40), [Choice("metamer")], ctx=gl_context)
    assert [event for event, _ in itertools.groupby(events)] == ["noise", "memory"] * 2


@pytest.mark.parametrize(("method", "viewing"), HELD)
def test_the_last_pass_of_the_last_picture_holds_what_it_reads(
    gl_context, monkeypatch, method, viewing
):
    foveator = Foveator((64, 128), viewing=viewing, method=method, ctx=gl_context)
    foveator.hold(photograph((64, 128)))
    shown, kind, held = foveator.show((9, 9)), type(foveator.passes), []
    finish = kind._finish

    def watched(self, *given):
        held.append(self.held_bytes)
        finish(self, *given)

    monkeypatch.setattr(kind, "_finish", watched)
    foveator.show((9, 9))
    np.testing.assert_array_equal(foveator.show((9, 9), last=True), shown)
    assert held[-1] < 0.9 * held[0]
    foveator.release()


_PEAK = """
import re, sys
from pathlib import Path
from study_app.cli import app
try:
    app(["foveate", *sys.argv[1:]])
finally:
    print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "most_mb"),
    [("metamer", 900), pytest.param("warped-metamer", 1480, marks=pytest.mark.full)],
)
def test_a_large_picture_takes_as_much_memory_as_the_page_says(tmp_path, method, most_mb):
    rng = np.random.default_rng(1)
    rows = rng.integers(0, 255, (700, 1050, 3)).astype(np.uint8)
    large = Image.fromarray(rows).resize((4200, 2800), Image.Resampling.BICUBIC)
    large.save(tmp_path / "large.jpg")
    words = [sys.executable, "-c", _PEAK, "large.jpg", "out.png", "-m", method]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert 1.024e-3 * int(done.stdout.split()[-1]) < most_mb
