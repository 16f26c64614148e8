"""Scenes with baked textures: the shader against numpy, the turning planet, the commands."""

import dataclasses

import numpy as np
import pytest
from command_line import outcome_of
from PIL import Image
from scipy.interpolate import griddata

from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import MetamerSettings, Pools
from pipeline.pictures.colour_file import save_colour
from pipeline.textures.bake import bake
from pipeline.textures.baked_file import read_baked
from pipeline.textures.reference import shade
from pipeline.textures.surface_noise import surface_noise
from stimuli.texture.draw_globes import TexturedRenderer
from stimuli.texture.scenes import SCENES, Globe, TexturedScene, planet_map

EDGE_PX = 96
GAZE_PX = (30.0, 40.0)
# A linear factor of 1 everywhere, and a globe larger than the picture.
BARE = TexturedScene("bare", "", (Globe((0, 0, 3.0), 1.3, 180.0),), (0.5, 0.5), (0, 0, 0), 0)


@pytest.fixture(scope="module")
def baked():
    return bake(planet_map(128), wraps=True)


@pytest.fixture
def renderer(gl_context, baked):
    made = TexturedRenderer(gl_context, baked, Flat(40.0).of(EDGE_PX, EDGE_PX), MetamerSettings())
    yield made
    made.release()


def test_the_shader_draws_what_numpy_says(renderer, baked):
    """Both read the same fragments. Half a step of 8 bits: sRGB there and back, in float32."""
    noise = surface_noise(0, baked.layout)
    for condition, foveated in (("reference", False), ("blur", True), ("metamer", True)):
        fragments, shown = renderer.fragments(BARE, GAZE_PX, foveated=foveated)
        assert shown.mean() > 0.6
        drawn = renderer.picture(BARE, condition, GAZE_PX)[shown]
        twin = shade(baked, fragments.where(shown[None][0]), noise)
        wanted = twin.base + (twin.noise if condition == "metamer" else 0)
        np.testing.assert_allclose(drawn, wanted.clip(0, 1), atol=0.5 / 255)
        assert (abs(twin.noise).max() > 0.05) == foveated


def test_a_pixel_s_pool_is_that_of_foveated_pictures(renderer):
    geometry = Flat(40.0).of(EDGE_PX, EDGE_PX)
    settings = MetamerSettings()
    fragments, shown = renderer.fragments(BARE, GAZE_PX, foveated=True)

    wanted = Pools(geometry, GAZE_PX, settings.pooling).lod().clip(0, settings.levels)

    np.testing.assert_allclose(fragments.eta[shown], wanted[shown], atol=2e-3)


def test_a_level_of_detail_follows_from_texels_per_pixel(renderer, baked):
    """In the middle of a globe: texels of a radian, over pixels that a radian of it covers."""
    fragments, _ = renderer.fragments(BARE, GAZE_PX, foveated=False)
    geometry = Flat(40.0).of(EDGE_PX, EDGE_PX)
    (globe,) = BARE.globes
    px_per_radian = geometry.distance_px * globe.radius_m / (globe.centre_m[2] - globe.radius_m)

    wanted = np.log2(baked.layout.width / (2 * np.pi) / px_per_radian)

    middle = fragments.rho[EDGE_PX // 2, EDGE_PX // 2]
    assert middle == pytest.approx(wanted, abs=0.03)


def test_noise_stays_on_a_planet_that_turns(renderer):
    """Noise of two frames, at the same places on the surface; and at the same pixels."""
    found = []
    for turn_deg in (0.0, 6.0):
        fragments, shown = renderer.fragments(BARE, GAZE_PX, foveated=True, turn_deg=turn_deg)
        metamer, blur = (
            renderer.picture(BARE, condition, GAZE_PX, turn_deg=turn_deg)
            for condition in ("metamer", "blur")
        )
        inner = shown & (np.hypot(*(np.indices(shown.shape) - EDGE_PX / 2)) < 0.3 * EDGE_PX)
        found.append((fragments.place_px, (metamer - blur)[..., 1], inner))
    (place_a, noise_a, shown), (place_b, noise_b, _) = found
    carried = griddata(place_a[shown], noise_a[shown], place_b[shown], method="cubic")
    both = np.isfinite(carried)
    assert both.mean() > 0.5

    on_surface = np.corrcoef(carried[both], noise_b[shown][both])[0, 1]
    on_screen = np.corrcoef(noise_a[shown], noise_b[shown])[0, 1]

    assert on_surface > 0.8
    assert abs(on_screen) < 0.3


def test_globes_show_the_side_that_faces_the_viewer(renderer, baked):
    """Longitude 180 is the middle of the map; turned by 90 degrees, a quarter of it farther."""
    for turn_deg, share in ((0.0, 0.5), (90.0, 0.25)):
        fragments, _ = renderer.fragments(BARE, GAZE_PX, foveated=False, turn_deg=turn_deg)
        x, y = fragments.place_px[EDGE_PX // 2, EDGE_PX // 2]
        assert x / baked.layout.width == pytest.approx(share, abs=0.01)
        assert y / baked.layout.height == pytest.approx(0.5, abs=0.01)


def test_the_planet_s_map_goes_round():
    found = planet_map(96).astype(float)
    across = abs(found[:, 0] - found[:, -1]).mean()
    inside = abs(np.diff(found, axis=1)).mean()
    assert across < 1.5 * inside


run = outcome_of()


@pytest.mark.slow
@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize("bits", [8, 16])
def test_bake_and_show_from_file_to_sheet(tmp_path, bits):
    path = tmp_path / "map.png"
    colour = planet_map(32)
    if bits == 16:
        colour = colour[..., 0]
        Image.fromarray(colour.astype(np.uint16) * 257).save(path)
    else:
        Image.fromarray(colour).save(path)

    assert (
        run("texture", "bake", path, "--wrap", "--out", tmp_path / "map.moments", status=None)[0]
        == 0
    )
    held = read_baked(tmp_path / "map.moments")
    np.testing.assert_array_equal(held.colour[0][..., 0], colour if bits == 16 else colour[..., 0])
    _, said, _ = run(
        "texture", "show", "spheres", "--baked", tmp_path / "map.moments", "--size-px", 64,
        "--out", tmp_path / "sheet.png", "--animate", tmp_path / "turn.webp", "--set",
        "law=authors",
    )  # fmt: skip

    assert "fewer bytes" in said
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.width > 3 * 64
    with Image.open(tmp_path / "turn.webp") as turning:
        assert turning.n_frames > 10


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("bake", "NO.png"), "no such file"),
        (("bake", "floats.exr"), "8 or 16 bits"),
        (("bake", "odd.png", "--wrap"), "multiple of"),
        (("bake", "odd.png", "--out", "x.png"), "must end in .moments"),
        (("show", "moon"), "must be one of planet, spheres"),
        (("show", "planet", "--baked", "odd.png"), "baked texture"),
        (("show", "planet", "--set", "chroma=full"), "chroma=follow"),
        (("show", "planet", "--set", "colour=3"), "colour"),
        (("show", "planet", "--out", "x.gif"), "must end in .png"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_message(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(np.zeros((20, 33, 3), np.uint8)).save("odd.png")
    save_colour(tmp_path / "floats.exr", np.full((8, 8, 3), 0.5, np.float32))

    _, _, error = run("texture", *arguments, status=2)

    assert message in error
    assert not list(tmp_path.glob("*.moments"))
    assert not (tmp_path / "texture.png").exists()


def test_scenes_have_globes_where_they_say():
    spheres = SCENES["spheres"]
    angles = [np.degrees(np.arctan2(x, z)) for (x, _, z) in (g.centre_m for g in spheres.globes)]
    np.testing.assert_allclose(angles, (-15, -5, 5, 15))
    with pytest.raises(dataclasses.FrozenInstanceError):
        spheres.name = "other"
    with pytest.raises(InputError):
        bake(np.zeros((8, 33, 3), np.uint8), wraps=True)
