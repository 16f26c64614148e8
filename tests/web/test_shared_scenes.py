"""A share of the scenes for each participant at home: all of them are shown to equally many."""

from collections import Counter
from pathlib import Path

import pytest

from protocols.load import load_protocol
from protocols.plan import planned_trials, rounds, scenes_at, windows
from protocols.study_file.schema import StudyProtocol


def shared(name: str, share: float, **design: object) -> StudyProtocol:
    """A shipped study as participants at home meet it."""
    text = load_protocol(Path(name)).in_any_order().model_dump()
    text |= {"web": {"gaze": "none", "share": share}}
    text["design"] |= design
    return StudyProtocol.model_validate(text).at_home()


def what_is_met(study: StudyProtocol, slot: int) -> tuple[tuple[str, ...], object]:
    """The scenes of a slot's main trials, and how its first trial is arranged and answered."""
    trials = planned_trials(study.ordered_by(5), "W-1", slot)
    main = sorted((t for t in trials if t.role == "main"), key=lambda trial: trial.id)
    scenes = tuple(sorted({str(trial.condition["scene"]) for trial in main}))
    shown = {(t.repeat, t.correct, t.stimuli) for t in main}
    return scenes, (main[0].answers, frozenset(shown))


@pytest.mark.parametrize(
    ("name", "share", "each", "count"),
    [("showcase", 0.5, 2, 3),
     ("inpainting-2afc", 0.5, 3, 2), ("inpainting-2afc", 0.7, 4, 3), ("demo", 0.01, 1, 2)],
)  # fmt: skip
@pytest.mark.parametrize("places", ["by-arrival", "drawn"])
def test_all_scenes_are_shown_to_equally_many(name, share, each, count, places):
    study = shared(name, share, places=places)
    assert (len(scenes_at(study, 9)), windows(study)) == (each, count)
    short, whole = rounds(study)
    assert whole % (short * count) == 0
    met = [what_is_met(study, slot) for slot in range(whole)]
    seen = Counter(scene for scenes, _ in met for scene in scenes)
    assert set(seen) == set(study.main_scenes())
    assert len(set(seen.values())) == 1
    assert all(len(scenes) == each for scenes, _ in met)


@pytest.mark.parametrize("name", ["inpainting-2afc", "showcase"])
@pytest.mark.parametrize("share", [0.2, 0.4, 0.5])
def test_each_window_meets_each_arrangement_and_key_equally_often(name, share):
    study = shared(name, share)
    short, count = rounds(study)[0], windows(study)
    met = Counter((scenes_at(study, place), place % short) for place in range(short * count))
    assert set(met.values()) == {1}
    for start in range(0, short * count, count):  # a study of few shows all scenes, too
        few = Counter(s for at in range(start, start + count) for s in scenes_at(study, at))
        assert set(few.values()) == {len(scenes_at(study, 0)) * count // len(study.main_scenes())}


def test_at_the_desk_everybody_is_shown_all_scenes():
    study = shared("beyond-blur-detection", 0.3)
    desk = load_protocol(Path("beyond-blur-detection"))
    same = StudyProtocol.model_validate(study.model_dump())
    assert {len(planned_trials(same, "P1", slot)) for slot in range(7)} == {294}
    assert [t.stimuli for t in planned_trials(same, "P1", 3)] == [
        t.stimuli for t in planned_trials(desk, "P1", 3)
    ]
    assert {len(planned_trials(study, "P1", slot)) for slot in range(7)} == {84}


def test_a_share_of_one_changes_no_hash():
    study = shared("critical-scaling", 1.0)
    assert "share" not in study.model_dump()["web"]
    assert windows(study) == 1


def test_a_share_of_what_cannot_be_shared_is_refused():
    with pytest.raises(ValueError, match=r"web.share: must be left out .* \(got 'garden' alone\)"):
        shared("demo", 0.5, scenes=("garden",))
