"""The study behind docs/quality.md is one that can be built."""

import pytest

from benchmarks.paper import Row, differences
from benchmarks.scores import MOTIONS, RECIRCULATED, SIZE, VARIANTS, protocol
from pipeline.quality import Quality


@pytest.mark.parametrize("motion", list(MOTIONS))
def test_the_study_of_a_motion_holds_every_scene_and_method_that_was_asked_for(motion):
    methods = ["reference", "coherence-transport", "push-pull"]
    study = protocol(motion, ["garden", "shed"], methods)

    stimuli = study.warped
    assert [scene.name for scene in stimuli.scenes] == [f"garden-{motion}", f"shed-{motion}"]
    assert {scene.camera.kind for scene in stimuli.scenes} == {MOTIONS[motion]["kind"]}
    assert [method.name for method in stimuli.methods] == methods
    assert [size.hole_share for size in stimuli.sizes] == [SIZE["hole_share"]]


def test_variants_are_one_method_with_other_parameters():
    study = protocol("lateral", ["garden"], list(VARIANTS))

    noise = {method.name: method.parameters.get("noise") for method in study.warped.methods}
    assert noise["half-noise"] == 0.5
    assert noise["no-noise"] == 0.0
    assert noise["metameric"] is None


def test_recirculated_clips_differ_by_the_weight_alone():
    study = protocol("lateral", ["garden"], ["reference", "weighted-pull-push", *RECIRCULATED])

    weights = {m.name: m.parameters.get("recirculate") for m in study.warped.methods[1:]}
    assert list(weights.values()) == [None, 0.25, 0.5, 1.0]


def test_differences_are_the_first_methods_jod_less_the_others():
    """By hand: 9 less 8.5 and 8 less 8.3 are .5 and -.3, on average .1."""
    quality = Quality(20.0, 0.5, 1.0, 0.2)
    jods = {"one": (9.0, 8.5), "two": (8.0, 8.3)}
    results = {
        scene: (0.05, {"ours": Row(quality, first), "theirs": Row(quality, other)})
        for scene, (first, other) in jods.items()
    }

    assert differences(results).splitlines()[2:] == [
        "| one | +0.50 |",
        "| two | -0.30 |",
        "| mean | +0.10 |",
    ]
