"""Panoramas: geometry of their poles, noise and displacement there, and no seam between charts."""

import numpy as np
import pytest

from pipeline.foveation import enhancement
from pipeline.foveation.catalogue import Blur, Eidolon, Metamer, NoiseEnhanced
from pipeline.foveation.conditions import condition_names, foveate
from pipeline.foveation.geometry import CapGeometry, Equirectangular, Flat, pixel_centres
from pipeline.foveation.panorama import cap_look, cap_of, cap_picture, over_poles
from pipeline.foveation.picture_fixation import PictureFixation
from pipeline.foveation.sphere import BELT_DEG, CAP_DEG, cap_shares, displaced_rays, unit_noise
from pipeline.foveation.view import flat_view
from pipeline.noise.tile import Stream, key_of

SIZE = (512, 256)


def lattice_key(seed):
    return key_of(seed, Stream.LATTICE)


@pytest.fixture(scope="module")
def geometry():
    return Equirectangular().of(*SIZE)


@pytest.fixture(scope="module")
def texture(geometry):
    """Waves in space, alike in all directions, finest as long as 6 px at the equator."""
    rays = geometry.directions(*pixel_centres(geometry))
    rng = np.random.default_rng(4)
    waves = rng.standard_normal((80, 3))
    waves *= (2 ** rng.uniform(3, 6.3, 80) / np.linalg.norm(waves, axis=1))[:, None]
    grey = 0.5 + 0.02 * np.sin(rays @ waves.T + rng.uniform(0, 6.3, 80)).sum(axis=2)
    return np.repeat(grey[..., None], 3, axis=2).clip(0, 1).astype(np.float32)


@pytest.fixture(scope="module")
def noisy(texture):
    """The metamer of the texture, the gaze on the horizon."""
    return foveate(texture, (0, 128), viewing=Equirectangular(), seed=3)


@pytest.mark.parametrize("upper", [True, False])
def test_a_cap_is_stereographic(geometry, upper, rng):
    """Positions invert directions, the pole is in the middle, and small circles are circles."""
    cap = cap_of(geometry, upper=upper)
    rays = rng.standard_normal((40, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    np.testing.assert_allclose(cap.directions(*cap.positions(rays)), rays, atol=1e-9)
    middle = np.array(cap.edge_px / 2)
    np.testing.assert_allclose(cap.directions(middle, middle), [0, -1 if upper else 1, 0])
    x, y = (rng.uniform(0, cap.edge_px, 40) for _ in range(2))
    step = 1e-4
    right, down = (
        (cap.directions(x + across, y + below) - cap.directions(x, y)) / step
        for across, below in ((step, 0), (0, step))
    )
    per_px = 1 / np.radians(1) / cap.px_per_deg(x, y) * np.radians(1) ** 2
    for side in (right, down):
        np.testing.assert_allclose(np.linalg.norm(side, axis=1), per_px, rtol=1e-3)
    np.testing.assert_allclose((right * down).sum(axis=1), 0, atol=1e-3 * per_px.max() ** 2)
    # Not mirrored: seen from the middle, right and down turn as on any picture.
    turn = np.cross(right, down)
    assert ((turn * cap.directions(x, y)).sum(axis=1) > 0).all()


def test_caps_show_what_the_panorama_shows(geometry, texture):
    """A cap looked at directly is the flat view of the pole."""
    cap = CapGeometry(64, cap_of(geometry, upper=True).radian_px, upper=True)
    seen = cap_picture(texture, cap)
    view = Flat(width_deg=30).of(65, 65)
    straight = flat_view(texture, view, down_deg=-90)
    rays = view.directions(*pixel_centres(view))
    # The view's ahead is up, its up is behind.
    turned = np.stack([rays[..., 0], -rays[..., 2], rays[..., 1]], axis=-1)
    x, y = cap.positions(turned)
    nearest = seen[y.astype(int), x.astype(int)]
    inside = (x % 1 > 0.2) & (x % 1 < 0.8) & (y % 1 > 0.2) & (y % 1 < 0.8)
    assert np.abs(nearest - straight)[inside].mean() < 0.02 < straight.std() / 2


def test_rows_over_a_pole_come_back_on_the_other_meridian(rng):
    panorama = rng.random((4, 8, 1)).astype(np.float32)
    tall = over_poles(panorama, 2)
    assert (tall[2:6] == panorama).all()
    assert (tall[1] == np.roll(panorama[0], 4, axis=0)).all()
    assert (tall[0] == np.roll(panorama[1], 4, axis=0)).all()
    assert (tall[7] == np.roll(panorama[2], 4, axis=0)).all()


def test_shares_of_belt_and_caps_meet_without_a_step():
    tall = Equirectangular().of(4096, 2048)
    rays = tall.directions(np.zeros(2048), pixel_centres(tall)[1][:, 0])
    latitude = np.degrees(np.arcsin(np.abs(rays[:, 1])))
    share = cap_shares(rays)
    assert (share[latitude < BELT_DEG] == 0).all()
    assert (share[latitude > CAP_DEG] == 1).all()
    assert np.abs(np.diff(share)).max() < 0.02


def evenness(picture, **towards):
    """Steps across over steps down, in a flat view 40 degrees wide; and their size."""
    seen = flat_view(picture, Flat(width_deg=40).of(72, 72), **towards)[..., 0].astype(np.float64)
    rows, columns = np.mgrid[:72, :72] - 35.5
    x, y = np.gradient(seen, axis=1), np.gradient(seen, axis=0)
    radius = np.maximum(np.hypot(rows, columns), 1)
    outwards = (x * columns + y * rows) / radius
    round_it = (x * rows - y * columns) / radius
    near = radius < 30
    return outwards[near].std() / round_it[near].std(), seen[near].std()


def test_noise_runs_in_no_streaks_to_the_pole(geometry, texture, noisy):
    in_pixels = Metamer().apply(texture, PictureFixation(geometry, (0, 128), seed=3))
    for down_deg in (-90, 90):
        even, strength = evenness(noisy, down_deg=down_deg)
        streaky, _ = evenness(in_pixels, down_deg=down_deg)
        assert 0.85 < even < 1.18
        assert streaky < 0.8
        assert strength == pytest.approx(evenness(texture, down_deg=down_deg)[1], rel=0.3)


def test_noise_is_as_strong_where_belt_and_caps_are_mixed(texture, noisy):
    blur = foveate(texture, (0, 128), viewing=Equirectangular(), method="blur")
    by_row = (noisy - blur).astype(np.float64)[..., 0].std(axis=1)
    latitude = 90 - (np.arange(256) + 0.5) * 180 / 256
    mixed = by_row[(np.abs(latitude) > 47) & (np.abs(latitude) < 53)].mean()
    beside = np.abs(latitude)
    around = by_row[((beside > 38) & (beside < 45)) | ((beside > 55) & (beside < 62))].mean()
    assert mixed == pytest.approx(around, rel=0.1)


def test_noise_of_a_blur_is_made_stronger_there_too(geometry, texture, monkeypatch):
    """Of the finest octave; a real panorama of so few pixels gets no noise."""
    finest = lambda _, count: [np.full((256, 512), float(k == 0)) for k in range(count)]  # noqa: E731
    monkeypatch.setattr(enhancement, "octave_shares", finest)
    fixation, made = PictureFixation(geometry, (0, 128), seed=1), NoiseEnhanced()
    blur = Blur(rate=1.4).apply(texture, fixation)
    strong = made.apply(texture, fixation) - blur
    monkeypatch.setattr(enhancement, "noise_strength", lambda rays: np.ones(rays.shape[:2]))
    plain = made.apply(texture, fixation) - blur
    row = round(256 * (90 - 50) / 180)  # half of each
    wide = np.abs(plain[row]) > 1e-3
    assert wide.sum() > 100
    ratio = np.median((strong[row] / plain[row])[wide])  # single ones are clipped
    assert ratio == pytest.approx(2**0.5, rel=0.01)
    assert (strong[128] == plain[128]).all()


def test_belt_and_cap_displace_alike(geometry, texture):
    """Mixed places show nothing twice: both charts show the same picture."""
    fixation, made = PictureFixation(geometry, (100, 120), seed=2), Eidolon()
    belt = made.apply(texture, fixation)
    cap = cap_of(geometry, upper=True)
    shown = made.apply(cap_picture(texture, cap), cap_look(fixation, cap))
    rows = slice(46, 62)  # 58 to 47 degrees
    x, y = pixel_centres(geometry)
    at_x, at_y = cap.positions(geometry.directions(x, y[rows]))
    nearest = shown[at_y.astype(int), at_x.astype(int)]
    inside = (np.abs(at_x % 1 - 0.5) < 0.15) & (np.abs(at_y % 1 - 0.5) < 0.15)
    assert inside.sum() > 300
    other = made.apply(texture, PictureFixation(geometry, (100, 120), seed=3))
    alike, unlike = (np.abs(image[rows] - nearest)[inside].mean() for image in (belt, other))
    assert alike < 0.2 * unlike


def test_displacement_is_as_long_as_asked_in_all_directions(rng):
    rays = rng.standard_normal((4000, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    sigma = np.full(4000, 0.02)
    moved = displaced_rays(rays, sigma, reach=0.35, smoothness=0.5, key=lattice_key(1)) - rays
    length = np.sqrt((moved**2).sum(axis=1).mean())
    assert length == pytest.approx(0.35 * 0.02 * np.sqrt(2), rel=0.05)
    # Nowhere out of the sphere, and across the meridian as far as along it.
    assert np.abs((moved * rays).sum(axis=1)).max() < 2e-3
    east = np.cross([0.0, 1.0, 0.0], rays)
    east /= np.linalg.norm(east, axis=1)[:, None]
    across = ((moved * east).sum(axis=1) ** 2).mean()
    assert across == pytest.approx(length**2 / 2, rel=0.12)
    other = displaced_rays(rays, sigma, reach=0.35, smoothness=0.5, key=lattice_key(2)) - rays
    assert abs(np.corrcoef(moved.ravel(), other.ravel())[0, 1]) < 0.05


@pytest.mark.parametrize("smooth", [0.011, 0.05])
def test_noise_of_directions_is_as_smooth_as_noise_pooled_so(rng, smooth):
    """White noise pooled by a Gaussian falls to exp(-1/4) at one of its deviations."""
    rays = rng.standard_normal((6000, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    aside = np.cross(rays, rng.standard_normal(3))
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    beside = np.cos(smooth) * rays + np.sin(smooth) * aside
    here, there = (
        unit_noise(place, np.full(6000, smooth), lattice_key(7)) for place in (rays, beside)
    )
    assert (here**2).mean() == pytest.approx(1, rel=0.05)
    assert (here * there).mean() == pytest.approx(np.exp(-0.25), abs=0.08)


@pytest.mark.parametrize("method", ["metamer", "warped-metamer"])
def test_a_fovea_at_the_pole_is_copied_bit_for_bit(texture, method):
    small = np.ascontiguousarray(texture[::2, ::2])
    shown = foveate(small, (40, 2), viewing=Equirectangular(), method=method, fovea_deg=8)
    fixation = PictureFixation(Equirectangular().of(256, 128), (40, 2))
    away = fixation.pools(Blur(fovea_deg=8).pooling).eccentricity_deg()
    assert (shown[away <= 8] == small[away <= 8]).all()
    assert (shown[away > 20] != small[away > 20]).mean() > 0.9


def test_noise_that_turns_with_the_panorama_turns_with_its_caps(geometry):
    """A panorama turned by 40 px is a cap turned by as much about its middle."""
    shift = np.broadcast_to([40.0, 0.0], (256, 512, 2))
    for upper in (True, False):
        cap = cap_of(geometry, upper=upper)
        carried = cap_look(
            PictureFixation(geometry, (9, 9), noise_shift_px=shift), cap
        ).noise_shift_px
        x, y = np.broadcast_arrays(*pixel_centres(cap))
        middle = cap.edge_px / 2
        from_x, from_y = x - carried[..., 0] - middle, y - carried[..., 1] - middle
        here = (x - middle) + 1j * (y - middle)
        turned = (from_x + 1j * from_y) / here
        angle = 2 * np.pi * 40 / 512 * (-1 if upper else 1)
        np.testing.assert_allclose(turned, np.exp(-1j * angle), atol=1e-6)


def test_the_smallest_panorama_is_shown():
    picture = np.full((1, 2, 3), 0.4, np.float32)
    for method in ("metamer", "warped-metamer", "noise-enhanced"):
        shown = foveate(picture, (0, 0), viewing=Equirectangular(), method=method)
        np.testing.assert_allclose(shown, picture, atol=1e-5)


@pytest.mark.parametrize(
    "method", [name for name in condition_names() if name not in ("reference", "files:FOLDER")]
)
@pytest.mark.parametrize("on_gpu", [False, True], ids=["numpy", "gpu"])
def test_every_condition_is_centred_on_the_gaze_of_a_panorama(method, on_gpu, rng, request):
    """Of noise, what is left unchanged is the fovea's disc on the sphere, here over the seam."""
    more = {}
    if method == "energy-metamer":
        pytest.importorskip(
            "torch", reason="needs the extra `metamers`: script/setup --metamers installs it"
        )
        more = {"steps": 1}
    ctx = request.getfixturevalue("gl_context") if on_gpu else None
    width, height, fovea_deg = 256, 128, 18.0
    panorama = rng.random((height, width, 3)).astype(np.float32)
    gaze = (4.5, 40.0)  # 26 degrees above the horizon
    made = foveate(
        panorama, gaze, viewing=Equirectangular(), method=method, ctx=ctx, fovea_deg=fovea_deg,
        **more,
    )  # fmt: skip

    kept = (made == panorama).all(axis=2)
    around = Equirectangular().of(width, height)
    rays = around.directions(*pixel_centres(around))
    looked = around.directions(np.array(gaze[0]), np.array(gaze[1]))
    away = np.degrees(np.arccos(np.clip(rays @ looked, -1, 1)))
    pixel_deg = 360 / width
    assert kept[away < fovea_deg].all()
    assert not kept[away > fovea_deg + 2 * pixel_deg].any()
    latitude = np.cos(np.radians(90 - (np.arange(height) + 0.5) * 180 / height))[:, None]
    middle = (rays * (kept * latitude)[..., None]).sum(axis=(0, 1))
    off = np.degrees(np.arccos(middle @ looked / np.linalg.norm(middle)))
    assert off < 0.25 * pixel_deg
