"""One simulator of power: its figures are those of before, and its tests are those of the parts."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import metamerlab
from scipy import stats

from analysis.parts import Part, Presentation, computed
from analysis.parts.preferences import PreferencesPart
from analysis.parts.ratings import RatingsPart
from analysis.pilot import rating_deviations
from analysis.plans.preference_plan import Comparison
from analysis.plans.rating_plan import RatingPlan
from analysis.plans.table_sections import RatingTableSection
from analysis.power import planned_p_values, power
from analysis.simulations import Choices, RatedSteps
from analysis.tasks import analysis_of
from protocols.errors import StudyError
from protocols.load import load_protocol
from protocols.study_file.new_study import preferences_of
from protocols.tasks.base import Arrangement, Cell

BEFORE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_power.json").read_text())
"""Power of shipped studies and documented examples, by the two simulators that this one replaced.

10,000 studies of preferences, 1,000 of others, seed 1.
"""


def simulation_of(name: str):
    if name.startswith("pairs"):
        study = preferences_of(pairs=3, scenes=6, repeats=2, participants=11)
    else:
        study = load_protocol(Path(name.split(",")[0]))
    return analysis_of(study.analysis.kind).simulation(study)


def test_power_of_scalings_says_that_it_is_of_shares(rng):
    simulation = simulation_of("critical-scaling-halves")
    found = power(simulation, {}, rng=rng, studies=20, participants=(4,))

    assert any("the study compares critical scalings" in note for note in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("name", BEFORE)
def test_power_is_what_it_was_within_chance(name, rng, full):
    """Within 4.5 errors of both simulations; the error of a share of 0 is that of half a study."""
    before, simulation = BEFORE[name], simulation_of(name)
    studies = (2000 if isinstance(simulation, Choices) else 200) * (5 if full else 1)
    people = before["participants"]
    found = power(simulation, before["assumed"], rng=rng, studies=studies, participants=people)

    figures = {**found.numbers, **found.curves, **found.wrong}
    for figure, values in before["figures"].items():
        was, now = np.array(values), figures[figure]
        both = (was + now) / 2
        spread = np.sqrt(np.maximum(both * (1 - both), 0.5 / studies))
        error = spread * np.sqrt(1 / studies + 1 / before["studies"])
        assert np.all(np.abs(now - was) < 4.5 * error), (figure, was, now)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "how"),
    [
        *(("pairs", how) for how in ("as planned", "participant", "pooled", "none")),
        ("demo", "as planned"),
        ("beyond-blur-detection", "as planned"),
        ("beyond-blur-detection", "participant"),
        ("beyond-blur-task", "as planned"),
        ("beyond-blur-task", "none"),
        ("critical-scaling-halves", "participant"),
    ],
)
def test_p_of_simulated_answers_is_that_of_their_table(name, how, rng):
    """Counts of cells and a table of trials are the same answers: both give the report's p."""
    simulation = simulation_of(name)
    pairs = isinstance(simulation, Choices)
    change = {"correction": how} if how == "none" else {"test": how}
    plan = simulation.plan if how == "as planned" else simulation.plan.but(**change)
    simulation.plan = plan
    assumed = {one.name: one.value for one in simulation.assumptions if not np.isnan(one.value)}
    studies = 3 if pairs else 1
    answers = simulation.draw(assumed, studies, 9, rng)
    kept = ("preferences", "rates", "sensitivity", "comparisons")
    parts = [part for part in simulation.parts if part.name in kept]
    tests = {}
    for part in parts:
        tests |= part.planned_over(answers, (5, 9), plan)
    p = {name: test() for name, test in tests.items()}
    for study in range(studies):
        for place, people in enumerate((5, 9)):
            one = answers.of(study, people)
            found, _ = computed(parts, simulation.table(one), plan)
            planned = [part.planned_p(found[part.name], simulation.plan) for part in parts]
            first = next(iter(p.values()))[study, place].min()
            known = [q for q in planned if q is not None]
            if name.startswith("critical"):  # critical scalings are planned, and power says shares
                known = [min(one.p_adjusted for one in found["sensitivity"].contrasts)]
            assert first == pytest.approx(known[0], rel=1e-6)
            if pairs:
                cells = found["preferences"].table.cells
                adjusted = [cell.test.p_adjusted for cell in cells]
                np.testing.assert_allclose(p[""][study, place], adjusted, rtol=1e-6)


def test_sizes_whose_scenes_differ_are_simulated(rng):
    """Before, the primary comparison over all sizes ended in a traceback."""
    plan = simulation_of("pairs").plan
    method, against, _ = plan.primary
    comparisons = (
        Comparison(method, against, "small", ("a", "b", "c"), 2),
        Comparison(method, against, "large", ("b", "c", "d", "e", "f"), 2),
    )
    plan = plan.but(sizes=("small", "large"), comparisons=comparisons)
    simulation = Choices(plan, (PreferencesPart(),))
    assumed = {"rate": 0.7, "participant_sd": 0.4, "scene_sd": 0.2, "size_correlation": 1.0}
    answers = simulation.draw(assumed, 2, 8, rng)
    p = PreferencesPart().planned_over(answers, (4, 8), plan)["primary"]()

    for study in range(2):
        table = simulation.table(answers.of(study, 8))
        found = PreferencesPart().compute(table, plan, {}, rng)
        assert p[study, 1, 0] == pytest.approx(found.primary.test.p, rel=1e-9)


class Sides(Part):
    """A sign test of people, as a lab would add it: it knows tables only."""

    name, section = "sides", ("sides", "Sides")

    def compute(self, table, plan, _found, _chance):
        method, against, _ = plan.primary
        pair = table["chosen"].isin((method, against)) & table["rejected"].isin((method, against))
        won = (table[pair]["chosen"] == method).groupby(table[pair]["participant"].astype(str))
        more = int((won.mean() > 0.5).sum())
        return stats.binomtest(more, won.ngroups).pvalue

    def planned_p(self, found, _plan):
        return found

    def show(self, _found, _plan):
        return Presentation()


class Never(Sides):
    name = "fast"

    def wanted(self, table, _plan):
        return "rt_s" in table


@pytest.mark.slow
def test_a_part_that_knows_tables_only_has_the_power_that_can_be_counted(rng):
    """One decision each: a sign test of people whose power is a sum of binomial chances."""
    study = preferences_of(pairs=1, scenes=2, repeats=1, participants=12)
    plan = analysis_of("preference").plan(study)
    one_scene = replace(plan.comparisons[0], scenes=("a",))
    simulation = Choices(plan.but(comparisons=(one_scene,)), (Sides(),))
    assumed = {"rate": 0.8, "participant_sd": 0.0, "scene_sd": 0.0}
    found = power(simulation, assumed, rng=rng, studies=60, participants=[6, 12])

    for place, people in enumerate((6, 12)):
        counts = np.arange(people + 1)
        small = np.array([stats.binomtest(int(k), people).pvalue < 0.05 for k in counts])
        for rate, figure in ((0.8, found.curves["sides"]), (0.5, found.wrong["false positives"])):
            by_hand = stats.binom.pmf(counts, people, rate)[small].sum()
            error = np.sqrt(max(by_hand * (1 - by_hand), 0.01) / 60)
            assert figure[place] == pytest.approx(by_hand, abs=4 * error)
    p = planned_p_values(simulation, assumed, [6], rng=rng, studies=5)
    assert set(np.round(p.ravel(), 6)) <= {0.03125, 0.21875, 0.6875, 1.0}


def test_what_cannot_be_simulated_is_said(rng):
    plan = simulation_of("demo").plan
    found = power(Choices(plan, (Sides(), Never())), {}, rng=rng, studies=3, participants=[4])
    (note,) = (one for one in found.warnings if "fast" in one)
    assert note == (
        "the test of fast is not simulated: answers are drawn without what it is about, such as"
        " reaction times"
    )
    with pytest.raises(StudyError, match="no statistic of its analysis plans a test"):
        power(Choices(plan, ()), {}, rng=rng, studies=100)


# Ratings.


@pytest.fixture(scope="module")
def rated():
    """The simulation of a study of ratings, two methods in six scenes."""
    study = load_protocol(Path("demo"))
    cells = [
        Cell(scene, (Arrangement({"scene": scene, "method": method}, ()),))
        for scene in "abcdef"
        for method in ("blur", "ours")
    ]
    told = SimpleNamespace(
        task=SimpleNamespace(cells=lambda _pool: cells),
        pool=None,
        design=SimpleNamespace(repeats=1),
        analysis=study.analysis,
        study=study.study,
    )
    scale = ("bad", "poor", "fair", "good")
    asked = RatingTableSection(by="method", baseline="blur", scale=scale)
    plan = RatingPlan(section=asked, study="s", title="s", scale=asked.scale)
    return RatedSteps(told, plan, (RatingsPart(),))


def test_power_of_ratings_rises_with_people_and_effect_and_keeps_alpha(rated, rng):
    found = power(rated, {"difference": 0.6}, rng=rng, studies=400, participants=[6, 12, 30])
    large = power(rated, {"difference": 1.2}, rng=rng, studies=400, participants=[6, 12, 30])

    each = found.numbers["each"]
    assert each[0] < each[1] < each[2]
    assert np.all(large.numbers["each"] > each)
    assert found.wrong["false positives"].max() < 0.15
    assert any("not by the report's mixed model" in note for note in found.warnings)


@pytest.mark.full
def test_p_of_simulated_ratings_is_near_that_of_the_reports_model(rated, rng):
    assumed = {"difference": 0.7, "participant_sd": 0.5, "scene_sd": 0.3}
    answers = rated.draw(assumed, 10, 8, rng)
    near = RatingsPart().planned_over(answers, (8,), rated.plan)[""]()[:, 0, 0]
    part = RatingsPart()
    models = np.array(
        [
            part.planned_p(part.of(rated.table(answers.of(k, 8)), rated.plan), rated.plan)
            for k in range(10)
        ]
    )
    gap = np.log(near) - np.log(models)
    assert np.corrcoef(np.log(near), np.log(models))[0, 1] > 0.9
    assert abs(np.median(gap)) < 0.5


@pytest.mark.slow
def test_deviations_of_a_pilot_of_ratings_are_those_it_was_made_with(rated, rng):
    assumed = {"difference": 0.7, "participant_sd": 0.8, "scene_sd": 0.3}
    table = rated.table(rated.draw(assumed, 1, 40, rng)).drop(columns="condition")
    values, notes = rating_deviations(table, rated.plan)

    assert values["participant_sd"] == pytest.approx(0.8, abs=0.25)
    assert values["scene_sd"] == pytest.approx(0.3, abs=0.25)
    assert [note.split(" in ")[0] for note in notes] == ["only 6 scenes"]
    with pytest.raises(StudyError, match="deviations cannot be taken from this pilot"):
        rating_deviations(table.assign(rating="bad"), rated.plan)


def test_the_command_simulates_a_new_study_of_ratings(tmp_path):
    def run(*words: object):
        return metamerlab(*words, env={"COLUMNS": "200"}, status=None)

    assert run("new-study", tmp_path / "new", "--task", "rating").exit_code == 0
    done = run("analysis", "power", tmp_path / "new" / "study.toml", "--studies", 100)

    assert done.exit_code == 0, done.output
    said = re.sub(r"\s+", " ", done.output)
    assert "difference 0.5, participant_sd 0.5, scene_sd 0.3" in said
    assert "10 comparisons" in said
    # Two scenes are too few for the report's model, and it says so in place of a number.
    assert "do not plan by these numbers: in this design the test errs too often" in said


def test_power_of_an_interaction_is_that_of_its_part_and_nothing_to_find_is_seldom_found(rng):
    """Between sizes of the primary comparison; the null leaves people who differ by size."""
    study = load_protocol(Path("inpainting-2afc"))
    analysis = analysis_of("preference")
    study = analysis.simulation(study).plan.but(interaction="size")
    plan = Choices(study, analysis.parts)
    assumed = {one.name: one.value for one in plan.assumptions} | {"interaction": 0.3}
    answers = plan.draw(assumed, 2, 8, rng)
    (part,) = [one for one in plan.parts if one.name == "interaction"]
    p = part.planned_over(answers, [6, 8], plan.plan)["interaction"]()

    for number in range(2):
        for place, count in enumerate([6, 8]):
            table = plan.table(answers.of(number, count))
            found = part.compute(table, study, {}, np.random.default_rng(0))
            shares = [one.gap.p_adjusted for one in found.planned if one.gap.measure != "JOD"]
            assert p[number, place] == pytest.approx(shares)
    found = power(plan, {"rate": 0.6, "interaction": 0.3}, rng=rng, studies=300, participants=[12])
    assert found.curves["interaction"][0] > 0.5
    assert found.wrong["interaction: false positives"][0] < 0.09
    assert any("size_correlation" in note for note in found.warnings)
    with pytest.raises(StudyError, match="every size a share between 0 and 1"):
        power(plan, {"rate": 0.95, "interaction": 0.3}, rng=rng, studies=2, participants=[4])


@pytest.mark.parametrize(
    ("name", "by", "factor"),
    [
        ("beyond-blur-detection", "method", "cut"),
        ("beyond-blur-task", "method", "symbol"),
        ("beyond-blur-task", "symbol", "eccentricity_deg"),
    ],
)
def test_power_of_an_interaction_of_right_answers_is_that_of_its_part(name, by, factor, rng):
    """Yes-no answers, and those of a set; no change is seldom found, and a large one often."""
    study = load_protocol(Path(name))
    asked = {"interaction": factor, "by": by} | ({"baseline": None} if by == "symbol" else {})
    study = study.model_copy(update={"analysis": study.analysis.model_copy(update=asked)})
    simulation = analysis_of(study.analysis.kind).simulation(study)
    assumed = {one.name: one.value for one in simulation.assumptions if not np.isnan(one.value)}
    answers = simulation.draw(assumed | {"interaction": 2.0}, 2, 8, rng)
    (part,) = [one for one in simulation.parts if one.name == "interaction"]
    p = part.planned_over(answers, [6, 8], simulation.plan)["interaction"]()

    for number in range(2):
        for place, count in enumerate([6, 8]):
            table = simulation.table(answers.of(number, count))
            found = part.compute(table, simulation.plan, {}, np.random.default_rng(0))
            assert p[number, place] == pytest.approx([one.gap.p_adjusted for one in found.planned])


def test_a_change_of_right_answers_is_found_where_there_is_one(rng):
    """Without it the test errs seldom, though people and scenes differ in it."""
    study = load_protocol(Path("beyond-blur-detection"))
    asked = study.analysis.model_copy(update={"interaction": "cut"})
    simulation = analysis_of("detection").simulation(study.model_copy(update={"analysis": asked}))
    found = power(simulation, {"interaction": 2.0, "d_prime": 2.0}, rng=rng, studies=100,
                  participants=[20])  # fmt: skip

    assert found.curves["interaction: a comparison"][0] > 0.5
    assert found.wrong["interaction: false positives"][0] < 0.1
    assert "the change of a comparison with cut is significant" in found.legend
