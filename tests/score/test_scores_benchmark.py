"""The study behind docs/quality.md is one that can be built."""

import pytest

from benchmarks.scores import MOTIONS, SIZE, protocol


@pytest.mark.parametrize("motion", list(MOTIONS))
def test_the_study_of_a_motion_holds_every_scene_and_method_that_was_asked_for(motion):
    methods = ["reference", "coherence-transport", "push-pull"]
    study = protocol(motion, ["garden", "shed"], methods)

    stimuli = study.warped
    assert [scene.name for scene in stimuli.scenes] == [f"garden-{motion}", f"shed-{motion}"]
    assert {scene.camera.kind for scene in stimuli.scenes} == {MOTIONS[motion]["kind"]}
    assert [method.name for method in stimuli.methods] == methods
    assert [size.hole_share for size in stimuli.sizes] == [SIZE["hole_share"]]
