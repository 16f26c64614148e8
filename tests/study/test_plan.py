"""The trial list: complete, balanced, reproducible; and what a display cannot do is refused."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from protocols.disk.hashing import Chance
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import (
    check_feasible,
    clip_size_px,
    require_feasible,
    session_duration_s,
    virtual_manifest,
)
from protocols.load import load_display, load_protocol
from protocols.manifest import check_manifest
from protocols.plan import PlannedTrial, apart, latin_row, make_plan
from protocols.study_file.schema import StudyProtocol

PAPER = load_protocol(Path("inpainting-2afc"))
DEMO = load_protocol(Path("demo"))
FHD = load_display("fhd27-60hz")
PAPER_CLIPS = virtual_manifest(PAPER, FHD)
DEMO_CLIPS = virtual_manifest(DEMO, FHD)


def changed(study: StudyProtocol, *, clips=None, **sections: dict[str, object]) -> StudyProtocol:
    """Return the protocol with some fields of its sections changed, checked again."""
    plain = study.model_dump()
    plain["stimuli"]["clips"] |= clips or {}
    for section, fields in sections.items():
        plain[section] |= fields
    return StudyProtocol.model_validate(plain)


def condition(trial) -> tuple[object, ...]:
    """Condition that a trial compares, in its order."""
    return tuple(trial.condition[name] for name in ("scene", "size", "first", "second"))


def display_at(refresh_hz: float, **fields: object) -> Display:
    return FHD.model_copy(update={"refresh_hz": refresh_hz, **fields})


@pytest.mark.parametrize("slot", range(12))
def test_the_paper_s_study_has_72_decisions_each_cell_twice_in_both_orders(slot):
    plan = make_plan(PAPER, PAPER_CLIPS, f"P{slot}", slot)

    assert len(plan.trials) == plan.main_trials == 72
    cells = Counter(trial.shown for trial in plan.trials)
    assert len(cells) == 3 * 2 * 6
    assert set(cells.values()) == {2}
    ordered = Counter(condition(t) for t in plan.trials)
    assert len(ordered) == 72
    assert {trial.repeat for trial in plan.trials} == {0, 1}


@pytest.mark.parametrize("repeats", [1, 2, 3, 4])
def test_orders_are_balanced_within_or_between_neighbouring_slots(repeats):
    protocol = changed(DEMO, design={"repeats": repeats})
    plans = [make_plan(protocol, virtual_manifest(protocol, FHD), f"P{s}", s) for s in (0, 1)]

    def orders(*which):
        return Counter(condition(t) for plan in which for t in plan.trials if t.role == "main")

    together = orders(*plans)
    assert len(together) == 24
    assert set(together.values()) == {repeats}
    if repeats % 2 == 0:
        assert set(orders(plans[0]).values()) == {repeats // 2}


def test_sides_swap_between_slots_or_within_a_session_or_never():
    def sides(mode, slot):
        protocol = changed(DEMO, design={"side": mode})
        plan = make_plan(protocol, virtual_manifest(protocol, FHD), "P1", slot)
        return Counter(trial.answers[0] for trial in plan.trials)

    total = len(make_plan(DEMO, DEMO_CLIPS, "P1", 0).trials)
    assert [set(sides("by-participant", slot)) for slot in range(4)] == [
        {"first"}, {"first"}, {"second"}, {"second"},
    ]  # fmt: skip
    assert set(sides("fixed", 3)) == {"first"}
    left = sides("by-trial", 0)["first"]
    assert abs(2 * left - total) <= 3  # one odd trial per block


@pytest.mark.parametrize("count", range(2, 10))
def test_latin_rows_put_every_scene_everywhere_and_after_every_other(count):
    rows = [latin_row(count, row) for row in range(count if count % 2 == 0 else 2 * count)]

    for column in zip(*rows, strict=True):
        assert len(set(Counter(column).values())) == 1
        assert len(set(column)) == count
    neighbours = Counter(pair for row in rows for pair in pairwise(row))
    assert len(neighbours) == count * (count - 1)
    assert len(set(neighbours.values())) == 1


@pytest.mark.parametrize("slot", range(6))
def test_balanced_scene_order_shows_every_scene_once_per_round(slot):
    plan = make_plan(PAPER, PAPER_CLIPS, "P1", slot)
    names = [scene.name for scene in PAPER.warped.scenes]
    for start in range(0, 72, 6):
        shown = [trial.condition["scene"] for trial in plan.trials[start : start + 6]]
        assert sorted(shown) == sorted(names)
        row = latin_row(6, slot + start // 6)
        assert shown == [names[index] for index in row]


def test_a_plan_is_the_same_on_every_platform():
    """Pinned: SHA-256, integers and sorting only. Changing it strands every running study."""
    assert Chance(1, "P01", "plan").shuffled(range(10)) == PINNED_SHUFFLE
    first = [condition(trial) for trial in make_plan(PAPER, PAPER_CLIPS, "P01", 0).trials[:3]]
    assert first == PINNED_TRIALS


PINNED_SHUFFLE = [2, 3, 6, 8, 9, 4, 0, 1, 5, 7]
PINNED_TRIALS = [
    ("garden", "large", "metameric", "push-pull"),
    ("shed", "small", "push-pull", "reference"),
    ("thicket", "large", "metameric", "reference"),
]


def test_chance_is_uniform():
    """Chi-square of 60,000 draws over 6 values: 5 degrees of freedom, 99.99 % below 25.7."""
    chance = Chance("die")
    counts = Counter(chance.below(6) for _ in range(60_000))
    assert sum((counts[face] - 10_000) ** 2 / 10_000 for face in range(6)) < 25.7
    shuffles = Counter(tuple(Chance(seed).shuffled("abc")) for seed in range(6000))
    assert len(shuffles) == 6
    assert sum((count - 1000) ** 2 / 1000 for count in shuffles.values()) < 25.7
    with pytest.raises(ValueError, match="at least 1"):
        chance.below(0)


@settings(max_examples=40)
@given(
    repeats=st.integers(1, 4),
    blocks=st.integers(1, 4),
    order=st.sampled_from(["random", "balanced"]),
    scenes=st.integers(1, 6),
    catches=st.integers(0, 6),
    slot=st.integers(0, 30),
    seed=st.integers(0, 99),
)
def test_no_clip_pair_comes_twice_in_a_row(repeats, blocks, order, scenes, catches, slot, seed):
    assume(catches <= 3 * scenes and 6 * scenes * repeats >= 6 * blocks)  # else there is no order
    catch = {
        "trials": catches,
        "better": "reference",
        "worse": "push-pull",
        "where": {"size": "large"},
    }
    protocol = changed(
        PAPER,
        clips={"duration_s": 0.1},
        design={
            "repeats": repeats,
            "blocks": blocks,
            "scene_order": order,
            "scenes": tuple(scene.name for scene in PAPER.warped.scenes[:scenes]),
            "practice": {"trials": 3, "scenes": ("thicket",)},
            "seed": seed,
        },
        task={"catch": catch if catches else None},
    )
    plan = make_plan(protocol, virtual_manifest(protocol, FHD), "P1", slot)

    assert all(early.shown != late.shown for early, late in pairwise(plan.trials))
    assert len({trial.id for trial in plan.trials}) == len(plan.trials)
    assert plan.main_trials == scenes * 2 * 3 * repeats
    assert sum(trial.role == "catch" for trial in plan.trials) == catches
    assert sum(trial.role == "practice" for trial in plan.trials) == 3
    assert [trial.block for trial in plan.trials] == sorted(trial.block for trial in plan.trials)
    assert set(plan.blocks) == set(range(blocks + 1))
    assert all(
        trial.condition[trial.correct] == "reference"
        for trial in plan.trials
        if trial.role == "catch"
    )


@given(
    adaptive=st.integers(1, 12),
    catches=st.lists(st.tuples(st.integers(1, 12), st.sampled_from("abc")), max_size=6),
    before=st.sampled_from([None, frozenset("a")]),
)
def test_catch_trials_among_adaptive_ones_are_apart_wherever_that_can_be(adaptive, catches, before):
    def planned(number, shown):
        return PlannedTrial(
            id=f"main-{number:04d}", block=1, role="main", repeat=0, condition={},
            stimuli=tuple(shown), answers=("yes", "no"), track=None if shown else "t",
        )  # fmt: skip

    trials = [planned(number, "") for number in range(adaptive)]
    for number, (place, shown) in enumerate(catches, start=adaptive):
        trials.insert(min(place, len(trials)), planned(number, shown))
    most = max(Counter(shown for _, shown in catches).values(), default=0)
    assume(most <= (len(trials) + 1) // 2 - (before is not None))

    ordered = apart(trials, before)

    assert sorted(trial.id for trial in ordered) == sorted(trial.id for trial in trials)
    shown = [before or frozenset(), *(trial.shown for trial in ordered)]
    assert not any(one and one == other for one, other in pairwise(shown))


def test_catch_trials_are_spread_over_the_blocks_and_never_open_one():
    catch = {"trials": 6, "better": "reference", "worse": "push-pull", "where": {"size": "large"}}
    protocol = changed(PAPER, task={"catch": catch})
    plan = make_plan(protocol, virtual_manifest(protocol, FHD), "P1", 5)

    assert Counter(t.block for t in plan.trials if t.role == "catch") == {1: 2, 2: 2, 3: 2}
    assert not any(plan.block(number)[0].role == "catch" for number in (1, 2, 3))


def test_another_participant_or_slot_gets_another_order():
    plans = {
        make_plan(PAPER, PAPER_CLIPS, code, slot).sha256 for code in ("P1", "P2") for slot in (0, 1)
    }

    assert len(plans) == 4
    assert make_plan(PAPER, PAPER_CLIPS, "P1", 0).sha256 in plans


def test_a_photograph_on_a_circle_has_no_pairing_with_the_reference():
    plain = DEMO.model_dump()
    plain["stimuli"]["scenes"] = (
        plain["stimuli"]["scenes"][0],
        {
            "name": "street", "kind": "stereo", "left": "l.png", "right": "r.png",
            "disparity": "d.pfm", "focal_px": 1000.0, "baseline_m": 0.2,
            "camera": {"kind": "circle"},
        },
    )  # fmt: skip
    plain["task"]["catch"] = None
    protocol = StudyProtocol.model_validate(plain)
    plan = make_plan(protocol, virtual_manifest(protocol, FHD), "P1", 0)

    street = [trial for trial in plan.trials if trial.condition["scene"] == "street"]
    assert len(street) == 1 * 2 * 2  # one pairing of three, two sizes, two repeats
    assert all(set(condition(t)[2:]) == {"push-pull", "metameric"} for t in street)
    assert [name for name in protocol.shown() if name.startswith("street")] == [
        f"street__{size}__{method}"
        for size in ("small", "large")
        for method in ("push-pull", "metameric")
    ]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {
                "design": {"repeats": 2, "scenes": ("garden",)},
                "task": {"pairings": (("metameric", "push-pull"),)},
            },
            None,
        ),
        (
            {"design": {"blocks": 25}},
            "design.blocks: must not be more than the main trials, 24 .got 25.",
        ),
    ],
)
def test_a_design_that_cannot_be_arranged_is_refused(fields, message):
    protocol = changed(DEMO, **fields)
    manifest = virtual_manifest(protocol, FHD)
    if message is None:
        assert make_plan(protocol, manifest, "P1", 0).main_trials == 4
        plain = protocol.model_dump()
        plain["stimuli"]["sizes"] = plain["stimuli"]["sizes"][:1]
        plain["design"]["practice"] = plain["task"]["catch"] = None
        protocol = StudyProtocol.model_validate(plain)
        message = "no two trials in a row may show the same"
        manifest = virtual_manifest(protocol, FHD)
    with pytest.raises(StudyError, match=message):
        make_plan(protocol, manifest, "P1", 0)


def test_clips_of_another_protocol_are_refused():
    with pytest.raises(StudyError, match="must belong to study 'demo'"):
        make_plan(DEMO, PAPER_CLIPS, "P1", 0)
    wider = changed(DEMO, clips={"width_deg": 9.0})
    with pytest.raises(StudyError, match="must be built from this protocol's display and stimuli"):
        make_plan(wider, DEMO_CLIPS, "P1", 0)
    fewer = DEMO_CLIPS.model_copy(update={"clips": DEMO_CLIPS.clips[1:]})
    with pytest.raises(StudyError, match="missing 1: garden__small__reference"):
        make_plan(DEMO, fewer, "P1", 0)
    cut = DEMO_CLIPS.clips[0].model_copy(
        update={"frames_sha256": DEMO_CLIPS.clips[0].frames_sha256[1:]}
    )
    with pytest.raises(StudyError, match=r"must have 30 frames \(got 29\)"):
        check_manifest(DEMO, DEMO_CLIPS.model_copy(update={"clips": (cut, *DEMO_CLIPS.clips[1:])}))


def messages(protocol, display, manifest=None):
    return [str(problem) for problem in check_feasible(protocol, display, manifest)]


def test_150_ms_at_90_hz_is_refused_with_the_nearest_durations():
    protocol = changed(DEMO, task={"gap_s": 0.15})

    assert messages(protocol, display_at(60.0)) == []
    assert messages(protocol, display_at(120.0)) == []
    (message,) = messages(protocol, display_at(90.0))
    assert message == (
        "task.gap_s: must be whole refreshes at 90 Hz (got 0.15 s = 13.5 refreshes); nearest:"
        " 0.14444444 s or 0.15555556 s, or a display with 60 or 100 or 120 or 240 Hz"
    )
    with pytest.raises(StudyError, match=r"feasible on display 'fhd27-60hz'"):
        require_feasible(protocol, display_at(90.0))


def test_60_fps_on_144_hz_is_refused_with_the_nearest_rates():
    (message,) = messages(PAPER, display_at(144.0))

    assert message == (
        "stimuli.clips.fps: every clip frame must last whole refreshes at 144 Hz (got 60 fps ="
        " 2.4 refreshes); nearest: 72 fps or 48 fps, or a display with 60 or 120 or 240 Hz"
    )


def test_a_clip_larger_than_the_screen_is_refused_with_the_largest_angle():
    (message,) = messages(changed(DEMO, clips={"height_deg": 28.0}), FHD)

    assert message.startswith(
        "stimuli.clips.height_deg: stimuli must fit the screen pixel by pixel (got"
    )
    assert message.endswith("nearest: 27 deg")
    assert messages(changed(DEMO, clips={"height_deg": 27.0}), FHD) == []


def test_pairs_larger_than_memory_are_refused_with_feasible_values():
    small = display_at(60.0, clip_memory_mib=1024)
    (message,) = messages(PAPER, small)

    assert "the stimuli of two trials must fit 1024 MiB of graphics memory (got 25" in message
    seconds = float(message.split("duration_s = ")[1].split(" ")[0])
    degrees = float(message.split("width_deg = ")[1].split(" ")[0])
    frames = int(seconds * 60)
    assert messages(changed(PAPER, clips={"duration_s": frames / 60}), small) == []
    assert (
        messages(changed(PAPER, clips={"width_deg": degrees, "height_deg": degrees}), small) == []
    )


def test_clips_built_for_another_display_are_never_rescaled():
    other = load_display("qhd27-120hz")
    (message,) = messages(DEMO, FHD, virtual_manifest(DEMO, other))

    width, height = clip_size_px(DEMO, FHD)
    assert f"must be {width}x{height} px on this display (got 420x314 px, built for" in message
    assert "never rescaled" in message


def test_a_dot_beside_the_screen_is_refused():
    (message,) = messages(changed(DEMO, trial={"fixation_x_deg": -24.0}), FHD)

    assert message == "trial.fixation_x_deg: the dot must be on the screen (got -24 deg);" + (
        " nearest: -22.81 deg"
    )


def test_session_duration_is_added_up():
    """72 x (0.5 + 3 + 0.5 + 3 + 1.5 + 0.5) s + 2 breaks of 60 s = 768 s."""
    assert session_duration_s(PAPER, 72) == pytest.approx(72 * 9.0 + 120.0)
