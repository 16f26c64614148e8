"""The stimuli of the Beyond Blur studies: rings to half a pixel, cuts, built-in pictures."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.foveation.conditions import condition_names
from pipeline.foveation.drawn import cut_shares, draw_ring
from pipeline.foveation.geometry import Equirectangular, Flat, eccentricity_deg, pixel_centres
from protocols.load import load_study
from protocols.recipes.foveated_images import FoveatedImages, ShownMethod
from stimuli.recipes.foveated_work import StillMaker, StillsPlan
from stimuli.scenes.builtin_pictures import builtin_picture, notices, picture_names

TALL, WIDE = 108, 192


def small(name: str, **more: object) -> StillsPlan:
    """A shipped study at a tenth or less of its pixels, its angles kept."""
    study, display = load_study(Path(name), None)
    recipe = study.stimuli
    assert isinstance(recipe, FoveatedImages)
    shrunk = recipe.width_px / WIDE
    changed = {"width_px": WIDE, "height_px": TALL, **more}
    return StillsPlan(
        recipe.model_copy(update=changed), display.distance_mm / display.pitch_x_mm / shrunk, Path()
    )


# --- Landolt rings -----------------------------------------------------------------------


def rays_of(geometry, x, y):
    """Directions by hand: through a flat pixel, or at a panorama's longitude and latitude."""
    if not geometry.wraps:
        ray = np.stack(
            np.broadcast_arrays(
                x - geometry.width_px / 2, y - geometry.height_px / 2, geometry.distance_px
            ),
            axis=-1,
        )
        return ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    longitude = np.radians((x / geometry.width_px - 0.5) * 360)
    latitude = np.radians((y / geometry.height_px - 0.5) * 180)
    return np.stack(
        np.broadcast_arrays(
            np.sin(longitude) * np.cos(latitude),
            np.sin(latitude),
            np.cos(longitude) * np.cos(latitude),
        ),
        axis=-1,
    )


@pytest.mark.parametrize(
    "geometry",
    [Flat(width_deg=85).of(1200, 760), Equirectangular().of(3000, 1500)],
    ids=["flat", "panorama"],
)
@pytest.mark.parametrize(
    ("eccentricity", "polar", "gap_deg"),
    [(5.0, 40.0, None), (25.0, 200.0, 0.0), (25.0, 270.0, 90.0)],
)
def test_size_gap_and_place_of_a_ring_are_right_to_half_a_pixel(
    geometry, eccentricity, polar, gap_deg
):
    """By spherical trigonometry: distance and bearing from the ring's middle, gaze ahead.

    Every pixel whose middle is farther than half a pixel from all edges is ink or is not.
    """
    white = np.ones((geometry.height_px, geometry.width_px, 3), np.float32)
    gaze = geometry.width_px / 2, geometry.height_px / 2
    drawn = draw_ring(
        white, geometry, gaze, eccentricity_deg=eccentricity, polar_deg=polar, height_deg=1.25,
        gap_deg=gap_deg,
    )  # fmt: skip
    ink = drawn[..., 0] < 0.5

    away, turn = np.radians(eccentricity), np.radians(polar)
    right = np.sin(away) * np.cos(turn)
    down = -np.sin(away) * np.sin(turn)
    centre = np.array([right, down, np.cos(away)])
    x, y = np.meshgrid(np.arange(geometry.width_px) + 0.5, np.arange(geometry.height_px) + 0.5)
    rays = rays_of(geometry, x, y)
    near = rays @ centre > np.cos(np.radians(1.5))
    ray = rays[near]
    distance = np.degrees(np.arccos(np.clip(ray @ centre, -1, 1)))
    # Level and upright at the ring: longitude and latitude about its own middle.
    longitude = np.arctan2(ray[:, 0], ray[:, 2]) - np.arctan2(centre[0], centre[2])
    low, middle = np.arcsin(ray[:, 1]), np.arcsin(centre[1])
    bearing = np.arctan2(
        np.cos(middle) * np.sin(low) - np.sin(middle) * np.cos(low) * np.cos(longitude),
        np.cos(low) * np.sin(longitude),
    )  # clockwise from the right, as y grows downwards
    half_px = (
        90 / geometry.height_px
        if geometry.wraps
        else np.degrees(0.5 * centre[2] / geometry.distance_px)
    )
    edge = np.minimum(abs(distance - 0.625), abs(distance - 0.375))
    inked = (distance < 0.625) & (distance > 0.375)
    if gap_deg is not None:
        turned = -bearing - np.radians(gap_deg)
        along, aside = distance * np.cos(turned), distance * np.sin(turned)
        inked &= ~((along > 0) & (abs(aside) < 0.125))
        edge = np.where(along > -half_px, np.minimum(edge, abs(abs(aside) - 0.125)), edge)
    clear = edge > half_px

    assert clear.sum() > 80
    assert inked[clear].sum() > 4
    np.testing.assert_array_equal(ink[near][clear], inked[clear])
    assert not ink[~near].any()


def test_a_ring_moved_by_a_pixel_fails_that_test():
    """The test above can fail: what it allows is less than a pixel."""
    geometry = Flat(width_deg=85).of(1200, 760)
    white = np.ones((760, 1200, 3), np.float32)
    ring = {"eccentricity_deg": 5.0, "polar_deg": 40.0, "height_deg": 1.25, "gap_deg": None}
    right = draw_ring(white, geometry, (600, 380), **ring)[..., 0] < 0.5
    moved = draw_ring(white, geometry, (601, 380), **ring)[..., 0] < 0.5
    edges = cv2.dilate(right.astype(np.uint8), None) - cv2.erode(right.astype(np.uint8), None)

    assert (right != moved).sum() > 0.15 * edges.sum()


# --- foveation and cuts ------------------------------------------------------------------


@pytest.mark.parametrize("name", ["beyond-blur-task", "beyond-blur-preference"])
def test_the_dot_the_gaze_and_the_pictures_middle_are_one_place(name):
    study, _ = load_study(Path(name), None)
    order = small(name)
    one = order.recipe.stimuli()[0]

    assert (study.trial.fixation_x_deg, study.trial.fixation_y_deg) == (0, 0)
    assert order.gaze_px(one) == pytest.approx((WIDE / 2, TALL / 2))


FOVEA_DEG = 5.0


@pytest.mark.parametrize(
    "method", [name for name in condition_names() if name not in ("reference", "files:FOLDER")]
)
def test_a_condition_changes_the_picture_from_the_foveas_border_on_all_around(method, rng):
    """Of a picture of noise, the nearest changed pixel in every direction is as near."""
    more = {}
    if method == "energy-metamer":
        pytest.importorskip(
            "torch", reason="needs the extra `metamers`: script/setup --metamers installs it"
        )
        more = {"steps": 1}
    shown = ShownMethod(name=method, parameters={"law": "v1", "fovea_deg": FOVEA_DEG, **more})
    order = small("beyond-blur-preference", methods=(shown,))
    bench = StillMaker(order)
    picture = rng.random((TALL, WIDE, 3)).astype(np.float32)
    try:
        bench._picture = "garden", picture
        made = bench.colour(order.recipe.stimuli()[0])
    finally:
        bench.release()

    changed = (made != picture).any(axis=2)
    x, y = pixel_centres(order.geometry)
    away = eccentricity_deg(order.geometry, (WIDE / 2, TALL / 2), x, y)
    turn = np.degrees(np.arctan2(y - TALL / 2, x - WIDE / 2)) % 360
    pixel_deg = 1 / order.geometry.px_per_deg(np.array(WIDE / 2), np.array(TALL / 2))
    for start in range(0, 360, 30):
        inside = changed & (turn >= start) & (turn < start + 30)
        assert FOVEA_DEG < away[inside].min() < FOVEA_DEG + 2 * pixel_deg


@pytest.fixture(scope="module")
def cut():
    """Stills of the detection study, notices alone, and how often a method worked."""
    order = small("beyond-blur-detection")
    recipe = order.recipe
    methods = [one for one in recipe.methods if one.condition != "energy-metamer"]
    order = small("beyond-blur-detection", methods=tuple(methods), pictures=recipe.pictures[-1:])
    bench = StillMaker(order)
    worked: list[str] = []
    foveated = bench._foveated
    bench._foveated = lambda *given: (worked.append(given[1].shown.name), foveated(*given))[1]
    try:
        made = {one.name: (one, bench.colour(one)) for one in order.recipe.stimuli()}
    finally:
        bench.release()
    return order, made, worked


def test_a_cut_picture_is_the_reference_bit_for_bit_beyond_the_blend(cut):
    order, made, _ = cut
    reference = made["notices__reference__consistent__d0"][1]
    gaze = WIDE / 2, TALL / 2
    tried = 0
    for one, colour in made.values():
        if one.cut_deg is None:
            continue
        whole = made[f"notices__{one.shown.name}__consistent__d0"][1]
        share = cut_shares(order.geometry, gaze, one.cut_deg, order.recipe.cuts.ramp_deg)
        np.testing.assert_array_equal(colour[share <= 0], reference[share <= 0])
        np.testing.assert_array_equal(colour[share >= 1], whole[share >= 1])
        assert 0.35 < (share <= 0).mean() < 0.65
        assert (whole != reference)[share <= 0].any()
        tried += 1
    assert tried == 2 * 6


def test_a_consistent_picture_is_the_method_everywhere_and_so_has_no_cut(cut):
    _, made, _ = cut
    for method in ("reference", "blur", "ours"):
        first = made[f"notices__{method}__consistent__d0"][1]
        for draw in range(1, 6):
            same = made[f"notices__{method}__consistent__d{draw}"][1]
            np.testing.assert_array_equal(same, first)


def strips_beside(order, gaze, angle_deg, wide_deg=1.5):
    """Pixels of the strips on both sides of a line through the gaze, beyond 3 degrees from it."""
    away = eccentricity_deg(order.geometry, gaze, *pixel_centres(order.geometry)) > 3
    share = cut_shares(order.geometry, gaze, angle_deg, 2 * wide_deg)
    return [np.flatnonzero(away & (share > low) & (share < low + 0.5)) for low in (0.5, 0.0)]


@pytest.mark.slow
def test_across_the_cut_a_consistent_picture_differs_as_across_any_line(rng):
    """Of even noise: at the cut consistent pictures differ as at other angles, cut ones more."""
    tall, wide = 3 * TALL, 3 * WIDE
    base = small("beyond-blur-detection")
    methods = [one for one in base.recipe.methods if one.condition in ("blur", "metamer")]
    order = StillsPlan(
        base.recipe.model_copy(
            update={"methods": tuple(methods), "width_px": wide, "height_px": tall}
        ),
        3 * base.distance_px,
        Path(),
    )
    bench = StillMaker(order)
    gaze = wide / 2, tall / 2
    picture = rng.random((tall, wide, 3)).astype(np.float32)
    strips = cache(lambda angle_deg: strips_beside(order, gaze, angle_deg))
    tried = 0
    try:
        for one in order.recipe.stimuli():
            if one.picture.name != "garden":
                continue
            bench._picture = "garden", picture
            made = bench.colour(one)
            steps = np.square(np.diff(made, axis=1, prepend=0)).sum(axis=2)
            angle = one.condition["cut_deg"]
            others = [
                other
                for other in np.arange(0, 180, 10.0)
                if abs((other - angle + 90) % 180 - 90) > 15
            ]
            # Log ratios of the root mean square of steps between neighbours.
            at_cut, *elsewhere = (
                np.log(steps.flat[left].mean() / steps.flat[right].mean()) / 2
                for left, right in map(strips, [angle, *others])
            )
            at_cut = abs(at_cut) / np.std(elsewhere)
            if one.condition["cut"] == "consistent":
                assert at_cut < 3
            else:
                assert at_cut > 3.5
            tried += 1
    finally:
        bench.release()
    assert tried == 2 * 12


def test_what_all_cuts_share_is_made_once(cut):
    assert cut[2] == ["blur", "ours"]


def test_with_seeds_of_their_own_draws_differ():
    order = small("beyond-blur-detection")
    own = order.recipe.cuts.model_copy(update={"own_seeds": True})
    seeds = {
        name: {one.seed for one in recipe.stimuli() if one.picture.name == "street"}
        for name, recipe in (
            ("one", order.recipe),
            ("own", order.recipe.model_copy(update={"cuts": own})),
        )
    }

    assert len(seeds["one"]) == 1
    assert len(seeds["own"]) == 12


# --- built-in pictures -------------------------------------------------------------------


def test_notices_are_the_same_wall_in_every_size_and_full_of_print():
    large, little = notices(432, 768), notices(108, 192)

    halved = cv2.resize(large, (192, 108), interpolation=cv2.INTER_AREA)
    assert np.corrcoef(halved.ravel(), little.ravel())[0, 1] > 0.9
    edges = abs(np.diff(large[..., 1], axis=1)) > 0.2
    assert edges.mean() > 0.02


def test_a_scene_is_drawn_in_the_perspective_of_the_eye_and_may_be_looked_at_elsewhere(
    gl_context, full
):
    """A view to the side shows what a wider view has there."""
    if not full:
        pytest.skip("bakes the light of a scene twice; with --full")
    straight = Flat(width_deg=100).of(240, 80)
    wide = builtin_picture("tunnel", straight, gl_context)
    aside = builtin_picture("tunnel", Flat(width_deg=20).of(80, 40), gl_context, right_deg=20)

    x = np.tan(np.radians(20)) * straight.distance_px + 120
    around = wide[38:42, round(x) - 2 : round(x) + 3].mean(axis=(0, 1))
    here = aside[16:24, 34:46].mean(axis=(0, 1))
    np.testing.assert_allclose(around, here, atol=0.08)
    assert wide.shape == (80, 240, 3)
    assert wide.std() > 0.05


def test_unknown_pictures_and_views_of_flat_ones_are_refused():
    geometry = Flat(width_deg=20).of(32, 16)
    with pytest.raises(InputError, match="did you mean 'tunnel'"):
        builtin_picture("tunel", geometry, None)
    with pytest.raises(InputError, match="leave view out"):
        builtin_picture("notices", geometry, None, right_deg=10)
    with pytest.raises(InputError, match="needs OpenGL"):
        builtin_picture("tunnel", geometry, None)
    assert len(picture_names()) == 8
