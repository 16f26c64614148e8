"""Planned looks: rpact's and published bounds, Bayes factors, error, where a study stands."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from itertools import starmap
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result
from undrawn_reports import undrawn

from analysis.models.bayes_factor import t_bayes_factor
from analysis.models.contrasts import Difference
from analysis.models.ordinal import RatingDifference
from analysis.models.sequential_bounds import (
    critical_values,
    plan_of,
    sequential_error,
    spent,
    standing,
)
from analysis.parts import computed, estimates_of
from analysis.parts.comparisons import ComparisonsPart, PlannedTests
from analysis.parts.interim_looks import LooksPart
from analysis.parts.ratings import RatingsPart
from analysis.parts.shared import difference_estimates
from analysis.plans.rate_plan import RatePlan
from analysis.plans.rating_plan import RatingPlan
from analysis.plots.sequential_plot import bounds_plot
from analysis.power import planned_p_values
from analysis.report.write_report import report_sessions
from analysis.tasks import analysis_of
from protocols.errors import StudyError
from protocols.load import load_protocol
from protocols.study_file.preregister import _analysis, _sample, to_markdown
from protocols.study_file.sequential import Sequential
from study_app.cli import app

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_sequential.json").read_text())


@pytest.mark.parametrize("said", ORACLE, ids=lambda s: f"{s['rule']}-{len(s['t'])}-{s['alpha']}")
def test_bounds_are_rpacts(said):
    z = critical_values(said["t"], said["alpha"], said["rule"])

    np.testing.assert_allclose(z, said["z"], rtol=2e-5)
    for t, error in zip(said["t"], said["spent"], strict=True):
        assert spent(t, said["alpha"], said["rule"]) == pytest.approx(error, rel=1e-4, abs=1e-9)


def test_bounds_are_the_published_ones():
    """Five equal looks, two-sided .05 (Jennison and Turnbull 2000; program ld98)."""
    fractions = np.arange(1, 6) / 5

    np.testing.assert_allclose(
        critical_values(fractions, 0.05, "obrien-fleming"),
        [4.8769, 3.3569, 2.6803, 2.2898, 2.0310],
        atol=2e-4,
    )
    np.testing.assert_allclose(
        critical_values(fractions, 0.05, "pocock"),
        [2.4380, 2.4268, 2.4101, 2.3966, 2.3859],
        atol=2e-4,
    )


def test_a_single_look_is_the_plain_test():
    assert critical_values([1.0], 0.05, "pocock") == pytest.approx(1.959964, abs=1e-6)


@pytest.mark.parametrize("fractions", [[], [0.5, 0.5, 1], [0.0, 1], [0.5, 1.2]])
def test_fractions_that_do_not_rise_are_refused(fractions):
    with pytest.raises(ValueError, match="must rise"):
        critical_values(fractions, 0.05, "pocock")


@pytest.mark.parametrize("rule", ["obrien-fleming", "pocock"])
def test_a_random_walk_leaves_the_bounds_as_often_as_alpha(rule):
    rng = np.random.default_rng(5)
    looks = (6, 15, 20)
    walk = np.cumsum(rng.standard_normal((200_000, 20)), axis=1)[:, np.array(looks) - 1]
    z = walk / np.sqrt(looks)
    bounds = critical_values([n / 20 for n in looks], 0.05, rule)

    out = np.mean((np.abs(z) >= bounds).any(axis=1))
    assert out == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 200_000))


def test_bayes_factors_become_bounds_of_p_where_the_factor_is_that():
    from scipy import stats

    plan = plan_of(Sequential(rule="bayes-factor", looks=(8, 20, 40), bayes_factor=6), 0.05)

    for people, low, high in zip(plan.looks, plan.reject_p, plan.accept_p, strict=True):
        t = stats.t.isf(low / 2, people - 1)
        assert t_bayes_factor(t, people) == pytest.approx(6.0, rel=1e-5)
        if high is not None:
            t = stats.t.isf(high / 2, people - 1)
            assert t_bayes_factor(t, people) == pytest.approx(1 / 6, rel=1e-5)
    assert plan.accept_p[0] is None  # eight people cannot show that there is nothing
    assert plan.spent == (None, None, None)


def test_each_study_ends_once_at_its_first_bound():
    plan = plan_of(Sequential(rule="pocock", looks=(10, 20)), 0.05)
    p = np.array([[0.001, 0.9], [0.3, 0.001], [0.3, 0.2], [0.04, 0.3]])
    found = sequential_error(plan, p)

    assert found.stops == (0.25, 0.25)
    assert found.significant == 0.5
    assert found.accepts == (0.0, 0.0)
    assert found.participants == pytest.approx((10 + 20 + 20 + 20) / 4)
    assert found.naive == 0.75


def test_stops_for_no_difference_are_counted_apart():
    plan = plan_of(Sequential(rule="bayes-factor", looks=(40, 80), bayes_factor=3), 0.05)
    found = sequential_error(plan, np.array([[1.0, 1e-9], [0.2, 1e-9], [1e-9, 1.0]]))

    assert found.accepts == pytest.approx((1 / 3, 0.0))
    assert found.stops == pytest.approx((1 / 3, 1 / 3))


@pytest.mark.parametrize(
    ("people", "p", "verdict", "said"),
    [
        (5, 0.001, "wait", "before the first look"),
        (10, 0.0001, "stop: significant", "Look 1 of 3"),
        (10, 0.02, "go on", "The next look is at 20 participants"),
        (15, 0.0001, "wait", "after look 1 of 3"),
        (30, 0.04, "stop: significant", "Look 3 of 3"),
        (32, 0.5, "end: not significant", "Look 3 of 3 (32 participants)"),
        (30, None, "wait", "no planned test"),
    ],
)
def test_where_a_study_stands(people, p, verdict, said):
    plan = plan_of(Sequential(rule="obrien-fleming", looks=(10, 20, 30)), 0.05)
    found = standing(plan, people, p, "that of the test")

    assert found.verdict == verdict
    assert said in found.sentence


# Studies that plan looks.


def with_looks(protocol, **section):
    analysis = protocol.analysis.model_copy(update={"sequential": Sequential(**section)})
    return protocol.model_copy(update={"analysis": analysis})


def test_looks_are_planned_in_the_study_file(tmp_path, demo_protocol):
    shipped = Path(__file__).parents[3] / "protocols" / "studies" / "demo.toml"
    people = demo_protocol.study.participants

    def written(looks: str):
        text = shipped.read_text() + (
            f'\n[analysis.sequential]\nrule = "pocock"\nlooks = {looks}\n'
        )
        file = tmp_path / "study.toml"
        file.write_text(text)
        return load_protocol(file)

    study = written(f"[2, {people}]")
    assert study.analysis.sequential.looks == (2, people)
    assert study.sha256 != demo_protocol.sha256
    assert "Lan-DeMets function of Pocock type" in preregistration_text(study)
    for looks, said in (
        (f"[2, {people - 1}]", f"must end with study.participants, {people}"),
        (f"[2, 2, {people}]", "looks must rise"),
        (f"[1, {people}]", "from 2 participants on"),
        (f"[{people}]", "analysis.sequential.looks"),
    ):
        with pytest.raises(StudyError, match=r"analysis\.sequential") as caught:
            written(looks)
        assert said in str(caught.value)


def preregistration_text(study) -> str:
    return to_markdown("t", [_analysis(study)])


def test_a_study_without_looks_keeps_its_hash(demo_protocol):
    assert "sequential" not in json.dumps(demo_protocol.analysis.model_dump(exclude_none=True))
    assert demo_protocol.analysis.sequential is None


def test_the_studys_own_test_keeps_alpha_over_all_looks(demo_protocol, proof_count):
    """The clustered test is shy, with two scenes very much so: looks may not make it bold."""
    studies = proof_count(4000)
    study = with_looks(demo_protocol, rule="pocock", looks=(8, 12, 16))
    simulation = analysis_of("preference").simulation(study)
    plan = plan_of(study.analysis.sequential, 0.05)
    p = {
        null: planned_p_values(
            simulation, {"rate": 0.75}, plan.looks, null=null,
            rng=np.random.default_rng(1), studies=studies,
        )
        for null in (True, False)
    }  # fmt: skip
    nothing, something = (sequential_error(plan, p[null]) for null in (True, False))

    assert p[True].shape == (studies, 3)
    assert nothing.significant <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / studies)
    assert nothing.naive >= nothing.significant
    assert something.significant > 0.15
    assert something.participants < nothing.participants


def test_right_answers_are_simulated_too():
    study = load_protocol(Path("beyond-blur-detection"))
    study = with_looks(study, rule="pocock", looks=(4, 6))
    simulation = analysis_of(study.analysis.kind).simulation(study)
    p = planned_p_values(simulation, {}, (4, 6), null=True, rng=np.random.default_rng(0), studies=3)

    # One of its conditions never holds the signal: it has no d' to compare, and is left out.
    assert p.shape == (3, 2)
    assert np.all((p > 0) & (p <= 1))


def test_the_report_says_at_which_look_it_stands(write_journals, demo_protocol, tmp_path):
    study = with_looks(demo_protocol, rule="obrien-fleming", looks=(4, 8))
    journals = write_journals(tmp_path / "s", people=4, protocol=study)
    with undrawn():
        made = report_sessions(journals, study, tmp_path / "r", figure_files=False)
    noted = json.loads(made.json.read_text())

    assert noted["results"]["looks"]["standing"]["look"] == 1
    assert (
        noted["results"]["looks"]["standing"]["p"]
        == noted["results"]["preferences"]["primary"]["p"]
    )
    assert "Planned looks: " in made.html.read_text()
    assert "Look 1 of 2 (4 participants)" in made.html.read_text()
    assert "Limits that take account of the looks" in made.html.read_text()
    (limits,), plain = (
        noted["results"]["looks"]["limits"],
        noted["results"]["preferences"]["primary"],
    )
    assert limits["value"] == plain["share"]
    assert limits["lower"] < plain["lower"] < plain["upper"] < limits["upper"]


def test_the_figure_shows_every_bound_and_the_study():
    plan = plan_of(Sequential(rule="bayes-factor", looks=(8, 16, 24), bayes_factor=3.0), 0.05)
    (axes,) = bounds_plot(plan, people=16, p=0.02).axes
    drawn = {line.get_label(): line.get_ydata() for line in axes.lines}

    np.testing.assert_allclose(drawn["significant"], plan.reject_p)
    kept = [bound for bound in plan.accept_p if bound is not None]
    np.testing.assert_allclose(drawn["no difference"], kept)
    assert list(drawn["this study"]) == [0.02]
    assert axes.get_ylim()[0] > axes.get_ylim()[1]  # small p above


@pytest.mark.parametrize("people", [8, 16, 24])
def test_limits_at_a_look_leave_out_one_half_exactly_where_it_stops(demo_protocol, people):
    """Shares of all strengths: the look's bound, and the limits that invert the test there."""
    plan = plan_of(Sequential(rule="pocock", looks=(8, 16, 24)), 0.05)
    bound = plan.reject_p[plan.looks.index(people)]
    settings = analysis_of("preference").settings(demo_protocol).but(alpha=bound)
    method, against, size = settings.primary
    stopped = set()
    for each in range(4, 13):
        wins = np.arange(12) < each
        rows = pd.DataFrame(
            [
                (f"P{who}", f"s{k % 6}", settings.sizes[0] if size == "all" else size, method,
                 against, method if wins[(k + who) % 12] else against)
                for who in range(people)
                for k in range(12)
            ],
            columns=["participant", "scene", "size", "first", "second", "chosen"],
        )  # fmt: skip
        analysis = analysis_of("preference")
        table = analysis.table(rows, settings)
        (one,) = estimates_of(analysis.parts, table, settings, planned=True)
        assert (one.p < bound) == (one.lower > 0.5 or one.upper < 0.5)
        stopped.add(one.p < bound)

    assert stopped == {True, False}


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["analysis", *map(str, arguments)], env={"COLUMNS": "200"})


def test_the_command_prints_bounds_and_error(tmp_path):
    shipped = Path(__file__).parents[3] / "protocols" / "studies" / "demo.toml"
    file = tmp_path / "study.toml"
    file.write_text(
        shipped.read_text().replace("\nparticipants = 4\n", "\nparticipants = 16\n")
        + '\n[analysis.sequential]\nrule = "obrien-fleming"\nlooks = [9, 16]\n'
    )
    result = run("sequential", file, "--set", "rate=0.8", "--studies", 100, "--out",
                 tmp_path / "out")  # fmt: skip
    without = run("sequential", "demo")

    assert result.exit_code == 0, result.output
    assert "rate 0.8" in result.output
    assert "Without an effect" in result.output
    assert (tmp_path / "out" / "looks.csv").is_file()
    assert (tmp_path / "out" / "looks-1-column.pdf").is_file()
    assert without.exit_code == 2
    assert "add [analysis.sequential]" in " ".join(without.output.split())


# Which p a look judges.


def gap(p: float, adjusted: float) -> Difference:
    nothing = dict.fromkeys(("difference", "standard_error", "lower", "upper", "level", "df"), 0.0)
    return Difference(measure="d'", first="a", second="b", p=p, p_adjusted=adjusted, **nothing)


@pytest.mark.parametrize(("correction", "judged"), [("holm", 0.06), ("none", 0.02)])
@pytest.mark.parametrize("adaptive", [False, True])
def test_a_look_judges_p_as_the_study_corrects_it(adaptive, correction, judged):
    """Three p of .02, .04 and .5: Holm's least is 3 x .02. Thresholds are compared alike."""
    plan = RatePlan.model_construct(correction=correction, adaptive=adaptive, labels={})
    found = PlannedTests(tuple(starmap(gap, ((0.04, 0.08), (0.02, 0.06), (0.5, 0.5)))), (), ())

    assert ComparisonsPart().planned_p(found, plan) == judged
    shown = difference_estimates(found.differences, {"a": 1, "b": 1}, plan)
    assert min(one.p for one in shown) == judged


@pytest.mark.parametrize(("correction", "judged"), [("holm", 0.06), ("none", 0.02)])
def test_a_look_at_ratings_judges_likelihood_ratios_as_the_study_corrects_them(correction, judged):
    nothing = dict.fromkeys([one.name for one in fields(RatingDifference)], np.nan)
    ratings = [
        RatingDifference(**nothing | {"ratio_p": own, "ratio_p_adjusted": together})
        for own, together in ((0.04, 0.08), (0.02, 0.06), (np.nan, np.nan))
    ]
    ratings = [replace(one, first="a", second="b", difference=1.0) for one in ratings]
    found = SimpleNamespace(model=SimpleNamespace(contrasts=ratings), levels={})
    plan = RatingPlan.model_construct(correction=correction, by="method")

    assert RatingsPart().planned_p(found, plan) == judged
    assert RatingsPart().estimates(found, plan)[1].p == judged


@pytest.mark.parametrize(("correction", "verdict"), [("holm", "go on"), ("none", "stop")])
def test_report_and_preregistration_say_which_p_a_look_judges(correction, verdict, rng):
    """One of five methods is told apart by 8 of 14 people: p lies below the bound, 5 p above."""
    study = load_protocol(Path("beyond-blur-task"))
    section = Sequential(rule="pocock", looks=(8, 14))
    study = with_rules(study, sequential=section, correction=correction)
    analysis = analysis_of(study.analysis.kind)
    simulation = analysis.simulation(study)
    parts = [one for one in simulation.parts if one.name in ("rates", "sensitivity", "comparisons")]
    answers = simulation.draw(
        {one.name: one.value for one in simulation.assumptions} | {"difference": 0.0}, 1, 8, rng
    )
    found, _ = computed(parts, simulation.table(answers), simulation.plan)
    differences = found["comparisons"].differences
    bound = plan_of(section, 0.05).reject_p[0]
    own = (0.9 * bound, *[0.9] * (len(differences) - 1))
    found["comparisons"] = replace(
        found["comparisons"],
        differences=tuple(replace(one, p=p, p_adjusted=min(1.0, len(own) * p))
                          for one, p in zip(differences, own, strict=True)),
    )  # fmt: skip
    part = LooksPart(study, section, parts, analysis.families(study)[0])
    looks = part.compute(simulation.table(answers), simulation.plan, found, rng)

    assert looks.standing.p == pytest.approx(own[0] * (len(own) if correction == "holm" else 1))
    assert looks.standing.verdict.startswith(verdict)
    adjusted = {"holm": "Holm-adjusted", "none": "not adjusted"}[correction]
    word = f"the least, {adjusted}, of the comparisons with reference"
    assert word in looks.standing.sentence
    assert word in preregistration_text(study)
    assert word in part.show(looks, simulation.plan).methods


def with_rules(protocol, **rules):
    return protocol.model_copy(update={"analysis": protocol.analysis.model_copy(update=rules)})


def test_a_look_at_preferences_judges_the_primary_comparison_alone(demo_protocol):
    for correction in ("holm", "none"):
        study = with_rules(demo_protocol, correction=correction)
        study = with_looks(study, rule="bayes-factor", looks=(8, 16))
        said = preregistration_text(study)
        assert "that of the primary comparison, not adjusted" in said
        # A look counts those whom the exclusions leave, and so does the end.
        ends = to_markdown("t", [_sample(study, None, None)])
        assert "completed their session and are left after the exclusions" in ends
        assert "looked at with 8, 16 participants left after exclusions" in said
    assert "are left after" not in to_markdown("t", [_sample(demo_protocol, None, None)])


def test_several_comparisons_without_correction_are_why_looks_err(tmp_path):
    shipped = Path(__file__).parents[3] / "protocols" / "studies" / "beyond-blur-task.toml"
    text = shipped.read_text().replace('correction = "holm"', 'correction = "none"')
    file = tmp_path / "study.toml"
    file.write_text(f'{text}\n[analysis.sequential]\nrule = "pocock"\nlooks = [10, 14]\n')
    result = run("sequential", file, "--studies", 100)

    assert 'each comparison is judged by itself (correction = "none")' in result.output
    assert "difference 0.5" in result.output
    assert "nan" not in result.output  # of assumptions that are not made
