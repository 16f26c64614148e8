"""Confidence: type-2 areas, meta-d' and unequal variances against R, metadpy and closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from made_up_trials import simulate_confidence
from scipy import stats
from typer.testing import CliRunner
from undrawn_reports import undrawn

from analysis.models.metacognition import (
    UNBIASED_PADDING,
    fit_meta,
    fit_unequal,
    graded_counts,
    halves_agree,
    mean_over_people,
    rank_area,
    ratio_of_means,
    roc_points,
)
from analysis.report.content import ReportContent, content_of
from analysis.report.report_source import from_question
from analysis.tables.table import Table
from analysis.tasks import analysis_of
from study_app.cli import app

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "oracle_confidence.json").read_text())
CASES = ("four", "two", "unequal")
METADPY = {"four": 1.460669, "two": 1.103685, "unequal": 0.655898}
"""meta-d' by metadpy 0.1.2 (Legrand), a translation of Maniscalco & Lau's own program."""


def counts_of(case: str) -> np.ndarray:
    return np.array([ORACLE[f"{case}_noise"], ORACLE[f"{case}_signal"]], dtype=float)


def expected(d_prime: float, criterion: float, gaps: list[float], sd: float = 1.0) -> np.ndarray:
    """Return the mean counts of 10^6 trials of an ideal observer; what it feels is its evidence."""
    away = np.array(gaps)
    edges = np.concatenate([criterion - away[::-1], [criterion], criterion + away])
    laws = (stats.norm(-0.5 * d_prime), stats.norm(0.5 * d_prime, sd))
    return np.array([np.diff(law.cdf([-np.inf, *edges, np.inf])) for law in laws]) * 1e6


# The models.


@pytest.mark.parametrize("case", CASES)
def test_meta_d_prime_is_that_of_r_and_of_metadpy(case):
    d_prime, criterion, meta, log_likelihood = ORACLE[f"{case}_meta"]
    fit = fit_meta(counts_of(case))
    assert (fit.d_prime, fit.criterion) == pytest.approx((d_prime, criterion), abs=1e-9)
    assert fit.meta_d_prime == pytest.approx(meta, abs=1e-5)
    assert fit.meta_d_prime == pytest.approx(METADPY[case], abs=2e-6)
    assert fit.log_likelihood == pytest.approx(log_likelihood, abs=1e-8)
    assert not fit.padded


@pytest.mark.parametrize("case", CASES)
def test_unequal_variances_are_those_of_rs_ordinal_with_a_scale(case):
    mean, log_sd, log_likelihood = ORACLE[f"{case}_unequal"]
    fit = fit_unequal(counts_of(case))
    assert (fit.mean, np.log(fit.sd)) == pytest.approx((mean, log_sd), abs=1e-5)
    assert fit.log_likelihood == pytest.approx(log_likelihood, abs=1e-8)
    sd = np.exp(log_sd)
    assert fit.d_a == pytest.approx(mean / np.sqrt((1 + sd**2) / 2), abs=1e-5)
    assert fit.slope == pytest.approx(1 / sd, abs=1e-5)
    assert fit.area == pytest.approx(stats.norm.cdf(mean / np.sqrt(1 + sd**2)), abs=1e-5)


@pytest.mark.parametrize("criterion", [0.0, 0.4, -0.7])
@pytest.mark.parametrize("steps", [2, 4, 11])
def test_an_ideal_observer_has_an_m_ratio_of_one(criterion, steps):
    gaps = list(np.linspace(0, 1.5, steps)[1:])
    fit = fit_meta(expected(1.2, criterion, gaps))
    assert fit.d_prime == pytest.approx(1.2, abs=1e-4)
    assert fit.ratio == pytest.approx(1.0, abs=2e-3)


def test_confidence_of_less_evidence_has_that_meta_d_prime():
    """Answers of d' 1.6, confidence of 0.8: rows of an ideal observer, weighed by answers."""
    answers, felt = (expected(d, c, [0.5, 1.0]) for d, c in ((1.6, 0.4), (0.8, 0.2)))
    for row, own in zip(felt, answers, strict=True):
        for half in (slice(0, 3), slice(3, 6)):
            row[half] *= own[half].sum() / row[half].sum()
    fit = fit_meta(felt)
    assert (fit.d_prime, fit.criterion) == pytest.approx((1.6, 0.4), abs=1e-4)
    assert fit.meta_d_prime == pytest.approx(0.8, abs=1e-3)


def test_a_signal_that_varies_more_has_a_slope_below_one():
    fit = fit_unequal(expected(1.5, 0.1, [0.4, 0.9, 1.5], sd=1.6))
    assert fit.sd == pytest.approx(1.6, abs=1e-3)
    assert fit.mean == pytest.approx(1.5, abs=1e-3)


def test_d_a_of_a_person_is_right_on_average_with_half_an_answer_more(rng):
    """Of 100 answers in two steps maxima of the likelihood are some .03 too large."""
    law = expected(1.3, 0.1, [0.5]) / 1e6
    drawn = [np.array([rng.multinomial(50, row) for row in law], float) for _ in range(200)]
    plain, padded = (
        np.mean([fit_unequal(one, padding).d_a for one in drawn]) - 1.3
        for padding in (0.0, UNBIASED_PADDING)
    )

    assert plain - padded > 0.01
    assert abs(padded) < 0.025
    assert fit_unequal(drawn[0], 0.5).d_a == pytest.approx(fit_unequal(drawn[0] + 0.125).d_a)


def test_empty_cells_are_padded_and_only_then():
    counts = counts_of("four")
    assert not fit_meta(counts).padded
    counts[0, -1] = 0.0
    fit = fit_meta(counts)
    assert fit.padded
    padded = counts + 1 / 8
    assert fit_meta(padded).meta_d_prime == pytest.approx(fit.meta_d_prime, abs=1e-9)


@pytest.mark.parametrize(
    ("counts", "why"),
    [
        ([[200, 100, 4, 0], [0, 0, 100, 200]], "fewer than 5 wrong answers"),
        ([[0, 100, 30, 0], [0, 30, 100, 0]], "one step of confidence only"),
        ([[50, 50, 50, 50], [50, 50, 50, 50]], "d' is not above its standard error"),
        ([[0, 0, 0, 0], [20, 40, 100, 200]], "only one of both stimuli was shown"),
    ],
)
def test_counts_that_cannot_be_fitted_say_why(counts, why):
    with pytest.raises(ValueError, match=why):
        fit_meta(np.array(counts, dtype=float))


@pytest.mark.parametrize(
    ("counts", "why"),
    [
        ([[100, 0, 0, 30], [30, 0, 0, 100]], "fewer than three grades"),
        ([[50, 40, 0, 0], [0, 0, 40, 50]], "without a mistake"),
        ([[0, 0, 0, 0], [20, 40, 100, 200]], "only one of both stimuli"),
        ([[0, 90, 0], [30, 0, 60]], "has no end"),
    ],
)
def test_grades_that_identify_no_slope_say_why(counts, why):
    with pytest.raises(ValueError, match=why):
        fit_unequal(np.array(counts, dtype=float))


def test_the_type_2_area_is_that_below_the_steps_counted_by_hand():
    right, wrong = np.array([4.0, 3, 3, 2]), np.array([3.0, 1])
    # Pairs won: 2 + 1.5 + 1.5 + 1 of 8.
    assert rank_area(right, wrong) == pytest.approx(6 / 8)
    points = roc_points(np.array([[1, 0, 1, 0], [0, 1, 2, 1]], dtype=float))
    assert points == ((0, 0), (0, 0.25), (0.5, 0.75), (0.5, 1), (1, 1))
    x, y = np.array(points).T
    assert np.trapezoid(y, x) == pytest.approx(6 / 8)
    assert np.isnan(rank_area(right, np.zeros(0)))


def test_graded_counts_run_from_surely_the_first_to_surely_the_second():
    found = graded_counts(
        np.array([0.0, 0, 1, 1]), np.array([0.0, 1, 1, 0]), np.array([2, 0, 2, 1]), 3
    )
    assert found.tolist() == [[1, 0, 0, 1, 0, 0], [0, 1, 0, 0, 0, 1]]


def test_limits_of_a_ratio_of_means_are_where_a_t_test_rejects(rng):
    below = rng.normal(1.2, 0.3, 9)
    above = 0.8 * below + rng.normal(0, 0.2, 9)
    found = ratio_of_means(above, below, 0.9)
    assert found.value == pytest.approx(above.mean() / below.mean())
    for end in (found.lower, found.upper):
        assert stats.ttest_1samp(above - end * below, 0.0).pvalue == pytest.approx(0.1)


def test_a_ratio_by_a_mean_that_may_be_none_has_no_limits():
    found = ratio_of_means(np.array([1.0, 2, 3]), np.array([-1.0, 0.1, 1.2]), 0.95)
    assert np.isnan(found.lower)
    assert np.isnan(found.upper)


def test_means_over_people_are_scipys(rng):
    values = np.append(rng.normal(0.6, 0.1, 8), np.nan)
    found, wanted = mean_over_people(values, 0.9, 0.5), stats.ttest_1samp(values[:8], 0.5)
    assert found.p == pytest.approx(wanted.pvalue)
    assert (found.lower, found.upper) == pytest.approx(wanted.confidence_interval(0.9))
    assert np.isnan(mean_over_people(values, 0.9).p)


def test_reliability_is_the_stepped_up_correlation_of_halves(rng):
    person = rng.normal(0, 1, 40)
    first, second = person + rng.normal(0, 0.5, 40), person + rng.normal(0, 0.5, 40)
    pairs = list(zip(first.tolist(), second.tolist(), strict=True))
    found = halves_agree("it", [*pairs, (np.nan, 1.0)], 0.95)
    half = stats.pearsonr(first, second)
    assert found.people == 40
    assert found.value == pytest.approx(2 * half.statistic / (1 + half.statistic))
    low, high = half.confidence_interval()
    ends = (2 * low / (1 + low), 2 * high / (1 + high))
    assert (found.lower, found.upper) == pytest.approx(ends)
    with pytest.raises(ValueError, match="of 5 people at least"):
        halves_agree("it", pairs[:4], 0.95)
    with pytest.raises(ValueError, match="people do not differ"):
        halves_agree("it", [(1.0, 1.0)] * 6, 0.95)


def test_people_who_differ_keep_their_m_ratio():
    """Without noise in confidence M-ratio is 1, with as much as evidence has clearly less."""
    rng = np.random.default_rng(2)
    ratios = {}
    for noise in (0.0, 1.0):
        rows = simulate_confidence(12, 400, {"a": 1.3}, rng, noise=noise)
        fits = [
            fit_meta(
                graded_counts(
                    (own["expected"] == "inconsistent").to_numpy(float),
                    (own["answer"] == "inconsistent").to_numpy(float),
                    own["confidence"].to_numpy() - 1,
                    4,
                )
            )
            for _, own in rows.groupby("participant")
        ]
        ratios[noise] = ratio_of_means(
            np.array([one.meta_d_prime for one in fits]),
            np.array([one.d_prime for one in fits]),
            0.95,
        )
    assert ratios[0.0].lower < 1.0 < ratios[0.0].upper
    assert ratios[1.0].upper < 0.85


# The parts.


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return simulate_confidence(
        6, 120, {"blur": 1.6, "ours": 1.1}, np.random.default_rng(0), noise=0.4
    )


def said_of(
    folder: Path, rows: pd.DataFrame, kind: str = "detection", **options: Any
) -> ReportContent:
    """Return what the parts of confidence say of a table."""
    rows.to_csv(folder / "rows.csv", index=False)
    analysis = analysis_of(kind)
    options = {"signal": "inconsistent"} | options if kind == "detection" else options
    source = from_question(
        analysis,
        Table(folder / "rows.csv"),
        analysis.options(**options),
        only=("confidence", "metacognition", "graded", "rates", "preferences"),
    )
    return content_of(source)


def cautions(content: ReportContent) -> str:
    """Return every note, caution and sentence."""
    notes = [
        note
        for section in content.sections
        for block in section.blocks
        for note in getattr(block, "notes", ())
    ]
    return "\n".join([*content.warnings, *notes, *content.sentences])


def numbers(content: ReportContent, part: str) -> Any:
    return content.numbers[part]


def test_confidence_by_correctness_is_that_of_the_table(rows, tmp_path):
    found = numbers(said_of(tmp_path, rows), "confidence")
    assert found["steps"] == [1, 2, 3, 4]
    means = rows.groupby(["method", "participant", "correct"])["confidence"].mean().unstack()
    for one in found["conditions"]:
        own = means.loc[one["condition"]]
        assert one["right"]["value"] == pytest.approx(own[1].mean())
        assert one["wrong"]["value"] == pytest.approx(own[0].mean())
        wanted = stats.ttest_rel(own[1], own[0])
        assert one["difference"]["p"] == pytest.approx(wanted.pvalue)
    areas = [
        stats.mannwhitneyu(own[own.correct == 1].confidence, own[own.correct == 0].confidence)
        .statistic / (own.correct.sum() * (1 - own.correct).sum())
        for _, own in rows[rows.method == "ours"].groupby("participant")
    ]  # fmt: skip
    assert found["conditions"][1]["area"]["value"] == pytest.approx(np.mean(areas))
    shares = rows.groupby(["method", "confidence"])["correct"].mean()
    for one in found["calibration"]:
        place = one["rate"]["condition"], one["step"]
        assert one["rate"]["share"] == pytest.approx(shares[place])


def test_which_of_two_answers_is_called_the_signal_does_not_move_m_ratio(rows, tmp_path):
    ratios = [
        [one["m_ratio"]["value"] for one in numbers(content, "metacognition")["conditions"]]
        for content in (
            said_of(tmp_path, rows),
            said_of(tmp_path, rows, signal="consistent"),
            said_of(tmp_path, rows, "identification"),
        )
    ]
    assert ratios[0] == pytest.approx(ratios[1], abs=1e-4)
    assert ratios[0] == pytest.approx(ratios[2], abs=1e-4)


def test_answers_without_confidence_are_left_out_of_confidence_alone(rows, tmp_path):
    lost = rows.astype({"confidence": object})
    lost.loc[::7, "confidence"] = "NA"
    found = said_of(tmp_path, lost)
    kept = said_of(tmp_path, rows.drop(rows.index[::7]))
    assert numbers(found, "confidence")["conditions"] == numbers(kept, "confidence")["conditions"]
    assert found.numbers["metacognition"] == kept.numbers["metacognition"]
    assert f"confidence is missing in {len(rows.index[::7])} of {len(rows)} answers" in cautions(
        found
    )
    assert numbers(found, "rates")["conditions"][0]["trials"] == len(rows) / 2


def all_right(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(answer=rows["expected"], correct=1)


def one_step_person(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(confidence=rows["confidence"].where(rows["participant"] != "P00", 3))


MISHAPS = {
    "no variation": (
        lambda rows: rows.assign(confidence=3),
        "no confidence: every answer was given with the same confidence (3)",
        (),
    ),
    "words": (
        lambda rows: rows.assign(confidence=rows["confidence"].map({1: "low"}).fillna("high")),
        "no confidence: the column confidence must hold numbers, such as 1 to 4 (found 'high')",
        (),
    ),
    "a slider": (
        lambda rows: rows.assign(confidence=np.arange(len(rows)) % 101),
        "must hold steps, at most 11 (found 101 values); group them into steps",
        (),
    ),
    "nothing": (lambda rows: rows.assign(confidence=""), "no answer has a confidence", ()),
    "all right": (
        all_right,
        "nobody has wrong answers: no difference, no type-2 area",
        ("confidence",),
    ),
    "all right, meta": (all_right, "(fewer than 5 wrong answers)", ("confidence",)),
    "one person": (
        lambda rows: rows[rows["participant"] == "P01"],
        "one participant only: no limits",
        ("confidence", "metacognition", "graded"),
    ),
    "one person, halves": (
        lambda rows: rows[rows["participant"] == "P01"],
        "no reliability of mean confidence: must be of 5 people",
        ("confidence", "metacognition", "graded"),
    ),
    "one step": (
        one_step_person,
        "P00 gave one step of confidence only, which tells nothing",
        ("confidence", "metacognition", "graded"),
    ),
    "one step, meta": (
        one_step_person,
        "1 participant left out: one step of confidence only",
        ("confidence", "metacognition", "graded"),
    ),
    "few": (
        lambda rows: rows.groupby(["participant", "method"]).head(16),
        "no metacognition: no participant has what it takes (fewer than 100 answers",
        ("confidence",),
    ),
    "few in each condition": (
        lambda rows: rows.groupby(["participant", "method"]).head(60),
        "no condition alone has enough answers of two people",
        ("confidence", "metacognition", "graded"),
    ),
}


@pytest.mark.parametrize("mishap", MISHAPS)
def test_what_cannot_be_had_is_said_and_why(mishap, rows, tmp_path):
    change, said, parts = MISHAPS[mishap]
    found = said_of(tmp_path, change(rows))
    assert said in cautions(found)
    assert found.numbers.keys() == {"rates", *parts}


@pytest.mark.parametrize("steps", [2, 11])
def test_scales_of_two_and_of_eleven_steps_have_every_part(steps, tmp_path):
    table = simulate_confidence(
        5, 200, {"a": 1.3}, np.random.default_rng(1), steps=np.linspace(0, 1.6, steps)[1:]
    )
    found = said_of(tmp_path, table)
    assert len(numbers(found, "confidence")["steps"]) == steps
    assert numbers(found, "metacognition")["conditions"][0]["m_ratio"]["people"] == 5
    assert numbers(found, "graded")["conditions"][0]["d_a"]["df"] == 4


def test_meta_d_prime_is_not_made_up_where_its_model_does_not_hold(rows, tmp_path):
    table = rows.replace({"inconsistent": "a", "consistent": "b"})
    found = said_of(tmp_path, table, "abx")
    assert found.numbers.keys() == {"rates", "confidence"}
    assert "no metacognition: meta-d' is of yes-no tasks and of two alternatives" in cautions(found)
    judged = rows.drop(columns=["expected", "answer"])
    found = said_of(tmp_path, judged, "identification", alternatives=2)
    assert found.numbers.keys() == {"rates", "confidence"}
    assert "no metacognition: the table must say which of two answers was right" in cautions(found)


def test_levels_within_a_condition_are_a_reason_for_caution(rows, tmp_path):
    found = said_of(tmp_path, rows.assign(level=np.arange(len(rows)) % 3), level="level")
    assert "the condition has several levels: answers of unequal d'" in cautions(found)


def test_confidence_may_be_the_condition_itself(rows, tmp_path):
    found = said_of(tmp_path, rows, by="confidence")
    assert found.numbers.keys() == {"rates"}


def run(*words: object) -> Any:
    with undrawn():
        return CliRunner().invoke(app, ["analysis", *map(str, words)], env={"COLUMNS": "200"})


def test_the_command_names_the_column_that_it_needs_and_its_cure_works(rows, tmp_path):
    rows.rename(columns={"confidence": "sure"}).to_csv(tmp_path / "rows.csv", index=False)
    words = ("confidence", tmp_path / "rows.csv", "--signal", "inconsistent")
    lost = run(*words)
    assert lost.exit_code == 2
    assert "must have the columns confidence" in lost.output.replace("\n", " ")
    assert "--map confidence=COLUMN" in lost.output.replace("\n", " ")
    done = run(*words, "--map", "confidence=sure")
    assert done.exit_code == 0, done.output
    assert "M-ratio" in done.output
    flat = rows.assign(confidence=2)
    flat.to_csv(tmp_path / "rows.csv", index=False)
    none = run(*words)
    assert none.exit_code == 2
    assert "every answer was given with the same confidence (2)" in none.output
    both = run(*words, "--alternatives", 2)
    assert both.exit_code == 2
    assert "--alternatives: must be left out with --signal" in both.output


# Preferences.


def test_confidence_of_preferences_goes_with_others_and_with_oneself(tmp_path):
    """Four people, two scenes, twice: in scene s all choose a, in scene t half of them do."""
    lines = []
    for person in range(4):
        for scene, first in (("s", (1, 1)), ("t", (1, 1) if person < 2 else (0, 0))):
            for again, chose in enumerate(first):
                mixed = person == 3 and scene == "s" and again == 1
                lines.append(
                    (f"P{person}", scene, "a", "b", 0 if mixed else chose, 3 if scene == "s" else 1)
                )
    columns = ["participant", "scene", "first", "second", "chose_first", "confidence"]
    table = pd.DataFrame(lines, columns=columns)
    table.loc[table["participant"] == "P3", "confidence"] = [2, 2, 1, 4]
    found = said_of(tmp_path, table, "preference").numbers["confidence"]
    (pair,) = found["pairs"]
    assert pair["share"] == pytest.approx(11 / 16)
    assert pair["confidence"]["value"] == pytest.approx((2 + 2 + 2 + 2.25) / 4)
    strength, most, again = found["companions"]
    # P0 sees others at s 5 of 6, at t 2 of 6: strengths 2/3 and 1/3; 2 steps for 1/3.
    # P3 sees 6 of 6 and 4 of 6: 1 and 1/3; -1/2 step for 2/3.
    assert strength["people"] == 4
    assert strength["difference"]["value"] == pytest.approx((6 + 6 + 6 - 0.75) / 4)
    # P0 to P2: with others at s (3), against them at t (1). P3: with 2, against (2 + 1 + 4) / 3.
    assert most["people"] == 4
    assert most["difference"]["value"] == pytest.approx((2 + 2 + 2 + 2 - 7 / 3) / 4)
    # P3's answers at t agree (1, 4), at s they do not (2, 2).
    assert again["people"] == 1
    assert again["difference"]["value"] == pytest.approx(0.5)


def test_preferences_without_repeats_say_so(tmp_path):
    table = pd.DataFrame(
        [(f"P{p}", "a", "b", p % 2, 1 + p % 3) for p in range(6)],
        columns=["participant", "first", "second", "chose_first", "confidence"],
    )
    found = said_of(tmp_path, table, "preference").numbers["confidence"]
    assert found["companions"][2]["lacking"] == "no repeats with same and with other answers"
    assert found["companions"][2]["difference"] is None
