"""The study behind docs/quality.md is one that can be built."""

import pytest

from benchmarks.scores import MOTIONS, SIZE, VARIANTS, protocol


@pytest.mark.parametrize("motion", list(MOTIONS))
def test_the_study_of_a_motion_holds_every_scene_and_method_that_was_asked_for(motion):
    study = protocol(motion, ["garden", "shed"], ["reference", "shift-map", "push-pull"])

    stimuli = study.warped
    assert [scene.name for scene in stimuli.scenes] == [f"garden-{motion}", f"shed-{motion}"]
    assert {scene.camera.kind for scene in stimuli.scenes} == {MOTIONS[motion]["kind"]}
    assert [method.name for method in stimuli.methods] == ["reference", "shift-map", "push-pull"]
    assert [size.hole_share for size in stimuli.sizes] == [SIZE["hole_share"]]


def test_variants_are_one_method_with_other_parameters():
    study = protocol("lateral", ["garden"], list(VARIANTS))

    noise = {method.name: method.parameters.get("noise") for method in study.warped.methods}
    assert noise["half-noise"] == 0.5
    assert noise["no-noise"] == 0.0
    assert noise["metameric"] is None
