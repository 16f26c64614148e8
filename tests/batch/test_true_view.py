"""The true view around the dot, in clips whose periphery is up-sampled."""

import numpy as np
import pytest
from built_study import write_small_study

from pipeline.transport.reference import TransportSettings
from protocols.errors import StudyError
from protocols.load import load_protocol
from protocols.recipes.warped_clips import TrueView
from stimuli.batch.build import build
from stimuli.batch.clip import true_share, with_true_view
from stimuli.media.png import decode_png

UPSAMPLED = (
    'camera = { kind = "circle" }',
    'camera = { kind = "upsampling", real_every = 2, along = { kind = "circle" } }',
)
CLIPS = "[stimuli.clips]\n"


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
    view = TrueView(within_deg=10, x_deg=5, y_deg=-3)
    share = true_share((200, 120), 100.0, view)[..., 0]

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
    share = np.array([0, 0, 0.25, 0.5, 1, 1], np.float32)[None, :, None] * np.ones((4, 1, 1), "f4")
    mixed = with_true_view(made, truth, share)

    assert mixed[:, :2].tobytes() == made[:, :2].tobytes()
    assert mixed[:, 4:].tobytes() == truth[:, 4:].tobytes()
    np.testing.assert_allclose(mixed[:, 3], (made[:, 3] + truth[:, 3]) / 2, atol=1e-6)


def test_clips_show_the_truth_around_the_dot_and_the_method_beyond(read_plan, inline, tmp_path):
    view = f"{CLIPS}true_view = {{ within_deg = 0.3, x_deg = -0.4 }}\n"
    plain, mixed = study(tmp_path / "plain"), study(tmp_path / "mixed", (CLIPS, view))
    for path in (plain, mixed):
        build(read_plan(path), path.parent / "clips", inline)
    plan = read_plan(mixed)
    stated = plan.study.warped.clips.true_view
    share = true_share(plan.render_px, plan.distance_px, stated)[..., 0]

    def frame(path, method):
        return decode_png(path.parent / f"clips/box__small__{method}/000001.png")

    truth, made, shown = frame(mixed, "reference"), frame(plain, "telea"), frame(mixed, "telea")
    assert (share == 1).any()
    assert np.array_equal(shown[share == 1], truth[share == 1])
    assert np.array_equal(shown[share == 0], made[share == 0])
    assert (shown[share == 1] != made[share == 1]).any()
    assert np.array_equal(frame(plain, "reference"), truth)


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


def test_scenes_without_a_reference_are_refused(tmp_path):
    path = study(
        tmp_path / "s",
        ('name = "box"\n', 'name = "box"\nreference = false\n'),
        (CLIPS, f"{CLIPS}true_view = {{ within_deg = 1 }}\n"),
    )
    with pytest.raises(StudyError, match=r"true_view needs scenes with a reference \(box: none\)"):
        load_protocol(path)
