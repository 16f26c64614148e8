"""The registry of conditions and the one call."""

import inspect
import math
from importlib.util import find_spec

import numpy as np
import pytest
from PIL import Image

from benchmarks.foveate_quality import band_ratios
from pipeline.errors import InputError
from pipeline.foveation.conditions import (
    CONDITIONS,
    Foveator,
    condition_names,
    condition_parameters,
    create_condition,
    foveate,
)
from pipeline.foveation.geometry import Equirectangular, Flat
from pipeline.foveation.pooling import Pools, make_pooling
from pipeline.foveation.steady_gaze import SteadyGaze, carried

NEEDS_TORCH = pytest.mark.skipif(
    find_spec("torch") is None,
    reason="needs the extra `metamers`: script/setup --metamers installs it",
)
MADE_HERE = [
    pytest.param(
        entry.name, marks=(NEEDS_TORCH, pytest.mark.slow) if entry.name == "energy-metamer" else ()
    )
    for entry in CONDITIONS
    if not entry.takes_path
]


@pytest.fixture
def picture(rng):
    y, x = np.mgrid[:48, :64] / 16
    waves = np.stack([np.sin(3 * x + y), np.sin(2 * y), np.cos(x * y)], axis=2)
    return (0.5 + 0.3 * waves + 0.1 * rng.random((48, 64, 3))).clip(0, 1).astype(np.float32)


@pytest.mark.parametrize("name", MADE_HERE)
def test_every_condition_keeps_the_fovea_and_answers_twice_alike(picture, name):
    viewing = Flat(width_deg=60)
    results = [
        foveate(picture, (20, 24), viewing=viewing, method=name, seed=7, fovea_deg=5)
        if name != "reference"
        else foveate(picture, (20, 24), viewing=viewing, method=name)
        for _ in range(2)
    ]
    assert (results[0] == results[1]).all()
    assert results[0].dtype == np.float32
    assert results[0].shape == picture.shape
    fovea = np.hypot(*np.meshgrid(np.arange(64) - 19.5, np.arange(48) - 23.5)) < 3
    assert (results[0][fovea] == picture[fovea]).all()
    assert (results[0] != picture).any() == (name != "reference")


@pytest.mark.parametrize("name", ["metamer", "eidolon", "warped-metamer"])
def test_seeds_differ_outside_the_fovea_only(picture, name):
    one, two = (foveate(picture, (10, 10), method=name, seed=s, viewing=Flat(120)) for s in (1, 2))
    assert np.abs(one - two).max() > 0.02
    assert (one[10, 10] == two[10, 10]).all()


def test_enhancing_noise_lies_between_what_is_resolved_and_what_is_detected(picture):
    """24 px per degree: at 12 degrees, gratings of 10 to 12 cycles per degree are left."""
    viewing = Flat(distance_px=1400)
    one, two = (
        foveate(picture, (-300, 24), method="noise-enhanced", seed=s, viewing=viewing)
        for s in (1, 2)
    )
    assert np.abs(one - two).max() > 0.01
    near = Flat(distance_px=200)  # 3.5 px per degree: all that pixels can show is resolved
    same = [
        foveate(picture, (32, 24), method="noise-enhanced", seed=s, viewing=near) for s in (1, 2)
    ]
    assert (same[0] == same[1]).all()


def noise_picture(exponent, blur_px, edge, seed):
    """Grey noise of a spectrum around .5: (edge, edge, 3)."""
    white = np.random.default_rng(seed).standard_normal((edge, edge))
    steps = np.fft.fftfreq(edge)
    frequency = np.maximum(np.hypot(steps[:, None], steps), 1 / edge)
    shape = frequency**-exponent * np.exp(-2 * (math.pi * blur_px * frequency) ** 2)
    plane = np.real(np.fft.ifft2(np.fft.fft2(white) * shape))
    plane = (plane - plane.mean()) / plane.std()
    grey = np.clip(0.5 + 0.12 * plane, 0, 1)
    return np.repeat(grey[..., None], 3, axis=2).astype(np.float32)


@pytest.mark.parametrize("blur_px", [1, 4])
def test_enhancing_noise_is_not_stronger_than_what_a_smooth_picture_has(blur_px):
    """Bands were 10 and 70 times as strong as the picture's."""
    smooth = noise_picture(1.5, blur_px, 256, 1)
    viewing, gaze = Flat(width_deg=20), (0, 128)
    shown = foveate(smooth, gaze, method="noise-enhanced", viewing=viewing)
    pools = Pools(viewing.of(256, 256), gaze, make_pooling("v1"))
    assert np.nanmax(band_ratios(shown, smooth, pools)) < 2.35


@pytest.mark.parametrize("name", MADE_HERE)
@pytest.mark.parametrize("size", [(1, 1), (1, 5), (9, 2), (17, 23)])
def test_pictures_of_any_size_are_taken(rng, name, size):
    picture = rng.random((*size, 3))
    result = foveate(picture, (-4, 900), method=name)
    assert result.shape == picture.shape
    assert np.isfinite(result).all()


@pytest.mark.parametrize("name", MADE_HERE)
def test_panoramas_are_taken(rng, name):
    picture = rng.random((40, 80, 3))
    result = foveate(picture, (79.9, 1), method=name, viewing=Equirectangular())
    assert np.isfinite(result).all()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"method": "metamr"}, "did you mean 'metamer'"),
        ({"method": "warped_metamer"}, "did you mean 'warped-metamer'"),
        ({"method": "files:"}, "must name a path"),
        ({"scalling": 0.3}, "did you mean 'scaling'"),
        ({"scaling": "wide"}, "must be int or float"),
        ({"chroma": "some"}, "follow, full, luma"),
        ({"residual": "none"}, "kept, pooled"),
        ({"noise": -1}, "noise must lie"),
        ({"levels": 9}, "levels must lie"),
        ({"seed": -1}, "seed must be"),
        ({"gaze_px": (np.inf, 0)}, "finite"),
        ({"noise_shift_px": np.zeros((2, 2, 2))}, "noise_shift_px must have shape"),
        ({"method": "eidolon", "reach": 3}, "reach must lie"),
        ({"method": "reference", "rate": 1.0}, "are: none"),
        ({"method": "blur", "chroma": "full"}, "parameters of blur are"),
        ({"picture": np.zeros((4, 4))}, "repeat a grey picture"),
        ({"picture": np.zeros((4, 4, 4))}, "transparent"),
        ({"picture": np.zeros((4, 4, 3), np.uint8)}, "divide 8-bit values by 255"),
        ({"picture": np.full((4, 4, 3), 1.5)}, "high dynamic range"),
        ({"picture": np.full((4, 4, 3), np.nan)}, "must lie in"),
    ],
)
def test_mistakes_get_one_clear_message(picture, arguments, match):
    call = {"picture": picture, "gaze_px": (5, 5), **arguments}
    with pytest.raises(InputError, match=match):
        foveate(**call)


def test_a_foveator_refuses_another_size(picture):
    foveator = Foveator((20, 20))
    with pytest.raises(InputError, match="20 x 20 px"):
        foveator(picture, (3, 3))


def test_every_condition_has_a_line_and_offers_its_parameters():
    assert condition_names()[-1] == "files:FOLDER"
    assert condition_parameters("metamer")["noise"] == 1.0
    assert condition_parameters("reference") == {}
    for entry in CONDITIONS:
        assert entry.summary
        assert inspect.isclass(entry.load())


def test_files_are_taken_by_frame_number(tmp_path, picture):
    made = (255 * picture[::-1]).round().astype(np.uint8)
    Image.fromarray(made).save(tmp_path / "000003.png")
    foveator = Foveator(picture.shape[:2], method=f"files:{tmp_path}")
    shown = foveator(picture, (1, 1), frame=3)
    np.testing.assert_allclose(shown, made / 255, atol=1e-6)
    with pytest.raises(InputError, match="must hold picture 000000"):
        foveate(picture, (1, 1), method=f"files:{tmp_path}")
    with pytest.raises(InputError, match="must be 64 x 47 px"):
        Foveator((47, 64), method=f"files:{tmp_path}")(picture[:47], (1, 1), frame=3)


def test_files_refuse_an_empty_folder(tmp_path):
    with pytest.raises(InputError, match="has none"):
        create_condition(f"files:{tmp_path}")


@pytest.mark.parametrize("copies", [2, 6])
def test_both_eyes_see_one_surface_with_one_noise(picture, copies):
    """The right eye's picture is the left one's, 4 px to the left, and so is its noise.

    Noise that stays on the screen and noise that a surface carries must be one, also where the
    picture needs a tile of more than 256 px.
    """
    left = np.concatenate([picture, picture[:, ::-1]] * (copies // 2), axis=1)
    right = np.roll(left, -4, axis=1)
    disparity = np.zeros((*right.shape[:2], 2))
    disparity[..., 0] = -4
    gaze = (-200.0, 24.0)
    seen_left = foveate(left, gaze, seed=1)
    seen_right = foveate(right, gaze, seed=1, noise_shift_px=disparity)
    on_screen = foveate(right, gaze, seed=1)
    inner = slice(8, -40)
    together = np.abs(np.roll(seen_left, -4, axis=1) - seen_right)[:, inner].mean()
    apart = np.abs(np.roll(seen_left, -4, axis=1) - on_screen)[:, inner].mean()
    assert together < 0.5 * apart


def test_carried_noise_follows_two_steps_of_motion():
    flow = np.zeros((6, 8, 2))
    flow[..., 0] = 1.5
    once = carried(None, flow)
    twice = carried(once, flow)
    np.testing.assert_array_equal(once, flow)
    np.testing.assert_allclose(twice[:, 3:], 2 * flow[:, 3:])
    with pytest.raises(InputError, match="shift_px must have shape"):
        carried(once[:3], flow)


def test_the_field_rests_within_a_fixation_and_goes_with_a_saccade():
    geometry = Flat(width_deg=40).of(512, 512)  # 13 px per degree
    state = SteadyGaze(geometry, (256, 256))
    drifted = state.after((259, 256), 0.1)
    assert drifted.field_px == (256, 256)
    assert drifted.eye_px == (259, 256)
    jumped = drifted.after((400, 256), 0.02)
    assert jumped.field_px == (400, 256)


def test_the_field_comes_after_a_slow_eye_without_a_jump():
    geometry = Flat(width_deg=40).of(512, 512)
    state = SteadyGaze(geometry, (100, 256))
    steps = []
    for frame in range(1, 240):
        before = state.field_px[0]
        state = state.after((100 + frame, 256), 1 / 60)  # 5 degrees per second
        steps.append(state.field_px[0] - before)
    assert max(steps) < 1.05
    assert state.eye_px[0] - state.field_px[0] < 60


def test_the_field_holds_while_nothing_is_known_of_the_eye():
    state = SteadyGaze(Flat(width_deg=40).of(512, 512), (100, 256))
    assert state.after((400, 256), 0) == state.after((400, 256), -0.1) == state
    lost = state.after((math.nan, math.nan), 0.5)
    assert (lost.eye_px, lost.field_px) == ((100, 256), (100, 256))
    # 7 degrees in a second are no saccade, though all was found in the last hundredth.
    found = lost.after((math.nan, 256), 0.49).after((190, 256), 0.01)
    assert found.eye_px == (190, 256)
    assert found.field_px[0] < 190
    around = SteadyGaze(Equirectangular().of(512, 256), (math.nan, math.nan))
    assert around.eye_px == (256, 128)
    assert around.after((256, 900), 0.01).field_px == (256, 256)


def test_a_moving_gaze_leaves_the_tamed_warp_alone(picture):
    gazes = ((20.0, 24.0), (21.0, 24.0))
    plain = [foveate(picture, gaze, method="warped-metamer", viewing=Flat(40)) for gaze in gazes]
    tamed = [
        foveate(picture, gaze, method="warped-metamer", viewing=Flat(40), field_gaze_px=gazes[0])
        for gaze in gazes
    ]
    far = np.s_[:, 35:]
    change = [np.abs(pair[0] - pair[1])[far].mean() for pair in (plain, tamed)]
    assert change[1] < 0.5 * change[0]


@pytest.mark.parametrize("on_gpu", [False, True])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_what_is_held_is_no_longer_the_callers(rng, request, on_gpu, kind):
    picture = rng.integers(0, 256, (40, 48, 3)).astype(kind)
    picture = picture if kind is np.uint8 else picture / kind(255)
    foveator = Foveator((40, 48), ctx=request.getfixturevalue("gl_context") if on_gpu else None)
    foveator.hold(picture)
    before = foveator.show((8, 8))
    picture[:] = 0
    np.testing.assert_array_equal(foveator.show((8, 8)), before)
    foveator.release()
    with pytest.raises(InputError, match="must hold a picture"):
        foveator.show((8, 8))


@pytest.mark.parametrize("size", [(5,), 5, (5, 5, 3), (5.0, 5.0), "ab", None, (0, 5)])
def test_a_size_that_is_none_is_refused(size):
    with pytest.raises(InputError, match=r"size must be|at least 1 x 1"):
        Foveator(size)
