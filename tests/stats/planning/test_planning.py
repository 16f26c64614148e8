"""Plans that can never show anything: said, or refused, before the data."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import result_of
from task_cases import case_text
from web_study import WEB_CASES

from analysis.parts import Part, computed
from analysis.parts.shared import planned_family
from analysis.plans.rate_plan import RatePlan
from analysis.plans.table_sections import CurveTableSection
from analysis.showable import FamilyOfTests
from analysis.simulations import Choices
from analysis.tasks import KINDS, analysis_of, planning_notes
from protocols.load import load_protocol
from protocols.tasks.single import RightOrWrong
from protocols.tasks.task_kinds import TASKS

ROOT = Path(__file__).parents[3]
DEMO = (ROOT / "protocols" / "studies" / "demo.toml").read_text()
run = result_of(env={"COLUMNS": "400"})


def test_a_family_needs_as_many_participants_as_are_said():
    family = FamilyOfTests("comparison", count=15)
    (said,) = family.hopeless(8, 0.05)
    enough = int(re.search(r"takes (\d+) participants", said)[1])

    assert 15 * 2 * 0.5**enough < 0.05 <= 15 * 2 * 0.5 ** (enough - 1)
    assert family.hopeless(enough, 0.05) == []
    assert (
        "the comparison cannot be significant" in FamilyOfTests("comparison").hopeless(5, 0.05)[0]
    )


def test_planning_says_what_two_scenes_and_small_families_cannot_show(tmp_path):
    study = load_protocol(Path("demo"))
    participant = study.model_copy(
        update={"analysis": study.analysis.model_copy(update={"test": "participant"})}
    )

    few = ["the primary", "none of", "none of"]
    assert [" ".join(note.split()[:2]) for note in planning_notes(study)] == [*few, "two scenes"]
    assert [" ".join(note.split()[:2]) for note in planning_notes(participant)] == few
    assert planning_notes(load_protocol(Path("inpainting-2afc"))) == []
    run("new-study", tmp_path / "rating", "--task", "rating", status=None)
    ratings = load_protocol(tmp_path / "rating" / "study.toml")
    assert planning_notes(ratings)[-1].endswith("Show five or more")  # they have no other test
    said = " ".join(run("protocol", "check", "demo", status=None).output.split())
    assert "note: two scenes show hardly anything" in said


# Every family of tests that a report makes is one that planning knows.


def planned_by(study, **analysis):
    """Return the study with other rules of analysis."""
    return study.model_copy(update={"analysis": study.analysis.model_copy(update=analysis)})


def case_study(folder, name, participants):
    """Return the small study of a task, with so many participants."""
    file = folder / "case.toml"
    text = case_text(WEB_CASES[name])
    file.write_text(re.sub(r"participants = \d+", f"participants = {participants}", text))
    return load_protocol(file)


def of_people(study):
    """Return planning's notes but those on few scenes."""
    return [note for note in planning_notes(study) if "scenes only" not in note]


@pytest.mark.parametrize("kind", KINDS)
def test_each_part_that_plans_a_test_names_its_families(kind):
    for part in analysis_of(kind).parts:
        plans = type(part).planned_over is not Part.planned_over
        assert not plans or type(part).families is not Part.families, part.name


def test_changes_with_size_that_can_never_be_significant_are_said_in_every_text(tmp_path):
    """Seven people show no p below 2/2^7 = .0156; Holm times 2 pairings x 3 pairs of sizes: .09."""
    sizes = ("s", "m", "l")
    plan = analysis_of("preference").plan(load_protocol(Path("inpainting-2afc")))
    scenes = plan.comparisons[0].scenes
    several = [replace(one, size=size, scenes=scenes) for one in plan.comparisons[:3]
               for size in sizes]  # fmt: skip
    plan = plan.but(sizes=sizes, comparisons=tuple(several), interaction="size")
    families = Choices(plan, analysis_of("preference").parts).families()
    own = [one for one in families if one.noun == "change"]

    assert [one.count for one in own] == [3, 6]
    assert [len(one.hopeless(7, 0.05)) for one in own] == [0, 1]
    assert [len(one.hopeless(8, 0.05)) for one in own] == [0, 0]
    (said,) = own[1].hopeless(7, 0.05)
    assert said == (
        "none of 6 changes of other pairs with size can be significant after Holm's adjustment:"
        " 7 participants can show no p below 0.016; that takes 8 participants, or fewer changes"
    )

    study = planned_by(load_protocol(Path("demo")), interaction="size")
    first, every = (note for note in planning_notes(study) if "with size" in note)
    assert first.startswith("the change of the primary preference with size cannot be significant")
    assert every.startswith("none of 2 changes of other pairs with size")
    file = tmp_path / "study.toml"
    file.write_text(
        DEMO.replace('\nkind = "preference"\n', '\nkind = "preference"\ninteraction = "size"\n')
    )
    for command in (("protocol", "check"), ("protocol", "preregister"), ("analysis", "power")):
        more = ("--studies", 100) if "power" in command else ()
        assert first in " ".join(run(*command, file, *more, status=None).output.split()), command


def test_p_of_people_who_all_agree_is_the_least_that_planning_promises(rng):
    """Of nine pairs of methods and sizes, nobody wavers: every p is the floor, none is below it."""
    plan = analysis_of("preference").plan(load_protocol(Path("inpainting-2afc")))
    simulation = Choices(plan.but(interaction="size"), analysis_of("preference").parts)
    sure = {"rate": 0.99, "participant_sd": 0.0, "scene_sd": 0.0, "interaction": 0.0}
    assumed = {one.name: one.value for one in simulation.assumptions} | sure
    answers = simulation.draw(assumed, 1, 6, rng)
    answers = replace(answers, given=np.ones_like(answers.given))
    tests = {}
    for part in simulation.parts:
        tests |= part.planned_over(answers, (6,), simulation.plan)
    first, every, *_ = simulation.families()
    least = 2 * 0.5**6

    assert tests["primary"]().min() == pytest.approx(least)
    assert tests[""]().min() == pytest.approx(6 * least)
    assert [len(first.hopeless(6, alpha)) for alpha in (least, 1.01 * least)] == [1, 0]
    assert [len(every.hopeless(6, 6 * alpha)) for alpha in (least, 1.01 * least)] == [1, 0]


def test_changes_of_right_answers_are_warned_of_at_planning(tmp_path):
    """One comparison at two levels: six people show .031, five no p below .062."""
    five, six = (
        of_people(planned_by(case_study(tmp_path, "identification", people), by="method",
                                  level=None, baseline="one", interaction="level"))
        for people in (5, 6)
    )  # fmt: skip

    assert [note.split(" cannot")[0] for note in five] == [
        "the comparison",
        "the change with level",
    ]
    assert six == []


def test_a_test_against_chance_needs_fewer_people_where_guessing_is_rarer():
    """Four alternatives: three people who are right by chance are a matter of 2/4^3 = .031."""
    facts = {"study": "", "title": "", "values": (), "answers": (), "labels": {}, "guess": None}
    plan = RatePlan(section=CurveTableSection(), alternatives=2, **facts)
    of = {n: planned_family(0, plan.but(alternatives=n)) for n in (2, 4)}

    assert [len(of[4].hopeless(3, alpha)) for alpha in (2 * 0.25**3, 0.032)] == [1, 0]
    assert [len(of[4].hopeless(people, 0.05)) for people in (2, 3)] == [1, 0]
    assert [len(of[2].hopeless(people, 0.05)) for people in (5, 6)] == [1, 0]
    assert "the test against chance cannot be significant" in of[2].hopeless(5, 0.05)[0]


def test_draws_of_a_bootstrap_that_are_too_few_are_said_with_a_cure_that_works(tmp_path):
    """19 draws show no p below 1/20 = .05, which is not below alpha."""
    study = planned_by(case_study(tmp_path, "rating", 6), reaction="models")
    few = of_people(planned_by(study, bootstrap_draws=19))

    assert [note.split(" cannot")[0] for note in few] == [
        "the comparison of ratings", "the ratio of times",
    ]  # fmt: skip
    assert "that takes bootstrap_draws = 20, or bootstrap_draws = 0" in few[0]
    for draws in (20, 0):
        assert of_people(planned_by(study, bootstrap_draws=draws)) == []


RIGHT_OR_WRONG = [name for name, kind in TASKS.items() if issubclass(kind.task, RightOrWrong)]


@pytest.mark.parametrize("name", RIGHT_OR_WRONG)
def test_right_answers_whose_power_is_known_have_a_planned_p(name, tmp_path, rng):
    study = case_study(tmp_path, name, 8)
    simulation = analysis_of(study.analysis.kind).simulation(study)
    assumed = {one.name: one.value for one in simulation.assumptions}
    answers = simulation.draw(assumed, 1, 8, rng)
    plan, needed = simulation.plan, ("rates", "sensitivity", "comparisons")
    parts = [one for one in simulation.parts if one.name in needed]
    found, _ = computed(parts, simulation.table(answers), plan)
    planned = [one.planned_p(found[one.name], plan) for one in parts if one.name in found]

    assert any(p is not None for p in planned)
    if study.analysis.kind == "detection":  # "one" has no signal: the other's d' is compared with 0
        told = (part.planned_over(answers, (8,), plan) for part in parts)
        (test,) = (tests[""]() for tests in told if "" in tests)
        assert [p for p in planned if p is not None] == [pytest.approx(float(test.item()))]


def test_a_study_of_ratings_tests_times_only_where_it_says_so(tmp_path):
    run("new-study", tmp_path / "rating", "--task", "rating", status=None)
    study = load_protocol(tmp_path / "rating" / "study.toml")
    analysis = analysis_of("ratings")
    for reaction in ("summary", "models"):
        planned = planned_by(study, reaction=reaction)
        nouns = [one.noun for one in analysis.families(planned)]
        assert analysis.plan(planned).reaction == reaction
        assert ("ratio" in " ".join(nouns)) == (reaction == "models")
