"""The true view around the dot, in clips whose periphery is up-sampled."""

import numpy as np
import pytest
from built_study import write_small_study

from pipeline.foveation.conditions import foveate
from pipeline.foveation.geometry import Flat
from pipeline.foveation.two_rates import TwoRates, coarsened
from pipeline.transport.reference import TransportSettings
from protocols.errors import StudyError
from protocols.load import load_display, load_protocol
from protocols.manifest import check_manifest, read_manifest
from stimuli.batch.build import build
from stimuli.media.png import decode_png
from stimuli.recipes import builder_of

UPSAMPLED = (
    'camera = { kind = "circle" }',
    'camera = { kind = "upsampling", real_every = 2, along = { kind = "circle" } }',
)
CLIPS = "[stimuli.clips]\n"
VIEW = "true_view = { within_deg = 1 }\n"


def study(folder, *changes):
    folder.mkdir(exist_ok=True)
    path = write_small_study(folder)
    text = path.read_text()
    head, rest = text.split('[[stimuli.scenes]]\nname = "motorcycle"', 1)
    text = head + rest[rest.index("[[stimuli.sizes]]") :]  # the photographs cannot be up-sampled
    for old, new in (UPSAMPLED, *changes):
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text)
    return path


def test_the_share_falls_from_one_to_none_over_a_degree_around_the_dot():
    """A clip 200 px wide at 100 px: the angle of a pixel is its arctangent."""
    eye = Flat(distance_px=100.0).of(200, 120)
    share = TwoRates(eye, eye.place_px(5, -3), 10).share[..., 0]

    y, x = np.mgrid[:120, :200] + 0.5
    rays = np.stack([x - 100, y - 60, np.full_like(x, 100.0)], axis=-1)
    dot = np.array([np.tan(np.radians(5)), np.tan(np.radians(-3)), 1.0])
    cosine = rays @ dot / np.linalg.norm(rays, axis=-1) / np.linalg.norm(dot)
    away = np.degrees(np.arccos(cosine.clip(-1, 1)))
    assert (share[away < 9.999] == 1).all()
    assert (share[away > 11.001] == 0).all()
    half = np.abs(away - 10.5) < 0.05
    assert half.any()
    assert np.abs(share[half] - 0.5).max() < 0.1


def test_mixing_keeps_the_bits_of_both(rng):
    made, truth = (rng.random((4, 6, 3), np.float32) for _ in range(2))
    rates = TwoRates(Flat().of(6, 4), (3, 2), 5)
    rates.share = np.array([0, 0, 0.25, 0.5, 1, 1], np.float32)[:, None] * np.ones((4, 1, 1), "f4")
    mixed = rates.shown(made, truth)

    assert mixed[:, :2].tobytes() == made[:, :2].tobytes()
    assert mixed[:, 4:].tobytes() == truth[:, 4:].tobytes()
    np.testing.assert_allclose(mixed[:, 3], (made[:, 3] + truth[:, 3]) / 2, atol=1e-6)


def test_clips_show_the_truth_around_the_dot_and_the_method_beyond(read_plan, inline, tmp_path):
    view = f"{CLIPS}true_view = {{ within_deg = 0.3, x_deg = -0.4 }}\n"
    plain, mixed = study(tmp_path / "plain"), study(tmp_path / "mixed", (CLIPS, view))
    for path in (plain, mixed):
        build(read_plan(path), path.parent / "clips", inline)
    plan = read_plan(mixed)
    share = TwoRates(plan.eye, plan.eye.place_px(-0.4, 0), 0.3).share[..., 0]

    def frame(path, method):
        return decode_png(path.parent / f"clips/box__small__{method}/000001.png")

    truth, made, shown = frame(mixed, "reference"), frame(plain, "telea"), frame(mixed, "telea")
    assert (share == 1).any()
    assert np.array_equal(shown[share == 1], truth[share == 1])
    assert np.array_equal(shown[share == 0], made[share == 0])
    assert (shown[share == 1] != made[share == 1]).any()
    assert np.array_equal(frame(plain, "reference"), truth)


def test_blocks_have_their_means_and_go_over_into_each_other():
    """By hand: blocks of 1 and 5, of which a border block goes on with its last pixel."""
    row = np.array([0, 2, 4, 6, 5], np.float32)
    found = coarsened(np.tile(row[None, :, None], (3, 1, 3)), 2)

    assert found.shape == (3, 5, 3)
    assert found[2, :, 1] == pytest.approx([1, 2, 4, 5, 5])  # middles lie at 1, 3, 5


def test_the_periphery_is_coarser_and_then_changed_for_the_gaze(gl_context, rng):
    """Both twins: what a condition makes of the coarse frame, and bit for bit the truth."""
    eye = Flat(width_deg=30.0).of(96, 64)
    made, truth = (rng.random((64, 96, 3), np.float32) for _ in range(2))
    given = {"parameters": {"scaling": 0.4}, "condition": "metamer", "coarser": 2, "seed": 5}
    for ctx in (None, gl_context):
        rates = TwoRates(eye, (40, 30), 4, **given, ctx=ctx)
        shown = rates.shown(made, truth)
        rates.release()
        wanted = foveate(
            coarsened(made, 2), (40, 30), viewing=Flat(width_deg=30.0), seed=5, scaling=0.4, ctx=ctx
        )
        share = rates.share[..., 0]
        assert np.array_equal(shown[share == 1], truth[share == 1])
        assert np.array_equal(shown[share == 0], wanted[share == 0])


def test_clips_have_such_a_periphery_and_say_so(read_plan, inline, tmp_path):
    """A factor of 1 without a condition is no periphery: clips and hashes are as without."""
    view = f"{CLIPS}true_view = {{ within_deg = 0.3, x_deg = -0.4 }}\n"
    added = {
        "plain": "",
        "one": "periphery = { coarser = 1 }\n",
        "metamer": 'periphery = { coarser = 3, condition = "metamer", parameters ='
        " { scaling = 0.5 } }\n",
    }
    made, plans = {}, {}
    for name, line in added.items():
        path = study(tmp_path / name, (CLIPS, view + line))
        plans[name] = read_plan(path)
        build(plans[name], path.parent / "clips", inline)
        made[name] = read_manifest(path.parent / "clips")
        check_manifest(plans[name].study, made[name])
    assert made["one"].clips == made["plain"].clips
    assert made["one"].stimuli_sha256 == made["plain"].stimuli_sha256

    def frame(name, method):
        return decode_png(tmp_path / f"{name}/clips/box__small__{method}/000001.png") / 255

    plan = plans["metamer"]
    gaze_px = plan.eye.place_px(-0.4, 0)
    telea = next(clip for clip in made["metamer"].clips if clip.column("method") == "telea")
    assert telea.parameters["periphery"] == "in blocks of 3 px, as metamer, scaling 0.5"
    assert telea.parameters["gaze_x_px"] == pytest.approx(gaze_px[0])
    share = TwoRates(plan.eye, gaze_px, 0.3).share[..., 0]
    shown, plain = frame("metamer", "telea"), frame("plain", "telea")
    assert np.array_equal(shown[share == 1], plain[share == 1])
    assert (shown != plain)[share == 0].any()
    assert np.array_equal(frame("metamer", "reference"), frame("plain", "reference"))


def test_a_fill_by_eccentricity_sees_as_wide_a_frame_as_the_display_shows(read_plan, tmp_path):
    """Unless the study says another width; a fill without a gaze keeps what it has."""
    gazed = 'name = "telea"\nmethod = "coherence-transport"\nparameters = { fovea_deg = 2.0'
    widths = {}
    for name, parameters in (
        ("gazed", gazed + " }"),
        ("said", gazed + ", width_deg = 30.0 }"),
        ("whole", gazed.replace("2.0", "0.0") + " }"),
    ):
        path = study(tmp_path / name, ('name = "telea"', parameters))
        plan = read_plan(path)
        clip = next(clip for clip in plan.clip_names if clip.method == "telea")
        widths[name] = plan.parameters(clip)["width_deg"]

    half = np.degrees(np.arctan(plan.render_px[0] / 2 / plan.distance_px))
    assert widths == {"gazed": pytest.approx(2 * half), "said": 30.0, "whole": 40.0}


def test_clips_are_filled_by_eccentricity(read_plan, inline, tmp_path):
    """The first frame, before anything is kept from earlier ones; its hole goes half way down."""
    gazed = 'method = "coherence-transport"\nparameters = { fovea_deg = 0.1, gaze_y_deg = -1.1 }'
    path = study(
        tmp_path / "s",
        ('name = "push-pull"', 'name = "push-pull"\nmethod = "push-pull-depth"'),
        ('name = "telea"', f'name = "telea"\n{gazed}'),
        UPSAMPLED[::-1],
    )
    build(read_plan(path), path.parent / "clips", inline)
    plan = read_plan(path)
    clip = next(clip for clip in plan.clip_names if clip.method == "telea")
    given = {k: v for k, v in plan.parameters(clip).items() if k != "z_near_m"}
    width, height = plan.render_px
    attention = TransportSettings(**given).attention((height, width))

    plain, shown, hole = (
        decode_png(path.parent / f"clips/{name}/000000.png")
        for name in ("box__small__push-pull", "box__small__telea", "holes/box__small")
    )
    assert hole[attention == 0].any()
    assert np.array_equal(shown[attention == 0], plain[attention == 0])
    assert (shown != plain)[attention > 0].any()


def test_without_a_true_view_a_study_has_the_hash_it_had(tmp_path):
    assert "true_view" not in load_protocol(study(tmp_path / "s")).stimuli.identity()["clips"]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("periphery = { coarser = 2 }", r"periphery needs true_view, around which it lies"),
        (f"{VIEW}periphery = {{ coarser = 0 }}", r"periphery.coarser: must be at least 1"),
        (f'{VIEW}periphery = {{ condition = "files:x" }}', r"periphery.condition: must be lower"),
    ],
)
def test_a_periphery_that_cannot_be_is_refused(tmp_path, lines, said):
    path = study(tmp_path / "s", (CLIPS, f"{CLIPS}{lines}\n"))
    with pytest.raises(StudyError, match=said):
        load_protocol(path)


@pytest.mark.parametrize(
    ("around", "said"),
    [
        ('condition = "metamers"', "did you mean 'metamer'?"),
        ("parameters = { scaling = 1.0 }", "parameters of reference are: none (got 'scaling')"),
    ],
)
def test_an_unknown_condition_is_told_before_a_build(tmp_path, around, said):
    path = study(tmp_path / "s", (CLIPS, f"{CLIPS}{VIEW}periphery = {{ {around} }}\n"))
    protocol = load_protocol(path)
    builder = builder_of(protocol, load_display(protocol.display.display), path.parent)
    (found,) = builder.problems()
    assert said in str(found)


def test_scenes_without_a_reference_are_refused(tmp_path):
    path = study(
        tmp_path / "s",
        ('name = "box"\n', 'name = "box"\nreference = false\n'),
        (CLIPS, f"{CLIPS}true_view = {{ within_deg = 1 }}\n"),
    )
    with pytest.raises(StudyError, match=r"true_view needs scenes with a reference \(box: none\)"):
        load_protocol(path)
